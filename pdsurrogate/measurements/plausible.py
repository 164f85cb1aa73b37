"""Readings of single columns as stretches or nominal stresses, and whether they can be those of a
test of rubber.
"""

from dataclasses import dataclass, replace
from itertools import permutations

import numpy as np

from .branches import MOST_SLACK
from .quantities import KINDS, fits, found_in, is_of_unit, unit_in
from .table import Block, Column

SOURCES = {
    "strain": ("stretch", "engineering-strain", "true-strain", "extension"),
    "stress": ("nominal-stress", "true-stress", "force"),
}
"""Quantities from which stretch and nominal stress follow, the most direct one first."""

TRUE = {"engineering-strain": "true-strain", "nominal-stress": "true-stress"}
"""Quantities that headings without "engineering" or "nominal" may mean as well."""

AGREE = 0.02
"""Fraction of their range by which two columns that say the same may differ. Chosen: twice the
scatter of a laboratory.
"""

MOST_STRETCH = 15.0
"""Greatest stretch that rubber bears: natural rubber breaks at 8 to 10, soft gels at some 15."""

MOST_STRESS = 100.0
"""Greatest nominal stress that rubber bears, in MPa: the strongest break at some 40."""

UNLOADED = 0.01
"""Fraction of the greatest stress below which a row counts as unloaded."""


@dataclass(frozen=True)
class Reading:
    """Stretches, or nominal stresses, by one meaning of a column."""

    column: Column
    quantity: str
    values: np.ndarray

    def __str__(self) -> str:
        kind = "stretch" if self.quantity in SOURCES["strain"] else "nominal stress"
        return (
            f"{self.column.heading!r} as {self.quantity} ({kind} {np.nanmin(self.values):.4g} to"
            f" {np.nanmax(self.values):.4g})"
        )

    @property
    def option(self) -> str:
        """Text that chooses this reading after --column."""
        return f"{self.quantity}={self.column.heading!r}"

    def agrees(self, other: "Reading") -> bool:
        """Whether another reading gives the same numbers."""
        least = AGREE * np.nanmax(np.abs(self.values - self.values[0]))
        return bool(np.nanmax(np.abs(self.values - other.values)) <= least)


def from_rest(strain: Reading, stress: Reading) -> tuple[Reading, list[str]]:
    """Return stretches of an extension that is counted from elsewhere, as positions of a crosshead
    are, from its first row, if that has no force; and remarks on that.
    """
    first = int(np.isfinite(strain.values + stress.values).argmax())
    size, away = np.abs(stress.values), strain.values[first] - 1
    reach = min(1.0, float(np.ptp(strain.values[np.isfinite(strain.values)])))
    begins = size[first] <= UNLOADED * np.nanmax(size) and abs(away) > MOST_SLACK * reach > 0
    if strain.quantity != "extension" or not begins:
        return strain, []
    remark = (
        f"{strain.column.heading!r} begins at {strain.column.values[first]:g} without force, and is"
        " counted from there (--zero keep)"
    )
    return replace(strain, values=strain.values - away), [remark]


