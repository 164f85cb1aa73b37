"""Base class of force models, their training domain, and the functions that bind models to the points of a body."""

from abc import ABC, abstractmethod
from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass, field, replace
from typing import Self

import numpy as np

from ..body import Body
from ..engine.block_arrays import BLOCK, SCRATCH_ROWS, aligned_rows
from ..engine.compile import call_block, kernel
from ..html_tables import html_facts
from ..kernels.bond_force import LEAST_NORMAL_STRETCH
from ..materials import Law
from ..materials.law import checked_law
from .internal_force import InternalForce
from .material_points import MaterialPoints
from .settings import ForceSettings
from .term import Term


@dataclass(frozen=True)
class Domain:
    """Bounds of the states on which a surrogate was trained.

    Attributes
    ----------
    least_stretch, greatest_stretch : float
        Bounds of both principal stretches in the plane; those of a bond follow from its stretch, its rotation and J (theory (10)).
    least_bulk, greatest_bulk : float
        Bounds of the squared volume ratio, J3^2 = J^2 C33.
    hull : tuple of tuple of float, optional
        Hull of the test data of an energy: half-planes (n1, n2, d) in the logarithms of the two greater of three principal stretches of
        product 1, the greatest first, n1 log l1 + n2 log l2 <= d.
    """

    least_stretch: float
    greatest_stretch: float
    least_bulk: float
    greatest_bulk: float
    hull: tuple[tuple[float, float, float], ...] | None = field(default=None, repr=False)

    @property
    def interior(self) -> Self:
        """Inner part of the domain, where the surrogate alone is used; from there to the domain's edge the exact force is blended in.

        Every bound lies a tenth nearer to 1, the undeformed state, on a logarithmic scale. A domain that does not contain the undeformed
        state is returned unchanged.
        """
        bounds = (self.least_stretch, self.greatest_stretch, self.least_bulk, self.greatest_bulk)
        if not (bounds[0] < 1 < bounds[1] and bounds[2] < 1 < bounds[3]):
            return self
        return type(self)(*(bound**0.9 for bound in bounds))

    def deviation(self, stretches: np.ndarray, bulk: np.ndarray | None = None) -> np.ndarray:
        """Return the greatest logarithmic excess of each state over a bound, shape (n,); inside, minus the distance to the nearest bound.

        The edge of the hull of test data, if there is one, is one of the bounds.

        Parameters
        ----------
        stretches : ndarray, shape (n, k)
            Principal stretches.
        bulk : ndarray, shape (n,), optional
            Squared volume ratio J3^2, for a model that depends on it.
        """
        passed = self.beyond_bounds(stretches, bulk)
        return passed if self.hull is None else np.maximum(passed, self.beyond_data(stretches))

    def beyond_data(self, stretches: np.ndarray) -> np.ndarray:
        """Return the `deviation` of states from the hull of test data alone, shape (n,).

        Two stretches in the plane are completed by a third at constant volume.
        """
        logs = np.log(stretches)
        logs = np.column_stack([logs, -logs.sum(axis=1)]) if logs.shape[1] == 2 else logs - logs.mean(axis=1, keepdims=True)
        planes = np.array(self.hull)
        return (-np.sort(-logs, axis=1)[:, :2] @ planes[:, :2].T - planes[:, 2]).max(axis=1)

    def beyond_bounds(self, stretches: np.ndarray, bulk: np.ndarray | None = None) -> np.ndarray:
        """Return the `deviation` of states from the bounds of stretches and J3^2 alone, shape (n,); a run uses the model within these."""
        with np.errstate(divide="ignore"):
            stretch = np.log(stretches)
            least, greatest, low, high = np.log([self.least_stretch, self.greatest_stretch, self.least_bulk, self.greatest_bulk])
            passed = np.maximum(stretch.max(axis=1) - greatest, least - stretch.min(axis=1))
            return passed if bulk is None else np.maximum(passed, np.maximum(np.log(bulk) - high, low - np.log(bulk)))

    def limits(self, dtype) -> np.ndarray:
        """Return the bounds as an array of constants for the compiled test `pdsurrogate.kernels.domain.is_outside`."""
        low, high = np.float64(self.least_stretch) ** 2, np.float64(self.greatest_stretch) ** 2
        with np.errstate(divide="ignore"):
            return np.array([low, high, 1 / low, 1 / high, self.least_bulk, self.greatest_bulk, LEAST_NORMAL_STRETCH], dtype=dtype)


