"""What runs write, and the tables of the reference of results: all that is written is in them,
and all that is in them is written.
"""

import csv
import itertools
import json
import platform
import re
import warnings
from pathlib import Path

import meshio
import numba
import numpy as np
import pytest
import scipy
from refusals import raising

import pdsurrogate as pds
from pdsurrogate.results import vtk
from pdsurrogate.results.measures import POINT_FIELDS, PointField
from pdsurrogate.studies.table import KEYS_OF_LEVELS, KEYS_OF_RUNS

ROOT = Path(__file__).parents[2]
PAGE = (ROOT / "docs" / "reference" / "summary.md").read_text()

BY_NAME = (
    "forces",
    "moments",
    "displacements",
    "probes",
    "rigid",
    "held_at_points",
    "grip_areas",
    "units",
    "material",
    "digests",
    "scene_as_run",
    "region",
    "machine",
)
"""Keys of the summary whose own keys are names of the scene's, of a law or of the machine."""

UNITS = {"length": "cm", "stress": "kPa", "time": "s"}

TEAR = {
    "spacing": 0.25,
    "stretches": [1.1, 1.2],
    "fracture.critical_stretch": 2.0,
    "dynamics.stretch": 1.6,
    "dynamics.outputs": 4,
    "dynamics.stretch_rate": 40.0,
}

SLOW = {**TEAR, "fracture.process": "quasi-static"}

RELAXING = {
    "spacing": 0.25,
    "stretches": 1.5,
    "times": 2.0,
    "material.branches": [{"modulus": 1.0, "time": 1.0}],
}


def _program() -> pds.Scene:
    """Two materials, a load, a probe, an obstacle, equilibrium and viscous dynamics."""
    stiff = {"law": "neo-hookean", "shear_modulus": 2.0, "bulk_modulus": 200.0}
    dynamics = {"duration": 0.5, "density": 1.0, "damping": 1.0, "viscosity": 1e-3}
    return pds.Scene(
        name="program",
        spacing=0.1,
        units=UNITS,
        body=pds.shapes.Rectangle(size=(1.0, 0.4)),
        material="neo-hookean",
        materials=({"region": {"box": ((0.5, 0.0), (1.0, 0.4))}, "material": stiff},),
        prescribed=({"region": "left", "x1": 0.0, "x2": 0.0},),
        loads=({"region": "right", "traction": (0.0, -0.05)},),
        probes=({"name": "tip", "at": (0.9, 0.2)},),
        obstacles=({"half_plane": {"point": (0.0, -0.1), "normal": (0.0, -1.0)}, "name": "floor"},),
        steps=(0.5, {"to": 1.0, "outputs": 2, "dynamics": dynamics}),
    )


def _in_space() -> pds.Scene:
    held, pulled = (
        {"region": "left", "x1": 0.0, "x2": 0.0, "x3": 0.0},
        {
            "region": "right",
            "x1": 0.1,
            "x2": 0.0,
            "x3": 0.0,
        },
    )
    return pds.Scene(
        name="block",
        spacing=0.25,
        units=UNITS,
        body={"shape": "box", "size": (1.0, 1.0, 1.0)},
        material="neo-hookean",
        prescribed=(held, pulled),
        steps=(1.0,),
    )


def _pulled(material) -> pds.Scene:
    held, pulled = {"region": "left", "x1": 0.0, "x2": 0.0}, {"region": "right", "x1": 0.5}
    body = pds.shapes.Rectangle(size=(1.0, 0.5))
    return pds.Scene(
        name="pulled",
        spacing=0.125,
        units=UNITS,
        body=body,
        material=material,
        prescribed=(held, pulled),
        steps=(1.0,),
    )


