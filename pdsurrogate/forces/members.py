"""How far the members of a committee deviate from the model that runs: what they would give for the same deformation."""

from __future__ import annotations

import numpy as np

from ..materials import Law, solid
from .agreement import isochoric_stresses
from .analytic import AnalyticBondForce
from .bond_force import BondStates, ForceSurrogate

CHUNK = 65_536
"""Bonds or points evaluated at once."""


def bond_deviations(model: ForceSurrogate, law: Law, states: BondStates) -> np.ndarray:
    """Greatest deviation of the members' bond force from the model's, theory (9), in units of the shear modulus, shape (n,).

    Beyond its domain each is the exact force of its own law, as in a run by default.

    Parameters
    ----------
    model : ForceSurrogate
        With its members.
    law : Law
        Of the body.
    states : BondStates
    """
    found = []
    for at in range(0, len(states.a), CHUNK):
        some = states.chosen(slice(at, at + CHUNK))
        own = _bond_force(model, law, some)
        others = (member.ratio * _bond_force(member.model, member.law, some) for member in model.members)
        found.append(np.max([np.linalg.norm(force - own, axis=1) for force in others], axis=0))
    return np.concatenate(found) if found else np.empty(0)


def _bond_force(model: ForceSurrogate, law: Law, states: BondStates) -> np.ndarray:
    inside = states.has_stretch_tensor & (model.domain.beyond_bounds(states.stretches, states.J**2 * states.C33) <= 0)
    force = np.empty((len(inside), 2))
    for which, source in ((inside, model), (~inside, AnalyticBondForce(law))):
        if which.any():
            force[which] = source.bond_force(*states.chosen(which).quantities())
    return force


def point_deviations(model, law: Law, stretches: np.ndarray) -> np.ndarray:
    """The same of isochoric energies: norm of the difference of the principal Kirchhoff stresses, shape (n,).

    Parameters
    ----------
    model : IsochoricNetwork
    law
        As for `bond_deviations`.
    stretches : ndarray, shape (n, 3)
        Principal stretches of product 1.
    """
    own = _stresses(model, law, stretches)
    others = (member.ratio * _stresses(member.model, member.law, stretches) for member in model.members)
    return np.max([np.linalg.norm(stress - own, axis=1) for stress in others], axis=0)


def _stresses(model, law: Law, stretches: np.ndarray) -> np.ndarray:
    squares = stretches.T**2
    I1, I2 = squares.sum(axis=0), (1 / squares).sum(axis=0)
    inside = model.domain.beyond_bounds(stretches) <= 0
    derivatives = np.empty((2, len(I1)))
    derivatives[:, inside] = model.isochoric_derivatives(I1[inside], I2[inside])[1:]
    p, _, r, _ = solid.isochoric_response(law, I1[~inside], I2[~inside], np.ones((~inside).sum()))
    derivatives[:, ~inside] = p / 2 + I1[~inside] * r / 2, -r / 2
    return isochoric_stresses(squares, *derivatives)
