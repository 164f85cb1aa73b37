"""Results of simulations: measured quantities, storage and figures."""

from .result import Result, load_result

__all__ = ["Result", "load_result"]
