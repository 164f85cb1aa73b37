"""What may be asked of a force is answered by its protocol, and what solvers know of the whole
body by one object.
"""

import ast
from pathlib import Path

import numpy as np
import pytest
from bodies import sheet
from refusals import raising

import pdsurrogate as pds
from pdsurrogate.artifacts import load_surrogate
from pdsurrogate.forces import FORCES, ForceSettings, ForceSurrogate
from pdsurrogate.forces.compiled_force import CompiledBondForce
from pdsurrogate.materials import homogeneous, plane_stress
from pdsurrogate.ranks import Share
from pdsurrogate.results import measures
from pdsurrogate.scenes.model import Units
from pdsurrogate.testing.bodies import wavy

LAW = pds.materials.NeoHookean()
MODELS = [*FORCES, "neo-hookean", "neo-hookean-energy"]
ROOT = Path(__file__).parents[2]
FOREIGN = {
    "_replace",
    "_Unpickler",
    "_exit",
    "_repr_html_",
    "_getvalue",
    "_cache",
    "_defn",
    "_is_initialized",
    "_launch_threads",
    "_parameter_constraints",
    "_params",
    "_protected_args",
    "_symbols",
}
"""Private members of pickle, os, numba, click and scikit-learn for which these have no public
ones, and the name that notebooks ask for.
"""


def bound(name, body, **settings):
    return load_surrogate(name).bind(body, LAW, ForceSettings(precision="float64", **settings))


def test_private_members_are_read_by_their_own_class_alone():
    found = []
    for path in (
        path
        for folder in ("pdsurrogate", "tests", "pipelines")
        for path in (ROOT / folder).rglob("*.py")
    ):
        for node in ast.walk(ast.parse(path.read_text("utf-8"))):
            if (
                not isinstance(node, ast.Attribute)
                or not node.attr.startswith("_")
                or node.attr.startswith("__")
            ):
                continue
            own = ast.unparse(node.value) in ("self", "cls", "super()")
            if node.attr not in FOREIGN and not own:
                found.append(f"{path.relative_to(ROOT)}:{node.lineno}: {ast.unparse(node)}")
    assert not found, found


@pytest.mark.parametrize("name", MODELS)
def test_what_is_asked_about_points_belongs_to_the_positions_last_given(name):
    """BA-NOSB's evaluations form no gradients of the points, and bond energies no thickness:
    they had those of the last output.
    """
    body = sheet()
    force, out = bound(name, body), np.empty_like(body.points)
    np.testing.assert_allclose(
        force.deformation_gradients(), np.broadcast_to(np.eye(2), (len(body), 2, 2)), atol=1e-13
    )
    for stretch, give in ((1.3, lambda positions: force(positions, out)), (1.7, force.place)):
        F = np.diag([stretch, homogeneous.uniaxial(LAW, stretch).lateral_stretch])
        give(body.points @ F)
        np.testing.assert_allclose(
            force.deformation_gradients(), np.broadcast_to(F, (len(body), 2, 2)), atol=1e-12
        )
        expected = plane_stress.volume_ratio(LAW, *plane_stress.invariants(F))
        np.testing.assert_allclose(
            force.volume_ratios(), expected, rtol=1e-4 if name == "neo-hookean" else 1e-9
        )
    assert force.supported.all()


@pytest.mark.parametrize("name", MODELS)
def test_what_a_force_does_not_have_it_says(name):
    body = sheet()
    force, out = bound(name, body), np.empty_like(body.points)
    force(wavy(body.points), out)
    assert (force.evaluations, force.timed) == (1, 1)
    assert force.seconds > 0
    assert force.has_energy == (name in ("bond-energy", "neo-hookean-energy"))
    if not force.has_energy:
        with raising("has no energy", TypeError):
            force.energy()
    # Of a force map it is that of the points, which averages the bonds'.
    exact = bound("bond-energy", body)
    exact(wavy(body.points), out)
    assert measures.strain_energy(force) == pytest.approx(exact.energy(), rel=0.05)
    assert len(force.collapsed_pairs()) == 0
    with raising("breakable"):
        force.break_bonds(np.arange(3))


def test_a_bond_force_model_states_its_features_domain_and_block_function():
    """All that a further one consists of: settings, evaluation and what it serves come from
    `ForceSurrogate`.
    """

    class Borrowed(ForceSurrogate):
        name, features, domain, gives_transverse, default_precision = (
            "borrowed",
            ("stretch",),
            None,
            True,
            "float64",
        )

        def bond_force(self, stretch, rotation, length, C33, J):
            return FORCES["analytic"](LAW).bond_force(stretch, rotation, length, C33, J)

        def compiled(self, dtype) -> CompiledBondForce:
            return FORCES["analytic"]().compiled(dtype)

    scene = pds.load_scene("uniaxial", {"spacing": 0.2, "stretches": [1.2]})
    mine, exact = (
        pds.simulate(scene, force).levels[-1]["nominal_stress"]
        for force in (Borrowed(), "analytic")
    )
    assert mine == exact
    with raising("borrowed does not support outside"):
        Borrowed().bind(sheet(), LAW, ForceSettings(outside="warn"))


def test_every_field_has_the_components_and_a_unit_that_it_states():
    body = sheet()
    positions = wavy(body.points)
    state = measures.PointState(bound("neo-hookean", body), positions, np.zeros(len(body)))
    fields = measures.point_fields(state)
    assert list(fields) == list(measures.POINT_FIELDS)
    for name, values in fields.items():
        components = measures.POINT_FIELDS[name].components
        assert values.shape == ((len(body),) if components == 1 else (len(body), components)), name
        assert measures.POINT_FIELDS[name].unit in (None, *Units.model_fields)
    np.testing.assert_array_equal(fields["displacement"][:, :2], positions - body.points)
    P = plane_stress.first_piola_stress(LAW, state.F)
    np.testing.assert_allclose(
        fields["stress"].reshape(-1, 3, 3)[:, :2, :2], P, rtol=1e-3, atol=1e-4
    )
    assert {"damage", "domain_deviation"}.isdisjoint(
        measures.point_fields(measures.PointState(bound("nosb", body), positions))
    )


def test_sums_over_a_body_that_one_process_has_whole(random):
    a, b, weights = (
        random.standard_normal((50, 2)),
        random.standard_normal((50, 2)),
        random.random(50),
    )
    share = Share.whole(50)
    assert share.dot(a, b) == pytest.approx((a * b).sum(), rel=1e-12)
    assert share.dot(a, b, weights) == pytest.approx((weights[:, None] * a * b).sum(), rel=1e-12)
    assert share.sum(a) == pytest.approx(a.sum())
    assert share.greatest(a) == a.max()
    assert np.isnan(share.greatest(np.array([1.0, np.nan, 2.0])))
    count, piece = Share.whole(5).pieces(np.array([0, 1]), np.array([1, 2]))
    assert count == 3
    assert piece[0] == piece[2] != piece[3] != piece[4]
