"""Error budgets: safety factors, shares and what is worth stating."""

# Mesh.
# Modal assurance criterion above which a shape of the other mesh is the run's own. The frequency of one that is less
# alike tells of the shapes it is mixed with, as of vectors that round-off alone sets apart, and not of the mesh.
ALIKE = 0.95
ALIKE_MODES = 0.5  # the same of modes, whose frequencies are results: less than half of it is another one
MIXED_MODE = 0.2  # of the criterion: a mode has that much of each of those that it is mixed from
MORE_COARSE_MODES = 1.5  # modes of the coarse mesh to find the run's among
SAME_FREQUENCY_OF_MESHES = 0.02  # relative: of shapes that the mesh alone keeps apart

# Comparison of runs.
COMPARED_FRAMES = 60  # at which stress is compared
COMPARED_TIMES = 2000  # at which reactions, places and accelerations are compared
HOTTEST_FRAMES = 20  # of them around the largest stress
NOTHING = 1e-8  # of the largest quantity of its unit: what solving leaves of a marker that a loop holds still
HOT = 0.5  # of the largest stress: what other nodes have doesn't matter

# Edges about which stress has no limit.
EDGE_RINGS = 2  # of triangles about an edge, within which the largest stress is the edge's
# Exponent of stress about a right angle between a rigid face and a free one, of Poisson's ratio 0.3 in plane strain:
# 1 - x with the smallest root of sin(x π/2)² = (4 (1 - ν)² - x²)/(3 - 4ν) (Williams 1952).
CLAMPED_EDGE = 0.289
OF_WEDGE = 0.5  # of a wedge's exponent: stress that grows by more with smaller elements is taken to have no limit

# Large deflection.
TOO_LARGE = 0.01  # relative error from which on a run warns of large deflection
# Pieces of a part over the root of the error that they are to divide: a chain of n bodies leaves about 1/n² of it.
PIECES_OF_ERROR = 1.25
# Error of a chain over the square, or with displacements of second order the fourth power, of the largest rotation in
# a piece: cantilevers of 3 to 16 pieces under P L²/EI = 1 to 10 have up to 0.08 and 0.3.
OF_SQUARE, OF_FOURTH = 0.08, 0.3

# Time limit.
TIMES_RUN = 3.0  # time limit over the time of the run
LEAST_SECONDS = 20.0  # of a time limit
WHOLE_SECONDS = 40.0  # of a run and its budget, if the run leaves a part of what it took itself
LEAST_PART_OF_RUN = 0.3  # of the run's time: a time limit isn't shorter
MORE_TIME = 5.0  # times the limit of an error budget that isn't whole

# Estimates.
# An estimate has the size of an error and is no bound: the stated error is this many times all estimates together.
SAFETY = 2.0
LEAST_SHOWN = 1e-5  # relative error whose figure is shown
NEAR_PEAK = 0.8  # of the largest value
MOST_OF_EIGENVALUE = 0.75  # part of an eigenvalue, or of a stiffness, that an estimate may change
HARDLY_MIXED = 1e-6  # of two shapes in one of a body of other frequencies: what solving leaves of none

# Estimators.
SHORT_SECONDS = 0.5  # seconds of a march that may be taken again with half of its step
COARSE_SHARE = 0.25  # of the time that mesh and modes took, for those of half as many elements each way
QUARTERED_SHARE = 5.0  # of that time, for four shells in place of each
ACROSS_SHARE = 2.0  # of that time, for more elements from side to side
HALVED_SHARE = 8.0  # the same where all are halved each way, as tetrahedra are
OF_TOLERANCE = 0.01  # less of an adaptive method's tolerance isn't accepted
FINER_WORK = 2.0  # work of a march that is finer in time, over the run's
FINER_TOLERANCE = 0.1  # tolerance of the finer march over the run's
# Radians of the highest frequency in a step that follows it, of which three bases had 0.8 to 1.5, and evaluations of
# a step of the Runge-Kutta method.
FOLLOWED, EVALUATIONS_A_STEP = 1.0, 12
DIE_OUT = 5.0  # radians of the highest frequency in a step of the search for a periodic start, where vibrations die out
# Part of the time limit that each of a dozen marches may take, and part of an explicit march's time from which on
# generalised-α is worth being another method.
MARCH_OF_LIMIT, WORTH_OTHER_METHOD = 0.04, 0.6
MOST_OF_METHOD = 0.1  # of a quantity by generalised-α: where more differs from the run, it is no measure of variants
COMPARED_IMPLICIT_STEPS = 4000  # of two marches that are compared, whose errors in time are alike
COMPARED_RHO = 0.95  # their spectral radius at infinite frequency: 0.8 takes 3e-4 of seed 1512's momentum, this 2e-5
MORE_IMPLICIT_STEPS = 4.0  # times as many, where a quantity vibrates too fast for these
# Change by a richer basis from which on its march is doubted, and the part of it that half of the step may change.
DOUBTED, RESOLVED_PART = 0.01, 0.3
# Time left over that of a comparison by half of the step, beneath which steps aren't halved once more: what else is
# estimated takes time, too.
WORTH_HALVING = 5.0
# Of a richer basis whose march would take too long the run's shapes are kept, as many of its lowest ones and this many
# more, unless these are nearly all of it.
LOWEST_SHAPES, LARGE_BASIS = 12, 0.7
MOST_REFINEMENTS = 4  # until a finer march differs from the run's
# Recovered stress overstates the error of static responses to forces on a face, where stress jumps, 25 times on the
# beam, and patches of elements that at edges: both count up to this many times of what the coarse mesh tells.
MOST_OF_CHANGE = 3.0

# Model.
# Shift of a vibration's eigenvalue over the square of the largest rotation: 0.02 for a cantilever's first mode, whose
# phase against a geometrically exact beam was measured over 25 periods.
OF_EIGENVALUE = 0.03
# With displacements of second order a mass at the end comes nearer as it swings, which makes the vibration slower.
# What makes up for it in truth, the bending energy of θ' = w'' / (1 − w'²)½, ¾ of 0.46 θ² of the eigenvalue at most,
# isn't in the model: five bars with and without such masses were off by 0.19 to 0.34 θ² against the elastica in
# motion.
OF_EIGENVALUE_SECOND_ORDER = 0.25
# Of what two meshes extrapolate to: the change by a rigid root falls more slowly on elements as small as the root.
OF_LIMIT = 1.5
LARGE_MESH = 30_000  # unknowns of a mesh that isn't solved anew with rigid roots
HARDLY_SHIFTED = 1e-6  # relative shift that isn't worth a march
BARE_METAL = 0.001  # damping of a part that is given none, over its critical damping
WORTH_NAMING = 1e-4  # relative error

# Stretching.
# Bending alone has up to 0.81 θ² with the largest rotation θ: 0.46 of a cantilever under a force at its end, 0.8 of
# one that bends evenly. That is an error by large rotation, which has a row of its own.
OF_BENDING = 0.85
# Rotation of a body that isn't clamped all around, below which even a plate of 1/300 of its length hardly stretches.
HARDLY_TURNED = 0.003
OF_VIBRATION = 0.75  # Of harmonic motion, whose mean stiffness is ¾ of the stiffening at its largest deflection.

# Warnings.
TOO_UNCERTAIN = 0.2  # Stated relative error beyond which a run warns of a result.

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
