"""Speckle images of a sheet with a hole whose motion finite elements give.

python draw.py FOLDER  writes FOLDER/VARIANT/image_K.png and masks, and FOLDER/truth.npz

The sheet has 3 x 4 cm, its lower left corner is (0, 0), its hole of radius 0.5 has the center
(1.2, 2.3). Top and bottom are held by grips that move apart by 1 cm each, in twelve equal steps,
of which six are the test. The material is Gent's, incompressible in plane stress, mu = 400 kPa,
limit 15: W = -mu limit/2 log(1 - (I1 - 3)/limit) with I1 = tr(F^T F) + det(F)^-2 of the F in the
plane. A pixel has the mean of four values of a random smooth function of the place on the sheet,
which is that of the deformed finite elements (9-node quadrilaterals) below the pixel.
"""

import sys
from dataclasses import dataclass, field
from pathlib import Path

import felupe as fem
import numpy as np
from matplotlib.tri import Triangulation
from PIL import Image
from scipy.ndimage import binary_erosion, gaussian_filter, map_coordinates, spline_filter

MU, LIMIT, STEPS, TRAVEL = 400.0, 15.0, 12, 2.0
CENTER, RADIUS, SIZE = np.array([1.2, 2.3]), 0.5, np.array([3.0, 4.0])
SIDES, RADIAL, PARTS = (36, 48, 36, 48), 40, 4
SHAPE = (816, 640)
"""Rows and columns of an image."""


@dataclass(frozen=True)
class Camera:
    """Pixels to a centimeter, turn, and motion after the reference image.

    Attributes
    ----------
    scale : float
        Pixels to a centimeter.
    turn : float
        Degrees, counterclockwise.
    drift : ndarray, shape (steps + 1, 3)
        Shift in pixels (right, down) and turn in degrees by image.
    spots : int
        Reflections: white spots that appear in the first image after the reference and stay where
        they are in the image.
    noise : int
        Seed of the noise of the images.
    """

    scale: float = 120.0
    turn: float = 0.0
    drift: np.ndarray = field(default_factory=lambda: np.zeros((STEPS + 1, 3)))
    spots: int = 0
    noise: int = 0

    def pixels(self, x: np.ndarray, step: int) -> np.ndarray:
        """Places in the image (right, down) of places in space."""
        right, down, turn = self.drift[step]
        c, s = np.cos(angle := np.radians(self.turn + turn)), np.sin(angle)
        turned = (x - SIZE / 2) @ np.array([[c, s], [-s, c]])
        return self.scale * turned * [1, -1] + [SHAPE[1] / 2 + right, SHAPE[0] / 2 + down]


MOVED = np.random.default_rng(3).normal(0, [3, 3, 0.08], (STEPS + 1, 3)).cumsum(axis=0) / 2
VARIANTS = {
    "base": Camera(),
    "turned": Camera(turn=1.0),
    "moved": Camera(drift=MOVED - MOVED[0], noise=1),
    "lost": Camera(spots=6),
}


def mesh() -> tuple[fem.Mesh, np.ndarray]:
    """Rings of 9-node quadrilaterals, and their nodes as a grid (around, outward)."""
    corners = np.array([[0, 0], [SIZE[0], 0], SIZE, [0, SIZE[1]]])
    outer = np.concatenate(
        [
            corners[k] + np.linspace(0, 1, 2 * n, endpoint=False)[:, None] * step
            for k, (n, step) in enumerate(
                zip(SIDES, np.roll(corners, -1, 0) - corners, strict=True)
            )
        ]
    )
    ray = outer - CENTER
    inner = CENTER + RADIUS * ray / np.linalg.norm(ray, axis=1)[:, None]
    outward = np.linspace(0, 1, 2 * RADIAL + 1) ** 1.4
    nodes = inner[:, None] + outward[:, None] * (outer - inner)[:, None]
    number = np.arange(len(outer) * len(outward)).reshape(len(outer), -1)
    i, j = np.meshgrid(2 * np.arange(sum(SIDES)), 2 * np.arange(RADIAL), indexing="ij")
    # corners counterclockwise seen from above: outward first, then around
    order = [(0, 0), (0, 2), (2, 2), (2, 0), (0, 1), (1, 2), (2, 1), (1, 0), (1, 1)]
    cells = np.stack([number[(i + a) % len(outer), j + b].ravel() for a, b in order], axis=1)
    return fem.Mesh(nodes.reshape(-1, 2), cells, "quad9"), nodes


