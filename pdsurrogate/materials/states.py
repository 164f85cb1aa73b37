"""States of a body: a sheet in plane stress or plane strain, or a solid; their stresses and
energies by any law, in NumPy.

Tensors of a sheet have shape (..., 2, 2), those of a solid (..., 3, 3). Stresses and energies have
the unit of the law's shear modulus; responses and `bond_traction` are dimensionless.
"""

from collections.abc import Callable

import numpy as np

from ..kernels.bond_force import lateral_stretch
from ..kernels.node_state import SWELLING
from . import expressions
from .consistency import check_consistency
from .law import Law

EDGE_ITERATIONS = 50
DIFFERENCE = 1e-6
EDGE_SOLVED = 1e-12
"""Settings of Newton's method for the thickness at an edge: the greatest number of iterations, the
interval of the differences of logarithms that give slopes, and the last step. Chosen: the error of
the slopes leaves 1e-6 of the error in each iteration, so that five are usual.
"""


def principal_stretches(F: np.ndarray) -> np.ndarray:
    """Return the principal stretches, the square roots of the eigenvalues of F^T F, the greatest
    first.

    Parameters
    ----------
    F : ndarray, shape (n, 2, 2) or (n, 3, 3)

    Returns
    -------
    ndarray, shape (n, 2) or (n, 3)

    Examples
    --------
    >>> principal_stretches(np.array([[[2.0, 0.0], [0.0, 0.5]]])).tolist()
    [[2.0, 0.5]]
    """
    if F.shape[-1] == 3:
        return np.linalg.svd(F, compute_uv=False)
    # A plane F is the sum of a turned stretch and a reflected one, of sizes p and q: p + q and |p -
    # q| are its stretches.
    p = np.hypot(F[:, 0, 0] + F[:, 1, 1], F[:, 1, 0] - F[:, 0, 1]) / 2
    q = np.hypot(F[:, 0, 0] - F[:, 1, 1], F[:, 1, 0] + F[:, 0, 1]) / 2
    return np.stack([p + q, np.abs(p - q)], axis=1)


def cofactor(F: np.ndarray) -> np.ndarray:
    """Return the cofactor of F, det F times F^-T, in the shape of F."""
    if F.shape[-1] == 2:
        return np.flip(F, (-2, -1)) * [[1, -1], [-1, 1]]
    # The columns are cross products of those of F.
    return np.stack([np.cross(F[..., (k + 1) % 3], F[..., (k + 2) % 3]) for k in range(3)], axis=-1)


def determinant(F: np.ndarray) -> np.ndarray:
    """Return det F, of shape (...), of matrices of two or three rows; for many small ones
    several times as fast as NumPy's function.
    """
    if F.shape[-1] == 2:
        return F[..., 0, 0] * F[..., 1, 1] - F[..., 0, 1] * F[..., 1, 0]
    of_rest = [determinant(F[..., 1:, [k for k in range(3) if k != column]]) for column in range(3)]
    return F[..., 0, 0] * of_rest[0] - F[..., 0, 1] * of_rest[1] + F[..., 0, 2] * of_rest[2]


def invariants(F) -> tuple:
    """Return tr C and det F of a sheet, or tr C, tr cof C and det F of a solid, each of shape
    (...).
    """
    F = np.asarray(F, dtype=float)
    tensors = (F, cofactor(F)) if F.shape[-1] == 3 else (F,)
    return *(np.einsum("...ij,...ij->...", tensor, tensor) for tensor in tensors), determinant(F)


def stretch_squares(trace: float, area_ratio: float) -> np.ndarray:
    """Return the squares of the three principal stretches, shape (3,), of a sheet of constant
    volume from tr C and det F in the plane.
    """
    half = trace / 2
    root = np.sqrt(max(half**2 - area_ratio**2, 0.0))
    return np.array([half - root, half + root, area_ratio**-2])


