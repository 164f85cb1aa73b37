"""Strengths of two numbers: surfaces of Drucker and Prager's form, theory, section 32."""

from dataclasses import dataclass

import numpy as np

from ..materials import PLANES, Law, homogeneous
from ..materials.states import principal_stretches
from ..materials.tearing import MOST_STRETCH, TABLE, tension_states
from ..scenes.strength import Strength


@dataclass(frozen=True)
class Surface:
    """Strength surface of a material: (1 - share) q + share tr T = uniaxial, with Mises' equivalent
    stress q and the trace of the principal nominal (Biot) stresses T.

    Attributes
    ----------
    share : float
        A third of the uniaxial strength over the hydrostatic one, from 0 to below 1.
    uniaxial : float
        Nominal stress at break in uniaxial tension.
    stresses, roots : ndarray, shape (k,)
        Nominal stresses in uniaxial tension and the roots of the energy densities there.
    """

    share: float
    uniaxial: float
    stresses: np.ndarray
    roots: np.ndarray

    @property
    def equibiaxial(self) -> float:
        """Nominal stress at break in equibiaxial tension."""
        return self.uniaxial / (1 + self.share)

    @property
    def hydrostatic(self) -> float | None:
        """Nominal stress at break in equal tension in all directions, if the surface has one."""
        return self.uniaxial / (3 * self.share) if self.share else None

    def equivalent(self, stresses: np.ndarray) -> np.ndarray:
        """Return the stress in uniaxial tension that is as near to break as states with principal
        nominal stresses (..., 3) are, shape (...); 0 for states that no greater load would break.
        """
        mean = stresses.mean(axis=-1)
        mises = np.sqrt(1.5 * np.square(stresses - mean[..., None]).sum(axis=-1))
        return np.maximum((1 - self.share) * mises + 3 * self.share * mean, 0.0)

    def energy(self, law: Law, plane: str, F: np.ndarray, volume_ratio: np.ndarray) -> np.ndarray:
        """Return the energy density in uniaxial tension of the stress that is as near to break as
        the states of a law with deformation gradients (n, d, d) and volume ratios (n,) are.
        """
        stretches = principal_stretches(F)
        F = stretches[:, None, :] * np.eye(stretches.shape[1])
        bulk = law.volumetric(volume_ratio, law.parameters)[1]
        stress = PLANES[plane].stress_and_energy(law, F, volume_ratio, bulk)[0]
        principal = self.equivalent(np.diagonal(stress, axis1=-2, axis2=-1))
        last = self.stresses[-1]
        root = np.interp(principal, self.stresses, self.roots)
        return np.square(root * np.maximum(principal / last, 1.0))

    def density_around_tip(self, angle: np.ndarray, nu: float, plane: str) -> np.ndarray:
        """Return this energy for small strains around the tip of a long crack, at angles from the
        line ahead, times 2 pi r / G, by the stresses of Williams.
        """
        cos, sin = np.cos(angle / 2), np.sin(angle / 2)
        across = 0 * cos if plane == "stress" else 2 * nu * cos
        stresses = np.stack([cos * (1 + sin), cos * (1 - sin), across], axis=-1)
        held = 1.0 if plane == "stress" else 1 - nu**2
        return np.square(self.equivalent(stresses)) / (2 * held)


def surface_of(law: Law, stretch: float, given: Strength) -> Surface | None:
    """Return the surface of a strength whose stretch at break in uniaxial tension is given, or None
    if that is the only number.

    Raises
    ------
    ValueError
        If no surface has the two numbers, or the law does not reach the hydrostatic strength.
    """
    if given.hydrostatic is None and given.equibiaxial is None:
        return None
    uniaxial = homogeneous.uniaxial(law, stretch).nominal_stress
    if given.hydrostatic is not None:
        share = uniaxial / (3 * given.hydrostatic)
        if share >= 1:
            raise ValueError(
                f"hydrostatic must be greater than a third of the nominal stress at break in"
                f" uniaxial tension, {uniaxial / 3:.4g}, not {given.hydrostatic:g}: else tension in"
                " one direction more would not break the material"
            )
        _check_reached(law, given.hydrostatic)
    else:
        assert given.equibiaxial is not None  # one of the two is given
        share = uniaxial / given.equibiaxial - 1
        if not -1e-9 <= share < 1:
            raise ValueError(
                "equibiaxial must be greater than half of the nominal stress at break in uniaxial"
                f" tension and at most that, {uniaxial / 2:.4g} to {uniaxial:.4g}, not"
                f" {given.equibiaxial:g}: beyond it, pressure would break the material"
            )
        share = max(share, 0.0)
    stretches, stresses, roots = tension_states(law, stretch)
    two = " for a strength of two numbers; leave the second out, for"
    rising(law, stretches, stresses, len(stresses), two)
    return Surface(share, uniaxial, stresses, roots)


def rising(law: Law, stretches: np.ndarray, values: np.ndarray, asked: int, why: str = ";") -> int:
    """Return how many `values` rise from the first on, which do if the nominal stress in uniaxial
    tension does; raise ValueError if fewer than `asked`, for a reason `why`.
    """
    count = int(np.append(np.diff(values) <= 0, True).argmax()) + 1
    if count < asked:
        raise ValueError(
            f"the nominal stress of {law.name} in uniaxial tension must rise up to a stretch of"
            f" {stretches[asked - 1]:.3g}{why} it does up to {stretches[count - 1]:.3g}"
        )
    return count


def _check_reached(law: Law, hydrostatic: float) -> None:
    """Raise ValueError if a law has no such nominal stress in equal tension in all directions."""
    stretches = np.geomspace(1.0, MOST_STRETCH, TABLE)
    ratios = stretches**3
    slopes = law.volumetric(ratios, law.parameters)[1]
    greatest = law.shear_modulus * float((slopes * stretches**2).max())
    if greatest < hydrostatic:
        raise ValueError(
            f"hydrostatic is {hydrostatic:g}, but {law.name} with a bulk modulus of"
            f" {law.bulk_modulus:g} reaches {greatest:.4g} at most in equal tension in all"
            " directions; a greater bulk modulus would do"
        )
