"""Digests of the forces on a ring between held boundaries, on one rank or several."""

import hashlib

import numpy as np

import pdsurrogate as pds
from pdsurrogate.body import divided
from pdsurrogate.discretization import discretize
from pdsurrogate.forces import FORCES, ForceSettings
from pdsurrogate.materials import NeoHookean
from pdsurrogate.ranks import communicator
from pdsurrogate.testing.bodies import Deformation

CASES = (
    ("analytic", "stress"),
    ("bond-energy", "stress"),
    ("bond-energy", "strain"),
    ("nosb", "strain"),
    ("bond-energy", "stress", "relaxed"),
    ("analytic", "stress", "relaxed"),
)
KEYS = {"spacing": 0.1, "holes": [{"shape": "circle", "radius": 0.3}]}


def digests(ranks, name, plane, arrangement="lattice"):
    """Of the forces with both boundaries moved, of those after bonds have broken, and the sum of
    pair forces across the boundaries.
    """
    body = discretize(
        pds.load_scene("disc-torsion", {**KEYS, "plane": plane, "body.arrangement": arrangement})
    )[0]
    if ranks.size > 1:
        body = divided(body, ranks)
        assert len(body) < body.share.size
    breakable = arrangement == "relaxed"
    force = FORCES[name]().bind(
        body, NeoHookean(1.0, 100.0), ForceSettings(plane=plane, breakable=breakable)
    )
    turn = np.array([[np.cos(0.1), -np.sin(0.1)], [np.sin(0.1), np.cos(0.1)]])
    force.move_plane(0, np.array([0.01, 0.0]), turn - np.eye(2))
    force.move_plane(1, np.array([0.0, 0.005]))
    forces, positions = (
        np.empty_like(body.points),
        Deformation(1.02, 0.99, 0.0, 0.0, 0.0003, 1)(body.points),
    )
    force(positions, forces)
    whole, outer = body.share.gather(forces), body.bonds.second >= len(body)
    outer &= body.share.own[body.bonds.first]
    reaction = body.share.total(force.pair_forces()[outer].sum(axis=0))
    digest = None if whole is None else hashlib.sha256(whole.tobytes()).hexdigest()
    broken = None
    if breakable:
        middles = (body.all_points[body.bonds.first] + body.all_points[body.bonds.second]) / 2
        force.break_bonds(
            np.flatnonzero(np.linalg.norm(middles - [0.0, 0.65], axis=1) < 0.12).astype(np.uint32)
        )
        force(positions, forces)
        broken = body.share.gather(forces)
    return {
        "broken": None if broken is None else hashlib.sha256(broken.tobytes()).hexdigest(),
        "case": f"{name}, {plane}, {arrangement}",
        "forces": digest,
        "reaction": reaction.tolist(),
        "bonds": body.share.total(int(outer.sum())),
    }


def digests_of_cases():
    return [digests(communicator(), *case) for case in CASES]
