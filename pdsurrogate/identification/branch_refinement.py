"""Refinement of a fit of an elastic energy, of softening and of branches: all parameters at once,
with free times.
"""

from dataclasses import replace
from functools import cache
from typing import NamedTuple

import numpy as np
from scipy.optimize import least_squares

from ..materials import Branch, Law, Memory, Softening
from .branch_search import Curves, constant
from .branch_start import Problem, Start
from .elastic_part import Elastic
from .energy import NEGLIGIBLE
from .regressor import DIFFERENCE, FAILED, covariance_at

BEYOND = 10.0
"""Factor by which times may lie beyond those of the grid: slower branches are elastic in the tests,
and faster ones are a viscosity.
"""

SAME_TIME = 0.2
"""Least difference of the logarithms of two relaxation times. Chosen: the stresses of two nearer
branches are those of one, to a percent.
"""

CERTAIN = 2.0
"""Least modulus of a branch, in its standard errors, in a choice of the number of branches."""

SOFTENING = {"r": (1.0, 100.0), "m": (1e-5, 1e3), "beta": (0.0, 10.0)}
"""Bounds of the parameters of softening; those of m are in units of the greatest energy."""

SPAN = 10.0
EXPONENTS = 2
"""Range of overstresses, up to the greatest one, in which times fall, and the number of powers by
which they do so in equal parts of it. Chosen: stresses below a tenth of the greatest tell little.
"""


class Form(NamedTuple):
    """Parameters of a law with memory, in their order: those of the elastic energy, of softening,
    the moduli of branches, their times, and the powers by which all times fall with the overstress.

    Attributes
    ----------
    elastic : Elastic
    softening : tuple of str
        Parameters of softening; none without it.
    branches : int
    places : ndarray, shape (n_powers + 1,)
        Logarithms of the overstresses, divided by the modulus, between which times are powers of
        them; empty for constant times.
    """

    elastic: Elastic
    softening: tuple[str, ...]
    branches: int
    places: np.ndarray = np.empty(0)

    @property
    def names(self) -> list[str]:
        numbers = range(1, self.branches + 1)
        of_branches = [f"branch_{what}_{one}" for what in ("modulus", "time") for one in numbers]
        softening = (f"softening_{key}" for key in self.softening)
        powers = (f"time_power_{one}" for one in range(1, len(self.places)))
        return [*self.elastic.names, *softening, *of_branches, *powers]

    def parts(self, values: np.ndarray) -> tuple[np.ndarray, ...]:
        """Return parameters of the elastic energy and of softening, moduli, times, and powers."""
        k = self.branches
        return tuple(
            np.split(values, np.cumsum([len(self.elastic.names), len(self.softening), k, k]))
        )

    def branch(self, modulus: float, time: float, powers: np.ndarray) -> Branch:
        """Return a branch whose time falls by powers of the overstress, if there are some."""
        if not len(powers):
            return Branch(modulus, time)
        falls = np.r_[0.0, np.cumsum(powers * np.diff(self.places))]
        times = zip(modulus * np.exp(self.places), time * np.exp(-falls), strict=True)
        return Branch(modulus, time, tuple((float(one), float(at)) for one, at in times))

    def law(self, values: np.ndarray) -> Law:
        """Return the law; raise ValueError for parameters that no law has."""
        elastic, softening, moduli, times, powers = self.parts(values)
        softens = dict(zip(self.softening, softening.tolist(), strict=True))
        each = zip(moduli.tolist(), times.tolist(), strict=True)
        branches = (self.branch(*one, powers) for one in each)
        memory = Memory(tuple(branches), Softening(**softens) if softens else None)
        return replace(self.elastic.law(elastic), memory=memory)


class Refined(NamedTuple):
    """Parameters with the least squares.

    Attributes
    ----------
    values : ndarray, shape (n_parameters,)
        In the order of `Form.names`, branches by their times.
    covariance : ndarray, shape (n_parameters, n_parameters)
    at_bound : ndarray of int, shape (n_parameters,)
        -1 at the lower bound of a parameter, 1 at the upper one, else 0.
    """

    values: np.ndarray
    covariance: np.ndarray
    at_bound: np.ndarray


