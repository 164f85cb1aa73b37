"""Exported files against the stresses of the package and their numerical differences, in random
states.
"""

import ctypes
import importlib.util
import shutil
import subprocess
import sys

import numpy as np
import pytest
from refusals import raising

import pdsurrogate as pds
from pdsurrogate.export import TARGETS, exported, file_name, source_of_artifact, source_of_law
from pdsurrogate.materials import LAWS, PLANES, InvariantLaw, Law

N_STATES, LEAST, GREATEST = 1000, 0.5, 3.0
STRESS, TANGENT = 1e-10, 1e-8
NETWORKS = (
    "neo-hookean-isochoric",
    "arruda-boyce-isochoric",
    "full-network-isochoric",
    "ogden-isochoric",
    "neo-hookean-energy",
)

needs_cc = pytest.mark.skipif(shutil.which("cc") is None, reason="needs a C compiler, cc")
needs_gfortran = pytest.mark.skipif(
    shutil.which("gfortran") is None, reason="needs gfortran (Debian package gfortran)"
)


def soft(law):
    """The law with a bulk modulus that does not hide the isochoric stress, and a shear modulus
    that is not 1.
    """
    values = {**law().describe(), "bulk_modulus": 7.5, "shear_modulus": 2.5}
    law = LAWS[values.pop("law")]
    if hasattr(law, "lists"):
        values |= {
            "shear_modulus": None,
            "moduli": (0.6, -0.1),
            "exponents": (1.3, -2.0),
            "first": (0.4, 0.01, 1e-3),
            "second": (0.1, 0.02),
        }
        values = {key: value for key, value in values.items() if key in law.__dataclass_fields__}
    return law(**values)


SOURCES = {name: lambda name=name: source_of_law(soft(LAWS[name])) for name in LAWS}
SOURCES |= {name: lambda name=name: source_of_artifact(name) for name in NETWORKS}


@pytest.fixture(scope="module", params=SOURCES)
def source(request):
    return SOURCES[request.param]()


@pytest.fixture(scope="module")
def expected(source):
    return states_of(source)


def states_of(source):
    """Deformation gradients, some with equal or nearly equal stretches, with energy, stress and
    tangent of the package.
    """
    d, random = 2 if source.is_sheet else 3, np.random.default_rng(7)
    low, high = LEAST, GREATEST
    if source.is_sheet:
        low, high = source.network.domain.least_stretch, source.network.domain.greatest_stretch
    logs = random.uniform(np.log(low), np.log(high), (N_STATES, d))
    logs[:50, 0] = logs[:50, 1]
    logs[50:100, 0] = logs[50:100, 1] + 10.0 ** random.uniform(-12, -1, 50)
    logs[100:150] = 10.0 ** random.uniform(-12, -1, (50, 1)) * random.standard_normal((50, d))
    if d == 3:
        # The volume changes by up to a third.
        logs -= (logs.mean(axis=1) - random.uniform(-0.1, 0.1, N_STATES))[:, None]
        logs = logs.clip(np.log(low), np.log(high))
    turns = np.linalg.qr(random.standard_normal((2, N_STATES, d, d)))[0]
    F = turns[0] @ (np.exp(logs)[:, :, None] * turns[1])
    F[np.linalg.det(F) < 0] = F[np.linalg.det(F) < 0][:, ::-1]
    F[0] = np.eye(d)
    tangent = np.empty((N_STATES, d, d, d, d))
    for k in range(d):
        for el in range(d):
            tangent[..., k, el] = slope_of(
                lambda G: source.energy_and_stress(G)[1], F, np.eye(d)[:, [k]] * np.eye(d)[el]
            )
    return F, *source.energy_and_stress(F), tangent


def slope_of(function, F, direction, step=1e-3):
    """Derivative along a direction by central differences of the sixth order."""
    ahead = [
        function(F + k * step * direction) - function(F - k * step * direction) for k in (1, 2, 3)
    ]
    return (45 * ahead[0] - 9 * ahead[1] + ahead[2]) / (60 * step)


