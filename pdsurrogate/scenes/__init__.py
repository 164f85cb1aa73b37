"""Scenes: what is simulated, described by a user or built in."""

from .loading import Load, Prescribed, Probe, Step, StepDynamics
from .model import Dynamics, Fracture, Grip, Hold, MaterialSpec, Part, Scene, SolverSpec, Units
from .problems import SceneError
from .reading import load_scene, scene_names
from .regions import Disc, HalfPlane, Region
from .shapes import Circle, Ellipse, Mesh, Polygon, Precut, Rectangle

__all__ = [
    "Circle",
    "Disc",
    "Dynamics",
    "Ellipse",
    "Fracture",
    "Grip",
    "HalfPlane",
    "Hold",
    "Load",
    "MaterialSpec",
    "Mesh",
    "Part",
    "Polygon",
    "Precut",
    "Prescribed",
    "Probe",
    "Rectangle",
    "Region",
    "Scene",
    "SceneError",
    "SolverSpec",
    "Step",
    "StepDynamics",
    "Units",
    "load_scene",
    "scene_names",
]
