"""Bond forces and energies that users write in Python, evaluated block by block in NumPy and therefore slower than compiled models."""

import ctypes
import warnings
from collections.abc import Mapping
from typing import ClassVar

import numpy as np

from ..body import Body
from ..engine.block_arrays import BLOCK, STATE_ROWS, TRACTION_ROWS
from ..engine.threads import thread_count
from ..materials import InvariantLaw, Law
from .bond_force import ForceSurrogate, bond_arrays, exact_bond_force
from .errors import InvalidState
from .internal_force import InternalForce
from .protocol import CompiledBondForce
from .settings import ForceSettings

_CALLED = ctypes.CFUNCTYPE(None, *[ctypes.c_void_p] * 3, ctypes.c_int64, *[ctypes.c_void_p] * 4)
"""Signature of a function compiled for blocks of bonds (`pdsurrogate.engine.compile.bond_force_signature`), in double precision."""

TRIAL = ([1.0, 1.3, 0.8, 1.1], [0.0, 0.2, -0.1, 0.05], [1.0, 0.5, 0.7, 0.2], [1.0, 0.7, 1.4, 0.9], [1.0, 1.2, 0.85, 1.05])
"""Stretches, rotations, lengths, C33 and J of four bonds at which a user's own force is checked before a run."""

INVARIANTS = ([3.2, 3.6, 4.5, 6.0], [3.25, 3.4, 5.0, 4.5])
"""I1bar and I2bar at which the derivatives of an energy are compared with its values before a run."""

REST = np.array([[1.0, 0.0, 1.0, 1.0, 1.0, 1.0]]).T
"""State of a bond at rest in a block: U_nn, U_nm, U_mm, J, C33, length."""

DIFFERENCE = 1e-3
"""Relative step of the difference quotients at `INVARIANTS`: their error is about 1e-6 of a derivative, in single precision 1e-3."""

MOST_OFF, NOTED = 1e-2, 1e-4
"""Errors, relative to the greatest derivative or force of a trial (at rest, to the shear modulus), beyond which a derivative or a force is
refused, and beyond which there is a warning. Chosen: a wrong formula is off by a factor or a term, far more than the first; a right one by
rounding, far less than the second."""

NOTED_OF_QUOTIENTS = 2e-3
"""Error of a derivative beyond which there is a warning: a difference quotient in single precision may itself be off by half of it."""

NEAR_REST = 3.0001
"""Value of both invariants at which the shear modulus of an energy is computed: at 3 itself its derivatives may be undefined."""


class OwnForceFailed(RuntimeError):
    """Error: Python code of a user's own force raised an exception, or returned something that is not a force."""


class OwnForceInvalid(InvalidState):
    """Error: a user's own force is not finite at a state, or fails a check of its values."""


def is_own_force(thing) -> bool:
    """Return whether an object is a user's own force: whether it has a method ``bond_force`` or ``energy``."""
    return not isinstance(thing, type) and any(callable(getattr(thing, key, None)) for key in ("bond_force", "energy"))