def _far() -> pds.Scene:
    """A strip that its load bends so far that increments are shortened, and lengthened again."""
    return pds.Scene(
        name="far",
        spacing=0.1,
        units=UNITS,
        body=pds.shapes.Rectangle(size=(1.0, 0.3)),
        material="neo-hookean",
        prescribed=({"region": "left", "x1": 0.0, "x2": 0.0},),
        loads=({"region": "right", "traction": (0.0, 0.3)},),
        steps=(1.0,),
    )


def _tested(folder: Path) -> Path:
    """A surrogate of an energy from test data."""
    data = pds.load_test_data("treloar").up_to(3.0)
    energy = pds.identification.EnergyRegressor().fit(data.stretches, data.nominal_stress)
    samples = pds.training_samples(energy.law_, 1500, (0.5, 3.0), random_state=0)
    samples.design["hull"] = energy.domain_hull()
    regressor = pds.learning.ChebyshevRegressor((10, 5))
    model = pds.surrogate_pipeline(regressor, features="isochoric").fit(samples.X, samples.y)
    return pds.store(model, samples, energy.law_, folder, "tested", "1", "a test")


def _plate() -> pds.Scene:
    """A block under a rigid plate that is pulled."""
    return pds.Scene(
        name="plated",
        spacing=0.1,
        units=UNITS,
        body=pds.shapes.Rectangle(size=(0.6, 0.6)),
        material={"law": "neo-hookean", "bulk_modulus": 5.0},
        regions={"plate": {"box": ((0.0, 0.4), (0.6, 0.6))}},
        materials=({"region": "plate", "material": "rigid"},),
        prescribed=({"region": "bottom", "x1": 0.0, "x2": 0.0},),
        loads=({"region": "top", "traction": (0.0, 0.02)},),
        steps=(1.0,),
    )


@pytest.fixture(scope="module")
def folders(tmp_path_factory):
    """Folders of the results of small runs of every kind, by name."""
    place = tmp_path_factory.mktemp("runs")
    with warnings.catch_warnings():
        warnings.simplefilter("ignore")
        tested = _tested(place / "artifacts")
        law = pds.load_card(tested).material.trained_with
        runs = {
            "plane": (pds.load_scene("uniaxial", spacing=0.25, stretches=1.5), "neo-hookean"),
            "pushed": (pds.load_scene("uniaxial", spacing=0.25, stretches=0.98), "bond-energy"),
            "tested": (
                pds.load_scene("uniaxial", spacing=0.25, stretches=2.0, material=law),
                tested,
            ),
            "pulled": (_pulled(law), tested),
            "relaxing": (pds.load_scene("uniaxial", RELAXING), "bond-energy"),
            "program": (_program(), "bond-energy"),
            "far": (_far(), "bond-energy"),
            "tear": (pds.load_scene("tear", TEAR), "bond-energy"),
            "slow": (pds.load_scene("tear", SLOW), "bond-energy"),
            "space": (_in_space(), "bond-energy"),
            "plated": (_plate(), "bond-energy"),
            "turned": (
                pds.load_scene(
                    "disc-torsion", {"spacing": 0.2, "holes.0.radius": 0.35, "steps": [0.1]}
                ),
                "nosb",
            ),
        }
        for name, (scene, force) in runs.items():
            pds.simulate(scene, force, folder=place / name)
    return {name: place / name for name in runs}


def table_under(header: str) -> dict[str, tuple[str, str]]:
    """Names in the first column of a table of the page, with the cell of their unit and the
    comment that names their tests.
    """
    text = PAGE.split(f"\n| {header} |", 1)[1].split("\n\n", 1)[0]
    found = {}
    for line in text.splitlines()[2:]:
        names, *_, unit, meaning = (cell.strip() for cell in line.strip("|").split("|"))
        found |= dict.fromkeys(
            re.findall(r"`([^`]+)`", names), (unit, re.search(r"<!-- (.*) -->$", meaning)[1])
        )
    return found


