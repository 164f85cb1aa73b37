"""Material laws, their plane-stress relations, and exact homogeneous solutions."""

from .law import InvariantLaw, Law
from .neo_hookean import NeoHookean

LAWS: dict[str, type[Law]] = {law.name: law for law in (NeoHookean,)}

__all__ = ["LAWS", "InvariantLaw", "Law", "NeoHookean"]
