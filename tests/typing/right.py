"""Right uses of every public name, which type checkers accept; `tests/test_public_types.py`
reads it and does not run it.
"""

from pathlib import Path

import numpy as np

import pdsurrogate as pds

# Scenes
names: list[str] = pds.scene_names()
scene: pds.Scene = pds.load_scene("uniaxial", ["spacing=0.1"])
scene = pds.load_scene(Path("scene.yaml"), {"spacing": 0.1})
hole = pds.shapes.Circle(center=(0.5, 0.5), radius=0.2)
bodies = [
    pds.shapes.Rectangle(size=(1.0, 2.0)),
    pds.shapes.Ellipse(center=(0.0, 0.0), semi_axes=(1.0, 2.0)),
    pds.shapes.Polygon(corners=((0.0, 0.0), (1.0, 0.0), (0.0, 1.0))),
    pds.shapes.Mesh(file=Path("part.msh")),
    pds.shapes.Box(size=(1.0, 1.0, 1.0)),
    pds.shapes.Cylinder(radius=1.0, height=2.0),
    pds.shapes.Tube(inner_radius=1.0, radius=2.0, height=1.0),
    pds.shapes.Sphere(radius=1.0),
    pds.shapes.Extrusion(section=hole, height=1.0),
]
cuts = [
    pds.shapes.Precut(begin=(0.0, 0.5), end=(0.2, 0.5)),
    pds.shapes.DiscCut(center=(0.0, 0.0, 0.0), normal=(0.0, 0.0, 1.0), radius=0.2),
    pds.shapes.ParallelogramCut(corner=(0.0, 0.0, 0.0), sides=((1.0, 0.0, 0.0), (0.0, 1.0, 0.0))),
]
left = pds.Region(edge="left")
held = pds.Prescribed(region=left, displacement=(0.0, None))
load = pds.Load(region="right", traction=(0.1, 0.0))
plate = pds.Obstacle(half_plane={"point": (0.0, 1.0), "normal": (0.0, 1.0)}, x2=-0.1)
step = pds.Step(to=1.0, dynamics=pds.StepDynamics(duration=1.0, density=1.0))
part = pds.Part(region=left, law="gent")
probe = pds.Probe(name="middle", at=(0.5, 0.5))
figure = pds.preview(scene)
figure.savefig("preview.png")

# Laws and cracks
laws = [
    pds.materials.NeoHookean(),
    pds.materials.MooneyRivlin(),
    pds.materials.Yeoh(),
    pds.materials.Ogden(),
    pds.materials.Gent(),
]
chains = [pds.materials.ArrudaBoyce(), pds.materials.FullNetwork(), pds.materials.Polyconvex()]
law_names = sorted(pds.materials.LAWS)
stretch: float = pds.critical_stretch_of(laws[0], 1.0, 0.3)
energy: float = pds.tearing_energy(laws[0], 0.1, leg_width=1.0, thickness=0.1)

# Forces
body = pds.Body.rectangle(1.0, 1.0, 0.1, 0.315)
largest: float = pds.greatest_bond_stretch(body, body.points)
settings = pds.ForceSettings(precision="float64")
models: list[pds.forces.ForceModel] = [
    pds.AnalyticBondForce(),
    pds.BondEnergyForce(),
    pds.forces.NOSBForce(),
    pds.forces.BANOSBForce(),
    pds.load_surrogate("neo-hookean@1"),
]
learned = (
    pds.forces.NetworkForce,
    pds.forces.PolynomialForce,
    pds.forces.SplineForce,
    pds.forces.EnergyNetwork,
    pds.forces.IsochoricNetwork,
    pds.forces.OwnBondForce,
)
kinds = (pds.forces.ForceSurrogate, pds.forces.EnergySurrogate)
for model in models:
    force = model.bind(body, laws[0], settings)
    try:
        force(body.points, np.empty_like(body.points))
    except (
        pds.forces.InvalidState,
        pds.forces.OutsideDomain,
        pds.forces.OutsideDomainWarning,
    ) as error:
        print(str(error))

# Runs and results
try:
    result: pds.Result = pds.simulate(scene, models[0], threads=1, folder="out", resume=False)
except (
    pds.SceneError,
    pds.ArtifactError,
    pds.SimulationFailed,
    pds.SimulationInterrupted,
) as error:
    print(str(error))
result = pds.load_result("out")
study: pds.Study = pds.Study(scene="uniaxial", parameters={"spacing": (0.1, 0.05)})
spread = pds.studies.Distribution(uniform=(0.1, 0.2))
try:
    table: pds.studies.StudyResult = pds.study("study.yaml", "runs", jobs=1)
except pds.StudyInterrupted as interrupted:
    table = interrupted.result

# Learning
samples: pds.Samples = pds.training_samples(laws[0], 500, (0.7, 2.0))
reached = pds.learning.reachable_stretches(laws[0], (0.7, 2.0))
pairs = pds.learning.algorithm_1(laws[0], 100)
regressors = (
    pds.LevenbergMarquardtRegressor((20,), "algebraic", max_iter=200, random_state=0),
    pds.TorchMLPRegressor(max_epochs=10),
    pds.learning.ChebyshevRegressor(6),
    pds.learning.SobolevRegressor(8, anchor=(0.0, 0.0), max_iter=500, n_init=2),
)
pipeline: pds.learning.InputAwareTargetRegressor = pds.surrogate_pipeline(regressors[0])
folds: list[dict] = pds.cross_validate(pipeline, samples, folds=5)
figures: dict = pds.evaluate(pipeline, laws[0])
place = pds.store(pipeline, samples, laws[0], None, "mine", None, pds.CardText("a network", folds))
surrogate = pds.learning.surrogate_of(pipeline, laws[0], samples)
card = pds.load_card("neo-hookean@1")
stored = pds.load_pipeline("neo-hookean@1")

# Identification
data = pds.load_test_data("treloar")
identified = pds.fit_to_tests(pds.identification.LawRegressor("ogden", n_terms=2), data)
free = pds.identification.EnergyRegressor(margin=0.1, bulk_modulus=1000.0)

# Checks of models and laws of one's own
known: tuple[pds.testing.Property, ...] = (
    *pds.testing.FORCE_MODEL_PROPERTIES,
    *pds.testing.LAW_PROPERTIES,
)
of_model: tuple[pds.testing.Finding, ...] = pds.testing.check_force_model(
    "analytic", tolerances={"angular_momentum": 0.1}
)
of_law = pds.testing.check_law(laws[0], properties=["derivatives"])

calibrated = pds.SceneRegressor("hole", "gent").fit(
    [[1.0, 0.0, 0.0, 0.0]], [3.0], standard_deviation=[0.01]
)
limit: float = float(calibrated.standard_errors_[1])
uncertain: pds.materials.LawCovariance = calibrated.law_covariance()
errors: dict[str, float] = result.standard_errors(["nominal_stress"], uncertain)

with pds.progress.listening(lambda stage, done, total, **numbers: None):
    pds.scene_names()
