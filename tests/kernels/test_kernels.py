"""Kernels against plain twins written for reading."""

import subprocess
import sys

import numpy as np
import pytest
from bodies import disc_with_hole, gripped_sheet, jittered, sheet

from pdsurrogate.engine import vector_loads
from pdsurrogate.engine.block_arrays import BLOCK
from pdsurrogate.engine.compile import CompilationClock, compilation_clock, kernel
from pdsurrogate.forces.kinematics import Kinematics
from pdsurrogate.forces.material_points import MaterialPoints
from pdsurrogate.kernels.algebra import algebra_of
from pdsurrogate.kernels.steps import greatest_strain
from pdsurrogate.materials import NeoHookean, plane_stress


def wavy(points, size=0.03):
    """A smooth inhomogeneous deformation."""
    x1, x2 = points.T
    return np.stack([1.3 * x1 + size * np.sin(4 * x2), 0.9 * x2 + 0.2 * x1 + size * np.cos(5 * x1)], axis=1)


@pytest.mark.parametrize("make", [sheet, disc_with_hole, gripped_sheet])
def test_deformation_gradients_against_the_sum(make):
    body = make()
    kinematics = Kinematics(body, "float64")
    kinematics.place(body.points + 0.1 * (wavy(body.points) - body.points))
    bonds, x, y = body.bonds, body.all_points, kinematics.positions
    for i in range(len(body)):
        mine = slice(int(bonds.pointers[i]), int(bonds.pointers[i + 1]))
        j = bonds.neighbors[mine]
        bond = x[j] - x[i]
        weight = body.weigh(np.linalg.norm(bond, axis=1)) * body.all_volumes[j]
        K = np.einsum("b,bi,bj->ij", weight, bond, bond)
        F = np.einsum("b,bi,bj->ij", weight, y[j] - y[i], bond) @ np.linalg.inv(K)
        np.testing.assert_allclose(kinematics.deformation_gradients()[i], F, rtol=1e-11, atol=1e-11)


def test_gradients_of_images_equal_the_sum_over_their_own_horizon():
    """The gradients of ghosts against a body in which the far side is really there."""
    for parity in ((-1, 1), (-1, -1)):
        half = gripped_sheet(parity)
        kinematics = Kinematics(half, "float64")
        displacement = 0.05 * np.sin(3 * half.points) * half.points[:, ::-1]
        kinematics.place(half.points + displacement)
        kinematics.form_gradients()
        # The whole neighborhood of the left plane: the sheet and its full reflection.
        reflected = half.points * [-1, 1]
        both = np.vstack([half.points, reflected])
        y = np.vstack([half.points + displacement, reflected + displacement * parity])
        for number in np.flatnonzero(half.ghosts.plane == 0):
            bond = both - half.ghosts.points[number]
            length = np.linalg.norm(bond, axis=1)
            near = (length > 1e-9) & (length <= half.horizon * (1 + 1e-9))
            weight = half.weigh(length[near])
            own = kinematics.positions[len(half) + number]
            K = np.einsum("b,bi,bj->ij", weight, bond[near], bond[near])
            F = np.einsum("b,bi,bj->ij", weight, y[near] - own, bond[near]) @ np.linalg.inv(K)
            record = kinematics.gradients[len(half) + number].reshape(2, 2).T
            np.testing.assert_allclose(record, F, atol=1e-11)


def test_node_states_solve_plane_stress(random):
    body, law = jittered(random), NeoHookean(1, 50)
    kinematics = Kinematics(body, "float64")
    points = MaterialPoints(kinematics, law, "float64")
    kinematics.place(wavy(body.points))
    points.find()
    F = kinematics.deformation_gradients()
    trace, J = plane_stress.invariants(F)
    np.testing.assert_allclose(points.records[:, 2], J, rtol=1e-12)
    np.testing.assert_allclose(points.records[:, 3], plane_stress.thickness_stretch_squared(law, trace, J), rtol=1e-11)
    W, _, Vt = np.linalg.svd(F)
    R = W @ Vt
    np.testing.assert_allclose(points.records[:, 0], R[:, 0, 0], atol=1e-12)
    np.testing.assert_allclose(points.records[:, 1], R[:, 1, 0], atol=1e-12)


