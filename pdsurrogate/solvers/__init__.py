"""Solvers for equilibrium and dynamics, which use the internal force only through the protocol
`InternalForce`.
"""
