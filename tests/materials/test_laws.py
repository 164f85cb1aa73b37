"""The library of laws: limits, special cases, equal stretches, what a user adds, and the
thickness from the learned force.
"""

from dataclasses import dataclass
from typing import ClassVar

import numpy as np
import pytest
from conftest import LAWS as EXAMPLES
from polynomials import polynomial
from refusals import raising

import pdsurrogate as pds
from pdsurrogate.forces import ForceSettings
from pdsurrogate.kernels.elementary import chain_energy, inverse_langevin, langevin
from pdsurrogate.learning import reachable_stretches, surrogate_of
from pdsurrogate.materials import LAWS, InvariantLaw, homogeneous, plane_stress
from pdsurrogate.materials.consistency import check_consistency
from pdsurrogate.testing.laws import compiled_response

LIMITED = [
    pds.materials.Gent(chain_limit=10.0),
    pds.materials.ArrudaBoyce(chain_links=4.0),
    pds.materials.FullNetwork(chain_links=9.0),
]
"""Laws that lock: all of them before equibiaxial stretch 6."""


def stretches(random, n, low=0.5, high=4.0):
    return np.exp(random.uniform(np.log(low), np.log(high), (2, n)))


def test_every_law_is_tried():
    assert {law.name for law in EXAMPLES} == set(LAWS)


@pytest.mark.parametrize(
    ("law", "tolerance"),
    [
        (pds.materials.MooneyRivlin(second_share=0.0), 1e-12),
        (pds.materials.Yeoh(second=0.0, third=0.0), 1e-12),
        # The chain's second term is of relative order I1/N.
        (pds.materials.Gent(bulk_modulus=100.0, chain_limit=1e9), 1e-7),
        (pds.materials.ArrudaBoyce(chain_links=1e7), 1e-4),
        (pds.materials.FullNetwork(chain_links=1e7), 1e-4),
        (pds.materials.Ogden(moduli=(1.0,), exponents=(2.0,)), 1e-9),
        (pds.materials.Polyconvex(), 1e-9),
    ],
    ids=lambda value: getattr(value, "name", ""),
)
def test_neo_hookean_limit(law, tolerance, random):
    first, second = stretches(random, 200)
    F = np.zeros((200, 2, 2))
    F[:, 0, 0], F[:, 1, 1] = first, second
    if law.name == "gent":  # its volumetric part is another: compare at J3 = 1
        state = first**2 + second**2, first * second, np.ones(200)
        np.testing.assert_allclose(
            plane_stress.response(law, *state)[:2],
            plane_stress.response(pds.materials.NeoHookean(), *state)[:2],
            rtol=tolerance,
        )
        return
    expected = plane_stress.first_piola_stress(pds.materials.NeoHookean(), F)
    np.testing.assert_allclose(
        plane_stress.first_piola_stress(law, F), expected, rtol=tolerance, atol=10 * tolerance
    )


def test_mooney_rivlin_is_an_ogden_law(random):
    """Exponents 2 and -2 with moduli 2 C10 and -2 C01: the two families of laws share no code
    for the stress.
    """
    mooney = pds.materials.MooneyRivlin(1.0, 100.0, 0.3)
    ogden = pds.materials.Ogden(moduli=(0.7, -0.3), exponents=(2.0, -2.0))
    first, second = stretches(random, 300)
    state = first**2 + second**2, first * second, np.exp(random.uniform(-0.2, 0.2, 300))
    for row, (one, other) in enumerate(
        zip(
            plane_stress.response(mooney, *state), plane_stress.response(ogden, *state), strict=True
        )
    ):
        np.testing.assert_allclose(one, other, rtol=1e-8, atol=1e-8, err_msg=f"row {row}")


def test_ogden_tension_is_the_papers_formula():
    """sum mu_k (l^(a_k - 1) - l^(-a_k/2 - 1)), the incompressible limit, at K = 1e7 mu."""
    law = pds.materials.Ogden(bulk_modulus=1e7)
    for stretch in (0.7, 2.0, 5.0):
        expected = sum(
            mu * (stretch ** (a - 1) - stretch ** (-a / 2 - 1))
            for mu, a in zip(law.moduli, law.exponents, strict=True)
        )
        assert homogeneous.uniaxial(law, stretch).nominal_stress == pytest.approx(
            expected, rel=1e-5
        )


