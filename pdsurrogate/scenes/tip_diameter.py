"""Effective crack-tip diameters in horizons, by force model, plane, arrangement, ratio of
horizon to spacing, and critical stretch.
"""

import json
from collections.abc import Sequence
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
    """Diameters of a crack tip in horizons, linear between critical stretches and constant beyond
    them.
    """

    stretches: np.ndarray
    """Critical stretches between which the diameters are linear, ascending."""

    diameters: np.ndarray
    """Diameter at each of them."""

    measured: tuple[float, float]
    """Least and greatest critical stretch that were measured for all neighboring horizons and
    ratios of the moduli.
    """

    bulk_ratios: tuple[float, float]
    """Least and greatest ratio of bulk and shear modulus that were measured for all neighboring
    horizons; 0 and infinity where the diameter does not depend on it.
    """

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

    Each horizon's diameters are constant beyond its own critical stretches, so that a diameter is
    continuous in all three.

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
            tip = _between(by_ratio, horizon_ratio, bulk_ratio)
            # a sheet in plane stress changes its thickness in place of its volume
            return tip._replace(bulk_ratios=(0.0, np.inf)) if plane == "stress" else tip
        told.append(
            _told(known, state, points)
            + " to ".join(dict.fromkeys(f"{ratio:g}" for ratio in (ratios[0], ratios[-1])))
        )
    raise ValueError(
        "fracture.energy is available only in cases for which the diameter of a crack tip was"
        f" measured ({'; '.join(told)}), not for"
        f" {_told(family, plane, arrangement)}{horizon_ratio:g}; set fracture.critical_stretch"
        " instead"
    )


def _of_bulk(by_bulk: dict[float, list], bulk_ratio: float) -> TipDiameters:
    """Return the diameters at a ratio of bulk and shear modulus: those of the least measured one
    times factors, which need fewer critical stretches.
    """
    known = {ratio: np.array(sorted(of_one)).T for ratio, of_one in sorted(by_bulk.items())}
    stretches, diameters = next(iter(known.values()))
    factor = np.zeros_like(stretches)
    sides = _sides(np.log(bulk_ratio), np.log([*known]))
    own = [[*known.values()][number] for number, _ in sides]
    for (measured, of_one), (_, share) in zip(own, sides, strict=True):
        ratios = of_one / np.interp(measured, stretches, diameters)
        factor += share * np.interp(stretches, measured, ratios)
    return TipDiameters(
        stretches, diameters * factor, _shared([one[0] for one in own]), _shared([[*known]])
    )


def _between(
    by_ratio: dict[float, dict[float, list]], horizon_ratio: float, bulk_ratio: float
) -> TipDiameters:
    """Return the diameters at a horizon from those of the measured horizons on both sides.

    The diameter is linear in spacings: horizons in which a point has the same neighbors have tips
    of the same size in spacings.
    """
    ratios = sorted(by_ratio)
    sides = _sides(horizon_ratio, ratios)
    tips = [_of_bulk(by_ratio[ratios[number]], bulk_ratio) for number, _ in sides]
    stretches = np.unique(np.concatenate([tip.stretches for tip in tips]))
    spacings = sum(
        share * ratios[number] * np.interp(stretches, tip.stretches, tip.diameters)
        for tip, (number, share) in zip(tips, sides, strict=True)
    )
    return TipDiameters(
        stretches,
        spacings / np.clip(horizon_ratio, ratios[0], ratios[-1]),
        _shared([tip.measured for tip in tips]),
        _shared([tip.bulk_ratios for tip in tips]),
    )


def _sides(value: float, known: Sequence[float]) -> list[tuple[int, float]]:
    """Return the numbers of the known values on both sides of a value, or of the one within
    rounding of it, with their shares in it.
    """
    place = round(float(np.interp(value, known, np.arange(len(known)))), 9)
    return [(number, 1 - abs(place - number)) for number in {int(place), int(np.ceil(place))}]


def _shared(ranges: Sequence[Sequence[float]]) -> tuple[float, float]:
    """Return the ends of what ascending ranges have in common."""
    return max(one[0] for one in ranges), min(one[-1] for one in ranges)


def grown_with_bulk() -> tuple[float, float, float, float]:
    """Return the ratios of bulk and shear modulus between which diameters in plane strain were
    measured, and the least and greatest quotient of the diameters at both.
    """
    found: dict[tuple, dict[float, float]] = {}
    for entry in measured_diameters():
        if (entry["family"], entry["plane"]) == ("bond energy", "strain"):
            case = entry["arrangement"], entry["horizon_ratio"], entry["critical_stretch"]
            found.setdefault(case, {})[entry["bulk_ratio"]] = entry["diameter"]
    ratios = [ratio for of_case in found.values() for ratio in of_case]
    low, high = min(ratios), max(ratios)
    grown = [own[high] / own[low] for own in found.values() if low in own and high in own]
    return low, high, min(grown), max(grown)


def tip_diameters_in(
    scene: SceneData, family: str | None = None, bulk_ratio: float = BULK_RATIO
) -> TipDiameters:
    """Return `tip_diameters` for a scene; the points of a mesh count as those of a lattice.

    Raise ValueError for a weight of bonds that was not measured: with ``"constant"`` tears needed
    12 to 21 % more energy than prescribed.
    """
    if scene.weight != "inverse":
        raise ValueError(
            "fracture.energy is available only in cases for which the diameter of a crack tip was"
            f" measured (weight=inverse), not for weight={scene.weight}; set"
            " fracture.critical_stretch instead"
        )
    points = getattr(scene.body, "arrangement", LATTICE)
    return tip_diameters(scene.plane, scene.horizon_ratio, family, points, bulk_ratio)


def _told(family: str | None, plane: str, arrangement: str) -> str:
    points = "" if arrangement == LATTICE else f"arrangement={arrangement}, "
    return f"{'' if family is None else f'{family}, '}plane={plane}, {points}horizon_ratio "
