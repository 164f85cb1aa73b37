"""Digests of the forces on a ring between held boundaries, on one rank or several."""

import hashlib

import numpy as np

import pdsurrogate as pds
from pdsurrogate.body import divided
from pdsurrogate.discretization import discretize
from pdsurrogate.forces import FORCES, ForceSettings
from pdsurrogate.materials import NeoHookean
from pdsurrogate.ranks import communicator
from pdsurrogate.stress_test.conformance import Deformation

CASES = (
    ("analytic", "stress"),
    ("bond-energy", "stress"),
    ("bond-energy", "strain"),
    ("nosb", "strain"),
    ("bond-energy", "stress", "relaxed"),
)
KEYS = {"spacing": 0.1, "holes": [{"shape": "circle", "radius": 0.3}]}


def digests(ranks, name, plane, arrangement="lattice"):
    """Of the forces with both boundaries moved, and of the pair forces across them summed on the ranks."""
    body = discretize(pds.load_scene("disc-torsion", {**KEYS, "plane": plane, "body.arrangement": arrangement}))[0]
    if ranks.size > 1:
        body = divided(body, ranks)
        assert len(body) < body.share.size
    force = FORCES[name]().bind(body, NeoHookean(1.0, 100.0), ForceSettings(plane=plane))
    turn = np.array([[np.cos(0.1), -np.sin(0.1)], [np.sin(0.1), np.cos(0.1)]])
    force.move_plane(0, np.array([0.01, 0.0]), turn - np.eye(2))
    force.move_plane(1, np.array([0.0, 0.005]))
    forces = np.empty_like(body.points)
    force(Deformation(1.02, 0.99, 0.0, 0.0, 0.0003, 1)(body.points), forces)
    whole, outer = body.share.gather(forces), body.bonds.second >= len(body)
    outer &= body.share.own[body.bonds.first]
    reaction = body.share.total(force.pair_forces()[outer].sum(axis=0))
    digest = None if whole is None else hashlib.sha256(whole.tobytes()).hexdigest()
    return {
        "case": f"{name}, {plane}, {arrangement}",
        "forces": digest,
        "reaction": reaction.tolist(),
        "bonds": body.share.total(int(outer.sum())),
    }


def digests_of_cases():
    return [digests(communicator(), *case) for case in CASES]
