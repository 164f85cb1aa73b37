#!/bin/sh
# muDIC 0.2.1 turns images upside down if it reads them from a folder, and leaves them as they are if they come as a list of arrays: the
# same two images have vertical displacements of opposite sign, and a shear of opposite sign, without an error or a warning.
#
# A speckle pattern moves by u = 0.01 y + 0.3 and v = 0.4 pixels (x along columns, y along rows, downward). Expected are these numbers from both
# ways of giving the images, or the same numbers from both; seen on 2026-11-30 with Python 3.11 is what SEEN holds: mean u, mean v, du/dy. From a
# list y and v point downward from the first row of pixels, from a folder upward from the last. The script fails if another version
# or behavior is found, so that whoever depends on it learns of the change. It installs muDIC alone, in a temporary folder, and uses nothing of
# this repository.
set -eu
folder=$(mktemp -d)
trap 'rm -rf "$folder"' EXIT
"${PYTHON:-python3}" -m venv "$folder/venv"
"$folder/venv/bin/pip" install -q mudic==0.2.1 numpy==2.4.6
"$folder/venv/bin/python" - "$folder" <<'PYTHON' 2>"$folder/log" || { tail -5 "$folder/log" >&2; exit 1; }
import sys
from importlib.metadata import version
from pathlib import Path

import imageio
import muDIC as dic
import numpy as np

WIDTH, HEIGHT = 120, 100
random = np.random.default_rng(1)
centers = random.uniform(0, [WIDTH, HEIGHT], (900, 2))
x, y = np.meshgrid(np.arange(WIDTH), np.arange(HEIGHT))
images = []
for moved in (0, 1):
    at = centers + moved * np.stack([0.01 * centers[:, 1] + 0.3, np.full(900, 0.4)], axis=1)
    image = sum(np.exp(-((x - a) ** 2 + (y - b) ** 2) / 8) for a, b in at)
    images.append((255 * image / 6).clip(0, 255).astype(np.uint8))
(Path(sys.argv[1]) / "images").mkdir()
for number, image in enumerate(images):
    imageio.imwrite(Path(sys.argv[1]) / "images" / f"{number}.tif", image)
SEEN = {"list": (0.80, 0.40, 0.01), "folder": (0.79, -0.40, -0.01)}
stacks = {
    "list": dic.image_stack_from_list([image.astype(float) for image in images]),
    "folder": dic.image_stack_from_folder(sys.argv[1] + "/images", file_type=".tif"),
}
changed = version("mudic") != "0.2.1"
print(f"muDIC {version('mudic')}: mean u, mean v, du/dy")
for name, stack in stacks.items():
    mesh = dic.Mesher(deg_e=1, deg_n=1, type="q4").mesh(stack, Xc1=20, Xc2=100, Yc1=20, Yc2=80, n_ely=3, n_elx=4, GUI=False)
    fields = dic.Fields(dic.DICAnalysis(dic.DICInput(mesh, stack)).run())
    u, v = fields.disp()[0, :, :, :, -1].mean(axis=(1, 2))
    found = u, v, fields.F()[0, 0, 1, :, :, -1].mean()
    print(f"images as a {name}:", *(f"{one:.3f}" for one in found))
    changed |= not np.allclose(found, SEEN[name], atol=0.02)
    changed |= found[2] * SEEN[name][2] < 0
sys.exit("muDIC behaves differently from what was seen" if changed else 0)
PYTHON
