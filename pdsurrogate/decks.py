"""Abaqus and CalculiX decks (.inp): nodes, elements and sets of all instances of parts."""

from __future__ import annotations

import re
import warnings
from collections.abc import Iterable, Iterator
from dataclasses import dataclass, field
from functools import lru_cache
from pathlib import Path
from typing import NamedTuple

import numpy as np
import scipy

KINDS = {
    "C3D": {4: "tetra", 8: "hexahedron", 10: "tetra10", 20: "hexahedron20", 27: "hexahedron27"}
    | {5: "pyramid", 6: "wedge", 13: "pyramid13", 15: "wedge15"},
    "T3D": {2: "line", 3: "line3"},
    "S": {3: "triangle", 4: "quad", 6: "triangle6", 8: "quad8", 9: "quad9"},
}
KINDS |= {"T2D": KINDS["T3D"]}
KINDS |= dict.fromkeys(("CPS", "CPE", "CPEG", "CAX", "M3D", "SFM3D", "STRI", "R3D"), KINDS["S"])
"""Names in meshio of cells, by the first letters of an element's type and its number of nodes,
which follows them in the type. Manuals of Abaqus and of CalculiX 2.20.
"""

TYPE = re.compile(rf"({'|'.join(KINDS)})([0-9]+)([A-Z]\w*)?")
"""Types of elements that are read: letters after the number tell the integration and unknowns."""

EDGE = 10
"""Number that is added to those of edges of shells, E1 to E4, to tell them from faces."""

GENERATORS = ("NGEN", "NFILL", "NCOPY", "NMAP", "ELGEN", "ELCOPY", "SYSTEM", "PARAMETER")
"""Keywords that make or move nodes and elements other than by a list of them."""


class Block(NamedTuple):
    """A keyword of a deck, in capitals and without blanks, its options, and its lines of data."""

    keyword: str
    options: dict[str, str]
    rows: list[str]


class Elements(NamedTuple):
    """Elements of one type: the type, its name in meshio ("" for one that is not read), numbers of
    the elements over the deck, and their nodes.
    """

    type: str
    kind: str
    numbers: np.ndarray
    nodes: np.ndarray


@dataclass
class Sets:
    """Elements, nodes, and sides of elements (rows of an element and its face, both from 0, edges
    of shells after `EDGE`) in each set, by its name in capitals; `names` has the names as they were
    first written, without those that Abaqus/CAE makes for itself.
    """

    elements: dict[str, np.ndarray] = field(default_factory=dict)
    nodes: dict[str, np.ndarray] = field(default_factory=dict)
    sides: dict[str, np.ndarray] = field(default_factory=dict)
    names: dict[str, str] = field(default_factory=dict)

    def add(self, kind: str, name: str, members: Iterable, internal: bool = False) -> None:
        """Add members to a set: blocks of one name add up, as in Abaqus and CalculiX."""
        of_kind = getattr(self, kind)
        every = np.array([*of_kind.get(name.upper(), ()), *members], dtype=int)
        shape = (-1, 2) if kind == "sides" else (-1,)
        of_kind[name.upper()] = np.unique(every.reshape(shape), axis=0)
        if not internal:
            self.names.setdefault(name.upper(), name)


@dataclass
class Deck:
    """Contents of a deck: places of nodes, elements by type, sets, and the numbers of the elements
    of every instance of a part.
    """

    places: list[np.ndarray] = field(default_factory=list)
    elements: list[Elements] = field(default_factory=list)
    sets: Sets = field(default_factory=Sets)
    instances: dict[str, np.ndarray] = field(default_factory=dict)

    @property
    def points(self) -> np.ndarray:
        """Places of all nodes, shape (k, d)."""
        return np.concatenate(self.places) if self.places else np.zeros((0, 3))

    def nodes_of(self, elements: np.ndarray) -> np.ndarray:
        """Return the nodes of elements."""
        nodes = [each.nodes[np.isin(each.numbers, elements)].ravel() for each in self.elements]
        return np.unique(np.concatenate(nodes))


