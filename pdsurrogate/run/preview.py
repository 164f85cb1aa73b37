"""Picture of a scene before it is run: the body, with regions, prescribed motions, loads, cuts
and probes.
"""

from typing import NamedTuple

import matplotlib
import numpy as np
from matplotlib.artist import Artist
from matplotlib.figure import Figure
from matplotlib.lines import Line2D
from matplotlib.patches import Circle, Patch
from mpl_toolkits.mplot3d.art3d import Poly3DCollection

from ..arguments import check_kind
from ..problem import Problem, compile_scene
from ..problem.materials import scene_errors
from ..results import figures
from ..scenes import Load, Part, Prescribed, Scene
from ..scenes.regions import label_of_region
from ..scenes.shapes import Precut

OBSTACLE = "#8b8f98"
"""Color of obstacles."""

FEW = 8
"""Greatest number of points of a region that are marked by dots as well, since so few cells are
hardly seen.
"""

ARROW = 0.12
"""Length of an arrow divided by the extent of the body. Chosen: long enough to show its direction,
short enough that arrows of neighboring regions stay apart.
"""


class _Mark(NamedTuple):
    """Labeled part of the body in a picture: label, points, color, place of an arrow, and its
    direction, or None without an arrow.
    """

    text: str
    points: np.ndarray
    color: tuple[float, float, float, float]
    place: np.ndarray
    arrow: np.ndarray | None


def preview(scene: Scene) -> Figure:
    """Draw the undeformed body of a scene, its regions colored and named, with arrows for
    displacements and loads.

    A body in three dimensions is shown from outside, and its obstacles are only named.

    Parameters
    ----------
    scene : Scene

    Returns
    -------
    matplotlib.figure.Figure

    Raises
    ------
    SceneError
        If the body cannot be built, a region is empty, or the supports and loads of the body are
        invalid for a run.

    See Also
    --------
    pdsurrogate.load_scene : loads a scene.
    pdsurrogate.simulate : runs a scene.

    Examples
    --------
    >>> import pdsurrogate as pds
    >>> figure = pds.preview(pds.load_scene("ring-pressure", spacing=0.1))
    >>> [text.get_text() for text in figure.legends[0].get_texts()]
    ['east: x2 = 0', 'west: x2 = 0', 'north: x1 = 0', 'south: x1 = 0', 'holes: pressure 1', 'probe']
    """
    check_kind(scene, Scene, "scene", "Scene, such as load_scene gives")
    problem = compile_scene(scene)
    with scene_errors(scene):
        marks = _marks(problem)
    colors = np.tile(matplotlib.colors.to_rgba(figures.PLAIN), (len(problem.body), 1))
    for mark in marks:
        colors[mark.points] = mark.color
    with matplotlib.rc_context(figures.STYLE):
        figure = Figure(figsize=(7.6, 4.6), layout="constrained")
        if scene.dimension == 3:
            axes = figure.add_subplot(projection="3d", computed_zorder=False)
            _in_space(axes, problem, marks, colors)
        else:
            axes = figure.subplots()
            _in_the_plane(axes, problem, marks, colors)
        axes.set_title(
            f"{scene.name}: {len(problem.body):,} points, spacing"
            f" {scene.units.amount(problem.body.spacing, 'length', '.4g')}"
        )
        handles: list[Artist] = [Patch(color=mark.color, label=mark.text) for mark in marks]
        handles += [Line2D([], [], color="black", lw=2, label="cut")] if scene.precuts else []
        handles += (
            [Line2D([], [], color="black", marker="x", ls="", label="probe")]
            if scene.probes
            else []
        )
        handles += [
            Patch(color=OBSTACLE, label=f"{one.name}: obstacle")
            for one in problem.loading.loads.obstacles
        ]
        if handles:
            figure.legend(handles=handles, loc="outside right upper", frameon=False)
    return figure


