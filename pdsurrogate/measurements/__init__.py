"""Files of laboratories: tables of testing machines, displacement fields of cameras."""

from .quantities import to_si
from .reading import read_tables
from .table import QUANTITIES, Block, Column, TableFile

__all__ = ["QUANTITIES", "Block", "Column", "TableFile", "read_tables", "to_si"]
