"""Time steps: their errors, ends and resolution of loads."""

# Many marches.
LANE_STEPS = 500_000  # of all together, from which on a step of eight at once is worth its compiling
FEWEST_LANES = 6  # of the eight of a step: with fewer, marches one after the other are sooner done

# Adaptive steps.
STILL_GROUP = 1e-12  # size of a group of coordinates that hasn't moved yet [SI units]
HARDLY_MOVING = 1e-6  # of the largest value of its kind: a group that hardly moves
# Of a run's tolerance, and at least: for motions whose derivatives are taken with their steps as they are. By 3e-6
# derivatives of a random tree were 3e-3 off though its motion was 1e-6 off.
DERIVED, LEAST_DERIVED = 1e-3, 1e-12
SHORTEST_STEP = 1e-12  # of the duration: a shorter step ends the march
SPARE_STEPS, FORGIVEN = 256.0, 2.0  # such steps after a breakpoint, as from rest under sqrt(t), and their largest error
# Of the duration: steps from rest, whose error is beside what they move themselves, can't be below that of the time's
# own round-off.
SHORT_STEP = 1e-6
TIME_JITTER = 8.0  # of the machine epsilon, times the time over a step: the error by the time's own round-off
FIRST_CHUNK, CHUNK = 4, 256  # steps at a time: few at first, lest each takes long and nothing is reported in between
CHUNK_SECONDS = 0.1  # between two reports of progress
LONG_SECONDS = 0.02  # seconds of some steps, beside which a look at what makes them short costs little
CRAWL = 0.05  # radians of the highest frequency in a step: of what vibrates faster than the undeformed mechanism
STEP_SAFETY = 0.9  # of the step by which the error would just be the tolerance
MOST_ADAPTIVE_STEPS, ADAPTIVE_WINDOW = 1e10, 20_000  # steps that never come to an end, by the mean of so many

# Fixed steps.
RUNAWAY = 1e30  # Rates that add up to more are taken as divergence: no mechanism in SI units comes near it.
FIRST_CYCLES = 1024  # of a march's first call, by which the time of a cycle is known
MORE_CYCLES = 1024  # times as many as in the call before: a short march is two calls, each of which takes Python 10 µs
CYCLES_SECONDS = 0.2  # between two reports of progress
MOST_STEPS = 1e12  # a day or more
MANY_RADIANS = 1e6  # radians, or times in which a motion falls to 37 %: more are due to one part, which is named

# Run times that are compared.
REPEATED_SECONDS, MOST_REPEATS = 0.02, 50  # that a march fills by repetition, and how often at most
LEAST_REPEATS, THRICE_SECONDS = 3, 0.1  # of a march that is so short: one reading may be that of a busy machine
SHOWN_SPREAD = 0.1  # of a run time: a smaller one is not told

# Forces that steps pass unseen.
MISSED_WORK = 0.05  # of a law's energies over the march: work that may be missed in a pass
SURE_WORK = 0.5  # times that: what the recommended step misses
CYCLES_BETWEEN_CHECKS = 4096  # between two checks
WORST_STEPS = 64  # steps about the worst one, by which a shorter step is found
FINER_DOUBLINGS = 16  # of the number of steps about the worst one
ELONGATIONS = 257  # of the elongations that were passed

# Exponential Rosenbrock method.
MOST_HALVED_STEPS = 28  # halvings of a step in one exponential
ROSENBROCK_NUDGE = 1.5e-8  # of a coordinate, or of 1, for one-sided differences: the root of round-off
TICKS = 16.0  # of the time's round-off, over which a load is differentiated at least
RATE_ROUND_OFF = 1e-15  # of the largest rate and acceleration so far, and of what they change in a step

# SciPy's methods.
MOST_SCIPY_STEPS, SCIPY_WINDOW = 1e8, 2000  # steps that never come to an end, by the mean of so many
FAR_OFF = 1e9  # [s]: neither an output time nor the end shortens a step, or sets the first one

# Events.
INTO_PIECE = 0.5  # of a piece: how far a step may enter it
LEAST_PART, MOST_PART = 0.05, 0.9  # of a step that went too far: what is tried next

