"""Results of simulations: what is measured on them and how they are stored."""

from .result import Result

__all__ = ["Result"]
