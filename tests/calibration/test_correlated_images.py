"""The law of a sheet again from what two programs for image correlation wrote of its images, by the
command as a user gives it (`tests/data/speckle/README.md`).
"""

import json
from pathlib import Path

import pytest
from commands import commanded

DATA = Path(__file__).parents[1] / "data" / "speckle"
FILES = {"sun-dic": ("sun-dic/*.csv", "25"), "al-dic": ("al-dic*", "28")}
"""Files of a variant, and the width of a subset."""


@pytest.mark.slow
@pytest.mark.parametrize(
    ("program", "variant", "options"),
    [
        ("al-dic", "base", "--pixels-per cm 121.2"),  # 120 is right
        ("sun-dic", "turned", []),
        ("sun-dic", "lost", []),
        ("al-dic", "moved", []),
    ],
)
def test_the_law_comes_back_from_correlated_images(tmp_path, program, variant, options):
    """mu = 400 kPa and the limit 15 within three standard errors, which are no wider than a
    measurement is worth: 5 % and a third.
    """
    pattern, subset = FILES[program]
    found = sorted((DATA / variant).glob(pattern))
    fields = [("--fields", each) for each in found]
    command = "calibrate", DATA / "sheet.toml", "rubber", fields, "--subset", subset, options
    commanded(command, "--forces", DATA / "forces.csv", "--law gent --json --out", tmp_path)
    report = json.loads((tmp_path / "calibration.json").read_text())
    truth = {"shear_modulus": (400.0, 0.05), "chain_limit": (15.0, 1 / 3)}
    for name, (true, widest) in truth.items():
        value, error = report["parameters"][name], report["standard_errors"][name]
        assert abs(value - true) < 3 * error
        assert error < widest * true
    assert report["map"]["scale"] == pytest.approx(1 / 120, rel=0.005)
    assert report["map"]["degrees"] == pytest.approx(-1.0 if variant == "turned" else 0, abs=0.05)
