"""Export of energies to other programs: source files for FElupe, Abaqus (UMAT), FEniCS (UFL) and
C.
"""

from .source import Source, source_of_artifact, source_of_law
from .writing import TARGETS, exported, file_name, identifier_of
