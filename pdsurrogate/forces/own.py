"""Bond forces and energies that users write in Python, evaluated in NumPy and therefore slower than
compiled models.
"""

import warnings
from collections.abc import Mapping
from functools import partial
from typing import ClassVar

import numpy as np

from ..errors import InvalidState
from ..kernels.bond_force import lateral_stretch
from ..materials import InvariantLaw, Law
from ..materials.consistency import compare_derivatives
from .bond_force import ForceSurrogate, bond_arrays, exact_bond_force
from .compiled_force import CompiledBondForce
from .pair_forces import BondStates

TRIAL = (
    [1.0, 1.3, 0.8, 1.1],
    [0.0, 0.2, -0.1, 0.05],
    [1.0, 0.5, 0.7, 0.2],
    [1.0, 0.7, 1.4, 0.9],
    [1.0, 1.2, 0.85, 1.05],
)
"""Stretches, rotations, lengths, C33 and J of four bonds at which a user's own force is checked
before a run.
"""

INVARIANTS = ([3.2, 3.6, 4.5, 6.0], [3.25, 3.4, 5.0, 4.5])
"""I1bar and I2bar at which the derivatives of an energy are compared with its values before a
run.
"""

RESULTS = {"bond_force": ("t_n", "t_tau"), "energy": ("W", "dW/dI1bar", "dW/dI2bar")}
"""Values that the methods of a user's own force return, in their order."""

MOST_OFF = 1e-2
NOTED = 2e-3
"""Relative errors beyond which a user's own force is refused (`MOST_OFF`), and beyond which there
is a warning (`NOTED`).

Errors of forces are relative to the greatest force of the trial, forces of undeformed bonds to the
shear modulus, and errors of derivatives to the derivative. Chosen: a wrong formula is off by a
factor or a term, more than the first; single precision leaves less than the second.
"""

NEAR_REST = 3.0001
"""Value of both invariants at which the shear modulus of an energy is computed: at 3 itself its
derivatives may be undefined.
"""


class OwnForceFailed(RuntimeError):
    """Error: Python code of a user's own force raised an exception, or returned something that
    is not a force.
    """


class OwnForceInvalid(InvalidState):
    """Error: a user's own force is not finite at a state, or fails a check of its values."""


def is_own_force(thing) -> bool:
    """Return whether an object is a user's own force: whether it has a method ``bond_force`` or
    ``energy``.
    """
    return not isinstance(thing, type) and any(
        callable(getattr(thing, key, None)) for key in ("bond_force", "energy")
    )