def columns_of(folders, file: str) -> dict[str, str | None]:
    """Columns of a table of all runs, names of the scene's in them replaced, with their units."""
    found = {}
    for path in folders.values():
        if not (path / file).exists():
            continue
        with (path / file).open(encoding="utf-8", newline="") as lines:
            for title in next(csv.reader(lines)):
                column, _, unit = title.removesuffix("]").partition(" [")
                kinds = "force|moment|displacement|contact_area|contact_penetration"
                of_name = rf"^({kinds})_[a-z]+(_rigid)?(_\d)?$"
                column = re.sub(
                    of_name, lambda m: f"{m[1]}_NAME{m[2] or ''}{'_I' if m[3] else ''}", column
                )
                found[re.sub(r"^[a-z]+_displacement_\d$", "PROBE_displacement_I", column)] = (
                    unit or None
                )
    return found


def keys_of(value: dict, prefix: str = "") -> set[str]:
    """Keys of a summary, with those of tables in it behind a dot."""
    found = set()
    for key, inner in value.items():
        rows = [
            row for row in (inner if isinstance(inner, list) else [inner]) if isinstance(row, dict)
        ]
        if rows and key not in BY_NAME and not prefix:
            found |= set().union(*(keys_of(row, f"{key}.") for row in rows))
        else:
            found.add(prefix + key)
    return found


def test_every_column_of_the_history_is_in_its_table(folders):
    written = columns_of(folders, "history.csv")
    described = table_under("column")
    assert set(written) == set(described) - {
        "moment_NAME_rigid_I"
    }  # the rigid region is in the plane
    # Of bodies in the plane forces, areas and energies are those per thickness.
    names = {
        "cm": ("length", "area"),
        "cm^2": ("area",),
        "kPa": ("stress",),
        "s": ("time",),
        "kPa cm": ("force",),
        "kPa cm^2": ("force", "energy"),
        "kPa cm^3": ("energy",),
        "mm": ("length", "area"),
        "MPa": ("stress",),
        None: ("",),
    }
    assert {
        column for column, unit in written.items() if described[column][0] not in names[unit]
    } == set()


def test_every_column_of_the_convergence_is_in_its_table(folders):
    assert set(columns_of(folders, "convergence.csv")) == set(
        table_under("column of the convergence")
    )


OF_TORN_MATERIALS = (
    "materials.critical_stretch",
    "interfaces.between",
    "interfaces.critical_stretch",
    "strength",
)


def test_every_key_of_the_summary_is_in_its_table(folders):
    summaries = [json.loads((path / "summary.json").read_text()) for path in folders.values()]
    assert set().union(*map(keys_of, summaries)) - {
        f"levels.{key}" for key in table_under("key in `levels`")
    } - {"levels"} == set(table_under("key of `summary.json`")) - {
        "levels",
        "ranks",
    } - set(OF_TORN_MATERIALS)  # of several ranks, and of fracture with strengths or materials
    levels = set().union(*(level for summary in summaries for level in summary["levels"]))
    assert levels == set(table_under("key in `levels`"))


def test_studies_take_every_key_as_a_quantity():
    assert {key.partition(".")[0] for key in table_under("key of `summary.json`")} == set(
        KEYS_OF_RUNS
    )
    assert set(table_under("key in `levels`")) == set(KEYS_OF_LEVELS)


def test_every_field_of_a_state_is_in_its_table(folders):
    """Of every state of every run, on cells and on nodes, and the single values beside them."""
    states = [path for folder in folders.values() for path in folder.glob("*.vtu")]
    read = [meshio.read(path) for path in states]
    assert (
        set().union(*(mesh.cell_data for mesh in read))
        == set(table_under("field"))
        == set(POINT_FIELDS)
    )
    assert {name for mesh in read for name in mesh.point_data} == {"displacement"}
    beside = PAGE.split("Files of states also hold", 1)[1].split("\n\n", 1)[0]
    values = set().union(*(vtk.read_values(path) for path in states))
    assert values | {"displacement", "number"} == set(re.findall(r"`(\w+)`", beside))


