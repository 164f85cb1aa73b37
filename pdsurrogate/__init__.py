"""pdsurrogate: learnt bond forces of rubber-like materials, and a peridynamic solver that runs on them."""

from importlib import import_module

__version__ = "0.1.0"

# Names are imported where they are first used: a simulation loads no scikit-learn, and training no solver.
_HOMES = {
    "algorithm_1": "learning",
    "AnalyticBondForce": "forces",
    "ArtifactError": "artifacts",
    "Body": "body",
    "bond_force_pipeline": "learning",
    "BondAssociatedForce": "forces",
    "BondEnergyForce": "forces",
    "BondSamples": "learning",
    "ChebyshevRegressor": "learning",
    "CorrespondenceForce": "forces",
    "cross_validate": "learning",
    "cross_validate_energy": "learning",
    "energy_design": "learning",
    "energy_pipeline": "learning",
    "energy_surrogate_of": "learning",
    "EnergyNetwork": "forces",
    "EnergySamples": "learning",
    "EnergySurrogate": "forces",
    "evaluate": "learning",
    "evaluate_energy": "learning",
    "ForceModel": "forces",
    "ForceSettings": "forces",
    "ForceSurrogate": "forces",
    "InputAwareTargetRegressor": "learning",
    "LevenbergMarquardtRegressor": "learning",
    "load_card": "artifacts",
    "load_pipeline": "artifacts",
    "load_scene": "scenes",
    "load_surrogate": "artifacts",
    "NeoHookean": "materials",
    "NetworkForce": "forces",
    "PolynomialForce": "forces",
    "Result": "results",
    "Scene": "scenes",
    "scene_names": "scenes",
    "SceneError": "scenes",
    "simulate": "simulation",
    "SimulationFailed": "simulation",
    "SobolevRegressor": "learning",
    "store": "learning",
    "store_energy": "learning",
    "TorchMLPRegressor": "learning",
    "TorchSobolevRegressor": "learning",
    "wide_design": "learning",
}

__all__ = sorted(_HOMES)


def __getattr__(name: str):
    if name not in _HOMES:
        raise AttributeError(f"module {__name__!r} has no attribute {name!r}")
    return getattr(import_module(f".{_HOMES[name]}", __name__), name)


def __dir__() -> list[str]:
    return [*globals(), *__all__]
