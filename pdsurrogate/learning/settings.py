"""Settings with which a surrogate is fitted to a law, for the command ``pdsurrogate fit`` and
for parameter studies.
"""

from collections.abc import Callable, Sequence
from dataclasses import replace
from pathlib import Path
from typing import Annotated, Any, Self

from pydantic import BeforeValidator, Field
from typer import Option

from ..arguments import check_known
from ..kernels.feature_sets import FEATURE_SETS
from ..kernels.network import ACTIVATIONS, MOST_HIDDEN
from ..materials import Law
from ..progress import part
from ..scenes.strict_model import NUMBER, StrictModel
from .chebyshev import ChebyshevRegressor
from .fitting import (
    TARGETS,
    cross_validate,
    reachable_stretches,
    surrogate_pipeline,
    training_samples,
)
from .levenberg_marquardt import LevenbergMarquardtRegressor
from .sampling import checked_range
from .sobolev import SobolevRegressor
from .storing import CardText, store
from .target import InputAwareTargetRegressor, Samples

DEGREES = (12, 6)
"""Default degrees of a polynomial in the two isochoric features: the best of those compared on the
cards of the shipped artifacts of Gent's and Ogden's law and the full network, 2e-6 to 4e-5 RMS off.
"""


def _as_text(value: Any) -> Any:
    """Return degrees or units, given as a number or a sequence of numbers, as text with commas
    between them.
    """
    if isinstance(value, list | tuple):
        return ",".join(str(_as_text(number)) for number in value)
    return (
        f"{value:.15g}" if isinstance(value, int | float) and not isinstance(value, bool) else value
    )


