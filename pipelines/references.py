"""Loads, solids and bodies in plane strain against finite elements and exact solutions, at several
spacings.

python pipelines/references.py                  all cases (hours at the finest spacings)
python pipelines/references.py loading cube     those of a group, or with such a word in their names
python pipelines/references.py --docs           puts the tables of the stored figures into the pages

References are finite elements: in the plane nine-node quadrilaterals on graded meshes, three-field
in plane strain, which change by 0.02 % or less in the last refinement (0.15 % for the pressed
block); in space those of `data/solid_fields.json`, by 0.05 % or less (the axial force of the
torsion by 0.11 %). For the ring and the sphere they are the radial equation of equilibrium.
"""

import json
import tomllib
from functools import cache
from pathlib import Path

import numpy as np
from boundaries import inflated
from cases import Case, at_spacings, percent, report, scene_of
from scipy.interpolate import RegularGridInterpolator

import pdsurrogate as pds
from pdsurrogate.scenes.reading import leaves

FOLDER = Path(__file__).parent / "data"
DATA = json.loads((FOLDER / "solid_fields.json").read_text())


@cache
def ran(scene, changes, spacing, force):
    """A run of a built-in scene with changes as JSON, which several cases share; of one that
    fails, what it has reached.
    """
    try:
        return pds.simulate(
            pds.load_scene(scene, {**json.loads(changes), "spacing": spacing}), force
        )
    except pds.SimulationFailed as error:
        print(error)
        return error.result


def loaded(scene, level, expected, changes=None, force=None, spacings=(0.08, 0.04, 0.02667, 0.02)):
    """A built-in scene, of which quantities at one output are read: by name, their places in the
    output and their values by the reference.
    """

    def measure(spacing):
        result = ran(scene, json.dumps(changes or {}), spacing, force)
        if level < len(result.levels):
            found = numbers_of(result.levels[level])
            for name, (place, value) in expected.items():
                yield name, percent(found[place], value), result.summary["n_force_evaluations"]

    return Case(measure, tuple(spacings))


def numbers_of(level):
    """Numbers of an output by dotted keys, with the mean radial displacements of a ring."""
    found = dict(leaves(level))
    for name in {"inner", "outer"} & level.get("probes", {}).keys():
        along, diagonal = (
            level["probes"][probe]["displacement"] for probe in (name, f"{name}-diagonal")
        )
        found[name] = (along[0] + (diagonal[0] + diagonal[1]) / np.sqrt(2)) / 2
    return found


LOADING = {
    name: loaded(**case)
    for name, case in tomllib.loads((FOLDER / "loading.toml").read_text("utf-8")).items()
}

EDGE = 3
"""Points at surfaces that are left out of the figures of the pressure, which is singular at
bonded edges; of 8 a side one.
"""


def of_result(run, read, *points):
    """A run by spacing, of which errors are read; `points` are numbers a side of 1."""

    def measure(spacing):
        result = run(spacing)
        for name, error in read(result).items():
            yield name, error, result.summary["n_force_evaluations"]

    return Case(measure, tuple(1 / one for one in points or (8, 16, 24, 32)))


def bonded(name, length, bulk_modulus, stretch):
    """A block between bonded plates: an eighth of it, between planes of symmetry."""

    def run(spacing):
        changes = {
            "spacing": spacing,
            "body.size.0": length / 2,
            "material.bulk_modulus": bulk_modulus,
            "prescribed.1.x1": (stretch - 1) * length / 2,
            "steps.0.largest_increment": min(1.0, 0.1 / abs(stretch - 1)),
        }
        return pds.simulate(scene_of("bonded-eighth", changes))

    def read(result):
        reference, points = DATA[name], round(1 / result.scene.spacing)
        cells = round(length * points / 2), points // 2, points // 2
        body, fields = result.body, result.states[-1][1]
        order = np.lexsort(body.points.T[::-1])
        places, moved = body.points[order], fields["displacement"][order]
        expected = field_of(reference, "x", "u", 3)(places)
        expected[:, 0] += (stretch - 1) * length / 2
        side = reference["lateral_mid_face"]
        pressure = (
            np.trace(fields["cauchy_stress"].reshape(-1, 3, 3), axis1=1, axis2=2)[order].reshape(
                cells
            )
            / 3
        )
        exact = field_of(reference, "p", "p", 1)(places).reshape(cells)
        edge = EDGE if points > 12 else 1
        inner = np.s_[edge:, :-edge, :-edge]
        spread = exact[inner].std()
        return {
            "force": percent(4 * result.levels[-1]["forces"]["right"][0], reference["reaction"]),
            "side": percent(at_side(moved[:, 1].reshape(cells)), side),
            "field": 100 * np.sqrt(((moved - expected) ** 2).sum(axis=1).mean()) / abs(side),
            "pressure": 100 * np.sqrt(((pressure - exact)[inner] ** 2).mean()) / spread,
        }

    return of_result(run, read)


