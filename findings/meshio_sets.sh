#!/bin/sh
# meshio 5.3.5 reads Abaqus decks whose element sets it loses in part, without an error or a warning.
#
# Each deck below is valid input: an element set may be given by several blocks of lines, which add to it, and may name other sets.
# Expected are the elements of each set as the decks state them; seen on 2026-11-29 with Python 3.11 is what SEEN holds: per block of
# elements the numbers within the block. The script fails if another version or behavior is found, so that whoever depends on it learns of
# the change. It installs meshio alone, in a temporary folder, and uses nothing of this repository.
set -eu
folder=$(mktemp -d)
trap 'rm -rf "$folder"' EXIT
"${PYTHON:-python3}" -m venv "$folder/venv"
"$folder/venv/bin/pip" install -q meshio==5.3.5 numpy==2.4.6
"$folder/venv/bin/python" - "$folder" <<'PYTHON'
import sys
from pathlib import Path

import meshio

NODES = "*NODE\n" + "".join(f"{5 * row + column + 1}, {column}.0, {row}.0, 0.0\n" for row in (0, 1) for column in range(5))
ONE, TWO, THREE = "1, 1, 2, 7, 6\n", "2, 2, 3, 8, 7\n", "3, 3, 4, 9, 8\n"
ELEMENT = "*ELEMENT, TYPE=CPS4"
DECKS = {
    "a set that two blocks of elements give (elements 1, 2 and 3)": (
        f"{ELEMENT}, ELSET=rubber\n{ONE}{TWO}{ELEMENT}, ELSET=rubber\n{THREE}",
        {"rubber": [[0], [0]]},  # elements 1 and 3; [[0, 1], [0]] is right
    ),
    "a set of the second block alone (elements 2 and 3)": (
        f"{ELEMENT}\n{ONE}{ELEMENT}, ELSET=rubber\n{TWO}{THREE}",
        {"rubber": [[0, 1], []]},  # of the first block, which has one element; [[], [0, 1]] is right
    ),
    "a set that two lists give (elements 1 and 3)": (
        f"{ELEMENT}\n{ONE}{TWO}{THREE}*ELSET, ELSET=ends\n1\n*ELSET, ELSET=ends\n3\n",
        {"ends": [[2]]},  # element 3; [[0, 2]] is right
    ),
    "a set of two sets in one line (elements 1 and 2)": (
        f"{ELEMENT}, ELSET=a\n{ONE}{ELEMENT}, ELSET=b\n{TWO}*ELSET, ELSET=both\na, b\n",
        {"both": [[0]], "a": [[0], []], "b": [[], [0]]},  # element 1; [[0], [0]] is right
    ),
}
print(f"meshio {meshio.__version__}")
changed = meshio.__version__ != "5.3.5"
for number, (what, (deck, seen)) in enumerate(DECKS.items()):
    path = Path(sys.argv[1]) / f"deck{number}.inp"
    path.write_text(NODES + deck)
    found = {name: [[int(one) for one in block] for block in blocks] for name, blocks in meshio.read(path).cell_sets.items()}
    print(f"{what}: {found}")
    changed |= found != seen
sys.exit("meshio behaves differently from what was seen" if changed else 0)
PYTHON
