"""Readings of stretch and stress from the columns of a table, which must agree."""

import re
from dataclasses import replace

import numpy as np

from .breaks import WORDS
from .plausible import AGREE, SOURCES, TRUE, Reading, doubts, from_rest, not_understood, question_of
from .quantities import KINDS, amount_in, factor, found_in, is_nominal, plain
from .specimens import ALL_MODES, BIAXIAL, TEARS, Facts
from .table import FAMILIES, Block, Column

NEEDED = {
    "extension": "the gauge length: --gauge-length '25 mm'",
    "force": "the undeformed area: --area '12 mm2', or --width and --thickness",
}
"""Sizes without which quantities are no stretches or stresses."""

COMPRESSION = r"compress|compres|druck|stauch|压缩|圧縮"
"""Words of headings whose numbers are positive in compression."""


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
        self._true_stress = self._unknown_mode = False
        self.resolution = 0.0

    def _column(self, quantity: str) -> Column | None:
        """Return the first column of a quantity alone."""
        return next((one for one in self.block.columns if one.quantities == (quantity,)), None)

    def numbers(self, quantity: str) -> np.ndarray:
        """Return the numbers of a quantity, in its unit of `UNITS`; NaN without a column of it."""
        found = self._column(quantity)
        return np.full(len(self.block.lines), np.nan) if not found else found.in_unit_of(quantity)

    def has_unit(self, quantity: str) -> bool:
        """Return whether there is a column of a quantity alone, with a unit."""
        found = self._column(quantity)
        return found is not None and found.unit is not None

    def text(self, quantity: str) -> list[str]:
        """Return the text of a column for each row, empty without such a column."""
        found = self._column(quantity)
        return (
            [""] * len(self.block.lines)
            if found is None
            else [f"{one:g}" if isinstance(one, float) else str(one) for one in found.values]
        )

    def ended(self, rows: np.ndarray) -> str | None:
        """Return how the test in some rows ended, a key of `breaks.WORDS`, by what the user, a
        column or an entry of the file says; None if nothing does.
        """
        cells = {self.text("broke")[row] for row in rows} - {"", "nan"}
        texts = cells or {self.block.facts.get("broke", "")} - {""}
        found = {text: found_in(WORDS, text) for text in texts}
        if unknown := [text for text, kind in found.items() if kind is None]:
            self.assumed.append(f"how the test ended, {unknown[0]!r}, is not understood (--broke)")
        own = next((kind for kind in WORDS if kind in found.values() and kind != "no"), None)
        own = own or ("no" if "no" in found.values() else None)
        stated = self.facts.broke
        kind = None if stated is None else found_in(WORDS, str(stated))
        if kind and own and kind != own:
            raise ValueError(f"{self.where}: --broke {stated}, but the file says {min(texts)}")
        return kind or own

    def modes(self) -> list[str] | None:
        """Return the mode of loading of each row; None, with a remark, if it is missing."""
        stated, found = self.facts.mode, [one.lower() for one in self.text("mode")]
        own = {*found} - {""}
        if wrong := ({*found} if own else own) - {*ALL_MODES}:
            line = next(
                line for line, mode in zip(self.block.lines, found, strict=True) if mode in wrong
            )
            raise ValueError(
                f"{self.where}, line {line}: unknown mode {min(wrong)!r}; there are"
                f" {', '.join(ALL_MODES)}"
            )
        quantities = {one for column in self.block.columns for one in column.quantities}
        if {"lateral-stress", "lateral-stretch"} <= quantities:
            own = {BIAXIAL}
        if stated not in TEARS:  # machines call each test one of tension
            own = own or {self.block.mode} - {None}
        if stated is not None and own and own != {stated}:
            raise ValueError(
                f"{self.where}: the file says {', '.join(sorted(own))}, not --mode {stated}"
            )
        if not own and stated is None:
            self.missing.append(f"the mode of loading is not stated: --mode {'|'.join(ALL_MODES)}")
            self._unknown_mode = True
            return None
        if own - {*ALL_MODES, BIAXIAL}:
            self.assumed.append(f"a {', '.join(own)} test, which is not used")
            return None
        return found if any(found) else [next(iter(own or {stated}))] * len(found)

    def stretch_and_stress(self) -> tuple[np.ndarray, np.ndarray] | None:
        """Return stretches and nominal stresses; None, with remarks, if something is missing."""
        before = len(self.missing)
        strains, stresses = self._alternatives("strain"), self._alternatives("stress")
        if not (strains and stresses) and len(self.missing) == before:
            self.missing.append(question_of(self.block))
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
        if self.facts.zero != "keep":
            strain, remarks = from_rest(strain, stress)
            self.assumed += remarks
        asked, remarks = doubts(strain, stress, confirmed)
        self.assumed += remarks
        if asked:
            self.missing.append(asked)
            return None
        self.assumed += [
            f"{one}: converted at constant volume"
            for one in (strain, stress)
            if one.quantity.startswith("true")
        ]
        if unknown := not_understood(self.block):
            self.assumed.append(f"{unknown}: not understood, and not used (--column strain='...')")
        for column in self.block.columns:
            across = column.quantities == ("lateral-stress",)
            if across and (column.unit is None) != (stress.column.unit is None):
                self.missing.append("the unit of all stresses: --unit stress=MPa")
        self._true_stress = stress.quantity == "true-stress"
        wanted = self.facts.stress_unit
        self.unit = None if stress.column.unit is None else wanted or "MPa"
        if wanted and self.unit is None:
            self.missing.append(f"the unit of {stress.column.heading!r}: --unit stress={wanted}")
        # A number that the file has with few digits moves in steps of the last one.
        span = np.nanmax(np.abs(strain.column.values)) / np.nanmax(np.abs(strain.values - 1) + 1e-9)
        self.resolution = _last_digit(strain.column.values) / max(float(span), 1e-9)
        return strain.values, self.in_wanted_unit(stress.values)

    def across(self, stretch: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
        """Return stretches across the load, also by volume ratios, and nominal stresses across it;
        NaN where the table does not have them.
        """
        found = self.numbers("lateral-stretch")
        found = np.where(np.isfinite(found), found, 1 + self.numbers("lateral-strain"))
        by_volume = np.sqrt(self.numbers("volume-ratio") / stretch)
        lateral = np.where(np.isfinite(found), found, by_volume)
        stress = self.numbers("lateral-stress")
        return lateral, self.in_wanted_unit(stress / lateral if self._true_stress else stress)

    def in_wanted_unit(self, stress: np.ndarray) -> np.ndarray:
        """Return stresses, which are in MPa, in the unit that the user wants."""
        wanted = self.facts.stress_unit
        return stress * factor("MPa", wanted) if wanted else stress

    def _alternatives(self, group: str) -> list[list[Reading]]:
        """Return the readings of each column that may give the stretch, or the nominal stress."""
        kinds = SOURCES[group]
        columns = [one for one in self.block.columns if {*one.quantities} & {*kinds}]
        stated = {*self.facts.columns} & {group, *kinds}
        if stated:  # the columns that a user names are those that count
            named = {FAMILIES.get(one, one) for one in stated}
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
                if not direct:
                    self.missing.append(f"the unit of {column.heading!r}: --unit {meanings[0]}=...")
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
        size: float | None = 1.0
        if quantity == "extension":
            size = self.size("gauge length")
            if size is None and (size := self.size("length")):
                self.assumed.append(f"the length of {size:g} mm is taken as gauge length")
        elif quantity == "force":
            size = self.area()
        if size is None:
            if needed:
                unless = self._unknown_mode and quantity == "extension"
                self.missing.append(NEEDED[quantity] + ", unless it is a trouser" * unless)
            return None
        values = values / size
        if quantity == "true-strain":
            with np.errstate(over="ignore"):
                values = np.exp(values)
        elif quantity in ("extension", "engineering-strain"):
            values = 1 + values
        return Reading(column, quantity, values)

    def size(self, name: str, to: str = "mm") -> float | None:
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

    def area(self) -> float | None:
        """Return the undeformed area in mm2 from all that is stated of it."""
        area = self.size("area", "mm2")
        width, thickness, diameter = map(self.size, ("width", "thickness", "diameter"))
        found = {
            "area": area,
            "diameter": diameter and np.pi / 4 * diameter**2,
            "width and thickness": width and thickness and width * thickness,
        }
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


def _last_digit(values: np.ndarray) -> float:
    """Return the unit of the last decimal digit that numbers have, at least 1e-6 of them."""
    some = values[np.isfinite(values)]
    for digits in range(7):
        if np.allclose(some, np.round(some, digits), rtol=0, atol=1e-9):
            return 10.0**-digits
    return 0.0
