"""A body of several materials: which points are of which, what they share, and the states of the points by their own laws."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import replace

import numpy as np

from ..body import Body
from ..kernels import node_state
from ..kernels.block_arrays import BLOCK, aligned_rows
from ..kernels.passes import BoundPass
from ..materials import Law, plane_stress
from .evaluation import Evaluation
from .kinematics import Kinematics
from .protocol import ForceModel, InternalForce, InvalidState, Portion
from .settings import ROTATION, ROTATIONS, ForceSettings
from .surrogate_thickness import SurrogateThickness


def bind_portions(body: Body, portions: Sequence[Portion], settings: ForceSettings) -> InternalForce:
    """Prepare the evaluation of a body whose points are of several materials.

    Portions of the same law and model are one material; where all are, the body is evaluated as any other.

    Parameters
    ----------
    body : Body
    portions : sequence of Portion
        Every point of the body is in one of them.
    settings : ForceSettings
        Each choice is one that every model can honour which has a use for it.

    Raises
    ------
    ValueError
        If a point is in none or in two, a model does not describe its law or cannot honour a setting, models of two kinds meet, or bonds
        are to break.
    """
    of_points = np.concatenate([portion.points for portion in portions])
    if not np.array_equal(np.sort(of_points), np.arange(len(body))):
        raise ValueError("the materials must have every point of the body once")
    families = {portion.model.family: portion.model.name for portion in portions}
    if len(families) > 1:
        raise ValueError(f"the materials of a body take force models of one kind, not {' and '.join(sorted(families.values()))}")
    if settings.breakable:
        raise ValueError("bonds that break (fracture) are taken in a body of one material only: leave out fracture or materials")
    merged = _merged(portions)
    if len(merged) == 1:
        return merged[0].model.bind(body, merged[0].law, settings)
    honoured = {key for portion in merged for key in portion.model.honours}
    for portion in merged:
        # Of models beside one that has a domain, those that hold everywhere have no use for `outside`.
        spared = "outside" in honoured and "outside" not in portion.model.honours
        (replace(settings, outside=None) if spared else settings).check(portion.model.name, portion.model.honours)
        portion.model.check_material(portion.law)
    return merged[0].model.evaluation_of_portions(body, merged, settings)


def _merged(portions: Sequence[Portion]) -> list[Portion]:
    """Portions of different laws or models, each with all points that are of them."""
    found: list[Portion] = []
    for portion in portions:
        same = next((n for n, other in enumerate(found) if other.law == portion.law and _same(other.model, portion.model)), None)
        if same is None:
            found.append(portion)
        else:
            found[same] = replace(portion, points=np.sort(np.concatenate([found[same].points, portion.points])))
    return found


def _same(model: ForceModel, other: ForceModel) -> bool:
    """Whether two models are one: the same object, or two of those that have learnt nothing."""
    return model is other or (type(model) is type(other) and model.name == other.name and not model.payload() and not other.payload())


def common_precision(portions: Sequence[Portion], settings: ForceSettings) -> str:
    """The precision asked for, or else the greatest of the models' own."""
    return settings.precision or max(portion.model.default_precision for portion in portions)


def padded(values: np.ndarray) -> np.ndarray:
    """Ends of pairs filled up with zeros to a whole number of blocks."""
    return np.pad(values, (0, -len(values) % BLOCK)).astype(np.uint32)


