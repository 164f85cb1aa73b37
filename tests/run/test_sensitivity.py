"""Derivatives of equilibria by parameters of the scene, and Newton's method."""

from dataclasses import replace

import numpy as np
import pytest
from refusals import raising

import pdsurrogate as pds
from pdsurrogate.materials import LAWS, MooneyRivlin, Yeoh
from pdsurrogate.materials.covariance import numbers_of, with_numbers_of
from pdsurrogate.materials.homogeneous import uniaxial
from pdsurrogate.problem.materials import checked_models
from pdsurrogate.run.differentiated import differentiated
from pdsurrogate.run.parameters import numbers_in
from pdsurrogate.run.sensitivity import jacobian
from pdsurrogate.scenes.reading import apply_change, leaves

CONVERGED = {"solver.method": "newton", "solver.tolerance": 1e-10, "precision": "float64"}
CLOSE = 1e-6
"""Difference of derivatives from central differences of converged runs, relative to the greatest.
Residuals of 1e-10 leave 1e-10/1e-4 in the differences, and their curvature 1e-8.
"""


def by_runs(scene, force, outputs, parameter):
    """Return derivatives of measurements by a parameter, from two runs that are converged to
    1e-10.
    """
    found = []
    value = (
        scene.stretches[-1]
        if parameter == "stretch"
        else dict(leaves(scene.model_dump(mode="json")))[parameter]
    )
    step = 1e-4 * (abs(value) or scene.spacing)
    for sign in (1, -1):
        data = scene.model_dump(mode="json")
        changes = (
            {"stretches": [value + sign * step]}
            if parameter == "stretch"
            else {parameter: value + sign * step}
        )
        for key, number in (CONVERGED | changes).items():
            apply_change(data, key, number)
        row = dict(leaves(pds.simulate(type(scene).model_validate(data), force).levels[-1]))
        found.append(np.array([row[name] for name in outputs]))
    return (found[0] - found[1]) / (2 * step)


def compare(scene, force, outputs, parameters):
    result = pds.simulate(scene, force)
    found = result.sensitivity(outputs, parameters)
    row = dict(leaves(result.levels[-1]))
    assert found.values == pytest.approx(
        [row[name] for name in found.outputs], rel=1e-4, abs=1e-4 * np.abs(found.values).max()
    )
    assert found.displacements.shape == (len(parameters), *result.body.points.shape)
    for number, parameter in enumerate(parameters):
        expected = by_runs(result.scene, force, found.outputs, parameter)
        assert (
            np.abs(found.derivatives[:, number] - expected).max() < CLOSE * np.abs(expected).max()
        ), parameter


def test_coefficients_near_zero_have_the_derivatives_of_the_exact_solution():
    """Differences keep the sign of such coefficients, which the law requires."""
    terms = {
        "law": "polyconvex",
        "first": [0.4, 1e-5, 1e-12],
        "second": [0.05],
        "bulk_modulus": 100.0,
    }
    scene = pds.load_scene("uniaxial", spacing=0.25, stretches=1.5, material=terms)
    parameters = ["material.first.0", "material.first.1", "material.first.2"]
    found = pds.simulate(scene, "bond-energy").sensitivity(["nominal_stress"], parameters)

    def stress(parameter, change):
        data = scene.model_dump(mode="json", exclude={"material": {"shear_modulus"}})
        apply_change(data, parameter, dict(leaves(data))[parameter] + change)
        return uniaxial(type(scene).model_validate(data).law(), 1.5).nominal_stress

    h = 1e-4  # one-sided, of second order: the stress is nearly linear in coefficients
    exact = [
        (4 * stress(name, h) - 3 * stress(name, 0.0) - stress(name, 2 * h)) / (2 * h)
        for name in parameters
    ]
    assert found.derivatives[0] == pytest.approx(exact, rel=1e-6)


