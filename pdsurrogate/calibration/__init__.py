"""Calibration: laws from measurements on bodies of any shape, by simulations of the tests and
their derivatives.
"""

from .regressor import SceneRegressor

__all__ = ["SceneRegressor"]
"""Names that type checkers of users' programs accept."""
