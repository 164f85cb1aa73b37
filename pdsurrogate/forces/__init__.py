"""Force models, which compute the internal forces of a deformed body."""

from ..errors import InvalidState, OutsideDomain, OutsideDomainWarning
from .ba_nosb import BANOSBForce
from .binding import MaterialPart
from .bond_energy import BondEnergyForce, EnergySurrogate
from .bond_force import AnalyticBondForce, ForceSurrogate
from .domain import Domain
from .internal_force import InternalForce, released_by
from .learned_energy import EnergyNetwork, IsochoricNetwork, LearnedEnergy
from .learned_force import LearnedBondForce, NetworkForce, PolynomialForce, SplineForce
from .nosb import NOSBForce
from .own import OwnBondForce, OwnForceFailed, OwnForceInvalid, is_own_force
from .protocol import ForceModel, bind_portions
from .settings import ForceSettings

FORCES = {
    model.name: model for model in (AnalyticBondForce, BANOSBForce, BondEnergyForce, NOSBForce)
}
"""Force models that need no artifact, by their names in scenes and on the command line."""

__all__ = [
    "AnalyticBondForce",
    "BANOSBForce",
    "BondEnergyForce",
    "ForceModel",
    "ForceSettings",
    "NOSBForce",
    "OwnBondForce",
]
__all__ += [
    "EnergyNetwork",
    "EnergySurrogate",
    "ForceSurrogate",
    "IsochoricNetwork",
    "NetworkForce",
    "PolynomialForce",
    "SplineForce",
]
__all__ += ["InvalidState", "OutsideDomain", "OutsideDomainWarning"]
