"""Sensitivities of an equilibrium: derivatives of the measurements of an output with respect to
parameters of the scene.
"""

from dataclasses import dataclass

import numpy as np


@dataclass(frozen=True)
class Sensitivities:
    """Derivatives of the measurements of an equilibrium with respect to parameters of its scene.

    Attributes
    ----------
    outputs : tuple of str
        Names of the measurements: dotted keys of an entry of `pdsurrogate.Result.levels`, such as
        ``"forces.right.0"``.
    parameters : tuple of str
        Names of the parameters: dotted keys of the scene, such as ``"material.shear_modulus"``, or
        the loading parameter.
    values : ndarray, shape (outputs,)
        Measurements in the equilibrium.
    derivatives : ndarray, shape (outputs, parameters)
        Derivative of each measurement with respect to each parameter, in the unit of the
        measurement over that of the parameter.
    displacements : ndarray, shape (parameters, n, d), or None
        Derivatives of the displacements of all points; None if there are fewer measurements than
        parameters, where adjoint equations are solved, one for each measurement.
    errors : ndarray, shape (outputs, parameters)
        Estimated errors of the derivatives, since linear equations are solved approximately and
        forces are rounded.

    See Also
    --------
    pdsurrogate.Result.sensitivity : returns sensitivities.
    """

    outputs: tuple[str, ...]
    parameters: tuple[str, ...]
    values: np.ndarray
    derivatives: np.ndarray
    displacements: np.ndarray | None
    errors: np.ndarray
