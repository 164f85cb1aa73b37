"""Files of laboratories: tables of testing machines, displacement fields of cameras."""

from .fields import is_field, read_fields

__all__ = ["is_field", "read_fields"]
