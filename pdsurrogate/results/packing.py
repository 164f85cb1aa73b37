"""States of a result as data within a page of HTML, for its viewer (``viewer/main.js``): cells,
motions and fields, each array once, compressed, and no more than there is room for.
"""

import base64
import zlib
from collections.abc import Sequence
from typing import Any

import numpy as np
import scipy

from ..body import CellMesh
from ..body.cell_mesh import CORNERS
from ..progress import event
from ..scenes import Units
from .figures import limits_of
from .measures import greatest_of, label_of, scalars_of
from .places import cells_at, displacements_at
from .states import Fields

USUAL = ("displacement", "von_mises", "principal_stretch", "damage")
"""Fields that a page shows first, as far as the last state has them."""

STEPS = 65534
"""Number of steps into which the range of a field in one state is divided; the next code is that
of values that are not finite.
"""

CAUTION = 1.15
"""Factor on sizes that are estimated from the last state."""


class Pieces:
    """Arrays as text, each once.

    Attributes
    ----------
    listed : list of tuple
        Type, number of components and text of each array: its columns one after the other as
        differences from entry to entry, all first bytes of them before all second ones,
        compressed (zlib), in base64.
    size : int
        Number of characters of all texts.
    """

    def __init__(self) -> None:
        self.listed: list[tuple[str, int, str]] = []
        self.size = 0
        self._known: dict[tuple, int] = {}

    def add(self, array: np.ndarray) -> int:
        """Return the number of the piece with an array, shape (n,) or (n, components)."""
        flat = np.ascontiguousarray(array.T).ravel()
        flat = flat.view(f"<u{flat.itemsize}")
        bytes_ = np.diff(flat, prepend=flat.dtype.type(0)).view(np.uint8)
        packed = zlib.compress(bytes_.reshape(-1, flat.itemsize).T.tobytes())
        key = array.dtype.str, array.shape, packed
        if key not in self._known:
            self._known[key] = len(self.listed)
            text = base64.b64encode(packed).decode()
            self.listed.append((array.dtype.str[1:], int(np.prod(array.shape[1:])), text))
            self.size += len(text)
        return self._known[key]

    def add_coded(self, values: np.ndarray) -> tuple[int, float, float]:
        """Return the number of the piece with real values as codes, and the ends of their range."""
        there = np.isfinite(values)
        low, high = (
            (float(values[there].min()), float(values[there].max())) if there.any() else (0.0, 0.0)
        )
        shares = (values[there] - low) * (STEPS / (high - low) if high > low else 0.0)
        codes = np.full(values.shape, STEPS + 1, "<u2")
        codes[there] = shares.round()
        return self.add(codes), low, high


def names_of(fields: Fields, first: Sequence[str]) -> list[str]:
    """Return the names of all fields of a state and of their components, those that a page shows
    first before the others; raise ValueError if one of `first` does not exist.
    """
    for name in first:
        scalars_of(fields, name)
    every = [*first, *(name for name in USUAL if name in fields)]
    for name, values in fields.items():
        if values.ndim == 1:
            every.append(name)
        else:
            axes = "123"
            tensor = values[0].size == 9
            every += [f"{name}_{i}{j}" for i in axes for j in (axes if tensor else ("",))]
    return list(dict.fromkeys(every))


def _frame(
    pieces: Pieces, cells: CellMesh, moved: np.ndarray, kept: np.ndarray | None = None
) -> dict[str, Any]:
    """Return the entry of a state for its cells and the displacements of their nodes, of the outer
    sides of chosen cells alone if `kept` flags them.
    """
    corners, owners = cells.outer_sides
    nodes = cells.nodes
    if kept is not None:
        used, corners = np.unique(corners, return_inverse=True)
        corners = corners.reshape(len(owners), -1)
        nodes, moved, owners = nodes[used], moved[used], (np.cumsum(kept) - 1)[owners]
    flat = cells.dimension == 2
    listed = [pieces.add(block.astype("<i4")) for block in cells.blocks] if kept is None else []
    sides = pieces.add(corners.astype("<i4"))
    return {
        "nodes": pieces.add(nodes.astype("<f4")),
        "moved": pieces.add_coded(moved),
        "faces": listed if flat else [sides],
        "owners": None if flat else pieces.add(owners.astype("<i4")),
        "cells": [] if flat else listed,
        "lines": sides if flat else None,
    }


