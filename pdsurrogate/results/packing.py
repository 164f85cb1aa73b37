"""States of a result as data within a page of HTML, for its viewer (``results/viewer/main.js``):
cells, motions and fields, each array once, compressed, and no more than there is room for.
"""

import base64
import zlib
from collections.abc import Sequence
from typing import Any

import numpy as np

from ..progress import event
from ..scenes import Units
from .figures import spread
from .measures import label_of, scalars_of
from .places import cells_at, displacements_at
from .states import Fields

STEPS = 65534
"""Number of steps into which the range of a field in one state is divided; the next code is that
of values that are not finite.
"""


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

    def add(self, array: np.ndarray, kind: str) -> int:
        """Return the number of the piece with an array, shape (n,) or (n, components), of a type
        such as "f4".
        """
        columns = array.T.astype(f"<{kind}", order="C").ravel().view(f"<u{kind[1]}")
        changes = np.diff(columns, prepend=columns.dtype.type(0)).view(np.uint8)
        packed = zlib.compress(changes.reshape(-1, columns.itemsize).T.tobytes())
        piece = kind, array.size // max(len(array), 1), base64.b64encode(packed).decode()
        if piece not in self._known:
            self._known[piece] = len(self.listed)
            self.listed.append(piece)
            self.size += len(piece[2])
        return self._known[piece]

    def add_coded(self, values: np.ndarray) -> tuple[int, float, float]:
        """Return the number of the piece with real values as codes, and the ends of their range."""
        there = np.isfinite(values)
        known = values[there] if there.any() else np.zeros(1)
        low, high = float(known.min()), float(known.max())
        codes = np.full(values.shape, STEPS + 1)
        codes[there] = np.rint((values[there] - low) / (high - low or 1.0) * STEPS)
        return self.add(codes, "u2"), low, high


def names_of(fields: Fields, first: Sequence[str]) -> list[str]:
    """Return the names of all fields of a state and of their components, `first` before others."""
    every = [*first]
    for name, values in fields.items():
        axes = {1: [""], 3: ["_1", "_2", "_3"]}.get(
            values.size // len(values), [f"_{i}{j}" for i in "123" for j in "123"]
        )
        every += [name + axis for axis in axes]
    return list(dict.fromkeys(every))


def body_of(
    result, shown: Sequence[int], names: Sequence[str], inside: bool, pieces: Pieces, room: float
) -> dict[str, Any] | None:
    """Return the entry of a body with fields in the states whose numbers are `shown`, of a solid
    with the cells at its surface alone unless `inside`; None if the pieces exceed the room.
    """
    units = result.scene.units
    entries: dict[str, dict] = {
        name: {"symbol": label_of(name, Units()), "label": label_of(name, units), "parts": []}
        for name in names
    }
    kept = np.full(len(result.cells(-1)[0]), inside)
    for number in () if inside else shown:
        kept[result.cells(number)[0].outer_sides[1]] = True
    states = []
    for done, output in enumerate(shown, 1):
        fields = result.states[output][1]
        cells, moved = result.cells(output)
        corners, owners = cells.outer_sides
        nodes, faces, flat = cells.nodes, cells.blocks, cells.dimension == 2
        if not inside:
            used, corners = np.unique(corners, return_inverse=True)
            corners, nodes, moved = corners.reshape(len(owners), -1), nodes[used], moved[used]
        sides = pieces.add(corners, "i4")
        listed = [pieces.add(block, "i4") for block in faces] if inside else []
        states.append(
            {
                "nodes": pieces.add(nodes, "f4"),
                "moved": pieces.add_coded(moved),
                "faces": listed if flat else [sides],
                "owners": None if flat else pieces.add((np.cumsum(kept) - 1)[owners], "i4"),
                "cells": [] if flat else listed,
                "lines": sides if flat else None,
            }
        )
        for name, entry in entries.items():
            try:
                part = pieces.add_coded(scalars_of(fields, name)[kept])
            except ValueError:  # a run in dynamics has fields that its equilibria lack
                part = None
            entry["parts"].append(part)
        if pieces.size > room:
            return None
        event("packing", done, len(shown))
    return {
        "dimension": cells.dimension,
        "places": pieces.add(fields["position"][kept, : cells.dimension], "f4"),
        "numbers": pieces.add(np.flatnonzero(kept), "i4"),
        "states": states,
        "fields": entries,
    }


def measured_of(
    result, measured: np.ndarray, shown: Sequence[int], pieces: Pieces
) -> dict[str, Any]:
    """Return an entry for measured displacements and their differences from those of a result, for
    each of the states whose numbers are `shown`; `measured` is as for `html_page`.
    """
    d = result.scene.dimension
    places, at = np.unique(measured[:, 1 : 1 + d], axis=0, return_inverse=True)
    number = cells_at(result.cells(-1)[0], result.field("position")[:, :d], places)
    states = []
    for output in shown:
        rows = measured[:, 0] == output + 1
        moved = np.full(places.shape, np.nan)
        moved[at.ravel()[rows]] = measured[rows, 1 + d :]
        off = moved - displacements_at(result.states[output][1], number, places)
        states.append([pieces.add_coded(values.T[k]) for values in (moved, off) for k in range(d)])
    return {"places": pieces.add(places, "f4"), "states": states}


def packed(
    result, first: Sequence[str], most: int, room: float, measured: np.ndarray | None = None
) -> tuple[dict[str, Any], list[int], Pieces, list[str]]:
    """Return the entries of the bodies of a result, the numbers of their states, pieces of at most
    `room` characters, and what was left out for that, in words.

    Where the room is too small, halves of the fields are left out, the last ones before those in
    `first`, then the inside of a solid, then halves of the outputs. There is no entry if one output
    has no room.
    """
    count = len(result.states)
    every = names_of(result.states[count - 1][1], first)
    shown = spread(count, most)
    names, inside = every, True
    while True:
        pieces = Pieces()
        bodies = {}
        if measured is not None:
            bodies["measured"] = measured_of(result, measured, shown, pieces)
        simulated = body_of(result, shown, names, inside, pieces, room)
        if simulated is not None:
            break
        if len(names) > 1:
            names = names[: len(names) // 2]
        elif inside and result.scene.dimension == 3:
            names, inside = every, False
        elif len(shown) > 1:
            names, shown = every, shown[::-2][::-1]
        else:
            return {}, [], Pieces(), ["the body, which is too large for the viewer"]
    told = [] if inside else ["the inside of the solid"]
    if len(shown) < count:
        told.append(f"{count - len(shown)} of {count} outputs")
    if len(names) < len(every):
        told.append(f"the fields {', '.join(every[len(names) :])}")
    return {"simulated": simulated, **bodies}, shown, pieces, told
