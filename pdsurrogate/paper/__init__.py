"""Parts that only the reproduction of the paper needs: its features and its rotation of a horizon.

Both are selected by name: `features="paper"` of a surrogate and `rotation="convected"` of a scene.
The paper's samples come from `pdsurrogate.learning.algorithm_1`, the surrogate learned from these
samples, features and rotation is the artifact ``neo-hookean-paper``, and the script
``pipelines/reproduce_paper.py`` makes the paper's tables.
"""

from . import features  # registers the paper's feature set

__all__ = ["features"]
