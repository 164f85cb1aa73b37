"""Progress of a simulation, as reported to those who want to show it."""

from __future__ import annotations

from typing import Any, Protocol, runtime_checkable


@runtime_checkable
class Progress(Protocol):
    """Receiver of the progress of a simulation; every method may do nothing."""

    def compiling(self) -> None:
        """Report that kernels are being compiled, which happens once on a machine."""

    def level(self, number: int, parameter: float) -> None:
        """Report that the search for an output in equilibrium begins: the number of its stage and its loading parameter."""

    def residual(self, evaluations: int, residual: float, tolerance: float) -> None:
        """Report the residual of a level."""

    def dynamics(self, done: float, parameter: float, broken_bonds: int) -> None:
        """Report the share of a stage in dynamics that is done, from 0 to 1."""

    def account(self, steps: int, kinetic_energy: float, strain_energy: float) -> None:
        """Report the row that a stage in dynamics adds to the history."""


class Silent:
    """Progress that is not shown."""

    def compiling(self, *_: Any, **__: Any) -> None:
        """Do nothing."""

    level = residual = dynamics = account = compiling
