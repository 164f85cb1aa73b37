"""Passes written once for every dimension, in three, against plain twins written for reading; and that a sheet needs none of it."""

import subprocess
import sys

import numpy as np
import pytest
from bodies import fill_gradients

from pdsurrogate.body import Body, ReflectionPlane
from pdsurrogate.engine.block_arrays import BLOCK, SCRATCH_ROWS
from pdsurrogate.engine.threads import Chunks
from pdsurrogate.kernels import damage, node_state, nosb, reference_state, steps, sums
from pdsurrogate.kernels.ghosts import fill_matrices, fold_matrices, fold_vectors, place_points
from pdsurrogate.materials import NeoHookean, Ogden, solid

COUNT, SPACING, CHUNKS = 7, 1 / 7, Chunks(threads=2, number=5)

# No scene uses these yet, and every law and dimension has to be compiled.
pytestmark = pytest.mark.slow

ROLLERS = tuple(ReflectionPlane(axis, 0.0, -1, tuple(np.where(np.arange(3) == axis, -1, 1))) for axis in range(3))
GRIPPED = (ReflectionPlane(0, 0.0, -1, (-1, -1, -1)), *ROLLERS[1:])


def cube(planes=(), reach=2.2, seed=7):
    """A cube of jittered points of unequal volumes, its lower corner at the origin."""
    random = np.random.default_rng(seed)
    axis = (np.arange(COUNT) + 0.5) * SPACING
    lattice = np.stack(np.meshgrid(axis, axis, axis, indexing="ij"), axis=-1).reshape(-1, 3)
    points = lattice + 0.2 * SPACING * random.uniform(-1, 1, lattice.shape)
    return Body(points, SPACING**3 * random.uniform(0.8, 1.2, len(points)), reach * SPACING, SPACING, planes=planes)


def deformed(points):
    """Positions in a smooth inhomogeneous deformation."""
    x1, x2, x3 = points.T
    turned = points @ np.array([[1.2, 0.1, 0.0], [-0.2, 0.9, 0.15], [0.05, 0.0, 0.95]]).T
    return turned + 0.03 * np.stack([np.sin(3 * x2), np.cos(4 * x3), np.sin(2 * x1 + x3)], axis=1)


def mirrored(body, displacements):
    """The eight bodies that three planes make of one, and their displacements."""
    points, volumes, moved = body.points, body.volumes, displacements
    for plane in body.planes:
        flip = np.where(np.arange(3) == plane.axis, -1.0, 1.0)
        points = np.concatenate([points, points * flip])
        volumes, moved = np.concatenate([volumes, volumes]), np.concatenate([moved, moved * plane.parity])
    return points, volumes, moved


def close(found, expected):
    np.testing.assert_allclose(found, expected, rtol=0, atol=1e-12 * np.abs(expected).max())


def matrices(columns):
    """Matrices of records by columns."""
    return columns.reshape(-1, 3, 3).swapaxes(1, 2)


class Twin:
    """Every sum of the definitions over all pairs of points within a horizon, as dense arrays."""

    def __init__(self, points, volumes, horizon, weigh):
        self.x = points[None] - points[:, None]  # x[i, j] from i to j
        length = np.linalg.norm(self.x, axis=2)
        bonded = (length <= horizon * (1 + 1e-9)) & (length > 0)
        self.w = np.where(bonded, weigh(np.where(bonded, length, 1.0)), 0.0)
        self.volumes = volumes
        self.K = np.einsum("ij,j,ija,ijb->iab", self.w, volumes, self.x, self.x)
        self.Z = np.linalg.inv(self.K)

    def gradients(self, positions):
        y = positions[None] - positions[:, None]
        return np.einsum("ij,j,ija,ijb->iab", self.w, self.volumes, y, self.x) @ self.Z

    def forces(self, P):
        T = P @ self.Z
        pairs = np.einsum("ij,ijab,ijb->ija", self.w, T[:, None] + T[None], self.x)
        return self.volumes[:, None] * np.einsum("j,ija->ia", self.volumes, pairs)


