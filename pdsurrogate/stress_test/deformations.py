"""Large deformations of small bodies, compared with exact solutions and finite elements."""

from __future__ import annotations

from contextlib import suppress
from dataclasses import replace
from itertools import pairwise

import numpy as np
from scipy.integrate import simpson
from scipy.optimize import brentq

from ..body import Body
from ..forces import FORCES, ForceSettings, ForceSurrogate, InvalidState, LearntEnergy
from ..materials import Gent, Law, NeoHookean, homogeneous
from ..results import Result
from ..run.simulate import SimulationFailed, SimulationInterrupted, simulate
from ..scenes import Scene, load_scene
from ..solvers import Unstable
from .bodies import HORIZONS, SPACING
from .case import INAPPLICABLE, PASS, STOPS, WEAK, Case, Outcome, Subject
from .tangents import resistance

MOST_ERROR = 1e-3
"""Greatest relative error of a stress: 0.1 %, a third of the repeatability of the best experiments on rubber."""


TURNED_ABOUT = np.array([2.0, -1.0, 2.0]) / 3
"""Axis of rotations in three dimensions, parallel to no face of a block."""


def turn(degrees: float, dimension: int = 2) -> np.ndarray:
    """Return a rotation matrix, in three dimensions about `TURNED_ABOUT` (Rodrigues)."""
    angle = np.deg2rad(degrees)
    if dimension == 2:
        return np.array([[np.cos(angle), -np.sin(angle)], [np.sin(angle), np.cos(angle)]])
    cross = np.cross(np.eye(3), -TURNED_ABOUT)
    return np.eye(3) + np.sin(angle) * cross + (1 - np.cos(angle)) * cross @ cross


def wavy(points: np.ndarray) -> np.ndarray:
    """Return the positions of points under an inhomogeneous deformation."""
    x1, x2, *rest = points.T
    across = [0.82 * x3 + 0.05 * x2 + 0.02 * np.sin(4 * x1) for x3 in rest]
    return np.stack([1.3 * x1 + 0.02 * np.sin(4 * x2), 0.95 * x2 + 0.1 * x1 + 0.02 * np.cos(5 * x1), *across], axis=1)


def force_densities(force, positions: np.ndarray) -> np.ndarray:
    """Return forces per volume in units of shear modulus / spacing."""
    out = np.empty_like(positions)
    force(positions, out)
    return out / force.body.volumes[:, None] * force.body.spacing / force.law.shear_modulus


def _stretched(subject: Subject, stretches, law: Law, square: bool = False) -> Outcome | float:
    """Return the greatest error of the nominal stress in uniaxial tension or compression between rollers, or a failed outcome.

    The body is a sheet of 3 by 1 or a block of 1 by 0.4 by 0.4, or, if `square`, a square or a cube.
    """
    # Double precision is needed: where a law stiffens, single precision rounds stresses of a hundred mu by more than 1e-6 mu/dx.
    changes = {"spacing": SPACING, "solver.most_evaluations": 20000}
    if subject.dimension == 2:
        changes |= {"precision": "float64"} | ({"body.size": [1.0, 1.0]} if square else {})
    else:
        size = [0.6, 0.6, 0.6] if square else [1.0, 0.4, 0.4]
        # The scene is that of a sheet, with another body and state.
        changes |= {"body": {"shape": "box", "size": size}, "horizon_ratio": HORIZONS[3], "plane": "space"}
    scene = load_scene("uniaxial", changes, stretches=stretches, material=law.describe())
    try:
        result = simulate(scene, subject.model)
    except SimulationInterrupted:
        raise KeyboardInterrupt from None
    except SimulationFailed as error:
        if isinstance(error.__cause__, Unstable):
            return Outcome(STOPS, str(error))
        return Outcome(WEAK, str(error), None, None, "does not converge")
    exact = [homogeneous.uniaxial(law, level["stretch"]).nominal_stress for level in result.levels]
    return max(abs(level["nominal_stress"] / stress - 1) for level, stress in zip(result.levels, exact, strict=True))


