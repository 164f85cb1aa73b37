"""Hard cases for every force model: tangents, large deformations, difficult discretizations, stiff
contrasts and long motions.

python pipelines/hard_cases.py                     all force models, in some two hours
python pipelines/hard_cases.py "stress, nosb"      a model in a plane; --help names other uses

The properties that every force model must have are in `pdsurrogate.testing`, where one of your own
is tested.
"""

from contextlib import suppress
from dataclasses import dataclass, replace
from functools import partial
from itertools import pairwise, permutations

import numpy as np
from cases import LISTED, Study, report
from pages import markdown_table
from scipy.integrate import fixed_quad
from scipy.linalg import block_diag
from threadpoolctl import threadpool_limits

import pdsurrogate as pds
from pdsurrogate.artifacts import list_artifacts, load_surrogate
from pdsurrogate.body import Body, ReflectionPlane
from pdsurrogate.forces import FORCES, ForceSurrogate, InvalidState, LearnedEnergy
from pdsurrogate.forces.settings import WHERE
from pdsurrogate.kernels.steps import central_difference_step
from pdsurrogate.materials import PLANES, homogeneous, plane_stress
from pdsurrogate.solvers.equilibrium import Diverging, NotConverged, Unstable
from pdsurrogate.solvers.methods import Automatic
from pdsurrogate.solvers.stability import FrequencyEstimate
from pdsurrogate.testing.bodies import HORIZONS, SPACING, crack, lattice, of_points, wavy
from pdsurrogate.testing.checks import subject_of
from pdsurrogate.testing.properties import DoesNotApply, required
from pdsurrogate.testing.subject import Subject, forces_at, mean_stress_at

WEAKNESSES = LISTED["weaknesses"]
"""Explanations of the weaknesses that a hard case can show, by their names."""


class Weak(Exception):
    """What a force model shows in a case that it does not pass: the figure, and the name of its
    weakness.
    """


def at_most(value, limit, weakness, figure="{:.1e}"):
    """Return a figure as text, or raise `Weak` if it is greater than a limit."""
    if not value <= limit:
        raise Weak(figure.format(value), weakness)
    return figure.format(value)


@dataclass(frozen=True, eq=False)
class Tested(Subject):
    """Force model in hard cases; `steps` is the number of explicit steps that long motions take."""

    steps: int = 100_000

    def body(self, plane, space, ratio=None, **options):
        """Return a `regular` body with `plane` points a side if the model is tested in the plane,
        with `space` points a side if in solids.
        """
        return regular(self.dimension, self.sized(plane, space), ratio, **options)

    def describes(self, law):
        """Return whether the model can be used for a material law."""
        with suppress(ValueError):
            self.model.check_material(law)
            return True
        return False

    def gradient(self, F):
        """Return an in-plane deformation gradient F, shape (2, 2), completed for solids by the
        stretch along x3 without stress there.
        """
        if self.dimension == 2:
            return F
        trace, J = plane_stress.invariants(F)
        return block_diag(F, plane_stress.volume_ratio(self.law, trace, J) / J)

    def uniaxial(self, stretch):
        """Return the deformation gradient, shape (d, d), of uniaxial tension along x1."""
        lateral = homogeneous.uniaxial(self.law, stretch).lateral_stretch
        return self.gradient(np.diag([stretch, lateral]))

    def solve(self, scene, where="", weakness="does not converge", unstable="loses stability"):
        """Return the result of a scene with the model under test; raise `Weak` if it fails."""
        try:
            return self.run(scene)
        except pds.SimulationFailed as error:
            why = unstable if isinstance(error.__cause__, Unstable) else weakness
            raise Weak(where + str(error).partition(":")[0], why) from error


def under_test(reference, plane="stress", **more):
    """Return a force model for the hard cases, by name."""
    return Tested(**vars(subject_of(reference, plane=plane)), **more)


def regular(dimension, cells, ratio=None, **options):
    """Return a square (`dimension` 2) or cube (3) with `cells` points a side, or along each axis;
    the horizon is `ratio` spacings, and `options` are those of `of_points`.
    """
    cells = (cells,) * dimension if isinstance(cells, int) else cells
    return of_points(lattice(*(count * SPACING for count in cells)), ratio, **options)


