"""Checks of a law: its coded derivatives are those of its energy; the undeformed material has no
stress and the law's stated moduli.

Stresses, tangents and the training data of surrogates use the coded derivatives alone, so that no
other test reveals a wrong one.
"""

from functools import partial

import numpy as np

from .law import InvariantLaw, Law

LOG_STRETCHES = np.array(
    [[0.0, 0.0], [1e-3, 0.0], [0.04, -0.01], [0.2, 0.1], [0.7, -0.3], [1.2, -0.7]]
)
"""Isochoric states by two principal log-stretches: undeformed, nearly so, and up to large
strains; those beyond a law's limit are skipped.
"""

_consistent: set = set()
"""Keys of the laws that have passed `check_consistency` in this process: class, expressions and
parameters.
"""


def check_consistency(law: Law) -> None:
    """Check the derivatives of a law against its energy, and its undeformed state, once per process
    for each class and set of parameters.

    Raise ValueError if a derivative is not that of the energy, or if the undeformed law has a
    stress or moduli other than those it states; the message names the derivative, the law's value
    and the right one.
    """
    parameters = np.asarray(law.parameters, dtype=float)
    expressions = (
        getattr(law, name, None) for name in ("isochoric", "term", "coefficients", "volumetric")
    )
    key = (type(law), *expressions, parameters.tobytes())
    if key in _consistent:
        return
    with np.errstate(all="ignore"):
        _check_volumetric(law, parameters)
        (_check_invariants if isinstance(law, InvariantLaw) else _check_stretches)(law, parameters)
    _consistent.add(key)


def _check_volumetric(law, parameters) -> None:
    bulk = parameters[0]
    derivatives = [("U'", 1, [1, 0, 0], [1]), ("U''", 2, [0, 1, 0], [1])]
    values = partial(law.volumetric, parameters=parameters)
    # Volume ratios at which U is checked; the undeformed state comes first, as in `LOG_STRETCHES`.
    states = {"J3": np.array([1.0, 0.9, 0.98, 1.001, 1.03, 1.15])}
    _, slope, curvature = compare_derivatives(
        law.name, "volumetric", values, states, derivatives, bulk
    )
    _at_rest(law, "U'", slope, 0.0, bulk, "without which it is not free of stress")
    _at_rest(law, "U''", curvature, bulk, bulk, "bulk_modulus/shear_modulus")


def _check_invariants(law, parameters) -> None:
    squares = np.exp(2 * np.column_stack([LOG_STRETCHES, -LOG_STRETCHES.sum(axis=1)]))
    states = {"I1bar": squares.sum(axis=1), "I2bar": (1 / squares).sum(axis=1)}
    W, W1, W2 = np.eye(6)[:3]
    by_I1, by_I2 = np.eye(2)
    derivatives = [
        ("W1", 1, W, by_I1),
        ("W2", 2, W, by_I2),
        ("W11", 3, W1, by_I1),
        ("W12", 4, W1, by_I2),
        ("W22", 5, W2, by_I2),
    ]
    rest = compare_derivatives(
        law.name,
        "isochoric",
        lambda I1, I2: law.isochoric(I1, I2, parameters),
        states,
        derivatives,
        1.0,
    )
    _at_rest(
        law,
        "2 (W1 + W2)",
        2 * (rest[1] + rest[2]),
        1.0,
        1.0,
        "the shear modulus in units of itself",
    )


def _check_stretches(law, parameters) -> None:
    def sums(*x):
        return law.sums((*x, *(np.exp(2 * log) for log in x)), parameters)

    x1, x2 = LOG_STRETCHES.T
    thickness = np.array([-1, -1, 2]) / 3
    derivatives = [(f"g{k + 1}", k + 1, np.eye(5)[0], np.eye(3)[k]) for k in range(3)]
    derivatives.append(("h", 4, [0, *thickness, 0], thickness))
    rest = compare_derivatives(
        law.name, "term", sums, {"x1": x1, "x2": x2, "x3": -x1 - x2}, derivatives, 1.0
    )
    for k in (2, 3):
        _at_rest(
            law, f"g{k} - g1", rest[k] - rest[1], 0.0, 1.0, "without which it is not free of stress"
        )
    _at_rest(law, "h", rest[4], 4 / 3, 4 / 3, "4/3 of the shear modulus in units of itself")


