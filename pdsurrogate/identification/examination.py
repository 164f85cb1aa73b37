"""Examination of test data and of fits to them: bad rows, modes in other units, laws that do not
describe the data.
"""

import warnings
from dataclasses import dataclass, replace
from typing import NamedTuple

import numpy as np

from ..materials.dictionary import Term
from ..measurements.branches import branches, records
from ..measurements.plausible import MOST_STRETCH
from .averaging import columns_of, isochoric, nonnegative
from .branch_search import Curves, constant
from .data import BIAXIAL, MODES, TestData, TestDataWarning
from .stress_regressor import StressRegressor

NOISE = 0.01
"""Relative scatter of measured stresses that data of any laboratory may have."""

FLOOR = 0.02
RANGE = 0.5
"""Fractions of the greatest stress of a mode of loading that are added to the stress by which a
residual is divided.

`FLOOR` serves where modes are compared, so that every row contributes; `RANGE` serves where a
single row is judged, since the error of a load cell, or of a figure that was read, is a fraction of
its range (Treloar's stresses below 0.2 MPa are 0.03 MPa off).
"""

OUTLIER = 5.0
"""Residual of an outlier, in standard deviations of all rows: one in two million of normal
residuals is greater.
"""

NEAR_REST = 2 * NOISE
"""Stress divided by the greatest stress of its mode, and log(stretch/thickness), below which the
sign of the stress counts as noise.

Chosen: twice the scatter `NOISE`.
"""

MENDED = 2.0
"""Least factor by which residuals fall if a remark says that changed data, such as those of a
mode in another unit, would fit better.
"""

MOST_ROWS = 3
"""Most rows of the data that a message names for one fault. Chosen: three show the pattern, and
the message stays one line.
"""

LEAST_FACTOR = 1.5
"""Least ratio, or inverse ratio, of the stresses of a mode to those that the other modes suggest,
at which a remark suspects another unit: units of stress differ by more.
"""

POOR = 0.9
"""R^2 of a mode below which a fit is called poor. Chosen: the residuals are then a third of the
scatter of the stresses, which a plot shows at a glance.
"""

POWERS = *range(-6, 0), *range(1, 13)
"""Exponents of the stretches in `TERMS`."""

TERMS = [
    *(Term("stretches", float(power)) for power in POWERS),
    Term("first", 2.0),
    Term("first", 3.0),
]
"""Terms of an energy that stands for all admissible energies: powers of stretches, their
inverses and the first invariant.
"""

CHANGED_VOLUME = 0.1
"""Change of log(volume) under a uniaxial load from which a material is no rubber. Chosen: twice
the greatest of Kawabata's data.
"""


@dataclass(frozen=True)
class Examination:
    """Result of the examination of test data and of a fit to the data.

    Attributes
    ----------
    refusals : list of str
        Reasons not to use the fit.
    remarks : list of str
        Points to check.
    """

    refusals: list[str]
    remarks: list[str]


def fit_to_tests(
    regressor: StressRegressor, data: TestData, force: bool = False
) -> StressRegressor:
    """Fit a regressor to test data, with modes weighted by their scatter, and examine data and fit
    (`examine`).

    Parameters
    ----------
    regressor : LawRegressor, EnergyRegressor or HistoryRegressor
        Fitted in place; left unfitted if ValueError is raised.
    data : TestData
    force : bool
        Whether reasons to refuse the fit are given as warnings, and the fit is kept.

    Returns
    -------
    estimator
        The regressor.

    Raises
    ------
    ValueError
        If a stress has the wrong sign, or a mode is described worse than by its mean stress; the
        message names row or mode.

    Warns
    -----
    TestDataWarning
        If the stress of a row stands out; if the stresses of a mode look like those in another unit
        or like Cauchy stresses; if stretches look like strains, or rows are of unloading; or if a
        mode has an R^2 below 0.9.

    See Also
    --------
    pdsurrogate.load_test_data : reads test data.
    pdsurrogate.identification.LawRegressor : fits the parameters of a law alone.
    pdsurrogate.identification.EnergyRegressor : fits an energy without a law.

    Examples
    --------
    >>> import pdsurrogate as pds
    >>> data = pds.load_test_data("treloar").up_to(3.0)
    >>> pds.fit_to_tests(pds.identification.LawRegressor("ogden"), data).law_.name
    'ogden'
    """
    regressor.forget()
    regressor.fit_tests(data)
    found = examine(regressor, data)
    if found.refusals and not force:
        regressor.forget()
        raise ValueError("; ".join(found.refusals))
    for remark in [*found.refusals, *found.remarks]:
        warnings.warn(remark, TestDataWarning, stacklevel=2)
    return regressor


