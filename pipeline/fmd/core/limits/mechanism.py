"""Mechanisms: what counts as constrained, coupled and light in them."""

# Mass.
NO_MASS_LEFT = 1e-12  # of the largest singular value of a frame's scaled inertia: less is a motion without inertia
DEFLECTED_TIMES = 20  # output times with the largest deflections
LOST_INERTIA = 0.05  # of an inertia, where a march ends because it vanishes
NO_INERTIA = 1e-14  # of the other coordinates', for each of them: round-off of the mass matrix

# Constraints.
SHARED_MOMENTS = 21  # of a motion, between which shares are interpolated
OPEN_MOMENTS = 5  # of a motion, at which components are looked for

# Loads through bodies.
LEAST_SHARE = 0.1  # of the largest load at a body's markers that each of them counts with at least

# Coupling of fast and slow coordinates.
COUPLED_STATES = 3  # random states at which coupling is sought
COUPLED_TIMES = 33  # at which inputs are looked at
COUPLED_DEFLECTION = 0.1  # of modal coordinates, beside rates of 1 rad/s or m/s
NEGLIGIBLE_STIFFNESS, NEGLIGIBLE_DAMPING = 1e-5, 1e-8  # by rates of 1 rad/s: too small to tell within a major cycle

# Force elements.
# Length [m] below which a spring between points has no direction: its length is ``√(d² + SHORTEST²)``.
SHORTEST_SPRING = 1e-9
NO_LENGTH = 1e-12  # of a spring whose line has no direction [m]

# Rotations.
SMALL_ANGLE = 0.05  # angle [rad] below which series replace differences that cancel

# Steps.
NO_FORCE = 1e-3  # largest response of a mode that is left out, over the wanted error

# Loops.
MOVED_BY_CLOSING = 1e-6  # how far a joint has to move as loops close to be named [rad or m]
# Of the distance of joints from the origins of their bodies: less, where no motion can close it, is the mesh's error
# of a face's centre and is taken as closed, with a warning.
CLOSED_SHARE = 1e-5
ALONG_AXIS = 0.9  # cosine between a direction and an axis for which it counts as along it