class Passes:
    """A body's arrays, and the passes over them."""

    def __init__(self, body):
        self.body, bonds = body, body.bonds
        owners = np.repeat(np.arange(len(body)), np.diff(bonds.pointers).astype(int))
        vectors = body.all_points[bonds.neighbors] - body.all_points[owners]
        factors = body.weigh(np.linalg.norm(vectors, axis=1)) * body.all_volumes[bonds.neighbors]
        self.weighted_bonds = np.ascontiguousarray(vectors * factors[:, None])
        self.inverse_shape = np.zeros((len(body.all_points), 6))
        self.supported = np.zeros(len(body.all_points), dtype=np.uint8)
        rows, lists = np.arange(len(body), dtype=np.uint32), (bonds.pointers, bonds.neighbors)
        found = self.weighted_bonds, self.inverse_shape, self.supported
        reference_state.shape_rows[3].bind(rows, *lists, body.all_points, *found, chunks=CHUNKS)()
        body.ghosts.fill_shapes(self.inverse_shape)
        body.ghosts.fill(self.supported)

    def placed(self, positions, plane_displacements=0.0):
        ghosts = self.body.ghosts
        shifts = ghosts.shifts(self.body.points, np.zeros((len(self.body.planes), 3)) + plane_displacements)
        return np.vstack([positions, shifts + ghosts.parity * positions[ghosts.source]])

    def gradients(self, positions, unsupported=1.0):
        bonds, F = self.body.bonds, np.zeros((len(positions), 9))
        arrays = positions, bonds.pointers, bonds.neighbors, self.weighted_bonds, self.inverse_shape, unsupported, F
        node_state.deformation_gradients[3].bind(*arrays, chunks=CHUNKS)()
        return F

    def stresses(self, F, law):
        scratch, out = np.zeros((CHUNKS.threads, SCRATCH_ROWS, BLOCK)), np.zeros_like(F)
        block, ratios = solid.response.block(law), np.ones(len(F))
        arrays = F, ratios, self.inverse_shape, law.shear_modulus, block.address, np.asarray(law.parameters), scratch, out
        nosb.weighted_stresses[3].bind(*arrays, chunks=CHUNKS)()
        return out

    def nosb_forces(self, stresses):
        bonds, out = self.body.bonds, np.zeros_like(self.body.points)
        arrays = stresses, bonds.pointers, bonds.neighbors, self.weighted_bonds, self.body.volumes, out
        assert nosb.nosb_forces[3].bind(*arrays, chunks=CHUNKS)() == 0
        return out


def first_piola(law, F):
    """Neo-Hookean stress written out: mu J^(-2/3) (F - tr C/3 F^-T) + K/4 (J - J^-3) J F^-T."""
    J, H = np.linalg.det(F)[:, None, None], np.linalg.inv(F).swapaxes(1, 2)
    trace = (F * F).sum(axis=(1, 2))[:, None, None]
    return law.shear_modulus * J ** (-2 / 3) * (F - trace / 3 * H) + law.bulk_modulus / 4 * (J - J**-3) * J * H


@pytest.mark.parametrize("reach", [1.75, 2.2])
def test_a_cube_from_shape_tensors_to_forces(reach):
    body, law = cube(reach=reach), NeoHookean(1.3, 130.0)
    twin, passes = Twin(body.points, body.volumes, body.horizon, body.weigh), Passes(body)
    assert passes.supported.all()
    upper = np.triu_indices(3)
    close(passes.inverse_shape, twin.Z[:, upper[0], upper[1]])
    y = deformed(body.points)
    F = passes.gradients(passes.placed(y))
    close(matrices(F), twin.gradients(y))
    P = first_piola(law, twin.gradients(y))
    stresses = passes.stresses(F, law)
    close(matrices(stresses), P @ twin.Z)
    forces = passes.nosb_forces(stresses)
    close(forces, twin.forces(P))
    # What must hold whatever the twin says: momentum, and angular momentum of an isotropic law.
    scale = np.abs(forces).sum()
    assert np.abs(forces.sum(axis=0)).max() < 1e-13 * scale
    assert np.abs(np.cross(y, forces).sum(axis=0)).max() < 1e-13 * scale


