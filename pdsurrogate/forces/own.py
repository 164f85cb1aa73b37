"""A force that somebody writes in Python: run as it is, block by block in NumPy, at the speed of that."""

from __future__ import annotations

import ctypes
import warnings
from collections.abc import Iterator
from contextlib import contextmanager
from typing import ClassVar

import numpy as np

from ..body import Body
from ..engine.block_arrays import BLOCK, STATE_ROWS, TRACTION_ROWS
from ..engine.threads import thread_count
from ..kernels.bond_state import along_and_across, lateral_stretch
from ..materials import InvariantLaw, Law, plane_stress
from .analytic import bond_arrays
from .bond_force import ForceSurrogate
from .errors import InvalidState
from .internal_force import InternalForce
from .protocol import CompiledBondForce, Domain
from .settings import ForceSettings

_CALLED = ctypes.CFUNCTYPE(None, *[ctypes.c_void_p] * 3, ctypes.c_int64, *[ctypes.c_void_p] * 4)
"""The signature of a block function (`pdsurrogate.engine.compile.bond_force_signature`), in double precision."""

TRIAL = ([1.0, 1.3, 0.8, 1.1], [0.0, 0.2, -0.1, 0.05], [1.0, 0.5, 0.7, 0.2], [1.0, 0.7, 1.4, 0.9], [1.0, 1.2, 0.85, 1.05])
"""Bonds by which a force is tried before a run."""

INVARIANTS = ([3.2, 3.6, 4.5, 6.0], [3.25, 3.4, 5.0, 4.5])
"""I1bar and I2bar at which the derivatives of an energy are tried before a run."""

REST = np.array([[1.0, 0.0, 1.0, 1.0, 1.0, 1.0]]).T
"""A bond at rest, as a block has it: U_nn, U_nm, U_mm, J, C33, length."""

DIFFERENCE = 1e-3
"""Relative step of the difference quotients there: their own error is some 1e-6 of a derivative, in single precision 1e-3."""

MOST_OFF, NOTED = 1e-2, 1e-4
"""Of the greatest derivative or force that a trial gives (at rest of the shear modulus): by more than the first a derivative is not one,
and a force is none of isotropic rubber, and is refused; by more than the second it is said."""

NOTED_OF_QUOTIENTS = 2e-3
"""The same of derivatives: what a difference quotient in single precision may be off by itself is half of it."""

NEAR_REST = 3.0001
"""Invariants at which the shear modulus of an energy is taken: at 3 itself its derivatives may not be defined."""


class OwnForceFailed(RuntimeError):
    """An error raised by a user's own force, or a result of it that is no force."""


class OwnForceInvalid(InvalidState):
    """A state in which a user's own force is not finite."""


def is_own_force(thing) -> bool:
    """Whether a user's object is a force of their own: it has a ``bond_force`` or an ``energy``."""
    return not isinstance(thing, type) and any(callable(getattr(thing, key, None)) for key in ("bond_force", "energy"))


