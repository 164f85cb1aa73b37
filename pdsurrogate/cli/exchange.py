"""Results in the forms of those who measure: fields on the pixels of an image, and the history as
the table of a testing machine.
"""

from pathlib import Path

import numpy as np

from ..measurements.quantities import amount_in, factor
from ..results import Result
from ..results.files import replacing
from ..results.places import pixel_grid, write_columns
from ..scenes.pulled import pulled_force


def check_new(option: str, path: Path | None, *endings: str) -> None:
    """Raise ValueError if a file to write exists already, or its name has another ending."""
    if path is not None and path.suffix not in endings:
        raise ValueError(f"{option} {path}: the name must end with {' or '.join(endings)}")
    if path is not None and path.exists():
        raise ValueError(f"{option} {path}: this file exists; choose another name")


def write_grid(
    path: Path,
    result: Result,
    pixels_per: tuple[str, float],
    origin: tuple[float, float],
    fields: list[str],
) -> None:
    """Write displacements in pixels, and fields, on the pixels of an image, see `pixel_grid`.

    `pixels_per` is a unit of length and the number of pixels in it.
    """
    length = result.scene.units.length
    if length is None:
        raise ValueError("--pixels-per: the scene does not name its unit of length (units.length)")
    if not 0 < pixels_per[1] < np.inf or not np.isfinite(origin).all():
        raise ValueError("--pixels-per takes a positive number, and --origin finite ones")
    pixels = pixels_per[1] / factor(pixels_per[0], length)
    grid = pixel_grid(result, pixels, origin, fields)
    if path.suffix == ".npz":
        with replacing(path) as temporary:
            np.savez_compressed(temporary, allow_pickle=False, **grid)
        return
    step, row, column = inside = np.nonzero(np.isfinite(grid["u"]))
    places = {"step": step + 1, "x [px]": column, "y [px]": row}
    moved = {f"{name} [px]": grid[name][inside] for name in "uv"}
    write_columns(path, places | moved | {name: grid[name][inside] for name in fields})


def write_machine(path: Path, result: Result, thickness: str | None) -> None:
    """Write the history as a testing machine does: time in dynamics, extension and load of the
    region that the scene pulls, from the undeformed state on.

    `thickness` of a sheet has a unit, such as "2mm".
    """
    units = result.scene.units
    key, sign = pulled_force(result.scene)
    name, axis = key.removeprefix("forces.").rsplit(".", 1)
    component = int(axis) + 1
    if units.length is None or units.stress is None:
        raise ValueError("--machine: the scene does not name its units of length and stress")
    length = factor(units.length, "m")
    if (result.scene.dimension == 2) == (thickness is None):
        raise ValueError(
            "--thickness: a solid has none"
            if thickness
            else "--machine: forces of a sheet are those per thickness: give --thickness 2mm"
        )
    thick = amount_in(thickness, "m", "thickness") if thickness else length
    newtons = factor(units.stress, "Pa") * length * thick

    timed = any("time" in row for row in result.history)
    if timed and units.time is None:
        raise ValueError("--machine: the scene does not name its unit of time (units.time)")

    def column(key: str) -> np.ndarray:
        if not any(key in row for row in result.history):
            raise ValueError(f"--machine: the history of the run has no {key}")
        return np.array([0.0, *(row.get(key, 0.0) for row in result.history)])

    moved = column(f"displacement_{name}_{component}")
    for grip in result.scene.grips:  # the other one may move as well
        if grip.edge != name:
            moved = moved - column(f"displacement_{grip.edge}_{component}")
    table = {
        "Extension (mm)": sign * 1000 * length * moved,
        "Load (N)": sign * newtons * column(f"force_{name}_{component}"),
    }
    if timed:
        table = {"Time (s)": factor(units.time, "s") * column("time"), **table}
    write_columns(path, table)
