"""Discretization of a scene (the input of a simulation): the points of its body, and its
boundary.
"""

from .planes import held_at_points
from .points import contained, cuts_of, discretize, grip_areas
from .size import check_size, estimated_points, memory_here
from .surfaces import surface_of
