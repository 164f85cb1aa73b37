"""Scenes: descriptions of simulations, written by a user or built in."""

from .loading import Load, Prescribed, Probe, Step, StepDynamics
from .model import Dynamics, Fracture, Grip, Hold, MaterialSpec, Part, SolverSpec, Units
from .obstacles import Obstacle
from .problems import SceneError
from .reading import load_scene, scene_names
from .regions import Ball, Disc, HalfPlane, HalfSpace, Region
from .scene import Scene
from .shapes import Circle, Ellipse, Mesh, Polygon, Precut, Rectangle
from .solids import Box, Cylinder, DiscCut, Extrusion, ParallelogramCut, Sphere, Tube