def why_inaccurate(subject: Subject) -> str:
    """Return the name of the weakness that makes a model less accurate than the analytic bond force."""
    known = {"ba-nosb": "weights do not add up", "nosb": "zero-energy modes"}
    if subject.reference in known:
        return known[subject.reference]
    blind = isinstance(subject.model, ForceSurrogate) and not subject.model.gives_transverse
    return "no transverse stress" if blind else "accuracy"


def _judged(subject: Subject, found: Outcome | float) -> Outcome:
    return found if isinstance(found, Outcome) else Outcome.below(found, MOST_ERROR, why_inaccurate(subject))


def stretch(subject: Subject) -> Outcome:
    """Test uniaxial tension to 4, 5 and 8 by the error of the nominal stress.

    Outside their domain surrogates use the exact bond force, so their error is no larger there.
    """
    return _judged(subject, _stretched(subject, [4.0, 5.0, 8.0], subject.law))


def compression(subject: Subject) -> Outcome:
    """Test uniaxial compression of a square or a cube to 0.5 by the error of the nominal stress.

    The exact state of the sheet is unstable below 0.53: a model with an energy detects this and stops there.
    """
    return _judged(subject, _stretched(subject, [0.7, 0.5], subject.law, square=True))


def patch_error(subject: Subject, body: Body, F: np.ndarray) -> float:
    """Return the error of the mean stress of a body in a homogeneous state, over the greatest component of the exact one."""
    force = subject.bind(body)
    force(body.points @ F.T, np.empty_like(body.points))
    exact = subject.exact_stress(F)
    return float(np.abs(force.mean_stress() - exact).max() / np.abs(exact).max())


def judged_patch(subject: Subject, error: float, resisted: float, least: float) -> Outcome:
    """Judge a homogeneous state by the error of its stress, and by its resistance to any disturbance, which must reach `least`."""
    figure = f"{error:.1e}, resistance {resisted:.2g}"
    if resisted < least:
        return Outcome(WEAK, figure, resisted, least, "zero-energy modes" if resisted > -least else "loses stability")
    if error > MOST_ERROR:
        return Outcome(WEAK, figure, error, MOST_ERROR, why_inaccurate(subject))
    return Outcome(PASS, figure, error, MOST_ERROR)


def _homogeneous(subject: Subject, F: np.ndarray) -> Outcome:
    """Test a homogeneous state: its mean stress against the exact one, and its resistance to any disturbance.

    The resistance must be a quarter of a continuum's, as in `tangents.least_eigenvalue`.
    """
    body, F = subject.body({2: 10, 3: 6}[subject.dimension]), subject.gradient(F)
    return judged_patch(subject, patch_error(subject, body, F), resistance(subject, body, F), 0.25)


def equibiaxial(subject: Subject) -> Outcome:
    """Test equibiaxial stretch 3: mean stress and stability."""
    return _homogeneous(subject, np.diag([3.0, 3.0]))


def simple_shear(subject: Subject) -> Outcome:
    """Test simple shear 2: mean stress and stability."""
    return _homogeneous(subject, np.array([[1.0, 2.0], [0.0, 1.0]]))


def compressibility(subject: Subject) -> Outcome:
    """Test uniaxial stretch 2 at K/mu = 10, 100, 10^3 and, in the plane, 10^4, by the greatest error of the stress."""
    errors = {}
    for ratio in (1e1, 1e2, 1e3, 1e4)[: 4 if subject.dimension == 2 else 3]:
        law = replace(subject.law, bulk_modulus=ratio * subject.law.shear_modulus)
        if not subject.describes(law):
            return Outcome(INAPPLICABLE, "fitted to one bulk modulus")
        found = _stretched(subject, [2.0], law)
        if isinstance(found, Outcome):
            return replace(found, figure=f"K/mu = {ratio:g}: {found.figure}")
        errors[ratio] = found
    ratio = max(errors, key=errors.get)
    return Outcome.below(errors[ratio], MOST_ERROR, why_inaccurate(subject), f"{{:.1e}} (K/mu = {ratio:g})")


