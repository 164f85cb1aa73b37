"""Solvers for equilibrium and dynamics, which use forces only through their protocol."""

from .automatic import Automatic
from .dynamics import ExplicitDynamics
from .equilibrium import (
    Diverging,
    Equilibrium,
    EquilibriumSolver,
    NoEquilibrium,
    NotConverged,
    RanAway,
    TooFar,
    TooSmall,
    Unbalanced,
    Unstable,
    note_of_zero_energy_modes,
)
from .increments import Increments
from .minimiser import EnergyMinimiser
from .quasi_newton import QuasiNewton
from .stability import FrequencyEstimate
from .stepping import DampedExplicit, DynamicRelaxation

SOLVERS = {solver.name: solver for solver in (Automatic, EnergyMinimiser, QuasiNewton, DynamicRelaxation, DampedExplicit)}

__all__ = [
    "SOLVERS",
    "Automatic",
    "DampedExplicit",
    "Diverging",
    "DynamicRelaxation",
    "EnergyMinimiser",
    "Equilibrium",
    "EquilibriumSolver",
    "ExplicitDynamics",
    "FrequencyEstimate",
    "Increments",
    "NoEquilibrium",
    "NotConverged",
    "QuasiNewton",
    "RanAway",
    "TooFar",
    "TooSmall",
    "Unbalanced",
    "Unstable",
    "note_of_zero_energy_modes",
]
