"""Material cards run by CalculiX, against the energies that they are said to mean."""

import numpy as np
import pytest
from calculix import needs_calculix, stresses

import pdsurrogate as pds
from pdsurrogate.cards.constants import as_read
from pdsurrogate.cards.programs import PROGRAMS
from pdsurrogate.cards.writing import card_of
from pdsurrogate.materials import PLANES

M = pds.materials
LAWS = (
    M.NeoHookean(0.4, 40.0),
    M.MooneyRivlin(0.4, 40.0, second_share=0.3),
    M.Yeoh(0.4, 40.0, second=-0.02, third=3e-4),
    M.Ogden(bulk_modulus=40.0, moduli=(0.63, 0.0012, -0.01), exponents=(1.3, 5.0, -2.0)),
    M.ArrudaBoyce(0.4, 40.0, chain_links=9.0),
)
SMALL, LARGE = (np.diag([one, one**-0.5, one**-0.5]) for one in (1.001, 2.0))
LESS, MORE = (J ** (1 / 3) * np.eye(3) for J in (0.9, 1.1))
UNITS = {
    "MPa": (1.0, (SMALL, LARGE, LESS, MORE)),
    "kPa": (1e3, (SMALL, MORE)),
    "Pa": (1e6, (SMALL, MORE)),
}


@needs_calculix
@pytest.mark.parametrize("unit", UNITS)
@pytest.mark.parametrize("law", LAWS, ids=lambda law: law.name)
def test_a_card_means_the_energy_of_its_heading(law, unit, tmp_path):
    factor, gradients = UNITS[unit]
    law = law.scaled(factor)
    card = card_of(law, "calculix-card", "RUBBER")
    meant = as_read(law, PROGRAMS["calculix-card"].forms[law.name].U)
    for F, found in zip(gradients, stresses(card, gradients, tmp_path), strict=True):
        _, P, _ = PLANES["space"].exact(meant, F[None])
        wanted = P[0] @ F.T / np.linalg.det(F)
        assert found == pytest.approx(wanted, abs=1e-4 * abs(wanted).max())