def assert_close(found, expected, answers, source, allowed=STRESS):
    """Values deviate by at most `allowed` of the greatest stress or modulus, those of a tangent
    of its greatest entry.
    """
    size = np.maximum(abs(answers[1]).max(axis=(1, 2)), source.law.shear_modulus)
    if allowed == TANGENT:
        size = abs(answers[2]).max(axis=(1, 2, 3, 4))
    for values, right in zip(found, expected, strict=True):
        deviation = abs(values - right).reshape(N_STATES, -1).max(axis=1)
        assert (deviation <= allowed * size).all()


def far_outside(source):
    """A state beyond every domain of a shipped artifact."""
    return np.diag([30.0, 30.0, 30.0**-2])[: 3 - source.is_sheet, : 3 - source.is_sheet].copy()


def assert_all_close(found, answers, source):
    """Compare energies, stresses and tangents, found and right."""
    assert_close(found[:2], answers[:2], answers, source)
    assert_close(found[2:], answers[2:], answers, source, TANGENT)


def written(source, target, folder):
    path = folder / file_name(source, target)
    path.write_text(exported(source, target))
    return path


def imported(path):
    spec = importlib.util.spec_from_file_location(path.stem, path)
    module = importlib.util.module_from_spec(spec)
    spec.loader.exec_module(module)
    return module


def library(path, tmp_path, *command):
    """Shared library that a compiler makes of a source file."""
    made = tmp_path / f"{path.stem}.so"
    subprocess.run(
        [*command, "-shared", "-fPIC", "-O1", path, "-lm", "-o", made], check=True, cwd=tmp_path
    )
    return ctypes.CDLL(str(made))


def address(array):
    return array.ctypes.data_as(ctypes.c_void_p)


def test_felupe_file(source, expected, tmp_path):
    path = written(source, "felupe", tmp_path)
    module = imported(path)
    F, *answers = expected
    assert_all_close(module.evaluate(F, *source.moduli), answers, source)
    material = module.Material()
    x = [np.moveaxis(F.reshape(10, 100, *F.shape[1:]), (2, 3), (0, 1)), None]
    for found, answer in zip(
        (material.function(x), material.gradient(x), material.hessian(x)), answers, strict=True
    ):
        d = answer.ndim - 1
        moved = np.moveaxis(found[0], range(d), range(-d, 0)) if d else found[0]
        assert np.allclose(
            moved.reshape(answer.shape), answer, rtol=1e-6, atol=1e-6 * abs(answer).max()
        )
    if source.network is not None:
        inside = module.inside(np.stack([np.eye(F.shape[-1]), far_outside(source)]))
        assert inside.tolist() == [True, False]
    subprocess.run([sys.executable, path], check=True)


@needs_cc
def test_c_header(source, expected, tmp_path):
    path = written(source, "c", tmp_path)
    name, d = path.stem, 2 if source.is_sheet else 3
    moduli = ["double mu", "double K"][: len(source.moduli)]
    passed = ", ".join(text.split()[1] for text in moduli)
    code = tmp_path / "all.c"
    code.write_text(
        f'#include "{path.name}"\n'
        f"void all(int n, const double *F, {', '.join(moduli)}, double *e, double *P, double *A)"
        " {\n"
        f"  for (int k = 0; k < n; k++) {{\n"
        f"    e[k] = {name}_energy(F + {d**2} * k, {passed});\n"
        f"    {name}_stress(F + {d**2} * k, {passed}, P + {d**2} * k);\n"
        f"    {name}_tangent(F + {d**2} * k, {passed}, A + {d**4} * k);\n"
        f"  }}\n}}\n"
        + f"int inside(const double *F) {{ return {name}_inside(F); }}\n"
        * (source.network is not None)
    )
    F, *answers = expected
    found = [np.empty_like(answer) for answer in answers]
    made = library(
        code,
        tmp_path,
        "cc",
        "-std=c99",
        "-Wall",
        "-Werror",
        "-Wno-unused-function",
        "-Wno-unused-variable",
    )
    made.all(N_STATES, address(F), *map(ctypes.c_double, source.moduli), *map(address, found))
    assert_all_close(found, answers, source)
    if source.network is not None:
        assert [made.inside(address(state)) for state in (np.eye(d), far_outside(source))] == [1, 0]


