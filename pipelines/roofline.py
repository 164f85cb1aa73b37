"""Roofline: bytes and arithmetic operations of each pass of a force evaluation, its time, and how near it is to what one core can do.

python pipelines/roofline.py            print the table (a minute or two of an idle processor)
python pipelines/roofline.py --docs     and put it into the documentation

Operations are counted while the passes run: the optimized code that numba compiled gets a counter in every basic block, of the additions,
subtractions, multiplications, divisions and square roots of reals that the block contains, each lane of a vector by itself. Comparisons,
conversions, moves and integer arithmetic do not count. Bytes are those of the arrays that a pass is given, each once, apart from working
memory, which stays in the nearest cache: no pass can move less. The peaks are measured in the same run: fused multiply-adds on registers
in either precision, and copies within as many bytes as all arrays of the evaluation, which lie in the same caches.
"""

from __future__ import annotations

import argparse
import copy
import ctypes
import os
import re
import tempfile
import time
from collections.abc import Callable
from typing import NamedTuple

# Everything is compiled anew, since cached code has no intermediate representation that could be counted. Set before numba is loaded.
_CACHE = tempfile.TemporaryDirectory()
os.environ["NUMBA_CACHE_DIR"] = _CACHE.name

import llvmlite.binding as llvm  # noqa: E402
import numpy as np  # noqa: E402
from numba.core.ccallback import CFunc  # noqa: E402
from pages import markdown_table, replace_block  # noqa: E402
from rich.console import Console  # noqa: E402

import pdsurrogate as pds  # noqa: E402
from pdsurrogate.engine.passes import BoundPass, Chain, Pass, share_of  # noqa: E402
from pdsurrogate.engine.threads import thread_count  # noqa: E402
from pdsurrogate.reports.speed import bench_positions  # noqa: E402
from pdsurrogate.results.provenance import processor  # noqa: E402

console = Console(width=140)

CASES = (("neo-hookean", "stress"), ("bond-energy", "space"), ("neo-hookean-isochoric", "space"))
"""Force and plane: the default in the plane, and the exact and the learned energy of solids."""

SECONDS = 0.25
"""Processor time of a measurement, for each pass; the fastest repetition counts."""

WORKING_MEMORY = ("memory", "scratch", "node_parts", "buffers")
"""Arguments of passes that are working memory of a thread."""

ARITHMETIC = re.compile(r"= f(?:add|sub|mul|div|rem)\b[^%<]*?(?:<(\d+) x )?(float|double)\b")
CALLED = re.compile(r"call\b.*?@llvm\.(fma|fmuladd|sqrt|vector\.reduce\.fadd)\.(?:v(\d+))?f(32|64)")
TERMINATOR = re.compile(r"^  (?:br|ret|switch|indirectbr|unreachable|resume)\b")
"""Lines of LLVM's intermediate representation: arithmetic, calls of arithmetic functions, and ends of basic blocks."""

_compiled: list[CFunc] = []
"""All functions called by address that this process has compiled."""

_bound: dict[int, tuple[BoundPass, Pass, tuple]] = {}
"""Bound passes with what they were bound to, by identity."""

_passes: dict[int, tuple[BoundPass, ...]] = {}
"""Passes of each chain, by the identity of the chain."""

_run: list[Chain] = []
"""Chains in the order in which they run."""


def record() -> None:
    """Make functions, passes and chains note what they are made of."""
    compile_function, bind, make, call = CFunc.compile, Pass.bind, Chain.__init__, Chain.__call__

    def compile_and_note(self):
        _compiled.append(self)
        return compile_function(self)

    def bind_and_note(self, *arguments, chunks=None):
        bound = bind(self, *arguments, chunks=chunks)
        _bound[id(bound)] = bound, self, arguments
        return bound

    def make_and_note(self, *passes):
        _passes[id(self)] = passes
        make(self, *passes)

    def call_and_note(self):
        _run.append(self)
        return call(self)

    CFunc.compile, Pass.bind, Chain.__init__, Chain.__call__ = compile_and_note, bind_and_note, make_and_note, call_and_note


