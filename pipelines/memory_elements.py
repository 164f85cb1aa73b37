"""Finite elements for rubber with memory, with FElupe: a bonded block and a bonded sheet that are
stretched, held and let back, with a branch or with softening, and stresses of FElupe's softening.

python pipelines/memory_elements.py      writes data/memory.json (minutes)

Nothing of this package is used. The material is an own one: C_k' = (Cbar - (Cbar : C_k^-1)/3 C_k) /
time is integrated within a step by the classical Runge-Kutta method along a straight path of Cbar.
"""

import json
from pathlib import Path

import felupe as fem
import numpy as np
from felupe.math import ddot, det, dot, inv, transpose

BULK = 100.0
EYE = np.eye(3)[:, :, None, None]
TINY = 1e-30
"""Complex step of the tangent."""
STAGES = 4
"""Runge-Kutta steps within a step of time."""
DATA = Path(__file__).parent / "data" / "memory.json"


def isochoric(F):
    """Cbar of deformation gradients."""
    return det(F) ** (-2 / 3) * dot(transpose(F), F)


class Viscoelastic:
    """Neo-Hookean material with a branch; its state is C_k and Cbar of the last step."""

    def __init__(self, shear_modulus, modulus, time):
        self.shear_modulus, self.modulus, self.time, self.dt = shear_modulus, modulus, time, 0.0
        self.x = [np.eye(3), np.zeros((2, 3, 3))]

    def at_rest(self, field):
        """State before anything has moved."""
        shape = field.region.quadrature.npoints, field.region.mesh.ncells
        return np.broadcast_to(EYE, (2, 3, 3, *shape)).copy()

    def advanced(self, C, begin, end):
        """C_k at the end of a step."""

        def rate(C, part):
            Cbar = begin + part * (end - begin)
            flow = ddot(Cbar, inv(C)) / 3
            return (Cbar - flow * C) * (self.dt / self.time)

        h = 1 / STAGES
        for number in range(STAGES):
            at = number * h
            k1 = rate(C, at)
            k2 = rate(C + h / 2 * k1, at + h / 2)
            k3 = rate(C + h / 2 * k2, at + h / 2)
            k4 = rate(C + h * k3, at + h)
            C = C + h / 6 * (k1 + 2 * k2 + 2 * k3 + k4)
        return C

    def stress(self, F, state):
        """Isochoric stress P, with C_k and Cbar at the end of the step."""
        Cbar = isochoric(F)
        C = self.advanced(state[0], state[1], Cbar)
        pull = self.shear_modulus * EYE + self.modulus * inv(C)
        FM, J = dot(F, pull), det(F)
        trace = ddot(FM, F)
        return J ** (-2 / 3) * (FM - trace / 3 * transpose(inv(F))), C, Cbar

    def gradient(self, x):
        """Stress and new state, as FElupe asks for them."""
        P, C, Cbar = self.stress(x[0], x[-1])
        return [P, np.stack([C, Cbar])]

    def hessian(self, x):
        """Derivative of the stress at the end of the step, through the evolution of the state."""
        F, found = x[0], np.empty((*x[0].shape[:2], *x[0].shape))
        for k in range(len(F)):
            for m in range(len(F)):
                moved = F.astype(complex)
                moved[k, m] += TINY * 1j
                found[:, :, k, m] = self.stress(moved, x[-1])[0].imag / TINY
        return [found]


class Sheet(Viscoelastic):
    """The material under plane stress: the stretch of the thickness makes P33 vanish."""

    def stress(self, F, state):
        """Whole stress P in the plane, with C_k and Cbar at the end of the step."""
        full = np.zeros((3, 3, *F.shape[2:]), dtype=F.dtype)
        full[:2, :2] = F
        full[2, 2] = 1 / (F[0, 0] * F[1, 1] - F[0, 1] * F[1, 0])
        for _ in range(5):
            full[2, 2] -= self.whole(full, state)[0][2, 2] / self.slope(full, state)
        P, C, Cbar = self.whole(full, state)
        return P[:2, :2], C, Cbar

    def whole(self, F, state):
        """Stress in space with that of the volume, and the new state."""
        P, C, Cbar = super().stress(F, state)
        J = det(F)
        return P + BULK / 4 * (J**2 - J**-2) * transpose(inv(F)), C, Cbar

    def slope(self, F, state):
        """Derivative of P33 by the stretch of the thickness, at real F."""
        moved = F.real.astype(complex)
        moved[2, 2] += TINY * 1j
        return self.whole(moved, state)[0][2, 2].imag / TINY


def block(n, sheet=False):
    """Quarter of the unit block in plane strain, n by n elements graded to the corner: fields of
    displacement, pressure and volume ratio, the boundary that moves, and all boundaries.

    A sheet under plane stress has displacements alone.
    """
    mesh = fem.Rectangle(n=n + 1)
    graded = 0.5 * (1 - (1 - mesh.points) ** 3)
    mesh.update(points=graded)  # the bonded end is x = 0.5, the free side y = 0.5
    mesh = mesh.add_midpoints_edges().add_midpoints_faces(cell_type="quad9")
    region = fem.RegionBiQuadraticQuad(mesh)
    field = (
        fem.FieldContainer([fem.Field(region, dim=2)])
        if sheet
        else fem.FieldsMixed(region, n=3, planestrain=True)
    )
    middle, axis, end = np.isclose(mesh.x, 0), np.isclose(mesh.y, 0), np.isclose(mesh.x, 0.5)
    boundaries = {
        "middle": fem.Boundary(field[0], mask=middle, skip=(0, 1)),
        "axis": fem.Boundary(field[0], mask=axis, skip=(1, 0)),
        "bonded": fem.Boundary(field[0], mask=end, skip=(1, 0)),
        "move": fem.Boundary(field[0], mask=end, skip=(0, 1)),
    }
    return field, boundaries["move"], boundaries