def examine(model: StressRegressor, data: TestData) -> Examination:
    """Return refusals and remarks on errors in test data, or in the fit of a regressor to the
    test data.
    """
    scores = data.r_squared(model.predict(model.rows_of(data)))
    # In unloading rubber that relaxes may be pushed back, and rubber that softens is softer.
    judged = data.where(_first_loading(data)) if model.over_time else data
    refusals = [*wrong_signs(judged), *changes_of_volume(data)]
    remarks = suspicions(judged, model.over_time)
    poorly = []
    for mode, value in scores.items():
        if value < 0:
            refusals.append(
                f"{model.form} describes {mode} worse than the mean stress does (R^2 below 0): use"
                " another law, or correct the data"
            )
        elif not value >= POOR:
            poorly.append(
                f"{model.form} describes {mode} poorly: R^2 is {value:.3g}, below {POOR:g}"
            )
    return Examination(refusals, [*remarks, *poorly])


def wrong_signs(data: TestData) -> list[str]:
    """Return a list of one message about the rows whose stress has the wrong sign; an empty list if
    there are none.

    Isotropic rubber pulls along the greater of two stretches (Baker, Ericksen 1954): with a
    stress-free thickness the stress has the sign of log(stretch/thickness).
    """
    first, second = data.stretches.T
    along = np.log(first * first * second)
    wrong = (along * data.nominal_stress < 0) & (np.abs(along) > NEAR_REST)
    wrong &= np.abs(data.nominal_stress) > NEAR_REST * _greatest_of_mode(data)
    does = np.where(
        along > 0,
        "is compressive where rubber is in tension",
        "is tensile where rubber is in compression",
    )
    found = [f"{data.row_in_words(row)} {does[row]}" for row in np.flatnonzero(wrong).tolist()]
    if len(found) > MOST_ROWS:
        found[MOST_ROWS:] = [f"and {len(found) - MOST_ROWS} more rows"]
    return [f"{', '.join(found)}: tension is positive, compression negative"] if found else []


def changes_of_volume(data: TestData) -> list[str]:
    """Return a list of one message if stretches under uniaxial load, with the same stretch of
    width and thickness, change the volume.
    """
    order = np.argsort(data.row, kind="stable")
    pairs = order[:-1][np.diff(data.row[order]) == 0], order[1:][np.diff(data.row[order]) == 0]
    free = data.mode == "uniaxial"
    size = np.abs(data.nominal_stress)
    for along, across in (pairs, pairs[::-1]):
        free[along] |= (data.mode[along] == BIAXIAL) & (size[across] <= NEAR_REST * size[along])
    measured = {} if data.tests is None else data.tests.lateral_stretches
    across = [
        measured.get(row, assumed)
        for row, assumed in zip(data.row.tolist(), data.stretches[:, 1].tolist(), strict=True)
    ]
    volume = data.stretches[:, 0] * np.array(across) ** 2
    off = np.where(free, np.abs(np.log(volume)), 0.0)
    if not off.max() > CHANGED_VOLUME:
        return []
    row = int(off.argmax())
    return [
        f"{data.row_in_words(row)}: the stretches along and across a uniaxial load change the"
        f" volume by {100 * (volume[row] - 1):.0f} %: the material is compressible, such as a"
        " foam, and these are laws of rubber"
    ]


def suspicions(data: TestData, over_time: bool = False) -> list[str]:
    """Return remarks on test data that look wrong for any law, or, `over_time`, for any with
    branches.

    The data are compared with an energy that stands for all that physics allows (`TERMS`), fitted
    so that single rows count little. Remarks name changes of the stresses of a mode that reduce the
    residuals by the factor `MENDED`, and rows that stand out after the best change. Changes are
    tried only where the residuals exceed `NOISE`.
    """
    best = data
    columns = _columns(data, over_time)
    predicted = _robust(data, columns)
    before = _size(data, predicted)
    faulty = before > NOISE or data.stretches.max() > MOST_STRETCH
    changes = _changes(data, columns, over_time) if faulty else []
    # The changes after which residuals are small enough, and at most twice those after the best
    # change.
    explained = [
        one
        for one in changes
        if one.size <= min(before / (one.enough or MENDED), 2 * changes[0].size)
    ]
    if explained:
        best, predicted = explained[0].data, explained[0].predicted
    mended = {one.mode: one.words for one in reversed(explained)}  # the best change of each mode
    remarks = [f"{mode}: {words}" for mode, words in mended.items()]
    remarks += [
        f"{mode}: there is one row only, which shows no curve"
        for mode in data.modes
        if (data.mode == mode).sum() == 1
    ]
    known = np.isin(best.mode, list(mended)) | ("all modes" in mended)
    standing = np.abs(_standing(best, predicted))
    rows = [
        row for row in np.argsort(-standing).tolist() if standing[row] > OUTLIER and not known[row]
    ]
    if len(rows) > max(1, len(best) / 4):
        return [
            *remarks,
            "no physically possible energy describes these tests together: check that all stresses"
            " have the same unit, are nominal, and are zero at a stretch of 1; foams, whose volume"
            " changes, are not described",
        ]
    turned = ~_first_loading(best)
    return remarks + [
        f"{best.row_in_words(row)} deviates by {standing[row]:.0f} standard deviations from the"
        f" other rows{', and is not of first loading' * bool(turned[row])}"
        for row in rows
    ]


