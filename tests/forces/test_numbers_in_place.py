"""Forces whose laws and models have other numbers within a ``with`` block, against forces that
are bound to these numbers.
"""

from dataclasses import replace

import numpy as np
import pytest
from refusals import raising

import pdsurrogate as pds
from pdsurrogate.forces.internal_force import numbers_in_place
from pdsurrogate.forces.learned import Learned
from pdsurrogate.problem import compile_scene
from pdsurrogate.problem.materials import checked_models
from pdsurrogate.run.parameters import numbers_in, with_numbers

OGDEN = {
    "law": "ogden",
    "moduli": [1.4911, 0.00284, -0.02367],
    "exponents": [1.3, 5.0, -2.0],
    "bulk_modulus": 100.0,
}
SHEET, BLOCK, STRAIN = {"spacing": 0.25}, {"spacing": 0.25}, {"spacing": 0.1}
OTHERS = {"material": {"law": "mooney-rivlin", "second_share": 0.4, "bulk_modulus": 50.0}}

CASES = [
    ("hole", "analytic", SHEET, ["material.shear_modulus", "material.bulk_modulus"]),
    ("hole", "nosb", SHEET, ["material.shear_modulus", "material.bulk_modulus"]),
    ("hole", "ba-nosb", SHEET, ["material.shear_modulus", "material.bulk_modulus"]),
    ("hole", "neo-hookean", SHEET, ["material.shear_modulus", "material.bulk_modulus"]),
    ("hole", "neo-hookean", SHEET, ["force.weights_1.2.1", "force.biases_0.3"]),
    (
        "hole",
        "gent",
        SHEET | {"material": {"law": "gent", "chain_limit": 120.0}},
        ["force.coefficients.0.2.1"],
    ),
    (
        "hole",
        "bond-energy",
        SHEET | {"material": OGDEN},
        ["material.moduli.1", "material.exponents.0", "material.bulk_modulus"],
    ),
    ("hole", "neo-hookean-energy", SHEET, ["force.output_weights.3", "force.hidden_biases.2"]),
    (
        "bimaterial",
        "analytic",
        STRAIN,
        ["material.shear_modulus", "materials.0.material.bulk_modulus"],
    ),
    ("bimaterial", "nosb", STRAIN, ["material.shear_modulus", "materials.0.material.bulk_modulus"]),
    (
        "bimaterial",
        "bond-energy",
        STRAIN,
        ["material.shear_modulus", "materials.0.material.bulk_modulus"],
    ),
    (
        "bimaterial",
        "bond-energy",
        STRAIN | {"plane": "strain"},
        ["material.bulk_modulus", "materials.0.material.shear_modulus"],
    ),
    ("bimaterial", "neo-hookean-energy", STRAIN, ["force.output_weights.3"]),
    (
        "plane-strain-block",
        "neo-hookean",
        STRAIN,
        ["material.shear_modulus", "material.bulk_modulus"],
    ),
    (
        "plane-strain-block",
        "bond-energy",
        STRAIN,
        ["material.shear_modulus", "material.bulk_modulus"],
    ),
    (
        "bonded-block",
        "bond-energy",
        BLOCK | {"material": OGDEN},
        ["material.moduli.1", "material.exponents.0", "material.bulk_modulus"],
    ),
    (
        "bonded-block",
        "neo-hookean-isochoric",
        BLOCK,
        ["material.shear_modulus", "material.bulk_modulus"],
    ),
    (
        "bonded-block",
        "neo-hookean-isochoric",
        BLOCK,
        ["force.output_weights.3", "force.hidden_biases.2"],
    ),
]


def moved(points):
    """Positions in a state with waves, small enough for held boundaries."""
    waves = [np.sin(4 * np.roll(points, 1, axis=1)[:, axis]) for axis in range(points.shape[1])]
    return points + 0.005 * np.stack(waves, axis=1)


class Case:
    """Force of a scene at wavy positions, and the laws and models of the scene with other
    numbers.
    """

    def __init__(self, name, force, changes, numbers):
        self.scene = pds.load_scene(name, changes)
        model = pds.load_surrogate(force)
        if isinstance(model, Learned):  # with other numbers it no longer has its stated errors
            model = replace(model, stated=dict(model.stated) | {"rms": 1.0, "max": 1.0})
        self.models = checked_models(self.scene, model)
        self.problem = compile_scene(self.scene, self.models)
        self.force = self.problem.bind("float64")[0]
        self.started = {key: array.copy() for key, array in self.force.state_arrays.items()}
        known = numbers_in(self.scene, self.models)
        # Forces vary little with the bulk modulus, and a learned model is not to leave its tested
        # range by much.
        values = {
            key: known[key] * (1.5 if key.endswith("bulk_modulus") else 1.01) for key in numbers
        }
        self.other = self.problem.changed(*with_numbers(self.scene, self.models, values))
        self.materials = [(portion.law, portion.model) for portion in self.other.portions]

    def forces(self, force):
        """Forces of points and pairs, and the energy, from the state in which a force is bound."""
        for key, array in force.state_arrays.items():
            array[:] = self.started[key]
        found = np.empty_like(force.body.points)
        force(moved(force.body.points), found)
        return found, force.pair_forces(), force.energy() if force.has_energy else 0.0


@pytest.mark.parametrize(("name", "force", "changes", "numbers"), CASES)
def test_numbers_in_place_give_the_bits_of_a_force_that_is_bound_to_them(
    name, force, changes, numbers
):
    case = Case(name, force, changes, numbers)
    own, expected = case.forces(case.force), case.forces(case.other.bind("float64")[0])
    assert np.abs(expected[0] - own[0]).max() > 1e-4 * np.abs(own[0]).max()
    with numbers_in_place(case.force, case.materials):
        found = case.forces(case.force)
    for one, other in zip(found, expected, strict=True):
        np.testing.assert_array_equal(one, other)
    for one, other in zip(case.forces(case.force), own, strict=True):
        np.testing.assert_array_equal(one, other)


@pytest.mark.parametrize(("name", "force", "changes", "numbers"), [CASES[7], CASES[10]])
def test_an_error_leaves_no_other_numbers_in_a_force(name, force, changes, numbers):
    case = Case(name, force, changes, numbers)
    own = case.forces(case.force)
    with (
        raising("in the block", KeyError),
        numbers_in_place(case.force, case.materials),
    ):
        raise KeyError("in the block")
    assert [portion.law for portion in case.force.portions] == [
        portion.law for portion in case.problem.portions
    ]
    for one, other in zip(case.forces(case.force), own, strict=True):
        np.testing.assert_array_equal(one, other)


def test_other_laws_and_models_are_refused():
    case = Case("hole", "bond-energy", SHEET, ["material.shear_modulus"])
    mooney = compile_scene(pds.load_scene("hole", SHEET | OTHERS), case.models).portions[0].law
    for materials in (
        [(mooney, case.models[0])],
        [(case.problem.law, pds.load_surrogate("analytic"))],
        case.materials * 2,
    ):
        with (
            raising("takes other numbers of its laws and models"),
            numbers_in_place(case.force, materials),
        ):
            pass
