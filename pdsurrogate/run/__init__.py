"""Loading programmes: levels in equilibrium, and explicit dynamics."""
