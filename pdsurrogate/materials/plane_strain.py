"""Plane strain of any law: the expressions of `plane_stress` at J3 = J, with the stress across the plane that holds C33 = 1.

In-plane tensors have shape (..., 2, 2).  Stresses and energies carry the unit of the law's shear modulus.
"""

from __future__ import annotations

import numpy as np

from ..engine.compile import inlined
from . import plane_stress
from .consistency import check_consistency
from .law import Law
from .response import Response


@inlined
def _held(state):
    """The state with C33 = 1."""
    return state[0], state[1], state[1]


@inlined
def _invariants(state):
    return plane_stress.isochoric_invariants(_held(state))


@inlined
def _stretches(state):
    return plane_stress.principal_stretches(_held(state))


@inlined
def _result(state, found):
    """Under plane stress q is short of the stress across the plane, which is zero there; here it is the residual J3 dPsi/dJ3."""
    p, q, across, _, energy = found
    return p, q + across, state[2] / state[1] - 1, 1 / state[1], energy


@inlined
def _of_invariants(state, isochoric, volumetric):
    return _result(state, plane_stress.of_invariants(_held(state), isochoric, volumetric))


@inlined
def _of_stretches(state, stretches, sums, volumetric):
    return _result(state, plane_stress.of_stretches(_held(state), stretches, sums, volumetric))


response = Response(5, 1, _invariants, _of_invariants, _stretches, _of_stretches, curvature=False)
"""``response(law, trace, J, J3)``: rows as under plane stress, so that kernels take one for the other.

p, q and the energy are those at J3 = J, whatever J3 is given; in the place of the condition P33 = 0 stands J3/J - 1 = 0, with its
derivative by J3.
"""


@inlined
def _isochoric(state, found):
    p, q, across, _, energy = found
    return p, q + across, across, energy


@inlined
def _isochoric_of_invariants(state, isochoric, volumetric):
    return _isochoric(state, plane_stress.of_invariants(_held(state), isochoric, (0.0, 0.0, 0.0)))


@inlined
def _isochoric_of_stretches(state, stretches, sums, volumetric):
    return _isochoric(state, plane_stress.of_stretches(_held(state), stretches, sums, (0.0, 0.0, 0.0)))


isochoric_response = Response(4, 1, _invariants, _isochoric_of_invariants, _stretches, _isochoric_of_stretches, curvature=False)
"""``isochoric_response(law, trace, J, J3)``: p, q, the Kirchhoff stress across the plane, and the energy, all of W alone.

U adds J U' to q and to the stress across: its stress is U' times the cofactor of F.
"""


def isochoric_state(F):
    """What `isochoric_response` is asked with, from F."""
    trace, J = plane_stress.invariants(F)
    return trace, J, J


def volume_ratio(law: Law, trace, area_ratio):
    """J3, which is det F in the plane."""
    return np.broadcast_arrays(np.asarray(trace, float), np.asarray(area_ratio, float))[1]


def first_piola_stress(law: Law, F):
    """In-plane first Piola-Kirchhoff stress P, shape (..., 2, 2), in the unit of the shear modulus."""
    check_consistency(law)
    trace, J = plane_stress.invariants(F)
    p, q, *_ = response(law, trace, J, J)
    return law.shear_modulus * plane_stress.in_plane_stress(F, p, q)


def energy_density(law: Law, F):
    """Strain energy density, shape (...), in the unit of the shear modulus."""
    check_consistency(law)
    trace, J = plane_stress.invariants(F)
    return law.shear_modulus * response(law, trace, J, J)[4]


def energy_at(law: Law, F, volume_ratio):
    """Energy density in units of mu, shape (n,): W at F, and U at the volume ratio (n,), of a selective energy not det F."""
    trace, J = plane_stress.invariants(F)
    return isochoric_response(law, trace, J, J)[3] + law.volumetric(volume_ratio, law.parameters)[0]


def stress_and_energy(law: Law, F, volume_ratio, bulk_stress, isochoric=None):
    """First Piola-Kirchhoff stress with the one across the plane, and energy density, of points.

    Parameters
    ----------
    law : Law
    F : ndarray, shape (n, 2, 2)
    volume_ratio : ndarray, shape (n,)
        Where U is taken: det F, or what a selective energy has in its place.
    bulk_stress : ndarray, shape (n,)
        U', in units of mu: at the volume ratio, or what the bonds feel of it (theory (51)).
    isochoric : tuple, optional
        Taken in the place of the law's own `isochoric_response`.

    Returns
    -------
    stress : ndarray, shape (n, 3, 3)
    energy : ndarray, shape (n,)
        Both in the unit of the shear modulus.
    """
    check_consistency(law)
    trace, J = plane_stress.invariants(F)
    p, q, across, energy = isochoric_response(law, trace, J, J) if isochoric is None else isochoric
    pressure = J * bulk_stress
    stress = np.zeros((len(F), 3, 3))
    stress[:, :2, :2] = plane_stress.in_plane_stress(F, p, q + pressure)
    stress[:, 2, 2] = across + pressure
    return law.shear_modulus * stress, law.shear_modulus * (energy + law.volumetric(volume_ratio, law.parameters)[0])
