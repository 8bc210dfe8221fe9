"""Linear responses: poles, zeros and whirl."""

# Frequencies.
LEAST_DAMPING = 1e-5  # narrower resonances are taken as so wide
NEAREST_TO_POLE = 0.05  # of half a bandwidth, distance from the pole
FINE_RATIO = 1.05  # ratio of distances from a pole: integrals over a resonance are then right to 2e-4
UNDAMPED = 1e-8  # damping ratio
NEAR_POLE, AWAY_FROM_POLE, RESONANT = 1e-7, 1e-3, 100.0  # a resonance is so much larger at the first of two distances
UNBOUNDED = 1e12  # a response beyond is that of an undamped pole itself

# Poles and zeros.
SLOW_POLE = 1e-6  # of the fastest oscillation: one that moves slower is a rigid motion
ROUNDED_POLES = 10.0  # round-off of the fastest pole that slow ones may have
FAR_ZERO = 0.2  # a zero with a larger real part, over its imaginary one, makes no response small
CANCELS = 1e-6  # distance of a zero from the pole that it cancels, over its size
INFINITE_ZERO = 1e4  # zeros so many times beyond the fastest pole are at infinity

# Whirl.
POLARISED = 0.5  # circulation from which on a motion is a whirl
ACROSS_AXIS = 1e-3  # of the markers' motion: a vibration with less of it across the axis doesn't whirl
NO_ENTRY = 1e-18  # of a matrix's largest entry
RIGID_POLE = 1e-7  # of the fastest: a pole that moves slower is a rigid motion

# State of linearisation.
STILL = 1e-3  # accelerations of joints below are none [rad/s² or m/s²], beside the squared rates
SETTLED_STATE = 1e-4  # of the largest modal coordinate