def chain_limit(subject: Subject) -> Outcome:
    """Test Gent's law in uniaxial tension: stresses at 99 % and 102 % of its limit, and a stop at twice the stretch.

    The limit concerns I1bar - 3, about the square of the stretch; a slightly compressible law exceeds it by a few per cent because its
    volume grows. At twice the stretch no solution exists, and the error must say where and why.
    """
    law = subject.law if isinstance(subject.law, Gent) else Gent(subject.law.shear_modulus, 100 * subject.law.shear_modulus, 30.0)
    if not subject.describes(law):
        return Outcome(INAPPLICABLE, "fitted to another law")

    def strain(stretch):
        return stretch**2 + 2 / stretch - 3

    def at(share):
        return float(brentq(lambda stretch: strain(stretch) - share * law.chain_limit, 1.0, 2 * np.sqrt(law.chain_limit + 3)))

    found = _stretched(subject, [at(0.99), at(1.02)], law)
    if isinstance(found, Outcome):
        return found
    body, stretch = subject.body(6), 2 * at(0.99)
    sides = [stretch, *[stretch**-0.5] * (subject.dimension - 1)]
    try:
        subject.bind(body, law)(body.points * sides, np.empty_like(body.points))
    except InvalidState as error:
        if "limit" in str(error) and "point" in str(error):
            return Outcome.below(found, MOST_ERROR, why_inaccurate(subject), f"{{:.1e}}, stops beyond ({error})")
        return Outcome(WEAK, f"beyond the limit: {error}", None, None, "accuracy")
    return Outcome(WEAK, "went on beyond the limit", None, None, "accuracy")


def run_described(subject: Subject, described: dict, force=None) -> Result | Outcome:
    """Return the run of a described scene in the material of a subject, with its model or another force; or a failed outcome."""
    scene = Scene(**{"name": "hard-case", "material": subject.law.describe(), "solver": {"most_evaluations": 5000}} | described)
    try:
        return simulate(scene, force or subject.model)
    except SimulationInterrupted:
        raise KeyboardInterrupt from None
    except SimulationFailed as error:
        return Outcome(WEAK, str(error), None, None, "does not converge")


BONDED = ((100.0, 1.5, 1.24139), (100.0, 0.9, -0.407074), (1000.0, 1.5, 1.25451))
"""Reference cases of a bonded cube: K/mu, stretch, and the force in units of mu on the bonded face of a cube of side 1 of Neo-Hookean
rubber. The forces come from finite elements (FElupe 11.3, three-field hexahedra) and changed by 0.05 % or less in the last refinement,
as in ``pipelines/data/solid_fields.json``.
"""


def bonded_faces(subject: Subject) -> Outcome:
    """Test a cube between bonded plates, pulled to 1.5, pressed to 0.9, and pulled at K = 1000 mu, by the greatest error of the force.

    Neo-Hookean rubber is compared with finite elements, within 2 %: an eighth of the cube with six points a side has a discretisation error
    of 1 %. A surrogate of another law is compared with the exact energy on the same points, within a tenth of a per cent.
    """
    errors = {}
    for bulk_modulus, stretch, reference in BONDED:
        law = replace(subject.law, bulk_modulus=bulk_modulus * subject.law.shear_modulus)
        half = (stretch - 1) / 2
        described = {
            "spacing": 1 / 12,
            "body": {"shape": "box", "size": [0.5, 0.5, 0.5]},
            "material": law.describe(),
            "prescribed": [
                {"region": "left", "x1": 0.0, "x2": 0.0, "x3": 0.0},
                {"region": "right", "x1": half},
                {"region": "bottom", "x2": 0.0},
                {"region": "back", "x3": 0.0},
            ],
            "steps": [{"to": 1.0, "largest_increment": min(1.0, 0.05 / abs(half))}],
        }
        exact = None if isinstance(law, NeoHookean) else run_described(subject, described, "bond-energy")
        found = [
            run if isinstance(run, Outcome) else _reaction(run) for run in (run_described(subject, described), exact) if run is not None
        ]
        for one in found:
            if isinstance(one, Outcome):
                return replace(one, figure=f"K/mu = {bulk_modulus:g}, {stretch:g}: {one.figure}")
        expected = reference * law.shear_modulus if exact is None else found[1]
        errors[f"K/mu = {bulk_modulus:g}, {stretch:g}"] = abs(found[0] / expected - 1)
    limit = 0.02 if isinstance(subject.law, NeoHookean) else MOST_ERROR
    worst = max(errors, key=errors.get)
    return Outcome.below(errors[worst], limit, "accuracy", f"{{:.1e}} ({worst})")


