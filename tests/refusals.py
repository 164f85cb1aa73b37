"""Inputs that are refused, and what is said of them, as `data/refused.toml` lists them by group."""

import re
import tomllib
from contextlib import contextmanager
from pathlib import Path

import pytest

GROUPS = tomllib.loads((Path(__file__).parent / "data" / "refused.toml").read_text("utf-8"))


def refused(group):
    """Decorator of a test, whose arguments are the keys of the cases of a group."""
    cases = GROUPS[group]
    return pytest.mark.parametrize(list(cases[0]), [tuple(case.values()) for case in cases])


@contextmanager
def raising(pattern, kind=ValueError):
    """Context of a call whose error matches a pattern, in one line."""
    with pytest.raises(kind, match=pattern) as caught:
        yield caught
    assert "\n" not in str(caught.value)


def saying(text, kind=ValueError, begins=False):
    """Context of a call whose error contains a text, or begins with it, in one line."""
    return raising("^" * begins + re.escape(text), kind)
