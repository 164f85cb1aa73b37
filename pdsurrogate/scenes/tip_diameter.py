"""Effective crack-tip diameters in horizons, by force model, plane, arrangement of the points and ratio of horizon to spacing."""

from __future__ import annotations

import json
from functools import cache
from importlib import resources
from typing import TYPE_CHECKING, Any

import numpy as np

if TYPE_CHECKING:
    from .model import Scene

TIP_DIAMETER = 1.15
"""Effective diameter of a crack tip, in horizons, in sheets whose bonds have forces and no energy, along a row of the lattice."""

LATTICE = "lattice"
"""Arrangement of the points of a body that does not name one."""


@cache
def measured_diameters() -> list[dict[str, Any]]:
    """Return the table `tip_diameters.json`, which `pipelines/tip_diameters.py` writes from simulated tears.

    Each entry has the ``family`` of the force models, the ``plane``, the ``arrangement`` of the points, the ``horizon_ratio``, and the
    ``diameter`` in horizons: the energy release rate at the peak of the load, divided by the uniaxial energy density at the critical
    stretch and by the horizon. ``deviation`` is the standard deviation over the tears. The diameters of the single tears follow: ``rows``
    by points per unit of height, ``turned`` by angle of the lattice in degrees, ``seeds`` by seed.
    """
    return json.loads((resources.files(__package__) / "tip_diameters.json").read_text("utf-8"))


def tip_diameter(plane: str, horizon_ratio: float, family: str | None = None, arrangement: str = LATTICE) -> float:
    """Return the effective diameter of a crack tip, in horizons, linearly interpolated between measured ratios of horizon to spacing.

    Parameters
    ----------
    plane : str
        "stress", "strain" or "space".
    horizon_ratio : float
        Horizon divided by the spacing of the points.
    family : str, optional
        Family of the force model, see `pdsurrogate.forces.ForceModel`; by default the first family that was measured for the other
        arguments.
    arrangement : str
        Arrangement of the points.

    Raises
    ------
    ValueError
        If no diameter was measured for these arguments; the message lists the measured cases.
    """
    cases: dict[tuple, list] = {}
    for entry in measured_diameters():
        case = entry["family"], entry["plane"], entry["arrangement"]
        cases.setdefault(case, []).append((entry["horizon_ratio"], entry["diameter"]))
    told = []
    for (known, state, points), entries in cases.items():
        ratios, diameters = np.array(sorted(entries)).T
        if (state, points) == (plane, arrangement) and family in (None, known) and ratios[0] - 1e-9 <= horizon_ratio <= ratios[-1] + 1e-9:
            return float(np.interp(horizon_ratio, ratios, diameters))
        told.append(_told(known, state, points) + " to ".join(dict.fromkeys(f"{ratio:g}" for ratio in (ratios[0], ratios[-1]))))
    here = f"{_told(family, plane, arrangement)}{horizon_ratio:g}"
    limited = f"for which the diameter of a crack tip was measured ({'; '.join(told)}), not for {here}"
    raise ValueError(f"fracture.energy is available only in cases {limited}; set fracture.critical_stretch instead")


def tip_diameter_in(scene: Scene, family: str | None = None) -> float:
    """Return `tip_diameter` for a scene; the points of a mesh count as those of a lattice."""
    return tip_diameter(scene.plane, scene.horizon_ratio, family, getattr(scene.body, "arrangement", LATTICE))


def _told(family: str | None, plane: str, arrangement: str) -> str:
    points = "" if arrangement == LATTICE else f"arrangement={arrangement}, "
    return f"{'' if family is None else f'{family}, '}plane={plane}, {points}horizon_ratio "
