"""Sources of exported files: the energy of a law or an artifact, the facts that a reader needs,
and states that check the file.
"""

from dataclasses import dataclass

import numpy as np

from ..artifacts.places import find_artifact
from ..artifacts.store import called, law_of, load_card, load_surrogate
from ..forces import EnergyNetwork, IsochoricNetwork
from ..kernels.branches import tensors_of
from ..kernels.softening import soften, softening_loss
from ..materials import InvariantLaw, Law, PrincipalStretchLaw, solid
from ..materials.consistency import check_consistency
from ..materials.states import cofactor, invariants

N_STATES = 4
LEAST = 0.85
GREATEST = 1.2
"""Number of states by which an exported file is checked, and the bounds of their principal
stretches. Chosen: a wrong constant shows at 20 % of strain; a law that ends before has smaller
strains.
"""


@dataclass(frozen=True)
class Source:
    """Energy to export: that of a law, or of a network that has learned the energy of a law.

    Attributes
    ----------
    title : str
        Name of the law, or name and version of the artifact.
    law : Law
        Law with the moduli that the exported file has as defaults; it gives the volumetric energy
        of an isochoric network.
    network : EnergyNetwork or IsochoricNetwork, optional
        Learned energy; None for the energy of the law.
    facts : tuple of str
        Origin and limits of the energy, in sentences.
    """

    title: str
    law: Law
    network: EnergyNetwork | IsochoricNetwork | None
    facts: tuple[str, ...]

    @property
    def is_sheet(self) -> bool:
        """Whether the energy is that of a sheet under plane stress, a function of the
        deformation gradient in the plane.
        """
        return isinstance(self.network, EnergyNetwork)

    @property
    def moduli(self) -> tuple[float, ...]:
        """Shear modulus and bulk modulus, the parameters of an exported file; of a sheet the
        first alone.
        """
        return (
            (self.law.shear_modulus,)
            if self.is_sheet
            else (self.law.shear_modulus, self.law.bulk_modulus)
        )

    @property
    def n_state(self) -> int:
        """Number of state variables: six for every branch, six for C, one for softening."""
        memory = self.law.memory
        branches = len(memory.branches)
        return 6 * (branches + bool(branches)) + (memory.softening is not None)

    @property
    def time_step(self) -> float:
        """Duration of the steps of the check: the first relaxation time."""
        branches = self.law.memory.branches
        return branches[0].time if branches else 1.0

    def energy_and_stress(self, F) -> tuple[np.ndarray, np.ndarray]:
        """Return the energy density (n,) and the first Piola-Kirchhoff stress of deformation
        gradients of shape (n, 3, 3) or (n, 2, 2).

        The sheets of `is_sheet` have the latter shape. The package computes both in NumPy.
        """
        law = self.law
        network = self.network
        if self.is_sheet:
            energy, by_trace, by_J, *_ = network.energy_derivatives(law, *invariants(F))
            stress = 2 * by_trace[:, None, None] * F + by_J[:, None, None] * cofactor(F)
            return law.shear_modulus * energy, law.shear_modulus * stress
        isochoric = None
        state = invariants(F)
        if network is not None:
            response = solid.isochoric_response
            none = np.zeros_like(state[0])
            W = network.isochoric_derivatives(*response.invariants(state))
            isochoric = response.of_invariants(state, (*W, none, none, none), (none, none, none))
        stress, energy = solid.stress_and_energy(
            law, F, state[-1], law.volumetric(state[-1], law.parameters)[1], isochoric
        )
        return energy, stress

    def _remembered(self, F, energy, stress) -> tuple[np.ndarray, np.ndarray]:
        """Return stored energy and stress with branches and softening, at states (n, 3, 3) that
        follow one another from rest, each after `time_step`.
        """
        law = self.law
        mu = law.shear_modulus
        J3 = invariants(F)[-1]
        U, slope, _ = (mu * part for part in law.volumetric(J3, law.parameters))
        volumetric = slope[:, None, None] * cofactor(F)
        W = energy - U
        if softening := law.memory.softening:
            numbers = softening.r, softening.m, softening.beta
            peak = np.maximum(np.maximum.accumulate(W), 0)
            eta, W, _ = soften(W, peak, softening_loss(peak, numbers), numbers)
            energy = W + U
            stress = eta[:, None, None] * (stress - volumetric) + volumetric
        inverse = np.linalg.inv(F).swapaxes(1, 2)
        Cb = np.cbrt(J3**-2)[:, None, None] * (F.swapaxes(1, 2) @ F)
        upper = np.triu_indices(3)
        steps = tensors_of(3)
        for branch in law.memory.branches:
            C_k, before = (list(np.eye(3)[upper]) for _ in range(2))
            for row, now in enumerate(Cb):
                C_k = steps.end_step(
                    *steps.begin_step(C_k, before, self.time_step / branch.time), now[upper]
                )
                before = now[upper]
                M = np.zeros((3, 3))
                M[upper] = steps.cofactor_of(C_k)
                M = M + M.T - np.diag(np.diag(M))
                share = np.sum(now * M)
                energy[row] += branch.modulus / 2 * (share - 3)
                drive = np.cbrt(J3[row] ** -2) * F[row] @ M
                stress[row] += branch.modulus * (drive - share / 3 * inverse[row])
        return energy, stress

    def states(self) -> np.ndarray:
        """Return rows of F, energy density and first Piola-Kirchhoff stress at a few random
        deformations within the limit of the law.
        """
        d = 2 if self.is_sheet else 3
        random = np.random.default_rng(0)
        turns = np.linalg.qr(random.standard_normal((2, N_STATES, d, d)))[0]
        stretches = random.uniform(LEAST, GREATEST, (N_STATES, d, 1))
        energy = np.array(np.nan)
        while not np.isfinite(energy).all():
            F = turns[0] @ (stretches * turns[1])
            F[np.linalg.det(F) < 0] = F[np.linalg.det(F) < 0][:, ::-1]
            with np.errstate(all="ignore"):  # beyond the limit of the law
                energy, stress = self.energy_and_stress(F)
                if self.law.memory:
                    energy, stress = self._remembered(F, energy, stress)
            stretches = np.sqrt(stretches)
        return np.hstack([F.reshape(N_STATES, -1), energy[:, None], stress.reshape(N_STATES, -1)])


