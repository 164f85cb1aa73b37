"""The materials of a scene: which force model each takes, and which points of the body are of it."""

from __future__ import annotations

import warnings

import numpy as np

from .. import artifacts
from ..body import Body
from ..forces import ForceModel, ForceSettings, Portion
from ..scenes import Scene, SceneError
from ..scenes.model import tip_diameter
from ..solvers.regions import BodyRegions


def settings_of(scene: Scene) -> ForceSettings:
    """Choices of a scene for the evaluation of its force model."""
    return ForceSettings(scene.precision, scene.correction, scene.rotation, scene.outside, scene.fracture is not None, scene.plane)


def warn_of_bulk_moduli(scene: Scene) -> None:
    """Warn of materials that no rubber is, as where a bulk modulus was left out beside a shear modulus in other units."""
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


def checked_models(scene: Scene, model: ForceModel) -> list[ForceModel]:
    """The models of all materials of a scene, that of the rest first, where they fit it: what can be told before a body is built.

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
    """Force models of the scene's `materials`.

    The one that a part asks for, or else that of the rest if it describes the part's law, or else that law's surrogate of the same kind.

    Parameters
    ----------
    scene : Scene
    model : ForceModel
        Of the rest of the body.

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
            found.append(model)  # which nothing is asked of there
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


def _describes(model: ForceModel, law) -> bool:
    try:
        model.check_material(law)
    except ValueError:
        return False
    return True


def portions_of(scene: Scene, body: Body, models: list[ForceModel], regions: BodyRegions) -> tuple[list[Portion], dict[str, np.ndarray]]:
    """The points of every material: those of the rest, then those of `materials` in order; a material that is left no point has no portion.

    Parameters
    ----------
    scene : Scene
    body : Body
    models : list of ForceModel
        Of the rest, then of `materials`.
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
        points = regions.points(part.region)
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
