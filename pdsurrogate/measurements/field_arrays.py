"""Arrays, meshes and lists of points that programs for image correlation write."""

from collections.abc import Callable
from pathlib import Path

import numpy as np

from .dialects import Dialect, Rows

AL_DIC = Dialect("al-dic", ("coordinates",), ("disp_u", "disp_v"), "px", "y")
MUDIC = Dialect(
    "muDIC",
    ("coords",),
    ("disp",),
    "px",
    None,
    deformed=True,
    hint=": upward for images that image_stack_from_folder read, which turns them upside down,"
    " downward for those of image_stack_from_list",
)
NCORR = Dialect("Ncorr", ("data_dic_save",), (), None, "yv")
PY3DIC = Dialect("py3dic", (), (), "px", "yv")
PYXEL = Dialect("pyxel", (), ("U",), None, "")

EXPORTS = {
    ".sdic": "sun-dic: save the displacements as CSV in its window, or the columns of"
    " sundic.post_process.getDisplacements for each pair",
    ".pyv": "geopyv: its file can run code when it is opened; write nodes and displacements of each"
    " mesh as a table x,y,u,v (y and v downward)",
    ".p": "muDIC: its file can run code when it is opened; save the arrays of its Fields:"
    " np.savez('fields.npz', coords=fields.coords(), disp=fields.disp())",
    ".npy": "a single array has no places: save both with np.savez, as the guide on fields says",
}
"""Files that are not read, by their endings, with the program and what to export."""

NCORR_EXPORT = (
    "MATLAB 7.3, as Ncorr writes it, is not read; in MATLAB: load FILE; d = data_dic_save;"
    " d.displacements = rmfield(d.displacements, {'roi_dic', 'roi_ref_formatted',"
    " 'roi_cur_formatted'}); data_dic_save = rmfield(d, {'strains', 'straininfo'});"
    " save fields.mat data_dic_save -v7"
)


def _rows(dialect: Dialect, unit: str | None, places, displacements, **more) -> Rows:
    """Return the rows of images, (images, points, d), with places of one or of all images."""
    images, points, d = displacements.shape
    return Rows(
        dialect,
        unit,
        np.repeat(np.arange(1, images + 1), points),
        np.broadcast_to(places, displacements.shape).reshape(-1, d),
        displacements.reshape(-1, d),
        np.full(images * points, np.nan),
        more.pop("lost", np.zeros((images, points), dtype=bool)).ravel(),
        notes=(f"{dialect.form} marks no lost points",) if "lost" not in more else (),
        **more,
    )


def _al_dic(found: dict) -> Rows:
    """Return the rows of arrays of al-dic, (nodes, images) or of one image."""
    parts = [np.asarray(found[name], dtype=float) for name in AL_DIC.displacements]
    u = np.stack([part.reshape(len(part), -1).T for part in parts], axis=-1)
    scale = float(found["DICpara"]["um2px"]) if "DICpara" in found else 1.0
    return _rows(AL_DIC, "px", np.asarray(found["coordinates"]), u / scale)


def _npz(path: Path) -> Rows:
    """Return the rows of arrays of al-dic or muDIC."""
    with np.load(path, allow_pickle=False) as file:
        found = dict(file)
    if {"coordinates", *AL_DIC.displacements} <= found.keys():
        return _al_dic(found)
    if {"coords", "disp"} <= found.keys():
        places, u = (
            np.moveaxis(found[name], (-1, 1), (0, -1)).reshape(found[name].shape[-1], -1, 2)
            for name in ("coords", "disp")
        )
        return _rows(MUDIC, "px", places, u)
    raise ValueError(
        f"the arrays {', '.join(found)} are not those of al-dic (coordinates, disp_u, disp_v) or"
        " muDIC (coords, disp). Those of DICpy are not read: it adds the steps at fixed pixels, not"
        " at the points of the body (a stretch of 1.5 in five steps becomes 1.42)"
    )


def _mat(path: Path) -> Rows:
    """Return the rows of a file of al-dic or Ncorr."""
    from scipy.io import loadmat

    try:
        found = loadmat(path, simplify_cells=True)
    except NotImplementedError:
        raise ValueError(NCORR_EXPORT) from None
    if {"coordinates", *AL_DIC.displacements} <= found.keys():
        return _al_dic(found)
    if "data_dic_save" not in found:
        raise ValueError("there are neither arrays of al-dic nor data_dic_save of Ncorr")
    info = found["data_dic_save"]["dispinfo"]
    images = found["data_dic_save"]["displacements"]
    if isinstance(images, dict):
        images = [images]
    u = np.stack(
        [[np.atleast_2d(one[f"plot_{axis}_ref_formatted"]) for axis in "uv"] for one in images]
    )
    size, spacing = float(info["pixtounits"]), int(info["spacing"]) + 1
    rows, columns = u.shape[2:]
    grid = np.stack(np.meshgrid(np.arange(columns), np.arange(rows)), axis=-1).reshape(-1, 2)
    u = np.moveaxis(u, 1, -1).reshape(len(images), -1, 2)
    there = (u != 0).any(axis=-1)  # a point outside the region of interest, or lost, is 0
    region = there.any(axis=0)
    return _rows(
        NCORR,
        {"pixels": "px"}.get(info["units"], info["units"]),
        grid[region] * spacing * size,
        u[:, region],
        lost=~there[:, region],
        subset=(2 * float(info["radius"]) + 1) * size,
    )


def _vtu(path: Path) -> Rows:
    """Return the rows of the nodes of a mesh of pyxel."""
    import meshio

    mesh = meshio.read(path)
    if "U" not in mesh.point_data:
        raise ValueError("there is no field U of displacements, as pyxel writes it")
    return _rows(PYXEL, None, mesh.points[:, :2], mesh.point_data["U"][None, :, :2])


def _dic(path: Path) -> Rows:
    """Return the rows of the list of tracked points of py3dic."""
    lines = path.read_text("utf-8").splitlines()
    window = float(lines[0].split()[3])
    places = np.array(
        [
            [[float(one) for one in pair.split(",")] for pair in line.split("\t")[1:] if pair]
            for line in lines[2:]
            if line.strip()
        ]
    )
    return _rows(PY3DIC, "px", places[0], places - places[0], subset=window)


READERS: dict[str, Callable[[Path], Rows]] = {
    ".npz": _npz,
    ".mat": _mat,
    ".vtu": _vtu,
    ".dic": _dic,
}
"""Readers by the endings of files."""


def rows_of_arrays(path: Path) -> Rows:
    """Return the rows of a file whose ending `READERS` or `EXPORTS` has."""
    ending = path.suffix.lower()
    if ending in EXPORTS:
        raise ValueError(f"{path} is not read. {EXPORTS[ending]}")
    try:
        return READERS[ending](path)
    except OSError as error:
        raise ValueError(f"cannot read {path}: {error.strerror or error}") from None
    except (ValueError, KeyError, IndexError, TypeError) as error:
        raise ValueError(f"{path}: {error}") from None