def linear(law: str, problem: Problem, start: Start, times: np.ndarray) -> tuple[Form, np.ndarray]:
    """Return the form of a fit of a law with a start and times, without branches and terms that
    have no share of the stresses, and its parameters.
    """
    elastic, curves, y, root, keys = problem
    sizes, _ = problem.solved(np.column_stack([start.columns, curves.columns(constant(times))]))
    sizes, moduli = np.split(sizes, [elastic.linear])
    shares = np.linalg.norm(root[:, None] * start.columns, axis=0) * sizes
    kept = shares > NEGLIGIBLE * np.linalg.norm(root * y)
    if not kept.any():
        raise ValueError(
            f"{law}: no part of the stresses is elastic, so that the rubber would flow;"
            " add tests that are slower, or that are held for longer"
        )
    if elastic.only is not None:
        elastic, sizes = elastic.only(kept), sizes[kept]
    some = moduli > 0
    form = Form(elastic, keys, int(some.sum()))
    return form, np.concatenate(
        [sizes, start.shape, start.softening, moduli[some], np.asarray(times)[some]]
    )


def restart(problem: Problem, form: Form, values: np.ndarray) -> Start:
    """Return the start of a further fit from parameters."""
    elastic, softening, *_ = form.parts(values)
    shape, law = elastic[form.elastic.linear :], form.law(values)
    factor = problem.curves.softened(law.memory.softening, problem.curves.energy(law))
    return Start(shape, softening, factor[:, None] * problem.elastic.columns(shape))


def refine(problem: Problem, form: Form, start: np.ndarray) -> Refined:
    """Return the parameters of a form with which it fits the stresses best, from a start."""
    curves, y, root = problem.curves, problem.y, problem.root
    low, high, logarithmic = _search_range(form, curves, y, start)
    k, scale = form.branches, np.abs(y).max()
    before = len(form.elastic.names) + len(form.softening)
    elastic_form = form._replace(branches=0, places=np.empty(0))

    def value(x):
        return np.exp(x, out=x.copy(), where=logarithmic)

    # Steps of one parameter, and derivatives after an evaluation, ask for the same again.
    @cache
    def unsoftened(*values):
        return curves.elastic(form.elastic.law(np.array(values)))

    @cache
    def relaxing(*values):
        times, powers = np.split(np.array(values), [k])
        moved = [(times, powers), (times * np.exp(DIFFERENCE), powers)]
        moved += [(times, one) for one in powers + DIFFERENCE * np.eye(len(powers))]
        each = [form.branch(1.0, time, some) for ends, some in moved for time in ends.tolist()]
        return np.hsplit(curves.columns(each), len(moved))

    def elastic(values):
        try:
            energy, stress = unsoftened(*values[: len(form.elastic.names)])
            softening = elastic_form.law(values[:before]).memory.softening
        except ValueError:  # parameters between the bounds that are not those of a law
            return np.full(len(y), np.nan)
        return stress * curves.softened(softening, energy)

    def residuals(x):
        values = value(x)
        moduli = form.parts(values)[2]
        found = root * (elastic(values) + relaxing(*values[before + k :])[0] @ moduli - y)
        return found if np.isfinite(found).all() else np.full(len(y), FAILED)

    def jacobian(x):
        values = value(x)
        moduli = form.parts(values)[2]
        here = elastic(values)
        columns = []
        for place in range(before):
            # Towards the farther bound, so that the law exists.
            size = DIFFERENCE * max(abs(x[place]), 0.0 if np.isinf(high[place]) else 1.0)
            moved = x.copy()
            moved[place] += size if 2 * x[place] < low[place] + high[place] else -size
            columns.append((elastic(value(moved)) - here) / (moved[place] - x[place]))
        now, later, *steeper = relaxing(*values[before + k :])
        powers = [(one - now) @ moduli / DIFFERENCE for one in steeper]
        table = np.column_stack([*columns, now, moduli * (later - now) / DIFFERENCE, *powers])
        return root[:, None] * np.nan_to_num(table, posinf=0.0, neginf=0.0)

    ends = low, high, np.clip(start, low, high)
    low, high, x = (np.log(one, out=one.copy(), where=logarithmic) for one in ends)
    edge = 1e-9 * np.where(np.isfinite(high), high - low, scale)
    found = least_squares(
        residuals,
        np.clip(x, low + edge, high - edge),
        jacobian,
        bounds=(low, high),
        x_scale="jac",
        xtol=1e-8,
        ftol=1e-8,
        gtol=1e-12,
        max_nfev=100,  # a few tens are usual
    )
    values, at_bound = value(found.x), found.active_mask
    # What has no share of the stresses, or is at a bound, tells nothing of the other parameters.
    shares = np.linalg.norm(found.jac, axis=0) * np.where(low == 0, values, 1.0)
    known = np.flatnonzero((at_bound == 0) & (shares > NEGLIGIBLE * np.linalg.norm(root * y)))
    slopes = found.jac / np.where(logarithmic, values, 1.0)
    covariance = np.full((len(values), len(values)), np.inf)
    covariance[np.ix_(known, known)] = covariance_at(slopes[:, known], 2 * found.cost)
    by_time = before + np.argsort(form.parts(values)[3])
    order = np.r_[: len(values)]
    order[before : before + 2 * k] = np.r_[by_time, by_time + k]
    return Refined(values[order], covariance[np.ix_(order, order)], at_bound[order])