def _marks(problem: Problem) -> list[_Mark]:
    """Return the labeled parts of the body in the order of drawing: materials, regions,
    prescribed motions and loads.
    """
    scene = problem.scene
    regions = problem.regions
    found: list[tuple[str, np.ndarray, np.ndarray | None]] = []
    for number, part in enumerate(scene.materials):
        key = f"materials.{number}"
        found.append(
            (
                f"{label_of_region(part.region, key)}: {part.material.law}",
                regions.points(part.region, f"{key}.region"),
                None,
            )
        )
    entries: tuple[Part | Prescribed | Load, ...] = (
        *scene.materials,
        *scene.prescribed,
        *scene.loads,
    )
    used = {entry.region for entry in entries if isinstance(entry.region, str)}
    found += [(name, regions.points(name), None) for name in scene.regions if name not in used]
    for one in problem.prescriptions:
        found.append(
            (
                f"{one.holder or one.key}: {one.words}",
                regions.points(one.region, one.key),
                one.displacement,
            )
        )
    for number, load in enumerate(scene.loads):
        value = np.array(getattr(load, load.kind))
        label = load.name or label_of_region(load.region, f"loads.{number}")
        size = ", ".join(f"{component:g}" for component in np.atleast_1d(value))
        points = (
            regions.points(load.region) if load.kind != "body_force" else np.zeros(0, dtype=int)
        )
        found.append(
            (
                f"{label}: {load.kind.replace('_', ' ')} {f'({size})' if value.ndim else size}",
                points,
                value if value.ndim else None,
            )
        )
    palette = matplotlib.colormaps["tab10"]
    middle = (regions.lower + regions.upper) / 2
    marks = []
    for number, (text, points, vector) in enumerate(found):
        place = problem.body.points[points].mean(axis=0) if len(points) else middle
        arrow = vector / np.linalg.norm(vector) if vector is not None and vector.any() else None
        marks.append(_Mark(text, points, palette(number % 10), place, arrow))
    return marks


def _in_the_plane(axes, problem: Problem, marks: list[_Mark], colors: np.ndarray) -> None:
    """Draw a sheet: its cells in given colors, with arrows of the labeled parts, cuts and
    probes.
    """
    scene = problem.scene
    body = problem.body
    nodes = problem.body.cells.nodes
    low = nodes.min(axis=0)
    high = nodes.max(axis=0)
    extent = (high - low).max()
    figures.draw_mesh(axes, body.cells, colors)
    for cut in (cut for cut in scene.precuts if isinstance(cut, Precut)):
        axes.plot(*zip(cut.start, cut.end, strict=True), color="black", lw=2)
    for mark in marks:
        if 0 < len(mark.points) <= FEW:
            axes.plot(*body.points[mark.points].T, "o", color=mark.color, ms=5)
        if mark.arrow is not None:
            arrow = {"arrowstyle": "-|>", "color": mark.color, "lw": 1.5, "ec": "black"}
            axes.annotate(
                "", mark.place + ARROW * extent * mark.arrow, tuple(mark.place), arrowprops=arrow
            )
    for obstacle in scene.obstacles:
        if (flat := obstacle.half_plane) is not None:
            axes.axline(
                flat.point,
                (flat.point[0] - flat.normal[1], flat.point[1] + flat.normal[0]),
                color=OBSTACLE,
                lw=3,
            )
        elif obstacle.disc is not None:
            axes.add_patch(Circle(obstacle.disc.center, obstacle.disc.radius, color=OBSTACLE))
    for probe in scene.probes:
        axes.plot(*probe.at, "x", color="black", ms=6)
        axes.text(*probe.at, f" {probe.name}")
    room = 1.25 * ARROW * extent
    axes.set(xlim=(low[0] - room, high[0] + room), ylim=(low[1] - room, high[1] + room))
    xlabel, ylabel = (scene.units.label(place, "length") for place in figures.PLACES[:2])
    axes.set(aspect="equal", xlabel=xlabel, ylabel=ylabel)


def _in_space(axes, problem: Problem, marks: list[_Mark], colors: np.ndarray) -> None:
    """Draw a solid from outside: its cells in given colors, with arrows of the labeled parts, cuts
    and probes.
    """
    scene = problem.scene
    body = problem.body
    nodes = problem.body.cells.nodes
    low = nodes.min(axis=0)
    high = nodes.max(axis=0)
    places = [scene.units.label(place, "length") for place in figures.PLACES]
    of_sides = colors[body.cells.outer_sides[1]]
    figures.draw_outside(axes, body.cells, nodes, of_sides, np.array([low, high]), places)
    for mark in marks:
        if mark.arrow is not None:
            axes.quiver(
                *mark.place,
                *(2 * ARROW * (high - low).max() * mark.arrow),
                color=mark.color,
                lw=2,
                zorder=5,
            )
    for cut in (cut for cut in scene.precuts if not isinstance(cut, Precut)):
        axes.add_collection3d(
            Poly3DCollection(
                [cut.edge(0.05 * (high - low).max())[0]],
                facecolors=(0, 0, 0, 0.25),
                edgecolors="black",
                zorder=6,
            )
        )
    for probe in scene.probes:
        axes.plot(*([value] for value in probe.at), "x", color="black", ms=6, zorder=7)
        axes.text(*probe.at, f" {probe.name}", zorder=8)
