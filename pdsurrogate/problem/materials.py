"""Materials of a scene: the force model of each, the points of the body that belong to it, and what to warn of."""

from __future__ import annotations

import warnings
from collections.abc import Sequence

import numpy as np

from .. import artifacts
from ..body import Body
from ..forces import ForceModel, ForceSettings, InternalForce, Portion
from ..forces.interfaces import YIELDING
from ..materials import Law
from ..scenes import Scene, SceneError
from ..scenes.tip_diameter import tip_diameter
from .regions import BodyRegions

LEAST_CELLS = 3
"""Thickness of a part in cells below which a warning is given: at a horizon of 3.15 cells its neighbours are bonded through it."""

LEAST_LOADED_CELLS = 5
"""Thickness of a rigid region in cells below which tractions on it are warned of; at a free side one more is counted than there are."""

MOST_CONTRAST = 30.0
"""Ratio of shear moduli beyond which a force that has no energy is warned of."""

NOT_CONFINED = 2.0
"""Bulk modulus of a soft material over the shear modulus of a stiff one beside it, beyond which plane strain warns of confined parts."""

AS_GOOD_AS_RIGID = 1e4
"""Ratio of shear moduli beyond which a rigid region is recommended: a box of rubber between blocks 1,000 times as stiff comes to rest in
1,800 evaluations, between blocks 80,000 times as stiff in none of 4,500, and with rigid blocks in 970."""


def settings_of(scene: Scene) -> ForceSettings:
    """Return the choices of a scene for the evaluation of its force model."""
    return ForceSettings(scene.precision, scene.correction, scene.rotation, scene.outside, scene.fracture is not None, scene.plane)


def warn_of_bulk_moduli(scene: Scene) -> None:
    """Warn of moduli that no rubber has, as where a bulk modulus is missing and the shear modulus is in other units."""
    laws = {"material": scene.law()}
    laws |= {f"materials.{number}": part.material.build() for number, part in enumerate(scene.materials) if not part.rigid}
    for key, law in laws.items():
        if law.bulk_modulus < 2 / 3 * law.shear_modulus:
            warnings.warn(
                f"scene {scene.name}: {key}: the bulk modulus, {law.bulk_modulus:g}, is less than two thirds of the shear modulus, "
                f"{law.shear_modulus:g}, and Poisson's ratio is negative: give bulk_modulus in the units of shear_modulus; left out, it is "
                "100 or 200 whatever these are",
                stacklevel=3,
            )


def warn_of_parts(scene: Scene, force: InternalForce, model: str, rigid: list[str]) -> None:
    """Warn of materials that are too thin or too stiff for the force model; refuse with ValueError a rigid region one cell thick."""
    moduli = [portion.law.shear_modulus for portion in force.portions]
    for number, modulus in enumerate([*moduli, None][: len(moduli) + bool(rigid)]):
        cells = force.interfaces.cells_across(number, LEAST_CELLS if modulus is not None else LEAST_LOADED_CELLS)
        if modulus is None and cells < 2:
            raise ValueError(f"materials: a rigid region ({', '.join(rigid)}) is one cell thick, and needs 2; take a smaller spacing")
        if modulus is None and 0 < cells < LEAST_LOADED_CELLS and {load.kind for load in scene.loads} & {"traction", "pressure"}:
            warnings.warn(
                f"scene {scene.name}: a rigid region is at most {cells:.0f} cells thick, and part of a traction or pressure on it "
                "acts on what is behind it: its force in the results is up to 31 % off with 2 cells, 20 % with 3, though all forces "
                "are in balance; give the load as a force on the region, or take a smaller spacing",
                stacklevel=2,
            )
        if modulus is not None and len(moduli) > 1 and 0 < cells < LEAST_CELLS:
            warnings.warn(
                f"scene {scene.name}: the part of shear modulus {modulus:.4g} is some {cells:.0f} cells thick, "
                f"{cells * force.body.spacing:.3g}, and bonds reach through it: with 2 cells a soft layer is 1.6 times too stiff "
                "between halves 10 times as stiff, 8 times between halves 100 times, and so on; take a smaller spacing",
                stacklevel=2,
            )
    contrast = max(moduli) / min(moduli)
    if contrast > AS_GOOD_AS_RIGID:
        warnings.warn(
            f"scene {scene.name}: one material is {contrast:.3g} times as stiff as another, and equilibrium takes thousands of "
            'evaluations or is not found: take material = "rigid" for it, which differs by less than 0.1 %',
            stacklevel=2,
        )
    if not force.has_energy and contrast > MOST_CONTRAST:
        warnings.warn(
            f"scene {scene.name}: one material is {contrast:.3g} times as stiff as another; beside it "
            f"{model} is off by 2 to 7 % (an inclusion 8 to 16 cells wide), a soft layer of 4 cells is many times too "
            "stiff, or no equilibrium is found: take force=bond-energy",
            stacklevel=2,
        )
    confined = [
        (stiff.law.shear_modulus, soft.law.bulk_modulus)
        for stiff in force.portions
        for soft in force.portions
        if YIELDING * soft.law.shear_modulus < stiff.law.shear_modulus < soft.law.bulk_modulus / NOT_CONFINED
    ]
    if force.has_energy and scene.plane == "strain" and confined:
        warnings.warn(
            f"scene {scene.name}: a material of shear modulus {confined[0][0]:.4g} lies beside a softer one of bulk modulus "
            f"{confined[0][1]:.4g}, and the softer one is too soft where it is confined: by 6 to 14 % in a layer 4 cells thick, by "
            '3 % in one of 8; take a smaller spacing, or material = "rigid" for the stiff part',
            stacklevel=2,
        )


