"""Forces that users write in Python: they run, they become artifacts, and what is wrong with one
is said.
"""

import numpy as np
import pytest
from own_forces import MyEnergy, MyRubber
from refusals import raising

import pdsurrogate as pds
from pdsurrogate.forces import ForceSettings, OwnBondForce, OwnForceFailed
from pdsurrogate.run.simulate import SimulationFailed
from pdsurrogate.scenes import SceneError

LAWS = [
    (MyRubber(), pds.materials.NeoHookean()),
    (MyEnergy(), pds.materials.MooneyRivlin(second_share=0.2)),
]


@pytest.mark.parametrize(("own", "law"), LAWS, ids=["force", "energy"])
def test_the_forces_are_those_of_the_law(own, law):
    """On every bond, and of a torn sheet, tensor correction and broken bonds included: with the
    exact force to rounding.
    """
    X = pds.training_samples(law, 500, random_state=0).X
    exact = pds.AnalyticBondForce(law)
    np.testing.assert_allclose(
        OwnBondForce(own).bond_force(*X.T), exact.bond_force(*X.T), rtol=1e-12, atol=1e-12
    )
    body = pds.Body.rectangle(1.0, 0.7, 0.05, 0.158)
    forces = []
    for model in (OwnBondForce(own), exact):
        bound = model.bind(body, law, ForceSettings(breakable=True))
        x1, x2 = body.points.T
        out = np.empty_like(body.points)
        bound.break_bonds(np.arange(0, len(body.bonds.first), 7))
        bound(
            np.stack([1.4 * x1 + 0.05 * np.sin(9 * x2), 0.8 * x2 + 0.05 * np.sin(7 * x1)], axis=1),
            out,
        )
        forces.append(out)
    assert np.abs(forces[0] - forces[1]).max() < 1e-10 * np.abs(forces[1]).max()


@pytest.mark.parametrize(("own", "law"), LAWS, ids=["force", "energy"])
def test_it_runs_and_becomes_an_artifact(own, law, tmp_path):
    scene = pds.load_scene("uniaxial", spacing=0.1, stretches=1.5, material=law.describe())
    exact = pds.simulate(scene, "analytic").levels[0]["nominal_stress"]
    assert pds.simulate(scene, own).levels[0]["nominal_stress"] == pytest.approx(exact, rel=1e-7)
    path = pds.store(
        own,
        pds.training_samples(law, 500, (0.6, 2.0), random_state=0),
        law,
        tmp_path,
        "own",
        "1",
        "x",
    )
    assert pds.simulate(scene, path).levels[0]["nominal_stress"] == pytest.approx(exact, rel=2e-5)
    assert pds.evaluate(own, law, (0.6, 2.0), 300)["on_surface"]["max"] < 1e-12


class Wrong:
    def __init__(self, answer):
        self.answer = answer

    def bond_force(self, stretch, rotation, length, C33, J):
        return self.answer(stretch)


@pytest.mark.parametrize(
    ("answer", "message"),
    [
        (
            lambda stretch: stretch,
            (
                r"bond_force must return t_n, t_tau, an array of shape \(n, 2\) .*, not float64 of"
                r" shape \(4,\), for n = 4"
            ),
        ),
        (
            lambda stretch: np.full((len(stretch), 2), np.nan),
            (
                r"Wrong: bond_force returned t_n = nan, t_tau = nan, which is not finite, at"
                r" stretch = 1, rotation = 0"
            ),
        ),
        (lambda stretch: 1 / 0, "Wrong: ZeroDivisionError: division by zero"),
    ],
)
def test_a_force_that_cannot_work_says_so_before_the_run(answer, message):
    with raising(message, SceneError):
        pds.simulate(pds.load_scene("uniaxial", spacing=0.2, stretches=1.2), Wrong(answer))


def test_an_energy_gives_its_derivatives():
    class Half:
        def energy(self, I1bar, I2bar):
            return I1bar - 3

    with raising("energy must return W, dW/dI1bar, dW/dI2bar, a tuple", SceneError):
        pds.simulate(pds.load_scene("uniaxial", spacing=0.2, stretches=1.2), Half())


def test_an_error_on_the_way_is_the_users_own():
    """It comes out of compiled code, with what was reached."""

    class Ends(MyRubber):
        def bond_force(self, stretch, rotation, length, C33, J):
            if stretch.max() > 1.35:
                raise LookupError("no table beyond 1.35")
            return super().bond_force(stretch, rotation, length, C33, J)

    with raising(r"Ends: LookupError: no table beyond 1\.35", SimulationFailed) as failed:
        pds.simulate(pds.load_scene("uniaxial", spacing=0.2, stretches=[1.2, 1.5]), Ends())
    assert len(failed.value.result.levels) == 1
    assert isinstance(failed.value.__cause__, OwnForceFailed)


