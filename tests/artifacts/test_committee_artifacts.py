"""A committee in one artifact: members run by their number, and what they would give is told
beside what runs.
"""

import numpy as np
import pytest

import pdsurrogate as pds
from pdsurrogate.artifacts import ArtifactError
from pdsurrogate.forces import AnalyticBondForce, ForceSettings
from pdsurrogate.results.measures import PointState, point_fields
from pdsurrogate.scenes import SceneError

MAIN = pds.materials.MooneyRivlin(shear_modulus=2.0, bulk_modulus=200.0, second_share=0.2)
OTHERS = [
    pds.materials.MooneyRivlin(shear_modulus=2.1, bulk_modulus=210.0, second_share=0.2),
    pds.materials.MooneyRivlin(shear_modulus=2.0, bulk_modulus=200.0, second_share=0.3),
]
BOX = (0.6, 2.0)


@pytest.fixture(scope="module")
def folder(tmp_path_factory):
    """An artifact of a polynomial with two members, of other moduli and of another shape."""
    place = tmp_path_factory.mktemp("artifacts")

    def fitted(law):
        samples = pds.training_samples(law, 1500, BOX, random_state=0)
        return (
            pds.surrogate_pipeline(
                pds.learning.ChebyshevRegressor((10, 5)), features="isochoric"
            ).fit(samples.X, samples.y),
            samples,
            law,
        )

    model, samples, law = fitted(MAIN)
    return pds.store(
        model,
        samples,
        law,
        place,
        "mine",
        "1",
        "a test",
        members=[fitted(other) for other in OTHERS],
    )


def bound(reference, **settings):
    body = pds.Body.rectangle(1.0, 0.7, 0.1, 0.315)
    return pds.load_surrogate(reference).bind(body, MAIN, ForceSettings(**settings)), body


def deformed(body):
    """A homogeneous state turned by 0.4, and its stretch tensor."""
    U = np.array([[1.5, 0.1], [0.1, 0.8]])
    turn = np.array([[np.cos(0.4), -np.sin(0.4)], [np.sin(0.4), np.cos(0.4)]])
    return body.points @ (turn @ U).T, U


def bonds_of(body, U, C33):
    """Ends, stretch, rotation, length, C33 and J of the bonds of a homogeneous state by theory
    (10).
    """
    first, second = body.bonds.first, body.bonds.second
    vectors = body.all_points[second] - body.all_points[first]
    length = np.linalg.norm(vectors, axis=1)
    n = vectors / length[:, None]
    moved = n @ U
    rotation = np.arctan2(n[:, 0] * moved[:, 1] - n[:, 1] * moved[:, 0], (n * moved).sum(axis=1))
    return (
        first,
        second,
        (np.linalg.norm(moved, axis=1), rotation, length / body.horizon, C33, np.linalg.det(U)),
    )


def test_the_deviation_is_that_of_the_bonds_of_a_point(folder):
    """In a homogeneous state, against the laws' exact bond forces."""
    force, body = bound(f"{folder}#all", precision="float64")
    positions, U = deformed(body)
    state = PointState(force, positions)
    C33 = pds.materials.plane_stress.thickness_stretch_squared(
        MAIN, np.array([(U * U).sum()]), np.array([np.linalg.det(U)])
    )[0]
    first, second, bonds = bonds_of(body, U, C33)
    own = MAIN.shear_modulus * AnalyticBondForce(MAIN).bond_force(*bonds)
    off = [
        np.linalg.norm(law.shear_modulus * AnalyticBondForce(law).bond_force(*bonds) - own, axis=1)
        for law in OTHERS
    ]
    expected = np.zeros(len(body))
    for ends in (first, second):
        np.maximum.at(expected, ends, np.max(off, axis=0))
    np.testing.assert_allclose(state.member_deviation, expected, rtol=1e-3)
    assert point_fields(state)["member_deviation"].shape == (len(body),)
    pairs, states = force.learned.bonds()
    assert len(pairs) == len(first)
    np.testing.assert_allclose(
        states.stretches, np.sort(np.linalg.eigvalsh(U))[::-1] * np.ones((len(pairs), 1)), rtol=1e-9
    )
    for found, right in zip(states.quantities(), bonds, strict=True):
        np.testing.assert_allclose(found, right * np.ones(len(pairs)), rtol=1e-6, atol=1e-9)


