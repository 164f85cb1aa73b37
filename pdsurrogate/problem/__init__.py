"""Compilation of a scene into the problem that a run solves: boundary conditions, loads, stages
and the material of every point.
"""

from .problem import Problem, compile_scene
from .program import Stage
