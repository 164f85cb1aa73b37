"""The two states that a body in the plane may be in; one interface, so that who knows the name of the state need not know more."""

from . import plane_strain, plane_stress

PLANES = {"stress": plane_stress, "strain": plane_strain}
"""By the name that scenes and settings know: modules with `response`, `volume_ratio`, `first_piola_stress` and `energy_density`."""
