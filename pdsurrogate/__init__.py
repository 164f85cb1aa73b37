"""pdsurrogate: learnt bond forces of rubber-like materials, and a peridynamic solver that runs on them."""

import logging
from importlib import import_module

__version__ = "0.1.0"

# Silent unless the program that uses it wants to hear: `logging.getLogger("pdsurrogate").setLevel("INFO")` with a handler, or `-v`.
logging.getLogger(__name__).addHandler(logging.NullHandler())

# Names are imported where they are first used: a simulation loads no scikit-learn, and training no solver.
_HOMES = {
    "AnalyticBondForce": "forces",
    "ArrudaBoyce": "materials",
    "ArtifactError": "artifacts",
    "Body": "body",
    "BANOSBForce": "forces",
    "BondEnergyForce": "forces",
    "CardText": "learning",
    "Box": "scenes",
    "ChebyshevRegressor": "learning",
    "Circle": "scenes",
    "Cylinder": "scenes",
    "DiscCut": "scenes",
    "Distribution": "studies",
    "NOSBForce": "forces",
    "Ellipse": "scenes",
    "EnergyNetwork": "forces",
    "EnergyRegressor": "identification",
    "EnergySurrogate": "forces",
    "Extrusion": "scenes",
    "ForceModel": "forces",
    "ForceSettings": "forces",
    "ForceSurrogate": "forces",
    "FullNetwork": "materials",
    "Gent": "materials",
    "InputAwareTargetRegressor": "learning",
    "IsochoricNetwork": "forces",
    "LAWS": "materials",
    "LawRegressor": "identification",
    "LevenbergMarquardtRegressor": "learning",
    "Load": "scenes",
    "Mesh": "scenes",
    "MooneyRivlin": "materials",
    "NeoHookean": "materials",
    "NetworkForce": "forces",
    "Ogden": "materials",
    "OwnBondForce": "forces",
    "ParallelogramCut": "scenes",
    "Part": "scenes",
    "Polyconvex": "materials",
    "Polygon": "scenes",
    "PolynomialForce": "forces",
    "Precut": "scenes",
    "Prescribed": "scenes",
    "Probe": "scenes",
    "Rectangle": "scenes",
    "Region": "scenes",
    "Result": "results",
    "Scene": "scenes",
    "Samples": "learning",
    "SceneError": "scenes",
    "SimulationFailed": "run.simulate",
    "SimulationInterrupted": "run.simulate",
    "SobolevRegressor": "learning",
    "Sphere": "scenes",
    "SplineForce": "forces",
    "Step": "scenes",
    "StepDynamics": "scenes",
    "Study": "studies",
    "StudyInterrupted": "studies",
    "StudyResult": "studies",
    "TorchMLPRegressor": "learning",
    "Tube": "scenes",
    "Yeoh": "materials",
    "algorithm_1": "learning",
    "committee": "identification",
    "committee_spread": "identification",
    "critical_stretch_of": "problem.fracture",
    "cross_validate": "learning",
    "evaluate": "learning",
    "fit_to_tests": "identification",
    "greatest_bond_stretch": "run.damage",
    "load_card": "artifacts",
    "load_pipeline": "artifacts",
    "load_result": "results",
    "load_scene": "scenes",
    "load_surrogate": "artifacts",
    "load_test_data": "identification",
    "preview": "run.preview",
    "reachable_stretches": "learning",
    "scene_names": "scenes",
    "simulate": "run.simulate",
    "store": "learning",
    "study": "studies",
    "surrogate_of": "learning",
    "surrogate_pipeline": "learning",
    "tearing_energy": "problem.fracture",
    "training_samples": "learning",
}

_ROOMS = {"ranks", *(home.split(".")[0] for home in _HOMES.values())}

__all__ = sorted(_HOMES)


def __getattr__(name: str):
    if name in _ROOMS:
        return import_module(f".{name}", __name__)
    if name not in _HOMES:
        raise AttributeError(f"module {__name__!r} has no attribute {name!r}")
    return getattr(import_module(f".{_HOMES[name]}", __name__), name)


def __dir__() -> list[str]:
    return [*globals(), *__all__]