@pytest.mark.parametrize(
    "law", [pds.materials.Ogden(), pds.materials.FullNetwork()], ids=lambda law: law.name
)
def test_equal_stretches_are_no_exception(law):
    """At and around equal stretches the response is smooth: the separation that avoids 0/0 costs
    less than 1e-9.
    """
    for J3 in (0.95, 1.0, 1.1):
        middle = 1.7
        apart = np.array([0.0, 1e-9, 1e-7, 1e-5, 1e-3])
        first, second = middle * np.exp(apart), middle * np.exp(-apart)
        state = first**2 + second**2, first * second, np.full(5, J3)
        for values in (plane_stress.response(law, *state), compiled_response(law, *state)):
            p, q = np.asarray(values)[:2]
            assert np.isfinite(values).all()
            np.testing.assert_allclose(p[:4], p[0], rtol=1e-8)
            # p itself changes with the square of the separation.
            np.testing.assert_allclose(p[4], p[0], rtol=1e-5)
            np.testing.assert_allclose(q[:4], q[0], rtol=1e-8)


def test_inverse_langevin_to_rounding():
    y = np.concatenate([np.geomspace(1e-4, 0.1, 50), np.linspace(0.1, 0.99, 200)])
    beta, stiffness = inverse_langevin(y)
    # coth(b) - 1/b written for large arguments, and its series for small ones: neither is the code
    # under test.
    large = y > 0.3
    np.testing.assert_allclose(1 / np.tanh(beta[large]) - 1 / beta[large], y[large], rtol=1e-14)
    small = y < 0.02
    series = 3 * y + 9 / 5 * y**3 + 297 / 175 * y**5 + 1539 / 875 * y**7
    np.testing.assert_allclose(beta[small], series[small], rtol=1e-13)
    np.testing.assert_allclose(langevin(beta), y, rtol=1e-14)
    h = 1e-6 * (1 - y)
    slope = (inverse_langevin(y + h)[0] - inverse_langevin(y - h)[0]) / (2 * h)
    np.testing.assert_allclose(stiffness, slope, rtol=1e-7)
    inner = y > 1e-2  # below, differences of the energy are rounding
    energy = (
        chain_energy(y + h, inverse_langevin(y + h)[0])
        - chain_energy(y - h, inverse_langevin(y - h)[0])
    ) / (2 * h)
    np.testing.assert_allclose(energy[inner], beta[inner], rtol=1e-6)
    assert np.isnan(inverse_langevin(np.array([1.0, 1.5]))[0]).all()


def test_quadrature_of_the_full_network_is_converged(random):
    """Against a Gauss-Legendre product rule of 40 x 40 directions in an octant, up to nine
    tenths of the locking stretch.
    """
    law = pds.materials.FullNetwork(chain_links=20.0)
    u, weight = np.polynomial.legendre.leggauss(40)
    z, angle = (u[:, None] + 1) / 2, np.pi / 4 * (u[None, :] + 1)
    directions = np.stack(
        np.broadcast_arrays((1 - z**2) * np.cos(angle) ** 2, (1 - z**2) * np.sin(angle) ** 2, z**2),
        axis=-1,
    )
    weights = weight[:, None] * weight[None, :] / 4

    def energy(first, second, third):
        y = np.sqrt(directions @ np.array([first, second, third]) ** 2 / 20)
        return (weights * (20 * chain_energy(y, inverse_langevin(y)[0]))).sum()

    N_kT = law.parameters[3]
    for first, second in stretches(random, 20, 0.6, 4.0).T:
        exact = N_kT * (energy(first, second, 1 / (first * second)) - energy(1.0, 1.0, 1.0))
        found = plane_stress.response(
            law, np.array([first**2 + second**2]), np.array([first * second]), np.ones(1)
        )[4]
        assert found[0] == pytest.approx(exact, rel=1e-8, abs=1e-10)


@pytest.mark.parametrize("law", LIMITED, ids=lambda law: law.name)
def test_laws_that_lock_say_where(law):
    parameter = next(iter(law.shape))
    with raising(rf"{law.name}: no plane-stress state at tr C = 72, det F = 36: .*{parameter} = "):
        homogeneous.equibiaxial(law, 6.0)
    past = np.array([72.0]), np.array([36.0]), np.ones(1)
    assert np.isnan(plane_stress.response(law, *past)).all()
    assert np.isnan(compiled_response(law, *past)).all()
    # Just short of it the stress is finite, and far above that of a law without a limit.
    reach = max(
        stretch
        for stretch in np.linspace(1.5, 4, 251)
        if np.isfinite(plane_stress.response(law, 2 * stretch**2 * np.ones(1), stretch**2, 1.0)[0])
    )
    near = plane_stress.response(law, np.array([2 * reach**2]), np.array([reach**2]), np.ones(1))
    assert np.isfinite(near).all()


