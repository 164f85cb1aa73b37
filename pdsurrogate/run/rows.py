"""Measurements at an output: its row in the summary's list ``levels``, and the columns of the
history table.
"""

import numpy as np
import scipy

from ..body import Body
from ..forces import released_by
from ..problem.fronts import Front
from ..results import measures
from ..solvers.reactions import Reactions, internal_forces, support_moments, support_reactions
from .run import Run

CLOSED = 0.5
"""Overlap of the faces of a cut from which they count as touching, in spacings times the strain
beside them. Chosen: a cut along the load of a strip, which stays as it is, changes by 0.16, one of
12 spacings across the load by 17.
"""

ROUNDING = 1e-9
"""Strain of an undeformed body, by rounding."""


def forces_by_name(run: Run, reactions: Reactions) -> dict[str, np.ndarray]:
    """Return, by name, the force (d,) of every support and load in the state last evaluated, in
    the plane per unit thickness.
    """
    return _with_loads(
        run.loading.names,
        reactions.forces,
        run.loads.by_name(run.positions, run.loaded.thickness()),
    )


def moments_by_name(run: Run, reactions: Reactions) -> dict[str, list | float]:
    """Return, by name, the moment of every support and load about the origin.

    The moment is one number, counter-clockwise, in the plane, and a list of three numbers in three
    dimensions.
    """
    loads = run.loads.moments(run.positions, np.zeros(run.body.dimension), run.loaded.thickness())
    found = _with_loads(
        run.loading.names, support_moments(run.loading, run.loaded, reactions), loads
    )
    return {name: moment.tolist() for name, moment in found.items()}


def displacements_by_name(run: Run) -> dict[str, np.ndarray]:
    """Return, by name, the mean displacement (d,) of each support and load, at the present
    positions.

    It is that of `Loading.displacements` for supports, and of `Loads.displacements`, weighted such
    that force times displacement is work.
    """
    found = dict(
        zip(
            run.loading.names,
            run.loading.displacements(run.state.parameter, run.positions),
            strict=True,
        )
    )
    return run.loads.displacements(run.positions) | found


def _with_loads(
    names: tuple[str, ...], values: np.ndarray, loads: dict[str, np.ndarray]
) -> dict[str, np.ndarray]:
    """Return the values of supports and loads by name; those of a support and a load with one
    name are added.
    """
    found = dict(zip(names, values, strict=True))
    for name, value in loads.items():
        found[name] = found.get(name, 0.0) + value
    return found


def contact_by_name(run: Run) -> dict[str, dict[str, float]]:
    """Return, by name, the area in contact with each obstacle, in the plane its length, and the
    greatest penetration.
    """
    return {one.name: one.contact(run.positions) for one in run.loads.obstacles}


def place_columns(run: Run, time: float | None = None) -> dict:
    """Return the first columns of a row of the history: stage, loading parameter, number of
    force evaluations, and time if it has one.
    """
    row = {
        "step": run.state.stage,
        run.loading.parameter: run.state.parameter,
        "evaluations": run.force.evaluations,
    }
    return row if time is None else row | {"time": time}


def state_columns(run: Run) -> dict[str, float]:
    """Return the last columns of a row of the history: displacements at probes, and mean
    displacements where supports and loads act.
    """
    found = component_columns("displacement", displacements_by_name(run)) | run.probes.columns(
        run.positions - run.body.points, run.loads.planes_moved
    )
    for name, contact in contact_by_name(run).items():
        found |= {f"contact_{kind}_{name}": value for kind, value in contact.items()}
    return found


def equilibrium_columns(run: Run, level: dict) -> dict:
    """Return the row of the history at an output in equilibrium, given `level`, the measurements
    from `output_row`.
    """
    row = place_columns(run, level.get("time"))
    if "nominal_stress" in level:
        row["nominal_stress"] = level["nominal_stress"]
    row |= {"strain_energy": run.strain_energy()} | dissipated_columns(run)
    row |= component_columns("force", level["forces"]) | component_columns(
        "moment", level.get("moments", {})
    )
    for name, region in level.get("rigid", {}).items():
        for kind in ("force", "moment"):
            row |= component_columns(kind, {f"{name}_rigid": region[kind]})
    return row | state_columns(run)


def dissipated_columns(run: Run) -> dict[str, float]:
    """Return the columns of a row of the history about energy that the materials have dissipated
    since the body was at rest; none if they have no memory.
    """
    return {f"dissipated_by_{cause}": value for cause, value in run.dissipated_energy().items()}


