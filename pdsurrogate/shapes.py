"""Public names of the shapes of bodies, of holes and of cuts in scenes."""

from .scenes import Box, Circle, Cylinder, DiscCut, Ellipse, Extrusion, Mesh, ParallelogramCut, Polygon, Precut, Rectangle, Sphere, Tube

__all__ = [
    "Box",
    "Circle",
    "Cylinder",
    "DiscCut",
    "Ellipse",
    "Extrusion",
    "Mesh",
    "ParallelogramCut",
    "Polygon",
    "Precut",
    "Rectangle",
    "Sphere",
    "Tube",
]
