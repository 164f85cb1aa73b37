"""Material laws, their stresses in plane stress, plane strain and three dimensions, and exact homogeneous solutions."""

from .arruda_boyce import ArrudaBoyce
from .full_network import FullNetwork
from .gent import Gent
from .law import InvariantLaw, Law, PrincipalStretchLaw
from .mooney_rivlin import MooneyRivlin
from .neo_hookean import NeoHookean
from .ogden import Ogden
from .planes import PLANES, SHEETS, dimension_of
from .polyconvex import Polyconvex
from .yeoh import Yeoh

LAWS: dict[str, type[Law]] = {law.name: law for law in (NeoHookean, MooneyRivlin, Yeoh, Gent, ArrudaBoyce, Ogden, FullNetwork, Polyconvex)}

__all__ = [
    "LAWS",
    "PLANES",
    "SHEETS",
    "ArrudaBoyce",
    "FullNetwork",
    "Gent",
    "InvariantLaw",
    "Law",
    "MooneyRivlin",
    "NeoHookean",
    "Ogden",
    "Polyconvex",
    "PrincipalStretchLaw",
    "Yeoh",
    "dimension_of",
]