class FitSettings(StrictModel):
    """Settings with which a surrogate is fitted to a law; each is an option of the command
    ``pdsurrogate fit``. None stands for a default.

    Parameters
    ----------
    energy : bool
        Whether a network is fitted to the isochoric energy of the law instead of its bond force.
    features : str, optional
        Feature set of a bond force: ``"isochoric"``, the default of polynomials; ``"symmetric"``,
        the default of networks; or ``"paper"``.
    degree : int, sequence of int or str, optional
        Degrees of a polynomial in its features; in text separated by commas. By default 12,6.
    units : int, sequence of int or str, optional
        Hidden units of a network, layer by layer; in text separated by commas. If they are given, a
        network is fitted instead of a polynomial.
    activation : str, optional
        Activation of a network: ``"algebraic"``, the default, ``"logistic"``, ``"tanh"`` or
        ``"relu"``.
    samples : int, optional
        Number of samples, by default 8000, or 1000 for an energy.
    least : float, optional
        Least principal stretch of the samples; by default 0.5 (0.25 for an energy), or as far as
        the law is finite. Unit: none.
    greatest : float, optional
        Greatest principal stretch of the samples; by default 4, or as far as the law is finite.
        Unit: none.
    iterations : int, optional
        Greatest number of iterations in the training of a network, by default 1000, or 500 for an
        energy.
    folds : int
        Folds of the cross-validation; 0 for none.
    seed : int
        Seed of samples, split and first weights.

    Raises
    ------
    SceneError
        If a setting is wrong, or if settings exclude each other; the message names them.
    """

    energy: Annotated[
        bool,
        Option(
            "--energy",
            help="Fit the isochoric energy, for plane strain, solids and any bulk modulus.",
        ),
    ] = False
    features: Annotated[
        str | None,
        Option(
            help="Features: isochoric (default for polynomials), symmetric (for networks) or paper."
        ),
    ] = None
    degree: Annotated[
        str | None,
        BeforeValidator(_as_text),
        Option(help="Degrees of a polynomial (default: 12,6)."),
    ] = None
    units: Annotated[
        str | None,
        BeforeValidator(_as_text),
        Option(help="Hidden units of a network instead, layer by layer."),
    ] = None
    activation: Annotated[
        str | None,
        Option(help="Activation: algebraic, logistic, tanh or relu (default: algebraic)."),
    ] = None
    samples: Annotated[
        int | None,
        Field(ge=200),
        NUMBER,
        Option(help="Samples (default: 8000, energies 1000).", min=200),
    ] = None
    least: Annotated[
        float | None,
        NUMBER,
        Option(help="Least principal stretch (default: 0.5, energies 0.25; or the law's limit)."),
    ] = None
    greatest: Annotated[
        float | None,
        NUMBER,
        Option(help="Greatest principal stretch (default: 4, or the law's limit)."),
    ] = None
    iterations: Annotated[
        int | None,
        Field(ge=1),
        NUMBER,
        Option(help="Most iterations of a network's training.", min=1),
    ] = None
    folds: Annotated[
        int,
        Field(ge=0),
        NUMBER,
        Option(help="Number of folds of the cross-validation (0: none).", min=0),
    ] = 5
    seed: Annotated[
        int, Field(ge=0), NUMBER, Option(help="Seed of samples, splits and initial weights.", min=0)
    ] = 0

    def model_post_init(self, context: Any) -> None:
        if self.folds != 0 and not 2 <= self.folds <= self.n_samples:
            raise ValueError(
                f"folds must be 0, or from 2 to the number of samples, not {self.folds}"
            )
        checked_range(self._range(*TARGETS[self.target].stretch_range))
        self.pipeline()

    def within(self, least: float, greatest: float) -> Self:
        """Return these settings with a range of stretches in the place of the bounds that are
        None.
        """
        least, greatest = self._range(least, greatest)
        return self.model_copy(update={"least": least, "greatest": greatest})

    @property
    def target(self) -> str:
        """Name of the quantity to learn: isochoric-energy or bond-force."""
        return "isochoric-energy" if self.energy else "bond-force"

    @property
    def n_samples(self) -> int:
        """Number of training samples: the setting `samples`, or the default of the quantity to
        learn.
        """
        return self.samples or TARGETS[self.target].n_samples

    def _range(self, low: float, high: float) -> tuple[float, float]:
        """Return the bounds of the principal stretches, `least` and `greatest`, with `low` and
        `high` in the place of None.
        """
        return low if self.least is None else self.least, (
            high if self.greatest is None else self.greatest
        )

    def pipeline(self) -> tuple[InputAwareTargetRegressor, str]:
        """Return the unfitted pipeline of these settings and its description in words; raise
        ValueError for wrong or contradictory ones.
        """
        if self.energy and (
            given := [key for key in ("features", "degree") if getattr(self, key) is not None]
        ):
            raise ValueError(
                f"{given[0]} applies to bond forces only; for an energy set units, the size of its"
                " network"
            )
        if self.units is None and not self.energy:
            return self._polynomial()
        if self.degree is not None:
            raise ValueError("degree sets a polynomial and units a network: choose one")
        hidden = _numbers("8" if self.units is None else self.units, "units")
        activation = self.activation or "algebraic"
        if self.energy:
            if len(hidden) != 1:
                raise ValueError(
                    "units: the network of an energy has a single hidden layer, not"
                    f" {_words(hidden)}"
                )
            network = SobolevRegressor(
                *hidden,
                activation,
                max_iter=self.iterations or 500,
                n_init=2,
                random_state=self.seed,
            )
            return surrogate_pipeline(network, self.target), f"{hidden[0]} units"
        options = {
            "max_iter": self.iterations or 1000,
            "n_iter_no_change": 100,
            "random_state": self.seed,
        }
        features = self.features or "symmetric"
        pipeline = surrogate_pipeline(
            LevenbergMarquardtRegressor(hidden, activation, **options), features=features
        )
        # Before the training of a network that would be resampled: another choice is exact.
        if not 1 <= len(hidden) <= MOST_HIDDEN:
            raise ValueError(
                f"units must have one to {MOST_HIDDEN} numbers, one for each hidden layer, not"
                f" {len(hidden)}"
            )
        check_known(activation, ACTIVATIONS, f"unknown activation {activation!r}")
        return pipeline, f"{features} features, {_words(hidden)} units"

    def _polynomial(self) -> tuple[InputAwareTargetRegressor, str]:
        """Return the pipeline of a polynomial for a bond force, and its description."""
        if self.activation is not None or self.iterations is not None:
            raise ValueError("activation and iterations apply to networks only: set units, too")
        degrees = DEGREES if self.degree is None else _numbers(self.degree, "degree")
        features = self.features or "isochoric"
        pipeline = surrogate_pipeline(
            ChebyshevRegressor(degrees if len(degrees) > 1 else degrees[0]), features=features
        )
        # Before the training of a polynomial that would be resampled: another choice is exact.
        if (count := len(FEATURE_SETS[features].names)) != 2:
            raise ValueError(
                f"a polynomial needs a set of two features (isochoric), but {features} has {count}"
            )
        return pipeline, f"{features} features, polynomial of degree {_words(degrees)}"

    def design(self, law: Law) -> Samples:
        """Draw training samples of a law over the stretches of the settings; default bounds are
        reduced to where the law is finite.
        """
        reach = reachable_stretches(
            law, self._range(*TARGETS[self.target].stretch_range), self.target
        )
        return training_samples(
            law, self.n_samples, self._range(*reach), random_state=self.seed, target=self.target
        )

    def train(
        self,
        law: Law,
        hull: dict | None = None,
        identification: dict | None = None,
    ) -> Callable[[str | Path | None, str, str | None], Path]:
        """Fit a pipeline to a law, and return the function ``(folder, name, version)`` that stores
        it and returns the artifact's folder.

        Parameters
        ----------
        law : Law
        hull : dict, optional
            Hull of the states in the tests from which the law was identified; it becomes part of
            the surrogate's domain.
        identification : dict, optional
            Report of the identification of the law, for the card; its ``rates`` become part of the
            domain.
        """
        samples = self.design(law)
        pipeline, what = self.pipeline()
        tested = {"hull": hull, "rates": (identification or {}).get("rates")}
        known = {key: value for key, value in tested.items() if value is not None}
        samples = replace(samples, design={**samples.design, **known})
        with part("fitting", 0, 1):
            pipeline.fit(samples.X, samples.y)
        folds = cross_validate(pipeline, samples, self.folds, self.seed) if self.folds else []
        description = f"{'Isochoric energy' if self.energy else 'Bond force'} of {law.name}, {what}"
        text = CardText(description, folds, identification=identification)
        return lambda folder, name, version: store(
            pipeline, samples, law, folder, name, version, text
        )


def _numbers(value: str, key: str) -> tuple[int, ...]:
    """Return degrees or units, given as text with commas between, as a tuple; raise ValueError
    if they are not whole numbers.
    """
    try:
        return tuple(map(int, value.split(",")))
    except ValueError:
        raise ValueError(
            f"{key} must be whole numbers separated by commas, not {value!r}"
        ) from None


def _words(numbers: Sequence[int]) -> str:
    """Return whole numbers as text with commas between them, for a description or a message."""
    return ",".join(map(str, numbers))
