"""The bond force as a target: its samples, pipeline, errors, domain and surrogates."""

from __future__ import annotations

import numpy as np

from ..body import WEIGHT_FUNCTIONS
from ..forces import Domain
from ..materials import Law
from .export import force_of, shift_and_scale, taken_over
from .pipeline import bond_force_pipeline, feature_set_of, parts_of
from .sampling import COLUMNS, TARGETS, bond_states_reached, range_of_stretches, wide_bonds
from .targets import REPORT_SEED, REPORTED_STATES, Range, Samples, Target
from .validation import force_report, relative_errors

WIDE = (0.5, 4.0)
"""Principal stretches of the default samples; the card of a surrogate trained on a smaller range reports its errors in this one as well."""


class _BondForce(Target):
    name, columns, outputs, stretch_range, n_samples = "bond-force", COLUMNS, TARGETS, WIDE, 8_000
    units = "dimensionless; rotation in radians; length in horizons; force in w l mu / kappa"
    weight_function = "any: the force learnt is dimensionless, t kappa / (w l mu); known are " + ", ".join(WEIGHT_FUNCTIONS)

    reached = staticmethod(bond_states_reached)
    pipeline = staticmethod(bond_force_pipeline)
    surrogate = staticmethod(taken_over)

    def draw(
        self, law: Law, n_samples: int, stretch_range: Range, near_rest: float, random_state: int, off_surface: float = 2 / 3
    ) -> Samples:
        return Samples(*wide_bonds(law, n_samples, stretch_range, near_rest, off_surface, random_state), self)

    def predicted_by(self, model) -> bool:
        try:
            return bool(feature_set_of(model))
        except ValueError:
            return False

    def errors(self, predicted: np.ndarray, samples: Samples) -> dict[str, float]:
        return relative_errors(predicted, samples.y)

    def domain_of_states(self, law: Law, X: np.ndarray) -> Domain:
        stretch, rotation, J, C33 = (X[:, COLUMNS.index(name)] for name in ("stretch", "rotation", "J", "C33"))
        # Components of the stretch tensor U, which stretch and rotation of a bond and the area ratio define.
        U_nn, U_nm = stretch * np.cos(rotation), stretch * np.sin(rotation)
        low, high = range_of_stretches(U_nn**2 + 2 * U_nm**2 + ((J + U_nm**2) / U_nn) ** 2, J)
        bulk = J**2 * C33
        return Domain(low, high, float(bulk.min()), float(bulk.max()))

    def report(self, model, law: Law, stretch_range: Range, n_samples: int = REPORTED_STATES, random_state: int = REPORT_SEED) -> dict:
        return force_report(force_of(model), law, stretch_range, n_samples, random_state)

    def more_reports(self, surrogate, law: Law, stretch_range: Range) -> dict[str, dict]:
        wider = stretch_range[0] > WIDE[0] and self.reached(law, *np.log(WIDE))
        return {"outside_box": self.report(surrogate, law, WIDE)} if wider else {}

    def scaling(self, model) -> dict:
        try:
            parts = parts_of(model)
        except ValueError:
            return {"folded": "whatever scaling the model has is part of the payload, which is on plain features"}
        (mean, scale), (target_mean, target_scale) = shift_and_scale(parts.scaling), shift_and_scale(parts.target)
        return {
            "feature_mean": mean.tolist(),
            "feature_scale": scale.tolist(),
            "output_mean": target_mean.tolist(),
            "output_scale": target_scale.tolist(),
            "folded": "into the constants of the payload",
        }


BOND_FORCE = _BondForce()
"""The dimensionless bond force along and across a bond, as a function of stretch, rotation, length, C33 and J."""
