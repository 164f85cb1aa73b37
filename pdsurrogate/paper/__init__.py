"""What only the reproduction of the paper needs, and nothing else asks for: its features and its rotation of a horizon.

Both are choices by name, `features="paper"` of a surrogate and `rotation="convected"` of a scene.  The surrogate that learnt them is the
artefact ``neo-hookean-paper``; the paper's tables are made by ``pipelines/reproduce_paper.py``.
"""

from . import features  # enters the paper's set in the table of feature sets

__all__ = ["features"]