class Solid:
    """Stresses and energies of a solid in three dimensions by any law; subclasses do the same for
    sheets.

    `response` and `isochoric_response` are expressions, which kernels use compiled; the methods
    evaluate these expressions in NumPy.
    """

    response = expressions.SOLID
    isochoric_response = expressions.ISOCHORIC_SOLID
    invariants = staticmethod(invariants)

    def isochoric_state(self, F) -> tuple:
        """Return the invariants of F that are the arguments of `isochoric_response`, each of
        shape (...).
        """
        return invariants(F)

    def volume_ratio(self, law: Law, *invariants):
        """Return the volume ratio J3, shape (...): the last of `invariants`, det F, except under
        plane stress.

        `invariants` are the results of the function `invariants` of F, passed as separate
        arguments.
        """
        return np.broadcast_arrays(*(np.asarray(value, float) for value in invariants))[-1]

    def first_piola_stress(self, law: Law, F):
        """Return the first Piola-Kirchhoff stress P in the shape of F, in the same unit as the
        shear modulus.
        """
        d = np.shape(F)[-1]
        return self.exact(law, F)[1][..., :d, :d]

    def energy_density(self, law: Law, F):
        """Return the strain energy per undeformed volume, shape (...), in the same unit as the
        shear modulus.
        """
        return self.exact(law, F)[2]

    def energy_at(self, law: Law, F, volume_ratio):
        """Return the strain energy per undeformed volume, shape (...), as `stress_and_energy`
        does, without the stress.
        """
        isochoric = self.isochoric_response(law, *self.isochoric_state(F))[-1]
        return law.shear_modulus * (isochoric + law.volumetric(volume_ratio, law.parameters)[0])

    def exact(self, law: Law, F) -> tuple:
        """Return J3 (...), the first Piola-Kirchhoff stress (..., 3, 3) and the energy density
        (...) of a law, from F alone.
        """
        J3 = self.volume_ratio(law, *invariants(F))
        return J3, *self.stress_and_energy(law, F, J3, law.volumetric(J3, law.parameters)[1])

    def stress_and_energy(self, law: Law, F, volume_ratio, bulk_stress, isochoric=None):
        """Return the first Piola-Kirchhoff stress (n, 3, 3) and the energy density (n,) of points,
        in the same unit as the shear modulus.

        U is evaluated at `volume_ratio` (n,): det F, or a smoothed ratio if the force model
        evaluates W at bonds and U at points. `bulk_stress` (n,) is U' in units of mu at that ratio,
        or the value in the bond forces (theory (51)); it is unused under plane stress, where J3
        determines the stress. `isochoric`, if given, replaces the results of the law's
        `isochoric_response`.
        """
        check_consistency(law)
        F = np.asarray(F, dtype=float)
        *rows, energy = (
            self.isochoric_response(law, *self.isochoric_state(F))
            if isochoric is None
            else isochoric
        )
        stress = self._stress(F, rows, bulk_stress)
        return law.shear_modulus * stress, law.shear_modulus * (
            energy + law.volumetric(volume_ratio, law.parameters)[0]
        )

    def _stress(self, F, rows, bulk_stress):
        """Return the dimensionless stress (..., 3, 3) from `rows`, the results of
        `isochoric_response` other than the energy, and U'.
        """
        p, q, r = (value[..., None, None] for value in (rows[0], rows[1] + bulk_stress, rows[2]))
        return p * F + q * cofactor(F) + r * (F @ (F.swapaxes(-1, -2) @ F))

    def has_state(self, law: Law, F) -> np.ndarray:
        """Return whether a law has a state at deformation gradients, shape (..., 3, 3), or (...,
        2, 2) in a sheet; shape (...).
        """
        with np.errstate(all="ignore"):  # of states beyond the limit
            return np.isfinite(expressions.ISOCHORIC_SOLID(law, *invariants(_in_space(F)))[3])

    def why_no_state(self, law: Law, F) -> str | None:
        """Explain why a law has no state at one deformation gradient (3 by 3, or 2 by 2 in a
        sheet); return None where it has one.
        """
        full = _in_space(F)
        squares = np.linalg.svd(full, compute_uv=False) ** 2 / np.abs(np.linalg.det(full)) ** (
            2 / 3
        )
        return (
            None
            if self.has_state(law, full)
            else f"{law.name}: no state exists: {law.limit(squares)}"
        )


class PlaneStrain(Solid):
    """Stresses and energies of a sheet in plane strain, whose thickness is held: C33 = 1."""

    response = expressions.PLANE_STRAIN
    isochoric_response = expressions.ISOCHORIC_PLANE_STRAIN

    def isochoric_state(self, F):
        trace, J = invariants(F)
        return trace, J, J

    def in_plane_stress(self, F, p, q):
        """Return the in-plane stress P = p F + q F^-T, shape (..., 2, 2), from its coefficients
        p and q, shape (...).
        """
        F = np.asarray(F, dtype=float)
        # Component by component, in an eighth of the time of products with `cofactor`.
        found = np.empty((*np.shape(p), 2, 2))
        of_cofactor = q / determinant(F)
        for i, j in np.ndindex(2, 2):
            found[..., i, j] = (
                p * F[..., i, j] + (of_cofactor if i == j else -of_cofactor) * F[..., 1 - i, 1 - j]
            )
        return found

    def _stress(self, F, rows, bulk_stress):
        p, q, across = rows
        pressure = invariants(F)[1] * bulk_stress
        stress = np.zeros((*F.shape[:-2], 3, 3))
        stress[..., :2, :2] = self.in_plane_stress(F, p, q + pressure)
        stress[..., 2, 2] = across + pressure
        return stress


