"""pdsurrogate: learned bond forces of rubber-like materials, and a peridynamic solver that runs
on them.
"""

import logging
from importlib import import_module

__version__ = "0.2.0"

# The package logs only if a program enables it: `logging.getLogger("pdsurrogate").setLevel("INFO")`
# with a handler, or `-v`.
logging.getLogger(__name__).addHandler(logging.NullHandler())

# Names are imported where they are first used: a simulation loads no scikit-learn, and training no
# solver.
_NAMES = {
    "artifacts": "ArtifactError load_card load_pipeline load_surrogate",
    "body": "Body",
    "calibration": "SceneRegressor",
    "forces": "AnalyticBondForce BondEnergyForce ForceSettings",
    "identification": "fit_to_tests load_test_data",
    "learning": (
        "CardText LevenbergMarquardtRegressor Samples TorchMLPRegressor cross_validate evaluate"
        " store surrogate_pipeline training_samples"
    ),
    "materials.tearing": "tearing_energy",
    "problem.fracture": "critical_stretch_of",
    "results": "Result load_result",
    "run.damage": "greatest_bond_stretch",
    "run.preview": "preview",
    "run.simulate": "SimulationFailed SimulationInterrupted simulate",
    "scenes": (
        "Load Obstacle Part Prescribed Probe Region Scene SceneError Step StepDynamics load_scene"
        " scene_names"
    ),
    "studies": "Study StudyInterrupted study",
}

# Public names that are found in a subpackage or module alone, as `pdsurrogate.shapes.Rectangle`.
_IN_ROOMS = {
    "forces": (
        "BANOSBForce EnergyNetwork EnergySurrogate ForceModel ForceSurrogate InvalidState"
        " IsochoricNetwork NOSBForce NetworkForce OutsideDomain OutsideDomainWarning OwnBondForce"
        " PolynomialForce SplineForce"
    ),
    "identification": "EnergyRegressor LawRegressor",
    "learning": (
        "ChebyshevRegressor InputAwareTargetRegressor SobolevRegressor algorithm_1"
        " reachable_stretches surrogate_of"
    ),
    "materials": (
        "LAWS ArrudaBoyce FullNetwork Gent LawCovariance MooneyRivlin NeoHookean Ogden Polyconvex"
        " Yeoh"
    ),
    "progress": "listening",
    "shapes": (
        "Box Circle Cylinder DiscCut Ellipse Extrusion Mesh ParallelogramCut Polygon Precut"
        " Rectangle Sphere Tube"
    ),
    "studies": "Distribution StudyResult",
    "testing": "Finding Property check_force_model check_law",
}

_HOMES = {name: home for home, names in _NAMES.items() for name in names.split()}
_ROOMS = {"ranks", *_IN_ROOMS, *(home.partition(".")[0] for home in _NAMES)}

__all__ = sorted(_HOMES)


def __getattr__(name: str):
    if name in _ROOMS:
        return import_module(f".{name}", __name__)
    if name in _HOMES:
        return getattr(import_module(f".{_HOMES[name]}", __name__), name)
    where = [
        f"; it is {__name__}.{room}.{name}"
        for room, names in _IN_ROOMS.items()
        if name in names.split()
    ]
    raise AttributeError(f"module {__name__!r} has no attribute {name!r}{''.join(where)}")


def __dir__() -> list[str]:
    return [*globals(), *_ROOMS, *__all__]
