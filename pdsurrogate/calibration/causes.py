"""Causes of displacements that no law describes: mistakes of files and cameras, tried one by one
on the simulated motion.
"""

from collections.abc import Callable, Sequence
from dataclasses import dataclass, replace
from typing import NamedTuple

import numpy as np

from .image_map import LOOSE, Fit, ImageMap, Sight, fit_map
from .kinematics import SIZES, Kinematics, start_of_map
from .measured import MeasuredScene
from .starts import first_values

BAD = 2.0
"""Residuals of displacements, rms in standard deviations, from which on a cause is sought."""

REPAIRED = 0.5
"""Greatest ratio of the residuals without a mistake to those with it, with which it is named. A
map that is fitted in vain reduces them by less.
"""

SIMILAR = 1.3
"""Among mistakes whose residuals are within this factor of the least, the first one is named."""

SURELY = 0.25
"""Greatest such ratio at the start of a search, where the law is unknown."""

DOUBTFUL = 0.1
"""Difference of measured displacements from those at the start of a search, relative to them, from
which on a cause is sought: those of laws differ by less.
"""

FEWEST = 10
"""Fewest places by which mistakes are told from each other, and by which a map is fitted."""

FIXED = 1e-9
"""Standard deviation of what is not fitted."""


class Mistake(NamedTuple):
    """A mistake: what is done against it, what to do about it, and the measurements without it.

    ``change(sight)`` returns the measured displacements without the mistake; None if there is no
    such mistake.
    """

    against: str
    advice: str
    change: Callable[[Sight], Sight | None]
    with_map: bool = False


@dataclass(frozen=True)
class Trial:
    """Measurements to which the simulated motion is fitted, with and without mistakes.

    Attributes
    ----------
    body : Kinematics
    sight : Sight
    steps : list of int
    law : ndarray, shape (k,)
        Standard deviations of the changes of the law that the motion allows.
    image : bool
        Whether the map from an image to the scene is fitted.
    pixels_per, origin
        As for `start_of_map`.
    """

    body: Kinematics
    sight: Sight
    steps: list[int]
    law: np.ndarray
    image: bool
    pixels_per: float | None = None
    origin: np.ndarray | None = None

    def start(self, sight: Sight, sizes: Sequence[float] = SIZES) -> tuple[Fit, np.ndarray]:
        """Return the start of the map of measurements; see `start_of_map`."""
        return start_of_map(self.body, sight, self.steps, self.pixels_per, self.origin, sizes)

    def fit(self, sight: Sight, image: bool, moving: float = FIXED) -> Fit:
        """Fit map and law to measurements; without `image` only motions of the steps."""
        if image:
            found, deviations = self.start(sight, (1.0, 0.8))
            start = found.map
        else:
            center = sight.places.mean(axis=0)
            start = ImageMap.at_rest(1.0, np.eye(len(center)), center, center, self.steps)
            deviations = start.deviations(self.body.size, FIXED, FIXED, FIXED, moving)
        deviations = np.append(deviations, self.law)
        return fit_map(start, sight, self.body.at, deviations)


def trial_of(
    model, test: MeasuredScene, body: Kinematics, sight: Sight, law: Sequence[float] = ()
) -> Trial:
    """Return the trial of measurements on a test of a `SceneRegressor`."""
    origin = None if model.origin is None else np.array(model.origin, dtype=float)
    image = model.frame == "image"
    return Trial(body, sight, test.steps, np.array(law), image, model.pixels_per, origin)


