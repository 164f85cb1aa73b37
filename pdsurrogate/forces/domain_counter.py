"""The watch over a surrogate's domain while a run goes on: how many pairs left it, and what is done about that."""

from __future__ import annotations

import warnings

from .protocol import OutsideDomain, OutsideDomainWarning
from .settings import OUTSIDE


class DomainCounter:
    """Counts the pairs outside a model's domain over all evaluations, and stops or warns where that was asked for.

    Attributes
    ----------
    model
        Whose `domain` is watched.
    outside : str
        What is done about pairs outside, see `ForceSettings`.
    evaluations : int
        Force evaluations so far.
    pairs_outside : int
        Pairs outside the model's domain, summed over all evaluations.
    """

    def __init__(self, model, outside: str | None, n_pairs: int, quantity: str, exact: str) -> None:
        """Begin to count; `quantity` is what the model gives, `exact` what would stand in for it."""
        self.model, self.outside, self.evaluations, self.pairs_outside = model, outside or OUTSIDE, 0, 0
        self._n_pairs, self._quantity, self._stand_in = n_pairs, quantity, exact
        self._warned = False

    def _report_outside(self, found: int) -> None:
        """Take note of the pairs outside in one evaluation.

        Raises
        ------
        OutsideDomain
            If there are any, and the policy is to stop.
        """
        self.pairs_outside += found
        if not found or self.outside not in ("raise", "warn"):
            return
        what = f"{found} of {self._n_pairs} bonds are outside the domain of {self.model.name}, {self.model.domain}"
        if self.outside == "raise":
            raise OutsideDomain(f"{what}; outside=fallback would use the exact {self._stand_in} for them")
        if not self._warned:
            self._warned = True
            warnings.warn(f"{what}: its {self._quantity} there is extrapolated", OutsideDomainWarning, stacklevel=3)

    @property
    def fraction_outside(self) -> float:
        """Share of all pair evaluations so far that were outside the model's domain."""
        return self.pairs_outside / max(1, self.evaluations * self._n_pairs)
