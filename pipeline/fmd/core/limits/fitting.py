"""Derivatives of results by numbers of a scene, and fits to measurements."""

# Derivatives by differences.
DIFFERENCE = 2e-3  # of a number: the longer of the two steps that differences are extrapolated from
JUMP = 0.05  # per cent per per cent that a largest value gains elsewhere, from which on it is said to jump
