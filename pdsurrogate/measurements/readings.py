"""What the columns of a table mean together: readings of stretch and stress, which must agree."""

import re
from dataclasses import dataclass, replace
from itertools import permutations

import numpy as np

from .branches import MOST_SLACK
from .quantities import (
    KINDS,
    amount_in,
    factor,
    fits,
    found_in,
    is_nominal,
    is_of_unit,
    plain,
    unit_in,
)
from .specimens import BIAXIAL, MODES, Facts
from .table import Block, Column

SOURCES = {
    "strain": ("stretch", "engineering-strain", "true-strain", "extension"),
    "stress": ("nominal-stress", "true-stress", "force"),
}
"""Quantities from which stretch and nominal stress follow, the most direct one first."""

TRUE = {"engineering-strain": "true-strain", "nominal-stress": "true-stress"}
"""What headings without "engineering" or "nominal" may mean as well."""

COMPRESSION = r"compress|compres|druck|stauch|压缩|圧縮"
"""Words of headings whose numbers are positive in compression."""

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
        span = f"{np.nanmin(self.values):.4g} to {np.nanmax(self.values):.4g}"
        return f"{self.column.heading!r} as {self.quantity} ({kind} {span})"

    @property
    def option(self) -> str:
        """What names this reading after --column."""
        return f"{self.quantity}={self.column.heading!r}"

    def agrees(self, other: "Reading") -> bool:
        """Whether another reading gives the same numbers."""
        least = AGREE * np.nanmax(np.abs(self.values - self.values[0]))
        return bool(np.nanmax(np.abs(self.values - other.values)) <= least)


