"""Test data and a fit to them, held against what rubber does: bad rows, modes of other units, laws that do not describe the data."""

from __future__ import annotations

import warnings
from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np
from scipy.optimize import nnls

from .data import BIAXIAL, TestData
from .energy import INVARIANTS, NEGATIVE, POSITIVE, columns_of, dictionary, isochoric
from .stress_regressor import StressRegressor

NOISE = 0.01
"""Scatter of stresses that is taken for granted, relative."""

FLOOR, RANGE = 0.02, 0.5
"""Part of the greatest stress of a mode that is added to a stress before a residual is divided by it: small where modes are compared, in
which every row has its part; large where a single row is judged, as a load cell, or a figure that is read off, is as good as a part of its
range (Treloar's stresses below 0.2 MPa are 0.03 MPa off)."""

OUTLIER = 5.0
"""Residual, in standard deviations of all, from which a row is named as one: of normal ones it is one in two million."""

NEAR_REST = 0.02
"""Part of the greatest stress of a mode, and log-stretch, within which the sign of a stress is noise."""

AT_REST = 1e-3
"""Part of the greatest stress of a mode from which a stress at a stretch of 1 is named, and log-stretch up to which it is one there."""

BETTER, MENDED, MENDED_IF_POOR = 5.0, 3.0, 2.0
"""How many times smaller the residual must be by another law, with a change of the data, or with one where the law describes a mode poorly
anyway, for it to be said."""

MOST_ROWS = 3
"""Rows that are named where many have the same fault."""

LEAST_FACTOR = 1.5
"""Between the stresses of two modes from which they may be in different units."""

POOR = 0.9
"""R^2 of a mode below which a fit is said to be poor."""

TERMS = [*dictionary(POSITIVE[-1], NEGATIVE[-1]), *INVARIANTS[1]]
"""Of the energy that stands for all that physics allows: powers of the stretches, of either sign, and of the first invariant."""


class TestDataWarning(UserWarning):
    """Test data, or a fit to them, that look wrong."""

    __test__ = False


@dataclass(frozen=True)
class Examination:
    """Remarks on a fit to test data.

    Attributes
    ----------
    refusals : list of str
        Why it should not be used.
    remarks : list of str
        What should be looked at.
    """

    refusals: list[str]
    remarks: list[str]


def fit_to_tests(regressor: StressRegressor, data: TestData, force: bool = False) -> StressRegressor:
    """Fit a regressor to test data, each mode weighted by its scatter, and hold data and fit against what rubber does.

    Parameters
    ----------
    regressor : LawRegressor or EnergyRegressor
        Fitted in place; not fitted where the fit is refused.
    data : TestData
    force : bool
        Whether what would be refused is a warning.

    Returns
    -------
    estimator
        The regressor.

    Raises
    ------
    ValueError
        If a stress pulls where rubber pushes, or a mode is described worse than by its mean stress; names row or mode.

    Warns
    -----
    TestDataWarning
        Of rows that stand out or fall, of modes that look like those of another unit, of Cauchy stress or of a shifted zero, of a mode
        with an R^2 below 0.9, and where an energy without a law describes the data five times better.

    Examples
    --------
    >>> import pdsurrogate as pds
    >>> data = pds.load_test_data("treloar").up_to(3.0)
    >>> pds.fit_to_tests(pds.LawRegressor("ogden"), data).law_.name
    'ogden'
    """
    regressor.forget()
    regressor.fit(data.stretches, data.nominal_stress, data.balanced_weights())
    found = examine(regressor, data)
    if found.refusals and not force:
        regressor.forget()
        raise ValueError("; ".join(found.refusals))
    for remark in [*found.refusals, *found.remarks]:
        warnings.warn(remark, TestDataWarning, stacklevel=2)
    return regressor


