"""Viscoelastic branches: a step in time of the internal variable C_k as the minimization of an
energy, theory (91)-(96).

A branch of modulus mu has the energy mu/2 (Cb : M - 3), M = C_k^-1, of an internal variable C_k of
determinant 1, and Cb is the isochoric right Cauchy-Green tensor. With C_k at the end of a step the
unimodular part of B + b Cb, where det B = 1 and b is a number, both of which the beginning of the
step determines, the step is the minimum over C_k of the energy

    mu/2 [Cb : M + (B : M)/b] + constant,   W_step = 3 mu/2 [(det(B + b Cb)^(1/3) - 1)/b - 1].

The stress is that of mu/2 Cb : M at fixed M. W_step is mu/2 (Cb : M - 3) if b = 0, a sudden step.

`tensors_of` makes these functions for symmetric tensors with the components 11, 12, 22, 33 in the
plane, and 11, 12, 13, 22, 23, 33 in space. All take tuples of reals of either precision, or of
arrays from Python, and are inlined into their callers.
"""

from functools import cache
from types import ModuleType

import numpy as np

from ..engine import vector_loads
from ..engine.compile import inlined
from .algebra import entries, scalar, total
from .elementary import exponential, inverse_cube_root, inverse_square_root, like, logarithm, select

LONGEST = 1e30
"""Greatest duration of a step, in relaxation times: longer ones, infinite ones too, count as this
one, after which nothing of C_k is left. Its cube is finite in double precision.
"""

GREATEST = {"float32": 1e10, "float64": 1e32}
"""Greatest coefficient b by precision: its cube must be finite. The overstress that a longer step
would leave is this number times smaller than the modulus.
"""

ROUNDED = 1e-10
"""Energy over half the modulus of a branch below which a difference of energies is rounding: the
overstress is then 1e-5, and its square tells the energy as exactly.
"""

SERIES = 0.01
"""Number of relaxation times below which integrals of exponentials are computed by their series,
whose error is then below rounding.
"""


NODES, SHARES = np.polynomial.legendre.leggauss(6)
NODES, SHARES = tuple((0.5 + NODES / 2).tolist()), tuple((SHARES / 2).tolist())
"""Nodes and weights of Gauss for integrals from 0 to 1. Chosen, with four trials of Newton's method
in `held`: the overstress in any hold after a jump to a stretch of 2 then errs by 1e-5 in
equibiaxial tension, to one of 3 by 1e-3, far less in other modes.
"""


@inlined
def weights_of_ends(k):
    """Return exp(-k) and the integrals over u from 0 to 1 of (1 - u) exp(-k (1 - u)) and u exp(-k
    (1 - u)).

    They weigh C_k and Cb at the beginning and Cb at the end of a step in which Cb is linear.
    """
    decay = exponential(-k)
    small = select(k < SERIES, k, 0.0)
    safe = select(k < SERIES, 1.0, k)
    begin = (1.0 - (1.0 + safe) * decay) / (safe * safe)
    end = (safe - 1.0 + decay) / (safe * safe)
    x = small
    first = 0.5 - x * (1 / 3 - x * (1 / 8 - x * (1 / 30 - x * (1 / 144 - x / 840))))
    last = 0.5 - x * (1 / 6 - x * (1 / 24 - x * (1 / 120 - x * (1 / 720 - x / 5040))))
    return decay, select(k < SERIES, first, begin), select(k < SERIES, last, end)


@inlined
def weight_of_bow(k, decay, begin):
    """Return the integral over u from 0 to 1 of u (1 - u) exp(-k (1 - u)), from the first two of
    `weights_of_ends`.
    """
    x = select(k < SERIES, k, 0.0)
    safe = select(k < SERIES, 1.0, k)
    series = 1 / 6 - x * (1 / 12 - x * (1 / 40 - x * (1 / 180 - x / 1008)))
    return select(k < SERIES, series, begin - (2.0 * begin - decay) / safe)


@inlined
def slowness(w, first, second):
    """Return 1/f of `held`, by 3 (lambda - 1) and its like at the beginning."""
    return inverse_cube_root(1.0 + w * (1.0 - w) * (first * (1.0 - w) + second * w))


@inlined
def gain(x, first, second):
    """Return the integrand (1/f - 1)/(1 - w) at w = x."""
    return (slowness(x, first, second) - 1.0) / (1.0 - x)


