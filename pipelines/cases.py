"""One form for comparisons with references: cases that measure errors at several spacings, their
figures as JSON, and tables made of these.

Figures go to docs/figures/NAME.json, so that cases can be run one by one, and from there into the
block NAME of the documentation.
"""

from __future__ import annotations

import argparse
import json
import time
from collections.abc import Callable, Iterable, Mapping
from dataclasses import dataclass, field

from pages import FIGURES, markdown_table, replace_block

import pdsurrogate as pds
from pdsurrogate.results.files import write_json

Errors = Iterable[tuple[str, float, int]]
"""Names of quantities with their error in percent, and the number of force evaluations of the
run.
"""


@dataclass(frozen=True)
class Case:
    """A case at several spacings.

    Attributes
    ----------
    measure : callable
        Of a spacing; gives `Errors`.
    spacings : tuple of float
        From coarse to fine.
    title : str
        What is compared, if the name of the case does not say it.
    aims : dict of str
        By quantity: the greatest error aimed at, in percent, and the spacing.
    """

    measure: Callable[[float], Errors]
    spacings: tuple[float, ...]
    title: str = ""
    aims: Mapping[str, str] = field(default_factory=dict)


def percent(found: float, expected: float) -> float:
    """By how much a value is off."""
    return 100 * (found / expected - 1)


def stored(name: str) -> dict[str, dict[str, dict[str, dict]]]:
    """Error and evaluations by case, quantity and spacing."""
    path = FIGURES / f"{name}.json"
    return json.loads(path.read_text("utf-8")) if path.exists() else {}


def measure(name: str, cases: Mapping[str, Case], chosen: Iterable[str], coarse: bool) -> None:
    """Measure some of the cases, or only their two coarser spacings, and store the figures."""
    found = stored(name)
    for title in chosen:
        for spacing in cases[title].spacings[: 2 if coarse else None]:
            began, key = time.perf_counter(), f"{spacing:.4g}"
            try:
                for quantity, error, count in cases[title].measure(spacing):
                    entry = {"error": float(f"{error:.4g}"), "evaluations": count}
                    found.setdefault(title, {}).setdefault(quantity, {})[key] = entry
                    print(
                        f"{title}, {quantity}, spacing {key}: {error:+.3g} %, {count} evaluations",
                        flush=True,
                    )
            except pds.SimulationFailed as failure:
                print(f"{title}, spacing {key}: {failure}", flush=True)
            print(f"{title}, spacing {key}: {time.perf_counter() - began:.0f} s", flush=True)
        write_json(
            FIGURES / f"{name}.json", {title: found[title] for title in cases if title in found}
        )


def shown(value: float) -> str:
    """An error, with few digits where it is small."""
    return f"{value:+.2f}" if abs(value) >= 0.005 or not value else f"{value:+.0e}"


def table(name: str, cases: Mapping[str, Case]) -> str:
    """The table of all cases that have figures."""
    lines, found, aimed = [], stored(name), any(case.aims for case in cases.values())
    for title, case in cases.items():
        first = f"{case.title} (`{title}`)" if case.title else title
        for quantity, points in found.get(title, {}).items():
            entries = [points.get(f"{spacing:.4g}") for spacing in case.spacings]
            columns = [[f"{spacing:.4g}" for spacing in case.spacings]]
            columns.append(
                ["none" if entry is None else shown(entry["error"]) for entry in entries]
            )
            columns.append(
                [
                    "none" if entry is None else str(entry.get("evaluations", "-"))
                    for entry in entries
                ]
            )
            aim = [case.aims.get(quantity, "")] if aimed else []
            lines.append([first, quantity, *aim, *map(" / ".join, columns)])
            first = ""
    return markdown_table(
        [
            "case",
            "quantity",
            *(["aim (%)"] if aimed else []),
            "spacing",
            "error (%)",
            "evaluations",
        ],
        lines,
    )


def compare(told: str, groups: Mapping[str, Mapping[str, Case]]) -> None:
    """Run the cases that the command line names, or all, or with ``--docs`` write the tables of the
    stored figures.

    `told` is the docstring of the script, and `groups` are its cases by the name of their block and
    their JSON.
    """
    parser = argparse.ArgumentParser(
        description=told, formatter_class=argparse.RawDescriptionHelpFormatter
    )
    parser.add_argument(
        "words",
        nargs="*",
        metavar="WORD",
        help="cases or groups that have one of these words in their names",
    )
    parser.add_argument("--coarse", action="store_true", help="the two coarser spacings alone")
    parser.add_argument(
        "--docs",
        action="store_true",
        help="put the tables of all stored figures into the documentation",
    )
    arguments = parser.parse_args()
    for name, cases in groups.items():
        wanted = [
            title for title in cases if any(word in f"{name}: {title}" for word in arguments.words)
        ]
        measure(
            name, cases, wanted if arguments.words or arguments.docs else cases, arguments.coarse
        )
        if arguments.docs:
            replace_block(name, table(name, cases))
