"""Keys of compiled code: what changes them, and what does not."""

import errno
import importlib
import os
import subprocess
import sys
import textwrap
import time

import numba
import numpy as np
import pytest
from numba.extending import overload
from refusals import raising

from pdsurrogate.engine import compile as compile_module
from pdsurrogate.engine.keys import NotKeyable, code_digest
from pdsurrogate.kernels import bond_force
from pdsurrogate.materials import plane_stress

LAW = """
    from dataclasses import dataclass
    from typing import ClassVar

    import numpy as np
    from numba.extending import register_jitable
    import my_constants
    from my_constants import STIFFENING, doubled
    from pdsurrogate.materials import InvariantLaw


    @dataclass(frozen=True)
    class Mine(InvariantLaw):
        name: ClassVar[str] = "mine"
        reference: ClassVar[str] = "none"

        @property
        def parameters(self):
            return np.array([self.bulk_modulus / self.shear_modulus])

        @staticmethod
        def isochoric(I1, I2, parameters):
            b = my_constants.EXTRA + STIFFENING + doubled(0.0 * I1)
            zero = 0 * I1
            W = b * (I1 - 3) * (I1 - 3) / 2 + (I1 - 3) / 2
            return W, b * (I1 - 3) + 0.5, zero, b + zero, zero, zero
"""
CONSTANTS = """
    from numba.extending import register_jitable

    STIFFENING = {stiffening}
    EXTRA = {extra}

    @register_jitable
    def doubled(x):
        return x + {added}
"""
COMPARE = """
    import numpy as np
    from my_law import Mine
    from pdsurrogate.forces import AnalyticBondForce
    from pdsurrogate.forces.kernel_values import kernel_bond_force

    law, state = Mine(), ([1.7, 0.8], [0.2, -0.1], [0.5, 0.5], [0.6, 1.1], [1.3, 0.9])
    model = AnalyticBondForce(law)
    compiled = kernel_bond_force(model, law, np.float64)
    print(*(repr(float(force(*state)[0, 0])) for force in (model.bond_force, compiled)))
"""


def _write(folder, name, text):
    (folder / name).write_text(textwrap.dedent(text))


def test_a_constant_of_another_module_reaches_the_cached_kernel(tmp_path):
    """A law that takes a constant from another module: after the constant changes, NumPy
    follows, and so must the cached kernel.
    """
    _write(tmp_path, "my_law.py", LAW)
    _write(tmp_path, "compare.py", COMPARE)
    found = []
    for value in (0.0, 0.3):
        _write(
            tmp_path, "my_constants.py", CONSTANTS.format(stiffening=0.1, extra=0.0, added=value)
        )
        environment = {**os.environ, "PYTHONDONTWRITEBYTECODE": "1"}
        done = subprocess.run(
            [sys.executable, "compare.py"],
            cwd=tmp_path,
            env=environment,
            capture_output=True,
            text=True,
            check=True,
        )
        plain, compiled = map(float, done.stdout.split())
        # The kernel's own roots and powers are exact to a few units in the last place.
        assert compiled == pytest.approx(plain, rel=1e-13)
        found.append(compiled)
    assert abs(found[1] / found[0] - 1) > 0.01


def test_a_constant_changed_while_python_runs_reaches_the_kernel(tmp_path, monkeypatch):
    _write(tmp_path, "my_law.py", LAW)
    _write(tmp_path, "my_constants.py", CONSTANTS.format(stiffening=0.1, extra=0.0, added=0.0))
    monkeypatch.syspath_prepend(tmp_path)
    try:
        constants, law = (
            importlib.import_module("my_constants"),
            importlib.import_module("my_law").Mine(),
        )
        before = plane_stress.response.block(law)
        assert plane_stress.response.block(law) is before
        monkeypatch.setattr(constants, "EXTRA", 0.4)
        assert plane_stress.response.block(law).address != before.address
    finally:
        for name in ("my_law", "my_constants"):
            sys.modules.pop(name, None)


