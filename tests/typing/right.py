"""Right uses of public functions, which type checkers accept."""

from pathlib import Path

import pdsurrogate as pds

names: list[str] = pds.scene_names()
scene: pds.Scene = pds.load_scene("uniaxial", ["spacing=0.1"])
scene = pds.load_scene(Path("scene.yaml"), {"spacing": 0.1})
model: pds.ForceModel = pds.load_surrogate("neo-hookean@1")
result: pds.Result = pds.simulate(scene, model, threads=1, folder="out", resume=False)
result = pds.load_result("out")
figure = pds.preview(scene)
figure.savefig("preview.png")
law = pds.NeoHookean()
stretch: float = pds.critical_stretch_of(law, 1.0, 0.3)
card = pds.load_card("neo-hookean@1")
data = pds.load_test_data("treloar")
table: pds.StudyResult = pds.study("study.yaml", "runs", jobs=1)
samples: pds.Samples = pds.training_samples(law, 500, (0.7, 2.0))
network = pds.LevenbergMarquardtRegressor((20,), "algebraic", max_iter=200, random_state=0)
energy = pds.SobolevRegressor(8, anchor=(0.0, 0.0), max_iter=500, n_init=2)
pipeline: pds.InputAwareTargetRegressor = pds.surrogate_pipeline(network)
identified = pds.LawRegressor("ogden", n_terms=2)
free = pds.EnergyRegressor(max_terms=4, bulk_modulus=1000.0)
try:
    pds.simulate("uniaxial")
except (pds.SceneError, pds.SimulationFailed, pds.SimulationInterrupted) as error:
    print(str(error))
