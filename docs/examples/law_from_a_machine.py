"""A law from the file of a testing machine: force and extension of a cycle, with decimal commas."""

import tempfile
import warnings
from pathlib import Path

import numpy as np

import pdsurrogate as pds

# What a machine may have written: Gent's rubber, with 15 % less force on the way back.
up = np.linspace(1.0, 3.0, 41)
stretch = np.concatenate([up, up[-2::-1]])
stress = 0.6 * 40 / (43 - stretch**2 - 2 / stretch) * (stretch - stretch**-2)  # MPa
force = 12 * stress * np.where(np.arange(81) > 40, 0.85, 1.0)  # N, on 12 mm2
lines = ["Zeit;Standardweg;Standardkraft", "s;mm;N"]
for second, (one, load) in enumerate(zip(stretch, force, strict=True)):
    lines.append(f"{second};{25 * (one - 1):.4f};{load:.4f}".replace(".", ","))

with tempfile.TemporaryDirectory() as folder, warnings.catch_warnings(record=True) as said:
    warnings.simplefilter("always")
    file = Path(folder, "cycle.txt")
    file.write_text("\n".join(lines))
    data = pds.load_test_data(file, mode="uniaxial", gauge_length="25 mm", area="12 mm2")
for warning in said:
    print(warning.message)

model = pds.identification.LawRegressor("gent").fit(data.stretches, data.nominal_stress)
print(f"{model.law_} from {len(data)} rows")

# The law that the file was made with; taking both branches would give 0.55 MPa.
assert abs(model.law_.shear_modulus / 0.6 - 1) < 0.005
