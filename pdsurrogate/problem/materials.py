"""Materials of a scene: the force model and the points of each material, and warnings about
their combination.
"""

import warnings
from collections.abc import Iterator, Sequence
from contextlib import contextmanager
from dataclasses import fields

import numpy as np

from .. import artifacts
from ..body import Body
from ..body.local_fit import text_of
from ..forces import ForceModel, ForceSettings, InternalForce, MaterialPart
from ..forces.interface_search import YIELDING
from ..scenes import Part, Scene, SceneError
from ..scenes.loading_checks import criteria_give, criteria_of
from ..scenes.regions import label_of_region
from ..scenes.strict_model import left_to_artifact
from ..scenes.tip_diameter import tip_diameters_in
from .regions import BodyRegions

LEAST_CELLS = 3
"""Thickness in cells of a region of one material below which the run warns: at a horizon of 3.15
cells bonds reach through the region.
"""

LEAST_LOADED_CELLS = 5
"""Thickness in cells of a rigid region below which the run warns of tractions on it: with 2 cells
the force in the results is up to 31 % off, with 3 cells 20 %. At a free side the count is one too
many, so that five means at least four cells.
"""

MOST_CONTRAST = 30.0
"""Ratio of the shear moduli of two materials beyond which the run warns of a force model that has
no energy: stresses are then 2 to 7 % off and thin soft layers lock.
"""


def settings_of(scene: Scene) -> ForceSettings:
    """Return the `ForceSettings` of a scene: its keys that have the name of a setting, and
    `breakable` if the scene has fracture.
    """
    keys = {
        setting.name: getattr(scene, setting.name)
        for setting in fields(ForceSettings)
        if setting.name not in ("breakable", "paths")
    }
    return ForceSettings(**keys, breakable=scene.fracture is not None)


def _warn(scene: Scene, text: str) -> None:
    warnings.warn(f"scene {scene.name}: {text}", stacklevel=4)


def warn_of_bulk_moduli(scene: Scene) -> None:
    """Warn of a bulk modulus below 2/3 of the shear modulus, for example a default bulk modulus
    beside a shear modulus in other units.
    """
    laws = {
        f"materials.{number}": part.material.build()
        for number, part in enumerate(scene.materials)
        if not part.material.rigid
    }
    for key, law in {"material": scene.law(), **laws}.items():
        if law.bulk_modulus < 2 / 3 * law.shear_modulus:
            _warn(
                scene,
                f"{key}: the bulk modulus, {law.bulk_modulus:g}, is less than two thirds of the"
                f" shear modulus, {law.shear_modulus:g}, so that Poisson's ratio is negative; set"
                " bulk_modulus in the unit of shear_modulus; its default is 100 or 200 in any unit",
            )


def warn_of_parts(scene: Scene, force: InternalForce, model: str, rigid: list[str]) -> None:
    """Warn of materials that are too thin or too stiff for the force model; raise ValueError for a
    rigid region one cell thick.

    `model` is the name of the force model, and `rigid` lists the names of the rigid regions.
    """
    laws = [portion.law for portion in force.portions]
    if rigid:
        _check_rigid_thickness(
            scene, force.interfaces.cells_across(len(laws), LEAST_LOADED_CELLS), ", ".join(rigid)
        )
    for number, law in enumerate(laws if len(laws) > 1 else ()):
        cells = force.interfaces.cells_across(number, LEAST_CELLS)
        if 0 < cells < LEAST_CELLS:
            _warn(
                scene,
                f"the part with shear modulus {law.shear_modulus:.4g} is only about {cells:.0f}"
                f" cells ({cells * force.body.spacing:.3g}) thick, and bonds reach through it: a"
                " soft layer of 2 cells is 1.6 times too stiff between parts 10 times as stiff (8"
                " times if they are 100 times as stiff); use a smaller spacing",
            )
    moduli = [law.shear_modulus for law in laws]
    contrast = max(moduli) / min(moduli)
    stiff = f"one material is {contrast:.3g} times as stiff as another"
    # A box of rubber between blocks 1,000 times as stiff converges in 1,800 evaluations, between
    # blocks 80,000 times as stiff not within 4,500, and with rigid blocks in 970.
    if contrast > 1e4:
        _warn(
            scene,
            f"{stiff}, and equilibrium needs thousands of evaluations, or is not found: use"
            ' material = "rigid" for it, which changes results by less than 0.1 %',
        )
    if not force.has_energy and contrast > MOST_CONTRAST:
        _warn(
            scene,
            f"{stiff}, for which {model} has errors of 2 to 7 %, makes a soft layer of 4 cells"
            " many times too stiff, or finds no equilibrium: use force=bond-energy",
        )
    # A stiff material of more than half the bulk modulus of the soft one yields as much as this
    # does where it is confined.
    confined = [
        (one.shear_modulus, soft.bulk_modulus)
        for one in laws
        for soft in laws
        if YIELDING * soft.shear_modulus < one.shear_modulus < soft.bulk_modulus / 2.0
    ]
    if force.has_energy and scene.plane == "strain" and confined:
        beside = (
            "a material with shear modulus {:.4g} lies next to a softer one with bulk modulus"
            " {:.4g}".format(*confined[0])
        )
        _warn(
            scene,
            f"{beside}, and the softer one is too soft where it is confined (by 6 to 14 % in a"
            " layer of 4 cells, by 3 % in a layer of 8); use a smaller spacing, or material ="
            ' "rigid" for the stiff part',
        )


