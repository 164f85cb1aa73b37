"""Export a law as source code for FElupe, and evaluate the stress of the file that was written."""

import runpy
import tempfile
from pathlib import Path

import numpy as np

from pdsurrogate.cli import app

with tempfile.TemporaryDirectory() as folder:
    command = "export gent --set chain_limit=30 --set bulk_modulus=100 --to felupe --out"
    app([*command.split(), folder], standalone_mode=False)
    material = runpy.run_path(str(Path(folder) / "gent_felupe.py"))["Material"]()

# Simple shear of gamma keeps the volume: the Kirchhoff and Cauchy shear stress of Gent's law is
# mu gamma/(1 - gamma^2/Jm), and P12 equals it, since F^-T maps the shear plane onto itself.
gamma = 1.5
F = np.eye(3)
F[0, 1] = gamma
P = material.gradient([F[..., None, None], None])[0][..., 0, 0]
exact = gamma / (1 - gamma**2 / 30)
print(f"P12 = {P[0, 1]:.6f}, exact {exact:.6f}")
assert abs(P[0, 1] / exact - 1) < 1e-12