@needs_cc
def test_the_check_of_a_header_finds_a_changed_constant(tmp_path):
    path = written(source_of_law(pds.materials.Gent()), "c", tmp_path)

    def status():
        subprocess.run(
            ["cc", "-x", "c", "-Dgent_check", path, "-lm", "-o", tmp_path / "check"], check=True
        )
        return subprocess.run([tmp_path / "check"]).returncode

    assert status() == 0
    path.write_text(path.read_text().replace("120.0;", "120.001;"))
    assert status() == 1


II, JJ = np.array([0, 1, 2, 0, 0, 1]), np.array([0, 1, 2, 1, 2, 2])


class UMAT:
    """A compiled UMAT, called with the arguments of Abaqus."""

    def __init__(self, source, tmp_path):
        self.moduli = np.array(source.moduli)
        self.call = library(
            written(source, "umat", tmp_path),
            tmp_path,
            "gfortran",
            "-Wall",
            "-Wno-unused-dummy-argument",
        ).umat_

    def __call__(self, F, ntens, state=None, duration=0.0):
        """Stress, tangent, factor of the increment, energy and state variable; `state` becomes
        that at the end of the increment.
        """
        full = np.eye(3)
        full[: len(F), : len(F)] = F
        stress, tangent = np.zeros(ntens), np.zeros((ntens, ntens), order="F")
        state = np.zeros(1) if state is None else state
        zeros = [
            np.zeros(shape) for shape in (ntens, ntens, ntens, ntens, 2, 1, 1, 3, (3, 3), (3, 3))
        ]
        ddsddt, drplde, strain, dstrain, time, predef, dpred, coordinates, turn, before = map(
            address, zeros
        )
        number, pnewdt, sse, props = (
            ctypes.byref(ctypes.c_double(0)),
            ctypes.c_double(1),
            ctypes.c_double(0),
            self.moduli,
        )
        after, steps = np.asfortranarray(full), np.zeros(4, dtype=np.int32)

        def whole(value):
            return ctypes.byref(ctypes.c_int(value))

        self.call(
            *(
                address(stress),
                address(state),
                address(tangent),
                ctypes.byref(sse),
                number,
                number,
                number,
                ddsddt,
            ),
            *(
                drplde,
                number,
                strain,
                dstrain,
                time,
                ctypes.byref(ctypes.c_double(duration)),
                number,
                number,
                predef,
                dpred,
                b" " * 80,
            ),
            *(
                whole(3),
                whole(ntens - 3),
                whole(ntens),
                whole(len(state)),
                address(props),
                whole(len(props)),
                coordinates,
                turn,
            ),
            *(
                ctypes.byref(pnewdt),
                number,
                before,
                address(after),
                *map(whole, (1, 1, 1, 1)),
                address(steps),
                whole(1),
            ),
            ctypes.c_size_t(80),
        )
        return stress, tangent, pnewdt.value, sse.value, state[0]


def jaumann(kirchhoff, F, order):
    """Tangents of the Jaumann rate of a Kirchhoff stress ``kirchhoff(F)`` at gradients (..., d, d),
    along symmetric rates of deformation, by differences.
    """
    columns = []
    for n in order:
        rate = np.zeros((3, 3))
        rate[II[n], JJ[n]] += 0.5
        rate[JJ[n], II[n]] += 0.5
        rate = rate[: F.shape[-1], : F.shape[-1]]
        columns.append(slope_of(kirchhoff, F, rate @ F)[..., II[order], JJ[order]])
    return np.stack(columns, axis=-1)