def doubts(strain: Reading, stress: Reading, confirmed: bool) -> tuple[str | None, list[str]]:
    """Return what is to be asked of stretches that cannot be those of a test that begins at rest,
    unless another column has `confirmed` them, and remarks on numbers that rubber hardly has.
    """
    size = np.abs(stress.values)
    # Of the rows without stress those before the load count, not those after a break.
    away = np.where(size <= UNLOADED * np.nanmax(size), np.abs(strain.values - 1), np.inf)
    rest = int(np.nanargmin(away)) if np.isfinite(away).any() else 0
    name, raw = strain.column.heading, strain.column.in_unit_of(strain.quantity)
    unloaded = size[rest] <= UNLOADED * np.nanmax(size) > 0 and np.ptp(raw) > 0
    elsewhere = unloaded and abs(strain.values[rest] - 1) > 0.3
    least, most = np.nanmin(strain.values), np.nanmax(strain.values)
    is_strain = strain.quantity in ("engineering-strain", "true-strain")
    too_far = most > MOST_STRETCH and not confirmed
    number = is_strain and strain.column.unit is None and not confirmed
    questions = (
        (
            number and too_far,
            f"{strain}, or in per cent to a stretch of {1 + np.nanmax(raw) / 100:.4g}: --unit"
            " strain=1 or --unit strain=%",
        ),
        (
            is_strain and np.nanmin(raw) >= 1 - 1e-3 and len(raw) > 1,
            f"{strain}, or as a stretch of {np.nanmin(raw):.4g} to {np.nanmax(raw):.4g}, as it"
            f" never is less than 1: --column stretch={name!r}",
        ),
        (
            elsewhere and strain.quantity == "extension",
            f"{strain} is {strain.values[rest]:.4g} without stress: is the length right?",
        ),
        (
            elsewhere,
            f"{strain} is {strain.values[rest]:.4g} without stress; as a strain it gives a stretch"
            f" of {1 + least:.4g} to {1 + most:.4g}: --column engineering-strain={name!r}",
        ),
    )
    asked = next((text for holds, text in questions if holds), None)
    remarks = (
        (
            number and np.nanmax(raw) > 1 and not asked,
            f"{name!r} has no unit, and is taken as a number, not in per cent (--unit strain=%)",
        ),
        (
            too_far and not asked,
            f"{strain} is more than rubber bears: correct the unit or length",
        ),
        (
            size.max(where=np.isfinite(size), initial=0.0) > MOST_STRESS and stress.column.unit,
            f"{stress} in MPa is more than rubber bears: correct unit or area",
        ),
    )
    return asked, [text for holds, text in remarks if holds]


def not_understood(block: Block) -> str:
    """Return which columns have a unit of stretches or stresses, and no heading that is known, as
    text; empty if there are none.
    """
    wanted = "extension", "engineering-strain", "force", "nominal-stress"
    return ", ".join(
        f"{one.heading!r} in {one.unit}"
        for one in block.columns
        if not one.quantities and is_of_unit(one.heading, one.unit, *wanted)
    )


def question_of(block: Block) -> str:
    """Return the question which columns are the stretch and the stress, with the readings that are
    possible.
    """
    columns = [
        (number, one)
        for number, one in enumerate(block.columns, start=1)
        if one.values.dtype.kind == "f" and np.isfinite(one.values).any()
        if one.quantities not in (("time",), ("temperature",), ("cycle",))
        if found_in(KINDS, one.heading) != "no measurement"
    ]
    words = ", ".join(
        f"{number} {one.heading!r} ({np.nanmin(one.values):.4g} to {np.nanmax(one.values):.4g})"
        for number, one in columns
    )
    text = f"which column is the stretch and which the stress, of {words}"
    if others := [
        repr(one.heading)
        for one in block.columns
        if found_in(KINDS, one.heading) == "no measurement"
    ]:
        text += f" ({', '.join(others)}: neither)"
    readings = [
        f"--column {kinds[0]}={strain[0]} --column {kinds[1]}={stress[0]}"
        for strain, stress in permutations(columns, 2)
        if all(kinds := [_kind(strain[1], "strain"), _kind(stress[1], "stress")])
    ]
    if not 0 < len(readings) < 3:
        readings = ["--column strain=NUMBER --column stress=NUMBER (or force, extension)"]
    return f"{text}: {', or '.join(readings)}"


def _kind(column: Column, group: str) -> str | None:
    """Return what a column may be as a strain or stress by its unit, or its numbers."""
    unit = unit_in(column.unit or "") or ""
    if unit:
        kinds = SOURCES[group][1::2] if group == "strain" else SOURCES[group][::2]
        return next((one for one in kinds if fits(unit, one)), None)
    if group == "stress":
        return group
    return "stretch" if np.nanmin(column.values) >= 0.3 else "engineering-strain"