@inlined
def trial(y, h, first, second):
    """Return the next value of y in the search of `held`; without a loop, for vectors."""
    w = 1.0 - exponential(-y)
    gained = SHARES[0] * gain(NODES[0] * w, first, second)
    gained += SHARES[1] * gain(NODES[1] * w, first, second)
    gained += SHARES[2] * gain(NODES[2] * w, first, second)
    gained += SHARES[3] * gain(NODES[3] * w, first, second)
    gained += SHARES[4] * gain(NODES[4] * w, first, second)
    gained += SHARES[5] * gain(NODES[5] * w, first, second)
    y = y + (h - y - w * gained) / slowness(w, first, second)
    return select(y > 0.0, y, 0.0)


@inlined
def held(rate, other, h):
    """Return, for a body held for h relaxation times, the integral of lambda and the share of Cb in
    C_k after it.

    `rate` and `other` are thirds of Cb : C_k^-1 and Cb^-1 : C_k at the beginning. C_k is the
    unimodular part of C_k + G Cb, and dG/dh = det(C_k + G Cb)^(1/3) = (1 + G) f. With y = log(1 +
    G) this is dy/dh = f, solved for y by its inverse, an integral over w = G/(1 + G).
    """
    first, second = 3.0 * (rate - 1.0), 3.0 * (other - 1.0)
    y = trial(trial(h, h, first, second), h, first, second)
    y = trial(trial(y, h, first, second), h, first, second)
    w = 1.0 - exponential(-y)
    r = slowness(w, first, second)
    return y - logarithm(r), w * r


@inlined
def weights_of_overstress(h):
    """Return the integrals over u from 0 to h of f0^2, f0 f1 and f1^2, where f1 = (1 -
    exp(-u))/(1 - exp(-h)) = 1 - f0.

    f0 and f1 weigh the overstresses at both ends of a step of h relaxation times.
    """
    series = h < 5 * SERIES
    x = select(series, h, 0.0)
    even = x * (1 / 3 + x * x * (1 / 180 - x * x / 5040))
    odd = x * x * (1 / 12 - x * x * (1 / 720 - x * x / 30240))
    mixed = x * (1 / 6 - x * x * (1 / 180 - x * x / 5040))
    # Overstresses below rounding must not count in very long steps.
    h = select(series, 1.0, select(h < 1e12, h, 1e12))
    decay = exponential(-h)
    risen = 1.0 - decay
    both = 0.5 * risen * (1.0 + decay)
    square = risen * risen
    return (
        select(series, even - odd, (both - 2.0 * decay * risen + decay * decay * h) / square),
        select(series, mixed, (risen - decay * h - both + decay * risen) / square),
        select(series, even + odd, (h - 2.0 * risen + both) / square),
    )


@cache
def tensors_of(dimension):
    """Return the module of functions on symmetric tensors and steps of branches, for bodies in the
    plane (2) or in space (3); it is made once for each.
    """
    found = ModuleType(f"{__name__}_{dimension}")
    vars(found).update(_components(dimension))
    vars(found).update(_steps(found))
    return found


def _components(d):
    """Return, by name, the functions on the components of tensors of a body in `d` dimensions."""
    axes = range(3)
    kept = [(0, 0), (0, 1), (1, 1), (2, 2)] if d == 2 else [(r, c) for r in axes for c in axes[r:]]
    Z = {place: n for n, (r, c) in enumerate(kept) for place in ((r, c), (c, r))}
    numbers = range(len(kept))

    def at(name, r, c):
        """Return the expression of a component, or of zero."""
        return f"{name}[{Z[r, c]}]" if (r, c) in Z else "0.0"

    def product(*factors):
        return None if "0.0" in factors else " * ".join(factors)

    def summed(plus, minus=()):
        """Return the sum of products that are not zero."""
        terms = [term for term in plus if term] + [f"(-{term})" for term in minus if term]
        return total(terms) if terms else "0.0"

    def cofactor(name, r, c):
        a, b, e, f = (r + 1) % 3, (r + 2) % 3, (c + 1) % 3, (c + 2) % 3
        return summed(
            [product(at(name, a, e), at(name, b, f))], [product(at(name, a, f), at(name, b, e))]
        )

    def green(r, c):
        """Return the expression of an entry of F^T F, for F by columns."""
        if d == 2 and r == 2:
            return "C33"
        return total(f"F[{r * d + k}] * F[{c * d + k}]" for k in range(d))

    both = [n for n, (r, c) in enumerate(kept) for _ in range(1 + (r != c))]
    full = [(r, c) for c in axes for r in axes if (r, c) in Z]
    W = {place: n for n, place in enumerate(full)}
    mixed = [
        summed([product(at("A", r, k), at("M", k, c)) for k in axes])
        + (" - mean" if r == c else "")
        for r, c in full
    ]
    return {
        "TENSOR": len(kept),
        # Rows of (B, b): in the plane the entry 33 of B follows from det B = 1.
        "STEP": 4 if d == 2 else 7,
        "kept_of": entries("B", [f"B[{n}]" for n in (range(3) if d == 2 else numbers)]),
        "PLACES": kept,
        "DIAGONAL": tuple(float(r == c) for r, c in kept),
        # The tensors in rows of a block, in the precision of x, and in listed records.
        "tensor_at": entries("rows, k", [f"rows[{n}, k]" for n in numbers]),
        "tensor_in": entries("rows, k, x", [f"like(x, rows[{n}, k])" for n in numbers]),
        "take_listed": vector_loads.take_listed(len(kept)),
        "scaled": entries("factor, A", [f"factor * A[{n}]" for n in numbers]),
        # A + factor G, and A : G.
        "combined": entries("A, factor, G", [f"A[{n}] + factor * G[{n}]" for n in numbers]),
        "contraction": scalar("A, G", total(f"A[{n}] * G[{n}]" for n in both)),
        "cofactor_of": entries("A", [cofactor("A", r, c) for r, c in kept]),
        # det A from A and its cofactor, by the first row; in the plane by the entry 33.
        "determinant_by": scalar(
            "A, cofactor",
            "A[3] * cofactor[3]" if d == 2 else total(f"A[{n}] * cofactor[{n}]" for n in range(3)),
        ),
        # C = F^T F; in the plane C33 is given.
        "green": entries("F, C33", [green(r, c) for r, c in kept]),
        # F A by columns, in the plane without the entry 33; the overstress A M - mean I, which is
        # not symmetric, and the trace of a product of two.
        "gradient_times": entries(
            "F, A",
            [
                total(f"F[{k * d + r}] * A[{Z[k, c]}]" for k in range(d))
                for c in range(d)
                for r in range(d)
            ],
        ),
        "mixed_product": entries("A, M, mean", mixed),
        "trace_of_product": scalar("S, R", total(f"S[{W[r, c]}] * R[{W[c, r]}]" for r, c in full)),
    }


