"""Starts of the search for a law: its unknowns, their first values, and the checks that the
measurements are those of the tests.
"""

import numpy as np

from ..identification import LawRegressor
from ..identification.stress_regressor import BULK_RATIO, bulk_arguments
from ..materials import LAWS, Law, Ogden
from .asked import scenes_of
from .free import EnergyUnknowns, floored, scaled, solved
from .measured import DISPLACEMENTS, FAILURES, FORCES, MeasuredScene, Unlike
from .remembering import LawUnknowns, with_memory
from .search import DIFFERENCE, Search, Space, failing

FARTHEST = 0.5
"""Greatest difference of measured from simulated displacements in a step of a test that prescribes
motions, relative to the greater of them. Displacements of different laws differ by less; a greater
difference is an error of units, axes or the order of the steps.
"""

ALONE = 0.9
"""Share of a single measurement in such a difference (root of the sum of squares) from which on
the error names this measurement.
"""

SIGNIFICANT = 2.0
"""Noise of the measurements, in standard deviations, that a difference must exceed in order to
count as such an error.
"""

EXPONENTS = ((2.0,), (2.0, -2.0), (1.3, 5.0, -2.0), (1.3, 5.0, -2.0, 8.0))
"""Exponents from which Ogden's law with one to four terms starts: those of Ogden (1972) for
three terms.
"""


def unknowns_of(model, count: int) -> LawUnknowns | EnergyUnknowns:
    """Return the unknowns of the fit; raise ValueError unless `count` measurements can determine
    them.
    """
    bulk = bulk_of(model)
    if model.law is None:
        if remembering := [one.name for one in scenes_of(model) if one.remembers]:
            raise ValueError(
                f"scene {remembering[0]}: an energy without a law has no branches and no softening:"
                " fit a law (--law), or learn it from tests over time (fit --free --branches)"
            )
        unknown = EnergyUnknowns(
            bulk.get("bulk_ratio", None if bulk else BULK_RATIO), bulk.get("bulk_modulus")
        )
        _check_energy(model, unknown, count)
        return unknown
    elastic = LawRegressor(model.law, model.n_terms).set_params(**bulk)
    unknown = with_memory(elastic, scenes_of(model))
    names = unknown.unknowns()
    if count < len(names):
        raise ValueError(
            f"X: {count} measurements do not determine {len(names)} parameters ({', '.join(names)})"
        )
    return unknown


def bulk_of(model) -> dict[str, float]:
    """Return the bulk modulus or its ratio, as arguments of a `LawRegressor`: given, or that of
    the first scene with a material.
    """
    if given := bulk_arguments(bulk_modulus=model.bulk_modulus, bulk_ratio=model.bulk_ratio):
        return given
    for scene in scenes_of(model):
        if scene.material is not None:
            return {"bulk_ratio": scene.law().bulk_modulus / scene.law().shear_modulus}
    return {}


def search_from(
    model, start: np.ndarray, y: np.ndarray, root: np.ndarray
) -> tuple[Search, np.ndarray]:
    """Return the search that starts at given parameters, at which the tests are simulated, and
    its variables there.
    """
    if isinstance(model.unknown_, EnergyUnknowns):
        low = np.zeros(len(start))
        high = np.full(len(start), np.inf)
        logarithmic = np.zeros(len(start), dtype=bool)
    else:
        low, high, logarithmic = model.unknown_.search_range(
            start, float(model.unknown_.law_of(start).shear_modulus)
        )
    x, low, high = (
        np.log(each, out=np.array(each, dtype=float), where=logarithmic)
        for each in (start, low, high)
    )
    if model.law is not None:  # central differences stay between the bounds
        low = low + 2 * DIFFERENCE
        high = high - 2 * DIFFERENCE
        x = np.clip(x, low, high)
    space = Space(low, high, logarithmic)
    _begin(model, model.unknown_.law_of(space.parameters(x)), y, root)
    held = model.law is not None and without_scale(model)
    return Search(model, space, y, root, held), x


def first_values(model) -> np.ndarray:
    """Return the parameters of a scene or the law's defaults, and those of a scene's memory."""
    unknown = model.unknown_
    stated = [
        scene.law()
        for scene in scenes_of(model)
        if scene.material is not None and scene.material.law == model.law
    ]
    if isinstance(unknown, EnergyUnknowns):
        return unknown.start()
    if model.law == Ogden.name:
        exponents = np.array(EXPONENTS[model.n_terms - 1])
        sizes = 1 / np.abs(exponents)
        if stated and isinstance(stated[0], Ogden) and len(stated[0].exponents) == model.n_terms:
            sizes = np.abs(stated[0].moduli)
            exponents = np.array(stated[0].exponents)
        start = np.concatenate([sizes, exponents])
    else:
        law = stated[0] if stated else LAWS[str(model.law)]()
        start = np.array([getattr(law, name) for name in unknown.elastic.unknowns()])
    return unknown.completed(start)


