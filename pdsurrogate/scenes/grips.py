"""Grips and holds of a scene as entries of `prescribed`, so that all that reads a scene knows
one way in which bodies are held.
"""

from .loading import Prescribed
from .regions import EDGES, Region
from .scene import Scene


def prescribed_in(scene: Scene, length: float = 1.0) -> dict[str, Prescribed]:
    """Return what a scene prescribes by key, in the order in which entries take effect: holds, then
    grips, then `prescribed`.

    Grips and holds are prescribed displacements with the amplitude ``ramp`` of the elongation,
    stretch - 1; `length` is that of the body along the loaded axis, by which their `travel` is
    multiplied.
    """
    found = {}
    names = ("x1", "x2", "x3")[: scene.dimension]
    for number, hold in enumerate(scene.holds):
        travel = hold.travel or (0.0,) * scene.dimension
        moved = {
            name: length * along
            for name, along in zip(names, travel, strict=True)
            if name in (hold.components or names)
        }
        # it may list no points, and is refused where it is resolved
        region = Region.model_construct(box=hold.box, points=hold.points)
        found[f"holds.{number}"] = Prescribed(region=region, **moved)
    for number, grip in enumerate(scene.grips):
        axis, side = EDGES[grip.edge]
        moved = {name: 0.0 for name in names if grip.holds == "all"} | {
            names[axis]: length * side * grip.travel
        }
        found[f"grips.{number}"] = Prescribed(region=grip.edge, **moved)
    return found | {f"prescribed.{number}": entry for number, entry in enumerate(scene.prescribed)}