def test_what_it_does_not_take_is_said():
    with raising("MyRubber does not support precision=float32", SceneError):
        pds.simulate(pds.load_scene("uniaxial", spacing=0.2, precision="float32"), MyRubber())
    with raising("MyRubber does not support plane=strain", SceneError):
        pds.simulate(pds.load_scene("plane-strain-block", spacing=0.2), MyRubber())
    for wrong in (MyRubber, 3, object()):
        with raising("or have bond_force or energy", TypeError):
            pds.simulate("uniaxial", wrong)


class Off(MyRubber):
    """The same with a mistake."""

    def __init__(self, mistake):
        self.mistake = mistake

    def bond_force(self, stretch, rotation, length, C33, J):
        return self.mistake(super().bond_force(stretch, rotation, length, C33, J), rotation)


@pytest.mark.parametrize(
    ("mistake", "message"),
    [
        (
            lambda force, rotation: np.add(force, [0.05, 0]),
            r"Off is not zero at rest; .*: off by 0\.05 at stretch = 1, rotation = 0, length = 1",
        ),
        (
            lambda force, rotation: force * [1, 0],
            "Off is not isotropic: the stress by the bond and that across it has not the axes",
        ),
        (
            lambda force, rotation: force * (1 + 0.2 * rotation)[:, None],
            (
                "Off distinguishes one sense of rotation from the other; .*: off by .* at stretch"
                " = 1.3"
            ),
        ),
    ],
)
def test_a_force_of_no_rubber_is_refused_before_the_run(mistake, message):
    with raising(message, SceneError):
        pds.simulate(pds.load_scene("uniaxial", spacing=0.2, stretches=1.2), Off(mistake))


def test_a_slightly_wrong_force_is_warned_of():
    with pytest.warns(UserWarning, match="Off is not zero at rest"):
        OwnBondForce(Off(lambda force, rotation: np.add(force, [5e-3, 0]))).check_material(
            pds.materials.NeoHookean()
        )


@pytest.mark.parametrize(
    ("slopes", "name"), [((0.44, 0.1), "dW/dI1bar"), ((0.4, 0.12), "dW/dI2bar")]
)
def test_a_derivative_that_is_none_is_refused(slopes, name):
    """With the place and both values."""

    class Slip(MyEnergy):
        def energy(self, I1bar, I2bar):
            return super().energy(I1bar, I2bar)[0], *slopes

    given, right = (slopes[0], 0.4) if name.endswith("1bar") else (slopes[1], 0.1)
    said = rf"Slip: {name} is {given} at I1bar = .*, I2bar = .*, but by finite differences {right}"
    with raising(said, SceneError):
        pds.simulate(pds.load_scene("uniaxial", spacing=0.2, stretches=1.2), Slip())


class WithLimit:
    """Gent's energy in the precision asked for."""

    def __init__(self, dtype=float):
        self.dtype = dtype

    def energy(self, I1bar, I2bar):
        x = (np.asarray(I1bar, self.dtype) - 3) / self.dtype(30)
        with np.errstate(
            invalid="ignore", divide="ignore"
        ):  # at trial states beyond the limit, which the solver then avoids
            return -15 * np.log(1 - x), self.dtype(0.5) / (1 - x), 0 * x


GENT = {"law": "gent", "chain_limit": 30.0}


def stretched(own, *stretches, **changes):
    return pds.simulate(
        pds.load_scene("uniaxial", spacing=0.25, stretches=stretches, **changes), own
    )


@pytest.mark.filterwarnings("error::UserWarning")
@pytest.mark.parametrize("dtype", [np.float64, np.float32])
def test_a_right_energy_passes_wherever_a_run_goes(dtype):
    """To I1bar = 29 of the 33 at which it ends, where difference quotients are worst, and in
    single precision too.
    """
    found = stretched(WithLimit(dtype), 1.5, 5.2, material=GENT).levels[-1]["nominal_stress"]
    assert found == pytest.approx(
        stretched("analytic", 1.5, 5.2, material=GENT).levels[-1]["nominal_stress"], rel=1e-5
    )


class Energy:
    def __init__(self, W, W1, W2):
        self.W, self.W1, self.W2 = W, W1, W2

    def energy(self, I1bar, I2bar):
        return self.W(I1bar, I2bar), self.W1 + 0 * I1bar, self.W2 + 0 * I2bar


def test_an_energy_of_another_modulus_is_said():
    """A factor of 2 that was forgotten."""
    halved = Energy(lambda I1, I2: 0.2 * (I1 - 3) + 0.05 * (I2 - 3), 0.2, 0.05)
    with pytest.warns(UserWarning, match=r"Energy: .* divided by the shear modulus, .* it is 0\.5"):
        pds.simulate(pds.load_scene("uniaxial", spacing=0.25, stretches=1.1), halved)


def test_a_value_that_is_not_finite_is_named_before_the_run():
    cut = Energy(lambda I1, I2: np.where(I1 > 4, np.nan, 0.4 * (I1 - 3) + 0.1 * (I2 - 3)), 0.4, 0.1)
    with raising(r"Energy: .* W = nan, .* at I1bar = 4\.5", SceneError):
        pds.simulate(pds.load_scene("uniaxial", spacing=0.25, stretches=1.1), cut)