@pytest.mark.parametrize(
    "law",
    [law() for law in LAWS.values()]
    + [MooneyRivlin(second_share=0.0), Yeoh(second=0.0, third=0.0)],
    ids=str,
)
def test_default_numbers_of_a_law_are_parameters(law):
    """All that are not zero are listed, and all listed ones have the derivatives of the exact
    stress, at the ends of their ranges, too.
    """
    name = (
        law.name
        if law == type(law)()
        else {key: value for key, value in law.describe().items() if key != "bulk_modulus"}
    )
    scene = pds.load_scene("uniaxial", spacing=0.25, stretches=1.5, material=name)
    result = pds.simulate(scene, "bond-energy")
    parameters = [
        name
        for name in numbers_in(scene, checked_models(scene, pds.load_surrogate("bond-energy")))
        if "material" in name
    ]
    assert {name.removeprefix("material.") for name in parameters} >= {
        name for name, value in numbers_of(law).items() if value
    }
    found = result.sensitivity(["nominal_stress"], parameters)

    def stress(name, change):
        key = name.removeprefix("material.")
        return uniaxial(
            with_numbers_of(law, {key: numbers_of(law)[key] + change}), 1.5
        ).nominal_stress

    exact = []
    for name in parameters:
        value = numbers_of(law)[name.removeprefix("material.")]
        h = 1e-4 * (abs(value) or 1.0)
        try:
            exact.append((stress(name, h) - stress(name, -h)) / (2 * h))
        except ValueError:  # one-sided, of second order
            exact.append(
                (4 * stress(name, h) - 3 * stress(name, 0.0) - stress(name, 2 * h)) / (2 * h)
            )
    assert found.derivatives[0] == pytest.approx(exact, rel=1e-6, abs=1e-6 * np.abs(exact).max())


def test_a_share_of_zero_is_a_parameter_in_any_unit_of_stress():
    scene = pds.load_scene(
        "uniaxial",
        material={
            "law": "mooney-rivlin",
            "shear_modulus": 400.0,
            "bulk_modulus": 4e4,
            "second_share": 0.0,
        },
    )
    assert "material.second_share" in numbers_in(
        scene, checked_models(scene, pds.load_surrogate("bond-energy"))
    )


def test_numbers_of_which_a_learned_model_knows_one_value_are_no_parameters():
    scene = pds.load_scene("uniaxial", spacing=0.25, stretches=1.5, material="gent")
    result, models = pds.simulate(scene, "gent"), checked_models(scene, pds.load_surrogate("gent"))
    moduli = ["material.shear_modulus", "material.bulk_modulus"]
    assert [name for name in numbers_in(scene, models) if "material" in name] == moduli
    rates = result.sensitivity(["nominal_stress"], moduli).derivatives[0]
    # stresses scale with both
    assert rates @ [1.0, 200.0] == pytest.approx(result.levels[-1]["nominal_stress"], rel=1e-6)
    with raising(
        r"gent@1 describes one value of chain_limit alone.*run the scene with force=analytic"
    ):
        result.sensitivity(["nominal_stress"], ["material.chain_limit"])
    polyconvex = pds.simulate(
        pds.load_scene("uniaxial", spacing=0.25, stretches=1.5, material="polyconvex"),
        "bond-energy",
    )
    with raising(r"material\.second\.1 is 0, so that polyconvex has no such term"):
        polyconvex.sensitivity(["nominal_stress"], ["material.second.1"])


def test_components_of_a_probe_have_short_names():
    probe = {"probes": [{"name": "tip", "at": [0.75, 0.25]}]}
    scene = pds.load_scene("uniaxial", {"spacing": 0.25, "stretches": [1.2, 1.5], **probe})
    result = pds.simulate(scene, "bond-energy")
    found = result.sensitivity(
        ["nominal_stress", "probes.tip.u2", "forces.right.1"], ["material.bulk_modulus"], level=-1
    )
    assert found.outputs == ("nominal_stress", "probes.tip.displacement.1", "forces.right.1")
    whole = result.sensitivity(["probes.tip.displacement"], ["material.bulk_modulus"])
    assert found.derivatives[1, 0] == pytest.approx(whole.derivatives[1, 0], rel=1e-6)
    with raising(r"the result has no 'probes\.tip\.u3'"):
        result.sensitivity(["probes.tip.u3"], ["stretch"])


@pytest.mark.parametrize("force", ["bond-energy", "analytic"])
def test_derivatives_of_a_sheet_with_a_hole_are_those_of_converged_runs(force):
    """Bond forces have no energy, so their tangent is not symmetric."""
    scene = pds.load_scene("hole", spacing=0.4)
    compare(
        scene,
        force,
        ["nominal_stress", "forces.top"],
        ["material.shear_modulus", "material.bulk_modulus", "stretch"],
    )


