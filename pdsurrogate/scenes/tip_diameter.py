"""Effective crack-tip diameters in horizons, by force model, plane, arrangement, ratio of
horizon to spacing, and critical stretch.
"""

import json
from functools import cache
from importlib import resources
from typing import Any, NamedTuple

import numpy as np

from .model import SceneData

TIP_DIAMETER = 1.15
"""Effective diameter of a crack tip, in horizons, in sheets whose bonds have forces and no
energy, along a row of the lattice.
"""

BULK_RATIO = 20.0
"""Bulk modulus over shear modulus of most measured tears."""

LATTICE = "lattice"
"""Arrangement of the points of a body that does not name one."""


@cache
def measured_diameters() -> list[dict[str, Any]]:
    """Return the table `tip_diameters.json`, which `pipelines/tip_diameters.py` writes from
    simulated tears.

    Each entry has the ``family`` of the force models, the ``plane``, the ``arrangement`` of the
    points, the ``horizon_ratio``, the ``bulk_ratio`` of bulk and shear modulus, the
    ``critical_stretch``, and the ``diameter`` in horizons: the
    energy release rate at the peak of the load, divided by the uniaxial energy density at the
    critical stretch and by the horizon. ``mean`` and ``deviation`` are those over the tears, whose
    single diameters follow: ``rows`` by points per unit of height, ``seeds`` by seed.
    """
    return json.loads((resources.files(__package__) / "tip_diameters.json").read_text("utf-8"))


class TipDiameters(NamedTuple):
    """Diameters of a crack tip in horizons, linear between measured critical stretches and
    constant beyond them.
    """

    stretches: np.ndarray
    """Critical stretches of the measured tears, ascending."""

    diameters: np.ndarray
    """Diameter at each of them."""

    def at(self, stretch: float) -> float:
        """Return the diameter at a critical stretch."""
        return float(np.interp(stretch, self.stretches, self.diameters))


def tip_diameters(
    plane: str,
    horizon_ratio: float,
    family: str | None = None,
    arrangement: str = LATTICE,
    bulk_ratio: float = BULK_RATIO,
) -> TipDiameters:
    """Return the diameters of a crack tip by critical stretch, between measured ratios of horizon
    to spacing linear in spacings, and between measured ratios of bulk and shear modulus linear in
    their logarithm, constant beyond them.

    Between two ratios, only the critical stretches that were measured for both count as measured.

    Parameters
    ----------
    plane : str
        "stress", "strain" or "space".
    horizon_ratio : float
        Horizon divided by the spacing of the points.
    family : str, optional
        Family of the force model, see `pdsurrogate.forces.ForceModel`; by default the first family
        that was measured for the other arguments.
    arrangement : str
        Arrangement of the points.
    bulk_ratio : float
        Bulk modulus over shear modulus at small strains.

    Raises
    ------
    ValueError
        If no diameter was measured for these arguments; the message lists the measured cases.
    """
    cases: dict[tuple, dict[float, dict[float, list]]] = {}
    for entry in measured_diameters():
        case = cases.setdefault((entry["family"], entry["plane"], entry["arrangement"]), {})
        by_bulk = case.setdefault(entry["horizon_ratio"], {})
        by_bulk.setdefault(entry["bulk_ratio"], []).append(
            (entry["critical_stretch"], entry["diameter"])
        )
    told = []
    for (known, state, points), by_ratio in cases.items():
        ratios = sorted(by_ratio)
        if (
            (state, points) == (plane, arrangement)
            and family in (None, known)
            and ratios[0] - 1e-9 <= horizon_ratio <= ratios[-1] + 1e-9
        ):
            of_bulk = {ratio: _of_bulk(by_ratio[ratio], bulk_ratio) for ratio in ratios}
            return _between(of_bulk, horizon_ratio)
        told.append(
            _told(known, state, points)
            + " to ".join(dict.fromkeys(f"{ratio:g}" for ratio in (ratios[0], ratios[-1])))
        )
    here = f"{_told(family, plane, arrangement)}{horizon_ratio:g}"
    limited = (
        f"for which the diameter of a crack tip was measured ({'; '.join(told)}), not for {here}"
    )
    raise ValueError(
        f"fracture.energy is available only in cases {limited}; set fracture.critical_stretch"
        " instead"
    )


def _of_bulk(by_bulk: dict[float, list], bulk_ratio: float) -> list:
    """Return stretches with their diameters at a ratio of bulk and shear modulus: those of the
    least measured one times factors, which need fewer critical stretches.
    """
    measured = [np.array(sorted(by_bulk[ratio])).T for ratio in sorted(by_bulk)]
    stretches, diameters = measured[0]
    factors = [
        np.interp(stretches, own[0], own[1] / np.interp(own[0], stretches, diameters))
        for own in measured
    ]
    logs = np.log(sorted(by_bulk))
    at = [np.interp(np.log(bulk_ratio), logs, of_one) for of_one in np.transpose(factors)]
    return [*zip(stretches, diameters * at, strict=True)]


def _between(by_ratio: dict[float, list], horizon_ratio: float) -> TipDiameters:
    """Return the diameters at a horizon from those of the measured horizons on both sides; each
    list has stretches with their diameters.

    The diameter is linear in spacings: horizons in which a point has the same neighbors have tips
    of the same size in spacings.
    """
    ratios = np.array(sorted(by_ratio))
    place = float(np.interp(horizon_ratio, ratios, np.arange(len(ratios))))
    sides = ratios[int(np.floor(place))], ratios[int(np.ceil(place))]
    low, high = (np.array(sorted(by_ratio[ratio])).T for ratio in sides)
    stretches = np.unique(np.concatenate([low[0], high[0]]))
    stretches = stretches[
        (stretches >= max(low[0][0], high[0][0])) & (stretches <= min(low[0][-1], high[0][-1]))
    ]
    share = place % 1
    spacings = (1 - share) * sides[0] * np.interp(stretches, *low) + share * sides[1] * np.interp(
        stretches, *high
    )
    return TipDiameters(stretches, spacings / np.clip(horizon_ratio, ratios[0], ratios[-1]))


def tip_diameters_in(
    scene: SceneData, family: str | None = None, bulk_ratio: float = BULK_RATIO
) -> TipDiameters:
    """Return `tip_diameters` for a scene; the points of a mesh count as those of a lattice.

    Raise ValueError for a weight of bonds that was not measured: with ``"constant"`` tears needed
    12 to 21 % more energy than prescribed.
    """
    if scene.weight != "inverse":
        limited = (
            "for which the diameter of a crack tip was measured (weight=inverse), not for"
            f" weight={scene.weight}"
        )
        raise ValueError(
            f"fracture.energy is available only in cases {limited}; set fracture.critical_stretch"
            " instead"
        )
    points = getattr(scene.body, "arrangement", LATTICE)
    return tip_diameters(scene.plane, scene.horizon_ratio, family, points, bulk_ratio)


def _told(family: str | None, plane: str, arrangement: str) -> str:
    points = "" if arrangement == LATTICE else f"arrangement={arrangement}, "
    return f"{'' if family is None else f'{family}, '}plane={plane}, {points}horizon_ratio "
