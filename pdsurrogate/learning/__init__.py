"""Learning bond forces and energies with scikit-learn; a simulation never imports this room."""

from .algorithm_1 import algorithm_1
from .card_text import CardText
from .chebyshev import ChebyshevRegressor
from .fitting import cross_validate, evaluate
from .levenberg_marquardt import LevenbergMarquardtRegressor
from .sobolev import SobolevRegressor
from .storing import store
from .surrogates import force_model_of, reachable_stretches, surrogate_of, surrogate_pipeline, training_samples
from .target import InputAwareTargetRegressor
from .targets import Samples
from .torch_regressor import TorchMLPRegressor

__all__ = [
    "CardText",
    "ChebyshevRegressor",
    "InputAwareTargetRegressor",
    "LevenbergMarquardtRegressor",
    "Samples",
    "SobolevRegressor",
    "TorchMLPRegressor",
    "algorithm_1",
    "cross_validate",
    "evaluate",
    "force_model_of",
    "reachable_stretches",
    "store",
    "surrogate_of",
    "surrogate_pipeline",
    "training_samples",
]