EVERYWHERE = Domain(0.0, np.inf, 0.0, np.inf)
"""Domain without bounds: all states in which a bond has a stretch tensor."""


@kernel
def _call(address, arguments):
    """Call the function compiled for blocks of bonds at an address."""
    call_block(address, *arguments)


def by_blocks(evaluate: Callable[[np.ndarray, np.ndarray], object], states: np.ndarray, n_rows: int, dtype) -> np.ndarray:
    """Return the results, shape (n_rows, n), of a function that accepts only blocks of BLOCK states, at n states, shape (rows, n).

    ``evaluate(block, result)`` writes the results of a block (rows, BLOCK) into `result` (n_rows, BLOCK); both are of type `dtype`.
    """
    n = states.shape[1]
    found = np.empty((n_rows, n))
    for at in range(0, n, BLOCK):
        size = min(BLOCK, n - at)
        # Copies of the first state fill the last block, so that all its columns are valid states.
        rows, result = np.repeat(states[:, at : at + 1], BLOCK, axis=1).astype(dtype), np.zeros((n_rows, BLOCK), dtype)
        rows[:, :size] = states[:, at : at + size]
        evaluate(rows, result)
        found[:, at : at + size] = result[:, :size]
    return found


@dataclass(frozen=True)
class CompiledBondForce:
    """Bond force or energy as a function compiled for blocks of bonds, with its constants.

    Attributes
    ----------
    address : int
        Address of the function (`pdsurrogate.engine.compile.bond_force_signature`).
    sizes : ndarray of int64
        Integer constants.
    weights : ndarray, in the precision of the bond pass
        Floating-point constants.
    work_rows : int
        Rows of working memory that the function needs, in the precision of the bond pass.
    needs_length : bool
        Whether the function reads the last row of its states, l/horizon, which is not filled otherwise.
    asks_law : bool
        Whether the function calls the law's response that the pass supplies, which accounts for a free or held thickness. Any other
        function returns the force for zero stress across the thickness, to which plane strain adds a pressure
        (`pdsurrogate.forces.bond_force.in_plane_strain`).
    """

    address: int
    sizes: np.ndarray
    weights: np.ndarray
    work_rows: int
    needs_length: bool = False
    asks_law: bool = False

    def constants(self, points: MaterialPoints) -> tuple:
        """Return the arguments of the function: its own constants, then address of the response and parameters of the law of `points`."""
        return self.sizes, self.weights, points.response.address, points.parameters

    def memory(self, threads: int, dtype) -> np.ndarray:
        """Return an array of working memory for the function, one block for every thread."""
        return aligned_rows((threads, max(self.work_rows, 1), BLOCK), dtype)

    def evaluate(self, states: np.ndarray, n_rows: int, response: int = 0, parameters: np.ndarray | None = None) -> np.ndarray:
        """Return the result of the function, shape (n_rows, n), at states (rows, n), in double; for checks, as it is slow.

        `response` and `parameters` are the compiled response and the parameters of the law, for functions that use it (`asks_law`).
        """
        dtype = self.weights.dtype
        law = response, np.zeros(1) if parameters is None else parameters
        memory = self.memory(1, dtype)[0], np.zeros((SCRATCH_ROWS, BLOCK))

        def evaluate(rows: np.ndarray, result: np.ndarray) -> None:
            _call(self.address, (rows, self.sizes, self.weights, *law, *memory, result))

        return by_blocks(evaluate, states, n_rows, dtype)