@needs_gfortran
def test_umat(source, expected, tmp_path):
    umat = UMAT(source, tmp_path)
    order = np.array([0, 1, 3]) if source.is_sheet else np.arange(6)

    def kirchhoff(F):
        return source.energy_and_stress(F)[1] @ F.swapaxes(1, 2)

    mu = source.law.shear_modulus
    states = expected[0][::10]
    energies = expected[1][::10]
    J = np.ones(len(states)) if source.is_sheet else np.linalg.det(states)
    stresses = kirchhoff(states)[:, II[order], JJ[order]] / J[:, None]
    tangents = jaumann(kirchhoff, states, order) / J[:, None, None]
    for F, exact, slopes, W in zip(states, stresses, tangents, energies, strict=True):
        stress, tangent, factor, energy, outside = umat(F, len(order))
        assert abs(stress - exact).max() <= STRESS * max(abs(exact).max(), mu)
        assert energy == pytest.approx(W, abs=STRESS * mu)
        assert abs(tangent - slopes).max() <= TANGENT * abs(tangent).max()
        assert (factor, outside) == (1.0, 0.0)
    if source.network is not None:
        assert umat(far_outside(source), len(order))[4] == 1.0
    broken = umat(-expected[0][0] if not source.is_sheet else expected[0][0][::-1], len(order))
    assert np.isnan(broken[0]).all()
    assert broken[2] < 1


@needs_gfortran
@pytest.mark.parametrize("name", ["gent", "ogden"])
def test_umat_of_sheets(name, tmp_path):
    """Plane stress eliminates the stress across, plane strain has the components 11, 22, 33, 12."""
    law = soft(LAWS[name])
    umat = UMAT(source_of_law(law), tmp_path)
    F = np.array([[1.6, 0.3], [-0.2, 0.8]])
    J3 = float(PLANES["stress"].volume_ratio(law, *PLANES["stress"].invariants(F)))

    def kirchhoff(F):
        return PLANES["stress"].first_piola_stress(law, F) @ F.T

    order = np.array([0, 1, 3])
    stress, tangent, *_ = umat(F, 3)
    assert np.allclose(stress, kirchhoff(F)[II[order], JJ[order]] / J3, rtol=1e-10)
    assert np.allclose(
        tangent, jaumann(kirchhoff, F, order) / J3, atol=TANGENT * abs(tangent).max()
    )
    J3, P, _ = PLANES["strain"].exact(law, F)
    stress, tangent, *_ = umat(F, 4)
    cauchy = np.block([[P[:2, :2] @ F.T, np.zeros((2, 1))], [np.zeros((1, 2)), P[2:, 2:]]]) / J3
    assert np.allclose(stress, cauchy[II[:4], JJ[:4]], rtol=1e-10)
    assert np.allclose(tangent, umat(F, 6)[1][:4, :4], rtol=1e-12)


