"""Refinement to a wanted accuracy."""

# Rounds.
MOST_ROUNDS = 6  # after which what is left is stated
MOST_ELEMENTS = 20_000  # of a part's mesh, beyond which it isn't refined
SHARE = 0.5  # of the wanted accuracy that a source may take
STALLED_ERROR = 0.75  # of what is stated is left after each of two rounds, or more: refining doesn't help
GENTLEST, BOLDEST = 1.25, 1.7  # refinement of a mesh in one round, each way
MESH_POWER = 1 / 3  # between the orders of stress and of all else on quadratic elements
MORE_MODES = 1.6  # times as many modes in the next round
TIME_SHARE = 0.05  # of the wanted accuracy, for time integration at the start: it costs the least
LEAST_ERROR = 1e-10  # wanted of time integration: less is beneath the methods' round-off