def source_of_law(law: Law) -> Source:
    """Return the energy of a law as an object to export; raise ValueError if its derivatives are
    wrong or it has an unknown form.
    """
    if not isinstance(law, InvariantLaw | PrincipalStretchLaw):
        raise ValueError(
            f"{law.name}: this is neither an InvariantLaw nor a PrincipalStretchLaw, which can be"
            " exported"
        )
    check_consistency(law)
    parameters = ", ".join(
        f"{key} = {value}" for key, value in law.describe().items() if key != "law"
    )
    first = " ".join((type(law).__doc__ or "").partition("\n\n")[0].split())
    return Source(law.name, law, None, (first, f"Parameters: {parameters}."))


def source_of_artifact(reference: str) -> Source:
    """Return the energy of an artifact as an object to export.

    An artifact with a bond force, which no energy gives, exports the energy of the law from which
    it was learned. Raise ArtifactError if the artifact is unknown or damaged.
    """
    folder = find_artifact(reference, ())
    card = load_card(reference)
    model = load_surrogate(reference)
    law = law_of(card)
    title = called(folder, card)
    origin = f"Artifact {title}, digest {card.found_digest()}."
    if not isinstance(model, EnergyNetwork | IsochoricNetwork):
        exact = source_of_law(law)
        learned = (
            "The artifact has a bond force, which no energy gives: this is the energy of the law"
            " from which it was learned."
        )
        return Source(title, law, None, (origin, learned, *exact.facts))
    low = model.domain.least_stretch
    high = model.domain.greatest_stretch
    stretches = f"principal stretches from {low:g} to {high:g}"
    error = (
        f"The stress has a relative RMS error of {card.errors['box']['on_surface']['rms']:.1e}"
        f" against the law {law.name}."
    )
    if isinstance(model, EnergyNetwork):
        what = (
            "Learned energy of a sheet under plane stress, for bulk_modulus/shear_modulus ="
            f" {law.bulk_modulus / law.shear_modulus:g}."
        )
    else:
        stretches = f"isochoric {stretches}"
        what = f"Learned isochoric energy, with the volumetric energy U(J3) of the law {law.name}."
    limits = (
        f"Domain: {stretches}. Outside, the network is extrapolated, as in a run with"
        " outside=extrapolate."
    )
    return Source(title, law, model, (origin, what, error, limits))
