#!/bin/sh
# FElupe 11.3.0's `finite_strain_viscoelastic` returns a fraction of the overstress of its own model, without an error or a warning.
#
# The model (its documentation, after Shutov, Landgraf and Ihlemann 2013) is an energy mu/2 (tr(C Ci^-1) - 3) of the isochoric C with an
# internal tensor Ci of determinant 1, which a step of implicit Euler updates. Its stress is the derivative of the energy at fixed Ci, as the
# dissipation inequality wants it. FElupe differentiates through the update of Ci as well, so that the stress is too small, the more so the
# longer the step. State variables begin at zero, not at the identity: in a first increment that does not start from rest Ci becomes C itself,
# and there is no overstress at all.
#
# Below a cube is stretched to 1.1 in one step of dt = tau = eta / mu after an increment at rest, and once in the first increment. Expected is the
# stress difference P11 - P22 / stretch^1.5 (independent of any pressure) of the stated model, evaluated by hand; seen on 2026-11-30 with
# Python 3.11 is what SEEN holds: its ratio to the expected one. The script fails if another version or behavior is found, so that whoever depends
# on it learns of the change. It installs FElupe and tensortrax alone, in a temporary folder, and uses nothing of this repository.
set -eu
folder=$(mktemp -d)
trap 'rm -rf "$folder"' EXIT
"${PYTHON:-python3}" -m venv "$folder/venv"
"$folder/venv/bin/pip" install -q felupe==11.3.0 tensortrax==0.29.0 numpy==2.4.6
"$folder/venv/bin/python" - <<'PYTHON'
import sys

import felupe
import numpy as np

STRETCH = 1.1
SEEN = {0.01: (0.989, 0.0), 1.0: (0.476, 0.0), 10.0: (0.084, 0.0)}  # after rest, in a first increment
F = np.diag([STRETCH, STRETCH**-0.5, STRETCH**-0.5])
C = F.T @ F


def difference(P):
    """Return the part of a nominal stress that no pressure changes."""
    return P[0, 0] - P[1, 1] * STRETCH**-1.5


changed = felupe.__version__ != "11.3.0"
print(f"FElupe {felupe.__version__}: overstress over that of the stated model, after an increment at rest and in a first increment")
for step, seen in SEEN.items():  # dt / tau
    material = felupe.Hyperelastic(felupe.finite_strain_viscoelastic, mu=1.0, eta=1.0, dtime=step, nstatevars=6)
    blank = np.zeros((6, 1, 1))
    rest = material.gradient([np.eye(3)[..., None, None], blank])[1]
    found = [difference(material.gradient([F[..., None, None], start])[0][..., 0, 0]) for start in (rest, blank)]
    Ci = np.eye(3) + step * C
    Ci /= np.linalg.det(Ci) ** (1 / 3)
    expected = difference(F @ np.linalg.inv(Ci))
    ratios = [one / expected for one in found]
    print(f"  dt / tau = {step:g}:", *(f"{one:.3f}" for one in ratios))
    changed |= not np.allclose(ratios, seen, atol=0.002)
sys.exit("FElupe behaves differently from what was seen" if changed else 0)
PYTHON
