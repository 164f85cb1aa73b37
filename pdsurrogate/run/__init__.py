"""Simulation of a scene: stages in equilibrium and in explicit dynamics, cracks, energy
accounts, checkpoints and results.
"""