def operations_in(line: str) -> tuple[int, int]:
    """Operations in single and in double precision of one line of intermediate representation."""
    if found := ARITHMETIC.search(line):
        lanes, double = int(found[1] or 1), found[2] == "double"
        count = lanes
    elif found := CALLED.search(line):
        lanes, double = int(found[2] or 1), found[3] == "64"
        count = lanes * (2 if found[1].startswith("fm") else 1)
    else:
        return 0, 0
    return (0, count) if double else (count, 0)


def with_counters(text: str, address: int) -> str:
    """Intermediate representation with code that adds the operations of every basic block to two counters at an address."""
    lines, block, number = [], [0, 0], 0
    for line in text.splitlines():
        if TERMINATOR.match(line):
            for kind, count in enumerate(block):
                if count:
                    place = f"ptr inttoptr (i64 {address + 8 * kind} to ptr)"
                    lines.append(f"  %roofline.{number} = load i64, {place}")
                    lines.append(f"  %roofline.{number + 1} = add i64 %roofline.{number}, {count}")
                    lines.append(f"  store i64 %roofline.{number + 1}, {place}")
                    number += 2
            block = [0, 0]
        else:
            single, double = operations_in(line)
            block = [block[0] + single, block[1] + double]
        lines.append(line)
    return "\n".join(lines)


class Machine:
    """Compiled intermediate representations, which live as long as this object."""

    def __init__(self) -> None:
        self._engines = []

    def address_of(self, text: str, name: str) -> int:
        """Address of a function of intermediate representation, compiled without further optimization of its code."""
        module = llvm.parse_assembly(text)
        module.verify()
        features = llvm.get_host_cpu_features().flatten()
        target = llvm.Target.from_triple(module.triple or llvm.get_process_triple())
        engine = llvm.create_mcjit_compiler(module, target.create_target_machine(cpu=llvm.get_host_cpu_name(), features=features, opt=3))
        engine.finalize_object()
        self._engines.append(engine)
        return engine.get_function_address(name)


def words_of(value) -> int:
    """Number of 64-bit words by which a pass knows an argument."""
    if isinstance(value, tuple):
        return sum(map(words_of, value))
    return 1 + value.ndim if isinstance(value, np.ndarray) else 1


def arrays_of(value) -> list[np.ndarray]:
    """All arrays in an argument of a pass."""
    if isinstance(value, tuple):
        return [array for item in value for array in arrays_of(item)]
    return [value] if isinstance(value, np.ndarray) else []


class Counter:
    """Operations of bound passes, counted by running them once with counters in their code."""

    def __init__(self) -> None:
        self._machine, self._counts, self._counted = Machine(), np.zeros(2, dtype=np.int64), {}
        self._known = 0

    def _instrument(self) -> None:
        """Compile every function that has been compiled since the last call once more, with counters."""
        for function in _compiled[self._known :]:
            text = with_counters(function.inspect_llvm(), self._counts.__array_interface__["data"][0])
            (name,) = re.findall(r"^define [^@\n]*@\"?(cfunc\.[^\"(]+)\"?\(", text, re.MULTILINE)
            self._counted[function.address] = self._machine.address_of(text, name)
        self._known = len(_compiled)

    def __call__(self, bound: BoundPass, arguments: tuple) -> tuple[int, int]:
        """Operations of a pass in single and in double precision."""
        self._instrument()
        code, place, chunks = bound.call
        size = sum(map(words_of, arguments))
        words = np.array((ctypes.c_int64 * size).from_address(place), dtype=np.int64)
        # Addresses of other functions are among the arguments, or in short arrays of constants.
        lists = [array for array in arrays_of(arguments) if array.dtype == np.int64 and array.size < 1000]
        kept = [array.copy() for array in lists]
        for array in [words, *lists]:
            flat = array.reshape(-1)
            for k in range(flat.size):
                flat[k] = self._counted.get(int(flat[k]), flat[k])
        other = copy.copy(bound)
        other.call = self._counted[code], words.__array_interface__["data"][0], chunks
        self._counts[:] = 0
        Chain(other)()
        for array, before in zip(lists, kept, strict=True):
            array[:] = before
        return int(self._counts[0]), int(self._counts[1])


def fastest(run: Callable[[], object], seconds: float) -> float:
    """Least processor time of a call, in seconds."""
    run()
    least, until = np.inf, time.thread_time() + seconds
    while (began := time.thread_time()) < until:
        run()
        least = min(least, time.thread_time() - began)
    return least


