"""Loading curve of a run with steps: what loads the body, and how it answers."""

from collections.abc import Sequence
from typing import Any, NamedTuple

import numpy as np

from ..scenes import Load, Obstacle, Prescribed, Scene
from ..scenes.amplitudes import amplitude_of
from ..scenes.model import with_unit
from ..scenes.regions import label_of_region
from .figures import PLACES

SHOWN_SHARE = 1e-3
"""Size of a force component, divided by that of the greatest component, above which it is drawn or
printed. Chosen: smaller ones may be residuals, which an equilibrium leaves up to a thousandth of
the forces that drive the body.
"""

NEGLIGIBLE = 1e-4
"""Force or torque, divided by the shear modulus and the volume, above which a curve is told from
zero.
"""


Curves = tuple[dict[str, np.ndarray], str, str]
"""Curves by name, what they show, and the kind of its unit."""


MOVING = Prescribed, Obstacle
"""Entries of a scene that move what they touch, and with which results report a force."""


class _Cause(NamedTuple):
    """Prescribed motion, obstacle or load: its entry in the scene, its name, what it is, with
    its unit, and its size at amplitude 1.
    """

    entry: Any
    name: str
    label: str
    size: float


def loading_curve(
    scene: Scene, history: Sequence[dict]
) -> tuple[list[float], dict[str, np.ndarray], str, str]:
    """Return abscissae, curves by name and the labels of both axes, from the rows of a run's
    history.

    They are force over prescribed displacement, torque over angle, or motion over load.

    The motion under loads is that of the probes, in a pressed hole their distance from its center,
    or without probes the mean displacement where the loads act. Motions or loads that do not go
    together are shown over the loading parameter t. Forces of less than `SHOWN_SHARE` of the
    greatest, and the lesser of two opposite ones, are left out.
    """
    rows = [{"t": 0.0}, *(row for row in history if any(key.startswith("force_") for key in row))]
    entries = {"prescribed": scene.prescribed, "obstacles": scene.obstacles, "loads": scene.loads}
    every = [
        _cause(scene, entry, f"{key}.{n}")
        for key, of_key in entries.items()
        for n, entry in enumerate(of_key)
    ]
    causes = [cause for cause in every if cause.size]
    x, xlabel = [row["t"] for row in rows], "loading parameter t"
    if len({(cause.label, abs(cause.size), cause.entry.amplitude) for cause in causes}) == 1:
        factor, xlabel = amplitude_of(causes[-1].entry.amplitude), causes[-1].label
        x = [causes[-1].size * factor(t) for t in x]
    if any(isinstance(cause.entry, MOVING) for cause in causes) or not causes:
        found, what, kind = _reactions(
            scene, rows, [cause for cause in causes or every if isinstance(cause.entry, MOVING)]
        )
    else:
        found, what, kind = _motions(scene, rows, causes)
    greatest, shown = max(np.abs(values).max() for values in found.values()), {}
    for name, values in sorted(found.items(), key=lambda item: -item[1].sum()):
        size = np.abs(values).max()
        if size >= SHOWN_SHARE * greatest and all(
            np.abs(values + other).max() > SHOWN_SHARE * size for other in shown.values()
        ):
            shown[name] = values
    shown = {name: values for name, values in found.items() if name in shown}
    what = what.split()[0] if len(shown) > 1 else f"{what} {next(iter(shown))}"
    return x, shown, xlabel, scene.units.label(what, kind)


def _cause(scene: Scene, entry: Prescribed | Obstacle | Load, key: str) -> _Cause:
    """Return what an entry of a scene, with the given key, does to the body; its size is 0 if it
    holds a region at rest.
    """
    units, name = (
        scene.units,
        entry.name or (key if isinstance(entry, Obstacle) else label_of_region(entry.region, key)),
    )
    if _turns(entry):
        return _Cause(entry, name, "angle (°)", entry.rotation)
    if isinstance(entry, MOVING):
        moved = max((value or 0.0 for value in (entry.x1, entry.x2, entry.x3)), key=abs)
        return _Cause(entry, name, units.label("prescribed displacement", "length"), moved)
    value, gradient = getattr(entry, entry.kind), units.force and f"{units.stress}/{units.length}"
    unit = {"force": units.force, "body_force": gradient}.get(entry.kind, units.stress)
    size = float(value) if entry.kind == "pressure" else float(np.linalg.norm(value))
    return _Cause(entry, name, with_unit(entry.kind.replace("_", " "), unit), size)


def _turns(entry: Prescribed | Obstacle | Load) -> bool:
    """Return whether an entry of a scene prescribes a rotation other than 0."""
    return isinstance(entry, Prescribed) and bool(entry.rotation)


def _reactions(scene: Scene, rows: Sequence[dict], causes: Sequence[_Cause]) -> Curves:
    """Return the torques on turned regions, or the force components on moved ones."""
    found, turned = {}, [cause for cause in causes if _turns(cause.entry)]
    for entry, name, *_ in turned or causes:
        force = _components(rows, f"force_{name}", scene.dimension)
        if not turned:
            found |= {
                f"{name}, {place}": values for place, values in zip(PLACES, force.T, strict=False)
            }
        elif scene.dimension == 2:
            moment = [row.get(f"moment_{name}", 0.0) for row in rows]
            found[name] = moment - entry.about[0] * force[:, 1] + entry.about[1] * force[:, 0]
        else:
            about = _components(rows, f"moment_{name}", 3) - np.cross(entry.about, force)
            found[name] = about @ entry.axis / np.linalg.norm(entry.axis)
    return (found, "torque on", "energy") if turned else (found, "force on", "force")


def _motions(scene: Scene, rows: Sequence[dict], causes: Sequence[_Cause]) -> Curves:
    """Return how far probes, or the regions of loads, have moved, or how far probes lie from the
    center of a pressed hole.
    """
    entry, names = causes[0].entry, [f"displacement_{cause.name}" for cause in causes]
    if not scene.probes:
        moved = {
            cause.name: _components(rows, name, scene.dimension)
            for cause, name in zip(causes, names, strict=True)
        }
        return (
            {name: np.linalg.norm(vectors, axis=1) for name, vectors in moved.items()},
            "displacement of",
            "length",
        )
    in_hole = [entry.kind, len(causes), len(scene.holes)] == ["pressure", 1, 1] and str(
        entry.region
    ).startswith("holes")
    center, found = getattr(scene.holes[0], "center", None) if in_hole else None, {}
    for probe in scene.probes:
        moved = _components(rows, f"{probe.name}_displacement", scene.dimension)
        found[probe.name] = np.linalg.norm(
            moved if center is None else moved + np.array(probe.at) - center, axis=1
        )
    return found, "displacement of" if center is None else "radius at", "length"


def _components(rows: Sequence[dict], column: str, dimension: int) -> np.ndarray:
    """Return the components of a vector in the rows of a history, shape (rows, d); zero in rows
    without them.
    """
    return np.array(
        [
            [row.get(f"{column}_{component}", 0.0) for component in range(1, dimension + 1)]
            for row in rows
        ]
    )
