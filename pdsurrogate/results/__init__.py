"""Results of simulations: measured quantities, storage in folders, and figures."""

from .result import Result, load_result

__all__ = ["Result", "load_result"]