def stress(fields, **kwargs):
    """First Piola-Kirchhoff stress in the plane, of Gent's law without change of volume."""
    F, state = fields[0], fields[-1]
    slope, _, inverse, J, _ = parts(F)
    return [2 * slope * (F - np.swapaxes(inverse, 0, 1) / J**2), state]


def elasticity(fields, **kwargs):
    """Derivative of `stress` by F."""
    slope, second, inverse, J, G = parts(fields[0])
    unit = np.eye(2)
    dG = 2 * (
        np.einsum("ik,jl->ijkl", unit, unit)[..., None, None]
        + (
            2 * np.einsum("ji...,lk...->ijkl...", inverse, inverse)
            + np.einsum("jk...,li...->ijkl...", inverse, inverse)
        )
        / J**2
    )
    return [slope * dG + second * np.einsum("ij...,kl...->ijkl...", G, G)]


def parts(F):
    """First two derivatives of W by I1, inverse and determinant of F, dI1/dF."""
    J, inverse = fem.math.det(F), fem.math.inv(F)
    left = LIMIT + 3 - (F**2).sum(axis=(0, 1)) - J**-2
    G = 2 * (F - np.swapaxes(inverse, 0, 1) / J**2)
    return MU * LIMIT / 2 / left, MU * LIMIT / 2 / left**2, inverse, J, G


def solve() -> tuple[np.ndarray, np.ndarray, np.ndarray]:
    """Nodes, displacements by step, and forces by step (kPa cm) of the top."""
    sheet, nodes = mesh()
    region = fem.RegionBiQuadraticQuad(sheet)
    motion = fem.FieldContainer([fem.Field(region, dim=2)])
    body = fem.SolidBody(fem.Material(stress, elasticity), motion)
    top, bottom = (np.flatnonzero(sheet.points[:, 1] == y) for y in (SIZE[1], 0.0))
    moves, forces = [], []
    for step in range(1, STEPS + 1):
        held = {
            "bottom": fem.Boundary(motion[0], fy=0.0),
            "right": fem.Boundary(motion[0], fy=SIZE[1], skip=(0, 1)),
            "top": fem.Boundary(motion[0], fy=SIZE[1], skip=(1, 0), value=TRAVEL * step / STEPS),
        }
        dof0, dof1 = fem.dof.partition(motion, held)
        ext0 = fem.dof.apply(motion, held, dof0)
        found = fem.newtonrhapson(
            items=[body], dof0=dof0, dof1=dof1, ext0=ext0, kwargs={}, tol=1e-10, verbose=0
        )
        force = np.asarray(found.fun.todense() if hasattr(found.fun, "todense") else found.fun)
        force = force.reshape(-1, 2)
        assert abs(force[top].sum(0) + force[bottom].sum(0)).max() < 1e-6
        move = motion[0].values - [0, TRAVEL * step / STEPS / 2]
        moves.append(move.reshape(nodes.shape))
        forces.append(force[top, 1].sum())
    return nodes, np.array(moves), np.array(forces)


def refined(nodes: np.ndarray) -> np.ndarray:
    """Values of the quadratic elements at `PARTS` places in each direction."""
    t = np.arange(PARTS) / PARTS
    shape = np.stack([(2 * t - 1) * (t - 1), 4 * t * (1 - t), t * (2 * t - 1)])
    ring = np.concatenate([nodes, nodes[:1]])
    around = np.einsum("nt,ncjd->ctjd", shape, np.stack([ring[:-2:2], ring[1::2], ring[2::2]]))
    around = around.reshape(-1, *nodes.shape[1:])
    outward = np.einsum(
        "nt,nicd->ictd", shape, np.stack([around[:, :-2:2], around[:, 1::2], around[:, 2::2]])
    )
    return np.concatenate([outward.reshape(len(around), -1, 2), around[:, -1:]], axis=1)