def checked_models(scene: Scene, model: ForceModel) -> list[ForceModel]:
    """Return the models of all materials of a scene, that of the remaining body first; raise SceneError for one that does not fit.

    Raises
    ------
    SceneError
        If a model does not describe its material, or cannot honour a setting of the scene.
    """
    try:
        settings_of(scene).check(model.name, model.honoured(scene.plane))
        model.check_material(scene.law())
    except ValueError as error:
        raise SceneError(f"scene {scene.name}: {error}") from None
    check_fracture(scene, model)
    return [model, *models_of(scene, model)]


def check_fracture(scene: Scene, model: ForceModel) -> None:
    """Raise SceneError for a fracture energy from which no critical stretch follows with this model."""
    if scene.fracture is None or scene.fracture.energy is None:
        return
    try:
        tip_diameter(scene.plane, scene.horizon_ratio, model.family)
    except ValueError as error:
        raise SceneError(f"scene {scene.name}: {error}") from None


def models_of(scene: Scene, model: ForceModel) -> list[ForceModel]:
    """Return the force models of the scene's `materials`.

    A part has the model that it asks for, or else that of the rest if it describes the part's law, or else its law's surrogate of the same
    kind.

    Parameters
    ----------
    scene : Scene
    model : ForceModel
        Model of the rest of the body.

    Raises
    ------
    SceneError
        If a part's artefact cannot be read, is of another kind than the model of the rest, or does not describe its law, or a rigid region
        is beside a force that has no energy.
    """
    found = []
    for number, part in enumerate(scene.materials):
        if part.rigid:
            if model.family != "bond energy":
                why = f"a rigid region takes a force that has an energy, as bond-energy; {model.name} has none"
                raise SceneError(f"scene {scene.name}: materials.{number}: {why}")
            found.append(model)  # not evaluated there
            continue
        law = part.material.build()
        try:
            if part.force is not None:
                own = artifacts.load_surrogate(part.force)
                if own.family != model.family:
                    raise ValueError(f"{own.name} is a {own.family}, and {model.name} of the rest a {model.family}; take two of one kind")
                own.check_material(law)
            else:
                own = model if _describes(model, law) else artifacts.surrogate_for(law, model.family, scene.plane)
        except ValueError as error:
            raise SceneError(f"scene {scene.name}: materials.{number}{'.force' if part.force else ''}: {error}") from None
        found.append(own)
    return found


def _describes(model: ForceModel, law: Law) -> bool:
    """Return whether a model describes a law."""
    try:
        model.check_material(law)
    except ValueError:
        return False
    return True


def portions_of(
    scene: Scene, body: Body, models: Sequence[ForceModel], regions: BodyRegions
) -> tuple[list[Portion], dict[str, np.ndarray]]:
    """Return the points of every material: of the rest, then of `materials` in order; one that is left no point has no portion.

    Parameters
    ----------
    scene : Scene
    body : Body
    models : list of ForceModel
        Models of the rest, then of `materials`.
    regions : BodyRegions

    Returns
    -------
    list of Portion
    dict of ndarray
        Points of the rigid regions, by the regions' names.

    Raises
    ------
    ValueError
        If a region has no point, or two materials take the same point; names them.
    """
    of_points, laws = np.zeros(len(body), dtype=np.int64), [scene.law()]
    for number, part in enumerate(scene.materials, 1):
        laws.append(None if part.rigid else part.material.build())
        points = regions.points(part.region, f"materials.{number - 1}.region")
        before = of_points[points]
        # Two rigid regions are two bodies.
        different = [part.rigid or laws[other] != laws[number] or models[other] is not models[number] for other in before]
        error, twice = None, (before > 0) & np.array(different, dtype=bool)
        if twice.any():
            place = ", ".join(f"{x:.4g}" for x in body.points[points[twice.argmax()]])
            error = ValueError(
                f"materials.{before[twice.argmax()] - 1} and materials.{number - 1} both take {int(twice.sum())} points, the first at "
                f"({place}); regions of different materials must not overlap"
            )
        body.share.agree(error)
        of_points[points] = number
    rigid = {
        regions.label(part.region, f"materials.{number}"): np.flatnonzero(of_points == number + 1)
        for number, part in enumerate(scene.materials)
        if part.rigid
    }
    portions = [
        Portion(law, model, points)
        for number, (law, model) in enumerate(zip(laws, models, strict=True))
        if law is not None
        and body.share.any(len(points := np.flatnonzero(of_points == number)) > 0)  # of several ranks all have the same portions
    ]
    return portions, rigid