# Co-simulation.
DAMPED_STEP = 5.0  # step times angular frequency up to which vibrations are damped, from 1 on ever more; 5.7 is stable
CO_SIMULATED = 1e-9  # Largest relative error of a co-simulation's step where nothing else is asked for.

# Loads in fixed steps.
SHARE_AHEAD = 1e-2  # of a major cycle, over which the slow motion of a mechanism with loops is followed
STEPS_IN_ACTION = 4.0  # at least, while a load acts between two times without it, and in each peak
MOST_TRIALS = 40  # of a step that resolves all loads
STEPS_AHEAD = 128  # steps for which loads are evaluated before coordinates go through them

# Trials.
FIRST_STEPS = 128  # of the exponential method over the duration
ODD = 13  # by which numbers of steps are more than doubled
MOST_DOUBLINGS = 13  # of its steps
DOUBLED_OFTEN = 16.0  # by which its error falls with twice as many steps, where all is smooth
MANY_BREAKPOINTS = 256  # breakpoints, as of a table, at each of which the exponential method would have to start anew
FEW_STEPS = 400  # stable steps of the Runge-Kutta method over the duration: not stiff
MOST_EXPLICIT = 1e8  # leapfrog steps over the duration: beyond, no explicit method comes to an end
FIRST_TOLERANCE = 0.3  # of an adaptive method, over the wanted error
FINEST_TOLERANCE = 3e-14  # of an adaptive method, as it works: one finer would be the same
FIRST_IMPLICIT_STEPS = 256  # of generalised-α over the duration, at first
IMPLICIT_STEPS_IN_ACTION = 8  # of generalised-α in the shortest load
TRIAL = 1 / 16  # part of the duration that is marched to see what a method costs
WORTH_A_TRIAL = 1000.0  # steps of the Rosenbrock method
FEWEST_EVALUATIONS = 3.0  # of generalised-α in a step
COUNTED_STEPS = 16  # steps of it, over which they are counted
IMPLICIT_SHARE = 1 / 6  # of the cost of two marches by central difference: what generalised-α may cost
WORTHWHILE = 0.8  # of a march by the Runge-Kutta method: what finer marches by central difference may cost
NEARLY = 1.25  # times as many steps: of the finer of two marches of second order
SHORTER_STEPS = 1.5  # times as many steps, where stable ones of the reference state weren't
COMPARED_TIMES = 100  # output times at which two marches are compared, at least
WORTH_A_CORE = 1.5e7  # operations of a march, beside which another thread's start is short
RESOLVED = 4.0  # radians of the highest frequency in a step of the Runge-Kutta and the exponential method
# Of longer ones, in which the fastest vibrations die away or aren't followed: the power of the step with which the
# error is believed to fall, in place of 5 and 4, and the least and the most of how far it is below the difference to a
# coarser march.
UNRESOLVED_ORDER, UNRESOLVED_LEAST, UNRESOLVED_MOST = 1.2, 0.7, 4.0

# Pairs of marches.
OF_RATES = 0.5  # weight of their error: rates hold more of the fastest vibrations, which matter less
# Evaluations of a Runge-Kutta march up to which a third one tells its error, and that one's tolerance over its own.
FEW_EVALUATIONS, THIRD_TOLERANCE = 3000, 0.1
STAYS = 0.7  # of the difference of coarser marches
# On the steps that a difference asks for; times as many steps as before.
MARGIN, FEWEST_TIMES, MOST_TIMES = 1.2, 1.5, 8.0

# On a difference that isn't met: an error that is, and the largest one that is worth asking for.
MET, LARGEST_MET = 1.5, 0.2

# Costs.
LEAP = 1.8  # radians of the highest frequency in a step of central difference, of the 2 that are stable
COST_OF_COORDINATE = 60.0  # operations of an evaluation for each coordinate, of a system that doesn't tell
OVERHEAD = 3000.0  # operations of an iteration of generalised-α beside its evaluation
COST_OF_PIECE = 1e6  # operations of a march of the exponential method between two breakpoints, before its first step
COST_OF_SAMPLE = 350.0  # operations of an output of that method, for each coordinate
# Evaluations of two marches by the Runge-Kutta method: and a stable step's.
ACCURATE_EVALUATIONS, ACCURATE_STABLE_STEP = 1000.0, 60.0
