"""Properties that force models and laws must have, and checks of models and laws of one's own
against them.
"""

from .checks import FORCE_MODEL_PROPERTIES, check_force_model, check_law
from .laws import LAW_PROPERTIES
from .properties import Finding, Property