def test_derivatives_of_a_nearly_incompressible_solid_are_those_of_converged_runs():
    scene = pds.load_scene("bonded-block", spacing=0.25)
    compare(
        scene,
        "bond-energy",
        ["nominal_stress", "energy", "probes.side.displacement"],
        ["material.shear_modulus"],
    )


def test_derivatives_by_a_pressure_that_follows_the_boundary_are_those_of_converged_runs():
    scene = pds.load_scene("ring-pressure", {"spacing": 0.2, "steps": [{"to": 0.2}]})
    compare(scene, "bond-energy", ["probes.inner.displacement", "energy"], ["loads.0.pressure"])
    found = pds.simulate(scene, "bond-energy").sensitivity(["energy"], ["loads.0.pressure", "t"])
    # the pressure acts with the factor t
    pressure = found.derivatives[0, 0] * scene.loads[0].pressure / 0.2
    assert found.derivatives[0, 1] == pytest.approx(pressure, rel=1e-6)


def test_derivatives_by_a_rotation_and_the_modulus_of_an_inclusion():
    compare(
        pds.load_scene("disc-torsion", spacing=0.2),
        "bond-energy",
        ["moments", "energy"],
        ["prescribed.1.rotation"],
    )
    scene = pds.load_scene("bimaterial", {"spacing": 0.1, "stretches": [1.2]})
    compare(
        scene,
        "bond-energy",
        ["nominal_stress", "probes.interface.displacement"],
        ["materials.0.material.shear_modulus"],
    )


def test_a_body_with_a_precut_has_derivatives_until_a_bond_breaks():
    """Also of the energy release rate; bonds that the precut has cut are damage, but none that
    the load has done.
    """
    changes = {
        "spacing": 0.2,
        "horizon_ratio": 2.2,
        "stretches": [1.2],
        "dynamics.stretch": 1.201,
        "dynamics.outputs": 1,
        "fracture": {"critical_stretch": 2.5},
        "reference": None,
    }
    scene = pds.load_scene("tear", changes)
    compare(
        scene,
        "bond-energy",
        ["nominal_stress", "cracks.0.energy_release_rate"],
        ["material.shear_modulus", "stretch"],
    )
    torn = pds.simulate(scene, "bond-energy")
    torn.field("damage", 0)[0] += 0.05  # as if a bond were broken
    with raising("bonds are broken at output 0"):
        torn.sensitivity(["nominal_stress"], ["stretch"])


def by_models(scene, outputs, models, step):
    """Return derivatives of measurements from two runs, converged to 1e-10, with the force
    models after and before.
    """
    rows = [
        dict(
            leaves(
                pds.simulate(
                    pds.load_scene(scene.name, {**scene_changes(scene), **CONVERGED}), model
                ).levels[-1]
            )
        )
        for model in models
    ]
    return np.array([rows[0][name] - rows[1][name] for name in outputs]) / (2 * step)


def scene_changes(scene):
    return {
        "spacing": scene.spacing,
        "stretches": list(scene.stretches),
        "material": scene.material.model_dump(mode="json"),
    }


@pytest.mark.parametrize(
    ("name", "spacing", "artifact", "array", "place"),
    [
        ("hole", 0.5, "neo-hookean-energy", "output_weights", (3,)),
        ("bonded-block", 0.25, "neo-hookean-isochoric", "output_weights", (3,)),
        ("hole", 0.5, "gent", "coefficients", (1, 2, 1)),
    ],
)
def test_derivatives_by_numbers_of_learned_models_are_those_of_converged_runs(
    name, spacing, artifact, array, place
):
    """Forces are linear in these numbers, so that the differences can be large; the models then
    no longer have their stated errors.
    """
    model = pds.load_surrogate(artifact)
    law = {"law": model.law} | (
        {"chain_limit": model.shape["chain_limit"]} if "chain_limit" in model.shape else {}
    )
    scene = pds.load_scene(name, {"spacing": spacing, "material": law})
    parameter = ".".join(map(str, ("force", array, *place)))
    found = pds.simulate(scene, model).sensitivity(["nominal_stress", "forces"], [parameter])
    values, step = getattr(model, array), 1e-3 * np.abs(getattr(model, array)).max()
    sides = []
    for change in (step, -step):
        changed = values.copy()
        changed[place] += change
        sides.append(
            replace(model, stated=model.stated | {"rms": 1.0, "max": 1.0}, **{array: changed})
        )
    expected = by_models(scene, found.outputs, sides, step)
    assert np.abs(found.derivatives[:, 0] - expected).max() < CLOSE * np.abs(expected).max()