def test_plane_stress_from_far_starts():
    """A cold start, strong compression and strong stretch converge to the same J3."""
    body = sheet()
    for F in (np.diag([4.0, 4.0]), np.diag([0.3, 0.4]), np.diag([6.0, 0.3]), np.array([[1, 3.0], [0, 1]])):
        for law in (NeoHookean(1, 10), NeoHookean(1, 1e4)):
            kinematics = Kinematics(body, "float64")
            points = MaterialPoints(kinematics, law, "float64")
            kinematics.place(body.points @ F.T)
            points.find()
            expected = plane_stress.volume_ratio(law, *plane_stress.invariants(F))
            np.testing.assert_allclose(points.volume_ratios, expected, rtol=1e-11)


@pytest.mark.parametrize("dtype", [np.float32, np.float64])
@pytest.mark.parametrize("d", [2, 3])
def test_record_loads(random, dtype, d):
    """Pairs gathered into columns of rows, and columns written back as records of the other precision."""
    n, pairs = 50, BLOCK
    table = random.standard_normal((n, d * d)).astype(dtype)
    positions = random.standard_normal((n, d))
    first, second = (random.integers(0, n, pairs).astype(np.uint32) for _ in range(2))
    gather_pairs, subtract_positions = vector_loads.gather_pairs(d), vector_loads.subtract_positions(d)
    algebra = algebra_of(d)

    @kernel
    def load(table, positions, first, second, sums, differences, alone, records, vectors):
        for k in range(0, first.shape[0], 4):
            gather_pairs(table, positions, (first, second), k, sums, differences, k)
            subtract_positions(positions, (first, second), k, alone, k)
        for k in range(0, first.shape[0], 4):
            algebra.put_vectors(differences, k, vectors, k)
            algebra.put_matrices(sums, k, records, k)

    sums, differences, alone = np.zeros((d * d, pairs), dtype), np.zeros((d, pairs), dtype), np.zeros((d, pairs), dtype)
    records, vectors = np.zeros((pairs, d * d), np.float32), np.zeros((pairs, d))
    load(table, positions, first, second, sums, differences, alone, records, vectors)
    np.testing.assert_array_equal(sums, (table[first] + table[second]).T)
    np.testing.assert_array_equal(differences, (positions[second] - positions[first]).T.astype(dtype))
    np.testing.assert_array_equal(alone, differences)
    np.testing.assert_array_equal(records, sums.T.astype(np.float32))
    np.testing.assert_array_equal(vectors, differences.T)


@pytest.mark.parametrize("dtype", [np.float32, np.float64])
@pytest.mark.parametrize(("length", "sign"), [(2, -1), (3, -1), (4, 1), (9, 1)])
def test_sums_of_records(random, dtype, length, sign):
    """Sums of every count, so that the interleaved part and the rest are both taken."""
    table = random.standard_normal((100, length)).astype(dtype)
    algebra = algebra_of(2 if length in (2, 4) else 3)
    add_up = algebra.sum_signed_records if sign < 0 else algebra.sum_matrices

    @kernel
    def total(table, count, listed, out):
        add_up(table, (5, 5 + count), (listed, listed.shape[0]), (0, listed.shape[0]), 2.0, 0, out)

    for count in (0, 1, 3, 4, 7, 29):
        listed, out = random.integers(0, 100, count).astype(np.uint32), np.zeros((1, length))
        total(table, count, listed, out)
        expected = 2 * (table[5 : 5 + count].astype(float).sum(axis=0) + sign * table[listed].astype(float).sum(axis=0))
        np.testing.assert_allclose(out[0], expected, atol=1e-13)


AT_THE_END_OF_MEMORY = """
import ctypes, mmap
import numpy as np
from pdsurrogate.engine import vector_loads
from pdsurrogate.engine.compile import kernel
size = mmap.PAGESIZE
memory = mmap.mmap(-1, 2 * size)
pages = np.frombuffer(memory, dtype=np.uint8)
assert ctypes.CDLL(None).mprotect(ctypes.c_void_p(pages.ctypes.data + size), ctypes.c_size_t(size), 0) == 0
def at_end(values):
    place = pages[size - values.nbytes : size].view(values.dtype).reshape(values.shape)
    place[...] = values
    return place
add_up = vector_loads.sum_records(3, -1, fetched=True)
@kernel
def total(records, listed, out):
    add_up(records, (0, 5), (listed, listed.shape[0]), (0, listed.shape[0]), 1.0, 0, out)
table, listed, out = np.arange(15.0).reshape(5, 3), np.array([4, 0, 1], dtype=np.uint32), np.zeros((1, 3))
total(table, at_end(listed), out)
print(out.tolist())
total(at_end(table), listed, out)
print(out.tolist())
"""