class Readings:
    """Readings of a table with what a user states of it; `missing` is what is still needed.

    Parameters
    ----------
    block : Block
    facts : Facts
    where : str
        Name of the table for messages.
    """

    def __init__(self, block: Block, facts: Facts, where: str) -> None:
        self.block, self.facts, self.where = block, facts, where
        self.assumed: list[str] = []
        self.missing: list[str] = []
        self.used: set[str] = set()
        self.unit: str | None = None
        self.true_stress = False
        self.resolution = 0.0

    def _column(self, quantity: str) -> Column | None:
        """Return the first column of a quantity alone."""
        return next((one for one in self.block.columns if one.quantities == (quantity,)), None)

    def numbers(self, quantity: str) -> np.ndarray:
        """Return the numbers of a quantity, in its unit of `UNITS`; NaN without a column of it."""
        found = self._column(quantity)
        return np.full(len(self.block.lines), np.nan) if not found else found.in_unit_of(quantity)

    def text(self, quantity: str) -> list[str]:
        """Return the text of a column for each row, empty without such a column."""
        found = self._column(quantity)
        return (
            [""] * len(self.block.lines)
            if found is None
            else [f"{one:g}" if isinstance(one, float) else str(one) for one in found.values]
        )

    def modes(self) -> list[str] | None:
        """Return the mode of loading of each row; None, with a remark, if it is missing."""
        stated, found = self.facts.mode, [one.lower() for one in self.text("mode")]
        own = {*found} - {""}
        if wrong := ({*found} if own else own) - {*MODES}:
            line = next(
                line for line, mode in zip(self.block.lines, found, strict=True) if mode in wrong
            )
            raise ValueError(
                f"{self.where}, line {line}: unknown mode {min(wrong)!r}; there are"
                f" {', '.join(MODES)}"
            )
        quantities = {one for column in self.block.columns for one in column.quantities}
        if {"lateral-stress", "lateral-stretch"} <= quantities:
            own = {BIAXIAL}
        own = own or {self.block.mode} - {None}
        if stated is not None and own and own != {stated}:
            raise ValueError(
                f"{self.where}: the file says {', '.join(sorted(own))}, not --mode {stated}"
            )
        if not own and stated is None:
            self.missing.append(f"the mode of loading is not stated: --mode {'|'.join(MODES)}")
            return None
        if own - {*MODES, BIAXIAL}:
            self.assumed.append(f"a {', '.join(own)} test, which is not used")
            return None
        return found if any(found) else [next(iter(own or {stated}))] * len(found)

    def stretch_and_stress(self) -> tuple[np.ndarray, np.ndarray] | None:
        """Return stretches and nominal stresses; None, with remarks, if something is missing."""
        before = len(self.missing)
        strains, stresses = self._alternatives("strain"), self._alternatives("stress")
        if not (strains and stresses) and len(self.missing) == before:
            self._ask_for_columns()
        strain = None if self.missing else self._chosen("strain", strains, stresses)
        if strain is None:
            return None
        with np.errstate(divide="ignore", invalid="ignore"):
            stresses = [
                [
                    replace(one, values=one.values / strain.values)
                    if one.quantity == "true-stress"
                    else one
                    for one in options
                ]
                for options in stresses
            ]
        stress = self._chosen("stress", stresses, strains)
        others = [one for options in strains for one in options if one.column is not strain.column]
        confirmed = any(strain.agrees(one) for one in others)
        if stress is None:
            return None
        strain = self._from_rest(strain, stress)
        if not self._possible(strain, stress, confirmed):
            return None
        self.assumed += [
            f"{one}: converted at constant volume"
            for one in (strain, stress)
            if one.quantity.startswith("true")
        ]
        self._tell_unknown()
        for column in self.block.columns:
            across = column.quantities == ("lateral-stress",)
            if across and (column.unit is None) != (stress.column.unit is None):
                self.missing.append("the unit of all stresses: --unit stress=MPa")
        self.true_stress = stress.quantity == "true-stress"
        wanted = self.facts.stress_unit
        self.unit = None if stress.column.unit is None else wanted or "MPa"
        if wanted and self.unit is None:
            self.missing.append(f"the unit of {stress.column.heading!r}: --unit stress={wanted}")
        # A number that the file has with few digits moves in steps of the last one.
        span = np.nanmax(np.abs(strain.column.values)) / np.nanmax(np.abs(strain.values - 1) + 1e-9)
        self.resolution = _last_digit(strain.column.values) / max(float(span), 1e-9)
        return strain.values, stress.values * (factor("MPa", wanted) if wanted else 1.0)

    def lateral(self, stretch: np.ndarray) -> np.ndarray:
        """Return the stretches across the load that the table has, also by its volume ratios, else
        NaN.
        """
        found = self.numbers("lateral-stretch")
        found = np.where(np.isfinite(found), found, 1 + self.numbers("lateral-strain"))
        by_volume = np.sqrt(self.numbers("volume-ratio") / stretch)
        return np.where(np.isfinite(found), found, by_volume)

    def _alternatives(self, group: str) -> list[list[Reading]]:
        """Return the readings of each column that may give the stretch, or the nominal stress."""
        kinds = SOURCES[group]
        columns = [one for one in self.block.columns if {*one.quantities} & {*kinds}]
        stated = {*self.facts.columns} & {group, *kinds}
        if stated:  # the columns that a user names are those that count
            named = {kinds[group == "strain"] if one == group else one for one in stated}
            columns = [one for one in columns if {*one.quantities} <= named] or columns
        direct = any({*one.quantities} - {"extension", "force"} for one in columns)
        found: list[list[Reading]] = []
        for column in columns:
            meanings = [one for one in column.quantities if one in kinds]
            marked = is_nominal(column.heading) or meanings[0] in stated
            marked = marked or found_in(KINDS, column.heading) == "elongation"
            if len(meanings) == 1 and meanings[0] in TRUE and not marked:
                meanings.append(TRUE[meanings[0]])
            if column.unit is None and {*meanings} & {"extension", "force"} == {*meanings}:
                self._need(not direct, f"the unit of {column.heading!r}: --unit {meanings[0]}=...")
                continue
            options = [self._reading(column, one, not direct) for one in meanings]
            found.append([one for one in options if one is not None])
        found = [options for options in found if options]
        if group == "strain" and len(found) > 1:
            for options in [one for one in found if np.nanmin(one[0].values) <= 0]:
                self.assumed.append(f"{options[0]} is a position, and is not used")
                found.remove(options)
        if group == "stress" and any(options[0].column.unit for options in found):
            for options in [options for options in found if not options[0].column.unit]:
                self.assumed.append(f"{options[0].column.heading!r} has no unit, and is not used")
                found.remove(options)
        return found

    def _need(self, needed: bool, text: str) -> None:
        """Note that something is missing, if it is needed."""
        if needed:
            self.missing.append(text)

    def _reading(self, column: Column, quantity: str, needed: bool) -> Reading | None:
        """Return the stretches, or stresses, of a column by a meaning; None without its size.

        True stresses are still to be divided by the stretch.
        """
        values = column.in_unit_of(quantity)
        titles = [self.block.title, *(one.heading for one in self.block.columns)]
        squeezed = any(re.search(COMPRESSION, plain(text).lower()) for text in titles)
        if squeezed and quantity != "stretch" and np.nanmax(values) > -np.nanmin(values):
            values = -values
            if (text := f"{column.heading!r} is positive in compression") not in self.assumed:
                self.assumed.append(text)
        if quantity == "extension":
            gauge = self._size("gauge length", "mm")
            if gauge is None and (gauge := self._size("length", "mm")):
                self.assumed.append(f"the length of {gauge:g} mm is taken as gauge length")
            if gauge is None:
                self._need(needed, "the gauge length: --gauge-length '25 mm'")
                return None
            values = 1 + values / gauge
        elif quantity == "force":
            area = self._area()
            if area is None:
                self._need(
                    needed, "the undeformed area: --area '12 mm2', or --width and --thickness"
                )
                return None
            values = values / area
        elif quantity == "engineering-strain":
            values = 1 + values
        elif quantity == "true-strain":
            with np.errstate(over="ignore"):
                values = np.exp(values)
        return Reading(column, quantity, values)

    def _size(self, name: str, to: str) -> float | None:
        """Return a length or area that the user or the file states, in a unit."""
        option = f"--{name.replace(' ', '-')}"
        stated = self.facts.sizes().get(name)
        found = [
            amount_in(text, to, f"{self.where}: {what}")
            for text, what in ((stated, option), (self.block.facts.get(name), f"the file's {name}"))
            if text is not None
        ]
        if stated is not None:
            self.used.add(name)
        if len(found) == 2 and abs(found[0] - found[1]) > AGREE * found[1]:
            raise ValueError(
                f"{self.where}: {option} {stated} is stated, but the file says"
                f" {self.block.facts[name]}"
            )
        return found[0] if found else None

    def _area(self) -> float | None:
        """Return the undeformed area in mm2 from all that is stated of it."""
        area, width, thickness, diameter = (
            self._size(name, to)
            for name, to in (
                ("area", "mm2"),
                ("width", "mm"),
                ("thickness", "mm"),
                ("diameter", "mm"),
            )
        )
        found = {"area": area, "diameter": diameter and np.pi / 4 * diameter**2}
        found["width and thickness"] = width and thickness and width * thickness
        known = {words: float(one) for words, one in found.items() if one}
        if known and max(known.values()) > (1 + AGREE) * min(known.values()):
            words = ", ".join(f"{one:.4g} mm2 by {words}" for words, one in known.items())
            raise ValueError(f"{self.where}: the area is {words}: state what is right alone")
        return next(iter(known.values()), None)

    def _chosen(self, group, columns, others) -> Reading | None:
        """Return the reading of a group that all columns confirm; None if it is to be asked for."""
        wish = {"strain": self.facts.strain, "stress": self.facts.stress}[group]
        certain = [options[0] for options in columns if len(options) == 1]
        for options in (options for options in columns if len(options) > 1):
            twins = options[1].quantity == TRUE.get(options[0].quantity)
            fitting = [one for one in options if certain and one.agrees(certain[0])]
            if wish and twins:
                self.used.add(group)
                pick = options[wish == "true"]
            elif fitting:
                pick = fitting[0]
            elif certain or not twins:
                pick = options[0]
                if not certain:
                    self.missing.append(
                        f"{' or '.join(map(str, options))}: --column {options[0].option} or"
                        f" --column {options[1].option} says which"
                    )
                    return None
            else:
                pick = options[0]
                if {one.quantity.startswith("true") for one, *more in others if not more} == {True}:
                    self.missing.append(
                        f"{options[0]}, or {options[1]}: --{group} engineering|true says which"
                    )
                    return None
                self.assumed.append(f"{pick} is assumed; --{group} true takes {options[1]}")
            certain.append(pick)
        certain.sort(key=lambda one: SOURCES[group].index(one.quantity))
        for other in certain[1:]:
            if not certain[0].agrees(other):
                raise ValueError(
                    f"{self.where}: {certain[0]} contradicts {other}: correct what is stated, or"
                    f" name the right one: --column {certain[0].option} or --column {other.option}"
                )
        return certain[0]

    def _from_rest(self, strain: Reading, stress: Reading) -> Reading:
        """Return stretches of an extension that is counted from elsewhere, as positions of a
        crosshead are, from its first row, if that has no force.
        """
        first = int(np.isfinite(strain.values + stress.values).argmax())
        size, away = np.abs(stress.values), strain.values[first] - 1
        reach = min(1.0, float(np.ptp(strain.values[np.isfinite(strain.values)])))
        begins = size[first] <= UNLOADED * np.nanmax(size) and abs(away) > MOST_SLACK * reach > 0
        if strain.quantity != "extension" or not begins or self.facts.zero == "keep":
            return strain
        self.assumed.append(
            f"{strain.column.heading!r} begins at {strain.column.values[first]:g} without force,"
            " and is counted from there (--zero keep)"
        )
        return replace(strain, values=strain.values - away)

    def _tell_unknown(self) -> None:
        """Say which columns have a unit of stretches or stresses, and no heading that is known."""
        wanted = "extension", "engineering-strain", "force", "nominal-stress"
        unknown = [
            f"{one.heading!r} in {one.unit}"
            for one in self.block.columns
            if not one.quantities and is_of_unit(one.heading, one.unit, *wanted)
        ]
        if unknown:
            self.assumed.append(
                f"{', '.join(unknown)}: not understood, and not used (--column strain='...')"
            )

    def _possible(self, strain: Reading, stress: Reading, confirmed: bool) -> bool:
        """Whether stretches, which another column may confirm, can be those of a test that begins
        at rest; else ask.
        """
        size = np.abs(stress.values)
        # Of the rows without stress those before the load count, not those after a break.
        away = np.where(size <= UNLOADED * np.nanmax(size), np.abs(strain.values - 1), np.inf)
        rest = int(np.nanargmin(away)) if np.isfinite(away).any() else 0
        name, raw = strain.column.heading, strain.column.in_unit_of(strain.quantity)
        unloaded = size[rest] <= UNLOADED * np.nanmax(size) > 0 and np.ptp(raw) > 0
        least, most = np.nanmin(strain.values), np.nanmax(strain.values)
        asked = None
        is_strain = strain.quantity in ("engineering-strain", "true-strain")
        if is_strain and most > MOST_STRETCH and strain.column.unit is None and not confirmed:
            percent = 1 + np.nanmax(raw) / 100
            asked = (
                f"{strain}, or in per cent to a stretch of {percent:.4g}: --unit strain=1 or"
                " --unit strain=%"
            )
        elif is_strain and np.nanmin(raw) >= 1 - 1e-3 and len(raw) > 1:
            asked = (
                f"{strain}, or as a stretch of {np.nanmin(raw):.4g} to {np.nanmax(raw):.4g}, as it"
                f" never is less than 1: --column stretch={name!r}"
            )
        elif strain.quantity == "extension" and unloaded and abs(strain.values[rest] - 1) > 0.3:
            asked = f"{strain} is {strain.values[rest]:.4g} without stress: is the length right?"
        elif unloaded and abs(strain.values[rest] - 1) > 0.3:
            asked = (
                f"{strain} is {strain.values[rest]:.4g} without stress; as a strain it gives a"
                f" stretch of {1 + least:.4g} to {1 + most:.4g}:"
                f" --column engineering-strain={name!r}"
            )
        elif is_strain and strain.column.unit is None and not confirmed and np.nanmax(raw) > 1:
            self.assumed.append(
                f"{name!r} has no unit, and is taken as a number, not in per cent (--unit strain=%)"
            )
        elif most > MOST_STRETCH and not confirmed:
            self.assumed.append(f"{strain} is more than rubber bears: correct the unit or length")
        if size.max(where=np.isfinite(size), initial=0.0) > MOST_STRESS and stress.column.unit:
            self.assumed.append(f"{stress} in MPa is more than rubber bears: correct unit or area")
        if asked:
            self.missing.append(asked)
        return not asked

    def _ask_for_columns(self) -> None:
        """Note that columns are not understood, with the readings that are possible."""
        columns = [
            (number, one)
            for number, one in enumerate(self.block.columns, start=1)
            if one.values.dtype.kind == "f" and np.isfinite(one.values).any()
            if one.quantities not in (("time",), ("temperature",), ("cycle",))
            if found_in(KINDS, one.heading) != "no measurement"
        ]
        words = ", ".join(
            f"{number} {one.heading!r} ({np.nanmin(one.values):.4g} to {np.nanmax(one.values):.4g})"
            for number, one in columns
        )
        text = f"which column is the stretch and which the stress, of {words}"
        kinds = [(one.heading, found_in(KINDS, one.heading)) for one in self.block.columns]
        if others := [repr(heading) for heading, kind in kinds if kind == "no measurement"]:
            text += f" ({', '.join(others)}: neither)"
        readings = [
            f"--column {kinds[0]}={strain[0]} --column {kinds[1]}={stress[0]}"
            for strain, stress in permutations(columns, 2)
            if all(kinds := [_kind(strain[1], "strain"), _kind(stress[1], "stress")])
        ]
        if not 0 < len(readings) < 3:
            readings = ["--column strain=NUMBER --column stress=NUMBER (or force, extension)"]
        self.missing.append(f"{text}: {', or '.join(readings)}")


def _kind(column: Column, group: str) -> str | None:
    """Return what a column may be as a strain or stress by its unit, or its numbers."""
    unit = unit_in(column.unit or "") or ""
    if unit:
        kinds = SOURCES[group][1::2] if group == "strain" else SOURCES[group][::2]
        return next((one for one in kinds if fits(unit, one)), None)
    if group == "stress":
        return group
    return "stretch" if np.nanmin(column.values) >= 0.3 else "engineering-strain"


def _last_digit(values: np.ndarray) -> float:
    """Return the unit of the last decimal digit that numbers have, at least 1e-6 of them."""
    some = values[np.isfinite(values)]
    for digits in range(7):
        if np.allclose(some, np.round(some, digits), rtol=0, atol=1e-9):
            return 10.0**-digits
    return 0.0
