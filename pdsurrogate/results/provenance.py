"""Provenance of a result: version and state of the package, time, and machine."""

import os
import platform
import subprocess
from contextlib import suppress
from datetime import UTC, datetime
from functools import cache
from pathlib import Path

import numba
import numpy
import scipy

from .. import __version__


def provenance() -> dict:
    """Return the versions of the package and its libraries, the commit, the date and the
    machine, as entries for a run's summary.
    """
    return {
        "version": __version__,
        "git": git_state(),
        "date": datetime.now(UTC).isoformat(timespec="seconds"),
        "machine": {
            "processor": processor(),
            "cores": os.cpu_count(),
            "system": platform.platform(),
        },
        "python": platform.python_version(),
        **{library.__name__: library.__version__ for library in (numpy, scipy, numba)},
    }


@cache
def processor() -> str:
    """Return the name of the processor that the system reports."""
    with suppress(OSError):
        for line in Path("/proc/cpuinfo").read_text().splitlines():
            if line.startswith("model name"):
                return line.split(":", 1)[1].strip()
    return platform.processor() or platform.machine()


@cache
def git_state() -> dict | None:
    """Return the commit of the git checkout from which the package runs, and whether files are
    modified; None without a checkout.
    """
    root = Path(__file__).resolve().parents[2]
    if not (root / ".git").exists():
        return None

    words = [
        "git",
        "-C",
        str(root),
        "describe",
        "--always",
        "--exclude=*",
        "--dirty",
        "--abbrev=40",
    ]
    with suppress(OSError, subprocess.SubprocessError):
        done = subprocess.run(words, capture_output=True, text=True, timeout=10, check=True)
        commit, _, dirty = done.stdout.strip().partition("-")
        return {"commit": commit, "modified": bool(dirty)}
    return None