def test_every_law_goes_through_the_same_pass(law):
    body = cube()
    passes = Passes(body)
    F = passes.gradients(passes.placed(deformed(body.points)))
    P = solid.first_piola_stress(law, matrices(F))
    close(matrices(passes.stresses(F, law)), P @ Twin(body.points, body.volumes, body.horizon, body.weigh).Z)


def test_affine_deformation_is_exact_and_free_points_have_none():
    body = cube()
    passes, A = Passes(body), np.eye(3) + 0.2 * np.random.default_rng(1).uniform(-1, 1, (3, 3))
    F = matrices(passes.gradients(passes.placed(body.points @ A.T)))
    np.testing.assert_allclose(F, np.broadcast_to(A, F.shape), atol=1e-13)
    # Points of one plane do not span space.
    flat = Body(body.points * [1, 1, 0] + [0, 0, 0.1], body.volumes, body.horizon, SPACING)
    passes = Passes(flat)
    assert not passes.supported.any()
    np.testing.assert_array_equal(matrices(passes.gradients(passes.placed(flat.points))), np.broadcast_to(np.eye(3), (len(flat), 3, 3)))


@pytest.mark.parametrize("planes", [ROLLERS, GRIPPED], ids=["rollers", "a grip and rollers"])
def test_images_are_what_is_there_in_the_mirrored_body(planes):
    """Faces, edges and the corner: a quarter of a quarter of a half of a body behaves as the whole does."""
    body, law = cube(planes, reach=1.75), Ogden()
    n, passes = len(body), Passes(body)
    displacement = 0.05 * np.sin(3 * body.points + [0.3, 1.0, 2.0]) * body.points[:, [1, 2, 0]]
    points, volumes, moved = mirrored(body, displacement)
    twin = Twin(points, volumes, body.horizon, body.weigh)
    same = np.abs(body.ghosts.points[:, None] - points[None]).max(axis=2).argmin(axis=1)
    at = np.concatenate([np.arange(n), same])
    # Every image is one of those points, and as many are there as lie within a horizon of the planes.
    close(points[at], body.all_points)
    assert len(np.unique(at)) == len(at)
    outside = (points < 0).any(axis=1)
    assert len(body.ghosts) == (outside & (points >= -body.horizon * (1 + 1e-9)).all(axis=1)).sum()
    assert {*(points[same] < 0).sum(axis=1)} == {1, 2, 3}
    close(body.all_volumes, volumes[at])

    upper = np.triu_indices(3)
    close(passes.inverse_shape, twin.Z[at][:, upper[0], upper[1]])
    y = passes.placed(body.points + displacement)
    close(y, (points + moved)[at])
    F = passes.gradients(y)
    fill_gradients(body.ghosts, F)
    whole = twin.gradients(points + moved)
    close(matrices(F), whole[at])
    P = solid.first_piola_stress(law, whole)
    stresses = passes.stresses(F, law)
    close(matrices(stresses), (P @ twin.Z)[at])
    close(passes.nosb_forces(stresses), twin.forces(P)[:n])


def test_images_follow_planes_that_move():
    """A block that grows by a half against its own symmetry planes: F is the same everywhere, on images too."""
    body = cube(ROLLERS)
    passes, stretch = Passes(body), np.array([1.5, 0.9, 0.8])
    shift = np.array([0.1, -0.2, 0.3])
    y = passes.placed(body.points * stretch + shift, np.diag(shift))
    close(y, body.all_points * stretch + shift)
    F = passes.gradients(y)
    fill_gradients(body.ghosts, F)
    np.testing.assert_allclose(matrices(F), np.broadcast_to(np.diag(stretch), (len(F), 3, 3)), atol=1e-13)


def test_a_plane_of_a_sheet_is_refused():
    with pytest.raises(ValueError, match=r"parity.* 3 components, not \(-1, 1\)"):
        cube((ReflectionPlane(0, 0.0, -1, (-1, 1)),))