@pytest.mark.skipif(sys.platform != "linux", reason="pages of memory are closed by a call of Linux")
def test_asking_for_memory_reads_nothing_beyond_the_arrays():
    """Behind the records, and behind the list of their numbers, lies a page whose use would end the process."""
    run = subprocess.run([sys.executable, "-c", AT_THE_END_OF_MEMORY], capture_output=True, text=True, check=False)
    table = np.arange(15.0).reshape(5, 3)
    expected = f"{[(table.sum(axis=0) - table[[4, 0, 1]].sum(axis=0)).tolist()]}\n"
    assert (run.returncode, run.stdout) == (0, 2 * expected), run.stderr


def test_compiled_code_is_cached_and_compilation_is_announced():
    """A kernel in a file is loaded by a second dispatcher; one that cannot be cached still works and is announced."""
    body = gripped_sheet()
    arguments = np.zeros_like(body.all_points), body.all_points, body.bonds.first, body.bonds.second
    greatest_strain(*arguments)
    again = kernel(greatest_strain.py_func)
    announced = []
    with compilation_clock(lambda: announced.append(1)) as clock:
        again(*arguments)
    assert isinstance(clock, CompilationClock)
    assert sum(again.stats.cache_hits.values()) == 1
    assert not announced
    assert clock.seconds == 0

    def fresh(x):
        return x + 1

    with compilation_clock(lambda: announced.append(1)) as clock:
        assert kernel(eval("lambda x: x + 2"))(1.0) == 3.0
    assert announced == [1]
    assert clock.seconds > 0


def test_greatest_strain(random):
    body = gripped_sheet()
    displacements = random.standard_normal(body.points.shape)
    first, second = body.bonds.first, body.bonds.second
    within = second < len(body)
    first, second = first[within], second[within]
    length = np.linalg.norm(body.points[second] - body.points[first], axis=1)
    expected = (np.abs(displacements[second] - displacements[first]).max(axis=1) / length).max()
    found = greatest_strain(displacements, body.points, body.bonds.first, body.bonds.second)
    np.testing.assert_allclose(found, expected, rtol=1e-14)


@pytest.mark.parametrize("count", [0, 1, 2, 3, 4, 5, 28])
@pytest.mark.parametrize("dtype", [np.float32, np.float64])
def test_outer_products_of_every_number_of_bonds(random, dtype, count):
    """Two bonds at a time, four in a turn, and the rest one by one."""

    @kernel
    def gradient(positions, neighbors, weights, bonds, point, out):
        vector_loads.sum_outer_products(positions, neighbors, weights, bonds, point, out)

    positions, weights = random.standard_normal((40, 2)), random.standard_normal((60, 2)).astype(dtype)
    neighbors, out = random.integers(0, 40, 60).astype(np.uint32), np.zeros((40, 4))
    gradient(positions, neighbors, weights, (np.uint64(7), np.uint64(7 + count)), 3, out)
    mine = slice(7, 7 + count)
    expected = np.einsum("bi,bj->ij", positions[neighbors[mine]] - positions[3], weights[mine].astype(float))
    np.testing.assert_allclose(out[3], expected.T.ravel(), atol=1e-13)


SHEET = """
import pdsurrogate as pds
pds.simulate(pds.load_scene("uniaxial", {"spacing": 0.1, "stretches": [1.1]}), "bond-energy")
from pdsurrogate.kernels.algebra import algebra_of
print(algebra_of.cache_info().currsize)
"""


def test_a_sheet_needs_nothing_of_space():
    done = subprocess.run([sys.executable, "-c", SHEET], capture_output=True, text=True, check=True)
    assert done.stdout.split("\n")[-2] == "1"
