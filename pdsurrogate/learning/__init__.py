"""Learning bond forces: scikit-learn's world.  Never imported to simulate."""

from .export import network_force
from .fitting import cross_validate, domain_of, store
from .levenberg_marquardt import LevenbergMarquardtRegressor
from .pipeline import bond_force_pipeline
from .sampling import BondSamples, algorithm_1, wide_design
from .target import InputAwareTargetRegressor
from .torch_regressor import TorchMLPRegressor
from .validation import evaluate

__all__ = [
    "BondSamples",
    "InputAwareTargetRegressor",
    "LevenbergMarquardtRegressor",
    "TorchMLPRegressor",
    "algorithm_1",
    "bond_force_pipeline",
    "cross_validate",
    "domain_of",
    "evaluate",
    "network_force",
    "store",
    "wide_design",
]
