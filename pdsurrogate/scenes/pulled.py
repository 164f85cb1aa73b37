"""Region that a scene pulls."""

import numpy as np

from .model import Grip
from .regions import EDGES, label_of_region
from .scene import Scene


def pulled_grip(scene: Scene) -> Grip:
    """Return the grip of a scene that moves farthest, the one at the upper end if two do."""
    return max(scene.grips, key=lambda grip: (grip.travel, EDGES[grip.edge][1]))


def pulled_force(scene: Scene) -> tuple[str, float]:
    """Return the dotted key of the force of the region that a scene pulls farthest, and the sign
    with which it is positive in tension.
    """
    if scene.stretched:
        edge = pulled_grip(scene).edge
        axis, side = EDGES[edge]
        return f"forces.{edge}.{axis}", float(side)
    entries = [
        (abs(value), value, axis, entry)
        for entry in scene.prescribed
        for axis, value in enumerate(entry.displacement)
        if value
    ]
    if not entries:
        raise ValueError(
            f"scene {scene.name} pulls no region: name what was measured instead of its force, as"
            " outputs=['energy']"
        )
    _, value, axis, entry = max(entries, key=lambda one: one[0])
    name = entry.name or label_of_region(entry.region, "")
    if not name:
        raise ValueError(
            f"scene {scene.name}: give the prescribed region a name (prescribed.name), by which its"
            " force is reported"
        )
    return f"forces.{name}.{axis}", float(np.sign(value))