def _described(name: str, units: Units) -> dict[str, Any]:
    symbol = label_of(name, Units())
    return {"symbol": symbol, "unit": label_of(name, units)[len(symbol) + 2 : -1], "parts": []}


def _limit(entry: dict[str, Any], greatest: float) -> None:
    """Add the ends of the scale of colors to the entry of a field that is complete."""
    ends = [end for part in entry["parts"] if part for end in part[1:]]
    entry["limits"] = limits_of(np.array(ends), greatest)


def body_of(
    result, shown: Sequence[int], names: Sequence[str], pieces: Pieces, inside: bool
) -> dict[str, Any]:
    """Return the entry of a body with fields in the states whose numbers are `shown`; of a solid
    the cells at its surface alone, unless `inside`.
    """
    kept = None
    if not inside:
        meshes = (result.cells(number)[0] for number in shown)
        kept = np.zeros(len(result.cells(-1)[0]), dtype=bool)
        for mesh in meshes:
            kept[mesh.outer_sides[1]] = True
    entries = {name: _described(name, result.scene.units) for name in names}
    greatest = dict.fromkeys(names, 0.0)
    states = []
    box = []
    for done, number in enumerate(shown, 1):
        cells, moved = result.cells(number)
        box += [(cells.nodes + moved).min(axis=0), (cells.nodes + moved).max(axis=0)]
        states.append(_frame(pieces, cells, moved, kept))
        fields = result.states[number][1]
        for name, entry in entries.items():
            try:
                values = scalars_of(fields, name)
            except ValueError:  # a run in dynamics has fields that its equilibria lack
                entry["parts"].append(None)
                continue
            greatest[name] = max(greatest[name], greatest_of(fields, name))
            entry["parts"].append(pieces.add_coded(values if kept is None else values[kept]))
        event("packing", done, len(shown))
    for name, entry in entries.items():
        _limit(entry, greatest[name])
    numbers = np.arange(len(cells)) if kept is None else np.flatnonzero(kept)
    places = fields["position"][numbers, : cells.dimension]
    return _body(pieces, places, numbers, box, states, entries)


def _body(pieces: Pieces, places, numbers, box, states, entries) -> dict[str, Any]:
    return {
        "dimension": places.shape[1],
        "box": [np.min(box, axis=0).tolist(), np.max(box, axis=0).tolist()],
        "places": pieces.add(places.astype("<f4")),
        "numbers": pieces.add(numbers.astype("<i4")),
        "states": states,
        "fields": entries,
    }


