"""Fracture energies from tear tests, by the law of the material."""

from collections.abc import Callable

import numpy as np
import scipy

from . import homogeneous
from .law import Law, check_number, checked_law
from .states import PLANES

TABLE, MOST_STRETCH = 500, 10.0
"""Number of states in uniaxial tension up to a stretch and as many beyond it, and the greatest
stretch over that one. Chosen: energies between them are off by less than 1e-4, and the last stress
is some hundred times the one at the stretch, also near the limit of chains.
"""


def tearing_energy(law: Law, force: float, leg_width: float, thickness: float) -> float:
    """Return the energy per undeformed area of a trouser tear at a given force on its legs.

    While the tear advances by dc, each leg, in simple tension lambda, lengthens by lambda dc under
    the force F, and a volume 2 b h dc of unstrained material enters the legs (Rivlin and Thomas
    1953):

        T = 2 F lambda / h - w(lambda),   w = 2 b psi(lambda),

    with F = b h P(lambda).  w is the energy of both legs per undeformed length and thickness, b and
    h are width and thickness of a leg, psi is the energy density and P the nominal stress of the
    law in simple tension.  For legs that hardly stretch T = 2 F / h.

    Parameters
    ----------
    law : Law
    force : float
        Force on each leg.
    leg_width, thickness : float
        Undeformed width b and thickness h of a leg.

    Returns
    -------
    float
        Energy in units of stress times length.

    Raises
    ------
    ValueError
        If one of the numbers is not positive and finite, or the law cannot reach such a stress.

    References
    ----------
    Rivlin and Thomas, J. Polym. Sci. 10 (1953) 291-318.

    See Also
    --------
    pdsurrogate.critical_stretch_of : critical stretch for a fracture energy.

    Examples
    --------
    >>> import pdsurrogate as pds
    >>> print(
    ...     round(
    ...         pds.tearing_energy(
    ...             pds.materials.NeoHookean(), force=1.0, leg_width=8.0, thickness=2.0
    ...         ),
    ...         4,
    ...     )
    ... )
    1.0106
    """
    check_positive({"force": force, "leg's width": leg_width, "thickness": thickness})
    stress = force / (leg_width * thickness)
    stretch = stretch_at_stress(law, stress)
    return (
        2 * force * stretch / thickness
        - 2 * leg_width * homogeneous.uniaxial(law, stretch).energy_density
    )


def check_positive(values: dict[str, float]) -> None:
    """Raise ValueError unless all numbers, by their names, are positive and finite."""
    for name, value in values.items():
        check_number(value, f"the {name}")
        if not (np.isfinite(value) and value > 0):
            raise ValueError(f"the {name} must be positive and finite, not {value}")


def stretch_at_stress(law: Law, stress: float, what: str = "that stress") -> float:
    """Return the uniaxial stretch at which a law has a nominal stress, see `stretch_at`."""
    return stretch_at(
        law, lambda stretch: homogeneous.uniaxial(law, stretch).nominal_stress, stress, what
    )


def tension_states(law: Law, stretch: float) -> tuple[np.ndarray, np.ndarray, np.ndarray]:
    """Return stretches in uniaxial tension from 1 to a stretch, and `MOST_STRETCH` times beyond it
    unless the law ends before, the nominal stresses there, and the roots of the energy densities,
    shape (n,).

    The roots are nearly linear in the stress, which is the last one of the first `TABLE` at the
    stretch.
    """
    stretches = np.linspace(1.0, stretch, TABLE)
    beyond = 1 + np.geomspace(stretch - 1, MOST_STRETCH * stretch - 1, TABLE)[1:]
    stretches = np.append(stretches, beyond)
    stresses, ratios = homogeneous.sheet_states(law, stretches, np.full(len(stretches), np.nan))
    of = np.isfinite(stresses)
    stretches, stresses, ratios = stretches[of], stresses[of], ratios[of]
    F = np.column_stack([stretches, np.sqrt(ratios / stretches)])[:, None] * np.eye(2)
    return stretches, stresses, np.sqrt(np.maximum(PLANES["stress"].energy_at(law, F, ratios), 0.0))


def stretch_at(law: Law, quantity: Callable[[float], float], wanted: float, what: str) -> float:
    """Return the uniaxial stretch at which a quantity of a law, a function of the stretch, has a
    wanted value.

    Raise ValueError if the law reaches its greatest stretch before this value; `what` describes the
    wanted value in the message.
    """
    checked_law(law)
    upper = 1.1
    while quantity(upper) < wanted:
        lower = upper
        upper = 1.1 * upper
        try:
            quantity(upper)
        except ValueError:
            raise ValueError(
                f"{law.name} reaches its limit at the stretch {lower:.3g}, before it reaches {what}"
            ) from None
    return float(
        scipy.optimize.brentq(lambda stretch: quantity(stretch) - wanted, 1.0, upper, xtol=1e-12)
    )