def peak_of(machine: Machine, real: str) -> float:
    """Operations per second of fused multiply-adds on registers, in "float" or "double"."""
    bits = 512 if llvm.get_host_cpu_features().get("avx512f") else 256 if llvm.get_host_cpu_features().get("avx") else 128
    lanes, chains, rounds = bits // (32 if real == "float" else 64), 10, 1_000_000
    vector = f"<{lanes} x {real}>"
    name = f"llvm.fma.v{lanes}f{32 if real == 'float' else 64}"
    constant = "<" + ", ".join(f"{real} 0.5" for _ in range(lanes)) + ">"
    rows = [
        f"declare {vector} @{name}({vector}, {vector}, {vector})",
        f'define void @peak(ptr %out) "prefer-vector-width"="{bits}" {{',
        "entry:",
        "  br label %loop",
        "loop:",
    ]
    rows.append("  %k = phi i64 [0, %entry], [%next, %loop]")
    rows += [f"  %a{c} = phi {vector} [{constant}, %entry], [%b{c}, %loop]" for c in range(chains)]
    rows += [f"  %b{c} = call {vector} @{name}({vector} %a{c}, {vector} {constant}, {vector} {constant})" for c in range(chains)]
    rows += ["  %next = add i64 %k, 1", f"  %more = icmp ult i64 %next, {rounds}", "  br i1 %more, label %loop, label %end", "end:"]
    for c in range(chains):
        rows += [f"  %p{c} = getelementptr {vector}, ptr %out, i64 {c}", f"  store {vector} %b{c}, ptr %p{c}, align 8"]
    rows += ["  ret void", "}"]
    function, out = ctypes.CFUNCTYPE(None, ctypes.c_void_p)(machine.address_of("\n".join(rows), "peak")), np.zeros(1024)
    seconds = fastest(lambda: function(out.__array_interface__["data"][0]), 4 * SECONDS)
    return 2 * lanes * chains * rounds / seconds


