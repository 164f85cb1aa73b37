"""From test data to the parameters of a law."""

from .data import MODES, TestData, load_test_data, test_data_names
from .regressor import LawRegressor
from .selection import held_out_modes

__all__ = ["MODES", "LawRegressor", "TestData", "held_out_modes", "load_test_data", "test_data_names"]
