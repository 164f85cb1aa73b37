"""Learning of bond forces and energies with scikit-learn; a simulation never imports this
package.
"""

from .bond_force import algorithm_1
from .chebyshev import ChebyshevRegressor
from .fitting import (
    cross_validate,
    evaluate,
    force_model_of,
    reachable_stretches,
    surrogate_of,
    surrogate_pipeline,
    training_samples,
)
from .levenberg_marquardt import LevenbergMarquardtRegressor
from .sobolev import SobolevRegressor
from .storing import CardText, store
from .target import InputAwareTargetRegressor, Samples
from .torch_regressor import TorchMLPRegressor

__all__ = [
    "ChebyshevRegressor",
    "InputAwareTargetRegressor",
    "SobolevRegressor",
    "algorithm_1",
    "reachable_stretches",
    "surrogate_of",
]