def examine(model: StressRegressor, data: TestData, others: Sequence[StressRegressor] = ()) -> Examination:
    """Say what is wrong with test data, or with a fit to them.

    Parameters
    ----------
    model : StressRegressor
        Fitted to the data.
    data : TestData
    others : sequence of StressRegressor
        Fitted to them as well, to be named where they are better; an energy without a law is compared with in any case.
    """
    scores = data.r_squared(model.predict(data.stretches))
    poor = not min(scores.values(), default=1.0) >= POOR
    refusals, remarks = wrong_signs(data), suspicions(data, MENDED_IF_POOR if poor else MENDED)
    poorly = []
    for mode, value in scores.items():
        if value < 0:
            refusals.append(
                f"{model.law} describes {mode} worse than the mean stress does (R^2 below 0): take another law, or mend the data"
            )
        elif not value >= POOR:
            poorly.append(f"{model.law} describes {mode} poorly: R^2 is {value:.3g}, below {POOR:g}")
    # Data that contradict each other are no measure of laws.
    return Examination(refusals, [*remarks, *poorly, *([] if remarks else _better(model, data, others))])


def wrong_signs(data: TestData) -> list[str]:
    """Rows whose stress has the wrong sign.

    Isotropic rubber pulls along the greater of two stretches (Baker, Ericksen 1954): with nothing on the thickness the stress has the sign
    of log(stretch/thickness).
    """
    if not len(data):
        return []
    first, second = data.stretches.T
    along = np.log(first * first * second)
    wrong = (along * data.nominal_stress < 0) & (np.abs(along) > NEAR_REST)
    wrong &= np.abs(data.nominal_stress) > NEAR_REST * _greatest_of_mode(data)
    does = np.where(along > 0, "pushes where rubber pulls", "pulls where rubber pushes")
    told = [f"{data.row_in_words(row)} {does[row]}" for row in np.flatnonzero(wrong)]
    return [f"{', '.join(_some(told))}: tension is positive, compression negative"] if told else []


def _some(told: list[str]) -> list[str]:
    """The first few of what is said of rows."""
    return told if len(told) <= MOST_ROWS else [*told[:MOST_ROWS], f"and {len(told) - MOST_ROWS} rows more"]


def suspicions(data: TestData, enough: float = MENDED) -> list[str]:
    """Return remarks on test data that look wrong for any law.

    They are held against an energy that stands for all that physics allows (`TERMS`), fitted so that single rows count little.  Changes of
    a mode that make the residuals smaller by the factor `enough` are told, and rows that stand out of what the energy says once the change
    that mends most is made.  Where rows stand out before any change is made, one is looked for however small the residuals of all others
    are; where several do that are of one mode, a smaller factor is enough.
    """
    told, explained, stress, predicted = [], [], data.nominal_stress, _robust(data, data.nominal_stress)[0]
    before, least = _size(data, stress, predicted), enough * NOISE
    outliers = np.abs(_standing(data, stress, predicted)) > OUTLIER
    if outliers.any():
        enough, least = MENDED_IF_POOR if _several_of_a_mode(data, outliers) else enough, NOISE
    if before > least:
        for mode, changed, shifted, words in _changes(data):
            fitted, shift = _robust(data, changed, shifted)
            words = words or f"the stresses look shifted by {shift:.3g}: at a stretch of 1 there should be none"
            explained.append((_size(data, changed, fitted), mode, words, changed, fitted))
        explained.sort(key=lambda one: one[0])
        most = min(before / enough, 2 * explained[0][0])
        explained = [one for one in explained if one[0] <= most]
        # Of one mode the change that mends most.
        told += [f"{mode}: {words}" for mode, words in {mode: words for _, mode, words, *_ in reversed(explained)}.items()]
    if explained:
        stress, predicted = explained[0][3:]
    mended = {one[1] for one in explained}
    known = np.isin(data.mode, list(mended)) | ("all modes" in mended)
    resting = _stressed_at_rest(data) & ~known
    at_rest = _some([data.row_in_words(row) for row in np.flatnonzero(resting)])
    if at_rest:
        told.append(f"{', '.join(at_rest)}: rubber has no stress at a stretch of 1: is the zero right, are they stretches, not strains?")
    standing = np.abs(_standing(data, stress, predicted))
    rows = [row for row in np.argsort(-standing) if standing[row] > OUTLIER and not known[row] and not resting[row]]
    if len(rows) > max(1, len(data) / 4):
        told.append("no energy that physics allows describes these tests together: are units the same, zeros right, all stresses nominal?")
    else:
        told += [f"{data.row_in_words(row)} stands out by {standing[row]:.0f} standard deviations from what the others say" for row in rows]
        named = {*rows, *np.flatnonzero(resting)}
        told += _some([text for row, text in _falling(data) if not named & {row, row - 1}])
    return told


