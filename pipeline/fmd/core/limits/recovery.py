"""Stress, deformation and fatigue from coordinates."""

# Large deformation.
# Error of a size, a stress or an energy over the square of the largest rotation. A cantilever under a dead load at
# its end has 0.46 for the deflection across it, 0.38 for its size and 0.27 for the moment at its root, under a moment
# 0.08 and 0; the budget states twice of it.
OF_SQUARED_ROTATION = 0.3
# Of the largest strain: a rod in tension has 1/2 for its stress; in bending, parts of opposite sign cancel.
OF_LARGEST_STRAIN = 0.25
POINTS_ON_LINE = 33  # points between a joint and a marker at which rotations are sampled
TOP_POINTS = 4  # points with the largest values of each mode at which rotation and strain are looked for
EVEN_POINTS = 200  # points beside these, spread over the body
MOST_PLACES = 2000  # elements, or nodes without elements, that are looked at, spread over the body
NEAREST_NODES = 5  # nodes that count as a node's nearest, with itself

# Error of the mesh.
# Part of the error's energy that averaged stress shows: 0.5 to 0.75 on bars and propellers of all four elements.
EFFECTIVITY = 0.6
SAMPLES_PER_TERM = 3  # points of stress for each term of the polynomial that is fitted to them
INDEPENDENT_TERM = 0.02  # of a term's norm over the points: with less outside the others it is left out

# Stress.
IN_A_ROW = 0.9  # cosine of the angle by which three elements in a row may turn
APART = 0.1  # of the larger stress
BESIDE_POINT = 0.5  # of the edge of a cube of the part's volume: stress so near a loaded point isn't the largest

# Largest values.
NEAR_LARGEST_DEFLECTION = 0.8  # of the tip's largest deflection
FINER_TIMES = 32  # times as many times there tell what is largest between two output times
MOST_FINE_TIMES = 8192  # times of a motion that tell what is largest between output times
LEAST_FINER = 2  # times as many times there in an interval
MOST_TIMES_BETWEEN = 65_536  # times there: of more intervals only every n-th one is looked into
LONG_AGAIN = 2.0  # seconds of a march with contacts that isn't made again for what lies between output times
MISSED_PEAK = 0.02  # of a largest value, between output times
TIMES_A_PERIOD = 24  # of a vibration whose cycles of stress count: they leave 0.3 % of its amplitude on average
INTERVALS_BESIDE = 2  # of outputs on both sides, since a rate at outputs may be small by chance
VIBRATION_TIMES = 65_536  # times between output times at which cycles are counted, where stress changes most

# Plies.
INSIDE_PLY = 1e-9  # of a ply's thickness: how far its faces are within, where two plies meet
INDEPENDENT_WAY = 1e-9  # of the largest square of a way to elements around one: with less across none is known
BENDS = 0.5  # least share of a shape's motion along the normal: with less it doesn't bend its shell