def standardized(model: StressRegressor, data: TestData, most: int = 5) -> list[dict]:
    """Return the `most` rows with the greatest residuals of a fit: measured and fitted stress,
    and residual in standard deviations.
    """
    predicted = model.predict(model.rows_of(data))
    standing = _standing(data, predicted)
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


CAUCHY = (
    "the stresses look like Cauchy (true) stresses; divide them by the stretch to obtain nominal"
    " stresses"
)
STRAINS = "the stretches, {:g} to {:g}, look like strains{}; a stretch is 1 + strain{}"
FOAM = (
    "the stresses of compression grow less than at constant volume, and are those of a material"
    " that hardly widens (R. Hill 1978): it is compressible, such as a foam, and these are laws of"
    " rubber"
)
HYSTERESIS = (
    "{} of {} rows are of unloading or of loading again, with other stresses than those of first"
    " loading (hysteresis), which no elastic law describes; take the loading branch alone"
    " (--branch loading)"
)
"""Words of remarks for faults in the data of a mode that a change may mend (`_changes`)."""


class _Change(NamedTuple):
    """Change of the data of a mode, or of all modes, that may mend them.

    It holds the RMS of the relative residuals after the change, the mode, a description, the
    changed data, the fitted stresses, and the least factor by which the residuals must fall, if it
    is not that of all changes.
    """

    size: float
    mode: str
    words: str
    data: TestData
    predicted: np.ndarray
    enough: float | None


def _changes(data: TestData, columns: np.ndarray, over_time: bool) -> list[_Change]:
    """Return possible corrections of faulty data, the best first: of stress measure or unit, of
    strains, and of unloading; `columns` are the `_columns` of the data.
    """
    stress = data.nominal_stress
    first = data.stretches[:, 0]
    found = []

    def add(
        mode: str,
        words: str,
        mended: TestData,
        columns: np.ndarray,
        enough: float | None = None,
    ) -> None:
        predicted = _robust(mended, columns)
        found.append(_Change(_size(mended, predicted), mode, words, mended, predicted, enough))

    for mode in data.modes:
        rows = data.mode == mode
        if rows.all():
            break
        divided = replace(data, nominal_stress=np.where(rows, stress / first, stress))
        add(mode, CAUCHY, divided, columns)
        others = 1 / (np.abs(stress) + FLOOR * _greatest_of_mode(data) + 1e-300) * ~rows
        predicted = columns @ nonnegative(columns, stress, others)
        some = rows & (np.abs(predicted) > 0)
        factor = float(np.median(stress[some] / predicted[some])) if some.any() else 1.0
        if factor > 0 and abs(np.log(factor)) > np.log(LEAST_FACTOR):
            way = "large" if factor > 1 else "small"
            size = f"{max(factor, 1 / factor):.3g} times too {way}"
            words = f"the stresses look {size} compared with the other modes; check their unit"
            scaled = replace(data, nominal_stress=np.where(rows, stress / factor, stress))
            add(mode, words, scaled, columns)
    else:
        add("all modes", CAUCHY, replace(data, nominal_stress=stress / first), columns)
    for whole, unit, share in ((100.0, " in per cent", "/100"), (1.0, "", "")):
        stretches = 1 + data.stretches / whole
        for mode in set(data.modes) - {BIAXIAL}:
            stretches[data.mode == mode, 1] = MODES[mode](stretches[data.mode == mode, 0])
        words = STRAINS.format(first.min(), first.max(), unit, share)
        strained = replace(data, stretches=stretches)
        enough = 1.0 if first.max() > MOST_STRETCH else None
        add("all modes", words, strained, _columns(strained, over_time), enough)
    if data.modes == ["uniaxial"] and (first < 1).all():
        powers = np.array(POWERS, dtype=float)
        freely = (first[:, None] ** (powers - 1) - 1 / first[:, None]) / powers
        add("uniaxial", FOAM, data, freely)
    turned = ~_first_loading(data)
    if turned.any():
        modes = sorted({*data.mode[turned].tolist()})
        add(
            modes[0] if len(modes) == 1 else "all modes",
            HYSTERESIS.format(turned.sum(), len(data)),
            data.where(~turned),
            columns[~turned],
        )
    return sorted(found, key=lambda one: one.size)


