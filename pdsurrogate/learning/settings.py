"""Settings of a fit to a law: the choices of `pdsurrogate fit`, and of studies that fit."""

from __future__ import annotations

from collections.abc import Callable, Sequence
from dataclasses import dataclass, replace
from pathlib import Path

from ..materials import Law
from .card_text import CardText
from .chebyshev import ChebyshevRegressor
from .fitting import cross_validate
from .levenberg_marquardt import LevenbergMarquardtRegressor
from .pipeline import parts_of
from .sampling import checked_range
from .sobolev import SobolevRegressor
from .storing import store
from .surrogates import TARGETS, reachable_stretches, surrogate_pipeline, training_samples
from .target import InputAwareTargetRegressor
from .targets import Samples

DEGREES = (12, 6)
"""Of a polynomial in the two isochoric features, where none are asked for."""


@dataclass(frozen=True)
class FitSettings:
    """Choices for a fit; what is left at None is chosen for what is fitted.

    Parameters
    ----------
    energy : bool
        The isochoric energy of the law instead of its bond force: a network.
    features : str, optional
        See `pdsurrogate.surrogate_pipeline`; "isochoric" of a polynomial, "symmetric" of a network.
    degree, units : int, sequence of int or str, optional
        Degrees of a polynomial, or hidden units of a network, layer by layer; as text with commas between.
    activation : str, optional
        Of a network, by default "algebraic".
    samples : int, optional
        8000, of an energy 1000.
    least, greatest : float, optional
        Principal stretches trained on: 0.5 (of an energy 0.25) and 4, or as far as the law goes.
    iterations : int, optional
        Most iterations of the training of a network: 1000, of an energy 500.
    folds : int
        Of the cross-validation; 0 for none.
    seed : int
        Of samples, split and first weights.

    Raises
    ------
    ValueError
        If the choices do not go together; names them.
    """

    energy: bool = False
    features: str | None = None
    degree: int | Sequence[int] | str | None = None
    units: int | Sequence[int] | str | None = None
    activation: str | None = None
    samples: int | None = None
    least: float | None = None
    greatest: float | None = None
    iterations: int | None = None
    folds: int = 5
    seed: int = 0

    def __post_init__(self) -> None:
        if self.folds < 0 or self.folds == 1 or self.folds > self.n_samples:
            raise ValueError(f"folds must be 0, or from 2 to the number of samples, not {self.folds}")
        self.asked_range()
        self.pipeline()

    def within(self, least: float, greatest: float) -> FitSettings:
        """Return these settings for a material that is known between two stretches, which are the range where none is given."""
        return replace(
            self, least=least if self.least is None else self.least, greatest=greatest if self.greatest is None else self.greatest
        )

    @property
    def target(self) -> str:
        """Name of the target."""
        return "isochoric-energy" if self.energy else "bond-force"

    @property
    def n_samples(self) -> int:
        """Number of training samples."""
        return self.samples or TARGETS[self.target].n_samples

    def asked_range(self) -> tuple[float, float]:
        """Return the principal stretches to train on, before the reach of any law is known."""
        low, high = TARGETS[self.target].stretch_range
        return checked_range((low if self.least is None else self.least, high if self.greatest is None else self.greatest))

    def pipeline(self) -> tuple[InputAwareTargetRegressor, str]:
        """Return the pipeline, not fitted, and its description in words."""
        return self._energy() if self.energy else self._bond_force()

    def _bond_force(self) -> tuple[InputAwareTargetRegressor, str]:
        if self.units is None:
            if self.activation is not None or self.iterations is not None:
                raise ValueError("activation and iterations are of a network: give its units")
            degrees = DEGREES if self.degree is None else _numbers(self.degree, "degree")
            regressor = ChebyshevRegressor(degrees if len(degrees) > 1 else degrees[0])
            chosen, what = self.features or "isochoric", f"polynomial of degree {_words(degrees)}"
        else:
            if self.degree is not None:
                raise ValueError("degree is of a polynomial, units of a network: choose one")
            hidden = _numbers(self.units, "units")
            options = {"max_iter": self.iterations or 1000, "n_iter_no_change": 100, "random_state": self.seed}
            regressor = LevenbergMarquardtRegressor(hidden, self.activation or "algebraic", **options)
            chosen, what = self.features or "symmetric", f"{_words(hidden)} units"
        pipeline = surrogate_pipeline(regressor, features=chosen)
        parts_of(pipeline)  # what would be resampled is an error here: another choice is exact, and known before the training
        return pipeline, f"{chosen} features, {what}"

    def _energy(self) -> tuple[InputAwareTargetRegressor, str]:
        for key in ("features", "degree"):
            if getattr(self, key) is not None:
                raise ValueError(f"{key} is of bond forces; of the network of an energy units are to choose")
        hidden = _numbers(8 if self.units is None else self.units, "units")
        if len(hidden) != 1:
            raise ValueError(f"the network of an energy has one layer, not units {_words(hidden)}")
        options = {"max_iter": self.iterations or 500, "n_init": 2, "random_state": self.seed}
        return surrogate_pipeline(SobolevRegressor(*hidden, self.activation or "algebraic", **options), self.target), f"{hidden[0]} units"

    def design(self, law: Law) -> Samples:
        """Return training samples of a law, over the range given, or as far as the law goes."""
        reach = reachable_stretches(law, self.asked_range(), self.target)
        box = (reach[0] if self.least is None else self.least, reach[1] if self.greatest is None else self.greatest)
        return training_samples(law, self.n_samples, box, random_state=self.seed, target=self.target)

    def cross_validate(
        self, pipeline: InputAwareTargetRegressor, design: Samples, progress: Callable[[int], None] = lambda fold: None
    ) -> list[dict]:
        """Return the relative errors of clones on the fold left out, fold by fold; an empty list for 0 folds."""
        return cross_validate(pipeline, design, self.folds, self.seed, progress=progress) if self.folds else []

    def store(
        self,
        pipeline: InputAwareTargetRegressor,
        design: Samples,
        law: Law,
        folder: str | Path,
        name: str,
        version: str,
        cross_validation: list[dict],
        identification: dict | None = None,
        members: Sequence[tuple] = (),
    ) -> Path:
        """Write the artefact of a fitted pipeline; see `pdsurrogate.store` for the arguments and errors."""
        description = f"{'Isochoric energy' if self.energy else 'Bond force'} of {law.name}, {self.pipeline()[1]}"
        text = CardText(description, cross_validation, identification=identification)
        return store(pipeline, design, law, folder, name, version, text, members)

    def committee(self, laws: Sequence[Law], progress: Callable[[int], None] = lambda member: None) -> list[tuple]:
        """Return members of a committee for `store`, a fit to every law with its own seed; call `progress` with each number, from 0."""
        members = []
        for number, law in enumerate(laws):
            progress(number)
            settings = replace(self, seed=self.seed + number + 1)
            design = settings.design(law)
            members.append((settings.pipeline()[0].fit(design.X, design.y), design, law))
        return members


def _numbers(value: int | Sequence[int] | str, key: str) -> tuple[int, ...]:
    if isinstance(value, int):
        return (value,)
    try:
        return tuple(int(number) for number in (value.split(",") if isinstance(value, str) else value))
    except (TypeError, ValueError):
        raise ValueError(f"{key} must be whole numbers with commas between, not {value!r}") from None


def _words(numbers: Sequence[int]) -> str:
    return ",".join(map(str, numbers))
