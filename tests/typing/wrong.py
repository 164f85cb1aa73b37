"""Wrong uses of public functions: a type checker has to find an error in every line that begins
with `pds.`.
"""

import pdsurrogate as pds

pds.no_such_name()
pds.load_scene()
pds.load_scene(3)
pds.scene_names("uniaxial")
pds.simulate(3)
pds.simulate("uniaxial", threads="two")
pds.simulate("uniaxial", None, 2)
pds.simulate("uniaxial", no_such_option=True)
pds.load_surrogate(1)
pds.load_card(None)
pds.load_result(1.5)
pds.load_test_data(2)
pds.preview("uniaxial")
pds.critical_stretch_of("neo-hookean", 1.0, 0.3)
pds.study("study.yaml")
pds.study("study.yaml", "runs", jobs="all")
pds.training_samples("gent")
pds.LevenbergMarquardtRegressor(max_iter="many")
pds.TorchMLPRegressor(learning_rate="fast")
pds.identification.LawRegressor(law=3)
pds.identification.EnergyRegressor(margin="few")