class _Scope:
    """Numbers of nodes and elements within an instance of a part, or of the model."""

    def __init__(self, deck: Deck, sets: Sets):
        self.deck = deck
        self.sets = sets
        self.nodes: dict[int, int] = {}
        self.elements: dict[int, int] = {}
        self.inner: dict[str, _Scope] = {}

    def read(self, blocks: list[Block], placing: Iterable[str] = ()) -> None:
        """Read the nodes, then the elements, then the sets of some blocks."""
        shifts = [_numbers(_entries(row)) for row in placing]
        labels = [
            self._read_nodes(block, shifts) if block.keyword == "NODE" else [] for block in blocks
        ]
        found = [
            self._read_elements(block) if block.keyword == "ELEMENT" else [] for block in blocks
        ]
        for (keyword, options, data), nodes, elements in zip(blocks, labels, found, strict=True):
            internal = "INTERNAL" in options
            # A deck without instances may still name those that it was made of.
            owner = self.inner.get(options.get("INSTANCE", "").upper(), self)
            if owner is self and self.inner and "INSTANCE" in options:
                raise ValueError(f"there is no instance {options['INSTANCE']}")
            rows = [] if keyword in ("NODE", "ELEMENT") else [_entries(row) for row in data if row]
            if keyword in ("ELSET", "NSET") and keyword in options:
                kind = "elements" if keyword == "ELSET" else "nodes"
                if keyword == "NSET" and "ELSET" in options:
                    chosen = self.deck.nodes_of(owner.members("elements", [options["ELSET"]]))
                elif "GENERATE" in options:
                    chosen = owner.between(kind, rows)
                else:
                    chosen = owner.members(kind, [entry for row in rows for entry in row if entry])
                self.sets.add(kind, options[keyword], chosen, internal)
            elif keyword == "SURFACE" and options.get("TYPE", "ELEMENT").upper() == "NODE":
                chosen = self.members("nodes", [row[0] for row in rows])
                self.sets.add("nodes", options["NAME"], chosen, internal)
            elif keyword == "SURFACE" and all(
                re.fullmatch("S[1-6]|E[1-4]", "".join(row[1:]).upper()) for row in rows
            ):
                for entry, face in rows:
                    number = int(face[1]) - 1 + EDGE * (face[0] in "Ee")
                    sides = [(each, number) for each in self.members("elements", [entry])]
                    self.sets.add("sides", options["NAME"], sides, internal)
            elif keyword == "SURFACE":
                warnings.warn(
                    f"body.file: surface {options['NAME']} is left out: its entries are not all"
                    " elements, or sets of them, with a face S1 to S6 or an edge E1 to E4",
                    stacklevel=6,
                )
            elif keyword == "NODE" and "NSET" in options:
                self.sets.add("nodes", options["NSET"], [self.nodes[label] for label in nodes])
            elif keyword == "ELEMENT" and "ELSET" in options:
                self.sets.add("elements", options["ELSET"], elements)

    def members(self, kind: str, entries: list[str]) -> list[int]:
        """Return the elements or nodes that entries of a set stand for: numbers, or names of sets
        above it, both maybe after the name of an instance.

        Numbers that no element or node has are left out, as Abaqus does.
        """
        found = []
        for entry in entries:
            of_instance = [name for name in self.inner if entry.upper().startswith(f"{name}.")]
            if entry.isdigit():
                found += [getattr(self, kind).get(int(entry), -1)]
            elif entry.upper() in getattr(self.sets, kind):
                found += getattr(self.sets, kind)[entry.upper()].tolist()
            elif of_instance:
                name = max(of_instance, key=len)
                found += self.inner[name].members(kind, [entry[len(name) + 1 :]])
            else:
                raise ValueError(
                    f"{entry!r} in a set of {kind} is neither a number nor a set above it"
                )
        return [number for number in found if number >= 0]

    def between(self, kind: str, rows: list[list[str]]) -> list[int]:
        """Return the elements or nodes of rows of a first, a last number and a step."""
        return [
            number
            for first, last, *step in ([int(entry) for entry in row if entry] for row in rows)
            for label, number in getattr(self, kind).items()
            if first <= label <= last and (label - first) % (step or [1])[0] == 0
        ]

    def _read_nodes(self, block: Block, placing: list[list[float]]) -> list[int]:
        """Add the nodes of a block to the deck, shifted and turned; return their numbers."""
        if block.options.get("SYSTEM", "R").upper() != "R":
            raise ValueError("*NODE with polar coordinates (SYSTEM) is not read")
        begin = sum(map(len, self.deck.places))
        rows = [_entries(row) for row in block.rows if row]
        labels = [int(row[0]) for row in rows]
        places = np.array([(_numbers(row[1:4]) + [0.0] * 3)[:3] for row in rows])
        for shift in placing[:1]:
            places = places + shift[:3]
        for start, end, angle in ((row[:3], row[3:6], row[6]) for row in placing[1:2]):
            axis = np.subtract(end, start)
            turn = scipy.spatial.transform.Rotation.from_rotvec(
                np.radians(angle) * axis / np.linalg.norm(axis)
            )
            places = turn.apply(places - start) + start
        self.deck.places.append(places.reshape(-1, 3))
        self.nodes |= {label: begin + number for number, label in enumerate(labels)}
        return labels

    def _read_elements(self, block: Block) -> np.ndarray:
        """Add the elements of a block to the deck; return their numbers."""
        name = block.options.get("TYPE", "").upper()
        known = TYPE.fullmatch(name)
        count = int(known[2]) if known else 0
        kind = KINDS[known[1]].get(count, "") if known else ""
        rows = [row for row in block.rows if row]
        goes_on = np.array([row.endswith(",") for row in rows], dtype=bool)
        begins = np.flatnonzero(~np.append(False, goes_on[:-1])[: len(rows)])
        if kind and rows:
            counts = np.array([row.count(",") for row in rows]) + ~goes_on
            sizes = np.add.reduceat(counts, begins)
            # Some programs end every line with a comma, also where no line goes on.
            for wrong in np.flatnonzero(sizes % (count + 1))[:1]:
                has = sizes[wrong] if sizes[wrong] <= 28 else counts[begins[wrong]]
                raise ValueError(
                    f"element {rows[begins[wrong]].split(',')[0]} has {has - 1} nodes; one of type"
                    f" {name} has {count}"
                )
            flat = [int(entry) for row in rows for entry in row.strip(",").split(",")]
            given = np.array(flat).reshape(-1, count + 1)
        else:
            given = np.array([[int(rows[line].split(",")[0])] for line in begins]).reshape(-1, 1)
        begin = sum(len(each.numbers) for each in self.deck.elements)
        numbers = np.arange(begin, begin + len(given))
        labels = dict(zip(given[:, 0].tolist(), numbers.tolist(), strict=True))
        if len(labels) < len(given) or labels.keys() & self.elements.keys():
            raise ValueError("two elements have one number, so that its sets are ambiguous")
        self.elements |= labels
        try:
            nodes = [self.nodes[node] for node in given[:, 1:].ravel().tolist()]
        except KeyError as error:
            raise ValueError(f"an element has the node {error}, which has no place") from None
        self.deck.elements.append(
            Elements(
                name,
                kind,
                numbers,
                np.array(nodes, dtype=int).reshape(len(given), given.shape[1] - 1),
            )
        )
        return numbers


