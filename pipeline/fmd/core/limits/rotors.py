"""Rotors: what turns about one axis, and how they are followed."""

# Bending.
# Squared displacement of points on the axis across it, times the whole mass, for a unit modal mass: more is bending.
BENDS = 1e-2

# Campbell diagram.
NO_DAMPING = 1e-10  # damping ratio of round-off
NO_WHIRL = 0.1  # circulation below which a motion is to and fro
