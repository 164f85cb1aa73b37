"""From the description of a scene to the points of its body, and to its boundary."""

from .points import discretise, grip_areas
from .surfaces import surface_of

__all__ = ["discretise", "grip_areas", "surface_of"]