def _several_of_a_mode(data: TestData, rows: np.ndarray) -> bool:
    """Return whether more than one of some rows is of the same mode of loading."""
    return len(set(data.mode[rows].tolist())) < rows.sum()


def _stressed_at_rest(data: TestData) -> np.ndarray:
    """Return which rows have a stress although neither stretch differs from 1, shape (n,)."""
    at_rest = np.abs(np.log(data.stretches)).max(axis=1) < AT_REST
    return at_rest & (np.abs(data.nominal_stress) > AT_REST * _greatest_of_mode(data))


def standardised(model: StressRegressor, data: TestData, most: int = 5) -> list[dict]:
    """Rows of a fit's greatest residuals: row, mode, stretches, stress, that of the fit, and the residual in standard deviations."""
    predicted = model.predict(data.stretches)
    standing = _standing(data, data.nominal_stress, predicted)
    rows = np.argsort(-np.abs(np.nan_to_num(standing, nan=np.inf)))[:most]
    return [
        {
            "row": int(data.row[row]),
            "mode": str(data.mode[row]),
            "stretches": data.stretches[row].tolist(),
            "nominal_stress": float(data.nominal_stress[row]),
            "fitted": float(predicted[row]) if np.isfinite(predicted[row]) else None,
            "standard_deviations": float(standing[row]) if np.isfinite(standing[row]) else None,
        }
        for row in rows
    ]


NOT_TOLD = "if all stresses were Cauchy (true) ones it would too, and nothing would tell: nominal ones are force over the area at rest"
"""What a form of energy that describes the data leaves open."""

CAUCHY = "the stresses look like Cauchy (true) ones: divided by the stretch, they are nominal"


def _changes(data: TestData):
    """Changes of a mode, or of all, that may mend it: mode, stresses, rows with a shift or None, and what it means (None for a shift)."""
    stress, first = data.nominal_stress, data.stretches[:, 0]
    columns = columns_of(isochoric(data.stretches, np.ones(len(data))), first, TERMS)
    for mode in data.modes:
        rows = data.mode == mode
        if mode != BIAXIAL:
            yield mode, stress, rows, None
        if rows.all():
            return
        yield mode, np.where(rows, stress / first, stress), None, CAUCHY
        others = 1 / (np.abs(stress) + FLOOR * _greatest_of_mode(data) + 1e-300) * ~rows
        predicted = columns @ _nonnegative(columns, stress, others)
        some = rows & (np.abs(predicted) > 0)
        factor = float(np.median(stress[some] / predicted[some])) if some.any() else 1.0
        if factor > 0 and abs(np.log(factor)) > np.log(LEAST_FACTOR):
            size = f"{factor:.3g} times too large" if factor > 1 else f"{1 / factor:.3g} times too small"
            words = f"the stresses look {size} for the other modes: is it in another unit?"
            yield mode, np.where(rows, stress / factor, stress), None, words
    yield "all modes", stress, np.ones(len(data), dtype=bool), None
    yield "all modes", stress / first, None, CAUCHY


def _robust(data: TestData, stress: np.ndarray, shifted: np.ndarray | None = None) -> tuple[np.ndarray, float]:
    """Stresses by all that physics allows, fitted so that rows far off count little, and the number that some rows may be shifted by."""
    columns = columns_of(isochoric(data.stretches, np.ones(len(data))), data.stretches[:, 0], TERMS)
    if shifted is not None:
        columns = np.column_stack([columns, shifted, -1.0 * shifted])
    greatest = _greatest_of_mode(data, stress)
    size, weight = np.abs(stress) + FLOOR * greatest + 1e-300, np.ones(len(data))
    for _ in range(12):
        weights = _nonnegative(columns, stress, np.sqrt(weight) / size)
        predicted = columns @ weights
        residuals = _relative(stress, predicted, FLOOR * greatest)
        weight = 1 / (1 + (residuals / (2 * _scale(residuals))) ** 2)  # Cauchy's
    return predicted, float(weights[-2] - weights[-1]) if shifted is not None else 0.0


