"""Files of laboratories: tables of testing machines, displacement fields of cameras."""

from .fields import files_at, is_field, read_fields
from .mechanical import read_tests
from .reading import read_tables
from .specimens import MechanicalTests

__all__ = ["MechanicalTests", "files_at", "is_field", "read_fields", "read_tables", "read_tests"]