def of_simplices(random, dimension, cells, amount=0.2):
    """Return a square or cube meshed with triangles or tetrahedra, with a point at the centroid of
    each, as from a mesh file.

    Every square of a grid is cut into two triangles, every cube into six tetrahedra around its
    diagonal. Interior corners are moved at random by up to `amount` sides of a square.
    """
    axes = np.meshgrid(*[np.arange(cells + 1)] * dimension, indexing="ij")
    corners = np.stack(axes, axis=-1).reshape(-1, dimension)
    within = ((corners > 0) & (corners < cells)).all(axis=1)
    nodes = SPACING * (corners + amount * within[:, None] * random.uniform(-1, 1, corners.shape))
    nodes = nodes.reshape(*axes[0].shape, dimension)
    origins = corners[(corners < cells).all(axis=1)]
    middles, volumes = [], []
    for path in permutations(np.eye(dimension, dtype=int)):
        steps = np.cumsum([np.zeros(dimension, dtype=int), *path], axis=0)
        cell = np.stack([nodes[tuple((origins + step).T)] for step in steps], axis=1)
        middles.append(cell.mean(axis=1))
        volumes.append(
            np.abs(np.linalg.det(cell[:, 1:] - cell[:, :1])) / (2 if dimension == 2 else 6)
        )
    volumes = np.concatenate(volumes)
    spacing = float(volumes.mean() ** (1 / dimension))
    return Body(np.concatenate(middles), volumes, HORIZONS[dimension] * spacing, spacing)


def tangent(force, positions):
    """Return -df/du at given positions of the points that are not outermost: component i of the
    k-th has row and column d k + i.
    """
    body, d = force.body, positions.shape[1]
    low, high = body.points.min(axis=0), body.points.max(axis=0)
    inner = np.minimum(body.points - low, high - body.points).min(axis=1) > 0.5 * body.spacing
    columns = (d * np.flatnonzero(inner)[:, None] + np.arange(d)).ravel()
    return (force.tangent(positions) @ np.eye(positions.size)[:, columns])[columns]


def resistance(subject, body, F):
    """Return the least stiffness against any displacement of the inner points in a homogeneous
    state, divided by that of an undeformed continuum of the body's length L.

    The continuum held at its boundary has d pi^2 mu V/L^2, for a mode with half a wave along each
    of d axes, with the shear modulus mu and the volume V of a point.
    """
    A, length = tangent(subject.bind(body), body.points @ F.T), np.ptp(body.points[:, 0])
    continuum = len(F) * np.pi**2 * subject.law.shear_modulus * body.volumes[0] / length**2
    return float(np.linalg.eigvalsh((A + A.T) / 2)[0] / continuum)


def resisting(found, least, figure="{:.2g} ({})"):
    """Return the least of some resistances as text, or raise `Weak` if it is too small."""
    name = min(found, key=found.get)
    text = figure.format(found[name], name)
    if not found[name] >= least:
        raise Weak(text, "zero-energy modes" if found[name] > -least else "loses stability")
    return text


CELLS = 12, 7
"""Points a side of the bodies whose tangents are computed, in the plane and in three dimensions:
some points in the middle have full horizons, and so have their neighbors.
"""


def states(subject):
    """Return by name the deformation gradients of the homogeneous states in which tangents are
    computed.
    """
    found = {f"uniaxial {stretch:g}": subject.uniaxial(stretch) for stretch in (2.0, 3.0, 0.7)}
    others = {"rest": [[1, 0], [0, 1]], "shear 0.8": [[1, 0.8], [0, 1]]}
    others |= {"equibiaxial 2": [[2, 0], [0, 2]]}
    return found | {name: subject.gradient(np.array(F, float)) for name, F in others.items()}


def least_eigenvalue(subject):
    """Neo-Hookean rubber resists every wave in every state at least as at rest, and a horizon of
    three spacings lowers the stiffness of a mode on a body eleven spacings long by up to half, as
    one of 1.75 does on one six spacings long; hence a quarter.
    """
    body = subject.body(*CELLS)
    return resisting(
        {name: resistance(subject, body, F) for name, F in states(subject).items()}, 0.25
    )


