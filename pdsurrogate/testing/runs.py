"""Properties of equilibria and motions that every force model must have: exact homogeneous
states, balance, units, resumed runs.
"""

import tempfile
import warnings
from collections.abc import Callable, Iterator
from contextlib import contextmanager, suppress
from functools import cache
from itertools import permutations, product
from pathlib import Path

import meshio
import numpy as np

from ..problem import compile_scene
from ..progress import listening
from ..run.levels import MOST_OFF
from ..scenes import Scene, load_scene
from .forces import tested
from .properties import Property, required
from .subject import FAILURES, Subject, force_densities, mean_stress_at, off

SIDES = ("left", "bottom", "back"), ("right", "top", "front")
"""Edges or faces of a box, by axis, at its lower and upper end."""

ARRANGEMENTS = ("lattice", "relaxed", "mesh")
"""Arrangements of points in which homogeneous states must be exact; a mesh consists of triangles
or tetrahedra.
"""


def write_mesh(path: Path, dimension: int, count: int) -> None:
    """Write a unit square or cube of `count` cells a side, each of two triangles or six
    tetrahedra that share a diagonal.
    """
    axes = np.meshgrid(*[np.arange(count + 1)] * dimension, indexing="ij")
    nodes = np.stack(axes, axis=-1).reshape(-1, dimension)
    number = np.arange((count + 1) ** dimension).reshape(axes[0].shape)
    corner = number[(slice(-1),) * dimension].ravel()
    strides = number.strides
    cells = []
    for path_of in permutations(range(dimension)):
        ends = corner[:, None] + np.cumsum(
            [0, *(strides[axis] // number.itemsize for axis in path_of)]
        )
        even = np.linalg.det(np.eye(dimension)[list(path_of)]) > 0
        cells.append(ends if even else ends[:, [1, 0, *range(2, dimension + 1)]])
    places = np.pad(nodes / count, ((0, 0), (0, 3 - dimension)))
    meshio.write(
        path,
        meshio.Mesh(places, [("triangle" if dimension == 2 else "tetra", np.concatenate(cells))]),
    )


@contextmanager
def _unit_body(subject: Subject, arrangement: str) -> Iterator[dict]:
    """Yield the keys of a scene with a unit square or cube in an arrangement of its points, in
    double precision.
    """
    d = subject.dimension
    count = subject.sized(8, 4)
    rollers = [{"region": side, f"x{axis + 1}": 0.0} for axis, side in enumerate(SIDES[0][:d])]
    keys = {
        "prescribed": rollers,
        "steps": [1.0],
        "precision": "float64",
        "solver": {"tolerance": 1e-8},
    }
    with tempfile.TemporaryDirectory() as folder:
        if arrangement == "mesh":
            file = Path(folder) / "cells.vtu"
            write_mesh(file, d, count)
            yield keys | {
                "spacing": None,
                "body": {"shape": "mesh", "file": str(file), **subject.sized({}, {"dimension": 3})},
            }
        else:
            body = {
                "shape": subject.sized("rectangle", "box"),
                "size": (1.0,) * d,
                "arrangement": arrangement,
            }
            yield keys | {"spacing": 1 / count, "body": body}


def _displaced(subject: Subject, arrangement: str, F: np.ndarray, loads: list[dict]) -> float:
    """Return the greatest error of the displacements of a loaded body, divided by the greatest
    displacement, if F is the exact state.
    """
    with _unit_body(subject, arrangement) as keys:
        result = subject.run(subject.scene((), **keys, loads=loads))
        exact = result.body.points @ (F - np.eye(len(F))).T
        return off(result.states[-1][1]["displacement"][:, : len(F)], exact)


def _swelling(subject: Subject) -> float:
    """Return a change of volume that needs a stress of half the shear modulus."""
    return 0.5 * subject.law.shear_modulus / subject.law.bulk_modulus


UNBALANCED = "it does not balance the loads on points beside boundaries"
"""Reason why homogeneous states under loads are not exact."""


def _response(subject: Subject, arrangement: str, F: np.ndarray) -> tuple[np.ndarray, float]:
    """Return the principal stresses, shape (d,), and the volume ratio of the model itself at a
    diagonal deformation gradient of a loaded body.

    They are those of the law but for the errors of a fit, which are no concern of these properties.
    """
    loads = [{"region": "right", "traction": np.eye(subject.dimension)[0].tolist()}]
    with _unit_body(subject, arrangement) as keys:
        body = compile_scene(subject.scene((), **keys, loads=loads)).body
    force = subject.bind(body)
    required(force.correction != "scalar", UNBALANCED)
    return np.diag(mean_stress_at(force, F)), float(force.volume_ratios().mean())


def _under_tractions(subject: Subject, arrangement: str) -> tuple[np.ndarray, list[dict]]:
    """Return a deformation gradient, and the tractions on all sides that it needs."""
    first, second = 1.2, 0.95
    last = (1 + _swelling(subject)) / first
    stretches = {"stress": (first, second), "strain": (first, last)}
    F = np.diag(stretches.get(subject.plane, (first, second, last / second)))
    sides = zip(SIDES[1], np.diag(_response(subject, arrangement, F)[0]).tolist(), strict=False)
    return F, [{"region": side, "traction": load} for side, load in sides]


def _under_pressure(subject: Subject, arrangement: str) -> tuple[np.ndarray, list[dict]]:
    """Return a deformation gradient, and the pressure on all sides that it needs."""
    d = subject.dimension
    stretch = 0.95 if subject.plane == "stress" else (1 - _swelling(subject)) ** (1 / d)
    F = stretch * np.eye(d)
    stress, J3 = _response(subject, arrangement, F)
    pressure = float(-stress[0] * stretch / J3)  # on sides of the deformed thickness
    return F, [{"region": side, "pressure": pressure} for side in SIDES[1][:d]]


def _homogeneous(kind: str, loaded: Callable, arrangement: str) -> Property:
    """Return the property that a kind of load on all sides makes a homogeneous state."""

    def measure(subject: Subject) -> float:
        return _displaced(subject, arrangement, *loaded(subject, arrangement))

    measure.__doc__ = (
        f"Return the relative error of the displacements of a square or cube under {kind} on all"
        f" sides ({arrangement})."
    )
    # The tolerance of the solver, and rounding.
    return Property(f"{kind}_on_{arrangement}", 1e-5, measure, FAILURES)


tractions_on_lattice, tractions_on_relaxed, tractions_on_mesh = (
    _homogeneous("tractions", _under_tractions, arrangement) for arrangement in ARRANGEMENTS
)
pressure_on_lattice, pressure_on_relaxed, pressure_on_mesh = (
    _homogeneous("pressure", _under_pressure, arrangement) for arrangement in ARRANGEMENTS
)


@tested(1e-9)
def cuts_that_touch(subject: Subject) -> float:
    """Return the greatest force, in mu/dx, if a body that two touching cuts divide along a kinked
    line opens there without deformation.

    The cuts, in a solid panels that share an edge, meet inside the body, and run towards each
    other.
    """
    d = subject.dimension
    corners = np.array([[-0.1, 0.38], [0.6, 0.5], [1.3, 0.83]])
    cuts: list[dict] = [
        {"start": start.tolist(), "end": end.tolist()}
        for start, end in (corners[[0, 1]], corners[[2, 1]])
    ]
    if d == 3:
        across = [0.0, 0.0, 3.0]
        cuts = [
            {
                "corner": [*cut["start"], -1.0],
                "sides": [[*np.subtract(cut["end"], cut["start"]), 0.0], across],
            }
            for cut in cuts
        ]
    held = [subject.held_at("bottom"), subject.held_at("top")]
    scene = subject.scene(
        (1.2, 1.0, 0.4), spacing=0.1, precuts=cuts, prescribed=held, support="points", steps=[1.0]
    )
    with warnings.catch_warnings(action="ignore"):  # of two pieces
        body = compile_scene(scene).body
    above = body.points[:, 1] > np.interp(body.points[:, 0], *corners.T)
    return np.abs(force_densities(subject.bind(body), body.points + 0.3 * above[:, None])).max()


OFF_BALANCE = 2e-3
"""Greatest permitted sum of loads and reactions, divided by the load.

The solver bounds this sum by 5e-4 of what drives the body, here the magnitudes of the reactions of
single points: at a clamped end these pull across as well, and their magnitudes add up to four times
the load at most.
"""

OFF_PROPORTION = 2e-3
"""Greatest permitted relative difference of two equilibria that should be equal, in displacements
or reactions; each may leave unbalanced forces of a thousandth of its load.
"""

LOADS = (1e-9, 1e-7, 1e-5, 1e-2, 1.0)
"""Tractions on the free end in shear moduli; under loads up to 1e-5, strains and departures from
linear elasticity are at most some 1e-5.
"""


def _loaded(
    subject: Subject,
    load: float,
    stress: float = 1.0,
    length: float = 1.0,
    amplitude: str | list = "ramp",
    **changes,
) -> Scene:
    """Return the scene of a body held at its left face, with a traction on its right face of `load`
    shear moduli that pulls, and bends a little.

    All moduli and the traction are multiplied by `stress`, all lengths by `length`, as by a change
    of units. `amplitude` is the course of the load in time, and `changes` are other keys of the
    scene.
    """
    law = subject.law.scaled(stress)
    size = load * stress * subject.law.shear_modulus
    loads = [
        {
            "region": "right",
            "traction": [size * part for part in (1.0, 0.1, 0.0)[: subject.dimension]],
            "amplitude": amplitude,
        }
    ]
    described = {
        "spacing": 0.2 * length,
        "material": law.describe(),
        "prescribed": [subject.held_at("left")],
        "steps": [1.0],
    }
    # Four to six points a side: few enough for runs under five loads and in four systems of units.
    return subject.scene(
        [length * side for side in subject.sized((1.2, 0.8), (1.0, 0.8, 0.8))],
        loads=loads,
        **described | changes,
    )


@cache
def _level(subject: Subject, load: float, stress: float = 1.0, length: float = 1.0) -> dict:
    """Return the last entry of ``levels`` of a run of the `_loaded` scene, computed only once
    for each subject, load and units.
    """
    return subject.run(_loaded(subject, load, stress, length)).levels[-1]


def _moved(level: dict) -> np.ndarray:
    return np.array(level["displacements"]["right"])


@tested(OFF_PROPORTION)
def small_loads(subject: Subject) -> float:
    """Return the greatest relative difference of compliances, displacement divided by load,
    under loads of 1e-9 to 1e-5 shear moduli.
    """
    over = np.array([_moved(_level(subject, load)) / load for load in LOADS[:3]])
    return off(over, over[-1])


@tested(OFF_BALANCE)
def force_balance(subject: Subject) -> tuple[float, str]:
    """Return the sum of load and reactions divided by the load, under loads of 1e-9 to 1 shear
    moduli.

    Twice the relative unbalanced force that the run itself reports (``force_balance``), whose own
    limit is half as large, counts too.
    """
    errors = {}
    for load in LOADS:
        level = _level(subject, load)
        right, left = (np.array(level["forces"][face]) for face in ("right", "left"))
        unbalanced = float(np.abs(right + left).sum() / np.abs(right).sum())
        errors[load] = np.max([unbalanced, OFF_BALANCE / MOST_OFF * level["force_balance"]])
    worst = max(errors, key=errors.__getitem__)
    return np.max(list(errors.values())), f"load {worst:g} mu"


@tested(OFF_PROPORTION)
def scale_of_units(subject: Subject) -> float:
    """Return the relative change of displacements and reactions under a load of 0.01 mu if units
    of stress and length are 1e-9 and 1e9.
    """
    expected = _level(subject, 1e-2)
    errors = []
    for stress, length in product((-9, 9), repeat=2):  # wider than any units in use
        level = _level(subject, 1e-2, 10.0**stress, 10.0**length)
        unit = 10.0**stress * (10.0**length) ** (subject.dimension - 1)
        errors.append(
            off(np.array(level["forces"]["left"]) / unit, np.array(expected["forces"]["left"]))
        )
        errors.append(off(_moved(level) / 10.0**length, _moved(expected)))
    return np.max(errors)


@tested(0.01)
def energy_account(subject: Subject) -> float:
    """Return the greatest gap in the account of energy under a sudden load of 0.1 mu, without
    damping, and with damping and viscosity.

    Shear waves have a speed of 1 in the units of the scene; in the duration of 4 they go along the
    body and back nearly twice in the plane, twice in a solid. A run warns of gaps above the
    tolerance.
    """
    required(subject.bind(compile_scene(_loaded(subject, 0.1)).body).has_energy, "has no energy")
    gaps = []
    sudden = [[0.0, 0.0], [1e-9, 1.0]]
    for losses in ({}, {"damping": 1.0, "viscosity": 0.02}):
        dynamics = {"duration": 4.0, "density": subject.law.shear_modulus, "safety": 0.5, **losses}
        steps = [{"to": 1.0, "outputs": 1, "dynamics": dynamics}]
        run = subject.run(_loaded(subject, 0.1, amplitude=sudden, precision="float64", steps=steps))
        gaps.append(abs(run.summary["dynamics"][0]["greatest_energy_gap"]) / 100)
    return np.max(gaps)


class _Killed(Exception):
    """Error that ends a run early, as if the process were killed."""


def _kill(stage: str, done: float, total: float, **numbers: float) -> None:
    """End a run by `_Killed` when the search for its second equilibrium begins."""
    if done == 1 and "residual" not in numbers:
        raise _Killed


@tested(0.0)
def resumed_run(subject: Subject) -> float:
    """Return the number of points that a run killed between two outputs and resumed leaves
    elsewhere than one without a break.
    """
    required(subject.plane != "space", "tested on sheets only")
    # The exact solution is not computed, since it costs more than the run for some laws.
    changes = {
        "spacing": 0.1,
        "body.size": [0.8, 0.8],
        "stretches": [1.05, 1.15],
        "solver.tolerance": 1e-4,
        "reference": None,
    }
    scene = load_scene(
        "uniaxial", changes | {"plane": subject.plane}, material=subject.law.describe()
    )
    whole = subject.run(scene)
    with tempfile.TemporaryDirectory() as name:
        with suppress(_Killed), listening(_kill):
            subject.run(scene, folder=Path(name))
        again = subject.run(scene, folder=Path(name), resume=True)
        return (again.displacement() != whole.displacement()).any(axis=1).sum()
