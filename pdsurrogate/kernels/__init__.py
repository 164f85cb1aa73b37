"""Kernels: compiled functions on plain arrays, and nothing else."""