def test_without_the_request_there_is_nothing_of_it(folder):
    """The same forces to the last bit, no field, and no members in memory."""
    outs = []
    for reference in (str(folder), f"{folder}#all"):
        force, body = bound(reference)
        positions, _ = deformed(body)
        outs.append(np.empty_like(body.points))
        force(positions, outs[-1])
        assert (
            "member_deviation" in point_fields(PointState(force, positions))
        ) == reference.endswith("#all")
    np.testing.assert_array_equal(*outs)
    assert pds.load_surrogate(folder).members == ()


def test_members_run_with_their_own_material(folder):
    """Their stress is that of the exact force with their law; a study takes them as values of a
    parameter.
    """
    scene = pds.load_scene("uniaxial", spacing=0.2, stretches=1.5)
    for number, law in enumerate(OTHERS, 1):
        found = pds.simulate(scene, f"{folder}#{number}")
        assert found.scene.material.build() == law
        assert abs(found.levels[0]["nominal_stress_error"]) < 1e-4
    result = pds.simulate(scene, f"{folder}#all")
    assert result.summary["force"] == "mine@1#all"
    assert result.field("member_deviation").min() > 0.02 * MAIN.shear_modulus


def test_a_study_takes_members(folder, tmp_path):
    forces = [str(folder), f"{folder}#1", f"{folder}#2"]
    keys = {
        "scene": "uniaxial",
        "set": {"spacing": 0.25, "stretches": 1.5},
        "parameters": {"force": forces},
    }
    rows = pds.study(keys, tmp_path / "study", jobs=1, threads=1).rows
    stresses = [row["nominal_stress"] for row in rows]
    assert stresses[1] == pytest.approx(1.05 * stresses[0], rel=1e-4)
    assert stresses[2] != pytest.approx(stresses[0], rel=1e-3)


def test_cards_know_their_members(folder):
    card = pds.load_card(folder)
    assert len(card.members) == 2
    assert set(card.payloads) >= {"surrogate.npz", "members.npz"}
    assert pds.load_card(f"{folder}#2").material.trained_with["second_share"] == 0.3
    assert pds.load_card(f"{folder}#all") == card
    assert "members" not in pds.load_card("neo-hookean@1").to_json()


@pytest.mark.parametrize(
    ("which", "message"),
    [
        ("#3", "has no member #3: it has members #1 to #2"),
        ("#0", "not the folder of an artifact"),
        ("#x", "not the folder of an artifact"),
    ],
)
def test_members_that_there_are_not(folder, which, message):
    with pytest.raises(ArtifactError, match=message):
        pds.load_surrogate(f"{folder}{which}")


def test_what_has_no_committee_says_so():
    for reference in ("neo-hookean@1#1", "neo-hookean#all"):
        with pytest.raises(
            ArtifactError,
            match="it has no committee \\(create one with pdsurrogate fit --committee",
        ):
            pds.load_surrogate(reference)
    with pytest.raises(
        ArtifactError, match="analytic is an exact force model without a committee: leave out #2"
    ):
        pds.load_surrogate("analytic#2")


def test_bodies_that_it_is_not_told_of_are_refused(folder):
    with pytest.raises(ValueError, match="the deviation of members needs plane stress"):
        bound(f"{folder}#all", plane="strain")
    part = {
        "region": {"box": [[-9, -9], [0.6, 9]]},
        "material": {**MAIN.describe(), "shear_modulus": 4.0},
    }
    scene = pds.load_scene(
        "uniaxial", spacing=0.25, stretches=1.2, material=MAIN.describe(), materials=[part]
    )
    with pytest.raises(
        SceneError, match="is available only for bodies of one material; leave out #all"
    ):
        pds.simulate(scene, f"{folder}#all")


def test_a_damaged_member_is_told(folder, tmp_path):
    import shutil

    copy = tmp_path / "mine" / "1"
    shutil.copytree(folder, copy)
    (copy / "members.npz").write_bytes(b"x" * (copy / "members.npz").stat().st_size)
    pds.load_surrogate(copy)
    with pytest.raises(ArtifactError, match=r"members\.npz: the file is damaged or was replaced"):
        pds.load_surrogate(f"{copy}#1")