def start_of(model, y: np.ndarray, root: np.ndarray) -> np.ndarray:
    """Return the parameters at which the search starts: first ones with moduli that fit the
    forces.
    """
    start = first_values(model)
    product = 0.0
    square = 0.0
    for test, here in model.tests_:
        forces = test.among(FORCES)
        if test.scene.loads or not forces.any():
            continue
        law = model.unknown_.law_of(start)
        with failing(f"the search cannot start at {law.describe()}"):
            simulated = test.simulate(law)[0]
        weight = root[here][forces] ** 2
        product += float((weight * simulated[forces] * y[here][forces]).sum())
        square += float((weight * simulated[forces] ** 2).sum())
    if product <= 0 < square:
        what = "are all zero" if product == 0 else "have the opposite sign of the simulated ones"
        raise ValueError(
            f"y: the measured forces {what}; a force is that on the region pulled, as a run of the"
            " scene reports it"
        )
    if square > 0:
        moduli = (
            len(start) if model.law is None else model.n_terms if model.law == Ogden.name else 1
        )
        start[:moduli] *= product / square
        if model.law is not None:
            start = model.unknown_.completed(start)
    return start


def _begin(model, law: Law, y: np.ndarray, root: np.ndarray) -> None:
    """Simulate all tests with a law; raise ValueError for displacements that are unlike those of
    a test that prescribes them.
    """
    for test, here in model.tests_:
        with failing(f"the search cannot start at {law.describe()}"):
            simulated = test.begin(law)
        if not test.scene.loads:
            weight = root[here]  # zero at places beside the body
            deviation = np.divide(1, weight, out=np.full(len(weight), np.inf), where=weight > 0)
            _check_displacements(test, simulated, y[here], deviation)


def better_start(model, search: Search, x: np.ndarray) -> np.ndarray:
    """Return the start of the search with the lesser sum of squares: x, or the solution of the weak
    form at measured displacements.
    """
    try:
        jacobian, right, forces = _weak_form(search, x)
    except FAILURES:  # as where noise turns bonds around
        return x
    weak = floored(solved(*scaled(jacobian, right, forces)))
    starts = {"default": x, "weak form": weak}
    squares = {name: float((search.residuals(each) ** 2).sum()) for name, each in starts.items()}
    taken = min(starts, key=squares.__getitem__)
    finite = {name: value if np.isfinite(value) else None for name, value in squares.items()}
    model.start_ = {"taken": taken, "terms": model.unknown_.unknowns(), "chi_squared": finite}
    return starts[taken]


def _weak_form(search: Search, x: np.ndarray) -> tuple[np.ndarray, np.ndarray, np.ndarray]:
    """Return the weighted equations of the weak form, and a mask of those of forces."""
    jacobian = np.empty((len(search.y), len(x)))
    right = np.empty(len(search.y))
    forces = np.zeros(len(search.y), dtype=bool)
    for test, here in search.tests:
        jacobian[here], right[here] = test.weak_form(search.law_at, x, search.y[here])
        forces[here] = test.among(FORCES)
    return search.root[:, None] * jacobian, search.root * right, forces


def _check_energy(model, unknown: EnergyUnknowns, count: int) -> None:
    """Raise ValueError for measurements that cannot determine an energy without a law."""
    if without_scale(model):
        raise ValueError(
            "displacements under prescribed motions determine an energy without a law up to a"
            " factor alone: add rows of forces (quantity 0; --forces)"
        )
    if count < len(unknown.terms):
        raise ValueError(
            f"an energy without a law has {len(unknown.terms)} candidate terms, and needs at least"
            f" as many measurements, not {count}: add displacements (--fields), or fit a law"
            " (--law)"
        )


def without_scale(model) -> bool:
    """Return whether all measurements are displacements that do not depend on a common factor of
    all stresses.
    """
    scaled = model.law is None or "bulk_modulus" not in bulk_of(model)
    tests = [
        test
        for test, _ in model.tests_
        if not (test.rows.is_field | test.among(DISPLACEMENTS)).all()
    ]
    return (
        scaled
        and not tests
        and not any(test.scene.loads or test.scene.materials for test, _ in model.tests_)
    )


def _check_displacements(
    test: MeasuredScene, simulated: np.ndarray, measured: np.ndarray, deviation: np.ndarray
) -> None:
    """Raise ValueError for displacements that differ from simulated ones by more than laws do,
    and than the noise of the measurements.
    """
    rows = test.rows
    field = test.rows.is_field & np.isfinite(deviation)
    what = f"those of scene {test.scene.name}, simulated with a law that fits the forces"
    for step in np.unique(rows.step[field]):
        here = field & (rows.step == step)
        found, right, scatter = (
            np.linalg.norm(each[here]) for each in (measured, simulated, deviation)
        )
        off = float(np.linalg.norm((measured - simulated)[here]))
        most = max(found, right)
        if off - SIGNIFICANT * scatter > FARTHEST * most:
            worst = np.flatnonzero(here)[np.abs(measured - simulated)[here].argmax()]
            if abs(measured[worst] - simulated[worst]) > ALONE * off:
                place = ", ".join(f"{x:.4g}" for x in rows.places[worst])
                raise ValueError(
                    f"y: one displacement of step {step} is far from all others: along"
                    f" x{rows.quantity[worst]} at ({place}) it is {measured[worst]:.4g}, and"
                    f" {simulated[worst]:.4g} among {what}: check this measurement"
                )
            raise Unlike(
                f"y: the displacements of step {step} differ by {off / most:.0%} from {what}"
            )
