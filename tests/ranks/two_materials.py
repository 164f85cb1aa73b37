"""Digests of the forces on bodies of two materials, and of what they found them with, on one
rank or several.
"""

import hashlib

import numpy as np
from described import SCENES
from every_model import pulled

import pdsurrogate as pds
from pdsurrogate.body import Body, ReflectionPlane, Round, divided
from pdsurrogate.discretization.cells import lattice_of
from pdsurrogate.forces import FORCES, ForceSettings, MaterialPart, bind_portions
from pdsurrogate.forces.interface_fits import SIGHT
from pdsurrogate.materials import NeoHookean
from pdsurrogate.ranks import communicator
from pdsurrogate.solvers.nearest_bonds import random_vector
from pdsurrogate.testing.bodies import Deformation

CASES = (
    ("analytic", "stress"),
    ("bond-energy", "stress"),
    ("bond-energy", "strain"),
    ("bond-energy", "space"),
)
LAYERS = SCENES["layers on ranks"]
"""Strip of two layers, the upper one three times as stiff, that tears along their interface,
without an equilibrium before: sums over ranks decide where its iterations end.
"""

DISC = Round((1.3, 0.3), 0.25)


def strip(d):
    """Points off a grid in a strip so long that no part has all of them in its halo, mirrored at
    its left.
    """
    counts, horizon = ((40, 7), 2.15) if d == 2 else ((24, 4, 4), 1.75)
    points = (lattice_of(*map(np.arange, counts)) + 0.5) * 0.1
    points += np.random.default_rng(1).uniform(-0.01, 0.01, points.shape)
    planes = (ReflectionPlane(0, 0.0, -1, (-1, 1, 1)[:d]),)
    return Body(
        points,
        np.full(len(points), 0.1**d),
        horizon * 0.1,
        0.1,
        planes=planes,
        rounds=(DISC,) if d == 2 else (),
    )


def torn_pairs(body, across, middle):
    """Numbers of the pairs across the interface in the lower half, and of those through a line
    in the upper half of the stiff part.
    """
    first, second = (
        body.all_points[ends] - middle for ends in (body.bonds.first, body.bonds.second)
    )
    through = (first[:, 0] < 0.25) != (second[:, 0] < 0.25)
    return np.flatnonzero(np.where(first[:, 1] < 0, across, through))


def digests(name, plane, ranks, disc=False, torn=False, loaded=False):
    """Of forces and volume ratios in a strip whose right part, or a disc, is five times as stiff.

    If `torn`, the interface has parted in the lower half of the strip, and a crack has grown
    through the stiff part. If `loaded`, gradients are balanced for a tension on the sides.
    """
    d = 3 if plane == "space" else 2
    body = strip(d)
    outward = pulled(body)
    middle = (body.points.min(axis=0) + body.points.max(axis=0)) / 2
    if ranks.size > 1:
        body = divided(body, ranks, SIGHT)
        assert len(body) < body.share.size
    if loaded:
        vars(body).update(outward=outward[body.share.numbers], loaded=True)
    # A slanted interface, which cuts are not along.
    stiff = (body.points - middle) @ np.array([0.8, 0.6, 0.2])[:d] > 0.1 * body.spacing
    if disc:
        stiff = DISC.distances(body.points) < 0
    model = FORCES[name]()
    portions = [
        MaterialPart(NeoHookean(mu, 100 * mu), model, np.flatnonzero(where))
        for mu, where in ((1.0, ~stiff), (5.0, stiff))
    ]
    force = bind_portions(body, portions, ForceSettings(plane=plane, breakable=torn))
    bonds, within = body.bonds, body.bonds.second < len(body)
    across = within & (stiff[bonds.first] != stiff[np.where(within, bonds.second, bonds.first)])
    if torn:
        force.break_bonds(torn_pairs(body, across, middle))
    positions = Deformation(1.02, 0.99, 0.0, 0.0, 0.0003, 1)(body.points)
    forces = np.empty_like(positions)
    force(positions, forces)
    energy = body.share.total(force.energy()) if force.has_energy else None
    jumps = int(body.share.total(int((across * body.share.own[bonds.first]).sum())))
    found = {
        "case": f"{name}, {plane}, {disc}, {torn}, {loaded}",
        "energy": energy,
        "beside": jumps,
    }
    fields = {"forces": forces, "ratios": force.volume_ratios()}
    if force.nearly_incompressible:
        dilatation = force.linearized_dilatation()
        dilatation.linearize()
        displacements = random_vector(body.share, np.ones_like(positions))
        fields |= {
            "changes": dilatation.changes(displacements),
            "pulls": dilatation.forces(displacements[:, 0]),
        }
    for what, values in fields.items():
        whole = body.share.gather(np.ascontiguousarray(values))
        found[what] = None if whole is None else hashlib.sha256(whole.tobytes()).hexdigest()
    return found


def digests_of_cases():
    ranks = communicator()
    whole = [digests(*case, ranks, torn=torn) for case in CASES for torn in (False, True)]
    return [
        *whole,
        digests(*CASES[1], ranks, disc=True),
        *(digests(*case, ranks, torn=True, loaded=True) for case in CASES[2:]),
    ]


def torn_layers(remembering=False):
    """Crack, digest of the displacements, number of ranks and number of steps of a run of
    `LAYERS`, whose lower layer has a branch and softens if `remembering`.
    """
    memory = {"branches": [{"modulus": 1.0, "time": 0.2}], "softening": {"r": 1.5, "m": 0.1}}
    material = LAYERS["material"] | (memory if remembering else {})
    result = pds.simulate(pds.Scene(**LAYERS | {"material": material}), "bond-energy")
    whole = result.displacement() if communicator().rank == 0 else np.zeros(0)
    return (
        result.summary["crack"],
        hashlib.sha256(whole.tobytes()).hexdigest(),
        result.summary.get("ranks"),
        result.summary["n_steps"],
    )
