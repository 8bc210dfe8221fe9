"""The choice of a method of integration, and what its marches cost."""

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
RESOLVED = 4.0  # radians of the highest frequency in a step of the Runge-Kutta method

# Pairs of marches.
OF_RATES = 0.5  # weight of their error: rates hold more of the fastest vibrations, which matter less
STAYS = 0.7  # of the difference of coarser marches
# On the steps that a difference asks for; times as many steps as before.
MARGIN, FEWEST_TIMES, MOST_TIMES = 1.2, 1.5, 8.0

# Costs.
LEAP = 1.8  # radians of the highest frequency in a step of central difference, of the 2 that are stable
COST_OF_COORDINATE = 60.0  # operations of an evaluation for each coordinate, of a system that doesn't tell
OVERHEAD = 3000.0  # operations of an iteration of generalised-α beside its evaluation
COST_OF_PIECE = 1e6  # operations of a march of the exponential method between two breakpoints, before its first step
COST_OF_SAMPLE = 350.0  # operations of an output of that method, for each coordinate
# Evaluations of two marches by the Runge-Kutta method: and a stable step's.
ACCURATE_EVALUATIONS, ACCURATE_STABLE_STEP = 1000.0, 60.0