class PlaneStress(PlaneStrain):
    """Stresses and energies of a sheet in plane stress, whose thickness is free: P33 = 0."""

    response = expressions.PLANE_STRESS
    isochoric_response = expressions.ISOCHORIC_PLANE_STRESS

    def volume_ratio(self, law: Law, trace, area_ratio):
        """Return the J3 that makes P33 = 0 (paper, Eq. (9)), shape (...), by Newton's method from
        1; then C33 = (J3/J)**2.

        Raise ValueError where J = det F is not positive or the law has no such state (beyond its
        limit), and if the law's derivatives are not those of its energy.
        """
        check_consistency(law)
        trace, J = np.broadcast_arrays(np.asarray(trace, float), np.asarray(area_ratio, float))
        if np.any(~(J > 0)):
            raise ValueError(f"det F must be positive; the least given is {np.nanmin(J):g}")
        J3, solved = self._solved(law, trace, J)
        if not np.all(solved):
            first = np.flatnonzero(~solved.ravel())[0]
            state = float(trace.ravel()[first]), float(J.ravel()[first])
            limit = law.limit(stretch_squares(*state))
            raise ValueError(
                f"{law.name}: no plane-stress state at tr C = {state[0]:g}, det F = {state[1]:g}:"
                f" {limit}"
            )
        return J3

    def _solved(self, law: Law, trace, area_ratio) -> tuple[np.ndarray, np.ndarray]:
        """Return the J3 that Newton's method finds, and whether P33 = 0 there."""
        J3 = newton(
            lambda J3: self.response(law, trace, area_ratio, J3)[2:4],
            np.ones_like(area_ratio),
            1e-15,
        )
        with np.errstate(all="ignore"):
            residual = self.response(law, trace, area_ratio, J3)[2]
        # NaN, and a residual that does not vanish, both mean that the state is beyond the law's
        # limit.
        return J3, np.abs(residual) <= 1e-9 * law.bulk_modulus / law.shear_modulus

    def has_state(self, law: Law, F) -> np.ndarray:
        return self._solved(law, *invariants(F))[1]

    def why_no_state(self, law: Law, F) -> str | None:
        try:
            self.volume_ratio(law, *invariants(F))
        except ValueError as error:
            return str(error)
        return None

    def thickness_stretch_squared(self, law: Law, trace, area_ratio):
        """Return C33 = (J3/J)**2, the squared stretch of the thickness under plane stress, shape
        (...).
        """
        return (self.volume_ratio(law, trace, area_ratio) / area_ratio) ** 2

    def thickness_at_edge(self, law: Law, along, pressure):
        """Return the stretch of the thickness at edges that have the stretches `along` (k,)
        themselves and bear a pressure, theory (44a).

        The stretch normal to the edge and J3 are found by Newton's method, such that the nominal
        stress on the edge is that of the pressure and P33 = 0. The result is NaN where there is no
        such state.
        """
        along, pressure = np.broadcast_arrays(np.asarray(along, float), np.asarray(pressure, float))
        load = pressure / law.shear_modulus

        def excess(logarithms):
            normal, J3 = np.exp(logarithms)
            p, q, across, _, _ = self.response(law, along**2 + normal**2, along * normal, J3)
            return np.array([p * normal**2 + q + load * J3, across])

        with np.errstate(all="ignore"):
            found = np.array([-np.log(along) / 2, np.zeros_like(along)])
            for _ in range(EDGE_ITERATIONS):
                off = excess(found)
                slopes = [
                    (excess(found + change) - off) / DIFFERENCE
                    for change in DIFFERENCE * np.eye(2)[:, :, None]
                ]
                (a, c), (b, d) = slopes
                step = np.array([d * off[0] - b * off[1], a * off[1] - c * off[0]]) / (
                    a * d - b * c
                )
                found = found - np.clip(step, -0.5, 0.5)
                if not (np.abs(step) > EDGE_SOLVED).any():
                    break
            return np.where(
                np.abs(step).max(axis=0) < 1e3 * EDGE_SOLVED,
                np.exp(found[1] - found[0]) / along,
                np.nan,
            )

    def stress_and_energy(self, law: Law, F, volume_ratio, bulk_stress=None, isochoric=None):
        p, q, _, _, energy = self.response(law, *invariants(F), volume_ratio)
        return (
            law.shear_modulus * self._stress(np.asarray(F, dtype=float), (p, q, 0.0), 0.0),
            law.shear_modulus * energy,
        )

    def energy_at(self, law: Law, F, volume_ratio):
        return law.shear_modulus * self.response(law, *invariants(F), volume_ratio)[-1]

    def energy_derivatives(self, law: Law, trace, area_ratio):
        """Return psi, psi_I, psi_J, psi_II, psi_IJ, psi_JJ of the energy as a function of I = tr C
        and J, dimensionless.

        At fixed J3 the energy has the derivatives of the law, and J3 makes it stationary, so the
        first derivatives are those at fixed J3. The second ones are fourth-order differences of the
        first, off by 3e-9, toward larger tr C and smaller J, since no states exist below tr C = 2
        J. All arrays have shape (n,). Raise ValueError where J is not positive or the law has no
        plane-stress state.
        """
        trace, J = (np.asarray(value, dtype=float) for value in (trace, area_ratio))
        steps = 2e-3 * np.arange(5)[:, None]
        weights = np.array([-25, 48, -36, 16, -3]) / (12 * 2e-3)

        def energy_and_slopes(trace, J):
            p, q, _, _, energy = self.response(law, trace, J, self.volume_ratio(law, trace, J))
            return energy, p / 2, q / J

        energy, by_trace, by_J = energy_and_slopes(trace, J)
        _, *along_trace = energy_and_slopes((1 + steps) * trace, J)
        *_, along_J = energy_and_slopes(trace, (1 - steps) * J)
        return (
            energy,
            by_trace,
            by_J,
            *(weights @ slopes / trace for slopes in along_trace),
            -(weights @ along_J) / J,
        )

    def bond_traction(self, law: Law, normal_stretch, shear_stretch, area_ratio, C33):
        """Return the components (T_nn, T_nm, T_mm) of R^T P / mu, from which the exact bond force
        follows (theory (7), (11)).

        n is the direction of the undeformed bond, m is normal to it in the plane, and F = R U. The
        bond is given by the components U_nn = lambda_b cos(dtheta), `normal_stretch`, and U_nm =
        lambda_b sin(dtheta), `shear_stretch`, with the stretch lambda_b of the bond and its
        rotation dtheta relative to R; `area_ratio` is J = det F. C33 need not be that of plane
        stress.
        """
        a, b, J, C33 = (
            np.asarray(value, dtype=float)
            for value in (normal_stretch, shear_stretch, area_ratio, C33)
        )
        U_mm = lateral_stretch(a, b, J)
        p, q, *_ = self.response(law, a * a + 2 * b * b + U_mm * U_mm, J, J * np.sqrt(C33))
        return p * a + q * U_mm / J, (p - q / J) * b, p * U_mm + q * a / J