def _steps(tensors):
    """Return, by name, the functions for steps of branches on the tensors of a module."""

    @inlined
    def isochoric(C, volume_ratio):
        """Return Cb = J^(-2/3) C of C = F^T F and J = det F."""
        r = inverse_cube_root(volume_ratio)
        return tensors.scaled(r * r, C)

    @inlined
    def begin_step(C_k, Cb, h):
        """Return (B, b) of a step of h relaxation times from the state C_k, Cb.

        The rate lambda = Cb : C_k^-1/3 of the beginning holds for the whole step, and Cb changes
        linearly in time.
        """
        h = select(h < LONGEST, h, LONGEST)
        rate = tensors.contraction(Cb, tensors.cofactor_of(C_k)) * (1.0 / 3.0)
        decay, begin, end = weights_of_ends(rate * h)
        B = tensors.combined(tensors.scaled(decay, C_k), h * begin, Cb)
        r = inverse_cube_root(tensors.determinant_by(B, tensors.cofactor_of(B)))
        return tensors.scaled(r, B), r * h * end

    @inlined
    def begin_curved_step(C_k, Cb, h, earlier, ratio):
        """Return (B, b) of a step of h relaxation times, `ratio` times as long as the one before
        that began at the strain `earlier`, theory (92a)-(92c).

        Cb changes as the parabola through its last three values, on which B and b depend. It
        changes linearly with a ratio of 0, or if it has changed so much that B might not be
        positive definite.
        """
        h = select(h < LONGEST, h, LONGEST)
        cofactor = tensors.cofactor_of(C_k)
        around = tensors.cofactor_of(Cb)
        whole = tensors.contraction(Cb, cofactor)
        # Cb - ratio/(1 + ratio) earlier is positive definite if the greatest eigenvalue of Cb^-1
        # earlier is less than g, and then its trace is less than g + 2 g^(-1/2).
        g = (1.0 + ratio) / (ratio + 1.0 / LONGEST)
        near = tensors.contraction(earlier, around) < g + 2.0 * inverse_square_root(g)
        ratio = select(near, ratio, 0.0)
        rise = ratio * (whole - tensors.contraction(earlier, cofactor)) * (1.0 / 3.0)
        still, share = held(whole * (1.0 / 3.0), tensors.contraction(C_k, around) * (1.0 / 3.0), h)
        _, begin, end = weights_of_ends(still)
        share = share / (begin + end)
        _, begin, end = weights_of_ends(2.0 * h)
        share = share * exponential(-h * rise * (begin + end) * (1.0 / 12.0))
        k = still + h * rise * end
        k = select(k > h, k, h)
        decay, begin, end = weights_of_ends(k)
        bow = weight_of_bow(k, decay, begin)
        last = ratio * bow / (1.0 + ratio)
        B = tensors.combined(tensors.scaled(decay, C_k), share * (begin + ratio * bow), Cb)
        B = tensors.combined(B, -share * ratio * last, earlier)
        r = inverse_cube_root(tensors.determinant_by(B, tensors.cofactor_of(B)))
        return tensors.scaled(r, B), r * share * (end - last)

    @inlined
    def step_in_plane(rows, k, x):
        """Return (B, b) in the precision of x, from rows of `kept_of` B and b."""
        one = like(x, 1.0)
        B11, B12, B22, b = tensors.tensor_in(rows, k, x)
        return (B11, B12, B22, one / (B11 * B22 - B12 * B12)), b

    @inlined
    def step_in_space(rows, k, x):
        """Return (B, b) in the precision of x, from rows of `kept_of` B and b."""
        return tensors.tensor_in(rows, k, x), like(x, rows[6, k])

    @inlined
    def in_plane(B, b, Cb):
        """Return cof(B + b Cb), its determinant and (det - 1)/b, which is the product of a
        determinant in the plane and an entry across it.
        """
        area = Cb[0] * Cb[2] - Cb[1] * Cb[1]
        linear = B[2] * Cb[0] - (B[1] + B[1]) * Cb[1] + B[0] * Cb[2] + b * area
        begun = B[0] * B[2] - B[1] * B[1]
        within = begun + b * linear
        across = B[3] + b * Cb[3]
        A = tensors.combined(B, b, Cb)
        cofactor = across * A[2], -across * A[1], across * A[0], within
        return cofactor, within * across, begun * Cb[3] + across * linear

    @inlined
    def in_space(B, b, Cb):
        """Return cof(B + b Cb), its determinant and (det - 1)/b."""
        A = tensors.combined(B, b, Cb)
        of_A = tensors.cofactor_of(A)
        second = tensors.contraction(tensors.cofactor_of(Cb), B)
        slope = tensors.contraction(of_A, Cb) - b * (second + b + b)
        return of_A, tensors.determinant_by(A, of_A), slope

    moved = in_plane if tensors.TENSOR == 4 else in_space

    @inlined
    def take_step(B, b, Cb):
        """Return M = C_k^-1 at the end of a step and W_step, of a branch of modulus 1."""
        one = like(Cb[0], 1.0)
        cofactor, determinant, slope = moved(B, b, Cb)
        r = inverse_cube_root(determinant)
        square = r * r
        root = determinant * square
        energy = like(one, 1.5) * (slope / (root * root + root + one) - one)
        return tensors.scaled(square, cofactor), energy

    @inlined
    def end_step(B, b, Cb):
        """Return C_k at the end of a step."""
        A = tensors.combined(B, b, Cb)
        return tensors.scaled(
            inverse_cube_root(tensors.determinant_by(A, tensors.cofactor_of(A))), A
        )

    @inlined
    def overstress(Cb, M, whole):
        return tensors.mixed_product(Cb, M, whole * (1.0 / 3.0))

    @inlined
    def dissipation(Cb_0, C_0, C_held, Cb_1, C_1, h):
        """Return the energy that a branch of modulus 1 dissipates in a step of h relaxation times
        between two states (Cb, C_k); `C_held` is C_k at the end of a step in which Cb stays Cb_0.

        The overstress Cb M - (Cb : M)/3 I relaxes exponentially from its value at the beginning to
        that at the end, and the integral of its square is scaled such that a body that is held
        dissipates the energy that it loses.
        """
        M_0 = tensors.cofactor_of(C_0)
        M_held = tensors.cofactor_of(C_held)
        M_1 = tensors.cofactor_of(C_1)
        energy_0 = tensors.contraction(Cb_0, M_0)
        energy_held = tensors.contraction(Cb_0, M_held)
        s_0 = overstress(Cb_0, M_0, energy_0)
        s_held = overstress(Cb_0, M_held, energy_held)
        s_1 = overstress(Cb_1, M_1, tensors.contraction(Cb_1, M_1))
        first, both, last = weights_of_overstress(h)
        begun = first * tensors.trace_of_product(s_0, s_0)
        found = begun + last * tensors.trace_of_product(s_1, s_1)
        found += 2.0 * both * tensors.trace_of_product(s_0, s_1)
        held = begun + last * tensors.trace_of_product(s_held, s_held)
        held += 2.0 * both * tensors.trace_of_product(s_0, s_held)
        return 0.5 * found * (energy_0 - energy_held + ROUNDED) / (held + ROUNDED)

    return {
        "step_in": step_in_plane if tensors.TENSOR == 4 else step_in_space,
        "isochoric": isochoric,
        "begin_step": begin_step,
        "begin_curved_step": begin_curved_step,
        "take_step": take_step,
        "end_step": end_step,
        "dissipation": dissipation,
    }
