"""Fit of a law to measurements on bodies: rounds of searches, corrected for the discretization
error, and what they leave open.
"""

import logging
import warnings
from contextlib import suppress
from types import SimpleNamespace
from typing import Any

import numpy as np
from scipy.optimize import least_squares, lsq_linear
from scipy.stats import chi2

from ..identification import EnergyRegressor, nominal_stress
from ..identification.averaging import average
from ..identification.energy import half_planes
from ..materials import Law
from ..materials.dictionary import STABLE_TO, wave_margin
from .asked import fine_spacing, ratio_of, scales_of, stress_derivatives
from .causes import cause_at_start, cause_of_misfit
from .free import FLOOR, HALVINGS, floored, grouping, minimized
from .image_start import start_maps, store_maps
from .measured import FAILURES, Unlike
from .search import Search, errors_of, failing
from .starts import better_start, search_from, start_of, unknowns_of

logger = logging.getLogger(__name__)

ORDER = 1.5
MEAN_ORDER = 1.75
"""Least order in the spacing with which displacements of sheets with holes converge, for standard
errors, and the mean one, for the extrapolation to a spacing of zero (theory, section 28).
"""

UNDETERMINED = 0.5
"""Relative standard error of a combination of parameters from which on the test does not
determine it.
"""

SHARE = 0.3
"""Least component of a parameter, in the unit vector of an undetermined combination, at which
the parameter is named.
"""

ROUNDS = 3
"""Most fits with a new correction of the discretization error: each changes the parameters by a
small part of the change before.
"""

AT_BOUND = 0.01
"""Distance from a bound, in standard errors, at which a parameter counts as at the bound, which
a search approaches without reaching it.
"""

SETTLED = 0.1
"""Change of all parameters, in their standard errors, below which the correction of the
discretization error is not computed again.
"""

MEMBERS = 8
"""Number of laws that are drawn: their spread is then known to some 25 %."""

ADVICE = (
    "give places and displacements in the unit of length and along the axes of the scene, and the"
    " steps in its order"
)

FAIR = 0.02
STEPS = (1, 3, 0)
"""Relative decrease of the cost that ends the least-squares steps of an energy with all terms, and
most such steps in each of the `ROUNDS`. Chosen: further steps would change the energy less than the
choice of the terms and the next correction do. The last round has no step: it linearizes the
equations about the average of the energies.
"""


