"""Stability of steps and coupling."""

# Steps.
BISECTIONS = 30  # of the longest safe step: it is then known to the last digits
BEYOND_LIMIT = 1.02  # times the limit, where the worst operating point shows
BELOW_CRITICAL = 0.8  # of the critical step: the longest one to recommend
ALLOWED_GROWTH = 10.0  # factor over the duration, beyond which a march is called unstable
NEARLY_STABLE = 0.9  # of the largest stable step: the longest one that is measured
SMALLEST_SHARE = 1e-6  # of the upper step: no shorter one is tried
SUMMIT = 0.5  # of the e-folds allowed: where growth comes so high and falls again, longer steps are not trusted
DAMPED = 1.01  # step without dampers over that with them, from which they are named
SURELY_STABLE = 0.4  # of the largest stable step: for a variant that is unstable at the run's own

# Operating points.
OPERATING_POINTS = 8  # of a motion, in the middles of equal parts of the duration
RIGID_STEPS = 20_000  # of the rigid motion, at least
RESOLVED_STEP = 0.1  # step of the rigid motion over its largest stable one, at most
SPAN = 1e-3  # of the duration: over so long a span the round-off of a tangent map is harmless
# Part of the duration after which a tangent map is done if nothing grows by more e-folds over the duration; most steps
# that are stable take no longer span.
FIRST_SPAN, NO_GROWTH = SPAN / 16, 1e-3
RIGID_TOLERANCE = 1e-6  # of a motion with all bodies rigid, by a method that chooses its steps
RATE_NUDGE, ACCELERATION_NUDGE = 1e-4, 1e-2  # of central differences [SI units], larger than that of positions

# Sub-cycling.
MOST_SUBSTEPS = 50  # fast steps in a slow one: more gain next to nothing
STABLE_SHARE = 0.8  # of the stability limit 2/ω
NO_RESTORING = 1e-6  # of the highest frequency: nothing holds what is below
SLOW_STEPS = 200  # slow steps over the duration, at least
HIGHEST_COURANT = 2.5  # Courant number up to which maps go
SLOWNESS = 1e-3  # slow over fast frequency, at which the law of the weak instability is fitted
STRONG = 0.99  # Inertial coupling β beyond which sub-cycling is warned of.

# Terminal.
COUPLED = 1e-6  # inertial coupling of rotation and modes from which on sub-cycling is said to grow
GROWING = 0.01  # growth over the scene by the method itself that is worth a note

# Sub-cycling by carried forces.
TRIED_PART, TRIED_TIMES = 1 / 16, 33  # of the duration, and times in it: a part by which the error of all is estimated
LEAST_CYCLES = 16  # in that part: fewer tell nothing

# Sampled controllers.
SAME_SAMPLES = 1e-9  # of a ratio of sample times: a whole number but for round-off
LONGEST_CYCLE = 10_000  # shortest sample times in a common multiple of all
FINELY_SAMPLED = 1 / 64  # of the sample times: as good as continuous control
SAMPLED_STATES = 5  # of a motion, evenly, at which its loops are checked
COARSE_EXCHANGE = 0.1  # change of an FMU's output in a sample time over its largest value that is worth a warning

# Motions that repeat.
SEARCH_TOLERANCE = 1e-8  # of the steps of the search, over the wanted error
CLOSES = 1e-3  # gap and last correction, over the wanted error, beside the largest value of each kind of coordinate
CORRECTIONS = 40  # of Newton's method
ADDED_UP = 1e3  # tolerances: what the steps of a period may be off by together
OF_SOLUTIONS = 1e-12  # the same of implicit steps, which differ as smoothly as their solutions
FOLLOWED = 0.03  # part of a gap that may be left of it by the directions in which disturbances are followed
ASTRAY = 10.0  # times the gap before: a correction that leaves more is halved
KEPT_SLOPES = 0.05  # part of the gap before: with less left, disturbances followed before go on to serve
SAME_MULTIPLIER = 1e-4  # error of a multiplier that is told
SAMPLES = 64  # of a period, for the largest values of coordinates
JUST_BEFORE = 1.0 - 1e-9  # of a period: a load that jumps at its end hasn't jumped yet
NOT_PERIODIC = 1e-6  # accelerations a period later may differ by, beside the largest along the motion
GROWS = 1e-3  # modulus of a multiplier above 1 that is neither round-off nor of a motion that nothing holds
SHOWN_MULTIPLIERS = 5  # on the terminal
MULTIPLIER_DECIMALS = 4  # of a modulus there: differences of marches tell no more of small ones