def cause_of(trial: Trial, repaired: float = REPAIRED) -> str | None:
    """Return words that say which mistake explains why measurements do not fit: one without which
    the residuals are less than a share `repaired`. None if none of the known ones does.
    """
    places, at = np.unique(trial.sight.places, axis=0, return_inverse=True)
    if len(places) < FEWEST:
        return None
    order = np.random.default_rng(0).permutation(len(places))[at.ravel()]
    # By 800 displacements the residuals are known to 5 %.
    trial = replace(trial, sight=trial.sight.of(order < 800 / len(trial.steps)))
    given = trial.fit(trial.sight, trial.image)
    zero = (trial.sight.displacements == 0).all(axis=1)
    squares = given.residuals**2
    if not trial.image and zero.any() and squares[zero].sum() > (1 - repaired**2) * squares.sum():
        return _words(
            "without the points whose displacement is exactly zero",
            np.sqrt(squares.mean()),
            np.sqrt(squares[~zero].mean()),
            "they are points that the program lost: leave them out",
        )
    found = []
    if not trial.image:
        fit = trial.fit(trial.sight, False, LOOSE)
        found.append((fit.rms, "with a rigid motion in each step", MOVED))
        fit = trial.fit(trial.sight, True)
        found.append((fit.rms, f"with a map from image to scene ({_described(fit.map)})", FRAME))
    for mistake in MISTAKES:
        changed = mistake.change(trial.sight)
        if changed is not None and len(changed.index):
            fit = trial.fit(changed, trial.image or mistake.with_map)
            found.append((fit.rms, mistake.against, mistake.advice))
    factor = _factor(trial)
    if abs(np.log(factor)) > np.log(1.5):
        for _ in range(3):
            changed = trial.sight._replace(
                displacements=factor * trial.sight.displacements, root=trial.sight.root / factor
            )
            fit = trial.fit(changed, trial.image)
            known = changed.root > 0
            measured = (changed.root * changed.displacements)[known]
            factor *= 1 - measured @ fit.residuals[known] / (measured @ measured)
        against = f"with displacements times {factor:.3g}"
        found.append((fit.rms, against, "places and displacements have different units of length"))
    least = min(found)[0]
    if least > repaired * given.rms:
        return None
    rms, against, advice = next(each for each in found if each[0] <= SIMILAR * least)
    return _words(against, given.rms, rms, advice)


def cause_at_start(model, y: np.ndarray, root: np.ndarray) -> str | None:
    """Return what explains that displacements are unlike those of a test at the start of a search;
    None if nothing known does.
    """
    law = model.unknown_.law_of(first_values(model))
    for test, here in model.tests_:
        if test.rows.is_field.any():
            sight = test.rows.sight(test.steps, y[here], root[here])[0]
            body = test.motion(law)
            if cause := cause_of(trial_of(model, test, body, sight)):
                return cause
    return None


def cause_of_misfit(
    model, search, x: np.ndarray, residuals: np.ndarray, first: bool = False
) -> str | None:
    """Return what explains that displacements differ by far more than their standard deviations
    from those of the law at the search variables x, or, at the `first` ones, by more than laws
    do; None if they do not, or nothing known does.
    """
    for test, here in model.tests_:
        used = test.rows.is_field & (search.root[here] > 0)
        off = residuals[here][used]
        size = (search.root * search.y)[here][used]
        least = DOUBTFUL * np.sqrt((size**2).mean()) if first and off.size else BAD
        if off.size and np.sqrt((off**2).mean()) > max(BAD, least):
            sight = test.rows.sight(test.steps, search.y[here], search.root[here])[0]
            kept = (sight.root > 0).any(axis=1)
            body = test.motion(search.law_at(x), *search.numbers(x))
            law = np.where(search.space.logarithmic, 1.0, np.abs(x))
            trial = trial_of(model, test, body, sight.of(kept), law)
            if cause := cause_of(trial, SURELY if first else REPAIRED):
                return cause
    return None


def _words(against: str, before: float, after: float, advice: str) -> str:
    return (
        f"{against} the residuals of the displacements fall from {before:.2g} to {after:.2g}"
        f" standard deviations: {advice}"
    )


def _described(found: ImageMap) -> str:
    words = found.described()
    turned = f"turned by {words['degrees']:.3g} degrees, " if "degrees" in words else ""
    origin = ", ".join(f"{x:.3g}" for x in words["origin_of_image"])
    return f"{turned}scale {words['scale']:.4g}, origin at ({origin})"