@pytest.mark.parametrize("planes", [ROLLERS, GRIPPED], ids=["rollers", "a grip and rollers"])
def test_filling_and_folding_are_transposes(planes, random):
    ghosts = cube(planes).ghosts
    total = len(cube()) + len(ghosts)
    n = total - len(ghosts)
    of_vectors, at_rest = (ghosts.source, ghosts.parity), np.zeros_like(ghosts.parity)
    for width in (3, 9):
        v, w = random.standard_normal((2, total, width))
        v[n:] = 0
        filled, folded = v.copy(), w.copy()
        if width == 3:
            place_points.bind(v[:n], *of_vectors, at_rest, filled, chunks=CHUNKS)()
            fold_vectors.bind(folded, *of_vectors, chunks=CHUNKS)()
        else:
            fill_matrices(filled, *ghosts.of_gradients, 0.0, np.zeros((len(ghosts), width)))
            fold_matrices.bind(folded, *ghosts.of_gradients, chunks=CHUNKS)()
        assert (filled * w).sum() == pytest.approx((v[:n] * folded[:n]).sum(), rel=1e-12)


def _pair_lists(body):
    """Pairs of points and ghosts alike, as `sum_moments` takes them."""
    bonds, n, total = body.bonds, len(body), len(body.all_points)
    own = np.full(total + 1, bonds.pair_pointers[-1])
    own[: n + 1] = bonds.pair_pointers
    pointers = np.zeros(total + 1, dtype=np.uint64)
    pointers[1:] = np.cumsum(np.bincount(bonds.second, minlength=total))
    return own, pointers, np.argsort(bonds.second, kind="stable").astype(np.uint32)


@pytest.mark.parametrize("dtype", [np.float32, np.float64])
def test_sums_of_pairs(dtype, random):
    body = cube(GRIPPED)
    bonds, n = body.bonds, len(body)
    first, second = bonds.first.astype(int), bonds.second.astype(int)
    forces, expected = random.standard_normal((len(first), 3)).astype(dtype), np.zeros((n, 3))
    within = second < n
    np.add.at(expected, first, 2.5 * forces.astype(float))
    np.add.at(expected, second[within], -2.5 * forces[within].astype(float))
    out = np.zeros((n, 3))
    arrays = forces, bonds.pair_pointers, bonds.incidence_pointers, bonds.incidence, 2.5, out
    assert sums.sum_pair_forces[3].bind(*arrays, chunks=CHUNKS)() == 0
    close(out, expected)
    forces[first == 11] = np.nan
    assert sums.sum_pair_forces[3].bind(*arrays, chunks=CHUNKS)() == len({11, *second[within & (first == 11)]})

    moments, expected = random.standard_normal((len(first), 9)).astype(dtype), np.zeros((len(body.all_points), 9))
    np.add.at(expected, first, moments.astype(float))
    np.add.at(expected, second, moments.astype(float))
    out = np.zeros_like(expected)
    sums.sum_moments[3].bind(moments, *_pair_lists(body), 1.0, out, chunks=CHUNKS)()
    close(out, expected)


def test_sums_of_directed_bonds(random):
    body = cube()
    bonds = body.bonds
    owners = np.repeat(np.arange(len(body)), np.diff(bonds.pointers).astype(int))
    place = {ends: b for b, ends in enumerate(zip(owners.tolist(), bonds.neighbors.tolist(), strict=True))}
    reverse = np.array([place[j, i] for i, j in place], dtype=np.uint32)
    forces, expected, out = random.standard_normal((len(owners), 3)), np.zeros((len(body), 3)), np.zeros((len(body), 3))
    np.add.at(expected, owners, 0.7 * (forces - forces[reverse]))
    assert sums.sum_pair_forces[3].bind(forces, bonds.pointers, bonds.pointers, reverse, 0.7, out, chunks=CHUNKS)() == 0
    close(out, expected)