def _check_rigid_thickness(scene: Scene, cells: float, names: str) -> None:
    """Raise ValueError for rigid regions one cell thick, and warn of thin rigid regions with a
    traction or pressure in the scene.

    Part of a traction or pressure on a thin rigid region acts on the material behind it. `cells` is
    the thickness of the regions in cells, and `names` their names in the messages.
    """
    if cells < 2:
        raise ValueError(
            f"materials: a rigid region ({names}) is only one cell thick, but needs two; use a"
            " smaller spacing"
        )
    if 0 < cells < LEAST_LOADED_CELLS and {load.kind for load in scene.loads} & {
        "traction",
        "pressure",
    }:
        _warn(
            scene,
            f"a rigid region is at most {cells:.0f} cells thick, and part of a traction or"
            " pressure on it acts on the material behind it: its force in the results has errors"
            " of up to 31 % with 2 cells and 20 % with 3, although all forces are in balance;"
            " apply the load as a force on the region, or use a smaller spacing",
        )


@contextmanager
def scene_errors(scene: Scene, key: str = "") -> Iterator[None]:
    """Context that turns every ValueError into a SceneError with the name of the scene, and
    optionally a key, in its message.
    """
    try:
        yield
    except SceneError:
        raise
    except ValueError as error:
        raise SceneError(f"scene {scene.name}: {key}{error}") from None


def checked_models(scene: Scene, model: ForceModel) -> list[ForceModel]:
    """Check the force models of a scene and return them: `model`, then the model of each entry of
    the scene's `materials`.

    `model` is that of the body outside the regions of `materials`. An entry has the model that it
    names; or else `model`, if this describes the entry's law; or else a stored surrogate of the
    entry's law of the same `family` (bond force or bond energy).

    Raises
    ------
    SceneError
        If a model does not describe its material, or cannot honor a setting of the scene, an
        artifact cannot be read or is of another family than `model`, a region is rigid and `model`
        has no energy, or no critical stretch follows from the fracture energy with `model`.
    """
    with scene_errors(scene):
        settings_of(scene).check(model.name, model.honored(scene.plane))
        model.check_material(scene.law())
        for key, criterion in criteria_of(scene).items():
            for name in left_to_artifact(criterion):
                raise ValueError(
                    f"{key}.{name}: neither the force model nor the material is an artifact with"
                    " tests behind it: state a number"
                )
        if criteria_give(scene, "energy"):
            tip_diameters_in(scene, model.family)
    found = [model]
    for number, part in enumerate(scene.materials):
        with scene_errors(scene, f"materials.{number}{'.force' if part.force else ''}: "):
            found.append(_model_of(part, model, scene.plane))
    return found


def _model_of(part: Part, rest: ForceModel, plane: str) -> ForceModel:
    """Return the force model of an entry of `materials`; raise ValueError if it does not fit
    `rest`, the model of the rest.
    """
    if part.material.rigid:
        if rest.family != "bond energy":
            raise ValueError(
                "a rigid region needs a force that defines an energy, such as bond-energy;"
                f" {rest.name} defines none"
            )
        return rest  # not evaluated there
    law = part.material.build()
    if part.force is None:
        try:
            rest.check_material(law)
        except ValueError:
            return artifacts.surrogate_for(law, rest.family, plane)
        return rest
    own = artifacts.load_surrogate(part.force)
    if own.family != rest.family:
        raise ValueError(
            f"{own.name} is a {own.family} model, but {rest.name} of the rest is a {rest.family}"
            " model; use one family"
        )
    own.check_material(law)
    return own


def portions_of(
    scene: Scene, body: Body, models: Sequence[ForceModel], regions: BodyRegions
) -> tuple[list[MaterialPart], dict[str, np.ndarray], np.ndarray]:
    """Assign the points of a body to the materials of a scene: return law, model and points of
    each, rigid regions, and numbers.

    Parameters
    ----------
    scene : Scene
    body : Body
    models : list of ForceModel
        Force model of the body outside the regions of the scene's `materials`, then one for each of
        these.
    regions : BodyRegions

    Returns
    -------
    list of MaterialPart
        Law, force model and points of every deformable material with points: the rest of the body,
        then `materials` in order.
    dict of ndarray
        Points of the rigid regions, by name.
    ndarray of int, shape (n,)
        Number of the material of every point: 0 for the rest of the body, then those of
        `materials`, counted from 1.

    Raises
    ------
    ValueError
        If a region has no point, or two materials contain the same point; the message names them.
    """
    of_points = np.zeros(len(body), dtype=np.int64)
    laws = [
        scene.law(),
        *(None if part.material.rigid else part.material.build() for part in scene.materials),
    ]
    for number, part in enumerate(scene.materials, 1):
        key = f"materials.{number - 1}"
        points = regions.points(part.region, f"{key}.region")
        before = of_points[points]
        # Two rigid regions are two bodies, and materials that break differently are two materials.
        same = [
            not part.material.rigid
            and laws[other] == laws[number]
            and models[other] is models[number]
            and scene.materials[other - 1].fracture == part.fracture
            for other in before
        ]
        error = None
        twice = (before > 0) & ~np.array(same, dtype=bool)
        if twice.any():
            first = before[twice.argmax()] - 1
            where = text_of(body.points[points[twice.argmax()]])
            error = ValueError(
                f"materials.{first} and {key} both contain {int(twice.sum())} points, the first at"
                f" {where}; regions of different materials must not overlap"
            )
        body.share.agree(error)
        of_points[points] = number
    found = {number: np.flatnonzero(of_points == number) for number in range(len(laws))}
    parts = {number: part for number, part in enumerate(scene.materials) if part.material.rigid}
    rigid = {
        label_of_region(part.region, f"materials.{number}"): found[number + 1]
        for number, part in parts.items()
    }
    # All ranks have the same portions.
    kept = [
        number
        for number, law in enumerate(laws)
        if law is not None and body.share.any(len(found[number]) > 0)
    ]
    return (
        [MaterialPart(laws[number], models[number], found[number]) for number in kept],
        rigid,
        of_points,
    )