def _reaction(run: Result) -> float:
    """Return the force on a whole face from that on a quarter of it."""
    return 4 * run.levels[-1]["forces"]["right"][0]


def torsion(subject: Subject) -> Outcome:
    """Test a cylinder between bonded faces by its torque at 10 and 180 degrees, against Rivlin's exact solution.

    An incompressible cylinder of any law is sheared by kappa r, and plane faces stay plane: the torque is 2 pi times the integral of the
    shear stress r^2 dr, and K = 100 mu changes it by tenths of a per cent. With eight points across, those at the surface lack half of
    their horizons and the torque is some 9 % low at any angle: it must be within a tenth, and its error must change by no more than 2 %.
    """
    radius, length, turned = 0.5, 1.5, 180.0
    run = run_described(
        subject,
        {
            "spacing": 0.125,
            "body": {"shape": "cylinder", "axis": "x1", "radius": radius, "length": length},
            "prescribed": [
                {"region": "left", "x1": 0.0, "x2": 0.0, "x3": 0.0},
                {"region": "right", "rotation": turned, "about": [length, 0.0, 0.0], "axis": [1.0, 0.0, 0.0]},
            ],
            "steps": [10 / turned, 1.0],
            "solver": {"most_evaluations": 5000, "tolerance": 1e-5},
        },
    )
    if isinstance(run, Outcome):
        return run
    errors = []
    for level, degrees in zip(run.levels, (10.0, turned), strict=True):
        r = radius * np.linspace(0, 1, 201)
        F = np.tile(np.eye(3), (len(r), 1, 1))
        F[:, 1, 2] = np.deg2rad(degrees) / length * r
        exact = 2 * np.pi * simpson(subject.exact_stress(F)[:, 1, 2] * r**2, x=r)
        errors.append(level["moments"]["right"][0] / exact - 1)
    figure, changed = f"{100 * errors[0]:+.1f} % at 10, {100 * errors[1]:+.1f} % at 180 degrees", abs(errors[1] - errors[0])
    if changed > 0.02:
        return Outcome(WEAK, figure, changed, 0.02, "accuracy")
    return Outcome.below(max(map(abs, errors)), 0.1, "accuracy", figure)


def slender(subject: Subject) -> Outcome:
    """Test a cantilever ten times as long as it is thick, four points across, by its deflection.

    The load gives a fiftieth of the length by Timoshenko's beam theory with the law's small-strain moduli. Four points resolve the bending
    stress within a sixth, because of the surfaces, six points within half of that; a fifth is allowed. With corrected bond forces the bar
    bends by 39 % too little with four points, by 12 % with eight and by 6 % with twelve.
    """
    law, d, thickness, length = subject.law, subject.dimension, 0.2, 2.0
    young = 9 * law.bulk_modulus * law.shear_modulus / (3 * law.bulk_modulus + law.shear_modulus)
    bending = length**3 / (3 * young * thickness**3 / 12) + length / (5 / 6 * law.shear_modulus * thickness)
    expected = 0.02 * length
    run = run_described(
        subject,
        {
            "spacing": thickness / 4,
            "body": {"shape": "rectangle" if d == 2 else "box", "size": [length, *[thickness] * (d - 1)]},
            "prescribed": [{"region": "left", **{f"x{axis + 1}": 0.0 for axis in range(d)}}],
            "loads": [{"region": "right", "traction": [0.0, expected / bending / thickness, 0.0][:d]}],
            "probes": [{"name": "tip", "at": [length, *[thickness / 2] * (d - 1)]}],
            "steps": [1.0],
        },
    )
    if isinstance(run, Outcome):
        return run
    off = run.levels[-1]["probes"]["tip"]["displacement"][1] / expected - 1
    weakness = why_inaccurate(subject)
    if weakness == "accuracy" and subject.model.family == "bond force":
        weakness = "cut horizons"
    return Outcome.below(abs(off), 0.2, weakness, f"{100 * off:+.1f} %")


