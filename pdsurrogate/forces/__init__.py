"""Force models: what turns a deformed body into forces."""

from .analytic import AnalyticBondForce
from .bond_associated import BondAssociatedForce
from .bond_energy import BondEnergyForce
from .energy_density import EnergySurrogate
from .learnt import LearntBondForce
from .learnt_energy import EnergyNetwork
from .model import BindableForce
from .network import NetworkForce
from .nosb import CorrespondenceForce
from .polynomial import PolynomialForce
from .protocol import Domain, ForceModel, ForceSurrogate, InternalForce, InvalidState, OutsideDomain, OutsideDomainWarning
from .settings import ForceSettings

FORCES = {model.name: model for model in (AnalyticBondForce, BondAssociatedForce, BondEnergyForce, CorrespondenceForce)}
"""Force models that need no artefact, by the name under which scenes and the command line know them."""

__all__ = [
    "FORCES",
    "AnalyticBondForce",
    "BindableForce",
    "BondAssociatedForce",
    "BondEnergyForce",
    "CorrespondenceForce",
    "Domain",
    "EnergyNetwork",
    "EnergySurrogate",
    "ForceModel",
    "ForceSettings",
    "ForceSurrogate",
    "InternalForce",
    "InvalidState",
    "LearntBondForce",
    "NetworkForce",
    "OutsideDomain",
    "OutsideDomainWarning",
    "PolynomialForce",
]
