"""Arrays, meshes and lists of points that programs for image correlation write."""

from collections.abc import Callable
from pathlib import Path

import numpy as np

from .dialects import DIALECTS, EXPORTS, RawField


def _rows(
    form: str, places, displacements, unit: str | None = "px", subset=None, lost=None
) -> RawField:
    """Return the rows of images, (images, points, d), with places of one or of all images."""
    shape = displacements.shape
    return RawField(
        DIALECTS[form],
        unit,
        np.repeat(np.arange(1, shape[0] + 1), shape[1]),
        np.broadcast_to(places, shape).reshape(-1, shape[2]),
        displacements.reshape(-1, shape[2]),
        np.full(shape[0] * shape[1], np.nan),
        np.zeros(shape[0] * shape[1], dtype=bool) if lost is None else lost.ravel(),
        subset=subset,
        notes=(f"{form} marks no lost points",) if lost is None else (),
    )


def _al_dic(found: dict) -> RawField:
    """Return the rows of arrays of al-dic, (nodes, images) or of one image."""
    u = np.stack([found[name].reshape(len(found[name]), -1).T for name in ("disp_u", "disp_v")], -1)
    settings = found.get("DICpara", {"um2px": 1.0, "winsize": None})
    u /= settings["um2px"]
    return _rows("al-dic, arrays", found["coordinates"], u, subset=settings["winsize"])


def _npz(path: Path) -> RawField:
    """Return the rows of arrays of al-dic or muDIC."""
    with np.load(path, allow_pickle=False) as file:
        found = dict(file)
    if "disp_u" in found:
        return _al_dic(found)
    if "coords" not in found:
        raise ValueError(EXPORTS["arrays"])
    places, u = (
        np.moveaxis(found[name], (-1, 1), (0, -1)).reshape(found[name].shape[-1], -1, 2)
        for name in ("coords", "disp")
    )
    return _rows("muDIC", places, u)


def _mat(path: Path) -> RawField:
    """Return the rows of a file of al-dic or Ncorr."""
    from scipy.io import loadmat

    try:
        found = loadmat(path, simplify_cells=True)
    except NotImplementedError:
        raise ValueError(EXPORTS["MATLAB 7.3"]) from None
    if "disp_u" in found:
        return _al_dic(found)
    info = found["data_dic_save"]["dispinfo"]
    images = np.atleast_1d(found["data_dic_save"]["displacements"])
    u = np.stack([[one[f"plot_{axis}_ref_formatted"] for one in images] for axis in "uv"], axis=-1)
    size = float(info["pixtounits"])
    places = np.stack(np.indices(u.shape[1:3])[::-1], axis=-1) * (info["spacing"] + 1) * size
    u = u.reshape(len(images), -1, 2)
    there = u.any(axis=-1)  # a point outside the region of interest, or lost, is 0
    region = there.any(axis=0)
    return _rows(
        "Ncorr",
        places.reshape(-1, 2)[region],
        u[:, region],
        {"pixels": "px"}.get(info["units"], info["units"]),
        (2 * info["radius"] + 1) * size,
        ~there[:, region],
    )


def _vtu(path: Path) -> RawField:
    """Return the rows of the nodes of a mesh of pyxel."""
    import meshio

    mesh = meshio.vtu.read(path)  # `meshio.read` ends the process if it cannot read a file
    return _rows("pyxel", mesh.points[:, :2], mesh.point_data["U"][None, :, :2], None)


def _dic(path: Path) -> RawField:
    """Return the rows of the list of tracked points of py3dic."""
    head, _, *lines = path.read_text("utf-8").strip().splitlines()
    pairs = [[pair.split(",") for pair in line.strip().split("\t")[1:]] for line in lines]
    places = np.array(pairs, dtype=float)
    return _rows("py3dic", places[0], places - places[0], subset=float(head.split()[3]))


READERS: dict[str, Callable[[Path], RawField]] = {
    ".npz": _npz,
    ".mat": _mat,
    ".vtu": _vtu,
    ".dic": _dic,
}
"""Readers by the endings of files."""


def rows_of_arrays(path: Path) -> RawField:
    """Return the rows of a file whose ending `READERS` or `EXPORTS` has."""
    ending = path.suffix.lower()
    if ending in EXPORTS:
        raise ValueError(f"{path} is not read. {EXPORTS[ending]}")
    try:
        return READERS[ending](path)
    except OSError as error:
        raise ValueError(f"cannot read {path}: {error.strerror or error}") from None
    except KeyError as error:
        raise ValueError(
            f"{path}: there is no {error}, as programs that are known write it"
        ) from None
    except Exception as error:  # readers of other packages raise errors of any type
        raise ValueError(f"{path} cannot be read: {error}") from None
