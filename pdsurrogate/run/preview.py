"""A scene before it is run: its body, and on it regions, grips, loads, cuts and probes."""

from __future__ import annotations

from dataclasses import dataclass

import matplotlib
import numpy as np
from matplotlib.collections import LineCollection, PolyCollection
from matplotlib.figure import Figure
from matplotlib.layout_engine import ConstrainedLayoutEngine
from matplotlib.lines import Line2D
from matplotlib.patches import Patch
from mpl_toolkits.mplot3d.art3d import Poly3DCollection
from scipy.spatial import cKDTree

from ..arguments import check_is
from ..body import Body
from ..problem import compile_scene
from ..problem.prescriptions import region_of_hold
from ..problem.problem import scene_errors
from ..problem.regions import BodyRegions
from ..results import figures, views
from ..scenes import Scene
from ..scenes.model import EDGES
from ..scenes.shapes import Precut
from ..scenes.solids import DiscCut, ParallelogramCut

PLAIN, MOST_CELLS_WITH_EDGES = "#d9dde3", 4000
FEW = 8
"""Points of a region that are shown by dots, since their cells are hardly seen."""

SIGHT, WITHIN = 0.75, 0.6
"""Cells from a place, towards the eye, from which it is looked whether points lie in between, and from a point that is its own: over a side
that faces the eye the first place of the way is 0.77 cells and more from the nearest point, half a cell beneath it."""

ARROW = 0.12
"""Length of an arrow over the extent of the body."""


@dataclass(frozen=True)
class _Mark:
    """A part of the body that something is said of: what, its points, and the direction that it moves or is pulled in."""

    text: str
    points: np.ndarray
    arrow: np.ndarray | None = None


def preview(scene: Scene) -> Figure:
    """Figure of the undeformed body of a scene, its regions coloured and named, with arrows of displacements and loads.

    A body in space is shown from outside.

    Parameters
    ----------
    scene : Scene

    Returns
    -------
    matplotlib.figure.Figure

    Raises
    ------
    SceneError
        If the body cannot be built, a region is empty, or a run would refuse how the body is held and loaded.

    Examples
    --------
    >>> import pdsurrogate as pds
    >>> figure = pds.preview(pds.load_scene("ring-pressure", spacing=0.1))
    >>> [text.get_text() for text in figure.legends[0].get_texts()]
    ['east: x2 = 0', 'west: x2 = 0', 'north: x1 = 0', 'south: x1 = 0', 'holes: pressure 1', 'probe']
    """
    check_is(scene, Scene, "scene", "load_scene gives")
    problem = compile_scene(scene)
    body, regions = problem.body, problem.regions
    with scene_errors(scene):
        marks = _marks(scene, body, regions)
    with matplotlib.rc_context(figures.STYLE):
        if scene.dimension == 3:
            return _in_space(scene, body, marks)
        return _in_the_plane(scene, body, marks, _outline(regions))


def _outline(regions: BodyRegions) -> np.ndarray:
    """Ends of the pieces of the boundary, shape (k, 2, 2); none of a body whose boundary only a load would need, and that has none."""
    try:
        surface = regions.surface()
    except ValueError:
        return np.zeros((0, 2, 2))
    return surface.nodes[surface.facets]