def test_what_is_said_to_be_tested_is_named_in_the_test():
    for header in (
        "field",
        "column",
        "column of the convergence",
        "key of `summary.json`",
        "key in `levels`",
    ):
        for name, (_, tests) in table_under(header).items():
            files = tests.split()
            # A name with the scene's own in it by the rest of it; references and errors by the
            # quantity.
            word = re.sub(
                r"^PROBE_|(_NAME)?(_rigid)?(_I)?$|_(reference|error)$", "", name.rpartition(".")[2]
            )
            assert files, name
            assert any(re.search(rf"\b{word}", (ROOT / file).read_text()) for file in files), (
                f"{name} is not tested in {tests}"
            )


def test_points_without_support_and_bonds_are_those_of_the_history(folders):
    """Of a tear: what the summary says of its end is what the last row says, and a body that is
    whole has none of it.
    """
    torn, whole = (pds.load_result(folders[name]) for name in ("tear", "plane"))
    last = torn.history[-1]
    assert torn.summary["unsupported_points"] == last["free_points"]
    assert torn.summary["crack"]["broken_bonds"] == last["broken_bonds"] > 0
    assert 0 <= torn.summary["crack"]["failed_points"] <= torn.summary["n_points"]
    assert whole.summary["unsupported_points"] == 0
    assert whole.summary["support"] == "reflected"
    assert whole.summary["precision"] == "float32"
    assert whole.summary["thickness"] == 1
    assert whole.summary["horizon"] == pytest.approx(3.15 * 0.25)
    # All bonds of the cut and broken ones are lost where damage is 1.
    assert torn.summary["unsupported_points"] >= np.count_nonzero(torn.field("damage") == 1)


def test_energy_beside_the_residual_is_that_of_the_output(folders):
    result = pds.load_result(folders["pushed"])
    assert result.convergence[-1]["energy"] == pytest.approx(result.levels[-1]["energy"], rel=1e-6)


def test_increments_that_change_say_why(folders):
    rows = pds.load_result(folders["far"]).convergence
    assert any("failure" in row for row in rows)
    assert any("increments of" in row.get("reason", "") for row in rows)


def test_what_is_beyond_the_data_has_its_state(folders):
    """One row for every recorded state, as that states itself."""
    result = pds.load_result(folders["tested"])
    for row, moment in itertools.zip_longest(result.summary["beyond_data"], result.states.moments):
        assert (row["run_time"], row["stretch"]) == (moment.run_time, moment.stretch)


@pytest.mark.parametrize(
    "quantity", ["nominal_stress", "lateral_displacement", "greatest_lateral_displacement"]
)
def test_errors_are_those_against_the_reference(folders, quantity):
    (level,) = pds.load_result(folders["plane"]).levels
    reference = level[f"{quantity}_reference"]
    assert level[f"{quantity}_error"] == pytest.approx(level[quantity] / reference - 1, abs=1e-12)
    exact = pds.materials.homogeneous.uniaxial(pds.materials.NeoHookean(), 1.5)
    assert reference == pytest.approx(
        exact.nominal_stress if quantity == "nominal_stress" else 0.5 * (1 - exact.lateral_stretch)
    )


def test_versions_are_those_of_what_runs(folders):
    found = pds.load_result(folders["plane"]).summary["provenance"]
    assert found["python"] == platform.python_version()
    assert [found[name] for name in ("version", "numpy", "scipy", "numba")] == [
        module.__version__ for module in (pds, np, scipy, numba)
    ]


def test_a_field_of_another_shape_is_named(monkeypatch):
    monkeypatch.setitem(POINT_FIELDS, "short", PointField(lambda state: np.ones(3)))
    with raising(r"the field short has values of shape \(3,\) at a state, not \(48,\)"):
        pds.simulate(pds.load_scene("uniaxial", {"spacing": 0.25, "stretches": [1.1]}), "analytic")