def symmetry(subject):
    """The force is the gradient of an energy if |A - A^T|/|A| of its tangent A vanishes; rounding
    leaves 1e-9.
    """
    force, found = subject.bind(subject.body(*CELLS)), {}
    for name, F in states(subject).items():
        A = tangent(force, force.body.points @ F.T)
        found[name] = np.linalg.norm(A - A.T, 2) / np.linalg.norm(A, 2)
    name = max(found, key=found.get)
    return at_most(found[name], 1e-6, "not conservative", f"{{:.1e}} ({name})")


MOST_ERROR = 1e-3
"""Greatest relative error of a stress with which a case passes: a third of the repeatability of
the best experiments on rubber.
"""


def accurate(subject, error, figure="{:.1e}"):
    """Return an error as text, or raise `Weak` with the reason for which the model is less
    accurate than the analytic bond force.
    """
    blind = isinstance(subject.model, ForceSurrogate) and not subject.model.gives_transverse
    known = {"ba-nosb": "weights do not add up", "nosb": "zero-energy modes"}
    other = "no transverse stress" if blind else "accuracy"
    return at_most(error, MOST_ERROR, known.get(subject.model.name, other), figure)


def stress_error(subject, stretches, law, square=False):
    """Return the greatest relative error of the nominal stress at some stretches of a sheet or
    block, or of a square or cube, between rollers.
    """
    sizes = ([1.0, 1.0], [0.6, 0.6, 0.6]) if square else ([3.0, 1.0], [1.0, 0.4, 0.4])
    shape = {"shape": subject.sized("rectangle", "box"), "size": subject.sized(*sizes)}
    changes = {"spacing": SPACING, "body": shape, "plane": subject.plane}
    changes |= {"horizon_ratio": HORIZONS[subject.dimension], "solver.most_evaluations": 20000}
    # Where a law stiffens, single precision rounds stresses of a hundred mu by more than 1e-6
    # mu/dx.
    changes |= subject.sized({"precision": "float64"}, {})
    scene = pds.load_scene("uniaxial", changes, stretches=stretches, material=law.describe())
    levels = subject.solve(scene, "stops ", unstable="").levels
    exact = [homogeneous.uniaxial(law, level["stretch"]).nominal_stress for level in levels]
    return max(
        abs(level["nominal_stress"] / stress - 1)
        for level, stress in zip(levels, exact, strict=True)
    )


def stretch(subject):
    """Outside their domain surrogates use the exact force, so their error is no larger there."""
    return accurate(subject, stress_error(subject, [4.0, 5.0, 8.0], subject.law))


def compression(subject):
    """The exact state of the square is unstable below 0.53: a model with an energy stops there."""
    return accurate(subject, stress_error(subject, [0.7, 0.5], subject.law, square=True))


def compressibility(subject):
    """At K/mu = 10, 100, 10^3 and, in the plane, 10^4."""
    errors = {}
    for ratio in subject.sized((1e1, 1e2, 1e3, 1e4), (1e1, 1e2, 1e3)):
        law = replace(subject.law, bulk_modulus=ratio * subject.law.shear_modulus)
        required(subject.describes(law), "fitted to one bulk modulus")
        errors[ratio] = stress_error(subject, [2.0], law)
    worst = max(errors, key=errors.get)
    return accurate(subject, errors[worst], f"{{:.1e}} (K/mu = {worst:g})")


def beyond_the_domain(subject):
    """At twice the greatest stretch of the domain, or where the law has no such state at 1.5 or 1.2
    times it, forces are exact; the work on the path there, by Gauss's rule on 200 intervals, equals
    the stored energy, which a jump by the error of the fit would exceed.
    """
    model = subject.model
    learned = isinstance(model, ForceSurrogate | LearnedEnergy) and model.domain is not None
    required(learned, "no training domain")
    body = subject.body(8, 5)
    force = subject.bind(body)
    exact = subject.bind(
        body,
        model=FORCES["bond-energy" if force.has_energy else "analytic"](),
        correction=None if force.has_energy else force.correction,
    )

    def at(stretch):
        sides = [stretch, *[stretch**-0.5] * (subject.dimension - 1)]
        return (body.points + 0.02 * (wavy(body.points) - body.points)) * sides

    for share in (2.0, 1.5, 1.2):
        greatest = share * model.domain.greatest_stretch
        # A law with a limit may have no state there.
        with suppress(InvalidState):
            expected = forces_at(exact, at(greatest))
            break

    def power(stretch):
        velocity = (at(stretch + 1e-6) - at(stretch - 1e-6)) / 2e-6
        return float((forces_at(force, at(stretch)) * velocity).sum())

    off = float(np.abs(forces_at(force, at(greatest)) - expected).max() / np.abs(expected).max())
    figure = at_most(off, 1e-9, "accuracy", "{:.0e} from the exact force")
    if not force.has_energy:
        return figure
    stored = force.energy()
    forces_at(force, at(1.0))
    stored -= force.energy()
    ends = np.exp(np.linspace(0, np.log(greatest), 201))
    work = -sum(fixed_quad(np.vectorize(power), low, high, n=3)[0] for low, high in pairwise(ends))
    return at_most(abs(work / stored - 1), 1e-7, "accuracy", f"{figure}, work within {{:.0e}}")


