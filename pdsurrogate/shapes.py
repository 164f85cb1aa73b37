"""Shapes of bodies, of their parts and of cuts, which a scene is made of."""

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
