"""Solvers: they know forces by their protocol alone."""

from .quasi_static import DampedExplicit, Diverging, DynamicRelaxation, Equilibrium, NotConverged
from .stability import FrequencyEstimate

SOLVERS = {"relaxation": DynamicRelaxation, "explicit": DampedExplicit}

__all__ = ["SOLVERS", "DampedExplicit", "Diverging", "DynamicRelaxation", "Equilibrium", "FrequencyEstimate", "NotConverged"]
