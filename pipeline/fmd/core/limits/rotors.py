"""Rotors: what turns about one axis, and how they are followed."""

# Bending.
# Squared displacement of points on the axis across it, times the whole mass, for a unit modal mass: more is bending.
BENDS = 1e-2

# Campbell diagram.
NO_DAMPING = 1e-10  # damping ratio of round-off
NO_WHIRL = 0.1  # circulation below which a motion is to and fro

# Steady rotation.
ALIKE_AROUND = 1e-4  # of stiffness: equations of a rotor that are the same at every angle
COMPARED_TURN = 1.0  # angle at which they are compared [rad]
SHORTEST_RATE = 1 / 256  # of the rate: shortest step to it
ON_AXIS = 1e-6  # of the farthest marker: one nearer to the axis is on it
ECCENTRIC = 2.5e-4  # of the rotor's size: unbalance that changes frequencies by less than 1 %
STEADY_RATE = 1e-3  # of the squared rate, or of 1 rad/s²: less is no acceleration of the whole

# Unbalance.
LOOSE_STATE = 1e-13  # of the largest singular value of a scaled state matrix: what nothing holds
HALF_POWER = 0.5**0.5  # of a peak, at which its width is measured
PEAK_DIGITS = 1e-8  # of a critical rate
# How far from a critical rate that of a rotor with more modes is looked for: a part of it, or widths of its peak.
OF_PEAK, WIDTHS_OF_PEAK, POINTS_OF_PEAK = 0.02, 3.0, 41
SHARPEST = 1e6  # amplification factor of a rotor without damping