def patches(subject, make):
    """Mean stress, against the greatest component of the exact stress, and resistance at uniaxial
    stretch 2 in three bodies that `make` draws at random, whose horizons are asymmetric.
    """
    F, bodies = subject.uniaxial(2.0), [make(np.random.default_rng(seed)) for seed in range(3)]
    exact = subject.exact_stress(F)
    off = [np.abs(mean_stress_at(subject.bind(body), F) - exact).max() for body in bodies]
    error, least = max(off) / np.abs(exact).max(), [resistance(subject, body, F) for body in bodies]
    figure = resisting(dict(enumerate(least)), 0.1, f"{error:.1e}, resistance {{:.2g}}")
    return accurate(subject, error, figure)


def jitter(subject):
    """Of regular points."""
    points = subject.body(10, 6).points
    return patches(
        subject,
        lambda random: of_points(points + 0.3 * SPACING * random.uniform(-1, 1, points.shape)),
    )


def mesh(subject):
    """Of irregular triangles or tetrahedra."""
    cells = subject.sized(8, 4)
    return patches(subject, partial(of_simplices, dimension=subject.dimension, cells=cells))


RATIOS = (2.015, 3.015, 3.15, 4.0, 6.0), (1.5, 1.75, 2.015, 2.5, 3.015)
"""Tested horizons in spacings, in the plane and in three dimensions: from the shortest whose bonds
span all directions to the largest in use.
"""


def horizons(subject):
    """Edges cut the longest horizons of nearly all points; hence a tenth."""
    F, bodies = subject.uniaxial(2.0), partial(subject.body, *CELLS)
    found = {
        f"{ratio:g} dx": resistance(subject, bodies(ratio), F) for ratio in subject.sized(*RATIOS)
    }
    return resisting(found, 0.1)


def notch_tip(subject):
    """Root mean square of the part of the displacements that alternates from point to point along
    all axes, over the greatest displacement: the field near a tip gives a few thousandths, a
    zero-energy mode tenths.
    """
    d, notch = subject.dimension, 3
    counts = subject.sized((20, 20), (12, 12, 4))
    cells, size = counts[0], counts[0] * SPACING
    planes = tuple(
        ReflectionPlane(1, place, side, (-1,) * d) for place, side in ((0.0, -1), (size, 1))
    )
    body = subject.body(counts, counts, planes=planes, separates=crack(size / 2, notch * SPACING))
    force, positions, reached = subject.bind(body), body.points.copy(), 1.0
    for target in (1.25, 1.5, 1.75, 2.0):
        positions[:, 1] *= target / reached
        force.move_plane(1, (target - 1) * size * np.eye(d)[1])
        try:
            method = Automatic(np.ones_like(positions), body.volumes, 1e-6, 20_000)
            method.solve(force, positions)
        except (InvalidState, NotConverged, Diverging) as error:
            raise Weak(f"stretch {target:g}", "does not converge") from error
        reached = target
    # x1 varies fastest in the order of the points.
    moved = (positions - body.points).reshape(*counts[::-1], d)
    rough = moved
    for axis in range(d):
        rough = np.diff(rough, 2, axis=axis) / 4
    # Differences across the notch, where the displacement jumps, are left out.
    rows = np.arange(1, cells - 1)
    smooth = np.ones((cells - 2, cells - 2), dtype=bool)
    smooth[np.ix_(np.abs(rows + 0.5 - cells / 2) < 2, rows <= notch + 1)] = False
    figure = np.sqrt((rough[..., smooth, :] ** 2).mean()) / np.abs(moved).max()
    return at_most(figure, 0.02, "zero-energy modes")