@pytest.fixture
def twice(tmp_path, monkeypatch):
    """A function in a file of its own, beside which its compiled code is kept."""
    _write(tmp_path, "kept_by_a_test.py", "def twice(x):\n    return 2 * x\n")
    monkeypatch.syspath_prepend(tmp_path)
    monkeypatch.setattr(numba.config, "CACHE_DIR", "")
    yield importlib.import_module("kept_by_a_test").twice
    del sys.modules["kept_by_a_test"]


@pytest.mark.parametrize("kind", ["nbi", "nbc"])
@pytest.mark.parametrize("damage", ["empty", "half", "zeros"])
def test_a_damaged_cache_is_none(tmp_path, twice, kind, damage):
    """A file that a full disk or a power cut had left half-written ended every run from then on."""

    def compiled():
        with compile_module.compilation_clock() as clock:
            assert compile_module.kernel(twice)(3.0) == 6.0
        return clock.seconds > 0

    assert compiled()
    assert not compiled()
    (path,) = tmp_path.rglob(f"twice*.{kind}")
    content = path.read_bytes()
    half = content[: len(content) // 2]
    path.write_bytes({"empty": b"", "half": half, "zeros": half.ljust(len(content), b"\0")}[damage])
    assert compiled()
    assert not compiled()


BESIDE = """
import sys
from kept_by_a_test import twice
from pdsurrogate.engine import compile as compile_module

compile_module.LONGEST_WAIT = float(sys.argv[1])
with compile_module.compilation_clock() as clock:
    print("begins", flush=True)
    assert compile_module.kernel(twice)(3.0) == 6.0
print("compiled" if clock.seconds else "loaded", flush=True)
"""


def test_of_several_processes_one_compiles_while_the_others_wait(tmp_path, twice):
    """This process begins to compile and never ends, as one that is killed: another one waits,
    and a third has no patience.
    """

    def beside(longest_wait):
        command = [sys.executable, "-c", BESIDE, str(longest_wait)]
        process = subprocess.Popen(command, cwd=tmp_path, stdout=subprocess.PIPE, text=True)
        assert process.stdout.readline() == "begins\n"
        return process

    kernel = compile_module.kernel(twice)
    assert kernel._cache.load_overload((numba.float64,), kernel.targetctx) is None
    waits = beside(600)
    time.sleep(1)
    hurries = beside(0.5)
    assert waits.poll() is None
    assert [process.communicate()[0] for process in (hurries, waits)] == ["compiled\n", "loaded\n"]
    assert not list(tmp_path.rglob("*.compiling"))


def test_a_process_that_is_killed_while_it_compiles_makes_no_other_wait(tmp_path, twice):
    """The next one waited for twenty seconds."""
    pytest.importorskip("fcntl")
    holds = """
import time, numba
from kept_by_a_test import twice
from pdsurrogate.engine import compile as compile_module

kernel = compile_module.kernel(twice)
assert kernel._cache.load_overload((numba.float64,), kernel.targetctx) is None
print("holds", flush=True)
time.sleep(600)
"""
    holding = subprocess.Popen(
        [sys.executable, "-c", holds], cwd=tmp_path, stdout=subprocess.PIPE, text=True
    )
    assert holding.stdout.readline() == "holds\n"
    assert list(tmp_path.rglob("*.compiling"))
    holding.kill()
    holding.communicate()
    began = time.monotonic()
    kernel = compile_module.kernel(twice)
    assert kernel._cache.load_overload((numba.float64,), kernel.targetctx) is None
    assert time.monotonic() - began < compile_module.LONGEST_WAIT / 2
    assert kernel(3.0) == 6.0
    assert not list(tmp_path.rglob("*.compiling"))


def test_a_full_disk_under_the_cache_is_done_without(twice, monkeypatch, caplog):
    """It ended the run with "could not write None"."""

    def full(*arguments):
        raise OSError(errno.ENOSPC, os.strerror(errno.ENOSPC))

    monkeypatch.setattr("os.replace", full)
    compile_module.log_not_kept.cache_clear()
    for _ in range(2):
        assert compile_module.kernel(twice)(3.0) == 6.0
    assert [record.message.count("No space left on device") for record in caplog.records] == [1]


def test_a_compiler_that_is_switched_off_is_told_in_one_line():
    environment = {**os.environ, "NUMBA_DISABLE_JIT": "1"}
    command = [sys.executable, "-m", "pdsurrogate", "run", "uniaxial", "--set", "spacing=0.25"]
    done = subprocess.run(command, env=environment, capture_output=True, text=True, check=False)
    assert done.returncode == 2
    assert done.stderr.startswith("pdsurrogate: NUMBA_DISABLE_JIT is set in the environment")
    assert len(done.stderr.splitlines()) == 1


def _made(source, **space):
    exec(textwrap.dedent(source), {"__name__": "a_users_module", **space}, space)
    function = space["f"]
    function.__globals__.update(space)
    return function


def test_comments_and_docstrings_do_not_count_and_code_does():
    plain = _made("def f(x):\n    return x + 1")
    explained = _made('# Why.\ndef f(x):\n    """What."""\n\n    # How.\n    return x + 1')
    assert code_digest(plain) == code_digest(explained)
    assert code_digest(plain) != code_digest(_made("def f(x):\n    return x + 2"))
    assert code_digest(plain) != code_digest(_made("def f(x, y=1):\n    return x + 1"))


@pytest.mark.parametrize(
    "values",
    [
        (1, 2),
        (1, 1.0),
        ("a", "b"),
        ((1, 2), (2, 1)),
        (np.zeros(2), np.zeros(3)),
        (np.float32(1), np.float64(1)),
    ],
)
def test_globals_and_closures_count_by_value(values):
    def closing(value):
        return lambda: value

    for make in (lambda value: _made("def f():\n    return c", c=value), closing):
        one, other = (make(value) for value in values)
        assert code_digest(one) != code_digest(other)
        assert code_digest(one) == code_digest(make(values[0]))


def test_called_functions_count_by_their_code_however_deep():
    def chain(number):
        inner = _made(f"def f(x):\n    return x + {number}")
        return _made(
            "def f(x):\n    return inner(x)",
            inner=_made("def f(x):\n    return deeper(x)", deeper=inner),
        )

    assert code_digest(chain(1)) == code_digest(chain(1)) != code_digest(chain(2))


def test_functions_may_call_themselves():
    assert code_digest(_made("def f(x):\n    return f(x - 1) if x else 0")) == code_digest(
        _made("def f(x):\n    return f(x - 1) if x else 0")
    )


def test_what_numba_compiles_in_the_place_of_a_function_counts():
    def with_implementation(number):
        inner = _made("def f(x):\n    return x")
        overload(inner)(_made(f"def f(x):\n    return lambda x: x + {number}"))
        return _made("def f(x):\n    return inner(x)", inner=inner)

    assert (
        code_digest(with_implementation(1))
        == code_digest(with_implementation(1))
        != code_digest(with_implementation(2))
    )


def test_what_cannot_be_keyed_is_named():
    with raising("f uses thing: an object of type object", NotKeyable):
        code_digest(_made("def f():\n    return thing", thing=object()))


def test_digests_are_the_same_in_every_process():
    """Orders of sets and addresses of objects differ between processes."""
    source = """
from pdsurrogate.engine.keys import code_digest
from pdsurrogate.kernels.bond_force import pair_forces
print(code_digest(pair_forces.function))
"""
    other = subprocess.run(
        [sys.executable, "-c", source], capture_output=True, text=True, check=True
    ).stdout.strip()
    assert other == code_digest(bond_force.pair_forces.function)
