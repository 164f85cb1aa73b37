"""Unknowns of a law with branches and softening: those of its elastic energy and of its memory."""

from collections.abc import Sequence
from dataclasses import dataclass, replace

import numpy as np

from ..identification import LawRegressor
from ..identification.branch_refinement import BEYOND, SOFTENING
from ..materials import Law, Memory
from ..problem.program import check_durations, stages_of
from ..scenes import Scene
from .asked import times_of

MODULI = 1e-6, 1e6
"""Bounds of the moduli of branches, over the shear modulus at the start, as those of laws."""


@dataclass(frozen=True)
class LawUnknowns:
    """Unknowns of a law, with those of its memory.

    Attributes
    ----------
    elastic : LawRegressor
        Unknowns of the elastic energy.
    memory : Memory
        Branches and softening at the start, in units of the shear modulus; numbers that are zero
        are no unknowns.
    times : tuple of float
        Bounds of relaxation times.
    """

    elastic: LawRegressor
    memory: Memory
    times: tuple[float, float]

    @property
    def _numbers(self) -> list[str]:
        """Names of the numbers of the memory that are unknowns."""
        return [name for name, value in self.memory.numbers().items() if value]

    def unknowns(self) -> list[str]:
        """Return the names of the parameters."""
        return [*self.elastic.unknowns(), *self._numbers]

    def completed(self, values: np.ndarray) -> np.ndarray:
        """Return parameters, of which those of the elastic energy are given, with the memory at the
        start.
        """
        elastic = values[: len(self.elastic.unknowns())]
        memory = self.memory.scaled(self.elastic.law_of(elastic).shear_modulus).numbers()
        return np.r_[elastic, [memory[name] for name in self._numbers]]

    def law_of(self, values: np.ndarray) -> Law:
        """Return the law with given values of the parameters."""
        elastic, memory = np.split(np.asarray(values, dtype=float), [len(self.elastic.unknowns())])
        numbers = dict(zip(self._numbers, memory.tolist(), strict=True))
        return replace(self.elastic.law_of(elastic), memory=self.memory.with_numbers(numbers))

    def search_range(
        self, start: np.ndarray, scale: float
    ) -> tuple[np.ndarray, np.ndarray, np.ndarray]:
        """Return bounds and which parameters are searched by logarithm, as `LawRegressor` does."""
        *bounds, logarithmic = self.elastic.search_range(start, scale)
        stresses = scale * np.array(MODULI)
        ranges = {**SOFTENING, "modulus": stresses, "m": stresses, "time": self.times}
        own = np.reshape([ranges[name.rpartition(".")[2]] for name in self._numbers], (-1, 2)).T
        low, high = (np.r_[one, more] for one, more in zip(bounds, own, strict=True))
        return low, high, np.r_[logarithmic, own[0] > 0]


def with_memory(elastic: LawRegressor, scenes: Sequence[Scene]) -> LawUnknowns:
    """Return the unknowns of a law with the memory of the first scene whose material remembers.

    Raise ValueError if the material has branches, and a scene has no times, or if times of
    relaxation depend on the overstress.
    """
    laws = [scene.law() for scene in scenes if scene.material is not None]
    law = next((one for one in laws if one.memory), None)
    if law is None:
        return LawUnknowns(elastic, Memory(), (1.0, 1.0))
    if law.memory.thinning:
        raise ValueError(
            "branches whose times depend on the overstress are not fitted with a body: give them"
            " constant times, or learn them from tests over time (identify --branches)"
        )
    for scene in scenes:
        try:
            check_durations(stages_of(scene), [law])
        except ValueError as error:
            raise ValueError(f"scene {scene.name}: {error}") from None
    clocks = [times_of(scene) for scene in scenes]
    parts = np.concatenate([np.diff(times, prepend=0.0) for times in clocks])
    longest = max(times.max(initial=0.0) for times in clocks)
    least = parts[parts > 0].min(initial=longest)
    bounds = float(least) / BEYOND, float(longest) * BEYOND
    return LawUnknowns(elastic, law.memory.scaled(1 / law.shear_modulus), bounds)
