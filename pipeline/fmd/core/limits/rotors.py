"""Rotors: what turns about one axis, and how they are followed."""

# Bending.
# Squared displacement of points on the axis across it, times the whole mass, for a unit modal mass: more is bending.
BENDS = 1e-2
