"""From test data to the parameters of a law."""

from .committee import committee, committee_spread
from .data import MODES, TestData, load_test_data, test_data_names
from .energy import EnergyRegressor
from .regressor import LawRegressor
from .reporting import figure, report
from .selection import held_out_modes
from .stress_regressor import nominal_stress

__all__ = [
    "MODES",
    "EnergyRegressor",
    "LawRegressor",
    "TestData",
    "committee",
    "committee_spread",
    "figure",
    "held_out_modes",
    "load_test_data",
    "nominal_stress",
    "report",
    "test_data_names",
]
