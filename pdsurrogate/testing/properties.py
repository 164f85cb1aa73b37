"""Properties that force models and laws must have, each with a name and a tolerance, and what
measuring one finds.
"""

from collections.abc import Callable, Iterable, Mapping
from dataclasses import dataclass
from functools import partial
from math import inf
from typing import Any


class DoesNotApply(Exception):
    """Exception that ends the measurement of a property that the object under test cannot have;
    its argument is the reason.
    """


def required(holds: bool, otherwise: str) -> None:
    """Raise `DoesNotApply` with the reason `otherwise`, unless the condition `holds`."""
    if not holds:
        raise DoesNotApply(otherwise)


@dataclass(frozen=True)
class Finding:
    """Result of one property.

    Parameters
    ----------
    name : str
        Name of the property.
    value : float or None
        Measured value; None if the property does not apply, infinity if the measurement failed.
    tolerance : float
        Greatest accepted value.
    note : str
        Reason why the property does not apply, the error that ended the measurement, or what was
        found.

    Examples
    --------
    >>> import pdsurrogate as pds
    >>> pds.testing.Finding("linear_momentum", 1e-9, 1e-12).holds
    False
    """

    name: str
    value: float | None
    tolerance: float
    note: str = ""

    @property
    def holds(self) -> bool:
        """Whether the value is within the tolerance, or the property does not apply.

        Examples
        --------
        >>> import pdsurrogate as pds
        >>> pds.testing.Finding("float32_agrees", None, 2e-5, "double precision only").holds
        True
        """
        return self.value is None or self.value <= self.tolerance

    def __str__(self) -> str:
        value = (
            "does not apply"
            if self.value is None
            else f"{self.value:.2g}, tolerance {self.tolerance:.2g}"
        )
        return f"{self.name}: {value}{f' ({self.note})' if self.note else ''}"


@dataclass(frozen=True)
class Property:
    """Property required of every force model, or of every law.

    Parameters
    ----------
    name : str
    tolerance : float
        Greatest accepted value.
    measure : callable
        Function of the object under test that returns the value, or the value and a note; its
        docstring describes the property.
    errors : tuple of type
        Exceptions that count as an infinite value.
    drawn : bool
        Whether `measure` takes deformations of a body as its second argument.

    Examples
    --------
    >>> import pdsurrogate as pds
    >>> [
    ...     one.tolerance
    ...     for one in pds.testing.FORCE_MODEL_PROPERTIES
    ...     if one.name == "linear_momentum"
    ... ]
    [1e-12]
    """

    name: str
    tolerance: float
    measure: Callable[..., Any]
    errors: tuple[type[Exception], ...] = ()
    drawn: bool = False

    @property
    def description(self) -> str:
        """Return what is measured: the first paragraph of the docstring of `measure`.

        Examples
        --------
        >>> import pdsurrogate as pds
        >>> pds.testing.LAW_PROPERTIES[0].description.split(",")[0]
        'Return 1 if a coded derivative is not that of the energy'
        """
        return " ".join((self.measure.__doc__ or "").split("\n\n")[0].split())

    def __call__(self, subject: Any, *given: Any, tolerance: float | None = None) -> Finding:
        """Measure the property of an object under test; `given` are further arguments of
        `measure`.
        """
        found = partial(
            Finding, self.name, tolerance=self.tolerance if tolerance is None else tolerance
        )
        try:
            value = self.measure(subject, *given)
        except DoesNotApply as reason:
            return found(None, note=str(reason))
        except self.errors as error:
            return found(inf, note=str(error))
        value, note = value if isinstance(value, tuple) else (value, "")
        return found(float(value), note=note)


def checked(
    what: str,
    subject: Any,
    all_of: Iterable[Property],
    names: Iterable[str] | None,
    tolerances: Mapping[str, float] | None,
):
    """Return the findings of the named properties, or of all; raise AssertionError with those that
    do not hold.

    Raise ValueError if a name is unknown.
    """
    known = {one.name: one for one in all_of}
    tolerances = tolerances or {}
    names = [names] if isinstance(names, str) else list(known if names is None else names)
    if unknown := [name for name in (*names, *tolerances) if name not in known]:
        raise ValueError(f"unknown property {unknown[0]!r}; the properties are {', '.join(known)}")
    findings = tuple(known[name](subject, tolerance=tolerances.get(name)) for name in names)
    if lacking := [f"  {finding}" for finding in findings if not finding.holds]:
        raise AssertionError(
            "\n".join([f"{what} lacks {len(lacking)} of {len(findings)} properties:", *lacking])
        )
    return findings
