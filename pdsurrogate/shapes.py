"""Public names of the shapes of bodies, holes and cuts (lines or surfaces that no bond crosses)
in scenes.
"""

from .scenes import (
    Box,
    Circle,
    Cylinder,
    DiscCut,
    Ellipse,
    Extrusion,
    Mesh,
    ParallelogramCut,
    Polygon,
    Precut,
    Rectangle,
    Sphere,
    Tube,
)

__all__ = ["Circle", "Ellipse", "Mesh", "Polygon", "Precut", "Rectangle"]
__all__ += ["Box", "Cylinder", "DiscCut", "Extrusion", "ParallelogramCut", "Sphere", "Tube"]