def beyond_the_domain(subject: Subject) -> Outcome:
    """Test the way from rest to twice the greatest stretch of a surrogate's domain: exact forces at its end, and conservation of energy.

    The end is at 1.5 or 1.2 times the greatest stretch if the law ends earlier. There every bond must have the exact force. On the way the
    exact energy replaces the learnt one: the work, by Gauss's rule on 200 intervals, must equal the stored energy to 1e-7, which a jump by
    the error of the fit would exceed.
    """
    model = subject.model
    if not isinstance(model, ForceSurrogate | LearntEnergy) or model.domain is None:
        return Outcome(INAPPLICABLE, "holds everywhere")
    body = subject.body({2: 8, 3: 5}[subject.dimension])
    force, out, expected = subject.bind(body), np.empty_like(body.points), np.empty_like(body.points)
    settings = ForceSettings(precision="float64", plane=subject.plane, correction=None if force.has_energy else force.correction)
    exact = FORCES["bond-energy" if force.has_energy else "analytic"]().bind(body, subject.law, settings)

    def at(stretch: float) -> np.ndarray:
        sides = [stretch, *[stretch**-0.5] * (subject.dimension - 1)]
        return (body.points + 0.02 * (wavy(body.points) - body.points)) * sides

    for share in (2.0, 1.5, 1.2):
        greatest = share * model.domain.greatest_stretch
        # A law with a limit may have no state there.
        with suppress(InvalidState):
            exact(at(greatest), expected)
            break

    nodes, weights = np.polynomial.legendre.leggauss(3)
    ends = np.exp(np.linspace(0, np.log(greatest), 201))
    work, change = 0.0, 1e-6
    if force.has_energy:
        force(at(1.0), out)
        before = force.energy()
        for low, high in pairwise(ends):
            for node, weight in zip(nodes, weights, strict=True):
                stretch = (low + high + node * (high - low)) / 2
                force(at(stretch), out)
                velocity = (at(stretch + change) - at(stretch - change)) / (2 * change)
                work -= weight * (high - low) / 2 * float((out * velocity).sum())
    force(at(greatest), out)
    lost = abs(work / (force.energy() - before) - 1) if force.has_energy else 0.0
    off = float(np.abs(out - expected).max() / np.abs(expected).max())
    figure = f"{off:.0e} from the exact force" + (f", work within {lost:.0e}" if force.has_energy else "")
    if lost > 1e-7:
        return Outcome(WEAK, figure, lost, 1e-7, "accuracy")
    return Outcome.below(off, 1e-9, "accuracy", figure)


CASES = (
    Case("stretch to 4, 5 and 8", "stress within 0.1 % of the exact one", stretch),
    Case("compression to 0.5", "stress within 0.1 % of the exact one", compression),
    Case("equibiaxial stretch 3", "stress within 0.1 %, and stable", equibiaxial),
    Case("simple shear 2", "stress within 0.1 %, and stable", simple_shear),
    Case("Gent to 99 % of its limit, and beyond", "stress within 0.1 %; beyond, a stop that names the place", chain_limit),
    Case("K/mu = 10 to 10^4 (in space 10^3), stretch 2", "stress within 0.1 % of the exact one", compressibility),
    Case("cube between bonded faces: 1.5, 0.9, and K/mu = 1000", "force within 2 % of finite elements", bonded_faces, ("space",)),
    Case("torsion of a cylinder by 180 degrees", "torque within a tenth of Rivlin's, its error even within 2 %", torsion, ("space",)),
    Case("slender cantilever, four points across", "deflection within a fifth of Timoshenko's", slender),
    Case("to twice the stretch of the domain", "the exact force there, work is energy to 1e-7", beyond_the_domain),
)
