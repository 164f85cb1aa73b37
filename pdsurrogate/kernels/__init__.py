"""Compiled physics on plain arrays: kinematics, bond forces and energies, networks, sums over
bonds, time steps.
"""
