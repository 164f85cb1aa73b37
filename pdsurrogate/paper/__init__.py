"""What only the reproduction of the paper needs, and nothing else asks for: its features, its rotation of a horizon, its samples.

The first two are choices by name, `features="paper"` of a surrogate and `rotation="convected"` of a scene; the third is
`pdsurrogate.algorithm_1`.  The surrogate learnt with them is the artefact ``neo-hookean-paper``; ``pipelines/reproduce_paper.py`` makes the
paper's tables.
"""

from . import features  # enters the paper's set in the table of feature sets

__all__ = ["features"]