@pytest.mark.parametrize("law", EXAMPLES, ids=lambda law: f"{law.name}-{law.shear_modulus:g}")
def test_every_law_has_a_surrogate_within_two_thousandths(law):
    samples = pds.training_samples(law, 4000, reachable_stretches(law), random_state=0)
    model = polynomial(samples, (12, 6))
    report = pds.evaluate(
        surrogate_of(model, law, samples).bond_force, law, reachable_stretches(law), 3000
    )
    assert max(report["on_surface"]["rms"], report["off_surface"]["rms"]) < 2e-3
    assert report["at_rest"] < 1e-9


UNPHYSICAL = [
    ("gent", {"chain_limit": 0.0}, "chain_limit must be positive"),
    ("gent", {"chain_limit": -3.0}, "chain_limit must be positive"),
    ("gent", {"chain_limit": np.nan}, "chain_limit must be finite"),
    ("arruda-boyce", {"chain_links": 1.0}, "chain_links must be above 1"),
    ("full-network", {"chain_links": -5.0}, "chain_links must be above 1"),
    ("mooney-rivlin", {"second_share": 1.5}, "second_share must be between 0 and 1"),
    ("mooney-rivlin", {"second_share": -0.1}, "second_share must be between 0 and 1"),
    ("yeoh", {"third": -1e-3}, "stress fall"),
    ("yeoh", {"second": -0.1, "third": 1e-4}, "stress fall"),
    ("ogden", {"moduli": (1.0, 1.0), "exponents": (2.0, -2.0)}, "term 2 needs modulus"),
    ("ogden", {"moduli": (1.0,), "exponents": (0.0,)}, "term 1 needs modulus"),
    ("ogden", {"moduli": (1.0, 2.0), "exponents": (2.0,)}, "lists of equal length"),
    ("ogden", {"moduli": (), "exponents": ()}, "lists of equal length"),
    ("ogden", {"moduli": (np.inf,), "exponents": (2.0,)}, "must be finite"),
    ("ogden", {"shear_modulus": 3.0}, "imply shear_modulus = 1, not 3"),
    ("polyconvex", {"moduli": (1.0,), "exponents": (0.5,)}, "exponents must be at least 1 in size"),
    ("polyconvex", {"first": (0.1, -0.1)}, "first must be at most 4 finite numbers, none negative"),
    ("polyconvex", {"first": (0.0, 1.0)}, "the stiffness at rest is zero"),
]


@pytest.mark.parametrize(("name", "parameters", "message"), UNPHYSICAL)
def test_unphysical_parameters_are_refused(name, parameters, message):
    with raising(f"{name}: .*{message}"):
        LAWS[name](**parameters)


@pytest.mark.parametrize("name", LAWS)
def test_moduli_must_be_positive(name):
    for value in (0.0, -1.0, np.nan, np.inf):
        with raising(f"{name}: .*shear_modulus"):
            LAWS[name](shear_modulus=value)
        with raising(f"{name}: bulk_modulus"):
            LAWS[name](bulk_modulus=value)


def test_ogden_of_a_scene_takes_lists():
    scene = pds.load_scene(
        "uniaxial",
        ["material=ogden", "material.moduli=0.63,0.0012,-0.01", "material.exponents=1.3,5,-2"],
    )
    law = scene.material.build()
    assert law.shear_modulus == pytest.approx(0.4225)
    assert law.bulk_modulus == pytest.approx(42.25)
    assert pds.materials.Ogden().shape == pytest.approx(law.shape)


@pytest.mark.parametrize("precision", ["float32", "float64"])
@pytest.mark.parametrize(
    "law",
    [pds.materials.ArrudaBoyce(), pds.materials.Ogden(bulk_modulus=10.0)],
    ids=lambda law: law.name,
)
def test_thickness_from_the_learned_force(law, precision, random):
    """J3 is off by the force error over K/mu: that of the force, in units of mu, is below 5e-3
    everywhere in this state.
    """
    body = pds.Body.rectangle(1.0, 1.0, 0.1, 0.315)
    samples = pds.training_samples(law, 4000, random_state=0)
    fitted = polynomial(samples, (12, 6))
    model = surrogate_of(fitted, law, samples)
    force = model.bind(body, law, ForceSettings(precision=precision))
    assert force.learned_thickness
    turn = np.array([[0.6, -0.8], [0.8, 0.6]])
    positions = (body.points * [1.9, 0.8] + 0.02 * np.sin(5 * body.points[:, ::-1])) @ turn.T
    out = np.empty_like(positions)
    force(positions, out)
    trace, J = plane_stress.invariants(force.deformation_gradients())
    exact = plane_stress.volume_ratio(law, trace, J)
    found = force.volume_ratios()
    assert np.abs(found / exact - 1).max() < 5e-3 * law.shear_modulus / law.bulk_modulus
    # A surrogate that knows the exact force gives the exact C33; and turned bodies have the same.
    force.place(body.points * [1.9, 0.8])
    straight = force.volume_ratios().copy()
    force.place((body.points * [1.9, 0.8]) @ turn.T)
    np.testing.assert_allclose(force.volume_ratios(), straight, rtol=2e-6)