@dataclass(frozen=True)
class Portion:
    """Points of one material of a body, with its law and its force model.

    Attributes
    ----------
    law : Law
    model : ForceModel
    points : ndarray of int or slice
        Numbers of the points in ascending order; ``slice(None)`` if all points are of the material.
    """

    law: Law
    model: "ForceModel"
    points: np.ndarray | slice


@dataclass(frozen=True)
class Member:
    """Member of the committee of a learned model: another learned model, whose deviation from it a run can report.

    Attributes
    ----------
    model : ForceModel
        Model of the member, whose forces are in units of the member's own shear modulus.
    law : Law
        Law that it describes.
    ratio : float
        Shear modulus of the member divided by that of the model to whose committee it belongs.
    """

    model: "ForceModel"
    law: Law
    ratio: float


class ForceModel(ABC):
    """Base class of force models, rules for the forces between points: exact laws, surrogates, and reference methods.

    A model declares the settings that it honors; `bind` combines it with a body, a material and settings.

    Attributes
    ----------
    name : str
    family : str
        Kind of force model; only models of one kind can describe the materials of one body together.
    honors : mapping
        Values that the model honors, for every field of `ForceSettings` that it uses.
    several_materials : tuple of str
        Planes in which models of its family describe the materials of one body together.
    default_precision : str
        Precision of the bond pass under plane stress.
    mirrors_curves : bool
        Whether mirrored points hold boundaries of any shape under this model; otherwise they hold edges alone.
    differentiable : bool
        Whether Newton's method finds equilibria under this model, which derivatives of results and modes need.
    stated : mapping, optional
        Errors that the card (the metadata of its artifact) of a learned model states, see `pdsurrogate.forces.agreement`.
    members : tuple of Member
        Members of the committee of a learned model, in a run that reports their deviation.

    See Also
    --------
    pdsurrogate.load_surrogate : loads a model by name.
    pdsurrogate.forces.OwnBondForce : model of a force that a user wrote.

    Examples
    --------
    >>> import pdsurrogate as pds
    >>> model = pds.load_surrogate("neo-hookean@1")
    >>> isinstance(model, pds.forces.ForceModel), model.facts["family"]
    (True, 'bond force')
    """

    name: str
    family: str
    several_materials: tuple[str, ...] = ()
    default_precision: str = "float64"
    mirrors_curves: bool = True
    differentiable: bool = True
    stated: Mapping[str, float] | None = None
    members: tuple[Member, ...] = ()

    @property
    @abstractmethod
    def honors(self) -> Mapping[str, tuple]:
        """Values that the model can honor, for every field of `ForceSettings` that the model uses.

        Examples
        --------
        >>> import pdsurrogate as pds
        >>> pds.forces.NOSBForce().honors["plane"]
        ('stress', 'strain', 'space')
        """

    def bind(self, body: Body, law: Law, settings: ForceSettings) -> InternalForce:
        """Return the internal force of this model on a body of one material, ready to be evaluated.

        Parameters
        ----------
        body : Body
        law : Law
            Material of all points.
        settings : ForceSettings

        Returns
        -------
        InternalForce
            Its method ``place(positions)`` takes positions, shape (n, d), and evaluates the forces there.

        Raises
        ------
        TypeError
            If one of the arguments is of another type.
        ValueError
            If the model does not fit the material, or cannot honor a setting.

        Examples
        --------
        >>> import pdsurrogate as pds
        >>> body = pds.Body.rectangle(1.0, 1.0, 0.25, 0.7875)
        >>> force = pds.AnalyticBondForce().bind(body, pds.materials.NeoHookean(), pds.ForceSettings())
        >>> force.place(body.points * [1.1, 1.0])
        >>> force.stress_and_energy()[1].shape
        (16,)
        """
        if not isinstance(body, Body):
            raise TypeError(f"body must be a Body, such as Body.rectangle(1.0, 1.0, 0.1, 0.315), not {body!r}")
        if not isinstance(settings, ForceSettings):
            raise TypeError(f"settings must be ForceSettings(), not {settings!r}")
        settings.check(self.name, self.honored(settings.plane))
        self.check_material(checked_law(law))
        return InternalForce(body, (Portion(law, self, slice(None)),), settings)

    @abstractmethod
    def terms(self, plane: str) -> Sequence[type[Term]]:
        """Return the classes of the terms of the internal force under plane stress, in plane strain, or in three dimensions.

        Parameters
        ----------
        plane : {"stress", "strain", "space"}

        Returns
        -------
        sequence of type

        Examples
        --------
        >>> import pdsurrogate as pds
        >>> [term.__name__ for term in pds.AnalyticBondForce().terms("stress")]
        ['BondForces']
        """

    def honored(self, plane: str) -> Mapping[str, tuple]:
        """Return `honors` for a given plane.

        Parameters
        ----------
        plane : {"stress", "strain", "space"}
            Plane stress, plane strain or three dimensions.

        Returns
        -------
        mapping

        Examples
        --------
        >>> import pdsurrogate as pds
        >>> pds.BondEnergyForce().honored("space")["precision"]
        ('float64',)
        """
        return self.honors

    def usual_precision(self, settings: ForceSettings) -> str:
        """Return the precision of the bond pass: from the settings if given, or else `default_precision` under plane stress, or double.

        Parameters
        ----------
        settings : ForceSettings

        Returns
        -------
        {"float32", "float64"}

        Examples
        --------
        >>> import pdsurrogate as pds
        >>> pds.load_surrogate("neo-hookean").usual_precision(pds.ForceSettings())
        'float32'
        """
        return settings.precision or (self.default_precision if settings.plane == "stress" else "float64")

    def cause_of(self, error: RuntimeError) -> RuntimeError:
        """Return the error to report for a failed evaluation: the error in a user's own code that caused it, or else the failure itself.

        Parameters
        ----------
        error : RuntimeError
            Failure of the evaluation.

        Returns
        -------
        RuntimeError

        Examples
        --------
        >>> import pdsurrogate as pds
        >>> pds.AnalyticBondForce().cause_of(RuntimeError("no state"))
        RuntimeError('no state')
        """
        return error

    def check_material(self, law: Law) -> None:  # noqa: B027 - most models have nothing to check
        """Raise ValueError if the model does not describe a material; a model without learned data accepts every law.

        Parameters
        ----------
        law : Law

        Raises
        ------
        ValueError
            If the model was learned for another law or for other parameters.

        Examples
        --------
        >>> import pdsurrogate as pds
        >>> try:
        ...     pds.load_surrogate("neo-hookean@1").check_material(pds.materials.Gent())
        ... except ValueError as error:
        ...     print(error)
        neo-hookean@1 describes the law neo-hookean, not gent; force=analytic supports every law
        """

    def payload(self) -> dict:
        """Return the learned numbers, which distinguish models of one name.

        Returns
        -------
        dict
            Arrays and names by key; empty if nothing is learned.

        Examples
        --------
        >>> import pdsurrogate as pds
        >>> pds.AnalyticBondForce().payload(), sorted(pds.load_surrogate("gent@1").payload())
        ({}, ['at_rest', 'centre', 'coefficients', 'feature_set', 'half_width'])
        """
        return {}

    @property
    def size(self) -> str:
        """Size of the learned model in words, for tables.

        Examples
        --------
        >>> import pdsurrogate as pds
        >>> pds.load_surrogate("neo-hookean-energy").size
        '12 units'
        """
        return ""

    @property
    def facts(self) -> dict[str, str]:
        """Main properties of the model in words, by name, for display.

        Examples
        --------
        >>> import pdsurrogate as pds
        >>> pds.AnalyticBondForce().facts
        {'family': 'bond force', 'learned': 'nothing: it is exact and serves every law'}
        """
        return {"family": self.family, "learned": self.size or "nothing: it is exact and serves every law"}

    def __repr__(self) -> str:
        return f"<{type(self).__name__} {self.name}>"

    def _repr_html_(self) -> str:
        return html_facts(f"Force model {self.name}", self.facts)


