"""Solvers for equilibrium and dynamics, which use forces only through their protocol."""
