"""Derivatives of a result by parameters of the scene, against a difference quotient."""

import pdsurrogate as pds


def run(chain_limit):
    """Equilibrium of a sheet with a hole of Gent's rubber, in double precision."""
    law = pds.materials.Gent(shear_modulus=1.0, bulk_modulus=100.0, chain_limit=chain_limit)
    changes = {"spacing": 0.2, "stretches": 1.5, "solver.tolerance": 1e-9}
    return pds.simulate(pds.load_scene("hole", {**changes, "material": law}), "bond-energy")


found = run(20.0).sensitivity(["nominal_stress"], ["material.chain_limit", "stretch"])
print(dict(zip(found.parameters, found.derivatives[0], strict=True)))

# A central difference of converged runs: its step of 0.1 leaves an error of (0.1/20)^2 = 2.5e-5.
stresses = [run(limit).levels[-1]["nominal_stress"] for limit in (19.9, 20.1)]
quotient = (stresses[1] - stresses[0]) / 0.2
print(f"difference quotient {quotient:.6f}")
assert abs(found.derivatives[0, 0] / quotient - 1) < 1e-3
