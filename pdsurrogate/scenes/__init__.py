"""Scenes: what is simulated, described by a user or built in."""

from .model import Grip, Hold, MaterialSpec, Rectangle, Scene, SolverSpec, Units
from .reading import SceneError, load_scene, scene_names

__all__ = ["Grip", "Hold", "MaterialSpec", "Rectangle", "Scene", "SceneError", "SolverSpec", "Units", "load_scene", "scene_names"]