def forces(n, material, program):
    """Force on the ends of the block after each step (stretch, dt) of a program."""
    sheet = isinstance(material, Sheet)
    field, move, boundaries = block(n, sheet)
    umat = (
        material
        if sheet
        else fem.NearlyIncompressible(
            material,
            BULK,
            dUdJ=lambda J, K: K / 4 * (J - 1 / J) * (1 + 1 / J**2),
            d2UdJdJ=lambda J, K: K / 4 * (1 + 3 / J**4),
        )
    )
    rest = material.at_rest(field) if isinstance(material, Viscoelastic) else None
    solid, found = fem.SolidBody(umat, field, statevars=rest), []
    for stretch, dt in program:
        material.dt = dt
        move.update(0.5 * (stretch - 1))
        fixed, free = fem.dof.partition(field, boundaries)
        given = fem.dof.apply(field, boundaries, fixed)
        result = fem.newtonraphson(
            items=[solid],
            x0=field,
            dof0=fixed,
            dof1=free,
            ext0=given,
            tol=1e-10,
            verbose=0,
            maxiter=40,
            plugins=[fem.LinesearchPlugin()],
        )
        field.link(result.x)
        # The quarter's end carries half the force of the block.
        found.append(2 * float(fem.tools.force(field, result.fun, move)[0]))
    return np.array(found)


def relaxing(steps):
    """Steps (stretch, dt) of a block pulled to 1.5 in a relaxation time, held nine of them, let
    back to 1.2 in half of one and held five, by steps a relaxation time; and the times of output.
    """
    part = steps // 8

    def held(stretch, pieces):
        return [(stretch, dt / part) for dt in pieces for _ in range(part)]

    pulled = [(1 + 0.5 * (k + 1) / steps, 1 / steps) for k in range(steps)]
    back = [(1.5 - 0.6 * (k + 1) / steps, 1 / steps) for k in range(steps // 2)]
    program = [
        *pulled,
        *held(1.5, [0.25] * 4 + [0.5] * 4 + [2.0] * 3),
        *back,
        *held(1.2, [0.25] * 4 + [1.0] * 4),
    ]
    return program, [1.0, 2.0, 4.0, 10.0, 10.5, 11.5, 15.5]


SOFTENING = {"r": 1.5, "m": 0.1, "beta": 0.1}
PATH = [1.1, 1.2, 1.3, 1.4, 1.5, 1.45, 1.4, 1.3, 1.2, 1.1, 1.2, 1.3, 1.4, 1.5, 1.6]
PARTS = 4
"""Stretches of the block with softening, and steps by which it reaches each."""
CYCLE = [(1.3, 0.2), (1.6, 0.6), (1.4, 0.4), (1.1, -0.2), (1.5, 0.3), (1.9, 0.8), (1.2, 0.0)]
"""Stretches along x, with the shear xy, of states without a change of volume."""


def softened():
    """The softening of FElupe on an isochoric neo-Hookean energy."""
    return fem.OgdenRoxburgh(fem.NeoHooke(mu=1.0), **SOFTENING)


def cycle():
    """Deformation gradients of `CYCLE` with their stresses P."""
    material, state, found = softened(), np.zeros((1, 1, 1)), []
    for stretch, shear in CYCLE:
        F = np.diag([stretch, stretch**-0.7, stretch**-0.3])
        F[0, 1] = shear
        P, state = material.gradient([F[:, :, None, None], state])
        found.append({"F": F.tolist(), "P": P[:, :, 0, 0].tolist()})
    return found


def main():
    """Compute all and write them."""
    found: dict = {"felupe": fem.__version__, "bulk_modulus": BULK, "relaxing": [], "steps": 32}
    program, at = relaxing(found["steps"])
    ends = np.cumsum([dt for _, dt in program])
    rows = [int(np.argmin(abs(ends - t))) for t in at]
    for n, modulus in ((8, 1.0), (12, 1.0), (12, 0.1)):
        force = forces(n, Viscoelastic(modulus, 1.0, 1.0), program)[rows]
        found["relaxing"].append(
            {"elements": n, "shear_modulus": modulus, "times": at, "forces": force.tolist()}
        )
        print(found["relaxing"][-1], flush=True)
    force = forces(8, Sheet(1.0, 1.0, 1.0), program)[rows]
    found["sheet"] = {"elements": 8, "times": at, "forces": force.tolist()}
    small = [
        (float(stretch), 0.0)
        for stretch in np.interp(
            np.arange(1, PARTS * len(PATH) + 1), PARTS * np.arange(len(PATH) + 1), [1.0, *PATH]
        )
    ]
    for name, material in (("elastic", fem.NeoHooke(mu=1.0)), ("softening", softened())):
        force = forces(12, material, small)[PARTS - 1 :: PARTS]
        found[name] = {"stretches": PATH, "forces": force.tolist()}
    found["softening"] |= SOFTENING | {"cycle": cycle()}
    DATA.write_text(json.dumps(found, indent=1) + "\n", "utf-8")


if __name__ == "__main__":
    main()
