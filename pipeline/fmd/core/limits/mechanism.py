"""Mechanisms: what counts as constrained, coupled and light in them."""

# Mass.
NO_MASS_LEFT = 1e-12  # of the largest singular value of a frame's scaled inertia: less is a motion without inertia