def field_of(reference, axes, values, components):
    """A field of a reference, as a function of places."""
    grid = [np.array(reference[f"{axes}{axis}"]) for axis in (1, 2, 3)]
    found = np.array(reference[values]).reshape(*(len(axis) for axis in grid), components)
    return RegularGridInterpolator(grid, found if components > 1 else found[..., 0], method="cubic")


def at_side(values):
    """Value in the middle of a side from those of an eighth: even across its planes of symmetry,
    a parabola to the surface.
    """
    line = (9 * values[-1] - values[-2]) / 8
    line = (9 * line[:, 0] - line[:, 1]) / 8
    return (15 * line[-1] - 10 * line[-2] + 3 * line[-3]) / 8


def read_torsion(result):
    """Errors of torque, axial force and displacements of the scene of the package."""
    reference, level = DATA["cube_torsion60_K100"], result.levels[-1]
    expected = field_of(reference, "x", "u", 3)(result.body.points)
    off = result.states[-1][1]["displacement"] - expected
    return {
        "torque": percent(level["moments"]["right"][0], reference["torque"]),
        "axial force": percent(level["forces"]["right"][0], reference["axial_force"]),
        "field": 100 * np.sqrt((off**2).sum(axis=1).mean() / (expected**2).sum(axis=1).mean()),
    }


def inflation(level):
    """The thick sphere of the package at one of its pressures."""

    def read(result):
        places, volumes, moved = (
            result.body.points,
            result.body.volumes,
            result.states[level][1]["displacement"],
        )
        radius = np.linalg.norm(places, axis=1)
        sphere, _ = inflated(0.25 * (level + 1), 0.5, 2, lambda along, across: across)
        expected = sphere(radius)[0] - radius
        outward = places / radius[:, None]
        found = (moved * outward).sum(axis=1)
        near = {"inner displacement": radius < 0.6, "outer displacement": radius > 0.9}
        errors = {
            name: percent(volumes[part] @ found[part], volumes[part] @ expected[part])
            for name, part in near.items()
        }
        apart = np.linalg.norm(moved - expected[:, None] * outward, axis=1)
        return errors | {"field": 100 * np.sqrt((apart**2).mean() / (expected**2).mean())}

    return of_result(packaged("inflation"), read, 8, 12, 16, 24, 32, 40, 48)


def packaged(name):
    """A run of a scene of the package, by spacing."""
    return lambda spacing: ran(name, json.dumps({"solver.tolerance": 1e-5}), spacing, None)


SOLID = {
    "bonded cube, 1.5, K = 100": bonded("cube_clamped_K100_l1.5", 1.0, 100.0, 1.5),
    "bonded cube, 1.5, K = 1000": bonded("cube_clamped_K1000_l1.5", 1.0, 1000.0, 1.5),
    "bonded cube, 0.9, K = 100": bonded("cube_clamped_K100_l0.9", 1.0, 100.0, 0.9),
    "bonded block 2 x 1 x 1, 1.5, K = 100": bonded("block2_clamped_K100_l1.5", 2.0, 100.0, 1.5),
    "torsion by 60 degrees": of_result(packaged("torsion"), read_torsion),
    "thick sphere, p = 0.25": inflation(0),
    "thick sphere, p = 0.5": inflation(1),
}


def pressed(model, bulk_modulus, stretch):
    """The bonded block in plane strain."""

    def run(spacing):
        changes = {
            "material.bulk_modulus": bulk_modulus,
            "spacing": spacing,
            "stretches": stretch,
            "solver.most_evaluations": 20_000,
        }
        return pds.simulate(pds.load_scene("plane-strain-block", changes), model)

    def read(result):
        level, bulge = result.levels[-1], "greatest_lateral_displacement_error"
        return {"force": 100 * level["nominal_stress_error"], "bulge": 100 * level[bulge]}

    return of_result(run, read, *(16, 24, 32), *([50] if model == "bond-energy" else []))


PLANE_STRAIN = {
    f"{model}, K = {bulk_modulus:g} mu, stretch {stretch:g}": pressed(model, bulk_modulus, stretch)
    for model in ("bond-energy", "analytic", "nosb")
    for bulk_modulus in (100.0, 1000.0)
    for stretch in (0.95, 1.3)
}

if __name__ == "__main__":
    groups = {"loading": LOADING, "solid": SOLID, "plane-strain": PLANE_STRAIN}
    report(__doc__, *(at_spacings(name, cases) for name, cases in groups.items()))