def measured_bodies(
    result, measured: np.ndarray, shown: Sequence[int], pieces: Pieces
) -> dict[str, Any]:
    """Return entries as of `body_of` for measured displacements and their differences from those of
    a result, on a square or a cube around every place; none if no step is shown.

    `measured` has the columns step (step k is output k - 1), places and displacements.
    """
    d = result.scene.dimension
    units = result.scene.units
    places, at = np.unique(measured[:, 1 : 1 + d], axis=0, return_inverse=True)
    number = cells_at(result.cells(-1)[0], result.field("position")[:, :d], places)
    # The distance from neighbors along the axes of a grid.
    beside = scipy.spatial.cKDTree(places).query(places, k=min(2 * d + 1, len(places)))[0]
    corners = places[:, None] + (CORNERS[d] - 0.5) * np.median(beside[:, 1:].mean(axis=1))
    corners = corners.reshape(-1, d)
    cells = CellMesh(corners, (np.arange(len(corners)).reshape(-1, 2**d),))
    names = ["displacement", *(f"displacement_{axis}" for axis in range(1, d + 1))]
    kinds = {
        kind: {name: _described(name, units) for name in names}
        for kind in ("measured", "difference")
    }
    states = []
    for output in shown:
        rows = measured[:, 0] == output + 1
        moved = np.full(places.shape, np.nan)
        moved[at.ravel()[rows]] = measured[rows, 1 + d :]
        fields = result.states[output][1]
        simulated = displacements_at(fields, number, places)
        around = displacements_at(fields, number.repeat(2**d), corners)
        strained = np.nan_to_num(around - simulated.repeat(2**d, axis=0))
        there = np.nan_to_num(moved).repeat(2**d, axis=0) + strained
        states.append(_frame(pieces, cells, there) | {"lines": None})
        off = moved - simulated
        for entries, vectors in zip(kinds.values(), (moved, off), strict=True):
            columns = [np.linalg.norm(vectors, axis=1), *vectors.T]
            for entry, values in zip(entries.values(), columns, strict=True):
                known = np.isfinite(values).any()
                entry["parts"].append(pieces.add_coded(values) if known else None)
    if not any(kinds["difference"]["displacement"]["parts"]):
        return {}
    box = [places.min(axis=0), places.max(axis=0)]
    for kind, entries in kinds.items():
        for entry in entries.values():
            entry["symbol"] += f" {kind}"
            _limit(entry, 0.0)
    numbers = np.arange(len(places))
    return {
        kind: _body(pieces, places, numbers, box, states, entries) | {"point": "place"}
        for kind, entries in kinds.items()
    }


def packed(
    result, first: Sequence[str], most: int, room: int
) -> tuple[dict[str, Any] | None, list[int], Pieces, list[str]]:
    """Return the entry of the body of a result (`body_of`), the numbers of its states, its pieces,
    and what was left out, in words, so that all texts have at most `room` characters.

    Fields named in `first` come before the others. Where the room is too small, first the inside of
    a solid is left out, then outputs above a number for which the first field fits in, then
    fields that no longer fit. Without room for a single output there is no entry.
    """
    count = len(result.states)
    last = result.states[count - 1][1]
    names = names_of(last, first)
    sizes = {
        name: _size(lambda pieces, n=name: pieces.add_coded(scalars_of(last, n))) for name in names
    }
    cells, moved = result.cells(-1)
    frame = _size(lambda pieces: _frame(pieces, cells, moved))
    wanted = min(most, count)
    inside = cells.dimension == 2 or wanted * (frame + sizes[names[0]]) <= room
    if not inside:
        kept = np.zeros(len(cells), dtype=bool)
        kept[cells.outer_sides[1]] = True
        frame = _size(lambda pieces: _frame(pieces, cells, moved, kept))
        sizes = {name: size * kept.mean() for name, size in sizes.items()}
    while True:
        fit = min(wanted, int(room // (frame + sizes[names[0]])))
        if fit < 1:
            return None, [], Pieces(), ["the body, which is too large for the viewer"]
        shown = (
            np.linspace(0 if fit > 1 else count - 1, count - 1, fit).round().astype(int).tolist()
        )
        left = room - fit * frame
        chosen = []
        for name in names:
            if fit * sizes[name] <= left:
                chosen.append(name)
                left -= fit * sizes[name]
        pieces = Pieces()
        body = body_of(result, shown, chosen, pieces, inside)
        if pieces.size <= room:
            break
        # The last state was not the largest one.
        frame, sizes = frame * CAUTION, {name: size * CAUTION for name, size in sizes.items()}
    told = [] if inside else ["the inside of the solid"]
    if fit < count:
        told.append(f"{count - fit} of {count} outputs")
    if missing := [name for name in names if name not in chosen]:
        told.append(f"the fields {', '.join(missing)}")
    return body, shown, pieces, told


def _size(add) -> float:
    """Return the estimated number of characters of what a function adds to pieces."""
    pieces = Pieces()
    add(pieces)
    return pieces.size * CAUTION
