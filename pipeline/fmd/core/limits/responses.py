"""Linear responses: poles, zeros and whirl."""

# Frequencies.
LEAST_DAMPING = 1e-5  # narrower resonances are taken as so wide
NEAREST_TO_POLE = 0.05  # of half a bandwidth, distance from the pole
FINE_RATIO = 1.05  # ratio of distances from a pole: integrals over a resonance are then right to 2e-4
UNDAMPED = 1e-8  # damping ratio
NEAR_POLE, AWAY_FROM_POLE, RESONANT = 1e-7, 1e-3, 100.0  # a resonance is so much larger at the first of two distances
UNBOUNDED = 1e12  # a response beyond is that of an undamped pole itself

# Modes.
RELIABLE_SHARE = 0.5  # of the highest mode: up to there a response is that of the whole mesh within 5e-3

# Poles and zeros.
SLOW_POLE = 1e-6  # of the fastest oscillation: one that moves slower is a rigid motion
ROUNDED_POLES = 10.0  # round-off of the fastest pole that slow ones may have
FAR_ZERO = 0.2  # a zero with a larger real part, over its imaginary one, makes no response small
CANCELS = 1e-6  # distance of a zero from the pole that it cancels, over its size
INFINITE_ZERO = 1e4  # zeros so many times beyond the fastest pole are at infinity

# Whirl.
ACROSS_AXIS = 1e-2  # of the squared motion of all markers: with less of it across the axis this isn't bent
NO_ENTRY = 1e-18  # of a matrix's largest entry

# State of linearisation.
STILL = 1e-3  # accelerations of joints below are none [rad/s² or m/s²], beside the squared rates
SETTLED_STATE = 1e-4  # of the largest modal coordinate
RIGID_POLE = 1e-7  # of the fastest vibration: a pole that oscillates slower is a rigid motion
RIGID_DRIFT = 1e-6  # of the fastest vibration: a smaller real pole is a rigid motion, split by round-off
GROWS = 1e-6  # of its own size: the real part of a pole from which on its motion grows
BESIDE_MEETING = 1e-3  # of a rate: so far beside it a whirl that stands still in the turning frame is looked at
LOOKED_RATES = 21  # of a range: between two, a frequency is met once
DOUBLED_RATES = 6  # times that the highest rate is doubled, to meet frequencies
NEAR_CRITICAL = 0.003  # of a critical speed: how far beside it that of a rotor a difference away is looked for
UNSTABLE_EDGE = 1e-4  # of the highest rate: how near the edges of unstable ranges are found

# Models over the rate of rotation.
INTERPOLATED = 1e-8  # of a pole: what interpolation may move it by
NARROWEST_PANEL = 1e-3  # of the highest rate: where narrower ones are needed, every model is computed

# Errors of a linear model by ranges of frequency.
ERROR_BANDS, ERROR_DECADES, POINTS_OF_BAND = 30, 3, 12
LITTLE_OFF = 0.01  # of a range's largest response: up to where it is within that, is said

# Models with fewer states.
RESPONSE_POINTS = 400  # evenly spaced frequencies at which an error is looked for, beside those about resonances
BEYOND_POLES = 1.5  # of the fastest pole: up to there a response is looked at
ROUNDED_GRAMIAN = 1e-13  # of the largest singular value: a state that is reached or seen less is round-off
WORST_VIBRATIONS = 1e-8  # relative round-off of coordinates in which vibrations are apart, above which they go unused

# Bending.
# Squared displacement of points on the axis across it, times the whole mass, for a unit modal mass: more is bending.
BENDS = 1e-2

# Campbell diagram.
NO_DAMPING = 1e-10  # damping ratio of round-off
NO_WHIRL = 0.1  # circulation below which a motion is to and fro
WHIRLS_BETWEEN = 4  # frequencies of whirl between two rows of a bearing's table at which vibrations are looked for
WHIRL_DIGITS = 1e-12  # of such a frequency
WHIRL_CORRECTIONS = 8  # of Newton's method for one of them; without an answer it is found by halves
WHIRL_OFF_LINE = 0.1  # of the way from pole to pole: how far off the straight line between them that of a vibration is

# Steady rotation.
ALIKE_AROUND = 1e-4  # of stiffness: equations of a rotor that are the same at every angle
COMPARED_TURN = 1.0  # angle at which they are compared [rad]
SHORTEST_RATE = 1 / 256  # of the rate: shortest step to it
ON_AXIS = 1e-6  # of the farthest marker: one nearer to the axis is on it
ECCENTRIC = 2.5e-4  # of the rotor's size: unbalance that changes frequencies by less than 1 %
YIELDING = 10.0  # of the rate: vibrations above it follow an unbalance by their stiffness alone
STEADY_RATE = 1e-3  # of the squared rate, or of 1 rad/s²: less is no acceleration of the whole

# Unbalance.
LOOSE_STATE = 1e-13  # of the largest singular value of a scaled state matrix: what nothing holds
# Of the same: the free turn of a rotor, which a mesh a little out of round holds by 1e-12 at 10,000 rpm, and by more at
# higher rates. Vibrations of the ready rotor are down to 1.3e-8, lightly damped ones at their critical rate far below.
# Unlike these it moves points on the axis by less than so much of what others do.
LOOSE_TURN, LEAST_SEEN = 6e-9, 3e-4
HALF_POWER = 0.5**0.5  # of a peak, at which its width is measured
PEAK_DIGITS = 1e-8  # of a critical rate
# How far from a critical rate that of a rotor with more modes is looked for: a part of it, or widths of its peak.
OF_PEAK, WIDTHS_OF_PEAK, POINTS_OF_PEAK = 0.02, 3.0, 41
SHARPEST = 1e6  # amplification factor of a rotor without damping
