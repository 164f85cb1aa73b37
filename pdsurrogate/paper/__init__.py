"""What only the reproduction of the paper needs, and nothing else asks for: its features and its rotation of a horizon.

Both are choices by name, `features="paper"` of a surrogate and `rotation="convected"` of a scene.  The paper's samples are
`pdsurrogate.algorithm_1`, the surrogate learnt with all of it is the artefact ``neo-hookean-paper``, and
``pipelines/reproduce_paper.py`` makes the paper's tables.
"""

from . import features  # enters the paper's set in the table of feature sets

__all__ = ["features"]
