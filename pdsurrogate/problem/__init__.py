"""Compilation of a scene into the problem that a run solves: conditions, loads, stages and materials of its points."""

from .problem import Problem, compile_scene
from .programme import Inertia, Stage

__all__ = ["Inertia", "Problem", "Stage", "compile_scene"]
