"""Correlate the images of a variant by sun-dic 0.0.36, and write the table that its window writes.

python by_sun_dic.py FOLDER/VARIANT  writes FOLDER/VARIANT/sun-dic/step_K.csv
"""

import sys
from pathlib import Path

import pandas as pd
from sundic import post_process, settings, sundic

SETTINGS = """
[General]
DebugLevel = 0
CPUCount = 1
ImageFolder = {folder}/images
[DICSettings]
SubSetSize = 25
StepSize = 28
ShapeFunctions = Affine
ReferenceStrategy = Relative
[ImageSetDefinition]
ROI = 154, 182, 336, 454
MaskFile = {folder}/masks/mask_00.png
[Optimisation]
NZCCThreshold = 0.9999
"""
HEADING = ["X Coord", "Y Coord", "Z Coord", "X Disp", "Y Disp", "Z Disp", "Disp Magnitude"]


def main(folder: Path) -> None:
    """Correlate, and write the tables."""
    (folder / "settings.ini").write_text(SETTINGS.format(folder=folder))
    results = str(folder / "results.sdic")
    chosen = settings.Settings.fromSettingsFile(str(folder / "settings.ini"))
    pairs = sundic.planarDICLocal(chosen, results)
    out = folder / "sun-dic"
    out.mkdir(exist_ok=True)
    for pair in range(1, len(pairs), 2):
        table, _, _ = post_process.getDisplacements(results, imgPair=pair)
        pd.DataFrame(table, columns=HEADING).to_csv(
            out / f"step_{(pair + 1) // 2}.csv", index=False
        )


if __name__ == "__main__":
    main(Path(sys.argv[1]).resolve())
