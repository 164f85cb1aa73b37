"""Tables as they stand in files of testing machines, with what their columns may mean."""

from dataclasses import dataclass, field
from pathlib import Path

import numpy as np

from .quantities import UNITS, factor

QUANTITIES = (
    "time",
    "force",
    "extension",
    "engineering-strain",
    "true-strain",
    "stretch",
    "nominal-stress",
    "true-stress",
    "lateral-stretch",
    "lateral-strain",
    "lateral-stress",
    "volume-ratio",
    "mode",
    "cycle",
    "specimen",
    "weight",
    "temperature",
    "broke",
)
"""Quantities that a column of a mechanical test can hold."""

FAMILIES = {"stress": "nominal-stress", "strain": "engineering-strain"}
"""Short names of quantities, for users and headings, with the quantities that they mean."""


@dataclass(frozen=True)
class Column:
    """A column of a table as its file has it.

    Attributes
    ----------
    heading : str
        Heading in the file, without its unit; empty if there is none.
    unit : str, optional
        Unit in the file, such as "mm" or "%".
    quantities : tuple of str
        Members of `QUANTITIES` that the heading and the unit may mean: none if the column is not
        understood, several if the reading is ambiguous.
    values : ndarray, shape (n,)
        Numbers in the unit of the file, NaN where a cell is empty; text of columns such as "mode".
    """

    heading: str
    unit: str | None
    quantities: tuple[str, ...]
    values: np.ndarray

    def in_unit_of(self, quantity: str) -> np.ndarray:
        """Return the numbers in the unit of a quantity (`UNITS`), as they are without a unit."""
        if not self.unit:
            return self.values
        try:
            return self.values * factor(self.unit, UNITS.get(quantity, "1"))
        except ValueError as error:
            raise ValueError(f"column {self.heading!r}: {error} (--unit {quantity}=...)") from None


@dataclass(frozen=True)
class Block:
    """A table of a file: a file may hold several, by specimen, sheet or keyword.

    Attributes
    ----------
    title : str
        Name of the sheet, the specimen or the keyword; empty if there is none.
    columns : tuple of Column
    lines : ndarray of int, shape (n,)
        Lines of the file (rows of the sheet), from 1, of the rows.
    mode : str, optional
        Mode of loading that the file itself states.
    facts : dict of str to str
        What the heading states: "gauge length", "width", "thickness", "diameter", "area" with
        their units, as "25 mm", and other entries by their own names.
    """

    title: str
    columns: tuple[Column, ...]
    lines: np.ndarray
    mode: str | None = None
    facts: dict[str, str] = field(default_factory=dict)


@dataclass(frozen=True)
class TableFile:
    """File of tables: its form, its notes and its tables.

    Attributes
    ----------
    path : Path
    form : str
        Form of the file in words, such as "Bluehill (raw)", "workbook" or "plain columns".
    encoding, separator, decimal_sign : str
        Of a text file; empty for a workbook.
    blocks : tuple of Block
    notes : tuple of str
        What was assumed or left out on reading.
    """

    path: Path
    form: str
    encoding: str
    separator: str
    decimal_sign: str
    blocks: tuple[Block, ...]
    notes: tuple[str, ...] = ()