def _marks(scene: Scene, body: Body, regions: BodyRegions) -> list[_Mark]:
    """Return the labelled parts of the body, larger ones first, since later ones are drawn over them."""
    marks = [
        _Mark(f"{regions.label(part.region, key)}: {part.material.law}", regions.points(part.region, f"{key}.region"))
        for key, part in ((f"materials.{number}", part) for number, part in enumerate(scene.materials))
    ]
    spoken = {entry.region for entry in (*scene.materials, *scene.prescribed, *scene.loads) if isinstance(entry.region, str)}
    marks += [_Mark(name, regions.points(name)) for name in scene.regions if name not in spoken]
    for grip in scene.grips:
        axis, side = EDGES[grip.edge]
        arrow = side * np.eye(body.dimension)[axis] if grip.travel else None
        how = "grip" if grip.holds == "all" else "roller"
        marks.append(_Mark(f"{grip.edge}: {how}", regions.points(grip.edge, "grips"), arrow))
    for number, hold in enumerate(scene.holds):
        held = "all" if hold.components is None else ", ".join(hold.components)
        marks.append(_Mark(f"holds.{number}: {held}", regions.points(region_of_hold(hold), f"holds.{number}")))
    for number, entry in enumerate(scene.prescribed):
        given = {f"x{axis}": value for axis, value in enumerate(entry.displacement, 1) if value is not None}
        told = [f"{key} = {value:g}" for key, value in given.items()]
        told += [] if entry.rotation is None else [f"turned by {entry.rotation:g} degrees"]
        vector = np.array([value or 0.0 for value in entry.displacement[: body.dimension]])
        label = entry.name or regions.label(entry.region, f"prescribed.{number}")
        marks.append(_Mark(f"{label}: {', '.join(told)}", regions.points(entry.region), vector if vector.any() else None))
    for number, load in enumerate(scene.loads):
        value = getattr(load, load.kind)
        told = f"{value:g}" if load.kind == "pressure" else f"({', '.join(f'{component:g}' for component in value)})"
        label = load.name or regions.label(load.region, f"loads.{number}")
        arrow = None if load.kind == "pressure" else np.array(value)
        points = regions.points(load.region) if load.kind != "body_force" else np.zeros(0, dtype=int)
        marks.append(_Mark(f"{label}: {load.kind.replace('_', ' ')} {told}", points, arrow))
    return marks


def _colours(body: Body, marks: list[_Mark]) -> tuple[np.ndarray, list]:
    """Colour of every cell, and of every mark."""
    palette = matplotlib.colormaps["tab10"]
    of_marks = [palette(number % 10) for number in range(len(marks))]
    colours = np.tile(matplotlib.colors.to_rgba(PLAIN), (len(body), 1))
    for mark, colour in zip(marks, of_marks, strict=True):
        colours[mark.points] = colour
    return colours, of_marks


def _legend(figure: Figure, scene: Scene, marks: list[_Mark], colours: list) -> None:
    handles = [Patch(color=colour, label=mark.text) for mark, colour in zip(marks, colours, strict=True)]
    handles += [Line2D([], [], color="black", lw=2, label="cut")] if scene.precuts else []
    handles += [Line2D([], [], color="black", marker="x", ls="", label="probe")] if scene.probes else []
    if handles:
        figure.legend(handles=handles, loc="outside right upper", frameon=False)


def _in_the_plane(scene: Scene, body: Body, marks: list[_Mark], outline: np.ndarray) -> Figure:
    polygons = figures.polygons_of(body.cells, np.zeros_like(body.cells.nodes))
    low, high = polygons.min(axis=(0, 1)), polygons.max(axis=(0, 1))
    extent = (high - low).max()
    size = (high - low) / extent * 5.0
    figure = Figure(figsize=(size[0] + 2.6, max(size[1] + 0.8, 1.6)), layout=ConstrainedLayoutEngine(w_pad=0.15))
    axis = figure.subplots()
    colours, of_marks = _colours(body, marks)
    edges = {"edgecolors": "white", "linewidths": 0.3} if len(body) <= MOST_CELLS_WITH_EDGES else {"edgecolors": "face", "linewidths": 0.2}
    axis.add_collection(PolyCollection(polygons, facecolors=colours, **edges))
    axis.add_collection(LineCollection(outline, colors="#555555", linewidths=0.8))
    for cut in scene.precuts:
        if isinstance(cut, Precut):
            axis.plot(*zip(cut.start, cut.end, strict=True), color="black", lw=2)
    middle = (low + high) / 2
    for mark, colour in zip(marks, of_marks, strict=True):
        if 0 < len(mark.points) <= FEW:
            axis.plot(*body.points[mark.points].T, "o", color=colour, ms=5)
        if mark.arrow is not None:
            begin = body.points[mark.points].mean(axis=0) if len(mark.points) else middle
            along = mark.arrow / np.linalg.norm(mark.arrow) * ARROW * extent
            axis.annotate("", begin + along, begin, arrowprops={"arrowstyle": "-|>", "color": colour, "lw": 1.5, "ec": "black"})
    for probe in scene.probes:
        axis.plot(*probe.at, "x", color="black", ms=6)
        axis.annotate(probe.name, probe.at, xytext=(4, 4), textcoords="offset points")
    room = 1.25 * ARROW * extent if any(mark.arrow is not None for mark in marks) else 0.03 * extent
    axis.set(xlim=(low[0] - room, high[0] + room), ylim=(low[1] - room, high[1] + room), aspect="equal")
    _name_axes(axis, scene)
    axis.set_title(_title(scene, body))
    _legend(figure, scene, marks, of_marks)
    return figure