def compare_derivatives(
    owner, expression, values, arguments, derivatives, modulus, relative=1e-4
) -> np.ndarray:
    """Compare coded derivatives with central differences, raise ValueError for a wrong one, and
    return the values at the first state.

    `arguments` is a dictionary of arrays, one value for each state. `values` is a function of these
    arrays that returns rows (energy and derivatives); messages call it `expression` of the `owner`.
    Each of `derivatives` is a tuple (name, row, weights, direction): this row must be the
    derivative of the weighted sum of the rows, along this direction in the space of the arguments.
    The allowed deviation is `relative` times the derivative, or times a hundredth of the typical
    size `modulus` if that is greater, plus ten times the spread of the differences with several
    step sizes. All states are evaluated at once, since a law may be a sum of many terms.
    """
    states = np.stack(list(arguments.values()))
    # The error of a step, its square, is 1e-6 and less, while rounding is 1e-13; halving twice
    # shows whether the differences converge.
    sizes = [
        (1e-3 * np.array([1.0, 0.5, 0.25]))[:, None]
        * np.maximum(np.abs(np.asarray(way) @ states), 1.0)
        for *_, way in derivatives
    ]
    moves = [
        np.asarray(way)[:, None, None] * size
        for (*_, way), size in zip(derivatives, sizes, strict=True)
    ]
    moved = np.stack([states[:, None] + sign * move for move in moves for sign in (1, -1)], axis=1)
    at = np.concatenate([states, moved.reshape(len(states), -1)], axis=1)
    # The results of an expression may be plain numbers.
    found = np.stack(
        [np.broadcast_to(np.asarray(value, dtype=float), at[0].shape) for value in values(*at)]
    )
    given = found[:, : states.shape[1]]
    ends = found[:, states.shape[1] :].reshape(len(found), len(derivatives), 2, *sizes[0].shape)
    for number, ((name, row, of, _), size) in enumerate(zip(derivatives, sizes, strict=True)):
        ahead, behind = np.tensordot(of, ends[:, number], 1)
        slopes = (ahead - behind) / (2 * size)
        right = (4 * slopes[-1] - slopes[-2]) / 3
        # Differences are accurate to some 1e-6 where the steps resolve the law (their error is the
        # step squared), and a mistake in a formula is a factor or a term, so any number between
        # would do. Near a limit or at the level of rounding the results of the three steps
        # disagree, and ten times their disagreement is allowed in addition.
        allowed = relative * np.maximum(np.abs(right), 1e-2 * modulus) + 10 * np.ptp(slopes, axis=0)
        # Steps beyond a limit of the law give no differences.
        wrong = np.isfinite(slopes).all(axis=0) & ~(np.abs(given[row] - right) <= allowed)
        if wrong.any():
            first = int(np.flatnonzero(wrong)[0])
            where = ", ".join(
                f"{label} = {value:.4g}"
                for label, value in zip(arguments, states[:, first], strict=True)
            )
            raise ValueError(
                f"{owner}: {name} is {given[row, first]:.6g} at {where}, but by finite differences"
                f" {right[first]:.6g}: correct {name} in `{expression}`, or the function of which"
                " it is the derivative"
            )
    return given[:, 0]


def _at_rest(law, name, given, right, scale, what) -> None:
    # Both are formulas.
    if not abs(given - right) <= 1e-6 * scale:
        raise ValueError(
            f"{law.name}: {name} of the undeformed material is {given:.6g}, but must be"
            f" {right:.6g}, {what}"
        )
