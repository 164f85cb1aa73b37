"""Learning bond forces: scikit-learn's world.  Never imported to simulate."""

from .chebyshev import ChebyshevRegressor
from .export import surrogate_of
from .fitting import cross_validate, domain_of, store
from .levenberg_marquardt import LevenbergMarquardtRegressor
from .pipeline import bond_force_pipeline
from .sampling import BondSamples, algorithm_1, reachable_stretches, wide_design
from .target import InputAwareTargetRegressor
from .torch_regressor import TorchMLPRegressor
from .validation import evaluate

__all__ = [
    "BondSamples",
    "ChebyshevRegressor",
    "InputAwareTargetRegressor",
    "LevenbergMarquardtRegressor",
    "TorchMLPRegressor",
    "algorithm_1",
    "bond_force_pipeline",
    "cross_validate",
    "domain_of",
    "evaluate",
    "reachable_stretches",
    "store",
    "surrogate_of",
    "wide_design",
]
