"""Checks of arguments of public functions before work starts; an error names the argument and
the right value, or a similar one.
"""

import difflib
import math
import os
from collections.abc import Iterable
from numbers import Integral, Real
from typing import Any


def check_kind(value: Any, kind: Any, what: str, wanted: str) -> None:
    """Raise TypeError unless a value is an instance of `kind`, a class or a union of classes; True
    and False are refused for every kind.

    The message names the argument, `what`, and the value that is `wanted`.
    """
    if not isinstance(value, kind) or isinstance(value, bool):
        raise TypeError(f"{what} must be {wanted}, not {kind_of(value)}")


def check_whole_number(
    value: Any, what: str, least: float = -math.inf, most: float = math.inf
) -> None:
    """Raise TypeError if the argument named `what` is no whole number, ValueError if it is less
    than `least` or more than `most`.
    """
    check_kind(value, Integral, what, "a whole number")
    if not least <= value <= most:
        raise ValueError(
            f"{what} must be"
            f" {f'at least {least}' if most == math.inf else f'from {least} to {most}'}, not"
            f" {value}"
        )


def check_seed(value: Any) -> None:
    """Raise TypeError or ValueError unless the argument ``random_state`` is a whole number from
    0 to 2^32 - 1, as all generators accept.
    """
    check_whole_number(value, "random_state", 0, 2**32 - 1)


def check_share(value: Any, what: str) -> None:
    """Raise TypeError if the argument named `what` is no number, ValueError if it is not from 0
    to 1.
    """
    check_kind(value, Real, what, "a number from 0 to 1")
    if not 0 <= value <= 1:
        raise ValueError(f"{what} must be from 0 to 1, not {value}")


def check_seconds(value: Any, what: str) -> None:
    """Raise TypeError if the argument named `what`, in seconds, is no number, ValueError if it
    is not positive and finite.
    """
    check_kind(value, Real, what, "a number of seconds")
    if not 0 < value < math.inf:
        raise ValueError(f"{what} must be a number of seconds greater than 0, not {value}")


def check_path(value: Any, what: str) -> None:
    """Raise TypeError if the argument named `what` is neither text nor a path."""
    check_kind(value, str | os.PathLike, what, "text or a path")


def check_estimator(value: Any, what: str = "model") -> None:
    """Raise TypeError if the argument named `what` is a class, or lacks a method fit, predict or
    get_params of scikit-learn estimators.
    """
    if isinstance(value, type):
        raise TypeError(f"{what} must be an estimator, not its class: give {value.__name__}()")
    if not all(callable(getattr(value, name, None)) for name in ("fit", "predict", "get_params")):
        raise TypeError(
            f"{what} must be an estimator with fit, predict and get_params, not {kind_of(value)}"
        )


def check_jobs(value: Any) -> None:
    """Raise TypeError or ValueError unless the argument ``n_jobs`` is one that joblib takes: a
    whole number other than 0, or None.
    """
    check_kind(value, Integral | None, "n_jobs", "a whole number or None")
    if value == 0:
        raise ValueError("n_jobs must be at least 1, or -1 for all cores, not 0")


def check_tables(value: Any, what: str) -> None:
    """Raise TypeError if the argument named `what` is neither a list or tuple of dictionaries
    nor None.
    """
    if value is not None and not (
        isinstance(value, list | tuple) and all(isinstance(row, dict) for row in value)
    ):
        raise TypeError(f"{what} must be a list of dictionaries, or None, not {kind_of(value)}")


def check_numbers(values: Any, what: str, wanted: str) -> None:
    """Raise ValueError if an array or table named `what` has no rows, rows of different lengths,
    or text; messages end with `wanted`.
    """
    import numpy as np

    try:
        found = np.asarray(values)
    except ValueError:
        raise ValueError(f"{what}: its rows have different lengths; {wanted}") from None
    texts = (
        [str(one) for one in found.flat if isinstance(one, str | bytes)]
        if found.dtype.kind in "USO"
        else []
    )
    if texts:  # beside text, numbers in a list become text, too
        wrong = next(
            (text for text in texts if not text.strip("+-.e").replace(".", "").isdigit()), texts[0]
        )
        raise ValueError(f"{what}: {wrong!r} is no number; {wanted}")
    if found.ndim and not len(found):
        raise ValueError(f"{what}: it is empty; {wanted}")


def check_names(value: Any, what: str, wanted: str) -> None:
    """Raise TypeError unless the argument named `what` is a list or tuple of text, ValueError if
    it is empty; messages tell `wanted`.
    """
    if not isinstance(value, list | tuple) or not all(isinstance(one, str) for one in value):
        wrong = (
            value
            if not isinstance(value, list | tuple)
            else next(one for one in value if not isinstance(one, str))
        )
        raise TypeError(f"{what} must be a list of names, {wanted}, not {kind_of(wrong)}")
    if not value:
        raise ValueError(f"{what}: the list is empty; give names, {wanted}")


def in_order(table, columns: tuple[str, ...] | None, title: str):
    """Return a table, such as a DataFrame, with its columns in the order of `columns`; messages
    call the table `title`.

    An array or a table without column names is returned as it is, and so is every table if
    `columns` is None.

    Raises
    ------
    ValueError
        If the names of the table's columns are not those in `columns`.
    """
    from sklearn.utils.validation import _get_feature_names

    names = None if columns is None else _get_feature_names(table)
    if names is None or list(names) == list(columns):
        return table
    if sorted(names) != sorted(columns):
        raise ValueError(
            f"{title} must have the columns {', '.join(columns)}, in any order, not"
            f" {', '.join(names)}"
        )
    return table[list(columns)]


def kind_of(value: Any) -> str:
    """Return the text that stands for a value in a message: its repr if it is a number, text or
    None, else the name of its class.
    """
    return (
        repr(value)
        if value is None or isinstance(value, bool | int | float | str | bytes)
        else f"a {type(value).__name__}"
    )


CLOSE = 0.78
"""Similarity of two words, from 0 to 1, above which one may be a misspelling of the other: elipse
and ellipse are similar (0.92), cube and tube are not (0.75).
"""


def check_known(
    word: Any, known: Iterable[str], unknown: str, otherwise: str = "there are"
) -> None:
    """Raise ValueError with the text `unknown` and a `suggestion` unless a word is known."""
    known = list(known)
    if word not in known:
        raise ValueError(f"{unknown}; {suggestion(str(word), known, otherwise)}")


def suggestion(
    word: str, known: Iterable[str], otherwise: str = "there are", unlisted: Iterable[str] = ()
) -> str:
    """Return the end of a message about an unknown word: "did you mean" a similar known word, else
    `otherwise` and all known words.

    Words that are `unlisted` may be meant, too, but are not among those that the message lists.
    """
    known = list(known)
    nearest = difflib.get_close_matches(word, [*known, *unlisted], 1, CLOSE)
    return f"did you mean {nearest[0]}?" if nearest else f"{otherwise} {', '.join(known)}"
