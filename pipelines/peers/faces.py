"""A cube in uniform tension: displacements at its faces, edges and corners, against perifit."""

from pathlib import Path

SIDE, STRAIN = 16, 1e-3
"""Points along a side of the whole cube; ours is an octant between planes of symmetry."""


def errors(index, off, unknowns, **more):
    """RMS errors, relative to the displacement of a face, by the place of points."""
    import numpy as np

    most = SIDE // 2 - 1
    outer = (abs(index) > most).sum(axis=1)
    size = np.linalg.norm(off, axis=1) / (STRAIN / 2)
    rms = [100 * float(np.sqrt((size[outer == n] ** 2).mean())) for n in range(4)]
    names = "inside (%)", "faces (%)", "edges (%)", "corners (%)"
    return dict(zip(names, rms, strict=True)) | {"unknowns": unknowns, **more}


def pairs(model=None):
    """Pairs of linear peridynamics (PMB, Poisson's ratio 1/4), with weights of perifit or 1.

    The traction acts on the outermost points, and stiffness is that of the full ball.
    """
    import time

    import numpy as np
    import perifit
    from scipy.sparse import bmat, coo_matrix
    from scipy.sparse.linalg import minres
    from scipy.spatial import KDTree

    h = 1 / SIDE
    line = (np.arange(SIDE) + 0.5) * h - 0.5
    points = np.stack(np.meshgrid(line, line, line, indexing="ij"), -1).reshape(-1, 3)
    volumes, reach = np.full(len(points), h**3), 3 * h * (1 + 1e-9)
    began = time.process_time()
    weights = np.ones(len(points))
    if model:
        weights = perifit.compute_weights(points, volumes, reach, model=model)
    spent = time.process_time() - began
    i, j = KDTree(points).query_pairs(reach, output_type="ndarray").T
    x = points[j] - points[i]
    length = np.linalg.norm(x, axis=1)
    # The stress of a strain e is pi c d^4 / 30 (2 e + tr(e) I): mu = 1, nu = 1/4.
    stiffness = 30 / (np.pi * reach**4) * (weights[i] + weights[j]) / 2 / length**3 * h**6
    blocks = [[None] * 3 for _ in range(3)]
    rows, columns = np.r_[i, j, i, j], np.r_[i, j, j, i]
    for a in range(3):
        for b in range(3):
            k = stiffness * x[:, a] * x[:, b]
            blocks[a][b] = coo_matrix((np.r_[k, k, -k, -k], (rows, columns)))
    load = np.zeros((3, len(points)))
    load[0] = 2.5 * STRAIN * h**2 * np.sign(points[:, 0]) * (abs(points[:, 0]) > 0.5 - h)
    found, _ = minres(bmat(blocks).tocsr(), load.ravel(), rtol=1e-9, maxiter=5000)
    exact = STRAIN * points * [1, -0.25, -0.25]
    more = {"weights (s)": spent} if model else {}
    return errors(points / h, found.reshape(3, -1).T - exact, load.size, **more)


def ours(force):
    """An octant under a traction on one face, between three planes of symmetry."""
    import pdsurrogate as pds

    law = pds.materials.NeoHookean(shear_modulus=1.0, bulk_modulus=5 / 3)
    state = pds.materials.homogeneous.uniaxial(law, 1 + STRAIN)
    across = state.lateral_stretch - 1
    changes = {"material": law.describe(), "loads.0.traction.0": state.nominal_stress}
    scene = pds.load_scene(Path(__file__).parents[1] / "data" / "octant.toml", changes)
    result = pds.simulate(scene, force, threads=1)
    points = result.body.points
    off = result.displacement() - points * [STRAIN, across, across]
    return errors(points * SIDE, off, points.size)
