"""States of a body by name, with one module for each: a sheet in plane stress or plane strain, or a solid."""

from __future__ import annotations

from importlib import import_module
from types import ModuleType


class _Planes(dict):
    """Modules by names, each imported on first use: a sheet loads nothing for three dimensions."""

    def __getitem__(self, plane: str) -> ModuleType:
        return import_module(f".{super().__getitem__(plane)}", __package__)


PLANES = _Planes(stress="plane_stress", strain="plane_strain", space="solid")
"""Modules by the names that scenes and settings use. Each has `response`, `first_piola_stress`, `energy_density`, and, for points whose
volume ratio was computed by a force, `energy_at` and `stress_and_energy`.
"""

SHEETS = ("stress", "strain")
"""Names of the states of two-dimensional bodies."""


def dimension_of(plane: str) -> int:
    """Return the dimension, 2 or 3, of bodies in the named state."""
    return 2 if plane in SHEETS else 3