def bandwidth_of(size: int) -> float:
    """Bytes per second, read and written, of copies within `size` bytes."""
    half = max(size // 16, 512)
    source, target = np.ones(half), np.ones(half)
    repeated = max(1, (1 << 20) // (16 * half))  # calls that are short beside the clock would measure the clock

    def run() -> None:
        for _ in range(repeated):
            np.copyto(target, source)

    return 16 * half * repeated / fastest(run, SECONDS)


@Pass
def multiply_and_add(chunk, x, y):
    """Two operations for each number, by which the count is checked."""
    for k in share_of(x.shape[0], chunk):
        y[k] += 3.0 * x[k]


def check(counter: Counter) -> None:
    """End the program if a pass with a known number of operations is counted wrongly."""
    arguments = np.ones(1000), np.ones(1000)
    found = counter(multiply_and_add.bind(*arguments), arguments)
    if found != (0, 2000):
        raise SystemExit(f"a pass with 2,000 operations in double precision was counted as {found}")


class Cost(NamedTuple):
    """Cost of a pass for one evaluation."""

    name: str
    seconds: float
    size: int
    operations: tuple[int, int]


class Evaluation(NamedTuple):
    """Passes of an evaluation, the number of directed bonds, the bytes of all arrays, and the seconds of a whole evaluation."""

    costs: list[Cost]
    bonds: int
    size: int
    seconds: float


def body_of(plane: str) -> pds.Body:
    """The sheet of 7,500 points, or a cube of 8,000."""
    if plane == "stress":
        return pds.Body.rectangle(3.0, 1.0, 0.02, 0.063)
    axis = (np.arange(20) + 0.5) / 20
    points = np.stack(np.meshgrid(axis, axis, axis, indexing="ij"), axis=-1).reshape(-1, 3)
    return pds.Body(points, np.full(len(points), 20.0**-3), 1.75 / 20, 1 / 20)


def evaluation_of(name: str, plane: str, counter: Counter) -> Evaluation:
    """The passes of an evaluation; they take turns as in an evaluation, so that each finds its arrays where the others left them."""
    body, law = body_of(plane), pds.materials.NeoHookean()
    model = pds.forces.FORCES[name]() if name in pds.forces.FORCES else pds.load_surrogate(name)
    force, out = model.bind(body, law, pds.ForceSettings(plane=plane)), np.empty_like(body.points)
    waves = 0.002 * np.sin(9 * body.points[:, ::-1])
    positions = bench_positions(body, law) if plane == "stress" else body.points * [1.5, 0.82, 0.82] + waves
    force(positions, out)
    _run.clear()
    force(positions, out)
    passes = [bound for chain in _run for bound in _passes[id(chain)]]
    # The whole evaluation takes its turn too: measured later, it would meet other disturbances than its passes.
    turns = [*(Chain(bound) for bound in passes), lambda: force(positions, out)]
    least, until = np.full(len(turns), np.inf), time.thread_time() + SECONDS * len(turns)
    while time.thread_time() < until:
        for number, run in enumerate(turns):
            began = time.thread_time()
            run()
            least[number] = min(least[number], time.thread_time() - began)
    found, arrays = [], {}
    *of_passes, whole = least.tolist()
    for bound, seconds in zip(passes, of_passes, strict=True):
        _, what, arguments = _bound[id(bound)]
        given = zip(what.names, arguments, strict=True)
        moved = {_place(array): array.nbytes for label, value in given if label not in WORKING_MEMORY for array in arrays_of(value)}
        arrays |= moved
        found.append(Cost(what.__name__, seconds, sum(moved.values()), counter(bound, arguments)))
    return Evaluation(found, body.bonds.n_directed, sum(arrays.values()), whole)


def _place(array: np.ndarray) -> int:
    return array.__array_interface__["data"][0]


def roofline() -> str:
    """The table and what it was measured on."""
    counter = Counter()
    check(counter)
    peaks = [peak_of(Machine(), real) for real in ("float", "double")]
    rows = []
    for name, plane in CASES:
        costs, bonds, size, whole = evaluation_of(name, plane, counter)
        speed = bandwidth_of(size)
        limits = [(cost.size / speed, sum(count / peak for count, peak in zip(cost.operations, peaks, strict=True))) for cost in costs]
        for cost, (moving, computing) in zip(costs, limits, strict=True):
            text = [f"{name}, {plane}: `{cost.name}`", *_figures([cost], bonds), "arithmetic" if computing > moving else "memory"]
            rows.append([*text, f"{100 * max(moving, computing) / cost.seconds:.0f}"])
        total = 100 * sum(map(max, limits)) / sum(cost.seconds for cost in costs)
        rows.append(
            [f"{name}, {plane}: all passes", *_figures(costs, bonds), f"{1e-9 * speed:.0f} GB/s in {size >> 20} MiB", f"{total:.0f}"]
        )
        rows.append([f"{name}, {plane}: one evaluation", f"{1e9 * whole / bonds:.2f}", *[""] * 7])
    header = ["force: pass", "ns", "bytes", "single", "double", "GB/s", "10^9 operations/s", "limit", "% of the limit"]
    peaks_told = f"{1e-9 * peaks[0]:.0f} in single and {1e-9 * peaks[1]:.0f} in double precision"
    told = f"Processor: {processor()}, one thread. Peaks of multiply-adds, in 10^9 operations/s: {peaks_told}."
    return f"{told}\n\n{markdown_table(header, rows)}"


def _figures(costs: list[Cost], bonds: int) -> list[str]:
    """Time, bytes and operations per directed bond, and both per second."""
    seconds, size = sum(cost.seconds for cost in costs), sum(cost.size for cost in costs)
    operations = [sum(cost.operations[kind] for cost in costs) for kind in (0, 1)]
    per_bond = [f"{1e9 * seconds / bonds:.2f}", *(f"{count / bonds:.1f}" for count in (size, *operations))]
    return [*per_bond, f"{1e-9 * size / seconds:.1f}", f"{1e-9 * sum(operations) / seconds:.1f}"]


def main() -> None:
    parser = argparse.ArgumentParser(description=__doc__.splitlines()[0])
    parser.add_argument("--docs", action="store_true", help="put the table into the documentation")
    arguments = parser.parse_args()
    record()
    llvm.initialize_native_target()
    llvm.initialize_native_asmprinter()
    with thread_count(1):
        table = roofline()
    console.print(table, markup=False, highlight=False, soft_wrap=True)
    if arguments.docs:
        replace_block("roofline", table)


if __name__ == "__main__":
    main()