class OwnBondForce(ForceSurrogate):
    """Force model made of a bond force or isochoric energy that a user wrote in Python, evaluated
    in NumPy.

    Parameters
    ----------
    thing : object
        Object with a method ``bond_force(stretch, rotation, length, C33, J)`` of vectors, as
        `ForceSurrogate.bond_force`; or with a method ``energy(I1bar, I2bar)`` of vectors that
        returns W and its derivatives by both, in units of the shear modulus. The force must be
        isotropic: the transverse component T_mm of a bond is T_nn of a bond perpendicular to it.
        The thickness of the points follows from the scene's material, as with every bond force.

    Raises
    ------
    TypeError
        If the object has neither method.

    See Also
    --------
    pdsurrogate.simulate : takes the user's object as it is.
    pdsurrogate.forces.ForceSurrogate : base class of compiled bond forces.

    Examples
    --------
    >>> import pdsurrogate as pds
    >>> class Mine:
    ...     def energy(self, I1, I2):
    ...         return 0.5 * (I1 - 3), 0.5 + 0 * I1, 0 * I1
    >>> pds.forces.OwnBondForce(Mine())
    <OwnBondForce Mine>
    """

    domain = None
    several_materials = ()

    @property
    def honors(self) -> Mapping[str, tuple]:
        return {**super().honors, "precision": ("float64",), "plane": ("stress",)}

    def __init__(self, thing) -> None:
        if not is_own_force(thing):
            raise TypeError(
                "a force needs a method bond_force(stretch, rotation, length, C33, J) or"
                f" energy(I1bar, I2bar), not {thing!r}"
            )
        self.thing = thing
        self.name = type(thing).__name__
        # a bond force takes precedence over an energy
        self._gives_force = callable(getattr(thing, "bond_force", None))

    def bond_force(self, stretch, rotation, length, C33, J) -> np.ndarray:
        """Return the dimensionless bond force of the user's object.

        Parameters
        ----------
        stretch, rotation, length, C33, J : array_like, shape (n,)
            Quantities of the bonds, as for `ForceSurrogate.bond_force`.

        Returns
        -------
        ndarray, shape (n, 2)
            Components along and across the deformed bond, in units of w l mu/kappa.

        Raises
        ------
        ValueError
            If the force is not finite; the message names the bond.

        Examples
        --------
        >>> import pdsurrogate as pds
        >>> class Linear:
        ...     def bond_force(self, stretch, rotation, length, C33, J):
        ...         import numpy as np
        ...
        ...         return np.stack([stretch - 1, 0 * stretch], axis=1)
        >>> pds.forces.OwnBondForce(Linear()).bond_force([1.0, 1.5], 0.0, 1.0, 1.0, 1.0).tolist()
        [[0.0, 0.0], [0.5, 0.0]]
        """
        try:
            return self._force(*bond_arrays(stretch, rotation, length, C33, J))
        except OwnForceInvalid as error:
            raise ValueError(str(error)) from error

    def _force(self, *bonds: np.ndarray) -> np.ndarray:
        """Return the checked bond force, shape (n, 2), at vectors of the five bond quantities,
        from the user's force or energy.
        """
        if self._gives_force:
            return self._values("bond_force", **dict(zip(self.features, bonds, strict=True))).T
        stretch, rotation, _, C33, J = bonds
        return exact_bond_force(_LawOf(self), stretch, rotation, C33, J)

    def energy(self, I1, I2) -> np.ndarray:
        """Return W and its derivatives from the user's ``energy``, checked for shape and finite
        values.

        Parameters
        ----------
        I1, I2 : array_like
            Isochoric invariants I1bar and I2bar, of one shape.

        Returns
        -------
        ndarray, shape (3, ...)
            W, and its derivatives by I1bar and by I2bar, in units of mu.

        Raises
        ------
        OwnForceFailed
            If the user's code raises an error or returns something else.
        OwnForceInvalid
            If a value is not finite.

        Examples
        --------
        >>> import pdsurrogate as pds
        >>> class Mine:
        ...     def energy(self, I1, I2):
        ...         return 0.5 * (I1 - 3), 0.5 + 0 * I1, 0 * I1
        >>> pds.forces.OwnBondForce(Mine()).energy([3.0, 4.0], [3.0, 4.0]).tolist()
        [[0.0, 0.5], [0.5, 0.5], [0.0, 0.0]]
        """
        I1, I2 = np.broadcast_arrays(I1, I2)
        return self._values("energy", I1bar=I1.ravel(), I2bar=I2.ravel()).reshape(-1, *I1.shape)

    def _values(self, method: str, **states: np.ndarray) -> np.ndarray:
        """Return what a method of the user's object gives at n states, shape (values, n), after
        checks for shape and finite numbers.
        """
        names = RESULTS[method]
        count = len(next(iter(states.values())))
        try:
            found = getattr(self.thing, method)(*states.values())
            rows = (
                np.asarray(found).T
                if self._gives_force
                else np.array([np.broadcast_to(part, count) for part in found])
            )
        except Exception as error:
            raise OwnForceFailed(f"{self.name}: {type(error).__name__}: {error}") from error
        if rows.shape != (len(names), count) or rows.dtype.kind not in "biuf":
            what = (
                f"{', '.join(names)},"
                f" {'an array of shape (n, 2)' if self._gives_force else 'a tuple of vectors'} of"
                " real numbers"
            )
            raise OwnForceFailed(
                f"{self.name}: {method} must return {what}, not {rows.dtype} of shape"
                f" {rows.T.shape}, for n = {count}"
            )
        bad = np.flatnonzero(~np.isfinite(rows).all(axis=0))
        if len(bad):
            pairs = zip(names, rows, strict=True), states.items()
            given, at = (
                ", ".join(f"{key} = {values[bad[0]]:.6g}" for key, values in some) for some in pairs
            )
            raise OwnForceInvalid(
                f"{self.name}: {method} returned {given}, which is not finite, at {at}"
            )
        return rows.astype(float)

    def tractions(self, states: BondStates) -> np.ndarray:
        """Return the stress components T_nn, T_nm and T_mm (theory (11)) of bonds.

        T_mm is T_nn of a perpendicular bond, whose stretch tensor has the components U_mm and
        -U_nm.

        Parameters
        ----------
        states : BondStates
            States of n bonds.

        Returns
        -------
        ndarray, shape (3, n)

        Examples
        --------
        >>> import numpy as np
        >>> import pdsurrogate as pds
        >>> from pdsurrogate.forces.pair_forces import BondStates
        >>> class Mine:
        ...     def energy(self, I1, I2):
        ...         return 0.5 * (I1 - 3), 0.5 + 0 * I1, 0 * I1
        >>> rest = BondStates(*np.array([[1.0], [0.0], [1.0], [1.0], [1.0]]))
        >>> pds.forces.OwnBondForce(Mine()).tractions(rest).shape
        (3, 1)
        """
        a = states.a
        b = states.b
        J = states.J
        twice = np.concatenate([[states.length, states.C33, J]] * 2, axis=1)
        normal = np.concatenate([a, lateral_stretch(a, b, J)])
        shear = np.concatenate([b, -b])
        stretch = np.hypot(normal, shear)
        t_n, t_tau = self._force(stretch, np.arctan2(shear, normal), *twice).T / stretch
        along, theirs = np.split(t_n * normal - t_tau * shear, 2)
        return np.stack([along, t_n[: len(a)] * b + t_tau[: len(a)] * a, theirs])

    def compiled(self, dtype) -> CompiledBondForce:
        return CompiledBondForce(0, np.zeros(1, dtype=np.int64), np.zeros(1, dtype=dtype), 0)

    def check_material(self, law: Law) -> None:
        """Check the user's force at a few bonds, or the derivatives of the user's energy at a few
        invariants.

        Parameters
        ----------
        law : Law
            Without effect: the force does not depend on a law.

        Raises
        ------
        ValueError
            If the object fails, or returns values that are not finite; if a derivative is not that
            of the energy; or if a force is not zero at rest or not isotropic.

        Warns
        -----
        UserWarning
            If the shear modulus of an energy is not 1, or if a derivative or a force is off by more
            than `NOTED`.

        Examples
        --------
        >>> import pdsurrogate as pds
        >>> class Wrong:
        ...     def energy(self, I1, I2):
        ...         return 0.5 * (I1 - 3), 0.6 + 0 * I1, 0 * I1
        >>> try:
        ...     pds.forces.OwnBondForce(Wrong()).check_material(pds.materials.NeoHookean())
        ... except ValueError as error:
        ...     print("dW/dI1bar" in str(error))
        True
        """
        try:
            found = self._force(*bond_arrays(*TRIAL))
            if self._gives_force:
                self._check_force(found)
            else:
                self._check_energy()
        except (OwnForceFailed, OwnForceInvalid) as error:
            raise ValueError(str(error)) from error

    def _check_energy(self) -> None:
        """Check that the user's derivatives are those of the energy; warn if its shear modulus
        is not 1 (a forgotten factor).
        """
        of_W = [1, 0, 0]
        names = RESULTS["energy"]
        first, second = np.eye(2)
        derivatives = [(names[1], 1, of_W, first), (names[2], 2, of_W, second)]
        states = dict(zip(("I1bar", "I2bar"), np.array(INVARIANTS), strict=True))
        compare = partial(
            compare_derivatives, self.name, "energy", self.energy, states, derivatives, 1.0
        )
        try:
            compare(NOTED)
        except ValueError as problem:
            compare(MOST_OFF)
            warnings.warn(str(problem), stacklevel=3)
        near = np.array([NEAR_REST])
        modulus = 2 * float(self.energy(near, near)[1:].sum())
        if not abs(modulus - 1) <= MOST_OFF:
            warnings.warn(
                f"{self.name}: energy must be divided by the shear modulus, so that 2 (dW/dI1bar +"
                f" dW/dI2bar) at rest is 1, but it is {modulus:.4g}: the material will be"
                f" {modulus:.4g} times as stiff as the scene states",
                stacklevel=3,
            )

    def _check_force(self, found: np.ndarray) -> None:
        """Check that the user's bond force vanishes at rest and is isotropic; `found` is the
        force at the bonds `TRIAL`.
        """
        trial = bond_arrays(*TRIAL)
        rest = bond_arrays(1.0, 0.0, TRIAL[2], 1.0, 1.0)
        stretch, rotation, length, C33, J = trial
        size = np.linalg.norm(found, axis=1).max()
        mirrored = self._force(stretch, -rotation, length, C33, J) * [1, -1]
        a = stretch * np.cos(rotation)
        b = stretch * np.sin(rotation)
        U_mm = lateral_stretch(a, b, J)
        T_nn, T_nm, T_mm = self.tractions(BondStates(a, b, length, C33, J))
        for bonds, off, what in (
            (
                rest,
                np.linalg.norm(self._force(*rest), axis=1),
                "is not zero at rest; subtract its value there",
            ),
            (
                trial,
                np.linalg.norm(mirrored - found, axis=1) / size,
                (
                    "distinguishes one sense of rotation from the other; in isotropic rubber the"
                    " opposite rotation negates t_tau alone"
                ),
            ),
            (
                trial,
                np.abs(T_nm * (a - U_mm) - b * (T_nn - T_mm)) / size,
                (
                    "is not isotropic: the stress by the bond and that across it has not the axes"
                    " of their stretch tensor; t_tau of a bond follows from t_n along the bond and"
                    " of the bond across it"
                ),
            ),
        ):
            worst = int(off.argmax())
            bond = ", ".join(
                f"{key} = {values[worst]:g}"
                for key, values in zip(self.features, bonds, strict=True)
            )
            problem = f"{self.name} {what}: off by {off[worst]:.2g} at {bond}"
            if not off[worst] <= MOST_OFF:
                raise OwnForceInvalid(problem)
            if off[worst] > NOTED:
                warnings.warn(problem, stacklevel=3)

    def payload(self) -> dict:
        return {"class": f"{type(self.thing).__module__}.{type(self.thing).__qualname__}"}


class _LawOf(InvariantLaw):
    """Material law whose isochoric energy is the one a user wrote, for evaluation in NumPy
    alone.
    """

    name: ClassVar[str] = "own"
    reference: ClassVar[str] = ""

    def __init__(self, own: OwnBondForce) -> None:
        super().__init__()
        object.__setattr__(self, "own", own)

    def isochoric(self, I1, I2, parameters):
        """Return the user's W and its first derivatives by I1bar and I2bar; second derivatives
        are zero, as nothing needs them here.
        """
        W, W1, W2 = self.own.energy(I1, I2)
        return W, W1, W2, 0 * W, 0 * W, 0 * W