def component_columns(kind: str, values: dict[str, np.ndarray | list | float]) -> dict[str, float]:
    """Return the values of a quantity by name as columns of the history, one for each component
    of a vector, called KIND_NAME_COMPONENT.
    """
    columns = {}
    for name, value in values.items():
        numbers = np.atleast_1d(value)
        places = (
            [f"_{component}" for component in range(1, len(numbers) + 1)]
            if np.ndim(value)
            else [""]
        )
        columns |= {
            f"{kind}_{name}{place}": float(number)
            for place, number in zip(places, numbers, strict=True)
        }
    return columns


def output_row(
    run: Run, time: float | None = None, drive: float | None = None, costly: bool = True
) -> dict:
    """Return the measurements at an output, a row of ``summary["levels"]``: stress, forces,
    moments, displacements, energy and probes.

    Parameters
    ----------
    run : Run
        Run with the force last evaluated at the present positions.
    time : float, optional
        Time since the dynamics began; None in equilibrium.
    drive : float, optional
        Sum of the magnitudes of the loads or of the reactions (`Equilibrium.drive`), by which the
        force balance is divided.
    costly : bool
        Whether to take the measurements that need stresses, or sums over all bonds of the body: the
        work-conjugate stress, moments, stability, lateral contraction, cracks and probes.
    """
    reactions = support_reactions(run.loading, run.loaded)
    declared = run.problem.measures
    row: dict = {run.loading.parameter: run.state.parameter}
    if declared.nominal_stress is None:
        row["step"] = run.state.stage
    else:
        stress = declared.nominal_stress
        row |= {
            "nominal_stress": stress.of(reactions.forces),
            "nominal_stress_grip": stress.edge,
            "nominal_stress_area": stress.area,
        }
        if costly:
            row["nominal_stress_work_conjugate"] = float(
                run.body.share.total(run.force.mean_stress())[stress.axis, stress.axis]
            )
    if time is None:
        row["force_balance"] = force_balance(run, reactions, drive)
    else:
        row["time"] = time
    row["forces"] = {name: force.tolist() for name, force in forces_by_name(run, reactions).items()}
    if declared.nominal_stress is None and costly:
        row["moments"] = moments_by_name(run, reactions)
    row["displacements"] = {
        name: displacement.tolist() for name, displacement in displacements_by_name(run).items()
    }
    if run.loads.obstacles:
        row["contact"] = contact_by_name(run)
    if run.force.has_energy:
        row["energy"] = run.strain_energy()
        if dissipated := run.dissipated_energy():
            row["dissipated_energy"] = dissipated
    if regions := run.loaded.rigid:
        internal = internal_forces(run.force)
        row["rigid"] = {region.name: region.describe(run.positions, internal) for region in regions}
    if time is None and costly:
        # A pull that rounding of the residual may show is no push.
        least = (
            run.problem.scene.solver.tolerance
            * run.problem.law.shear_modulus
            * min(run.problem.measures.areas.values(), default=0.0)
        )
        if run.loading.course.pushes(run.loaded, least):
            row["stability"] = "checked" if run.loaded.has_energy else "not checked"
        if declared.lateral is not None:
            displacements = run.body.share.gather(run.positions - run.body.points)
            box = np.array(run.problem.scene.body.bounds())
            row |= run.ranks.to_all(
                None
                if displacements is None
                else _lateral(run.problem.whole, displacements, declared.lateral, box)
            )
    if run.measures_cracks and costly:
        row["cracks"] = crack_rows(run)
    if len(run.probes) and costly:
        state = measures.PointState(run.force, run.positions)
        row["probes"] = run.probes.read(state, run.loads.planes_moved)
    for key, reference in declared.reference(run.state.parameter).items():
        if key in row:
            row[f"{key}_reference"] = float(reference)
            row[f"{key}_error"] = float(row[key] / reference - 1) if reference else None
    return row


