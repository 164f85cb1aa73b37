"""Speed against error in space: cost of a whole force evaluation with the exact energy of every law, with the learned ones and with NOSB.

python pipelines/speed_in_space.py            print the table (two minutes of an idle processor)
python pipelines/speed_in_space.py --docs     and put it into the documentation
"""

from __future__ import annotations

import argparse
import dataclasses
import time
from collections.abc import Callable

import numba
import numpy as np
from pages import markdown_table, replace_block
from rich.console import Console

import pdsurrogate as pds
from pdsurrogate.artifacts import list_artifacts, load_card, load_surrogate
from pdsurrogate.engine.threads import thread_count
from pdsurrogate.forces.settings import PRECISIONS
from pdsurrogate.results.provenance import processor

console = Console()

POINTS = 20
"""Along every side of the cube."""

SECONDS = 60.0
"""Of the processor, for which all evaluations take turns; the machine may be shared, so the fastest tenth of each counts."""


def cube() -> pds.Body:
    """A lattice with the default horizon of bodies in space, 26 bonds of points within."""
    axis = (np.arange(POINTS) + 0.5) / POINTS
    points = np.stack(np.meshgrid(axis, axis, axis, indexing="ij"), axis=-1).reshape(-1, 3)
    return pds.Body(points, np.full(len(points), float(POINTS) ** -3), 1.75 / POINTS, 1 / POINTS)


def stretched(points: np.ndarray) -> np.ndarray:
    """Positions at stretch 1.5 with waves on top: every bond in a state of its own."""
    waves = np.stack([np.sin(7 * points[:, 1]), np.sin(5 * points[:, 2]), np.sin(6 * points[:, 0] + points[:, 1])], axis=1)
    return points @ np.diag([1.5, 1.5**-0.5, 1.5**-0.5]) + 0.01 * waves


def timed(evaluations: dict[str, Callable[[], None]]) -> dict[str, float]:
    """Seconds of each, in turns; the mean of the fastest tenth.

    Seconds that the thread had the processor: what others do on the machine at the same time counts by the memory that they fill alone.
    """
    times = {name: [] for name in evaluations}
    for run in evaluations.values():
        run()
    began = time.thread_time()
    while time.thread_time() - began < SECONDS or min(map(len, times.values())) < 10:
        for name, run in evaluations.items():
            # A dear one takes the time of many others.
            if len(times[name]) > 10 and times[name][-1] > 20 * min(times["NOSB"]):
                continue
            run()  # the caches are another's
            start = time.thread_time()
            run()
            times[name].append(time.thread_time() - start)
    return {name: float(np.mean(np.sort(found)[: max(1, len(found) // 10)])) for name, found in times.items()}


def table() -> str:
    """The table of the documentation."""
    body, settings = cube(), pds.ForceSettings(plane="space")
    y, forces, errors = stretched(body.points), {}, {}
    forces["NOSB"] = pds.forces.NOSBForce().bind(body, pds.materials.NeoHookean(), settings)
    for name, law in pds.materials.LAWS.items():
        forces[f"exact, {name}"] = pds.BondEnergyForce().bind(body, law(), settings)
    out, exact = np.empty_like(y), np.empty_like(y)
    for folder in list_artifacts():
        card = load_card(folder)
        if card.kind != pds.forces.IsochoricNetwork.kind:
            continue
        law, found = pds.materials.LAWS[card.material.law](), card.errors["box"]["on_surface"]
        forces[f"exact, {card.material.law}"](y, exact)
        for precision in PRECISIONS:
            name = f"learned, {card.material.law}, {precision}"
            forces[name] = load_surrogate(folder).bind(body, law, dataclasses.replace(settings, precision=precision))
            forces[name](y, out)
            off = np.sqrt(((out - exact) ** 2).sum() / (exact**2).sum())
            errors[name] = [f"{found['rms']:.1e}", f"{found['max']:.1e}", f"{off:.1e}"]
    with thread_count(1):
        seconds = timed({name: lambda force=force: force(y, out) for name, force in forces.items()})
    scale = 1e9 / body.bonds.n_directed
    rows = [
        [
            name,
            f"{scale * found:.1f}",
            f"{found / seconds['NOSB']:.1f}",
            f"{found / seconds['learned, neo-hookean, float32']:.2f}",
            *errors.get(name, ["-", "-", "-"]),
        ]
        for name, found in seconds.items()
    ]
    costs = ["ns/directed bond, 1 thread", "cost / NOSB", "cost / learned Neo-Hookean in float32"]
    header = ["force", *costs, "stress error, RMS", "stress error, largest", "force error on the cube, RMS"]
    return markdown_table(header, rows)


def main() -> None:
    parser = argparse.ArgumentParser(description=__doc__.splitlines()[0])
    parser.add_argument("--docs", action="store_true", help="put the table into the documentation")
    arguments = parser.parse_args()
    found = table()
    console.print(found, soft_wrap=True)
    if arguments.docs:
        replace_block("speed-in-space", f"Processor: {processor()}, numba {numba.__version__}.\n\n{found}")


if __name__ == "__main__":
    main()
