"""Scene: a body, its material, its supports and loads, and the reference solution with which
results are compared.
"""

import json

from ..html_tables import html_facts
from ..materials import Law
from .consistency import check_consistency
from .model import SceneData
from .problems import SceneError


class Scene(SceneData):
    """Complete description of a simulation: body, material, loading, solver and output.

    All values are in one consistent system of units. Places, directions and forces have as many
    components as the body has dimensions. A scene defines its loading in one of two ways: with two
    `grips` and `stretches` (and `holds` and `dynamics`), or with `prescribed` displacements,
    `loads` and `obstacles` (at least one of these) and `steps`.

    Parameters
    ----------
    name : str
        Name of the scene and of its result files: letters, digits, spaces and ``._-``, at most 64
        characters.
    title : str
        Title of tables and figures.
    spacing : float
        Distance between neighboring points, which is the side of their cells. If it does not divide
        a side of the body, the cells have the nearest side that does; a spacing from which it
        differs by more than 10 % is an error. A mesh defines its own spacing, so that this key is
        optional. Unit: length.
    stretches : float or list of float
        Stretches that the grips reach in equilibrium, in this order; a stretch is the distance of
        the grips divided by their undeformed distance. A single number means a list with this
        number. Unit: none.
    times : float or list of float
        Time at which each of `stretches` is reached, from 0 for the undeformed body on, in which
        the stretch changes linearly; two equal times are a sudden change, two equal stretches a
        hold. Materials with branches need them. Unit: time.
    body : shape or Mesh
        Shape of the undeformed body; without the key ``shape`` it is a rectangle.
    holes : list of shapes
        Shapes that are cut out of the body.
    precuts : list of Precut, ParallelogramCut or DiscCut
        Cuts of the undeformed body; points on different sides of a cut have no bond. An edge that
        is held by reflection mirrors them as it mirrors the body.
    plane : {"stress", "strain", "space"}
        Plane stress for a thin sheet, plane strain for a long body of constant cross-section,
        ``"space"`` for a solid. By default plane stress for a body in the plane.
    material : MaterialSpec or str, optional
        Material of the body outside the regions of `materials`; the name of a law alone means the
        law with its default parameters. Optional if the force model is an artifact: the run then
        uses the material of the artifact.
    materials : list of Part
        Regions that have another material or are rigid.
    grips : list of Grip
        Two grips on opposite edges.
    holds : list of Hold
        Points that are held besides the grips.
    regions : dict of Region
        Regions by name, to which conditions, loads and materials refer.
    prescribed : list of Prescribed
        Prescribed displacements of regions.
    loads : list of Load
        Loads on regions.
    obstacles : list of Obstacle
        Rigid obstacles without friction.
    steps : float, Step or list of these
        Steps of the loading program. They move the loading parameter t, which begins at 0. A number
        is a step to this value in equilibrium; a single step means a list with one step.
    probes : list of Probe
        Places at which results are reported.
    support : {"reflected", "points"}
        How an edge of the bounding box with a held normal component is held: ``"reflected"``
        continues the body beyond the edge by its mirror image, which holds the edge exactly;
        ``"points"`` holds the outermost points, half a cell inside the edge. ``"reflected"`` also
        holds whole spheres, circular and elliptic holes and convex outlines by mirror images, if
        all components are prescribed and the radius of curvature is at least two spacings; other
        boundaries are held at their points.
    horizon_ratio : float
        Horizon divided by the smaller side of a cell; by default 3.15 in the plane, as in the
        paper, and 1.75 for solids. Unit: none.
    weight : str
        Weight of a bond of length l at the horizon d: ``"inverse"`` is d/l, as in the paper;
        ``"constant"`` is 1; ``"linear"`` is 1 - l/d.
    correction : {"tensor", "scalar", "none"}, optional
        Correction of incomplete horizons, near edges, in bond forces: ``"tensor"`` is theory (21),
        ``"scalar"`` is the paper's (24)-(25). By default ``"tensor"`` if the force model supports
        it. Bond energies have balanced gradients there (theory, section 26).
    rotation : {"polar", "convected"}, optional
        Rotation of a horizon: that of the polar decomposition, which is the default, or the paper's
        (22)-(23).
    precision : {"float32", "float64"}, optional
        Precision in which forces of bonds are computed; by default the force model chooses.
        Positions and sums are always in float64.
    outside : {"fallback", "warn", "raise", "extrapolate"}, optional
        What happens to a bond whose state is outside the domain of a surrogate: ``"fallback"``, the
        default, uses the exact force; ``"extrapolate"`` uses the surrogate; ``"warn"`` does the
        same with a warning; ``"raise"`` ends the run.
    solver : SolverSpec
        Settings of the solver for equilibrium.
    fracture : Fracture, optional
        Criterion by which bonds break, and whether in dynamics or in equilibrium.
    dynamics : Dynamics, optional
        Dynamics after the last of `stretches`. A step has its own dynamics.
    units : Units
        Names of the units, for tables and figures.
    reference : {"uniaxial", "finite-elements"}, optional
        Solution with which results are compared: exact homogeneous tension of a rectangle between
        rollers, or the stored finite element solutions of built-in scenes.

    See Also
    --------
    pdsurrogate.load_scene : loads a scene by name or from a file.
    pdsurrogate.preview : draws a scene before it runs.
    pdsurrogate.simulate : runs a scene.

    Examples
    --------
    >>> import pdsurrogate as pds
    >>> scene = pds.Scene(
    ...     name="block",
    ...     spacing=0.25,
    ...     body=pds.shapes.Rectangle(size=(1.0, 1.0)),
    ...     material={"law": "neo-hookean"},
    ...     prescribed=(
    ...         pds.Prescribed(region="left", x1=0.0, x2=0.0),
    ...         pds.Prescribed(region="right", x1=0.2),
    ...     ),
    ...     steps=(1.0,),
    ... )
    >>> scene
    <Scene block: rectangle, spacing 0.25, neo-hookean, 1 step>
    """

    def law(self) -> Law:
        """Return the law of the material.

        Returns
        -------
        Law

        Raises
        ------
        SceneError
            If the scene names no material, or an artifact's: only runs, with an artifact that
            brings its own material, know that of such a scene.

        Examples
        --------
        >>> import pdsurrogate as pds
        >>> pds.load_scene("uniaxial").law().name
        'neo-hookean'
        """
        if self.material is None:
            raise SceneError(
                f"scene {self.name}: material: missing; add one, or choose an artifact as the force"
                " to use its material"
            )
        try:
            return self.material.build()
        except ValueError as error:
            raise SceneError(f"scene {self.name}: material: {error}") from None

    def model_post_init(self, _) -> None:
        check_consistency(self)

    def __repr__(self) -> str:
        program, kind = (self.stretches, "stretch") if self.stretched else (self.steps, "step")
        count = len(program)
        of = self.material
        law = "no material" if of is None else of.law or f"material of {of.artifact}"
        told = (
            f"{count} {kind}{'' if count == 1 else 'es' if kind == 'stretch' else 's'}"
            if count
            else "dynamics"
        )
        spacing = (
            ""
            if self.spacing is None
            else f", spacing {self.units.amount(self.spacing, 'length', 'g')}"
        )
        return f"<Scene {self.name}: {self.body.shape}{spacing}, {law}, {told}>"

    __str__ = __repr__

    def _repr_html_(self) -> str:
        given = self.model_dump(
            mode="json", by_alias=True, exclude_defaults=True, exclude_none=True
        )
        facts = {
            key: value if isinstance(value, str | int | float) else json.dumps(value)
            for key, value in given.items()
        }
        return html_facts(f"Scene {facts.pop('name')}", facts)