def test_forces_of_a_bond_energy_are_its_derivative(random):
    """Pairs that know their own bond and both ends' gradients: forces from `sums` are minus the derivative, through images as well.

    The energy is linear, sum of g . (y_j - y_i) + M : (F_i + F_j), so that its change along any displacement is exact.
    """
    body = cube(GRIPPED, reach=1.75)
    bonds, ghosts, passes, n = body.bonds, body.ghosts, Passes(body), len(body)
    forces, moments = random.standard_normal((len(bonds.first), 3)), random.standard_normal((len(bonds.first), 9))
    pairs, total = _pair_lists(body), len(body.all_points)
    S, node_parts, out = np.zeros((total, 9)), np.zeros((total, 3)), np.zeros((total, 3))
    sums.sum_moments[3].bind(moments, *pairs, 1.0, S, chunks=CHUNKS)()
    fold_matrices(S, *ghosts.of_gradients)
    expected = matrices(S[:n]) @ Twin(body.all_points, body.all_volumes, body.horizon, body.weigh).Z[:n]
    sums.weigh_moments[3].bind(S, passes.inverse_shape, body.volumes, chunks=CHUNKS)()
    close(matrices(S[:n]), expected / body.volumes[:, None, None])
    # The directed bonds that end in a ghost act on it from their point.
    toward = np.flatnonzero(bonds.neighbors >= n)
    toward = toward[np.argsort(bonds.neighbors[toward], kind="stable")]
    owners = np.repeat(np.arange(n, dtype=np.uint32), np.diff(bonds.pointers).astype(int))[toward]
    pointers = np.zeros(total - n + 1, dtype=np.uint64)
    pointers[1:] = np.cumsum(np.bincount(bonds.neighbors[toward] - n, minlength=total - n))
    vectors = body.all_points[owners] - body.all_points[bonds.neighbors[toward]]
    factors = body.weigh(np.linalg.norm(vectors, axis=1)) * body.volumes[owners]
    assert sums.sum_pair_forces[3].bind(forces, *pairs, 1.0, out, chunks=CHUNKS)() == 0
    for first, lists in (
        (0, (bonds.pointers, bonds.neighbors, passes.weighted_bonds)),
        (n, (pointers, owners, np.ascontiguousarray(vectors * factors[:, None]))),
    ):
        arrays = S, *lists, body.all_volumes, 1.0, first, node_parts, out
        assert sums.add_node_forces[3].bind(*arrays, chunks=CHUNKS)() == 0
    fold_vectors(out, ghosts.source, ghosts.parity)
    for _ in range(5):
        u = np.zeros((total, 3))
        u[:n] = random.standard_normal((n, 3))
        u[n:] = ghosts.parity * u[ghosts.source]
        dF = passes.gradients(u, 0.0)
        fill_matrices(dF, *ghosts.of_gradients, 0.0, np.zeros((len(ghosts), dF.shape[1])))
        change = (forces * (u[bonds.second] - u[bonds.first])).sum() + (moments * (dF[bonds.first] + dF[bonds.second])).sum()
        assert (out[:n] * u[:n]).sum() == pytest.approx(-change, rel=1e-11, abs=1e-9)


def test_shares_of_bonds_center_them(random):
    """The shares of greatest entropy by Newton's method in NumPy, and what they are for: no first moment within the body."""
    body = cube()
    bonds, points = body.bonds, body.points
    strength = random.uniform(0.5, 1.5, len(bonds.first))
    shares = np.zeros(len(bonds.neighbors))
    arrays = np.arange(len(body), dtype=np.uint32), bonds.pointers, bonds.neighbors, bonds.pair_of, points, body.volumes, strength
    supported = np.ones(len(body), dtype=bool)
    reference_state.bond_shares[3].bind(*arrays, supported, body.horizon, shares, chunks=CHUNKS)()
    epsilon = reference_state.LEAST_TILT_STIFFNESS
    for i in range(0, len(body), 5):
        mine = slice(int(bonds.pointers[i]), int(bonds.pointers[i + 1]))
        x, weights = (points[bonds.neighbors[mine]] - points[i]) / body.horizon, strength[bonds.pair_of[mine]]
        tilt = np.zeros(3)
        for _ in range(60):
            share = weights * np.exp(-x @ tilt)
            share /= share.sum()
            mean = share @ x
            hessian = (share[:, None] * x).T @ x - np.outer(mean, mean) + epsilon * np.eye(3)
            step = np.linalg.solve(hessian, epsilon * tilt - mean)
            tilt -= step * min(1, 1 / max(np.linalg.norm(step), 1e-300))
        np.testing.assert_allclose(shares[mine], body.volumes[i] * share, rtol=1e-11)


