"""Compare correlated fields with the motion of the finite elements.

python check.py FOLDER  prints by program, variant and step: points, lost ones, errors in pixels
"""

import csv
import sys
from pathlib import Path

import numpy as np
from draw import CENTER, RADIUS, SIZE, VARIANTS, refined, triangles
from matplotlib.tri import LinearTriInterpolator, Triangulation

COLUMNS = {
    "sun-dic": (("X Coord", "Y Coord", "X Disp", "Y Disp"), "step_{}.csv", 0, 1),
    "al-dic": (("x_px", "y_px", "disp_u", "disp_v"), "frame_{}.csv", 1, -1),
}
"""Columns, name of a file, its number for the reference image, sign of v if y points downward."""


def true_motion(camera, nodes, moves, pixels):
    """Displacements by step of pixels of the reference image, and their places on the sheet."""
    places = refined(nodes).reshape(-1, 2)
    sheet = Triangulation(*places.T, triangles(*refined(nodes).shape[:2]))
    origin = camera.pixels(np.zeros(2), 0)
    by_axis = camera.pixels(np.eye(2), 0) - origin
    X = (pixels - origin) @ np.linalg.inv(by_axis)
    finder = sheet.get_trifinder()
    found = []
    for step, move in enumerate(moves):
        u = [
            LinearTriInterpolator(sheet, one, finder)(*X.T).filled(np.nan)
            for one in refined(move).reshape(-1, 2).T
        ]
        found.append(camera.pixels(X + np.stack(u, axis=1), step) - pixels)
    return np.array(found), X


def read(path, columns, sign):
    """Places and displacements, y and v downward."""
    with path.open(encoding="utf-8-sig") as lines:
        rows = [[float(row[name] or "nan") for name in columns] for row in csv.DictReader(lines)]
    return np.array(rows) * [1, 1, 1, sign]


def main(folder: Path) -> None:
    """Print the comparison."""
    truth = np.load(folder / "truth.npz")
    print("variant, program, step: points, lost, error rms, mean right, mean down, greatest, off")
    for variant, camera in VARIANTS.items():
        for program, (columns, name, first, sign) in COLUMNS.items():
            motion = None
            for step in range(1, len(truth["moves"]) // 2 + 1):
                path = folder / variant / program / name.format(step + first)
                if not path.exists():
                    continue
                table = read(path, columns, sign)
                if motion is None:
                    motion, X = true_motion(camera, truth["nodes"], truth["moves"], table[:, :2])
                error = table[:, 2:] - motion[2 * step]
                lost = np.isnan(table[:, 2:]).any(axis=1)
                off = np.linalg.norm(error, axis=1)
                near = (X < 0.125).any(1) | (X > SIZE - 0.125).any(1)
                near |= np.linalg.norm(X - CENTER, axis=1) < RADIUS + 0.125
                for where, chosen in (("inside", ~near), ("edges", near)):
                    one = error[chosen & ~lost & np.isfinite(off)]
                    rms, size = np.sqrt((one**2).mean()), np.linalg.norm(one, axis=1)
                    found = len(one), (lost & chosen).sum(), rms, *one.mean(axis=0), size.max()
                    head = f"{variant:8}{program:8}{step} {where:7}"
                    print(head, *(f"{value:.4g}" for value in found), (size > 0.2).sum())


if __name__ == "__main__":
    main(Path(sys.argv[1]))
