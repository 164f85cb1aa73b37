"""Save a run, read it back, and read its CSV and VTU files as another program would."""

import csv
import tempfile
from pathlib import Path

import meshio

import pdsurrogate as pds

rubber = pds.materials.NeoHookean(shear_modulus=1.0, bulk_modulus=1e5)
scene = pds.load_scene("uniaxial", spacing=0.1, stretches=1.5, material=rubber)
with tempfile.TemporaryDirectory() as folder:
    pds.simulate(scene, "bond-energy").save(folder)
    print(pds.load_result(folder))
    with (Path(folder) / "history.csv").open() as file:
        (row,) = csv.DictReader(file)
    (states,) = Path(folder).glob("*.vtu")
    cells = meshio.read(states)

# The energy of 3 cm2 of sheet is psi = mu/2 (l^2 + 2/l - 3) times the area, incompressible.
exact = 3 * (1.5**2 + 2 / 1.5 - 3) / 2
energy = cells.cell_data["energy_density"][0] @ cells.cell_data["volume"][0]
print(f"cells {energy:.5f}, history {row['strain_energy [kPa cm^2]']}, exact {exact:.5f}")
assert abs(energy / exact - 1) < 1e-3  # mu/K, and single precision in files