class Motion:
    """Explicit motion of a body of unit density by central differences, in steps of a part of the
    critical one, from given positions and small random velocities.

    A displacement component moves where `free`, shape (n, d), is 1.
    """

    def __init__(self, force, part=0.5, positions=None, free=None, damping=0.0):
        self.force, self.mass, self.damping = force, force.body.volumes, damping
        self.positions = force.body.points.copy() if positions is None else positions
        self.free = np.ones_like(self.positions) if free is None else free
        frequency = FrequencyEstimate(self.mass, self.free)(force, self.positions)
        self.step = part * 2 / np.sqrt(frequency)
        self.shake()

    def shake(self):
        """Set random velocities of a thousandth of the speed of shear waves."""
        random = np.random.default_rng(0).standard_normal(self.positions.shape)
        self.velocities = 1e-3 * np.sqrt(self.force.law.shear_modulus) * random * self.free

    @property
    def kinetic_energy(self):
        return float((self.mass[:, None] * self.velocities**2).sum() / 2)

    def advance(self, steps):
        scheme = self.free, self.mass, self.damping, self.step, self.step
        for _ in range(steps):
            forces = forces_at(self.force, self.positions)
            central_difference_step(self.positions, self.velocities, forces, *scheme)


def held(subject):
    """Return the motion of a body held at both ends at stretch 1.5, with half the critical step
    and the damping of `DampedExplicit`.
    """
    body = subject.body(8, (6, 4, 4))
    x1, free = body.points[:, 0], np.ones_like(body.points)
    free[np.abs(x1 - x1.mean()) > np.ptp(x1) / 2 - 1e-9] = 0
    damping = 2 * np.pi / (np.ptp(x1) + SPACING) * np.sqrt(3 * subject.law.shear_modulus)
    return Motion(subject.bind(body), 0.5, body.points @ subject.uniaxial(1.5).T, free, damping)


def damped_steps(subject):
    """Kinetic energy at the end over that at the start: velocities fall from 1e-3 to 1e-13 times
    the speed of waves, where rounding is.
    """
    motion = held(subject)
    first = motion.kinetic_energy
    try:
        motion.advance(subject.steps)
    except InvalidState as error:
        raise Weak(str(error), "loses stability") from error
    return at_most(motion.kinetic_energy / first, 1e-16, "loses stability")


