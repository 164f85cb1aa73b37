"""Base class of force models, and the functions that bind models to the points of a body."""

from abc import ABC, abstractmethod
from collections.abc import Mapping, Sequence
from dataclasses import replace

import numpy as np

from ..body import Body
from ..html_tables import html_facts
from ..materials import Law
from ..materials.law import checked_law
from .binding import MaterialPart
from .internal_force import InternalForce
from .settings import ForceSettings
from .term import Term


class ForceModel(ABC):
    """Base class of force models, rules for the forces between points: exact laws, surrogates, and
    reference methods.

    A model declares the settings that it honors; `bind` combines it with a body, a material and
    settings.

    Attributes
    ----------
    name : str
    family : str
        Kind of force model; only models of one kind can describe the materials of one body
        together.
    honors : mapping
        Values that the model honors, for every field of `ForceSettings` that it uses.
    several_materials : tuple of str
        Planes in which models of its family describe the materials of one body together.
    default_precision : str
        Precision of the bond pass under plane stress.
    mirrors_curves : bool
        Whether mirrored points hold boundaries of any shape under this model; otherwise they hold
        edges alone.
    differentiable : bool
        Whether Newton's method finds equilibria under this model, which derivatives of results and
        modes need.
    remembers : tuple of str
        Planes in which the model describes materials with branches or softening.
    stated : mapping, optional
        Errors that the card (the metadata of its artifact) of a learned model states, see
        `pdsurrogate.forces.agreement`.

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
    remembers: tuple[str, ...] = ()
    default_precision: str = "float64"
    mirrors_curves: bool = True
    differentiable: bool = True
    stated: Mapping[str, float] | None = None

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
            Its method ``place(positions)`` takes positions, shape (n, d), and evaluates the forces
            there.

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
        >>> force = pds.AnalyticBondForce().bind(
        ...     body, pds.materials.NeoHookean(), pds.ForceSettings()
        ... )
        >>> force.place(body.points * [1.1, 1.0])
        >>> force.stress_and_energy()[1].shape
        (16,)
        """
        if not isinstance(body, Body):
            raise TypeError(
                f"body must be a Body, such as Body.rectangle(1.0, 1.0, 0.1, 0.315), not {body!r}"
            )
        if not isinstance(settings, ForceSettings):
            raise TypeError(f"settings must be ForceSettings(), not {settings!r}")
        settings.check(self.name, self.honored(settings.plane))
        self.check_material(checked_law(law))
        _check_memory(self, law, settings.plane)
        return InternalForce(body, (MaterialPart(law, self, slice(None)),), settings)

    @abstractmethod
    def terms(self, plane: str) -> Sequence[type[Term]]:
        """Return the classes of the terms of the internal force under plane stress, in plane
        strain, or in three dimensions.

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
        """Return the precision of the bond pass: from the settings if given, or else
        `default_precision` under plane stress, or double.

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
        return settings.precision or (
            self.default_precision if settings.plane == "stress" else "float64"
        )

    def check_material(self, law: Law) -> None:  # noqa: B027 - most models have nothing to check
        """Raise ValueError if the model does not describe a material; a model without learned data
        accepts every law.

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
        return {
            "family": self.family,
            "learned": self.size or "nothing: it is exact and serves every law",
        }

    def __repr__(self) -> str:
        return f"<{type(self).__name__} {self.name}>"

    def _repr_html_(self) -> str:
        return html_facts(f"Force model {self.name}", self.facts)


def bind_portions(
    body: Body,
    portions: Sequence[MaterialPart],
    settings: ForceSettings,
    rigid: np.ndarray | None = None,
) -> InternalForce:
    """Return the internal force on a body of several materials, ready to be evaluated.

    Portions (the points of one material each) with equal law and model are merged; if one portion
    is left, the body is evaluated as a body of one material.

    Parameters
    ----------
    body : Body
    portions : sequence of MaterialPart
        Points of each material with its law and force model, which together contain every point of
        the body once.
    settings : ForceSettings
        Settings that every model honors, as far as it uses them.
    rigid : ndarray of int, optional
        Points of rigid parts, without a material; solvers move them, and bonds to other points act
        on them. The force must have an energy.

    Raises
    ------
    ValueError
        If a point is in no portion or in two; if a model does not describe its law, cannot honor a
        setting, or does not accept several materials in this plane; if models belong to different
        families; or if bonds may break and there are rigid points.
    """
    rigid = np.empty(0, dtype=np.int64) if rigid is None else rigid
    if not portions:
        raise ValueError(
            "the rigid regions contain all points of the body, so that no material is left to"
            " deform"
        )
    of_points = np.concatenate([rigid, *(portion.points for portion in portions)])
    if not np.array_equal(np.sort(of_points), np.arange(len(body))):
        raise ValueError("every point of the body must belong to exactly one material")
    families = {portion.model.family: portion.model.name for portion in portions}
    if len(families) > 1:
        raise ValueError(
            "all materials of a body need force models of the same family, not"
            f" {' and '.join(sorted(families.values()))}"
        )
    if settings.breakable and len(rigid):
        raise ValueError(
            "bonds cannot break (fracture) in a body with rigid regions; give them a law, or leave"
            " out fracture"
        )
    merged: list[MaterialPart] = []
    for portion in portions:
        same = next(
            (
                n
                for n, other in enumerate(merged)
                if other.law == portion.law and _same(other.model, portion.model)
            ),
            None,
        )
        if same is None:
            merged.append(portion)
        else:
            merged[same] = replace(
                portion, points=np.sort(np.concatenate([merged[same].points, portion.points]))
            )
    if len(merged) == 1 and not len(rigid):
        return merged[0].model.bind(body, merged[0].law, settings)
    honored = {key for portion in merged for key in portion.model.honored(settings.plane)}
    for portion in merged:
        # Models that hold everywhere do not use `outside`; those of other materials may have a
        # domain.
        honors = portion.model.honored(settings.plane)
        spared = "outside" in honored and "outside" not in honors
        (replace(settings, outside=None) if spared else settings).check(portion.model.name, honors)
        portion.model.check_material(portion.law)
        _check_memory(portion.model, portion.law, settings.plane)
        several = portion.model.several_materials
        if not several:
            raise ValueError(
                f"{portion.model.name} supports bodies of one material only; leave out materials"
            )
        # The pressure of bond forces and of NOSB depends on det F at single points (theory, section
        # 16). A point would have to keep its volume both in its own motion and in the continued
        # motion of the other material, and no equilibrium exists; with one gradient for both
        # materials, states that are homogeneous on either side are not in equilibrium.
        if settings.plane not in several:
            raise ValueError(
                f"{portion.model.name} supports several materials only with plane=stress; use"
                " force=bond-energy"
            )
    return InternalForce(body, merged, settings)


def _check_memory(model: ForceModel, law: Law, plane: str) -> None:
    """Raise ValueError if a law has a memory that a model does not describe."""
    if law.memory and plane not in model.remembers:
        raise ValueError(
            f"{model.name} does not describe branches or softening with plane={plane}; use"
            " force=bond-energy, or leave them out of the material"
        )


def _same(model: ForceModel, other: ForceModel) -> bool:
    """Return whether two models are equivalent: the same object, or two of one class without
    learned data.
    """
    return model is other or (
        type(model) is type(other)
        and model.name == other.name
        and not model.payload()
        and not other.payload()
    )
