"""Other programs beside this one, on one machine in one run: what the same answer costs in each.

python pipelines/peers.py --docs           all cases, and their tables into docs/validation/peers.md
python pipelines/peers.py --quick          the short ones, once; nothing is stored
python pipelines/peers.py cube --docs      those with such a word in their names

Each row of a case is a function of a file in `peers/` that runs as a process of its own, on one
thread, in the environment that the row names. Environments of peers are made in a cache folder,
from pinned versions; rows of programs that are missing are left out by name. Of a row that has
several settings, from coarse to fine, the first that is good enough is timed, in turns with those
of the other rows: medians of three, of which the first has what has to be compiled.
"""

from __future__ import annotations

import argparse
import json
import os
import shutil
import subprocess
import sys
import tempfile
import tomllib
from datetime import date
from pathlib import Path
from statistics import median

from pages import FIGURES, markdown_table, replace_block, rounded, shown
from processes import NotRun, spent

# Nothing of the package is imported: memory of a process counts that of the one which starts it.
ROOT = Path(__file__).resolve().parents[1]
PEERS = ROOT / "pipelines" / "peers"
STORE = FIGURES / "peers.json"
CACHE = Path(os.environ.get("XDG_CACHE_HOME", Path.home() / ".cache")) / "pdsurrogate-peers"

TOLD = tomllib.loads((ROOT / "pipelines" / "data" / "peers.toml").read_text("utf-8"))
CASES = TOLD["cases"]
ENVIRONMENTS = {"pdsurrogate": sys.executable, "debian": "/usr/bin/python3", **TOLD["environments"]}
"""Interpreters; or what pip installs for one, after the name of a Python unless it is this one."""

SPENT = {"processor time (s)": ".1f", "wall time (s)": ".1f", "memory (MB)": ".0f"}


def interpreter(name):
    """Python of an environment, which is made where it is missing or has other versions."""
    wanted = ENVIRONMENTS[name]
    if isinstance(wanted, str):
        return wanted
    base, *packages = wanted if wanted[0].startswith("python") else [sys.executable, *wanted]
    folder, python = CACHE / name, CACHE / name / "bin" / "python"
    said = folder / "installed.txt"
    if not said.exists() or said.read_text() != "\n".join(wanted):
        others = Path.home().glob(f".pyenv/versions/{base.removeprefix('python')}*/bin/python")
        if not (base := next(map(str, others), None) or shutil.which(base)):
            raise NotRun(f"no {wanted[0]} is installed")
        for command in (
            [base, "-m", "venv", "--clear", folder],
            [python, "-m", "pip", "install", "-q", *packages],
        ):
            done = subprocess.run(command, capture_output=True, text=True, check=False)
            if done.returncode:
                raise NotRun(done.stderr.strip().splitlines()[-1])
        said.write_text("\n".join(wanted))
    return str(python)


def figures_of(file, row, setting):
    """What a process of a row prints, and what it costs."""
    _, environment, function, _ = row
    setting = dict(setting)
    threads = str(setting.pop("threads", 1))
    code = f"import json\nfrom {file} import {function}\nprint(json.dumps({function}(**{setting})))"
    limited = {
        f"{library}_NUM_THREADS": threads for library in ("OMP", "NUMBA", "MKL", "OPENBLAS", "CCX")
    }
    own = environment == "pdsurrogate"
    seen = [str(one) for one in (PEERS, *((ROOT, ROOT / "pipelines") if own else ()))]
    if not own:  # libraries in wheels, such as that of MPI
        limited["LD_LIBRARY_PATH"] = str(CACHE / environment / "lib")
    python = "timeout", "900", interpreter(environment)
    with tempfile.TemporaryDirectory() as folder:
        return spent(folder, "-c", code, python=python, PYTHONPATH=":".join(seen), **limited)


def compared(name, case, turns):
    """Figures of the rows of a case by label, medians of so many turns."""
    found, ready, bounds = {}, [], case.get("within", {})
    for row in case["rows"]:
        label, *_, settings = row
        try:
            for setting in settings:
                found[label] = figures_of(case["file"], row, setting)
                print(f"{name}, {label}, {setting}: {rounded(found[label])}", flush=True)
                if all(abs(found[label][key]) < most for key, most in bounds.items()):
                    break
            ready.append((row, setting, [found[label]]))
        except NotRun as failure:
            found[label] = {"left out": str(failure)}
            print(f"{name}, {label}: left out, {failure}", flush=True)
    for _ in range(turns - 1):
        for row, setting, of_turns in ready:
            of_turns.append(figures_of(case["file"], row, setting))
    for (label, *_), _, of_turns in ready:
        for key, value in found[label].items():
            if not isinstance(value, str):
                found[label][key] = median(one[key] for one in of_turns)
    return rounded(found)


def table(case, rows):
    """The table of a case, and what is missing in it."""
    columns = {**case["columns"], **SPENT}
    lines = [
        [label, *(shown(row.get(key), form) for key, form in columns.items())]
        for label, row in rows.items()
        if "left out" not in row
    ]
    left = "; ".join(
        f"{label} ({row['left out']})" for label, row in rows.items() if "left out" in row
    )
    return markdown_table(["program", *columns], lines) + (f"\n\nLeft out: {left}." if left else "")


def stored():
    """Cases measured so far."""
    return json.loads(STORE.read_text("utf-8")) if STORE.exists() else {}


def blocks(known):
    """Texts of the blocks of the page."""
    days = sorted({case["day"] for case in known.values()})
    places = [ENVIRONMENTS[row[1]] for name in known for row in CASES[name]["rows"]]
    versions = {one for place in places if not isinstance(place, str) for one in place}
    found = {f"peers-{name}": table(CASES[name], case["rows"]) for name, case in known.items()}
    machines = ", ".join(sorted({case["machine"] for case in known.values()}))
    found["peers-machine"] = f"{machines}; {' to '.join(days)}; {', '.join(sorted(versions))}."
    return found


def machine():
    """The processor's name."""
    lines = Path("/proc/cpuinfo").read_text().splitlines()
    return next(line.split(": ")[1] for line in lines if line.startswith("model name"))


def main():
    """Measure the cases that the command line names, or all."""
    parser = argparse.ArgumentParser(
        description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter
    )
    parser.add_argument("words", nargs="*", help="words in names of cases")
    parser.add_argument("--quick", action="store_true", help="short cases, once")
    parser.add_argument("--docs", action="store_true", help="write the tables of stored figures")
    parser.add_argument("--tables", action="store_true", help="--docs, and measure nothing")
    options = parser.parse_args()
    for name, case in CASES.items():
        wanted = not options.words or any(word in name for word in options.words)
        if options.tables or not wanted or (options.quick and case.get("long")):
            continue
        turns = 1 if options.quick or case.get("once") else 3
        rows = compared(name, case, turns)
        if not options.quick:
            known = stored() | {
                name: {"day": str(date.today()), "machine": machine(), "rows": rows}
            }
            known = {one: known[one] for one in CASES if one in known}
            STORE.write_text(json.dumps(known, indent=1) + "\n", "utf-8")
    if options.docs or options.tables:
        for block, text in blocks(stored()).items():
            replace_block(block, text)


if __name__ == "__main__":
    main()
