"""Bodies in the reference state: points with volumes, their horizons, the bonds between them,
and ghosts beyond reflection planes.
"""

from .body import Body, Round
from .bonds import MOST_BONDS, Bonds
from .cell_mesh import CellMesh
from .division import HALO, divided, rows_of
from .ghosts import Ghosts, HeldBoundary, Mirror, ReflectionPlane
from .grid import MOST_POINTS, Cells, grid
from .local_fit import fields_at
from .surface import Faces, Following, Surface
