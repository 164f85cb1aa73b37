"""Material laws, their stresses in plane stress, plane strain and three dimensions, and exact
homogeneous solutions.
"""

from importlib import import_module
from typing import TYPE_CHECKING

from .covariance import LawCovariance
from .invariant_laws import ArrudaBoyce, Gent, MooneyRivlin, NeoHookean, Yeoh
from .law import InvariantLaw, Law, PrincipalStretchLaw
from .memory import Branch, Memory, Softening
from .polyconvex import Polyconvex
from .stretch_laws import FullNetwork, Ogden

if TYPE_CHECKING:
    from .states import PLANES, SHEETS, dimension_of, plane_strain, plane_stress, solid

LAWS: dict[str, type[Law]] = {
    law.name: law
    for law in (NeoHookean, MooneyRivlin, Yeoh, Gent, ArrudaBoyce, Ogden, FullNetwork, Polyconvex)
}
"""Material laws by their names in scenes and on the command line."""

__all__ = [
    "LAWS",
    "ArrudaBoyce",
    "Branch",
    "FullNetwork",
    "Gent",
    "LawCovariance",
    "Memory",
    "MooneyRivlin",
    "NeoHookean",
    "Ogden",
    "Polyconvex",
    "Softening",
    "Yeoh",
]
"""Names that type checkers of users' programs accept."""

_OF_STATES = ("PLANES", "SHEETS", "dimension_of", "plane_strain", "plane_stress", "solid")


def __getattr__(name: str):
    # States load numba, which a scene and its laws do without: a scene with a mistake is refused
    # before it is loaded.
    if name in ("histories", "homogeneous"):
        return import_module(f".{name}", __name__)
    if name in _OF_STATES:
        return getattr(import_module(".states", __name__), name)
    raise AttributeError(f"module {__name__!r} has no attribute {name!r}")