def undamped_steps(subject):
    """Mean kinetic energy in the last tenth of the steps over that in the first: 1 within the
    scatter of some hundred modes, among which small waves share their energy evenly.
    """
    motion, pieces, energies = held(subject), 100, []
    motion.advance(2000)
    motion.damping = 0.0
    motion.shake()
    for _ in range(pieces):
        try:
            motion.advance(subject.steps // pieces)
        except InvalidState as error:
            within = (len(energies) + 1) * subject.steps // pieces
            raise Weak(f"within {within} steps", "not conservative") from error
        energies.append(motion.kinetic_energy)
    growth = np.mean(energies[-pieces // 10 :]) / np.mean(energies[: pieces // 10])
    return at_most(growth, 1.2, "not conservative", "{:.3g}")


SOFT, MOVED = 0.4, 1e-3
"""Thickness of the soft layer, of four points, in the middle of a body of height 1; and
displacement of the top, small enough for linear elasticity to be exact to 0.1 %.
"""


def layered(subject, direction, still, contrasts):
    """Error of the force on a layered body whose top moves along an axis and whose sides roll, so
    that every layer is homogeneous and the exact force is that of springs in series.

    The stiff parts have K = 2 mu, unless the model is fitted to one ratio of the moduli.
    """
    alone = f"takes bodies of one material only{WHERE[subject.plane]}"
    required(subject.plane in subject.model.several_materials, alone)
    d, width, across = subject.dimension, 0.4, f"x{2 - direction}"
    sides = [("left", across), ("right", across), ("back", "x3"), ("front", "x3")][: 2 * (d - 1)]
    top = {"region": "top", **still, f"x{1 + direction}": MOVED}
    prescribed = [{"region": "bottom", **still}, top]
    prescribed += [{"region": face, component: 0.0} for face, component in sides]
    low, high = np.tile([[-1.0], [2.0]], (2, 1, d))
    low[1, 1], high[0, 1] = (1 - SOFT) / 2, (1 + SOFT) / 2
    F, errors = np.eye(d), {}
    F[direction, 1] += 1e-6
    for ratio in contrasts:
        alike = subject.law.scaled(ratio)
        stiff = replace(alike, bulk_modulus=2 * alike.shear_modulus)
        stiff = stiff if subject.describes(stiff) else alike
        parts = [
            {"region": {"box": box.tolist()}, "material": stiff.describe()} for box in (low, high)
        ]
        loading = {"prescribed": prescribed, "steps": [1.0], "solver": {"most_evaluations": 1500}}
        scene = subject.scene((width, 1.0, width), spacing=SOFT / 4, materials=parts, **loading)
        why = "zero-energy modes" if subject.model.name == "nosb" else "does not converge"
        run = subject.solve(scene, f"{ratio:g} times: ", why)
        soft, hard = (
            PLANES[subject.plane].first_piola_stress(law, F)[direction, 1] / 1e-6
            for law in (subject.law, stiff)
        )
        expected = MOVED / (SOFT / soft + (1 - SOFT) / hard) * width ** (d - 1)
        errors[ratio] = run.levels[-1]["forces"]["top"][direction] / expected - 1
    worst = max(errors, key=lambda ratio: abs(errors[ratio]))
    figure = f"{100 * errors[worst]:+.2g} % ({worst:g} times)"
    return at_most(abs(errors[worst]), 0.05, "stiff contrasts", figure)


def sheared_layer(subject):
    """Between parts as stiff as a stiffer rubber, plastic and steel."""
    still = dict.fromkeys(("x1", "x2", "x3")[: subject.dimension], 0.0)
    return layered(subject, 0, still, (1e1, 1e3, 1e5))


def confined_layer(subject):
    """Rollers on the sides keep the width of the body constant."""
    return layered(subject, 1, {"x2": 0.0}, (1e1, 1e5))


TESTED = (
    least_eigenvalue,
    symmetry,
    stretch,
    compression,
    compressibility,
    beyond_the_domain,
    jitter,
    mesh,
    horizons,
    notch_tip,
    damped_steps,
    undamped_steps,
    sheared_layer,
    confined_layer,
)
CASES = {case: LISTED["hard cases"][case.__name__] for case in TESTED}
"""Functions of a `Tested` that return their figure or raise `Weak`, with title and requirement."""


def all_models(plane):
    """Return the names of all force models that support a plane; an artifact without a version
    stands for its newest version.
    """
    found = dict.fromkeys(folder.parent.name for folder in list_artifacts())
    return [name for name in (*FORCES, *found) if plane in load_surrogate(name).honors["plane"]]


def outcome(case, subject):
    """Return the figure of a case for a force model, and its weakness or ""."""
    try:
        # BLAS threads would spin on the cores that the kernels need.
        with threadpool_limits(1, user_api="blas"):
            return case(subject), ""
    except Weak as weak:
        return weak.args
    except DoesNotApply as reason:
        return f"- ({reason})", ""


def measured(case, model, plane):
    yield outcome(case, under_test(model, plane))


def table(plane, figures):
    """Table of all cases of a plane, a column for each model, and explanations of the weaknesses
    in it.
    """
    rows, met, models = [], set(), all_models(plane)
    for case, titles in CASES.items():
        cells = [figures.get(f"{plane}, {name}, {case.__name__}", [["", ""]])[0] for name in models]
        met |= {weakness for _, weakness in cells}
        rows.append(
            [*titles, *(f"**weak** {text}: {weak}" if weak else text for text, weak in cells)]
        )
    meanings = [f"- *{name}*: {what}." for name, what in WEAKNESSES.items() if name in met]
    text = markdown_table(["case", "asked", *models], rows)
    return "\n".join([text, "", *meanings])


if __name__ == "__main__":
    cases = {
        f"{plane}, {model}, {case.__name__}": partial(measured, case, model, plane)
        for plane in ("stress", "space")
        for model in all_models(plane)
        for case in CASES
    }
    tables = {f"hard-cases-{plane}": partial(table, plane) for plane in ("stress", "space")}
    report(__doc__, Study("hard-cases", cases, tables))