def read_deck(file: str | Path) -> Deck:
    """Return the contents of a deck and the files that it includes.

    Raises
    ------
    ValueError
        If the deck contradicts itself, or makes nodes or elements in a way that is not read.
    """
    model: list[Block] = []
    parts: dict[str, list[Block]] = {}
    instances: list[tuple[Block, list[Block]]] = []
    current = model
    for block in _all_blocks(Path(file), Path(file).parent):
        name = block.options.get("NAME", "")
        if block.keyword in GENERATORS:
            raise ValueError(
                f"*{block.keyword} is not read: write the deck with all its nodes and elements"
            )
        if block.keyword == "PART":
            current = parts[name.upper()] = []
        elif block.keyword == "INSTANCE":
            current = []
            instances.append((block, current))
        elif block.keyword in ("ENDPART", "ENDINSTANCE"):
            current = model
        else:
            current.append(block)
    deck = Deck()
    whole = _Scope(deck, deck.sets)
    # Without an assembly every part is there once, where it was drawn.
    for block, own in instances or [
        (Block("INSTANCE", {"NAME": name, "PART": name}, []), []) for name in parts
    ]:
        name = block.options.get("NAME", "")
        part = block.options.get("PART", "")
        if part.upper() not in parts:
            raise ValueError(f"instance {name} is one of part {part!r}, which is not there")
        scope = whole.inner[name.upper()] = _Scope(deck, Sets())
        scope.read(parts[part.upper()] + own, block.rows)
        deck.instances[name] = np.fromiter(scope.elements.values(), dtype=int)
        if "ELSET" in block.options:
            deck.sets.add("elements", block.options["ELSET"], deck.instances[name])
        if "NSET" in block.options:
            nodes = np.fromiter(scope.nodes.values(), dtype=int)
            deck.sets.add("nodes", block.options["NSET"], nodes)
    whole.read(model)
    for name, scope in zip(deck.instances, whole.inner.values(), strict=True):
        alone = len(deck.instances) == 1
        taken = set(deck.sets.names)
        for key, said in scope.sets.names.items():
            new = said if alone and key not in taken else f"{name}.{said}"
            for kind in ("elements", "nodes", "sides"):
                if key in getattr(scope.sets, kind):
                    deck.sets.add(kind, new, getattr(scope.sets, kind)[key])
    if len(deck.instances) > 1:
        for name, elements in deck.instances.items():
            if name.upper() not in deck.sets.names:
                deck.sets.add("elements", name, elements)
    return deck


