"""Identification of the parameters of a law from test data."""

from .data import MODES, TestData, load_test_data, test_data_names
from .energy import EnergyRegressor
from .examination import Examination, TestDataWarning, examine, fit_to_tests
from .history_regressor import HistoryRegressor
from .regressor import LawRegressor, fitted_laws
from .reporting import differences, figure, held_out_modes
from .stress_regressor import free_sides, nominal_stress

__all__ = [
    "EnergyRegressor",
    "HistoryRegressor",
    "LawRegressor",
    "TestDataWarning",
    "fit_to_tests",
    "load_test_data",
]
"""Names that type checkers of users' programs accept."""