class OwnBondForce(ForceSurrogate):
    """A bond force, or an isochoric energy, of a user's own, evaluated in NumPy.

    Parameters
    ----------
    thing : object
        With a ``bond_force(stretch, rotation, length, C33, J)`` as `ForceSurrogate.bond_force`, of vectors; or with an
        ``energy(I1bar, I2bar)`` that gives W and its derivatives by both, vectors too, in units of the shear modulus.  The force must be
        isotropic: what it has across a bond is that along a bond across it.  The thickness of the points is that of the scene's material,
        as with every bond force.

    Raises
    ------
    TypeError
        If it has neither.

    Examples
    --------
    >>> import pdsurrogate as pds
    >>> class Mine:
    ...     def energy(self, I1, I2):
    ...         return 0.5 * (I1 - 3), 0.5 + 0 * I1, 0 * I1
    >>> pds.forces.OwnBondForce(Mine())
    <OwnBondForce Mine>
    """

    features = ("stretch", "rotation", "length", "C33", "J")
    domain: Domain | None = None
    gives_transverse = True
    default_precision = "float64"
    several_materials = ()
    honours: ClassVar = {
        "precision": ("float64",),
        "correction": ("tensor", "scalar", "none"),
        "rotation": ("polar", "convected"),
        "breakable": (True,),
        "plane": ("stress",),
    }

    def __init__(self, thing) -> None:
        if not is_own_force(thing):
            raise TypeError(
                f"a force of one's own has bond_force(stretch, rotation, length, C33, J) or energy(I1bar, I2bar), not {thing!r}"
            )
        self.thing, self.name = thing, type(thing).__name__
        self.failure: Exception | None = None
        self._callback = _CALLED(self._evaluate_block)  # kept: its address is handed around

    def bond_force(self, stretch, rotation, length, C33, J) -> np.ndarray:
        """Dimensionless (t_n, t_tau) of theory (9); see `ForceSurrogate.bond_force`.

        Raises
        ------
        ValueError
            If it is not finite; says at which bond.
        """
        try:
            return self._force(*bond_arrays(stretch, rotation, length, C33, J))
        except OwnForceInvalid as error:
            raise ValueError(str(error)) from error

    def _force(self, stretch, rotation, length, C33, J) -> np.ndarray:
        if self._gives_force:
            force = self._checked("bond_force", self.thing.bond_force(stretch, rotation, length, C33, J), (len(stretch), 2))
        else:
            a, b = stretch * np.cos(rotation), stretch * np.sin(rotation)
            T_nn, T_nm, _ = plane_stress.bond_traction(_LawOf(self), a, b, J, C33)
            force = along_and_across(T_nn, T_nm, a, b, stretch)
        bad = np.flatnonzero(~np.isfinite(force).all(axis=1))
        if len(bad):
            bond = (quantity[bad[0]] for quantity in (stretch, rotation, length, C33, J))
            raise OwnForceInvalid(self._not_finite(force[bad[0]], *bond))
        return force

    def _not_finite(self, force, stretch, rotation, length, C33, J) -> str:
        """Say what is not finite, and at which state."""
        bond = f"stretch = {stretch:.6g}, rotation = {rotation:.6g}, length = {length:.6g}, C33 = {C33:.6g}, J = {J:.6g}"
        if self._gives_force:
            return f"{self.name}: bond_force gives ({force[0]:.6g}, {force[1]:.6g}), which is not finite, at {bond}"
        a, b = stretch * np.cos(rotation), stretch * np.sin(rotation)
        I1, I2 = _invariants(a, b, lateral_stretch(a, b, J), J, C33)
        found = (part.item() for part in self.energy(np.array([I1]), np.array([I2])))
        return f"{self._energy_not_finite(I1, I2, *found)}, of a bond with {bond}"

    def _energy_not_finite(self, I1, I2, W, W1, W2) -> str:
        what = f"W = {W:.6g}, dW/dI1bar = {W1:.6g}, dW/dI2bar = {W2:.6g}"
        return f"{self.name}: energy gives {what}, which is not finite, at I1bar = {I1:.6g}, I2bar = {I2:.6g}"

    def energy(self, I1, I2) -> tuple[np.ndarray, np.ndarray, np.ndarray]:
        """W and its derivatives, of an object that gives them."""
        found = self.thing.energy(I1, I2)
        if not isinstance(found, tuple) or len(found) != 3:
            raise OwnForceFailed(f"{self.name}: energy must return W, dW/dI1bar and dW/dI2bar, not {type(found).__name__}")
        return tuple(self._checked("energy", np.broadcast_to(part, np.shape(I1)), np.shape(I1)) for part in found)

    def _checked(self, what: str, values, shape: tuple[int, ...]) -> np.ndarray:
        if np.iscomplexobj(values):
            raise OwnForceFailed(f"{self.name}: {what} must return real numbers, not complex ones")
        values = np.asarray(values, dtype=float)
        if values.shape != shape:
            raise OwnForceFailed(f"{self.name}: {what} must return an array of shape {shape}, not {values.shape}")
        return values

    def _tractions(self, a, b, U_mm, J, C33, length) -> np.ndarray:
        """T_nn, T_nm and T_mm: the last is the normal traction of the bond across, whose stretch tensor has the other two components."""
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
            # Where a point has no state the evaluation itself says so; a user's own function is not asked about it, nor about the bonds
            # that fill the last block, which have no length.
            has_state = np.isfinite(rows).all(axis=0) & (rows[3] > 0) & (rows[4] > 0)
            rows = np.where(has_state & (rows[5] > 0), rows, REST)
            result[:] = np.where(has_state, self._tractions(*rows), np.nan)
        except Exception as error:  # it cannot pass through compiled code; the evaluation raises it
            self.failure = error
            result[:] = np.nan

    def compiled(self, dtype) -> CompiledBondForce:
        """The address of a function that calls Python."""
        address = ctypes.cast(self._callback, ctypes.c_void_p).value
        return CompiledBondForce(address, np.zeros(1, dtype=np.int64), np.zeros(1, dtype=dtype), 0, needs_length=True)

    def check_material(self, law: Law) -> None:
        """Try the force on a few bonds, and the derivatives of an energy at a few invariants.

        Raises
        ------
        ValueError
            If it fails, or is not finite; if a derivative is not that of the energy, or a force is not zero at rest or not isotropic.

        Warns
        -----
        UserWarning
            If it is slightly so, or an energy has another shear modulus than 1.
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
        except Warning:  # made an error by whoever called
            raise
        except Exception as error:
            raise ValueError(f"{self.name} fails on bonds of stretches {TRIAL[0]}: {type(error).__name__}: {error}") from error

    @property
    def _gives_force(self) -> bool:
        """Whether the object has a ``bond_force``, which counts before an ``energy``."""
        return callable(getattr(self.thing, "bond_force", None))

    def _check_derivatives(self) -> None:
        """Derivatives of an energy by I1bar and I2bar, as it gives them, against difference quotients of its values."""
        at, quotients = np.array(INVARIANTS), []
        for number in range(2):
            step = np.zeros_like(at)
            step[number] = DIFFERENCE * at[number]
            quotients.append((self.energy(*(at + step))[0] - self.energy(*(at - step))[0]) / (2 * step[number]))
        found = np.stack(self.energy(*at))
        bad = np.flatnonzero(~(np.isfinite(found) & np.isfinite(quotients).all(axis=0)).all(axis=0))
        if len(bad):
            raise OwnForceInvalid(f"{self._energy_not_finite(*at[:, bad[0]], *found[:, bad[0]])}, or is not close by")
        derivatives, quotients = found[1:], np.stack(quotients)
        # Each against its own size, but what is a hundredth of the other against that.
        sizes = np.maximum(np.abs(derivatives), np.abs(quotients)).max(axis=1, keepdims=True)
        sizes = np.maximum(sizes, max(0.01 * sizes.max(), 1e-300))
        off = np.abs(derivatives - quotients) / sizes
        number, worst = np.unravel_index(off.argmax(), off.shape)
        I1, I2 = at[:, worst]
        self._judge(
            off[number, worst],
            f"{self.name}: dW/dI{number + 1}bar is not the derivative of its W: at I1bar = {I1:g}, I2bar = {I2:g} it is "
            f"{derivatives[number, worst]:.6g}, and a difference quotient of W is {quotients[number, worst]:.6g}",
            NOTED_OF_QUOTIENTS,
        )

    def _check_modulus(self) -> None:
        """In units of the shear modulus an energy has one of 1; another is most likely a factor that was forgotten."""
        near = np.array([NEAR_REST])
        _, W1, W2 = self.energy(near, near)
        modulus = 2 * (W1 + W2).item()
        if not abs(modulus - 1) <= MOST_OFF:
            warnings.warn(
                f"{self.name}: energies are in units of the shear modulus, and this one has a shear modulus 2 (dW/dI1bar + dW/dI2bar) of "
                f"{modulus:.4g} of it at rest, where 1 was expected: the material will be {modulus:.4g} times as stiff as the scene says",
                stacklevel=4,
            )

    def _check_rest(self) -> None:
        lengths = np.array(TRIAL[2])
        force = self._force(*bond_arrays(1.0, 0.0, lengths, 1.0, 1.0))
        worst = np.linalg.norm(force, axis=1).argmax()
        t_n, t_tau = force[worst]
        self._judge(
            np.hypot(t_n, t_tau),
            f"{self.name} is not zero at rest: bond_force(stretch=1, rotation=0, length={lengths[worst]:g}, C33=1, J=1) is ({t_n:.3g}, "
            f"{t_tau:.3g}) in units of the shear modulus; take off what it gives there",
        )

    def _check_isotropy(self, found: np.ndarray) -> None:
        """A bond turned the other way has the force mirrored; the stress by bonds along and across has the axes of the stretch."""
        stretch, rotation, length, C33, J = (np.array(quantity) for quantity in TRIAL)
        size = np.linalg.norm(found, axis=1).max()
        mirrored = self._force(stretch, -rotation, length, C33, J) * [1, -1]
        off = np.linalg.norm(mirrored - found, axis=1)
        worst = off.argmax()
        self._judge(
            off[worst] / size,
            f"{self.name} tells one way of turning from the other: at stretch {stretch[worst]:g} it is ({found[worst, 0]:.4g}, "
            f"{found[worst, 1]:.4g}) for a rotation of {rotation[worst]:g}, and of {-rotation[worst]:g} not that with the second turned "
            f"round, but ({mirrored[worst, 0]:.4g}, {-mirrored[worst, 1]:.4g}); isotropic rubber does not",
        )
        a, b = stretch * np.cos(rotation), stretch * np.sin(rotation)
        U_mm = (J + b * b) / a
        T_nn, T_nm, T_mm = self._tractions(a, b, U_mm, J, C33, length)
        off = np.abs(T_nm * (a - U_mm) - b * (T_nn - T_mm))
        worst = off.argmax()
        self._judge(
            off[worst] / size,
            f"{self.name} is not isotropic: the stress by the bond of stretch {stretch[worst]:g} and rotation {rotation[worst]:g} and that "
            f"across it has not the axes of their stretch tensor (off by {off[worst] / size:.2g} of the force); the part of the force "
            "across a bond follows from those along it and along the bond across it",
        )

    def _judge(self, off: float, what: str, noted: float = NOTED) -> None:
        """Refuse what is off by much, and say what is by little."""
        if not off <= MOST_OFF:
            raise OwnForceInvalid(what)
        if off > noted:
            warnings.warn(what, stacklevel=4)

    def bind(self, body: Body, law: Law, settings: ForceSettings) -> InternalForce:
        # Python runs on one thread, that which calls.
        with thread_count(1):
            return super().bind(body, law, settings)

    @contextmanager
    def guarded(self) -> Iterator[None]:
        """Return a context that raises the error of the user's own code in place of what follows from it."""
        self.failure = None
        try:
            yield
        except Exception:
            if self.failure is None:
                raise
        if isinstance(self.failure, OwnForceFailed | OwnForceInvalid):
            raise self.failure
        if self.failure is not None:
            raise OwnForceFailed(f"{self.name}: {type(self.failure).__name__}: {self.failure}") from self.failure

    def payload(self) -> dict:
        return {"class": f"{type(self.thing).__module__}.{type(self.thing).__qualname__}"}


class _LawOf(InvariantLaw):
    """An energy of a user's own in the place of a law's, in NumPy alone."""

    name: ClassVar[str] = "own"
    reference: ClassVar[str] = ""

    def __init__(self, own: OwnBondForce) -> None:
        super().__init__()
        object.__setattr__(self, "own", own)

    @property
    def parameters(self) -> np.ndarray:
        return np.array([self.bulk_modulus / self.shear_modulus])

    def isochoric(self, I1, I2, parameters):
        """W and its first derivatives; the second ones are not asked for at a given thickness."""
        W, W1, W2 = self.own.energy(I1, I2)
        return W, W1, W2, 0 * W, 0 * W, 0 * W


def _invariants(a, b, U_mm, J, C33) -> tuple:
    """I1bar and I2bar of bonds."""
    return plane_stress.isochoric_invariants((a * a + 2 * b * b + U_mm * U_mm, J, J * np.sqrt(C33)))


def _rows_at(address: int, rows: int) -> np.ndarray:
    return np.ctypeslib.as_array(ctypes.cast(address, ctypes.POINTER(ctypes.c_double)), (rows, BLOCK))