@pytest.mark.parametrize("name", ["bonded-block", "disc-torsion"])
def test_adjoint_solutions_give_the_derivatives_of_forward_ones(name):
    """With fewer measurements than parameters each measurement has a solution, else each
    parameter.
    """
    scene = pds.load_scene(name, spacing=0.25)
    body, result = (
        differentiated(scene, checked_models(scene, pds.load_surrogate("bond-energy"))),
        pds.simulate(scene, "bond-energy"),
    )
    at, start = (
        (result.levels[-1]["stretch"] if scene.stretched else result.levels[-1]["t"]),
        result.displacement(),
    )
    parameters = [
        "material.shear_modulus",
        "material.bulk_modulus",
        "stretch" if scene.stretched else "t",
    ]
    holder = next(iter(result.levels[-1]["forces"]))
    forward = jacobian(body, at, start, ["energy", f"forces.{holder}"], parameters)
    for name in ("energy", f"forces.{holder}.0", f"forces.{holder}.1"):
        adjoint, row = (
            jacobian(body, at, start, [name], parameters),
            forward.derivatives[forward.names.index(name)],
        )
        assert adjoint.moved is None
        assert (
            np.abs(adjoint.derivatives[0] - row).max() < CLOSE * np.abs(forward.derivatives).max()
        )


def test_jacobians_of_displacements_at_places_are_those_of_changed_equilibria():
    scene = pds.load_scene("hole", spacing=0.25)
    places = np.array([[0.5, 0.3], [0.3, 1.1], [0.9, 0.8]])
    body = differentiated(scene, checked_models(scene, pds.load_surrogate("bond-energy")), places)
    at, start, outputs, step = (
        scene.stretches[-1],
        pds.simulate(scene, "bond-energy").displacement(),
        ["nominal_stress"],
        1e-4,
    )
    found = jacobian(body, at, start, outputs, ["stretch", "material.shear_modulus"])
    assert found.names == (
        "nominal_stress",
        *(f"places.{place}.{axis}" for place in range(3) for axis in range(2)),
    )
    pulled = [
        jacobian(body, at + change, found.displacements, outputs, ["stretch"]).values
        for change in (step, -step)
    ]
    stiffer = [body.changed({"material.shear_modulus": 1 + change}) for change in (step, -step)]
    stiffer = [
        jacobian(side, at, found.displacements, outputs, ["stretch"]).values for side in stiffer
    ]
    expected = np.array([(after - before) / (2 * step) for after, before in (pulled, stiffer)]).T
    assert np.abs(found.derivatives - expected).max() < CLOSE * np.abs(expected[1:]).max()


@pytest.mark.parametrize("name", ["uniaxial", "bonded-block"])
def test_newton_reaches_ten_digits_in_a_few_iterations(name):
    scene = pds.load_scene(name, {"spacing": 0.25, "stretches": [1.5], **CONVERGED})
    result = pds.simulate(scene, "bond-energy")
    residuals = [row["residual"] for row in result.convergence if row.get("residual") is not None]
    assert result.levels[-1]["method"] == "newton"
    assert residuals[-1] < 1e-10
    assert sum(residual < 1e-3 for residual in residuals) <= 1 + 6


