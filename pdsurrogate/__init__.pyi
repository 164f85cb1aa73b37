"""The types of the names that `pdsurrogate/__init__.py` loads on first use.

`tests/test_public_types.py` holds the two together.
"""

from . import artifacts as artifacts
from . import body as body
from . import calibration as calibration
from . import forces as forces
from . import identification as identification
from . import learning as learning
from . import materials as materials
from . import problem as problem
from . import progress as progress
from . import ranks as ranks
from . import results as results
from . import run as run
from . import scenes as scenes
from . import shapes as shapes
from . import studies as studies
from . import testing as testing
from .artifacts import ArtifactError as ArtifactError
from .artifacts import load_card as load_card
from .artifacts import load_pipeline as load_pipeline
from .artifacts import load_surrogate as load_surrogate
from .body import Body as Body
from .calibration import SceneRegressor as SceneRegressor
from .forces import AnalyticBondForce as AnalyticBondForce
from .forces import BondEnergyForce as BondEnergyForce
from .forces import ForceSettings as ForceSettings
from .identification import fit_to_tests as fit_to_tests
from .identification import load_test_data as load_test_data
from .learning import CardText as CardText
from .learning import LevenbergMarquardtRegressor as LevenbergMarquardtRegressor
from .learning import Samples as Samples
from .learning import TorchMLPRegressor as TorchMLPRegressor
from .learning import cross_validate as cross_validate
from .learning import evaluate as evaluate
from .learning import store as store
from .learning import surrogate_pipeline as surrogate_pipeline
from .learning import training_samples as training_samples
from .materials.tearing import tearing_energy as tearing_energy
from .problem.fracture import critical_stretch_of as critical_stretch_of
from .results import Result as Result
from .results import load_result as load_result
from .run.damage import greatest_bond_stretch as greatest_bond_stretch
from .run.preview import preview as preview
from .run.simulate import SimulationFailed as SimulationFailed
from .run.simulate import SimulationInterrupted as SimulationInterrupted
from .run.simulate import simulate as simulate
from .scenes import Load as Load
from .scenes import Obstacle as Obstacle
from .scenes import Part as Part
from .scenes import Prescribed as Prescribed
from .scenes import Probe as Probe
from .scenes import Region as Region
from .scenes import Scene as Scene
from .scenes import SceneError as SceneError
from .scenes import Step as Step
from .scenes import StepDynamics as StepDynamics
from .scenes import load_scene as load_scene
from .scenes import scene_names as scene_names
from .studies import Study as Study
from .studies import StudyInterrupted as StudyInterrupted
from .studies import study as study

__version__: str