def _factor(trial: Trial) -> float:
    """Return the ratio of the mean strains of the simulated motion and of the measured one."""
    last = trial.sight.of(trial.sight.index == trial.sight.index.max())
    known = np.isfinite(last.displacements).all(axis=1)
    places = last.places[known] - last.places[known].mean(axis=0)
    slope = np.linalg.lstsq(places, last.displacements[known], rcond=None)[0]
    gradient = trial.body.gradients[int(last.index[0])].mean(axis=0) - np.eye(places.shape[1])
    return float(np.linalg.norm(gradient) / max(np.linalg.norm(slope), 1e-300))


def _signs(*signs: float, places: bool = False) -> Callable[[Sight], Sight]:
    """Return a change of the signs of the displacements along the first axes, and of places."""

    def change(sight: Sight) -> Sight:
        factors = np.ones(sight.places.shape[1])
        factors[: len(signs)] = signs[: len(factors)]
        moved = sight._replace(displacements=factors * sight.displacements)
        return moved._replace(places=factors * sight.places) if places else moved

    return change


def _downward(sight: Sight) -> Sight:
    return sight._replace(places=_signs(1.0, -1.0, places=True)(sight).places)


def _summed(sight: Sight) -> Sight | None:
    """Return the sums of displacements of the steps up to each, at places known in all of them."""
    sight = sight.of((sight.root > 0).all(axis=1))
    places, at = np.unique(sight.places, axis=0, return_inverse=True)
    shape = int(sight.index.max(initial=0)) + 1, *places.shape
    if shape[0] == 1:
        return None
    entry = sight.index, at.ravel()
    sums, variances = np.full((2, *shape), np.nan)
    sums[entry] = sight.displacements
    variances[entry] = sight.root**-2.0
    moved, root = np.cumsum(sums, axis=0)[entry], np.cumsum(variances, axis=0)[entry] ** -0.5
    return sight._replace(displacements=moved, root=root).of(np.isfinite(moved).all(axis=1))


def _numbered(change: int) -> Callable[[Sight], Sight]:
    def moved(sight: Sight) -> Sight:
        index = sight.index + change
        kept = (index >= 0) & (index <= sight.index.max())
        return sight._replace(index=index).of(kept)

    return moved


def _undeformed(sight: Sight) -> Sight:
    return sight._replace(places=sight.places - sight.displacements).of(
        np.isfinite(sight.displacements).all(axis=1)
    )


FRAME = "give --frame image (frame='image'), with which this map is fitted with the law"
MOVED = f"the camera moved, or a program took rigid motions out: {FRAME}"

MISTAKES = (
    Mistake(
        "with the displacements summed over the steps",
        "they are from the image before: sum them up from the reference image",
        _summed,
    ),
    Mistake(
        "with places less their displacements",
        "the places are those in the deformed images: give those in the reference image",
        _undeformed,
    ),
    Mistake(
        "with each image as that of the next step",
        "the steps are numbered one too low",
        _numbered(1),
    ),
    Mistake(
        "with each image as that of the step before",
        "the steps are numbered one too high: step 1 is the first after the reference image",
        _numbered(-1),
    ),
    Mistake(
        "with v (u2) of the opposite sign",
        "v points against the second axis: change its sign",
        _signs(1.0, -1.0),
    ),
    Mistake(
        "with u (u1) of the opposite sign",
        "u points against the first axis: change its sign",
        _signs(-1.0, 1.0),
    ),
    Mistake(
        "with all displacements of the opposite sign",
        "they are old places minus new ones: change their sign",
        _signs(-1.0, -1.0, -1.0),
    ),
    Mistake(
        "with places counted in the opposite direction along the second axis, and a map from image"
        " to scene",
        "y points downward, v upward: change the sign of x2, with --frame image",
        _downward,
        True,
    ),
    Mistake(
        "with y and v in the opposite direction, and a map from image to scene",
        "both point downward: give --down, with --frame image",
        _signs(1.0, -1.0, places=True),
        True,
    ),
)
"""Mistakes in the order in which they are named if several explain the same."""