def _in_space(F) -> np.ndarray:
    """Return deformation gradients of sheets, shape (..., 2, 2), as those of bodies whose
    thickness is held; those of solids unchanged.
    """
    full = np.broadcast_to(np.eye(3), (*np.shape(F)[:-2], 3, 3)).copy()
    full[..., : np.shape(F)[-2], : np.shape(F)[-1]] = F
    return full


def newton(
    function: Callable[[np.ndarray], tuple], start: np.ndarray, tolerance: float
) -> np.ndarray:
    """Return the zeros of increasing functions of positive numbers by Newton's method, up to a last
    relative step of `tolerance`.

    ``function(x)`` returns values and slopes. A number at most halves or doubles in one step, so it
    stays positive from any start. Where the value is NaN, as beyond a law's limit, the number is
    increased: a state with a larger volume may lie within the limit.
    """
    found = start
    with np.errstate(all="ignore"):
        for _ in range(60):
            value, slope = function(found)
            step = np.where(slope > 0, value / slope, np.sign(value) * found)
            found = found - np.where(
                np.isnan(value + slope), -SWELLING * found, np.clip(step, -found, 0.5 * found)
            )
            if np.all(np.abs(step) <= tolerance * found):
                break
    return found


plane_stress = PlaneStress()
plane_strain = PlaneStrain()
solid = Solid()

PLANES = {"stress": plane_stress, "strain": plane_strain, "space": solid}
"""States of a body (`PlaneStress`, `PlaneStrain` or `Solid`) by the names that scenes and
settings use.
"""

SHEETS = ("stress", "strain")
"""Names of the states of two-dimensional bodies."""


def dimension_of(plane: str) -> int:
    """Return the dimension, 2 or 3, of bodies in a state named in `PLANES`."""
    return 2 if plane in SHEETS else 3