def bind_portions(body: Body, portions: Sequence[Portion], settings: ForceSettings, rigid: np.ndarray | None = None) -> InternalForce:
    """Return the internal force on a body of several materials, ready to be evaluated.

    Portions (the points of one material each) with equal law and model are merged; if one portion is left, the body is evaluated as a body
    of one material.

    Parameters
    ----------
    body : Body
    portions : sequence of Portion
        Points of each material with its law and force model, which together contain every point of the body once.
    settings : ForceSettings
        Settings that every model honors, as far as it uses them.
    rigid : ndarray of int, optional
        Points of rigid parts, without a material; solvers move them, and bonds to other points act on them. The force must have an energy.

    Raises
    ------
    ValueError
        If a point is in no portion or in two; if a model does not describe its law, cannot honor a setting, or does not accept several
        materials in this plane; if models belong to different families; or if bonds may break and there are rigid points.
    """
    rigid = np.empty(0, dtype=np.int64) if rigid is None else rigid
    if not portions:
        raise ValueError("the rigid regions contain all points of the body, so that no material is left to deform")
    of_points = np.concatenate([rigid, *(portion.points for portion in portions)])
    if not np.array_equal(np.sort(of_points), np.arange(len(body))):
        raise ValueError("every point of the body must belong to exactly one material")
    families = {portion.model.family: portion.model.name for portion in portions}
    if len(families) > 1:
        raise ValueError(f"all materials of a body need force models of the same family, not {' and '.join(sorted(families.values()))}")
    if settings.breakable and len(rigid):
        raise ValueError("bonds cannot break (fracture) in a body with rigid regions; give them a law, or leave out fracture")
    merged: list[Portion] = []
    for portion in portions:
        same = next((n for n, other in enumerate(merged) if other.law == portion.law and _same(other.model, portion.model)), None)
        if same is None:
            merged.append(portion)
        else:
            merged[same] = replace(portion, points=np.sort(np.concatenate([merged[same].points, portion.points])))
    if len(merged) > 1 and (asked := [portion.model.name for portion in merged if portion.model.members]):
        raise ValueError(f"{asked[0]}: the deviation of committee members is available only for bodies of one material; leave out #all")
    if len(merged) == 1 and not len(rigid):
        return merged[0].model.bind(body, merged[0].law, settings)
    honored = {key for portion in merged for key in portion.model.honored(settings.plane)}
    for portion in merged:
        # Models that hold everywhere do not use `outside`; those of other materials may have a domain.
        honors = portion.model.honored(settings.plane)
        spared = "outside" in honored and "outside" not in honors
        (replace(settings, outside=None) if spared else settings).check(portion.model.name, honors)
        portion.model.check_material(portion.law)
        several = portion.model.several_materials
        if not several:
            raise ValueError(f"{portion.model.name} supports bodies of one material only; leave out materials")
        # The pressure of bond forces and of NOSB depends on det F at single points (theory, section 16). A point would have to keep its
        # volume both in its own motion and in the continued motion of the other material, and no equilibrium exists; with one gradient for
        # both materials, states that are homogeneous on either side are not in equilibrium.
        if settings.plane not in several:
            raise ValueError(f"{portion.model.name} supports several materials only with plane=stress; use force=bond-energy")
    return InternalForce(body, merged, settings)


def _same(model: ForceModel, other: ForceModel) -> bool:
    """Return whether two models are equivalent: the same object, or two of one class without learned data."""
    return model is other or (type(model) is type(other) and model.name == other.name and not model.payload() and not other.payload())
