"""Scenes: what is simulated, described by a user or built in."""

from .model import Dynamics, Fracture, Grip, Hold, MaterialSpec, Scene, SolverSpec, Units
from .problems import SceneError
from .reading import load_scene, scene_names
from .shapes import Circle, Ellipse, Mesh, Polygon, Precut, Rectangle

__all__ = [
    "Circle",
    "Dynamics",
    "Ellipse",
    "Fracture",
    "Grip",
    "Hold",
    "MaterialSpec",
    "Mesh",
    "Polygon",
    "Precut",
    "Rectangle",
    "Scene",
    "SceneError",
    "SolverSpec",
    "Units",
    "load_scene",
    "scene_names",
]