def evaluated(expression, values):
    """Values of a UFL expression, of shape (N_STATES, *shape); `values` are those of variables.

    Arrays have an axis of states, one for each free index by its number, and those of the shape.
    """
    from ufl import classes
    from ufl.algorithms.apply_algebra_lowering import apply_algebra_lowering
    from ufl.algorithms.apply_derivatives import apply_derivatives
    from ufl.algorithms.remove_complex_nodes import remove_complex_nodes
    from ufl.corealg.traversal import unique_post_traversal

    functions = {
        classes.Sqrt: np.sqrt,
        classes.Exp: np.exp,
        classes.Ln: np.log,
        classes.Tanh: np.tanh,
        classes.Conditional: np.where,
        classes.Sum: np.add,
        classes.Product: np.multiply,
        classes.Division: np.divide,
        classes.Power: np.power,
        classes.GT: np.greater,
        classes.LT: np.less,
    }

    def ordered(array, before, after):
        """An array with other axes of free indices; of an index that occurs twice, the diagonal."""
        labels = {index: label for label, index in enumerate(dict.fromkeys(before), start=1)}
        rows = ([0, *(labels[index] for index in row)] for row in (before, after))
        return np.einsum(array, *rows)

    def spread(node, indices):
        """Value of an operand with an axis for each of the indices."""
        found = known[node]
        for place, index in enumerate(indices):
            if index not in node.ufl_free_indices:
                found = np.expand_dims(found, place + 1)
        return found

    known = dict(values)
    expression = apply_derivatives(remove_complex_nodes(apply_algebra_lowering(expression)))
    for node in unique_post_traversal(expression):
        if node in known or isinstance(node, classes.Label | classes.MultiIndex):
            continue
        free = getattr(node, "ufl_free_indices", ())
        first, *rest = node.ufl_operands or (None,)
        if isinstance(node, classes.Zero):
            found = np.zeros((1, *[1] * len(free), *node.ufl_shape))
        elif isinstance(node, classes.ScalarValue):
            found = np.full(1, float(node))
        elif isinstance(node, classes.Identity):
            found = np.eye(node.ufl_shape[0])[None]
        elif isinstance(node, classes.ListTensor):
            parts = np.broadcast_arrays(*(spread(one, free) for one in node.ufl_operands))
            found = np.stack(parts, axis=1 + len(free))
        elif isinstance(node, classes.IndexSum):
            place = first.ufl_free_indices.index(rest[0][0].count())
            found = known[first].sum(axis=1 + place)
        elif isinstance(node, classes.ComponentTensor):
            order = [*free, *(index.count() for index in rest[0])]
            found = ordered(known[first], first.ufl_free_indices, order)
        elif isinstance(node, classes.Indexed):
            numbers = [
                int(one) if isinstance(one, classes.FixedIndex) else slice(None) for one in rest[0]
            ]
            left = [one.count() for one in rest[0] if not isinstance(one, classes.FixedIndex)]
            taken = known[first][(..., *numbers)]
            found = ordered(taken, [*first.ufl_free_indices, *left], free)
        else:
            found = functions[type(node)](*(spread(one, free) for one in node.ufl_operands))
        known[node] = found
    return known[expression]


def variable(values):
    """A matrix of UFL that stands for values of shape (N_STATES, d, d)."""
    ufl = pytest.importorskip("ufl", reason="needs fenics-ufl")
    return ufl.variable(ufl.as_matrix(values[0].tolist()))


@pytest.mark.parametrize(
    "name",
    [pytest.param(name, marks=[pytest.mark.slow] * (name == "full-network")) for name in SOURCES],
)
def test_ufl_file(name, tmp_path):
    """Among the states are that at rest, and equal and nearly equal stretches."""
    source = SOURCES[name]()
    F, energy, stress, tangent = states_of(source)
    module = imported(written(source, "ufl", tmp_path))
    H = np.random.default_rng(3).standard_normal(F.shape)
    state, change = variable(F), variable(H)
    values = {state: F, change: H}
    with np.errstate(all="ignore"):  # the values that conditions leave out
        found = [
            evaluated(expression, values)
            for expression in (
                module.psi(state),
                module.stress(state),
                module.tangent(state, change),
            )
        ]
    answers = energy, stress, np.einsum("nijkl,nkl->nij", tangent, H)
    assert_close(found[:2], answers[:2], (energy, stress, tangent), source)
    assert_close(found[2:], answers[2:], (energy, stress, tangent), source, TANGENT)


def test_ufl_differentiates_an_exported_energy(tmp_path):
    ufl = pytest.importorskip("ufl", reason="needs fenics-ufl")
    source = SOURCES["ogden"]()
    F, _, *answers = states_of(source)
    H = np.random.default_rng(3).standard_normal(F.shape)
    state, change, t = variable(F), variable(H), ufl.variable(ufl.as_ufl(0.5))
    energy = imported(written(source, "ufl", tmp_path)).psi(state + t * change)
    slope = ufl.diff(energy, t)
    with np.errstate(all="ignore"):  # the values that conditions leave out
        found, second = (
            evaluated(expression, {state: F, change: H, t: np.zeros(1)})
            for expression in (slope, ufl.diff(slope, t))
        )
    stress, tangent = answers
    assert_close([found], [np.einsum("nij,nij->n", stress, H)], (None, *answers), source)
    right = np.einsum("nijkl,nij,nkl->n", tangent, H, H)
    assert_close([second], [right], (None, *answers), source, TANGENT)