def triangles(around: int, outward: int) -> np.ndarray:
    """Numbers of the corners of triangles between the values of `refined`."""
    number = np.arange(around * outward).reshape(around, outward)
    a, b = number[:, :-1], number[:, 1:]
    c, d = np.roll(a, -1, 0), np.roll(b, -1, 0)
    return np.concatenate(
        [np.stack([one.ravel() for one in corner], axis=1) for corner in ((a, b, c), (b, d, c))]
    )


class Speckle:
    """A random smooth function of material places, 480 values to a centimeter."""

    def __init__(self, seed: int):
        noise = np.random.default_rng(seed).standard_normal((2100, 1620))
        smooth = gaussian_filter(noise, 7.0)
        self.values = spline_filter(130 + 60 * np.tanh(1.3 * smooth / smooth.std()))

    def __call__(self, X: np.ndarray) -> np.ndarray:
        at = (X[..., ::-1] + 0.15) * 480
        return map_coordinates(self.values, np.moveaxis(at, -1, 0), order=3, prefilter=False)


def draw(camera, step, nodes, moved, speckle, rng) -> tuple[np.ndarray, np.ndarray]:
    """Image of 8 bits, and where the sheet is seen."""
    places = refined(nodes)
    seen = camera.pixels(places + refined(moved), step)
    below = Triangulation(*seen.reshape(-1, 2).T, triangles(*places.shape[:2]))
    rows, columns = np.mgrid[: 2 * SHAPE[0], : 2 * SHAPE[1]] / 2 - 0.25
    under = below.get_trifinder()(columns, rows)
    inside = under >= 0
    at = np.stack([columns[inside], rows[inside], np.ones(inside.sum())])
    X = [
        np.einsum("nk,kn->n", below.calculate_plane_coefficients(one)[under[inside]], at)
        for one in places.reshape(-1, 2).T
    ]
    values = np.full(inside.shape, 8.0)
    values[inside] = speckle(np.stack(X, axis=1))
    value = values.reshape(SHAPE[0], 2, SHAPE[1], 2).mean(axis=(1, 3))
    if camera.spots and step:
        middles = np.random.default_rng(7).uniform([180, 150], [460, 670], (camera.spots, 2))
        y, x = np.mgrid[: SHAPE[0], : SHAPE[1]]
        for middle in middles:
            value[np.hypot(x - middle[0], y - middle[1]) < 10] = 255
    value += rng.normal(0, 1.5, SHAPE)
    return (
        np.clip(np.round(value), 0, 255).astype(np.uint8),
        inside.reshape(SHAPE[0], 2, SHAPE[1], 2).all(axis=(1, 3)),
    )


def main(folder: Path) -> None:
    """Write images, masks, forces and the motion."""
    nodes, moves, forces = solve()
    print("forces (kPa cm):", np.round(forces, 3))
    moves = np.concatenate([np.zeros((1, *nodes.shape)), moves])
    np.savez_compressed(folder / "truth.npz", nodes=nodes, moves=moves, forces=forces)
    lines = [f"{step},{force:.3f}" for step, force in enumerate(forces[1::2], 1)]
    (folder / "forces.csv").write_text("\n".join(["step,force", *lines, ""]))
    speckle = Speckle(54)
    for name, camera in VARIANTS.items():
        (folder / name / "masks").mkdir(parents=True, exist_ok=True)
        (folder / name / "images").mkdir(exist_ok=True)
        rng = np.random.default_rng(camera.noise)
        for step, moved in enumerate(moves):
            image, mask = draw(camera, step, nodes, moved, speckle, rng)
            Image.fromarray(image).save(folder / name / "images" / f"image_{step:02}.png")
            mask = binary_erosion(mask, iterations=1)
            Image.fromarray((255 * mask).astype(np.uint8)).save(
                folder / name / "masks" / f"mask_{step:02}.png"
            )


if __name__ == "__main__":
    main(Path(sys.argv[1]))
