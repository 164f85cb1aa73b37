"""Plane strain of any law: the expressions of `plane_stress` at J3 = J, with the stress across the plane that holds C33 = 1.

In-plane tensors have shape (..., 2, 2). Stresses and energies have the unit of the law's shear modulus.
"""

from __future__ import annotations

from collections.abc import Callable

import numpy as np

from ..engine.compile import inlined
from . import plane_stress
from .consistency import check_consistency
from .law import Law
from .response import Response


@inlined
def _held(state):
    """Return the state with C33 = 1."""
    return state[0], state[1], state[1]


@inlined
def _invariants(state):
    return plane_stress.isochoric_invariants(_held(state))


@inlined
def _stretches(state):
    return plane_stress.principal_stretches(_held(state))


def _response(rows: int, result: Callable, isochoric: bool) -> Response:
    """Return the response with the rows ``result(state, found)``, `found` being those of plane stress at C33 = 1."""
    result = inlined(result)

    @inlined
    def of_invariants(state, isochoric, volumetric):
        return result(state, plane_stress.of_invariants(_held(state), isochoric, volumetric))

    @inlined
    def of_stretches(state, stretches, sums, volumetric):
        return result(state, plane_stress.of_stretches(_held(state), stretches, sums, volumetric))

    return Response(rows, 1, _invariants, of_invariants, _stretches, of_stretches, isochoric=isochoric)


def _stress(state, found):
    """Return the rows of `response` from those of plane stress at C33 = 1: q gains J3 dPsi/dJ3, which is zero in plane stress."""
    p, q, across, _, energy = found
    return p, q + across, state[2] / state[1] - 1, 1 / state[1], energy


def _isochoric_stress(state, found):
    """Return the rows of `isochoric_response`."""
    p, q, across, _, energy = found
    return p, q + across, across, energy


response = _response(5, _stress, isochoric=False)
"""Response ``response(law, trace, J, J3)`` with the rows of the plane-stress one, so that kernels can use either.

p, q and the energy are those at J3 = J, whatever J3 is passed; the condition P33 = 0 is replaced by J3/J - 1 = 0, with its derivative by
J3.
"""

isochoric_response = _response(4, _isochoric_stress, isochoric=True)
"""Response ``isochoric_response(law, trace, J, J3)``: p, q, the Kirchhoff stress across the plane, and the energy, all from W alone.

U adds J U' to q and to the stress across the plane, since its stress is U' times the cofactor of F.
"""


def isochoric_state(F):
    """Return the arguments of `isochoric_response` from F."""
    trace, J = plane_stress.invariants(F)
    return trace, J, J


def volume_ratio(law: Law, trace, area_ratio):
    """Return J3, which is det F in the plane."""
    return np.broadcast_arrays(np.asarray(trace, float), np.asarray(area_ratio, float))[1]


def first_piola_stress(law: Law, F):
    """Return the in-plane first Piola-Kirchhoff stress P, shape (..., 2, 2), in the same unit as the shear modulus."""
    check_consistency(law)
    trace, J = plane_stress.invariants(F)
    p, q, *_ = response(law, trace, J, J)
    return law.shear_modulus * plane_stress.in_plane_stress(F, p, q)


def energy_density(law: Law, F):
    """Return the strain energy density, shape (...), in the same unit as the shear modulus."""
    check_consistency(law)
    trace, J = plane_stress.invariants(F)
    return law.shear_modulus * response(law, trace, J, J)[4]


def energy_at(law: Law, F, volume_ratio):
    """Return the energy density in units of mu, shape (n,): W at F plus U at the given volume ratio, which may differ from det F."""
    trace, J = plane_stress.invariants(F)
    return isochoric_response(law, trace, J, J)[3] + law.volumetric(volume_ratio, law.parameters)[0]


def stress_and_energy(law: Law, F, volume_ratio, bulk_stress, isochoric=None):
    """Return the first Piola-Kirchhoff stress (n, 3, 3) and the energy density (n,) of points, in the same unit as the shear modulus.

    U is evaluated at `volume_ratio` (n,): det F, or the smoothed ratio of a selective energy. `bulk_stress` (n,) is U' in units of mu at
    that ratio, or as the bonds use it (theory (51)). `isochoric` replaces the law's own `isochoric_response`.
    """
    check_consistency(law)
    trace, J = plane_stress.invariants(F)
    p, q, across, energy = isochoric_response(law, trace, J, J) if isochoric is None else isochoric
    pressure = J * bulk_stress
    stress = np.zeros((len(F), 3, 3))
    stress[:, :2, :2] = plane_stress.in_plane_stress(F, p, q + pressure)
    stress[:, 2, 2] = across + pressure
    return law.shear_modulus * stress, law.shear_modulus * (energy + law.volumetric(volume_ratio, law.parameters)[0])
