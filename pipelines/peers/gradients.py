"""Derivatives of the force on a stretched slab by the moduli of its law: torch-fem's own benchmark
of hyperelasticity, a thin slab stretched to ten times its length, with the law of this package.
"""

import time
from pathlib import Path

K, STRETCH, INCREMENTS = 13 / 6, 10.0, 10
"""Bulk modulus by shear modulus (Poisson's ratio is 0.3), and geometric increments."""


def exact():
    """Force on an area of 1, and its derivatives by the shear and the bulk modulus."""
    from scipy.optimize import brentq

    def force(mu, K):
        def stresses(across):
            J = STRETCH * across**2
            mean = (STRETCH**2 + 2 * across**2) / 3
            volume = K / 4 * (J - 1 / J) * (1 + J**-2) * J
            return [
                (mu * J ** (-2 / 3) * (one**2 - mean) + volume) / one for one in (STRETCH, across)
            ]

        across = brentq(lambda across: stresses(across)[1], 0.1, 1.0, xtol=1e-15)
        return stresses(across)[0]

    steps = (1e-4, 0), (0, 1e-4)
    return [(force(1 + a, K + b) - force(1 - a, K - b)) / (2 * (a + b)) for a, b in steps]


def found(unknowns, slopes, seconds):
    """Figures of a row."""
    off = max(abs(one / true - 1) for one, true in zip(slopes, exact(), strict=True))
    return {
        "unknowns": unknowns,
        "error of derivatives": off,
        "equilibrium (s)": seconds[1] - seconds[0],
        "derivatives (s)": seconds[2] - seconds[1],
    }


def ours(n):
    """The package: a slab of 4 by n by n points."""
    import pdsurrogate as pds

    long = 4 / n
    steps = [(STRETCH ** (k / INCREMENTS) - 1) / (STRETCH - 1) for k in range(1, INCREMENTS + 1)]
    changes = {"body.size": [long, 1.0, 1.0], "steps": steps, "material.bulk_modulus": K}
    changes |= {"prescribed.1.x1": (STRETCH - 1) * long, "spacing": 1 / n}
    scene = pds.load_scene(Path(__file__).parents[1] / "data" / "slab.toml", changes)
    seconds = [time.process_time()]
    result = pds.simulate(scene)
    seconds.append(time.process_time())
    moduli = ["material.shear_modulus", "material.bulk_modulus"]
    slopes = result.sensitivity(["forces.right.0"], moduli).derivatives
    seconds.append(time.process_time())
    return found(result.body.points.size, slopes.ravel().tolist(), seconds)


def torchfem(n):
    """torch-fem: 4 by n by n linear hexahedra."""
    import torch
    from torchfem import Solid
    from torchfem.materials import Hyperelastic3D
    from torchfem.mesh import cube_hexa

    torch.set_default_dtype(torch.float64)
    torch.set_num_threads(1)

    def energy(F, moduli):
        C = F.transpose(-1, -2) @ F
        volume = 0.5 * torch.logdet(C)
        shear = moduli[0] / 2 * (torch.trace(C) * torch.exp(-2 / 3 * volume) - 3)
        return shear + moduli[1] / 2 * torch.sinh(volume) ** 2

    seconds, long = [time.process_time()], 4 / n
    nodes, elements = cube_hexa(5, n + 1, n + 1, long, 1.0, 1.0)
    moduli = torch.tensor([1.0, K], requires_grad=True)
    slab = Solid(nodes, elements, Hyperelastic3D(energy, moduli))
    left, right = nodes[:, 0] == 0.0, nodes[:, 0] == long
    slab.constraints[left | right, 0] = True
    for axis in (1, 2):
        slab.constraints[nodes[:, axis] == 0.5, axis] = True
    slab.displacements[right, 0] = (STRETCH - 1) * long
    steps = (STRETCH ** (torch.arange(INCREMENTS + 1) / INCREMENTS) - 1) / (STRETCH - 1)
    _, force, *_ = slab.solve(increments=steps, differentiable_parameters=moduli)
    seconds.append(time.process_time())
    force[right, 0].sum().backward()
    seconds.append(time.process_time())
    return found(nodes.numel(), moduli.grad.tolist(), seconds)
