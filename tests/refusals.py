"""Inputs that are refused, and what is said of them, as `data/refused.toml` lists them by group."""

import tomllib
from pathlib import Path

import pytest

GROUPS = tomllib.loads((Path(__file__).parent / "data" / "refused.toml").read_text("utf-8"))


def refused(group):
    """Decorator of a test, whose arguments are the keys of the cases of a group."""
    cases = GROUPS[group]
    return pytest.mark.parametrize(list(cases[0]), [tuple(case.values()) for case in cases])