@dataclass(frozen=True)
class Exponential(InvariantLaw):
    """W = mu/(2 b) (exp(b (I1bar - 3)) - 1), as a user would write it (Demiray, J. Biomech. 5
    (1972) 309).
    """

    name: ClassVar[str] = "exponential"
    reference: ClassVar[str] = "Demiray 1972"

    stiffening: float = 0.05

    @property
    def parameters(self):
        return np.array([self.bulk_modulus / self.shear_modulus, self.stiffening])

    @property
    def shape(self):
        return {"stiffening": self.stiffening}

    @staticmethod
    def isochoric(I1, I2, parameters):
        b = parameters[1]
        growth = np.exp(b * (I1 - 3))
        zero = 0 * I1
        return (growth - 1) / (2 * b), growth / 2, zero, b * growth / 2, zero, zero


@pytest.mark.parametrize(
    ("name", "change"),
    [
        ("W1 is", lambda W, W1, W2, W11, W12, W22: (W, 2 * W1, W2, W11, W12, W22)),
        ("W2 is", lambda W, W1, W2, W11, W12, W22: (W, W1, W2 + 0.01, W11, W12, W22)),
        ("W11 is", lambda W, W1, W2, W11, W12, W22: (W, W1, W2, 0 * W11, W12, W22)),
        ("W12 is", lambda W, W1, W2, W11, W12, W22: (W, W1, W2, W11, W11, W22)),
        ("W22 is", lambda W, W1, W2, W11, W12, W22: (W, W1, W2, W11, W12, W11)),
        ("2 \\(W1 \\+ W2\\)", lambda *values: tuple(2 * value for value in values)),
    ],
)
def test_a_law_with_a_wrong_derivative_is_refused(name, change):
    class Wrong(Exponential):
        @staticmethod
        def isochoric(I1, I2, parameters):
            return change(*Exponential.isochoric(I1, I2, parameters))

    for use in (lambda law: plane_stress.volume_ratio(law, 2.0, 1.0), plane_stress.response.block):
        with raising(f"^exponential: {name}.* but "):
            use(Wrong())


def test_wrong_volumetric_and_principal_stretch_derivatives_are_refused():
    class Volume(pds.materials.NeoHookean):
        @staticmethod
        def volumetric(J3, parameters):
            U, dU, ddU = pds.materials.NeoHookean.volumetric(J3, parameters)
            return U, dU, ddU / 2

    with raising("neo-hookean: U'' is 50 at J3 = 1, but by finite differences 100"):
        plane_stress.volume_ratio(Volume(), 2.0, 1.0)
    for row, name in enumerate(("g1", "g2", "g3", "h"), start=1):

        class Stretch(pds.materials.Ogden):
            @staticmethod
            def term(*arguments, row=row):
                values = list(pds.materials.Ogden.term(*arguments))
                values[row] = 2 * values[row]
                return tuple(values)

        with raising(f"ogden: {name} is"):
            plane_stress.volume_ratio(Stretch(), 2.0, 1.0)


def test_the_check_of_a_law_lets_sound_ones_pass():
    """Near their limits and far from them, and where rounding of the energy is felt."""
    laws = [pds.materials.Gent(chain_limit=limit) for limit in (0.01, 1e9)] + [
        pds.materials.ArrudaBoyce(chain_links=links) for links in (1.01, 1e7)
    ]
    for law in [
        *laws,
        *LIMITED,
        *EXAMPLES,
        pds.materials.Yeoh(second=10.0, third=10.0),
        pds.materials.Ogden(moduli=(1e-4, 1.0), exponents=(20.0, 2.0)),
    ]:
        check_consistency(law)


def test_a_law_whose_limit_lies_at_a_checked_state_is_consistent():
    """At I1bar - 3 = 8.638 a step passes the limit, so that there is no difference to compare
    with.
    """
    for limit in np.linspace(8.639, 8.66, 8):
        check_consistency(pds.materials.Gent(chain_limit=limit))
