#!/bin/sh
# meshio 5.3.5 ends a block of an Abaqus deck at the first comment within it, and what follows is lost without an error or a warning.
#
# A line that begins with ** may stand anywhere in a deck, also between lines of data, and Abaqus and CalculiX read on behind it. Expected
# are four elements, and a set of all of them, in each deck below; seen on 2026-11-30 with Python 3.11 is what DECKS holds. Of three tests of
# CalculiX 2.20 meshio reads 177 of 362 (rotor3), 49 of 95 (segmentsuper) and 28 of 30 elements (beamptied5) for this reason. The script fails
# if another version or behavior is found. It installs meshio alone, in a temporary folder, and uses nothing of this repository.
set -eu
folder=$(mktemp -d)
trap 'rm -rf "$folder"' EXIT
"${PYTHON:-python3}" -m venv "$folder/venv"
"$folder/venv/bin/pip" install -q meshio==5.3.5 numpy==2.4.6
"$folder/venv/bin/python" - "$folder" <<'PYTHON'
import sys
from pathlib import Path

import meshio

PLACES = [f"{5 * row + column + 1}, {column}.0, {row}.0, 0.0\n" for row in (0, 1) for column in range(5)]
SQUARES = [f"{k}, {k}, {k + 1}, {k + 6}, {k + 5}\n" for k in (1, 2, 3, 4)]
ROWS = ["1, 2\n", "3, 4\n"]
NOTE = "** a comment\n"


def deck(after_node=99, after_element=99, after_row=99):
    blocks = (("*NODE", PLACES, after_node), ("*ELEMENT, TYPE=CPS4", SQUARES, after_element), ("*ELSET, ELSET=all", ROWS, after_row))
    return "".join(f"{head}\n{''.join(rows[:place])}{NOTE}{''.join(rows[place:])}" for head, rows, place in blocks)


DECKS = {
    "comments behind the blocks": (deck(), (10, 4, 4)),
    "a comment behind the second element": (deck(after_element=2), (10, 2, 2)),  # 10 nodes, 4 elements, 4 in the set are right
    "a comment behind the first row of the set": (deck(after_row=1), (10, 4, 2)),
    "a comment behind the tenth node": (deck(after_node=10), (10, 4, 4)),
    "a comment behind the first node": (deck(after_node=1), "KeyError(np.int64(2))"),  # the only one that is told
}
print(f"meshio {meshio.__version__}")
changed = meshio.__version__ != "5.3.5"
for number, (what, (text, seen)) in enumerate(DECKS.items()):
    path = Path(sys.argv[1]) / f"deck{number}.inp"
    path.write_text(text)
    try:
        mesh = meshio.read(path)
        found = len(mesh.points), sum(len(block.data) for block in mesh.cells), sum(map(len, mesh.cell_sets["all"]))
    except (Exception, SystemExit) as error:
        found = repr(error)
    print(f"{what}: nodes, elements, elements of the set: {found}")
    changed |= found != seen
sys.exit("meshio behaves differently from what was seen" if changed else 0)
PYTHON