def test_steps(random):
    n = 400
    positions, velocities, forces, last, displacements = random.standard_normal((5, n, 3))
    free, mass = (random.random((n, 3)) > 0.2).astype(float), random.uniform(1, 2, n)
    found = steps.rayleigh_parts(velocities, forces, last, mass)
    close(found, (-(velocities * (forces - last)).sum(), (mass[:, None] * velocities**2).sum()))
    v = ((2 - 0.3) * velocities + 2 * forces / mass[:, None]) / (2 + 0.3) * free
    moved = positions.copy(), velocities.copy()
    steps.relaxation_step(*moved, forces, last, free, mass, 0.3)
    close(moved[0], positions + v)
    close(moved[1], v)
    np.testing.assert_array_equal(last, forces)

    volumes = random.uniform(1, 2, n)
    assert steps.greatest_force_density(forces, free, volumes) == (np.abs(forces) * free / volumes[:, None]).max()

    moved, span = (positions.copy(), velocities.copy()), 0.5 * (0.1 + 0.12)
    steps.central_difference_step(*moved, forces, free, mass, 0.4, 0.1, 0.12)
    v = ((1 - 0.2 * span) * velocities + span * forces / mass[:, None]) / (1 + 0.2 * span) * free
    close(moved[0], positions + 0.1 * v)
    close(moved[1], v)

    body = cube(ROLLERS)
    first, second, displacements = body.bonds.first, body.bonds.second, random.standard_normal((len(body), 3))
    within = second < len(body)
    ends = first[within], second[within]
    length = np.linalg.norm(body.points[ends[1]] - body.points[ends[0]], axis=1)
    expected = (np.abs(displacements[ends[1]] - displacements[ends[0]]).max(axis=1) / length).max()
    assert steps.greatest_strain(displacements, body.points, first, second) == pytest.approx(expected, rel=1e-14)


def test_overstretched_bonds():
    body = cube()
    first, second = body.bonds.ends_in_blocks(BLOCK)
    y, n_pairs = deformed(body.points), len(body.bonds.first)
    length = np.linalg.norm(body.points[second] - body.points[first], axis=1)
    limits = np.full(len(first), np.inf)
    limits[:n_pairs] = (1.2 * length[:n_pairs]) ** 2
    found, counts = np.zeros(len(first), dtype=np.uint32), np.zeros(1, dtype=np.int64)
    arrays = y, first, second, limits.reshape(-1, BLOCK), np.zeros((1, 3, BLOCK)), found, counts
    number = damage.find_overstretched[3].bind(*arrays, chunks=Chunks(threads=1, number=1))()
    expected = np.flatnonzero(((y[second] - y[first]) ** 2).sum(axis=1) > limits)
    assert 0 < number < n_pairs
    np.testing.assert_array_equal(found[:number], expected)


SHEET = """
import pdsurrogate as pds
for force in ("nosb", "bond-energy", "analytic"):
    pds.simulate(pds.load_scene("uniaxial", {"spacing": 0.1, "stretches": [1.1]}), force)
from pdsurrogate.kernels.algebra import algebra_of
print(algebra_of.cache_info().currsize)
"""


def test_a_sheet_needs_nothing_of_space():
    done = subprocess.run([sys.executable, "-c", SHEET], capture_output=True, text=True, check=True)
    assert done.stdout.split("\n")[-2] == "1"
