"""Files of laboratories: tables of testing machines, displacement fields of cameras."""

from .fields import is_field, read_fields
from .quantities import to_si
from .reading import read_tables

__all__ = ["is_field", "read_fields", "read_tables", "to_si"]
