"""Material laws, their plane-stress relations, and exact homogeneous solutions."""

from .gent import Gent
from .law import InvariantLaw, Law
from .neo_hookean import NeoHookean

LAWS: dict[str, type[Law]] = {law.name: law for law in (NeoHookean, Gent)}

__all__ = ["LAWS", "Gent", "InvariantLaw", "Law", "NeoHookean"]
