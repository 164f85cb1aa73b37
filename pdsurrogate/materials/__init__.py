"""Material laws, their stresses in plane stress, plane strain and three dimensions, and exact homogeneous solutions."""

from .invariant_laws import ArrudaBoyce, Gent, MooneyRivlin, NeoHookean, Yeoh
from .law import InvariantLaw, Law, PrincipalStretchLaw
from .polyconvex import Polyconvex
from .states import PLANES, SHEETS, dimension_of, plane_strain, plane_stress, solid
from .stretch_laws import FullNetwork, Ogden

LAWS: dict[str, type[Law]] = {law.name: law for law in (NeoHookean, MooneyRivlin, Yeoh, Gent, ArrudaBoyce, Ogden, FullNetwork, Polyconvex)}
"""Material laws by their names in scenes and on the command line."""

__all__ = ["LAWS", "ArrudaBoyce", "FullNetwork", "Gent", "MooneyRivlin", "NeoHookean", "Ogden", "Polyconvex", "Yeoh"]
"""Names that type checkers of users' programs accept."""
