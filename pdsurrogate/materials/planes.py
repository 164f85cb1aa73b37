"""What a body may be: a sheet whose thickness is free or held, or a solid; one interface, so that who knows the name need not know more."""

from __future__ import annotations

from collections.abc import Mapping
from importlib import import_module
from types import ModuleType


class _Planes(Mapping):
    """Modules by the names that scenes and settings know, each imported when it is asked for: a sheet needs nothing of space."""

    def __init__(self, modules: Mapping[str, str]) -> None:
        self._modules = modules

    def __getitem__(self, plane: str) -> ModuleType:
        return import_module(f".{self._modules[plane]}", __package__)

    def __iter__(self):
        return iter(self._modules)

    def __len__(self) -> int:
        return len(self._modules)


PLANES = _Planes({"stress": "plane_stress", "strain": "plane_strain", "space": "solid"})
"""By the name that scenes and settings know: modules with `response`, `first_piola_stress`, `energy_density`,
and, of points whose volume ratio has been found otherwise, `energy_at` and `stress_and_energy`."""

SHEETS = ("stress", "strain")
"""Those of bodies in the plane."""


def dimension_of(plane: str) -> int:
    """Dimension of the bodies that are in a state of this name."""
    return 2 if plane in SHEETS else 3
