"""The standard error of a simulated stress, from that of the law that was fitted to tests."""

import pdsurrogate as pds

data = pds.load_test_data("treloar").of("uniaxial")
small = data.stretches[:, 0] < 3
model = pds.identification.LawRegressor("neo-hookean")
model.fit(data.stretches[small], data.nominal_stress[small])
scene = pds.load_scene("hole", spacing=0.2, stretches=1.2, material=model.law_)
result = pds.simulate(scene, "bond-energy")
error = result.standard_errors(["nominal_stress"], model.law_covariance())["nominal_stress"]
stress = result.levels[-1]["nominal_stress"]
print(f"stress {stress:.4f} ± {error:.4f} MPa")

# Both moduli are multiples of the shear modulus, and so is every stress: relative errors are equal.
expected = model.standard_errors_[0] / model.law_.shear_modulus
assert abs(error / stress / expected - 1) < 1e-3