def _entries(row: str) -> list[str]:
    """Return the entries of a line of data without blanks and quotes."""
    return [entry.strip(' "') for entry in row.split(",")]


def _numbers(entries: list[str]) -> list[float]:
    """Return numbers, 0 for an empty entry; exponents may be Fortran's D."""
    return [float(entry.upper().replace("D", "E") or 0) for entry in entries]


def _blocks(path: Path) -> Iterator[Block]:
    """Yield the keywords of one file of a deck."""
    keyword = ""
    options: dict[str, str] = {}
    rows: list[str] = []
    head = ""
    for line in map(str.strip, [*path.read_text("utf-8", errors="replace").splitlines(), "*"]):
        if line.startswith("**"):
            continue
        if head.endswith(","):
            head += line
        elif line.startswith("*"):
            if keyword:
                yield Block(keyword, options, rows)
            head = line
            rows = []
        else:
            rows.append(line)
            continue
        words = [part.strip() for part in head[1:].split(",")]
        keyword = words[0].upper().replace(" ", "")
        pairs = (part.partition("=") for part in words[1:])
        options = {key.strip().upper(): value.strip().strip('"') for key, _, value in pairs}


def _all_blocks(path: Path, home: Path, above: tuple[Path, ...] = ()) -> Iterator[Block]:
    """Yield the keywords of a file of the deck in a folder `home`, those of included files in
    their place; `above` are the files that include it.
    """
    for block in _blocks(path):
        if block.keyword == "INCLUDE":
            inner = _included(block, path, home)
            if any(inner.samefile(each) for each in (*above, path)):
                raise ValueError(f"{inner.name} includes itself")
            yield from _all_blocks(inner, home, (*above, path))
        else:
            yield block


def _included(block: Block, path: Path, home: Path) -> Path:
    """Return the path of the file that an *INCLUDE in the file `path` names: in the folder `home`
    of the deck, or else beside that file.
    """
    name = block.options.get("INPUT", "").replace("\\", "/")
    for folder in (home, path.parent):
        if (folder / name).is_file():
            return folder / name
    raise ValueError(f"the included file {name} is not in {home or '.'}")


def files_of(file: str | Path) -> list[Path]:
    """Return the files of a mesh: itself, and those that it includes if it is a deck.

    Raises
    ------
    ValueError
        If an included file is not there.
    """
    files = [Path(file)]
    if files[0].suffix.lower() == ".inp":
        for each in files:
            further = _includes(each, files[0].parent, each.stat().st_mtime_ns)
            files += [path for path in further if path not in files]
    return files


@lru_cache(maxsize=8)
def _includes(path: Path, home: Path, _changed: int) -> tuple[Path, ...]:
    """Return the files that a file of a deck names, which is read again once it has changed."""
    return tuple(
        _included(block, path, home) for block in _blocks(path) if block.keyword == "INCLUDE"
    )
