"""Results of simulations: what is measured on them and how they are stored."""

from .result import Result, load_result

__all__ = ["Result", "load_result"]