def _first_loading(data: TestData) -> np.ndarray:
    """Return a mask of the rows of first loading, shape (n,): in biaxial tests, whose order says
    nothing, all of them.
    """
    first = np.ones(len(data), dtype=bool)
    stretch, untimed = data.stretches[:, 0], np.full(len(data), np.nan)
    for mode in {*data.modes} - {BIAXIAL}:
        rows = np.flatnonzero(data.mode == mode)
        record = records(stretch[rows], untimed[rows])
        for number in range(record[-1] + 1):
            part = rows[record == number]
            branch, cycle = branches(stretch[part], untimed[part], 0.0)
            first[part] = (branch == "loading") & (cycle == 1)
    return first


def _columns(data: TestData, over_time: bool) -> np.ndarray:
    """Return the design matrix of a linear fit: the nominal stress of each energy term of
    `TERMS` with unit weight, at constant volume, and, `over_time`, that of branches, if the data
    have times.
    """
    terms = columns_of(isochoric(data.stretches, np.ones(len(data))), data.stretches[:, 0], TERMS)
    if not over_time or np.isnan(data.time).any():
        return terms
    curves = Curves.of(data.histories())
    return np.column_stack([terms, curves.columns(constant(curves.grid()))])


def _robust(data: TestData, columns: np.ndarray) -> np.ndarray:
    """Return the stresses of columns of a linear fit, `_columns` or others, fitted to measured
    ones, with little weight on outliers.
    """
    stress = data.nominal_stress
    size = np.abs(stress) + FLOOR * _greatest_of_mode(data) + 1e-300
    weight = np.ones(len(data))
    # The weights of outliers settle within a few fits.
    for _ in range(12):
        predicted = columns @ nonnegative(columns, stress, np.sqrt(weight) / size)
        residuals = _relative(data, predicted, FLOOR)
        weight = 1 / (1 + (residuals / (2 * _scale(residuals))) ** 2)  # Cauchy's
    return predicted


def _relative(data: TestData, predicted, share: float) -> np.ndarray:
    """Return measured minus predicted stresses, shape (n,), each divided by a stress that is not
    near zero.

    This stress is the greater absolute value of the two, plus `share` times the greatest stress of
    the mode.
    """
    greater = np.maximum(np.abs(data.nominal_stress), np.abs(predicted))
    return (data.nominal_stress - predicted) / (greater + share * _greatest_of_mode(data) + 1e-300)


def _standing(data: TestData, predicted: np.ndarray) -> np.ndarray:
    """Return the relative residuals of the rows divided by their standard deviation, robustly
    estimated (`_scale`), shape (n,).
    """
    residuals = _relative(data, predicted, RANGE)
    return residuals / _scale(residuals)


def _scale(residuals) -> float:
    """Return the standard deviation of residuals, at least `NOISE`, from their median absolute
    value, which is robust to outliers.
    """
    finite = np.abs(residuals[np.isfinite(residuals)])
    return max(1.4826 * float(np.median(finite)) if len(finite) else 1.0, NOISE)


def _size(data: TestData, predicted: np.ndarray) -> float:
    """Return the root mean square of the relative residuals of a fit, without the greatest tenth
    of the residuals.
    """
    off = np.sort(np.abs(_relative(data, predicted, FLOOR)))
    kept = off[: max(1, int(np.ceil(0.9 * len(data))))]
    return max(float(np.sqrt((kept**2).mean())), 1e-6)


def _greatest_of_mode(data: TestData) -> np.ndarray:
    """Return for each row the greatest absolute stress among the rows of its mode of loading,
    shape (n,).
    """
    modes, mode = np.unique(data.mode, return_inverse=True)
    greatest = np.zeros(len(modes))
    np.maximum.at(greatest, mode, np.abs(data.nominal_stress))
    return greatest[mode]
