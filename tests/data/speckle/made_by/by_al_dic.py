"""Correlate the images of a variant by al-dic 1.0.3 and write its files of displacements.

python by_al_dic.py FOLDER/VARIANT  writes FOLDER/VARIANT/al-dic/frame_K.csv and al-dic.npz
"""

import shutil
import sys
from pathlib import Path

from al_dic.core.config import dicpara_default
from al_dic.core.data_structures import GridxyROIRange
from al_dic.core.pipeline import run_aldic
from al_dic.export.export_csv import export_csv
from al_dic.export.export_npz import export_npz
from al_dic.io.io_utils import load_images, load_masks


def main(folder: Path) -> None:
    """Correlate, and write the tables."""
    images = load_images(folder / "images", "*[02468].png")
    masks = load_masks(folder / "masks", "*[02468].png")
    chosen = dicpara_default(
        winsize=28,
        winstepsize=16,
        use_masks=True,
        tol=1e-3,
        size_of_fft_search_region=130,
        gridxy_roi_range=GridxyROIRange(gridx=(154, 490), gridy=(182, 636)),
    )
    found = run_aldic(chosen, images, [mask.astype(float) for mask in masks], compute_strain=False)
    fields, out = ["disp_u", "disp_v"], folder / "al-dic"
    out.mkdir(exist_ok=True)
    for path in export_csv(folder, "run", "0", found, fields):
        shutil.move(path, out / path.name)
    shutil.move(export_npz(folder, "run", "0", found, fields), out / "al-dic.npz")


if __name__ == "__main__":
    main(Path(sys.argv[1]))
