"""Learning bond forces: scikit-learn's world.  Never imported to simulate."""

from .card_text import CardText
from .chebyshev import ChebyshevRegressor
from .energy import (
    cross_validate_energy,
    energy_design,
    energy_pipeline,
    energy_surrogate_of,
    evaluate_energy,
    store_energy,
)
from .energy_form import EnergySamples
from .export import surrogate_of
from .fitting import cross_validate, domain_of
from .force_model import evaluate, force_model_of
from .levenberg_marquardt import LevenbergMarquardtRegressor
from .pipeline import bond_force_pipeline
from .sampling import BondSamples, reachable_stretches, wide_design
from .sobolev import SobolevRegressor
from .storing import store
from .target import InputAwareTargetRegressor
from .torch_regressor import TorchMLPRegressor

__all__ = [
    "BondSamples",
    "CardText",
    "ChebyshevRegressor",
    "EnergySamples",
    "InputAwareTargetRegressor",
    "LevenbergMarquardtRegressor",
    "SobolevRegressor",
    "TorchMLPRegressor",
    "bond_force_pipeline",
    "cross_validate",
    "cross_validate_energy",
    "domain_of",
    "energy_design",
    "energy_pipeline",
    "energy_surrogate_of",
    "evaluate",
    "evaluate_energy",
    "force_model_of",
    "reachable_stretches",
    "store",
    "store_energy",
    "surrogate_of",
    "wide_design",
]