class OwnBondForce(ForceSurrogate):
    """Force model made of a bond force or isochoric energy that a user wrote in Python, evaluated in NumPy.

    Parameters
    ----------
    thing : object
        Object with a method ``bond_force(stretch, rotation, length, C33, J)`` of vectors, as `ForceSurrogate.bond_force`; or with a method
        ``energy(I1bar, I2bar)`` of vectors that returns W and its derivatives by both, in units of the shear modulus. The force must be
        isotropic: the transverse component T_mm of a bond is T_nn of a bond perpendicular to it. The thickness of the points follows from
        the scene's material, as with every bond force.

    Raises
    ------
    TypeError
        If the object has neither method.

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
    def honours(self) -> Mapping[str, tuple]:
        return {**super().honours, "precision": ("float64",), "plane": ("stress",)}

    def __init__(self, thing) -> None:
        if not is_own_force(thing):
            raise TypeError(
                f"a force of one's own has bond_force(stretch, rotation, length, C33, J) or energy(I1bar, I2bar), not {thing!r}"
            )
        self.thing, self.name = thing, type(thing).__name__
        self.failure: Exception | None = None
        self._gives_force = callable(getattr(thing, "bond_force", None))  # a bond force takes precedence over an energy
        self._callback = _CALLED(self._evaluate_block)  # a reference is kept, since compiled code holds its address

    def bond_force(self, stretch, rotation, length, C33, J) -> np.ndarray:
        """Return the dimensionless bond force, see `ForceSurrogate.bond_force`.

        Raises
        ------
        ValueError
            If the force is not finite; the message names the bond.
        """
        try:
            return self._force(*bond_arrays(stretch, rotation, length, C33, J))
        except OwnForceInvalid as error:
            raise ValueError(str(error)) from error

    def _force(self, *bonds: np.ndarray) -> np.ndarray:
        """Return the checked bond force, shape (n, 2), at vectors of the five bond quantities, from the user's force or energy."""
        if not self._gives_force:
            stretch, rotation, _, C33, J = bonds
            return exact_bond_force(_LawOf(self), stretch, rotation, C33, J)
        force = self._checked("bond_force", self.thing.bond_force(*bonds), (len(bonds[0]), 2))
        self._check_finite("bond_force gives ({:.6g}, {:.6g})", force.T, dict(zip(self.features, bonds, strict=True)))
        return force

    def energy(self, I1, I2) -> tuple[np.ndarray, np.ndarray, np.ndarray]:
        """Return W and its derivatives by I1bar and I2bar from the user's ``energy``, checked for shape and finite values."""
        found = self.thing.energy(I1, I2)
        if not isinstance(found, tuple) or len(found) != 3:
            raise OwnForceFailed(f"{self.name}: energy must return W, dW/dI1bar and dW/dI2bar, not {type(found).__name__}")
        found = tuple(self._checked("energy", np.broadcast_to(part, np.shape(I1)), np.shape(I1)) for part in found)
        components = "W = {:.6g}, dW/dI1bar = {:.6g}, dW/dI2bar = {:.6g}"
        self._check_finite(f"energy gives {components}", found, {"I1bar": I1, "I2bar": I2})
        return found

    def _checked(self, what: str, values, shape: tuple[int, ...]) -> np.ndarray:
        """Return values as an array of doubles; raise OwnForceFailed if they are complex or not of the given shape."""
        if np.iscomplexobj(values):
            raise OwnForceFailed(f"{self.name}: {what} must return real numbers, not complex ones")
        values = np.asarray(values, dtype=float)
        if values.shape != shape:
            raise OwnForceFailed(f"{self.name}: {what} must return an array of shape {shape}, not {values.shape}")
        return values

    def _check_finite(self, what: str, found, state: dict[str, np.ndarray]) -> None:
        """Raise OwnForceInvalid if values found are not finite; `what` is a format string of the values, `state` the arguments by name."""
        bad = np.flatnonzero(~np.isfinite(np.stack(found)).all(axis=0))
        if len(bad):
            given = what.format(*(part.flat[bad[0]] for part in found))
            at = (f"{key} = {part.flat[bad[0]]:.6g}" for key, part in state.items())
            raise OwnForceInvalid(f"{self.name}: {given}, which is not finite, at {', '.join(at)}")

    def _tractions(self, a, b, U_mm, J, C33, length) -> np.ndarray:
        """Return T_nn, T_nm and T_mm of bonds; T_mm is T_nn of a perpendicular bond, whose stretch tensor has components U_mm and -U_nm."""
        count, twice = len(a), np.concatenate([[length, C33, J]] * 2, axis=1)
        normal, shear = np.concatenate([a, U_mm]), np.concatenate([b, -b])
        stretch = np.hypot(normal, shear)
        t_n, t_tau = self._force(stretch, np.arctan2(shear, normal), *twice).T / stretch
        along = t_n * normal - t_tau * shear
        return np.stack([along[:count], t_n[:count] * b + t_tau[:count] * a, along[count:]])

    def _evaluate_block(self, states, sizes, weights, response, parameters, work, scratch, traction) -> None:
        result = _rows_at(traction, TRACTION_ROWS)
        try:
            rows = _rows_at(states, STATE_ROWS)
            # A point without a state is found by the evaluation itself. The user's function sees neither its bonds nor those that fill the
            # last block, which have no length.
            has_state = np.isfinite(rows).all(axis=0) & (rows[3] > 0) & (rows[4] > 0)
            rows = np.where(has_state & (rows[5] > 0), rows, REST)
            result[:] = np.where(has_state, self._tractions(*rows), np.nan)
        except Exception as error:  # an exception cannot pass through compiled code; the evaluation raises it later
            self.failure = error
            result[:] = np.nan

    def compiled(self, dtype) -> CompiledBondForce:
        """Return the function for blocks of bonds that compiled passes call; it calls back the user's Python code."""
        address = ctypes.cast(self._callback, ctypes.c_void_p).value or 0
        return CompiledBondForce(address, np.zeros(1, dtype=np.int64), np.zeros(1, dtype=dtype), 0, needs_length=True)

    def check_material(self, law: Law) -> None:
        """Check the user's force at a few bonds, or the derivatives of the user's energy at a few invariants.

        Raises
        ------
        ValueError
            If the object fails, or returns values that are not finite; if a derivative is not that of the energy; or if a force is not
            zero at rest or not isotropic.

        Warns
        -----
        UserWarning
            If such an error is small, or if the shear modulus of an energy is not 1.
        """
        try:
            found = self._force(*bond_arrays(*TRIAL))
            if self._gives_force:
                self._check_rest()
                self._check_isotropy(found)
            else:
                self._check_derivatives()
                self._check_modulus()
        except (OwnForceFailed, OwnForceInvalid) as error:
            raise ValueError(str(error)) from error
        except Warning:  # the caller turns the warning into an error
            raise
        except Exception as error:
            raise ValueError(f"{self.name} fails on bonds of stretches {TRIAL[0]}: {type(error).__name__}: {error}") from error

    def _check_derivatives(self) -> None:
        """Check the derivatives of the user's energy against difference quotients of its values; raise or warn by `_judge`."""
        at = np.array(INVARIANTS)
        derivatives, quotients = np.stack(self.energy(*at))[1:], np.empty_like(at)
        for number, step in enumerate(DIFFERENCE * at[:, None] * np.eye(2)[:, :, None]):
            quotients[number] = (self.energy(*(at + step))[0] - self.energy(*(at - step))[0]) / (2 * step[number])
        # Errors are relative to the size of each derivative, or to a hundredth of the other's if that is greater.
        sizes = np.maximum(np.abs(derivatives), np.abs(quotients)).max(axis=1, keepdims=True)
        off = np.abs(derivatives - quotients) / np.maximum(sizes, max(0.01 * sizes.max(), 1e-300))
        number, worst = np.unravel_index(off.argmax(), off.shape)
        I1, I2 = at[:, worst]
        self._judge(
            off[number, worst],
            f"{self.name}: dW/dI{number + 1}bar is not the derivative of its W: at I1bar = {I1:g}, I2bar = {I2:g} it is "
            f"{derivatives[number, worst]:.6g}, and a difference quotient of W is {quotients[number, worst]:.6g}",
            NOTED_OF_QUOTIENTS,
        )

    def _check_modulus(self) -> None:
        """Warn if the shear modulus of the user's energy is not 1: a factor has most likely been forgotten."""
        near = np.array([NEAR_REST])
        modulus = 2 * float(np.sum(self.energy(near, near)[1:]))
        if not abs(modulus - 1) <= MOST_OFF:
            warnings.warn(
                f"{self.name}: energies are in units of the shear modulus, and this one has a shear modulus 2 (dW/dI1bar + dW/dI2bar) of "
                f"{modulus:.4g} of it at rest, where 1 was expected: the material will be {modulus:.4g} times as stiff as the scene says",
                stacklevel=4,
            )

    def _check_rest(self) -> None:
        """Check that the user's bond force vanishes at rest for bonds of every length."""
        lengths = np.array(TRIAL[2])
        force = self._force(*bond_arrays(1.0, 0.0, lengths, 1.0, 1.0))
        off = np.linalg.norm(force, axis=1)
        worst = off.argmax()
        self._judge(
            off[worst],
            f"{self.name} is not zero at rest: bond_force(stretch=1, rotation=0, length={lengths[worst]:g}, C33=1, J=1) is "
            f"({force[worst, 0]:.3g}, {force[worst, 1]:.3g}) in units of the shear modulus; subtract its value there",
        )

    def _check_isotropy(self, found: np.ndarray) -> None:
        """Check that the user's force is isotropic: mirrored for the opposite rotation, stress and stretch with common principal axes.

        `found` is the force at the bonds `TRIAL`.
        """
        stretch, rotation, length, C33, J = (np.array(quantity) for quantity in TRIAL)
        size = np.linalg.norm(found, axis=1).max()
        mirrored = self._force(stretch, -rotation, length, C33, J) * [1, -1]
        off = np.linalg.norm(mirrored - found, axis=1) / size
        worst = off.argmax()
        self._judge(
            off[worst],
            f"{self.name} distinguishes one sense of rotation from the other: at stretch {stretch[worst]:g} it is ({found[worst, 0]:.4g}, "
            f"{found[worst, 1]:.4g}) for a rotation of {rotation[worst]:g}, and for {-rotation[worst]:g} not that with the second part "
            f"negated, but ({mirrored[worst, 0]:.4g}, {-mirrored[worst, 1]:.4g}); isotropic rubber does not",
        )
        a, b = stretch * np.cos(rotation), stretch * np.sin(rotation)
        U_mm = (J + b * b) / a
        T_nn, T_nm, T_mm = self._tractions(a, b, U_mm, J, C33, length)
        off = np.abs(T_nm * (a - U_mm) - b * (T_nn - T_mm)) / size
        worst = off.argmax()
        self._judge(
            off[worst],
            f"{self.name} is not isotropic: the stress by the bond of stretch {stretch[worst]:g} and rotation {rotation[worst]:g} and that "
            f"across it has not the axes of their stretch tensor (off by {off[worst]:.2g} of the force); the part of the force across a "
            "bond follows from those along it and along the bond across it",
        )

    def _judge(self, off: float, what: str, noted: float = NOTED) -> None:
        """Raise OwnForceInvalid with message `what` if an error `off` exceeds `MOST_OFF`, and warn if it exceeds `noted`."""
        if not off <= MOST_OFF:
            raise OwnForceInvalid(what)
        if off > noted:
            warnings.warn(what, stacklevel=4)

    def bind(self, body: Body, law: Law, settings: ForceSettings) -> InternalForce:
        # Python code must run on the calling thread only.
        with thread_count(1):
            return super().bind(body, law, settings)

    def cause_of(self, error: RuntimeError) -> RuntimeError:
        failure, self.failure = self.failure, None
        if failure is None or isinstance(failure, OwnForceFailed | OwnForceInvalid):
            return failure or error
        found = OwnForceFailed(f"{self.name}: {type(failure).__name__}: {failure}")
        found.__cause__ = failure
        return found

    def payload(self) -> dict:
        return {"class": f"{type(self.thing).__module__}.{type(self.thing).__qualname__}"}


class _LawOf(InvariantLaw):
    """Material law whose isochoric energy is the one a user wrote, for evaluation in NumPy alone."""

    name: ClassVar[str] = "own"
    reference: ClassVar[str] = ""

    def __init__(self, own: OwnBondForce) -> None:
        super().__init__()
        object.__setattr__(self, "own", own)

    @property
    def parameters(self) -> np.ndarray:
        return np.array([self.bulk_modulus / self.shear_modulus])

    def isochoric(self, I1, I2, parameters):
        """Return the user's W and its first derivatives by I1bar and I2bar; second derivatives are zero, as nothing needs them here."""
        W, W1, W2 = self.own.energy(I1, I2)
        return W, W1, W2, 0 * W, 0 * W, 0 * W


def _rows_at(address: int, rows: int) -> np.ndarray:
    return np.ctypeslib.as_array(ctypes.cast(address, ctypes.POINTER(ctypes.c_double)), (rows, BLOCK))
