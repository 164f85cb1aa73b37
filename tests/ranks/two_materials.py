"""Digests of the forces on bodies of two materials, and of what they found them with, on one rank or several."""

import hashlib

import numpy as np

from pdsurrogate.body import Body, ReflectionPlane, Round, divided
from pdsurrogate.forces import FORCES, ForceSettings, Portion, bind_portions
from pdsurrogate.forces.interfaces import SIGHT
from pdsurrogate.materials import NeoHookean
from pdsurrogate.ranks import communicator
from pdsurrogate.solvers.nearest_bonds import random_vector
from pdsurrogate.stress_test.conformance import Deformation

CASES = ("analytic", "stress"), ("bond-energy", "stress"), ("bond-energy", "strain"), ("bond-energy", "space")
DISC = Round((1.3, 0.3), 0.25)


def strip(d):
    """Points off a grid in a strip so long that no part has all of them in its halo, mirrored at its left."""
    counts, horizon = ((40, 7), 2.15) if d == 2 else ((24, 4, 4), 1.75)
    points = (np.stack(np.meshgrid(*map(np.arange, counts), indexing="ij"), axis=-1).reshape(-1, d) + 0.5) * 0.1
    points += np.random.default_rng(1).uniform(-0.01, 0.01, points.shape)
    planes = (ReflectionPlane(0, 0.0, -1, (-1, 1, 1)[:d]),)
    return Body(points, np.full(len(points), 0.1**d), horizon * 0.1, 0.1, planes=planes, rounds=(DISC,) if d == 2 else ())


def digests(name, plane, ranks, disc=False):
    """Of forces and volume ratios in a strip whose right part, or a disc, is five times as stiff."""
    d = 3 if plane == "space" else 2
    body = strip(d)
    middle = (body.points.min(axis=0) + body.points.max(axis=0)) / 2
    if ranks.size > 1:
        body = divided(body, ranks, SIGHT)
        assert len(body) < body.share.size
    # A slanted interface, which cuts are not along.
    stiff = (body.points - middle) @ np.array([0.8, 0.6, 0.2])[:d] > 0.1 * body.spacing
    if disc:
        stiff = DISC.distances(body.points) < 0
    model = FORCES[name]()
    portions = [Portion(NeoHookean(mu, 100 * mu), model, np.flatnonzero(where)) for mu, where in ((1.0, ~stiff), (5.0, stiff))]
    force = bind_portions(body, portions, ForceSettings(plane=plane))
    positions = Deformation(1.02, 0.99, 0.0, 0.0, 0.0003, 1)(body.points)
    forces = np.empty_like(positions)
    force(positions, forces)
    energy = body.share.total(force.energy()) if force.has_energy else None
    bonds, within = body.bonds, body.bonds.second < len(body)
    across = within & (stiff[bonds.first] != stiff[np.where(within, bonds.second, bonds.first)])
    jumps = int(body.share.total(int((across * body.share.own[bonds.first]).sum())))
    found = {"case": f"{name}, {plane}, {disc}", "energy": energy, "beside": jumps}
    fields = {"forces": forces, "ratios": force.volume_ratios()}
    if force.nearly_incompressible:
        dilatation = force.linearized_dilatation()
        dilatation.take()
        displacements = random_vector(body.share, np.ones_like(positions))
        fields |= {"changes": dilatation.changes(displacements), "pulls": dilatation.forces(displacements[:, 0])}
    for what, values in fields.items():
        whole = body.share.gather(np.ascontiguousarray(values))
        found[what] = None if whole is None else hashlib.sha256(whole.tobytes()).hexdigest()
    return found


def digests_of_cases():
    return [*(digests(*case, communicator()) for case in CASES), digests("bond-energy", "stress", communicator(), disc=True)]