def test_what_has_no_derivative_is_refused(tmp_path):
    result = pds.simulate(pds.load_scene("uniaxial", spacing=0.25, stretches=1.5), "bond-energy")
    with raising(
        r"there is no number 'material.shear_modulos' .* did you mean material.shear_modulus"
    ):
        result.sensitivity(["energy"], ["material.shear_modulos"])
    with raising("there is no number 'spacing'"):
        result.sensitivity(["energy"], ["spacing"])
    for outputs, numbers in (
        (["crack.peak.nominal_stress"], ["material.shear_modulus"]),
        (["peak_nominal_stress"], ["material.shear_modulus"]),
        (["energy"], ["fracture.strength.uniaxial"]),
    ):
        with raising("what a body bears at break has no derivative"):
            result.sensitivity(outputs, numbers)
    with raising("the result has no 'nominal_stres'; did you mean nominal_stress"):
        result.sensitivity(["nominal_stres"], ["stretch"])
    with raising("parameters: name at least one number to differentiate by, such as 'stretch'"):
        result.sensitivity([], [])
    with raising(r"outputs: must be a list of names such as .* not 'energy'"):
        result.sensitivity("energy", ["stretch"])
    with raising(r"parameters: must be a list of names .* not \[1\]"):
        result.sensitivity(["energy"], [1])
    with raising(r"outputs: must be a list of at least one name, .* not \[\]"):
        result.standard_errors([])
    with raising(r"covariance: must be a LawCovariance, .* not a float"):
        result.standard_errors(["energy"], 1.0)
    twice = result.sensitivity(["energy"], ["stretch", "stretch"]).derivatives[0]
    assert twice[0] == pytest.approx(twice[1], rel=1e-6)
    with raising("has 1 outputs, none with the number 1", IndexError):
        result.sensitivity(["energy"], ["stretch"], level=1)
    result.save(tmp_path / "saved")
    saved = pds.load_result(tmp_path / "saved")
    for ask in (
        lambda: saved.sensitivity(["energy"], ["stretch"]),
        lambda: saved.standard_errors(["energy"]),
        saved.lowest_mode,
    ):
        with raising("read from files has no force model"):
            ask()
    soft = pds.simulate(result.scene, "ba-nosb")
    with raising("the forces of ba-nosb have no energy: use bond-energy"):
        soft.sensitivity(["nominal_stress"], ["stretch"])
    with raising(r"solver\.method=newton needs precision", pds.SceneError):
        pds.simulate(
            pds.load_scene("uniaxial", {"spacing": 0.25, "solver.method": "newton"}), "neo-hookean"
        )


def test_a_kink_of_an_amplitude_has_no_derivative_by_t():
    """The amplitude rises to 1 at t = 1, and then stays there."""
    moved = {"region": "right", "x1": 0.2, "x2": 0.0, "amplitude": [[0, 0], [1, 1], [2, 1]]}
    scene = {
        "name": "kink",
        "spacing": 0.25,
        "steps": [0.5, 1.0, 2.0],
        "body": {"size": [1.0, 0.5]},
        "material": "neo-hookean",
    }
    scene |= {"prescribed": [{"region": "left", "x1": 0.0, "x2": 0.0}, moved]}
    result = pds.simulate(pds.Scene.model_validate(scene), "bond-energy")
    assert result.sensitivity(["forces.right.0"], ["t"], level=0).derivatives[0, 0] > 0
    assert (
        result.sensitivity(["forces.right.0"], ["prescribed.1.x1"], level=1).derivatives[0, 0] > 0
    )
    with raising(r"prescribed\.1\.amplitude has a kink at t = 1"):
        result.sensitivity(["forces.right.0"], ["t"], level=1)


RUBBER = {"law": "neo-hookean", "shear_modulus": 1.0}
STIFF = RUBBER | {"bulk_modulus": 1e4}
OF_STIFF = ["material.shear_modulus", "material.bulk_modulus", "stretch"]
DISC = {"disc": {"center": (0.6, 1.5), "radius": 0.5}, "x1": 0.05, "x2": -0.1, "name": "disc"}


def pressed(**keys):
    """A sheet on rollers into which a disc is pressed."""
    rollers = [{"region": "bottom", "x2": 0.0}, {"region": "left", "x1": 0.0}]
    material = RUBBER | {"bulk_modulus": 10.0}
    given = {
        "name": "pressed",
        "spacing": 0.2,
        "steps": [1.0],
        "body": {"size": (1.0, 1.0)},
        "material": material,
    }
    return pds.Scene.model_validate(given | {"prescribed": rollers, "obstacles": [DISC]} | keys)