def _nonnegative(columns, stress, root) -> np.ndarray:
    columns = root[:, None] * columns
    size = np.linalg.norm(columns, axis=0)
    size[size == 0] = 1.0
    return nnls(columns / size, root * stress)[0] / size


def _relative(stress, predicted, floor) -> np.ndarray:
    """Differences in parts of the stress, between -1 and 1 where the signs are the same."""
    return (stress - predicted) / (np.maximum(np.abs(stress), np.abs(predicted)) + floor + 1e-300)


def _standing(data: TestData, stress: np.ndarray, predicted: np.ndarray) -> np.ndarray:
    """Residuals of the rows in standard deviations of all."""
    residuals = _relative(stress, predicted, RANGE * _greatest_of_mode(data, stress))
    return residuals / _scale(residuals)


def _scale(residuals) -> float:
    """Standard deviation of residuals by their median, of which outliers know nothing; no less than `NOISE`."""
    finite = np.abs(residuals[np.isfinite(residuals)])
    return max(1.4826 * float(np.median(finite)) if len(finite) else 1.0, NOISE)


def _size(data: TestData, stress: np.ndarray, predicted: np.ndarray) -> float:
    """Root mean square of relative residuals but for the tenth that is farthest off."""
    residuals = _relative(stress, predicted, FLOOR * _greatest_of_mode(data, stress))
    kept = np.sort(np.abs(residuals))[: max(1, int(np.ceil(0.9 * len(residuals))))]
    return max(float(np.sqrt((kept**2).mean())), 1e-6)


def _greatest_of_mode(data: TestData, stress: np.ndarray | None = None) -> np.ndarray:
    stress = data.nominal_stress if stress is None else stress
    greatest = np.zeros(len(data))
    for mode in data.modes:
        rows = data.mode == mode
        greatest[rows] = np.abs(stress[rows]).max()
    return greatest


def _falling(data: TestData):
    """Numbers of rows whose stress is less than that at a smaller stretch of their mode, and that in words."""
    for mode in data.modes:
        if mode == BIAXIAL:
            continue
        rows = np.flatnonzero(data.mode == mode)
        rows = rows[np.argsort(data.stretches[rows, 0], kind="stable")]
        stress, stretch = data.nominal_stress[rows], data.stretches[rows, 0]
        for k in np.flatnonzero((np.diff(stress) < -2 * NOISE * np.abs(stress[:-1])) & (np.diff(stretch) > 1e-3 * stretch[:-1])):
            yield rows[k + 1], f"{data.row_in_words(rows[k + 1])} is below {stress[k]:g} at the smaller stretch {stretch[k]:g}"


def _better(model: StressRegressor, data: TestData, others: Sequence[StressRegressor]):
    """Return a remark where another law, or an energy without a law, describes the data many times better."""
    from .energy import EnergyRegressor

    def off(one: StressRegressor) -> float:
        missing = [1 - value for value in data.r_squared(one.predict(data.stretches)).values()]
        return float(np.sqrt(np.mean(missing))) if missing else 0.0

    own = off(model)
    if own < NOISE:
        return
    candidates = list(others)
    if not any(isinstance(one, EnergyRegressor) for one in [model, *others]):
        with warnings.catch_warnings():
            warnings.simplefilter("ignore")
            candidates.append(EnergyRegressor().fit(data.stretches, data.nominal_stress, data.balanced_weights()))
    best = min((one for one in candidates if one is not model), key=off, default=None)
    if best is not None and off(best) < own / BETTER:
        name = "an energy without a law (--free, EnergyRegressor)" if isinstance(best, EnergyRegressor) else best.law
        better = f"{name} describes these data {own / max(off(best), 1e-9):.0f} times better than {model.law}"
        yield f"{better}; {NOT_TOLD}"