def _in_space(scene: Scene, body: Body, marks: list[_Mark]) -> Figure:
    cells, nodes = body.cells, body.cells.nodes
    colours, of_marks = _colours(body, marks)
    low, high = nodes.min(axis=0), nodes.max(axis=0)
    figure = Figure(figsize=(7.6, 4.6), layout="constrained")
    axes = figure.add_subplot(projection="3d", computed_zorder=False)
    views.draw_outside(axes, cells, nodes, colours)
    extent = (high - low).max()
    for mark, colour in zip(marks, of_marks, strict=True):
        if mark.arrow is not None:
            begin = body.points[mark.points].mean(axis=0) if len(mark.points) else (low + high) / 2
            along = mark.arrow / np.linalg.norm(mark.arrow) * 2 * ARROW * extent
            axes.quiver(*begin, *along, color=colour, lw=2, zorder=5)
    for cut in scene.precuts:
        axes.add_collection3d(Poly3DCollection([_rim(cut)], facecolors=(0, 0, 0, 0.25), edgecolors="black", zorder=6))
    tree, reach = cKDTree(body.points), np.linalg.norm(high - low)
    for probe in scene.probes:
        hidden = _hidden(np.array(probe.at), tree, body.cell.min(), reach)
        axes.plot(*([value] for value in probe.at), "x", color="black", ms=6, zorder=7, alpha=0.35 if hidden else 1)
        axes.text(*probe.at, f" {probe.name}{' (hidden)' if hidden else ''}", zorder=8, alpha=0.6 if hidden else 1)
    axes.set(xlim=(low[0], high[0]), ylim=(low[1], high[1]), zlim=(low[2], high[2]))
    axes.set_box_aspect(high - low, zoom=0.95)
    axes.set_axis_on()
    lengths = [
        f"x{number}: {scene.units.amount(f'{one:.4g} to {other:.4g}', 'length')}"
        for number, (one, other) in enumerate(zip(low, high, strict=True), 1)
    ]
    axes.set(xticks=[], yticks=[], zticks=[], xlabel=lengths[0], ylabel=lengths[1], zlabel=lengths[2])
    for each in (axes.xaxis, axes.yaxis, axes.zaxis):
        each.labelpad = -5  # there are no ticks between it and the axis
    axes.set_title(_title(scene, body))
    _legend(figure, scene, marks, of_marks)
    return figure


def _hidden(place: np.ndarray, points: cKDTree, cell: float, reach: float) -> bool:
    """Return whether a place lies inside the body or on its far side: whether points lie between it and the eye."""
    way = np.arange(SIGHT, reach / cell, SIGHT / 2)[:, None] * cell * views.EYE
    return bool((points.query(place + way)[0] < WITHIN * cell).any())


def _rim(cut: ParallelogramCut | DiscCut) -> np.ndarray:
    """Return the corners of a cut of a solid, shape (k, 3)."""
    if isinstance(cut, ParallelogramCut):
        one, other = map(np.array, cut.sides)
        return np.array(cut.corner) + np.array([0 * one, one, one + other, other])
    _, normal, _ = cut.plane()
    across = np.cross(normal, np.eye(3)[int(np.argmin(np.abs(normal)))])
    across /= np.linalg.norm(across)
    angles = np.linspace(0, 2 * np.pi, 40, endpoint=False)[:, None]
    return np.array(cut.centre) + cut.radius * (np.cos(angles) * across + np.sin(angles) * np.cross(normal, across))


def _name_axes(axis, scene: Scene) -> None:
    axis.set(xlabel=scene.units.label("x1", "length"), ylabel=scene.units.label("x2", "length"))


def _title(scene: Scene, body: Body) -> str:
    return f"{scene.name}: {len(body):,} points, spacing {scene.units.amount(body.spacing, 'length', 'g')}"
