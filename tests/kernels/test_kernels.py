"""Kernels against plain twins written for reading."""

import subprocess
import sys
from functools import partial

import numpy as np
import pytest
from bodies import disc_with_hole, gripped_sheet, sheet

from pdsurrogate.engine import vector_loads
from pdsurrogate.engine.block_arrays import BLOCK, block_rows
from pdsurrogate.engine.compile import CompilationClock, compilation_clock, kernel
from pdsurrogate.forces.kinematics import Kinematics
from pdsurrogate.kernels.steps import greatest_strain
from pdsurrogate.solvers.bond_strains import NONE
from pdsurrogate.testing.bodies import gripped


@pytest.mark.parametrize("make", [sheet, disc_with_hole, gripped_sheet, partial(gripped, 3)])
def test_deformation_gradients_against_the_sum(make):
    body = make()
    kinematics = Kinematics(body, "float64")
    waves = 0.005 * np.sin(4 * body.points[:, ::-1])
    kinematics.place(1.05 * body.points + waves)
    bonds, x, y = body.bonds, body.all_points, kinematics.positions
    for i in range(len(body)):
        mine = slice(int(bonds.pointers[i]), int(bonds.pointers[i + 1]))
        j = bonds.neighbors[mine]
        bond = x[j] - x[i]
        weight = body.weigh(np.linalg.norm(bond, axis=1)) * body.all_volumes[j]
        K = np.einsum("b,bi,bj->ij", weight, bond, bond)
        F = np.einsum("b,bi,bj->ij", weight, y[j] - y[i], bond) @ np.linalg.inv(K)
        np.testing.assert_allclose(kinematics.deformation_gradients()[i], F, rtol=1e-11, atol=1e-11)


AT_THE_END_OF_MEMORY = """
import ctypes, mmap
import numpy as np
from pdsurrogate.engine import vector_loads
from pdsurrogate.engine.compile import kernel
size = mmap.PAGESIZE
memory = mmap.mmap(-1, 2 * size)
pages = np.frombuffer(memory, dtype=np.uint8)
after = ctypes.c_void_p(pages.ctypes.data + size)
assert ctypes.CDLL(None).mprotect(after, ctypes.c_size_t(size), 0) == 0
def at_end(values):
    place = pages[size - values.nbytes : size].view(values.dtype).reshape(values.shape)
    place[...] = values
    return place
add_up = vector_loads.sum_scaled_records(3)
@kernel
def total(records, factors, listed, forces, moments):
    ends = (listed, listed.shape[0]), (0, listed.shape[0])
    add_up(records, factors, (0, 5), *ends, 0, (forces, moments))
table = np.arange(60, dtype=np.float32).reshape(5, 12)
found = np.zeros((1, 3), dtype=np.float32), np.zeros((1, 9), dtype=np.float32)
factors = np.ones(5, dtype=np.float32)
listed = np.array([4, 0, 1], dtype=np.uint32)
total(table, factors, at_end(listed), *found)
print(found[0].tolist())
total(at_end(table), factors, listed, *found)
print(found[0].tolist())
"""


@pytest.mark.parametrize("length", [3, 4, 6])
def test_listed_records(random, length):
    take = vector_loads.take_listed(length)

    @kernel
    def taken(records, width, numbers, start, rows):
        rows = block_rows(rows)
        for k in range(0, BLOCK, 4):
            take(records, width, numbers, k, start, rows, k)

    records, rows = random.normal(size=(50, 2 * length)), np.zeros((length, BLOCK))
    numbers = random.integers(0, 50, BLOCK).astype(np.uint32)
    taken(records, 2 * length, numbers, length, rows)
    assert np.array_equal(rows, records[numbers, length:].T)


@pytest.mark.skipif(sys.platform != "linux", reason="pages of memory are closed by a call of Linux")
def test_asking_for_memory_reads_nothing_beyond_the_arrays():
    """Behind the records, and behind the list of their numbers, lies a page whose use would end
    the process.
    """
    run = subprocess.run(
        [sys.executable, "-c", AT_THE_END_OF_MEMORY], capture_output=True, text=True, check=False
    )
    table = np.arange(60.0).reshape(5, 12)[:, :3]
    expected = f"{[(table.sum(axis=0) - table[[4, 0, 1]].sum(axis=0)).tolist()]}\n"
    assert (run.returncode, run.stdout) == (0, 2 * expected), run.stderr


def test_compiled_code_is_cached_and_compilation_is_announced():
    """A kernel in a file is loaded by a second dispatcher; one that cannot be cached still works
    and is announced.
    """
    body = gripped_sheet()
    bonds = body.bonds
    arguments = np.zeros_like(body.points), body.points, bonds.first, bonds.second, NONE
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


SHEET = """
import pdsurrogate as pds
pds.simulate(pds.load_scene("uniaxial", {"spacing": 0.1, "stretches": [1.1]}), "bond-energy")
from pdsurrogate.kernels.algebra import algebra_of
print(algebra_of.cache_info().currsize)
"""


def test_a_sheet_needs_nothing_of_space():
    done = subprocess.run([sys.executable, "-c", SHEET], capture_output=True, text=True, check=True)
    assert done.stdout.split("\n")[-2] == "1"
