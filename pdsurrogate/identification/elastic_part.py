"""Elastic energies in fits of branches: their stress is linear in some of their parameters."""

from collections.abc import Callable, Sequence
from typing import NamedTuple

import numpy as np

from ..materials import Law
from ..materials.dictionary import OF_TESTS, Term
from ..materials.polyconvex import law_of, stiffness_of
from .averaging import columns_of, isochoric
from .energy import mode_of
from .regressor import LawRegressor
from .stress_regressor import BULK_RATIO


class Elastic(NamedTuple):
    """Family of elastic energies of one mode of the data or more.

    Attributes
    ----------
    names : list of str
        Names of the parameters: first those in which the stress is linear, then those of a shape.
    shapes : sequence of sequence of float
        Shapes from which a search starts.
    columns : callable
        ``columns(shape)`` returns the nominal stresses (n, n_linear) of unit parameters; it raises
        ValueError for a shape that no law has.
    law : callable
        ``law(values)`` returns the law.
    search_range : callable
        As `LawRegressor.search_range`.
    only : callable, optional
        ``only(kept)`` returns the family without some of its linear parameters, which `kept`, a
        mask, leaves out; None if a law needs all of them.
    """

    names: list[str]
    shapes: Sequence[Sequence[float]]
    columns: Callable[[Sequence[float] | np.ndarray], np.ndarray]
    law: Callable[[np.ndarray], Law]
    search_range: Callable[[np.ndarray, float], tuple[np.ndarray, np.ndarray, np.ndarray]]
    only: Callable[[np.ndarray], "Elastic"] | None = None

    @property
    def linear(self) -> int:
        """Number of parameters in which the stress is linear."""
        return len(self.names) - len(self.shapes[0])


def elastic_of_law(regressor: LawRegressor, states: np.ndarray) -> Elastic:
    """Return the energies of a regressor's law in states (n, 2), stretches along the stress and
    across it.
    """
    return Elastic(
        regressor.unknowns(),
        regressor.shapes(),
        lambda shape: regressor.unit_stresses(shape, states),
        regressor.law_of,
        regressor.search_range,
    )


def elastic_without_law(states: np.ndarray, kept: Sequence[Term] | None = None) -> Elastic:
    """Return sums of the terms of the dictionary, or of those `kept`, in states (n, 2): of
    functions of the first invariant if they are of one mode of loading, else of the second too.
    """
    if kept is None:
        # The mode of loading of states that are strained less does not count.
        strained = np.abs(np.log(states[:, 0])) > 0.05
        of_one = len({*mode_of(states)[strained]}) < 2
        kept = [one for one in OF_TESTS if one.polyconvex and not (of_one and one.row[0] < 2)]
    terms = list(kept)
    table = columns_of(isochoric(states, np.ones(len(states))), states[:, 0], terms)

    def search_range(values: np.ndarray, scale: float):
        return np.zeros(len(terms)), np.full(len(terms), np.inf), np.zeros(len(terms), dtype=bool)

    def only(chosen: np.ndarray) -> Elastic:
        some = [term for term, one in zip(terms, chosen, strict=True) if one]
        return elastic_without_law(states, some)

    return Elastic(
        [f"weight of {term}" for term in terms],
        [()],
        lambda _: table,
        lambda sizes: law_of(terms, sizes, BULK_RATIO * stiffness_of(terms, sizes)),
        search_range,
        only,
    )
