"""A body of several materials: which points are of which, what they share, and the states of the points by their own laws."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import replace

import numpy as np

from ..body import Body
from ..engine.block_arrays import BLOCK, aligned_rows
from ..engine.passes import BoundPass
from ..kernels import node_state
from ..materials import PLANES, Law
from .evaluation import Evaluation, usual_precision
from .interfaces import YIELDING, Interfaces
from .kinematics import Kinematics
from .protocol import ForceModel, InternalForce, InvalidState, Portion
from .settings import ROTATION, ROTATIONS, ForceSettings
from .surrogate_thickness import SurrogateThickness


def bind_portions(body: Body, portions: Sequence[Portion], settings: ForceSettings, rigid: np.ndarray | None = None) -> InternalForce:
    """Prepare the evaluation of a body whose points are of several materials.

    Portions of the same law and model are one material; where all are, the body is evaluated as any other.

    Parameters
    ----------
    body : Body
    portions : sequence of Portion
        Every point of the body is in one of them.
    settings : ForceSettings
        Each choice is one that every model can honour which has a use for it.
    rigid : ndarray of int, optional
        Points of no material, which move as solvers have it; what they are bonded to pulls at them.  Of a force that has an energy.

    Raises
    ------
    ValueError
        If a point is in none or in two, a model does not describe its law or cannot honour a setting, models of two kinds meet, or bonds
        are to break.
    """
    rigid = np.empty(0, dtype=np.int64) if rigid is None else rigid
    if not portions:
        raise ValueError("the rigid regions take all points of the body: nothing is left to be deformed")
    of_points = np.concatenate([rigid, *(portion.points for portion in portions)])
    if not np.array_equal(np.sort(of_points), np.arange(len(body))):
        raise ValueError("the materials must have every point of the body once")
    families = {portion.model.family: portion.model.name for portion in portions}
    if len(families) > 1:
        raise ValueError(f"the materials of a body take force models of one kind, not {' and '.join(sorted(families.values()))}")
    if settings.breakable:
        raise ValueError("bonds that break (fracture) are taken in a body of one material only: leave out fracture or materials")
    merged = _merged(portions)
    if len(merged) > 1 and (asked := [portion.model.name for portion in merged if portion.model.members]):
        raise ValueError(f"{asked[0]}: the deviation of members is told of bodies of one material; leave out #all")
    if len(merged) == 1 and not len(rigid):
        return merged[0].model.bind(body, merged[0].law, settings)
    honoured = {key for portion in merged for key in portion.model.honoured(settings.plane)}
    for portion in merged:
        # Of models beside one that has a domain, those that hold everywhere have no use for `outside`.
        honours = portion.model.honoured(settings.plane)
        spared = "outside" in honoured and "outside" not in honours
        (replace(settings, outside=None) if spared else settings).check(portion.model.name, honours)
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
    return max(usual_precision(portion.model, settings) for portion in portions)


def refuse_in_plane_strain(name: str, settings: ForceSettings) -> None:
    """Refuse several materials to a force whose pressure is that of det F at single points (theory, section 16).

    What the other material sees of a point would have to keep its volume as well as what its own sees, and no equilibrium is found; with
    one gradient for both, states that are homogeneous on either side are not in equilibrium.

    Raises
    ------
    ValueError
        Where the volume is held.
    """
    if settings.plane != "stress":
        raise ValueError(
            f"{name} takes several materials with plane=stress only: where the volume is held its pressure is wrong beside an interface; "
            "force=bond-energy takes them everywhere"
        )


class View:
    """The points of a material, and those of others that it is bonded to where and as it sees them (`Interfaces`).

    Parameters
    ----------
    kinematics : Kinematics
    own : ndarray of bool, shape (n + m,)
        Points and images of the material.
    pairs : ndarray of int
        Pairs of the body that it has a part in.

    Attributes
    ----------
    numbers : ndarray of int, shape (k,)
        Of the points and images in the body, rising.
    first, second : ndarray of uint32
        Ends of the pairs by their places in `numbers`, filled up to whole blocks.
    positions, gradients : ndarray, shapes (k, d) and (k, d d)
    """

    def __init__(self, kinematics: Kinematics, own: np.ndarray, pairs: np.ndarray) -> None:
        self._kinematics, bonds = kinematics, kinematics.body.bonds
        ends = bonds.first[pairs], bonds.second[pairs]
        seen = own.copy()
        for end in ends:
            seen[end] = True
        self.numbers, place = np.flatnonzero(seen), np.cumsum(seen) - 1
        self.first, self.second = (np.pad(place[end], (0, -len(end) % BLOCK)).astype(np.uint32) for end in ends)
        size, d = len(self.numbers), kinematics.body.dimension
        self.positions, self.gradients = aligned_rows((size, d)), aligned_rows((size, d * d))
        self._others = np.flatnonzero(~own[self.numbers])
        self._numbers_of_others = self.numbers[self._others]

    def update(self) -> None:
        """Bring positions and gradients up to date with those of the body."""
        kinematics, interfaces = self._kinematics, self._kinematics.interfaces
        np.take(kinematics.positions, self.numbers, axis=0, out=self.positions, mode="clip")
        np.take(kinematics.gradients, self.numbers, axis=0, out=self.gradients, mode="clip")
        self.positions[self._others] = interfaces.seen_positions[self._numbers_of_others]
        self.gradients[self._others] = interfaces.seen_gradients[self._numbers_of_others]


class PointStates:
    """States of the points that a material sees, by its law.

    Parameters
    ----------
    kinematics : Kinematics
        Of the body.
    law : Law
    view : View
    precision, rotation : str
        Of the records, as for `Kinematics`.

    Attributes
    ----------
    view
    volume_ratios, records : ndarray, shapes (k,) and (k, 4)
        As those of `Kinematics`; no records in space.
    kept_ratios : ndarray, shape (n + m,)
        The volume ratios last found, by the numbers of points and images: those from which the next are found.
    response, parameters, scratch
        Of the law, for passes over these points.
    surrogate_thickness : SurrogateThickness or None
        What solves the plane-stress condition in the place of the law.
    """

    def __init__(self, kinematics: Kinematics, law: Law, view: View, precision: str, rotation: str | None) -> None:
        self._kinematics, self.law, self.view = kinematics, law, view
        self.response, self.parameters, self.scratch = PLANES[kinematics.plane].response.block(law), law.parameters, kinematics.scratch
        self.volume_ratios, self.kept_ratios = np.ones(len(view.numbers)), np.ones(len(kinematics.positions))
        self.records = aligned_rows((len(view.numbers) if kinematics.body.dimension == 2 else 0, 4), precision)
        self.surrogate_thickness: SurrogateThickness | None = None
        turn = ROTATIONS[rotation or ROTATION]
        self._turn = turn and turn.bind(view.gradients, self.records, chunks=kinematics.chunks)
        self._find: BoundPass | None = None

    def find(self) -> None:
        """Bring volume ratios and records up to date with the gradients in the view.

        Raises
        ------
        InvalidState
            Where there is no state; names the point.
        """
        if self._find is None:
            self._find = self._bound()
        np.take(self.kept_ratios, self.view.numbers, out=self.volume_ratios)
        if self._find():
            self.kept_ratios[:] = 1.0
            raise InvalidState(self._kinematics.diagnose(self.law, self.view.numbers, self.view.gradients))
        self.kept_ratios[self.view.numbers] = self.volume_ratios
        if self._turn:
            self._turn()

    def _bound(self) -> BoundPass:
        law, chunks = (self.response.address, self.parameters), self._kinematics.chunks
        if self._kinematics.plane == "space":
            return node_state.volume_ratios[3].bind(self.view.gradients, self.volume_ratios, chunks=chunks)
        if self._kinematics.plane == "strain":
            return node_state.held_states.bind(self.view.gradients, self.volume_ratios, self.records, chunks=chunks)
        if self.surrogate_thickness is not None:
            return self.surrogate_thickness.bind(self.view.gradients, self.volume_ratios, *law, self.records, chunks)
        return node_state.node_states.bind(self.view.gradients, self.volume_ratios, *law, self.scratch, self.records, chunks=chunks)


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
        Which of the portions every point and image is of; their number of those that are rigid.
    states : list of PointStates
        Of every portion; `_add_states` makes them, in the order of the portions.
    """

    def __init__(self, body: Body, portions: Sequence[Portion], precision: str, correction: str, settings: ForceSettings) -> None:
        stiffest = max((portion.law for portion in portions), key=lambda law: law.shear_modulus)
        super().__init__(body, stiffest, precision, correction, settings)
        self.portions, self._rotation = portions, settings.rotation
        self.portion_of = np.full(len(body.all_points), len(portions))
        for number, portion in enumerate(portions):
            self.portion_of[portion.points] = number
        body.ghosts.fill(self.portion_of)
        moduli = np.array([*(portion.law.shear_modulus for portion in portions), np.inf])[self.portion_of]
        self._kinematics.interfaces = Interfaces(
            body, self._kinematics, self.portion_of, moduli, self.has_energy, settings.plane != "stress"
        )
        self.states: list[PointStates] = []
        n, bonds = len(body), body.bonds
        owners = np.repeat(np.arange(n), np.diff(bonds.pointers).astype(np.int64))
        around, length = moduli[bonds.neighbours], np.linalg.norm(body.all_points[bonds.neighbours] - body.points[owners], axis=1)
        # What a bond between very different moduli carries is the softer one's, and the stiffer one's points feel no more of it.
        apart = self.has_energy & (np.maximum(around, moduli[owners]) > YIELDING * np.minimum(around, moduli[owners]))
        around[apart] = moduli[owners[apart]]
        moduli = np.minimum(moduli, stiffest.shear_modulus)  # rigid points have none of their own
        around = np.minimum(around, stiffest.shear_modulus)
        weights = body.weigh(length) * body.all_volumes[bonds.neighbours]
        self._stiffness_moduli = (moduli[:n] + np.bincount(owners, weights * around, n) / np.bincount(owners, weights, n)) / 2
        self._force_scale = moduli[:n].copy()
        np.maximum.at(self._force_scale, owners, around)
        body.share.fill(self._stiffness_moduli)
        body.share.fill(self._force_scale)
        counted = body.share.counted_pairs(bonds.first)
        self._counted = np.ones(self._n_pairs, dtype=bool) if counted is None else counted

    def cells_across(self, number: int, most: int) -> float:
        """See `Interfaces.cells_across`; the number of the portions is that of what is rigid."""
        return self._kinematics.interfaces.cells_across(self.portion_of, number, most)

    def _add_states(self, pairs: np.ndarray) -> PointStates:
        """States of the points of the next portion, and of those that it sees in the given pairs."""
        number, kinematics = len(self.states), self._kinematics
        view = View(kinematics, self.portion_of == number, pairs)
        self.states.append(PointStates(kinematics, self.portions[number].law, view, self.precision, self._rotation))
        return self.states[-1]

    def form_views(self) -> None:
        """Bring gradients, and what the materials see, up to date."""
        kinematics = self._kinematics
        kinematics.form_gradients()
        kinematics.interfaces.see(kinematics.positions, kinematics.gradients)
        for states in self.states:
            states.view.update()

    def find_states(self) -> None:
        """Bring gradients, views and the points' states up to date."""
        self.form_views()
        for states in self.states:
            states.find()

    @property
    def laws(self) -> list[tuple[Law, np.ndarray]]:
        return [(portion.law, portion.points) for portion in self.portions]

    @property
    def stiffness_moduli(self) -> np.ndarray:
        return self._stiffness_moduli

    @property
    def force_scale(self) -> np.ndarray:
        return self._force_scale

    def bulk_stresses(self) -> np.ndarray:
        found, J3 = np.zeros(len(self.body)), self.volume_ratios()
        for law, points in self.laws:
            found[points] = law.volumetric(J3[points], law.parameters)[1]
        return found

    def volume_ratios(self) -> np.ndarray:
        self.find_states()
        found, n = np.ones(len(self.portion_of)), len(self.body)
        for number, states in enumerate(self.states):
            numbers = states.view.numbers
            own = self.portion_of[numbers] == number
            found[numbers[own]] = states.volume_ratios[own]
        return found[:n]

    def state_arrays(self) -> dict[str, np.ndarray]:
        return {f"volume_ratios_{number}": states.kept_ratios for number, states in enumerate(self.states)}

    @property
    def state_rows(self) -> dict[str, str]:
        return dict.fromkeys(self.state_arrays(), "images")
