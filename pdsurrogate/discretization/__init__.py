"""Discretization of a scene (the input of a simulation): the points of its body, and its
boundary.
"""

from .material import contained
from .planes import held_at_points
from .points import discretize
from .sections import grip_areas
from .separation import cuts_of
from .size import check_size, estimated_points, memory_here
from .surfaces import surface_of