def fitted(model, y: np.ndarray, root: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
    """Set the results of the fit to values with roots of weights; return its values and the
    correction of the discretization error.
    """
    model.unknown_ = unknowns_of(model, len(y))
    root = start_maps(model, y, root)
    ratio = ratio_of(model)
    try:
        start = start_of(model, y, root)
        search, x = search_from(model, start, y, root)
    except Unlike as error:
        cause = cause_at_start(model, y, root)
        raise ValueError(f"{error}; {cause or ADVICE}") from None
    if model.frame == "image":
        search.aim(y, x)
    elif cause := cause_of_misfit(model, search, x, root * (y - search.values(x)), True):
        raise ValueError(f"y: {cause}")
    model.start_: dict[str, Any] = {"taken": "default"}
    if model.law is None and all(test.has_fields for test, _ in model.tests_):
        x = better_start(model, search, x)
    found, correction = _searched(model, search, x)
    x = found.x
    space = search.space
    model.weights_ = np.where(root > 0, search.root / np.where(root > 0, root, 1.0), 0.0) ** 2
    root = search.root
    if model.law is None:
        kept = x > FLOOR * x.max()
        model.unknown_ = model.unknown_.of(kept)
        search.space = search.space.of(kept)
        search.forget()
        x = x[kept]
        found.jac = found.jac[:, kept]
        space = search.space
        found.spread = found.spread[np.ix_(kept, kept)]
        found.active_mask = np.zeros(len(x), dtype=bool)
    else:
        found.active_mask = (found.active_mask != 0) | (
            np.minimum(x - space.low, space.high - x) < AT_BOUND * errors_of(found.jac)
        )
    visited = np.concatenate([test.states(search.law_at(x)) for test, _ in model.tests_])
    _set_domain(model, visited)
    model.n_simulations_ = search.count
    fit = search.values(x) + correction
    residuals = root * (y - fit)
    if cause := cause_of_misfit(model, search, x, residuals):
        if model.frame != "scene":
            raise ValueError(f"y: {cause}")
        warnings.warn(cause, stacklevel=3)
    fit[root == 0] = np.nan
    remaining = found.remaining if ratio == 1 else correction / (ratio**ORDER - 1)
    used = len(x) + sum(test.used for test, _ in model.tests_)
    _store(model, x, space, found, residuals, root * remaining, int((root > 0).sum()) - used)
    store_maps(model, space.sizes(x))
    if ratio == 1:
        correction = -remaining
        if (error := float(np.sqrt(((root * remaining) ** 2).mean()))) > 1:
            warnings.warn(
                f"refine=1: the discretization error that is not corrected is about {error:.2g}"
                " standard deviations of the measurements, and the standard errors contain it to"
                " first order only: use refine=2 or more, or a smaller spacing",
                stacklevel=3,
            )
    if model.law is not None:
        model.members_ = _drawn(model, x, space, found.jac, residuals, visited)
    return fit, correction


def _searched(model, search: Search, x: np.ndarray) -> tuple[SimpleNamespace, np.ndarray]:
    """Return the solution of a search that starts at x, and the correction of the discretization
    error, (n,), that it contains.
    """
    ratio = ratio_of(model)
    imaged = model.frame == "image"
    y = search.y
    correction = np.zeros(len(search.y))
    for number in range(ROUNDS if ratio > 1 or model.law is None or imaged else 1):
        first = ratio > 1 and not number
        # Changes of the cost by less than these are those of parameters within a part of their
        # standard errors.
        close = 1e-3 if first else 1e-2 / len(y)
        if model.law is None:
            found = _energy(model, search, x, number)
        else:
            bounds = {"bounds": (search.space.low, search.space.high), "x_scale": "jac"}
            found = least_squares(
                search.residuals,
                x,
                search.jacobian,
                **bounds,
                ftol=close,
                xtol=1e-8,
                gtol=1e-12,
                max_nfev=60,  # well-posed fits take five to ten
            )
        before = x
        x = found.x
        settled = (
            model.law is not None
            and number
            and (np.abs(x - before) <= SETTLED * errors_of(found.jac)).all()
        )
        if imaged:
            search.forget()  # the maps become those of this law
            search.values(x)
        if ratio == 1 and model.law is not None:
            found.remaining = _error_by_coarse(model, search.law_at(x), search.values(x))
        if settled:
            break
        if ratio > 1:
            correction = _fine_values(model, search.law_at(x)) - search.values(x)
            if model.law is None:
                correction *= ratio**MEAN_ORDER / (ratio**MEAN_ORDER - 1)
        search.aim(y - correction, x if imaged else None)
    if imaged:
        search.forget()
        found.jac = search.jacobian(x)
    return found, correction


def _error_by_coarse(model, law: Law, values: np.ndarray) -> np.ndarray:
    """Return the discretization error of measurements with a law, (n,), by simulations with
    twice the spacing; warn where they fail.
    """
    found = np.zeros(len(values))
    for test, here in model.tests_:
        try:
            if test.scene.spacing is None:
                raise ValueError("the spacing of a mesh is its own")
            coarse = test.simulate(law, 2 * test.scene.spacing)[0]
            found[here] = (coarse - values[here]) / (2**ORDER - 1)
        except (*FAILURES, ValueError) as error:
            warnings.warn(
                f"refine=1: the discretization error of scene {test.scene.name} is unknown and no"
                " part of the standard errors, since a simulation with twice the spacing fails:"
                f" {error}",
                stacklevel=5,
            )
    return found


def _fine_values(model, law: Law) -> np.ndarray:
    """Return the measurements of the finer simulations with a law, shape (n,)."""
    found = np.empty(sum(len(here) for _, here in model.tests_))
    for test, here in model.tests_:
        finer = fine_spacing(model, test.scene)
        logger.info("%s: finer simulation, spacing %.3g", test.scene.name, finer)
        with failing(
            f"refine: with the spacing {finer} the fitted law fails; choose"
            " another spacing or refine"
        ):
            found[here] = test.simulate(law, finer)[0]
    return found


def _energy(model, search: Search, x: np.ndarray, number: int) -> SimpleNamespace:
    """Return the coefficients of all terms and the Jacobian there.

    In the first of the rounds, which are numbered from 0, a least-squares step finds the
    coefficients. In the following ones the equations are linearized there, and the average of
    energies with few terms is their solution, with the covariance ``spread``.
    """
    found = minimized(search, x, FAIR, STEPS[number])
    if number == 0:
        return found
    residuals = search.residuals(found.x)
    total = 0.0
    count = 0
    for test, here in model.tests_:
        field = test.rows.is_field
        each = grouping(residuals[here][field], test.rows.places[field], test.rows.quantity[field])
        total = total + each[0]
        count = count + each[1]
    correlated = max(1.0, total / count / (residuals**2).mean()) if count else 1.0
    greatest = max(STABLE_TO, *(test.greatest_stretch for test, _ in model.tests_))
    right = found.jac @ found.x - residuals
    terms = model.unknown_.terms
    settings = (
        lambda least: correlated * max(1.0, least / len(right)),
        wave_margin(terms, greatest),
        MEMBERS,
        model.random_state,
    )
    energies = average(terms, found.jac, right, *settings)
    members = energies.members
    found.spread = energies.covariance
    found.x = floored(energies.mean)
    if ratio_of(model) == 1 and number == ROUNDS - 1:
        found.remaining = _error_by_coarse(model, search.law_at(found.x), search.values(found.x))
        shift = search.root * found.remaining
        sides = [average(terms, found.jac, right + way * shift, *settings) for way in (1, -1)]
        members = np.concatenate([sides[0].members[::2], sides[1].members[1::2]])
        change = (sides[0].mean - sides[1].mean) / 2
        found.spread = found.spread + np.outer(change, change)
    model.members_ = [model.unknown_.of(each > 0).law_of(each[each > 0]) for each in members]
    return found


def _set_domain(model, visited: np.ndarray) -> None:
    """Set the hull and the range of the principal stretches (n, 3) in the tests, which are in
    descending order.
    """
    isochoric = visited / np.cbrt(visited.prod(axis=1))[:, None]
    model.domain_hull_ = [
        [n1, n2, EnergyRegressor.margin - offset]
        for n1, n2, offset in half_planes(isochoric[:, :2]).tolist()
    ]
    model.stretch_range_ = float(visited.min()), float(visited.max())


def _store(model, x, space, found, residuals, remaining, free) -> None:
    """Set parameters, covariance and lack of fit from the weighted Jacobian and residuals at the
    solution, and the remaining error.
    """
    jacobian = found.jac / space.sizes(x)
    model.parameter_names_ = model.unknown_.unknowns()
    model.parameters_ = space.parameters(x)
    model.law_ = model.unknown_.law_of(model.parameters_)
    names = np.array(model.parameter_names_)
    model.at_bound_ = names[found.active_mask].tolist()
    model.lack_of_fit_ = float((residuals**2).sum() / free) if free > 0 else np.nan
    model.p_value_ = float(chi2.sf((residuals**2).sum(), free)) if free > 0 else np.nan
    if model.law is None:
        model.covariance_ = found.spread
        errors = np.sqrt(np.diag(found.spread))
        model.standard_errors_ = errors
        model.correlation_ = found.spread / np.outer(errors, errors)
        model.undetermined_ = names[errors > UNDETERMINED * model.parameters_].tolist()
        return
    scales = scales_of(model)
    left, singular, right = np.linalg.svd(jacobian * scales, full_matrices=False)
    known = singular > 1e-10 * singular.max(initial=0.0)
    inverse = (right[known].T / singular[known]) @ left[:, known].T
    covariance = inverse @ inverse.T * max(1.0, model.lack_of_fit_ if free > 0 else 1.0)
    change = inverse @ remaining
    covariance += np.outer(change, change)
    unknown = (np.abs(right[~known]) > SHARE).any(axis=0)
    doubtful = ~known | (1 / np.where(known, singular, 1.0) > UNDETERMINED)
    named = (np.abs(right[doubtful]) > SHARE).any(axis=0)
    model.undetermined_ = names[named].tolist()
    covariance = covariance * np.outer(scales, scales)
    errors = np.sqrt(np.diag(covariance))
    errors[errors == 0] = 1.0
    model.correlation_ = covariance / np.outer(errors, errors)
    covariance[unknown, unknown] = np.inf
    model.covariance_ = covariance
    model.standard_errors_ = np.sqrt(np.diag(covariance))


def _drawn(model, x, space, jacobian, residuals, visited) -> list[Law]:
    """Return laws drawn from the distribution of bounded least-squares solutions x; none if a
    parameter is not determined at all.

    `jacobian` is the derivative of the weighted simulated measurements by x, and `residuals` are
    the weighted measurements minus the simulated ones. Solutions without bounds are normal about
    the minimum of the linearized residuals, with the covariance of the parameters. The bounded
    solution is the nearest place within the bounds, in the metric of the covariance. The change
    from x is halved until it gives a law whose stresses in the states `visited` (n, 3) are nearly
    linear in it: others do not describe the test.
    """
    if not np.isfinite(model.covariance_).all():
        return []
    # The stresses of a drawn law are compared with linear ones in at most a hundred states.
    states = visited[:: -(-len(visited) // 100), :2]
    sizes = space.sizes(x)
    variances, axes = np.linalg.eigh(model.covariance_ / np.outer(sizes, sizes))
    deviations = np.sqrt(np.maximum(variances, 1e-14 * variances.max()))
    random = np.random.default_rng(model.random_state)
    members = []
    inverse = (axes / deviations).T
    unbounded = x + np.linalg.lstsq(jacobian, residuals, rcond=1e-10)[0]
    stress, error = model.nominal_stress(states)
    slopes = stress_derivatives(model, states) * sizes
    for normal in random.standard_normal((MEMBERS, len(x))):
        change = (
            lsq_linear(
                inverse,
                inverse @ (unbounded + axes @ (deviations * normal)),
                (space.low, space.high),
                method="bvls",
            ).x
            - x
        )
        member = model.law_
        for part in change / 2.0 ** np.arange(HALVINGS)[:, None]:
            with suppress(ValueError):  # some parameters between the bounds are not those of a law
                law = model.unknown_.law_of(space.parameters(x + part))
                if ((nominal_stress(law, states) - stress - slopes @ part) ** 2).mean() <= (
                    error**2
                ).mean():
                    member = law
                    break
        members.append(member)
    return members