def crack_rows(run: Run) -> list[dict]:
    """Return tip, length and energy release rate of every crack that grows from a precut, theory
    (74), (75), in the state last evaluated.

    A rate is None if there is no room for its domain, or the body has several materials, branches
    or softening; `remark` then says why. ``closed`` tells whether the faces of the precut overlap.
    """
    body = run.body
    force = run.force
    found = run.problem.fronts
    fronts = found.after(
        [output["tips"] for output in run.state.crack["tips"]] if run.state.crack else []
    )
    rows = []
    loads = run.loaded.applied() * body.share.own[:, None]
    F = force.deformation_gradients().copy()
    for front in fronts:
        reach = None
        rate = None
        remark = "the body has several materials"
        if force.history:
            remark = "the material has branches or softening, which dissipate energy around a crack"
        elif force.portion_of is None:
            reach, remark = found.reach(front, fronts, _nearest(run, front, loads))
        if reach is not None:
            motion = front.motion(body.points, reach)
            work = np.einsum("ni,nij,nj->", loads, F, motion)
            rate = body.share.total(float(released_by(force, motion) - work)) / front.extent
        row = {
            "tip": front.path[-1].tolist(),
            "length": front.length,
            "energy_release_rate": rate,
            "reach": reach,
            "remark": remark,
        }
        rows.append(row | {"closed": _closed(run, front, F)})
    return rows


def _nearest(run: Run, front: Front, loads: np.ndarray) -> dict[str, float]:
    """Return how near to a front the held points come, and points under other `loads` (n, d) per
    volume than its surroundings.

    The motion (75) must not move them: a body force moves with its material, a support or a load on
    a region does not.
    """
    body = run.body
    share = run.body.share
    distances = np.where(
        share.own, scipy.spatial.cKDTree(front.places).query(body.points)[0], np.inf
    )
    density = loads / body.volumes[:, None]
    here = int(distances.argmin())
    _, around = min(share.everywhere((float(distances[here]), density[here].tolist())))
    varies = np.abs(density - around).max(axis=1) > ROUNDING * share.greatest(
        float(np.abs(density).max())
    )
    points = {"a point under a load": varies}
    for part in run.loading.held:
        if part.plane is None:
            held = points.setdefault(
                f"a point that {part.name} holds", np.zeros(len(body), dtype=bool)
            )
            held[part.every] = True
    return {
        what: -share.greatest(-float(distances[chosen].min(initial=np.inf)))
        for what, chosen in points.items()
    }


def _closed(run: Run, front: Front, F: np.ndarray) -> bool:
    """Return whether the faces of a front's precut overlap in the mean over the bonds that it cuts.

    A bond opens by what its deformed vector has, along the deformed normal of the cut, beyond that
    of the material around its ends.
    """
    body = run.body
    force = run.force
    one, other = body.bonds.cut[(body.bonds.cut < len(body)).all(axis=1)].T
    chosen = body.share.own[one] & front.cut.crosses(body.points[one], body.points[other])
    one = one[chosen]
    other = other[chosen]
    bonds = body.points[other] - body.points[one]
    around = (F[one] + F[other]) / 2
    gaps = force.positions[other] - force.positions[one] - np.einsum("bij,bj->bi", around, bonds)
    opened = np.sign(bonds @ front.normal) * np.einsum(
        "bi,bji,j->b", gaps, np.linalg.pinv(around), front.normal
    )
    strains = (
        np.linalg.norm(
            np.einsum("bki,bkj->bij", around, around) - np.eye(body.dimension), axis=(1, 2)
        )
        / 2
        + ROUNDING
    )
    return body.share.total(float(opened.sum())) < -CLOSED * body.spacing * body.share.total(
        float(strains.sum())
    )


def force_balance(run: Run, reactions: Reactions, drive: float | None) -> float | None:
    """Return the magnitude of the sum of all loads and reactions, divided by `drive`; None if
    `drive` is 0 or None.

    `drive` is the sum of the magnitudes of the loads or of the reactions, see `Equilibrium.drive`.
    """
    if not drive:
        return None
    total = reactions.on_planes.sum(axis=0)
    if reactions.at_points is not None:
        total = total + [run.body.share.sum(column) for column in reactions.at_points.T]
    loads = run.loads.by_name(run.positions, run.loaded.thickness())
    return float(np.linalg.norm(total + sum(loads.values())) / drive)


def _lateral(body: Body, displacements: np.ndarray, axis: int, box: np.ndarray) -> dict[str, float]:
    """Return measurements of the lateral contraction of a rectangle, with the corners `box`, along
    `axis`, perpendicular to the load.

    They are, for the two edges normal to `axis`, half the mean decrease of their distance and the
    greatest displacement along `axis` on them; and the roughness (`measures.roughness`) of the
    displacements of all points along `axis`.
    """
    _, low, high = measures.edge_displacements(body, displacements, axis, box)
    return {
        "lateral_displacement": float((low - high).mean() / 2),
        "greatest_lateral_displacement": float(max(np.abs(low).max(), np.abs(high).max())),
        "roughness": measures.roughness(body, displacements, 1 - axis),
    }