def _search_range(form: Form, curves: Curves, y: np.ndarray, start: np.ndarray):
    """Return the bounds of all parameters, and which of them are searched by their logarithm."""
    elastic = form.parts(start)[0]
    low, high, logarithmic = form.elastic.search_range(elastic, np.abs(y).max())
    if form.softening:
        # Within the bounds, for a law may have no term of size zero.
        top = curves.energy(form.elastic.law(np.clip(elastic, low, high))).max()
        scale = np.array([top if key == "m" else 1.0 for key in form.softening])
        least, most = scale * np.array([SOFTENING[key] for key in form.softening]).T
        low, high = np.r_[low, least], np.r_[high, most]
        logarithmic = np.r_[logarithmic, least > 0]
    k, powers = form.branches, max(0, len(form.places) - 1)
    ends = [curves.grid()[0] / BEYOND, curves.grid()[-1] * BEYOND] if k else [1.0, 1.0]
    # Times fall by the tenth power at most.
    return (
        np.r_[low, np.zeros(k), np.full(k, ends[0]), np.zeros(powers)],
        np.r_[high, np.full(k, np.inf), np.full(k, ends[1]), np.full(powers, 10.0)],
        np.r_[logarithmic, np.repeat([False, True, False], [k, k, powers])],
    )


def falling(curves: Curves, form: Form, values: np.ndarray) -> tuple[Form, np.ndarray]:
    """Return the form of a fit whose times fall with the overstress, and its start from a fit of
    constant times.
    """
    top = curves.greatest_overstress(constant(form.parts(values)[3]))
    places = np.log(np.geomspace(top / SPAN, top, EXPONENTS + 1))
    return form._replace(places=places), np.r_[values, np.ones(EXPONENTS)]


def superfluous(form: Form, found: Refined, chosen: bool) -> np.ndarray:
    """Return the numbers of branches to leave out: those without a modulus, else one of two with
    nearly the same time, else, if the number of branches is `chosen`, one at the least time, a
    viscosity, whose modulus the tests do not tell, or the least certain one if its modulus is
    within its error.
    """
    _, _, moduli, times, _ = form.parts(found.values)
    untold = np.flatnonzero(chosen & (form.parts(found.at_bound)[3] < 0))[:1]
    errors = form.parts(np.sqrt(np.diag(found.covariance)))[2]
    idle = np.flatnonzero(moduli <= NEGLIGIBLE * moduli.max(initial=0.0))
    same = np.flatnonzero(np.diff(np.log(times)) < SAME_TIME)[:1]
    vague = np.flatnonzero(chosen & np.isfinite(errors) & (moduli < CERTAIN * errors))
    worst = vague[np.argsort((moduli / errors)[vague])][:1]
    return next((one for one in (idle, same, untold, worst) if len(one)), idle)