def test_laws_that_end_soon_are_checked_within_their_limit(tmp_path):
    source = source_of_law(pds.materials.Gent(chain_limit=0.02))
    path = written(source, "felupe", tmp_path)
    subprocess.run([sys.executable, path], check=True)
    assert "nan" not in path.read_text().partition("STATES")[2]
    assert np.isnan(imported(path).evaluate(np.diag([1.5, 0.8, 0.8]), *source.moduli)[1]).all()


class Exponential(InvariantLaw):
    """W = mu/(2 b) (exp(b (I1bar - 3)) - 1)."""

    name, reference = "exponential", "Demiray 1972"

    @staticmethod
    def isochoric(I1, I2, parameters):
        growth = np.exp(0.05 * (I1 - 3))
        zero = 0 * I1
        return (growth - 1) / 0.1, growth / 2, zero, 0.05 * growth / 2, zero, zero


def test_own_laws_are_exported():
    text = exported(source_of_law(Exponential()), "c")
    assert "const double t1 = exp(0.05 * (I1 - 3.0));" in text
    assert "W[1] = t1 / 2.0;" in text


def with_isochoric(function):
    return type("Own", (Exponential,), {"isochoric": staticmethod(function)})()


def test_expressions_that_other_languages_lack_are_refused():
    zero = (0.0, 0.0, 0.0)
    branching = with_isochoric(
        lambda I1, I2, parameters: (
            (I1 - 3) / 2 if np.all(I1 > 0) else I1,
            0.5 + 0 * I1,
            0.0,
            *zero,
        )
    )
    with raising("exponential: its expressions use all, which cannot be exported"):
        exported(source_of_law(branching), "c")
    strange = with_isochoric(
        lambda I1, I2, parameters: ((I1 - 3) / 2 + 0 * np.arctan(I1), 0.5 + 0 * I1, 0.0, *zero)
    )
    with raising("exponential: its expressions use arctan"):
        exported(source_of_law(strange), "umat")

    class Nameless(Law):
        name, reference = "nameless", "none"

    with raising("nameless: this is neither an InvariantLaw nor a PrincipalStretchLaw"):
        source_of_law(Nameless())


@pytest.mark.parametrize("target", TARGETS)
def test_headers_say_what_a_file_is(target):
    card = pds.load_card("ogden-isochoric")
    text = " ".join(
        exported(source_of_artifact("ogden-isochoric"), target)
        .replace("\nC ", " ")
        .replace("\n * ", " ")
        .split()
    )
    for words in (
        "ogden-isochoric@1",
        f"Written by pdsurrogate {pds.__version__}.",
        f"digest {card.found_digest()}.",
        "isochoric principal stretches from 0.25 to 4. Outside, the network is extrapolated",
        "have the unit of the shear modulus",
        "Use: ",
    ):
        assert words in text
    assert (
        "Parameters: shear_modulus = 1.0, bulk_modulus = 200.0, chain_limit = 120.0."
        in " ".join(exported(source_of_artifact("gent@1"), "felupe").split())
    )
    assert exported(source_of_artifact("ogden-isochoric"), target) == exported(
        source_of_artifact("ogden-isochoric"), target
    )


def test_fortran_fits_into_72_columns():
    for make in SOURCES.values():
        source = make()
        for target in ("umat", "calculix-umat")[: 2 - source.is_sheet]:
            assert max(map(len, exported(source, target).splitlines())) <= 72


def test_calculix_has_no_elements_for_the_energy_of_a_sheet():
    with raising(r"CalculiX computes sheets as solids.*neo-hookean, which"):
        exported(source_of_artifact("neo-hookean-energy"), "calculix-umat")