def cantilever(length, force):
    """A cantilever of the thickness 1 under a force at its end."""
    end = {
        "probes": [{"name": "end", "at": (length, 0.5)}],
        "loads": [{"region": "right", "force": (0.0, force), "name": "end"}],
    }
    given = {"name": "cantilever", "spacing": 0.25, "steps": [1.0], "body": {"size": (length, 1.0)}}
    held = {
        "prescribed": [{"region": "left", "x1": 0.0, "x2": 0.0}],
        "material": RUBBER | {"bulk_modulus": 100.0},
    }
    return pds.Scene.model_validate(given | held | end)


def settled(body, at, displacements):
    """Return the measurements of an equilibrium that Newton's method with the dense tangent has
    converged to rounding.
    """
    run = body.system
    run.state.parameter = at
    run.place(run.body.points + displacements)
    free, forces = run.loading.free.ravel() > 0, np.empty_like(run.positions)
    chosen = np.eye(free.size)[:, free]
    for number in range(8 if not run.loads.obstacles else 16):
        if number < 5:  # the last steps are corrections of 1e-8 and less
            tangent = (run.loaded.tangent(run.positions) @ chosen)[free]
        run.loaded(run.positions, forces)
        moved = np.zeros(free.size)
        moved[free] = np.linalg.solve(tangent, forces.ravel()[free])
        run.positions += moved.reshape(forces.shape)
        # without penetration
        run.loads.pushes[:] = run.loads.pushed(run.positions, run.loads.pushes)
    assert all(one.contact(run.positions)["penetration"] < 1e-12 for one in run.loads.obstacles)
    return body.evaluated(run.positions)[0]


def by_settled(body, at, start, names, parameter):
    """Return derivatives of measurements by Richardson's extrapolation of the differences of
    four equilibria.
    """
    loading = body.system.loading.parameter
    value = at if parameter == loading else body.numbers[parameter]
    # Nearly incompressible bodies hardly depend on their bulk modulus.
    step, found = (1e-2 if parameter.endswith("bulk_modulus") else 1e-4) * value, {}
    for way in (-2, -1, 1, 2):
        if parameter == loading:  # bodies move about in proportion to their supports
            rest = body.system.loading.rest
            measured = settled(body, at + way * step, start * (1 + way * step / (at - rest)))
        else:
            measured = settled(body.changed({parameter: value + way * step}), at, start)
        found[way] = np.array([measured[name] for name in names])
    near, far = (found[1] - found[-1]) / (2 * step), (found[2] - found[-2]) / (4 * step)
    return (4 * near - far) / 3


@pytest.mark.parametrize(
    ("scene", "outputs", "parameters"),
    [
        (
            lambda: pds.load_scene(
                "plane-strain-block", {"spacing": 0.2, "stretches": [1.3], "material": STIFF}
            ),
            ["forces"],
            OF_STIFF,
        ),
        (
            lambda: pds.load_scene(
                "bonded-block", {"spacing": 1 / 3, "stretches": [1.3], "material": STIFF}
            ),
            ["nominal_stress"],
            OF_STIFF,
        ),
        (
            pressed,
            ["forces"],
            [
                "obstacles.0.x1",
                "obstacles.0.x2",
                "obstacles.0.disc.radius",
                "material.shear_modulus",
                "t",
            ],
        ),
        (
            lambda: cantilever(6.0, 6e-3),
            ["probes.end.displacement", "forces.left"],
            ["loads.0.force.1", "t"],
        ),
    ],
    ids=["strain", "solid, adjoint", "disc", "cantilever"],
)
def test_derivatives_at_large_bulk_moduli_in_contact_and_of_slender_bodies(
    scene, outputs, parameters
):
    """K/mu is 10,000 in the first two. The equilibria of the reference are converged to
    rounding.
    """
    scene = scene()
    result = pds.simulate(scene, "bond-energy")
    found = result.sensitivity(outputs, parameters)
    body = differentiated(scene, checked_models(scene, pds.load_surrogate("bond-energy")))
    at = result.levels[-1]["stretch" if scene.stretched else "t"]
    jacobian(body, at, result.displacement(), outputs, [])  # finds the pushes of obstacles
    for number, parameter in enumerate(parameters):
        column = found.derivatives[:, number]
        expected = by_settled(body, at, result.displacement(), found.outputs, parameter)
        assert np.abs(column - expected).max() < CLOSE * np.abs(expected).max(), parameter
        assert found.errors[:, number].max() < CLOSE * np.abs(expected).max()