class PointStates:
    """States of some points and images of a body by the law of one material.

    Parameters
    ----------
    kinematics : Kinematics
        Of the body, whose deformation gradients are read.
    law : Law
    numbers : ndarray of int
        Of the points and images.
    precision, rotation : str
        Of the records, as for `Kinematics`.

    Attributes
    ----------
    numbers
    gradients, volume_ratios, records : ndarray, shapes (k, 4), (k,) and (k, 4)
        As those of `Kinematics`, of these points.
    response, parameters, scratch
        Of the law, for passes over these points.
    surrogate_thickness : SurrogateThickness or None
        What solves the plane-stress condition in the place of the law.
    """

    def __init__(self, kinematics: Kinematics, law: Law, numbers: np.ndarray, precision: str, rotation: str | None) -> None:
        self._kinematics, self.law, self.numbers = kinematics, law, numbers
        self.response, self.parameters, self.scratch = plane_stress.response.block(law), law.parameters, kinematics.scratch
        self.gradients = aligned_rows((len(numbers), 4))
        self.volume_ratios = np.ones(len(numbers))
        self.records = aligned_rows((len(numbers), 4), precision)
        self.surrogate_thickness: SurrogateThickness | None = None
        turn = ROTATIONS[rotation or ROTATION]
        self._turn = turn and turn.bind(self.gradients, self.records, chunks=kinematics.chunks)
        self._find: BoundPass | None = None

    def find(self) -> None:
        """Bring volume ratios and records up to date with the body's deformation gradients.

        Raises
        ------
        InvalidState
            Where there is no state; names the point.
        """
        np.take(self._kinematics.gradients, self.numbers, axis=0, out=self.gradients, mode="clip")
        if self._find is None:
            self._find = self._bound()
        if self._find():
            self.volume_ratios[:] = 1.0
            raise InvalidState(self._kinematics.diagnose(self.law, self.numbers))
        if self._turn:
            self._turn()

    def _bound(self) -> BoundPass:
        law, chunks = (self.response.address, self.parameters), self._kinematics.chunks
        if self.surrogate_thickness is not None:
            return self.surrogate_thickness.bind(self.gradients, self.volume_ratios, *law, self.records, chunks)
        return node_state.node_states.bind(self.gradients, self.volume_ratios, *law, self.scratch, self.records, chunks=chunks)


class EvaluationOfPortions(Evaluation):
    """A force on a body of several materials.

    The deformation gradients and shape tensors of the points are those of the body, whatever it is made of.  What follows from them
    follows for every material by its own law and model, on the points and bonds that it has a part in.

    Parameters
    ----------
    body : Body
    portions : sequence of Portion
    precision, correction : str
        See `InternalForce`.
    settings : ForceSettings

    Attributes
    ----------
    portions
    portion_of : ndarray of int, shape (n + m,)
        Which of the portions every point and image is of.
    states : list of PointStates
        Of every portion; `_add_states` makes them.
    """

    def __init__(self, body: Body, portions: Sequence[Portion], precision: str, correction: str, settings: ForceSettings) -> None:
        stiffest = max((portion.law for portion in portions), key=lambda law: law.shear_modulus)
        super().__init__(body, stiffest, precision, correction, settings)
        self.portions, self._rotation = portions, settings.rotation
        self.portion_of = np.empty(len(body.all_points), dtype=np.int64)
        for number, portion in enumerate(portions):
            self.portion_of[portion.points] = number
        body.ghosts.fill(self.portion_of)
        self.states: list[PointStates] = []
        moduli = np.array([portion.law.shear_modulus for portion in portions])[self.portion_of]
        self._shear_moduli, self._force_scale = moduli[: len(body)], moduli.copy()
        bonds = body.bonds
        for ends, others in ((bonds.first, bonds.second), (bonds.second, bonds.first)):
            np.maximum.at(self._force_scale, ends, moduli[others])
        self._force_scale = self._force_scale[: len(body)]

    def _add_states(self, portion: Portion, numbers: np.ndarray) -> PointStates:
        """States of points and images by the law of a portion."""
        self.states.append(PointStates(self._kinematics, portion.law, numbers, self.precision, self._rotation))
        return self.states[-1]

    def find_states(self) -> None:
        """Bring gradients and the points' states up to date."""
        self._kinematics.form_gradients()
        for states in self.states:
            states.find()

    @property
    def laws(self) -> list[tuple[Law, np.ndarray]]:
        return [(portion.law, portion.points) for portion in self.portions]

    @property
    def shear_moduli(self) -> np.ndarray:
        return self._shear_moduli

    @property
    def force_scale(self) -> np.ndarray:
        return self._force_scale

    def volume_ratios(self) -> np.ndarray:
        self.find_states()
        found, n = np.empty(len(self.portion_of)), len(self.body)
        for number, states in enumerate(self.states):
            own = self.portion_of[states.numbers] == number
            found[states.numbers[own]] = states.volume_ratios[own]
        return found[:n]

    def state_arrays(self) -> dict[str, np.ndarray]:
        return {f"volume_ratios_{number}": states.volume_ratios for number, states in enumerate(self.states)}
