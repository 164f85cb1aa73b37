"""Blocks of a material in CalculiX: decks, runs, and the stresses that come back."""

import shutil
import subprocess
from itertools import product

import numpy as np
import pytest

needs_calculix = pytest.mark.skipif(
    shutil.which("ccx") is None, reason="needs CalculiX, ccx (Debian package calculix-ccx)"
)

NODES = np.array(list(product(range(3), repeat=3)))
CORNERS = np.array(
    [[0, 0, 0], [1, 0, 0], [1, 1, 0], [0, 1, 0], [0, 0, 1], [1, 0, 1], [1, 1, 1], [0, 1, 1]]
)
STEP = (
    "*STEP, NLGEOM, INC=1000\n*STATIC\n{first}, 1.\n*BOUNDARY\n{moved}\n"
    "*EL PRINT, ELSET=ALL\nS\n*END STEP"
)


def run(deck, folder, command="ccx"):
    """Run a deck and return the text of its .dat file; a run that fails is an AssertionError."""
    (folder / "deck.inp").write_text(deck)
    done = subprocess.run(
        [command, "-i", "deck"],
        cwd=folder,
        capture_output=True,
        text=True,
        timeout=300,
        env={"OMP_NUM_THREADS": "1", "PATH": "/usr/local/bin:/usr/bin:/bin"},
    )
    assert done.returncode == 0, done.stdout[-2000:]
    assert "*ERROR" not in done.stdout, done.stdout[-2000:]
    return (folder / "deck.dat").read_text()


def block(material, gradients, first=0.1):
    """Deck of eight cubes of a material ``RUBBER``, whose faces move by one gradient (3, 3) after
    another; the node in the middle is free, since CalculiX solves for something.
    """
    number = {tuple(place): k for k, place in enumerate(NODES.tolist(), start=1)}
    cells = [
        [number[tuple(place)] for place in (CORNERS + low).tolist()]
        for low in product(range(2), repeat=3)
    ]
    lines = [
        "*NODE, NSET=ALL",
        *(f"{k}, {x}, {y}, {z}" for (x, y, z), k in number.items()),
        "*ELEMENT, TYPE=C3D8, ELSET=ALL",
        *(", ".join(map(str, [k, *cell])) for k, cell in enumerate(cells, start=1)),
        material,
        "*SOLID SECTION, ELSET=ALL, MATERIAL=RUBBER",
    ]
    for F in gradients:
        moved = [
            f"{k}, {axis + 1}, {axis + 1}, {shift:.15g}"
            for place, k in number.items()
            if place != (1, 1, 1)
            for axis, shift in enumerate((F - np.eye(3)) @ place)
        ]
        lines.append(STEP.format(first=first, moved="\n".join(moved)))
    return "\n".join(lines) + "\n"


def stresses(material, gradients, folder, command="ccx"):
    """Cauchy stresses (n, 3, 3) of a material at deformation gradients (n, 3, 3) that follow one
    another.
    """
    text = run(block(material, gradients), folder, command)
    steps = text.split("stresses (elem")[1:]
    rows = [
        np.array([line.split()[2:8] for line in step.splitlines()[1:] if len(line.split()) == 8])
        for step in steps
    ]
    last = {}
    for step, values in zip(steps, rows, strict=True):
        last[float(step.split("time")[1].split()[0])] = values.astype(float)
    found = []
    for k in range(1, len(gradients) + 1):
        values = last[float(k)]
        assert np.ptp(values, axis=0).max() <= 1e-5 * abs(values).max()  # homogeneous
        xx, yy, zz, xy, xz, yz = values.mean(axis=0)
        found.append([[xx, xy, xz], [xy, yy, yz], [xz, yz, zz]])
    return np.array(found)
