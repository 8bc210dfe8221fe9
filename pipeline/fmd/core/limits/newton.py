"""Newton's method: what counts as small where something is closed, at rest or steady, and how long it is sought."""

# Of all.
STALLED = 0.3  # part of the size before: what shrinks by less no longer converges as Newton's method does
MOST_HALVINGS = 12  # of a correction: 1/4096 of it still makes nothing better
FARTHEST = 0.3  # turn of a joint, and of a marker within its body, in one correction [rad]; of a slide at first [m]
NUDGE = 1e-6  # of positions, by which forces and accelerations are differentiated [SI units]
SHORTEST_NORM = 1e-300  # divisor in place of 0, for motions that aren't there

# Loops that close at the start.
CLOSED = 1e-12  # residual of a constraint that is none [m or rad]
OPEN = 1e-9  # the same where it no longer shrinks; one that is larger is an open loop [m or rad]
CLOSING_CORRECTIONS = 60  # many: a start may be far off, and corrections halve near singular positions
DEPENDENT_DIRECTION = 1e-9  # of the largest singular value: directions in which nothing closes
AWAY = 1e-3  # motion by which the rank of the constraints is tried [rad or m]
TRIED, SPREAD = 3, 0.2  # positions nearby at which constraints are tried, and how far off they are [rad or m]
WAYS_TRIED = 12  # positions from anywhere, from which other ways of closing are sought
OTHER_WAY = 1e-3  # how far apart two ways are [rad or part of the size of the gap]
SHOWN_WAYS = 4  # written in a message
DRIVEN_MOMENTS = 5  # at which prescribed motions are tried

# Loops in each step of a march.
PROJECTED = 1e-14  # residual of a constraint that is round-off [m or rad]
NOT_PROJECTED = 1e-8  # residual after the last correction that ends a march [m or rad]
PROJECTIONS = 8  # corrections in a step: it starts within the step's error
RELINEARISED = 1e-7  # residual from which on the constraints are linearised anew [m or rad]

# Rest under the loads of the start.
AT_REST = 1e-11  # last correction [rad, m or modal coordinate], also beside the largest position
REST_CORRECTIONS = 200  # long paths down from an unstable start
PRESSED = 1e-9  # forces left over those of the start, where bodies are pressed
ROUNDED_PRESS = 1e-5  # the same where they no longer shrink
LOAD_STEP_CORRECTIONS = 14  # in a load step, which is halved then
SHORTEST_LOAD_STEP = 1 / 64  # of the forces of the start: no shorter step is tried
LONGEST_SLIDE = 1e6  # of a slide in one correction [m]
OVERSHOT = 0.9  # of the force along a correction that may act against it at its end
DOWNHILL = 2.0  # times the most negative stiffness over mass is added where there is one
NO_STIFFNESS = 1e-13  # of the highest stiffness over mass: less counts as none
LEAST_STIFFNESS = 1e-9  # stiffness over mass of what has none at all [1/s²]
UNSTABLE = 1e-6  # of the fastest motion: an eigenvalue above is a motion that grows

# Steady states: modes at rest in their frames.
STEADY = 1e-10  # last correction, beside the largest modal coordinate
STEADY_CORRECTIONS = 30  # also of steady rotations
LOOPS_STEADY = 1e-7  # last correction of modes and joints, beside the largest modal coordinate: slopes are differences
LOOPS_AT_REST = 1e-6  # forces left, over what would deflect a mode by 1, beside the largest modal coordinate
LOOPS_NO_FORCE = 1e-12  # forces left that are none, over what would deflect a mode by 1
LOOPS_DEPENDENT = 1e-10  # of the largest singular value of the slopes
LOOPS_MOMENT = 1e-5  # how far rates move the mechanism where constraints are differentiated in time [rad or m]

# Operating points along a motion.
SETTLED = 1e-8  # last correction, beside the largest position or 1
SETTLING_CORRECTIONS = 20  # a point that isn't near by rests where it is
WORST_CONDITION = 1e14  # of slopes that are inverted; beyond, pseudoinverses leave out what nothing holds

# Steady rotation of a mechanism as a whole.
TURNING = 1e-9  # last correction, beside the largest one
SOFT = 1.0  # stiffness over mass by which a coordinate counts at least [1/s²]
LOOSE = 1e-10  # of the largest singular value: nothing holds such a motion

# Generalised-α method, in each step.
CONVERGED = 1e-10  # last correction, relative to the largest acceleration
OF_GUESS = 1e-5  # times that: the round-off of the acceleration that an iteration starts from
# Of positions, relative to the largest, or to a radian or metre: a loop of three bars with 27 modes each, nearly at
# rest, has up to 3e-13, since a tangent's condition is 1e13.
POSITION_ROUND_OFF = 1e-12
LEAST_MOVED = 1e-10  # of positions, by which slopes are differences above the accelerations' round-off [rad or m]
# The same where surfaces touch, which a move by more may part, at first and where that doesn't converge [rad or m].
LEAST_PRESSED = 1e-12, 1e-14
STEP_ITERATIONS = 12  # of a step: one that needs more is too long
DAMPED_ITERATIONS = 36  # the same with shortened corrections: few of those that are long cross no state of a point
MOST_HALVED = 6  # of these corrections: 1/64 of one is made whatever the next one is
VANISHED = 1e-200  # an acceleration below which nothing is left to converge: damped motions underflow in the end
BALANCING_PART = 1e-6  # part of each coordinate of the start by which it is changed to see what forces balance there

# Selection.
LOCATING_CORRECTIONS = 20  # in an element, to find a point: beyond, it lies far outside
