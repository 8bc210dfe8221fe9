"""Memory: how much is computed at a time."""

# Finite elements.
# Elements at a time, fewer if they have many nodes: their matrices stay in the processor's cache.
ELEMENTS_AT_ONCE = 2048
ENHANCED_AT_ONCE = 512  # elements with enhanced strain at a time: they have more unknowns
BLOCKS_AT_ONCE = 8192  # 3 × 3 blocks at a time, so that they stay in the cache too
STRESSED_AT_ONCE = 256  # elements under stress at a time: a matrix for each of all loads
CELLS_AT_ONCE = 4096  # cells of a file at a time

# Reduction.
ENTRIES_AT_ONCE = 1200  # entries of an element's matrices under all loads at a time, in large meshes
FEW_ENTRIES = 5_000_000  # the same of a small mesh, times its nodes, of which there are as many as elements or more
SMALL_SYSTEM = 2500  # unknowns, below which SuperLU takes at most 57 ms longer warm, and cold no kernels: 0.3 s less
# Entries of 3 × 3 blocks for each nonzero of A, from which on nodes begin within blocks: 1.00 to 1.06 where they don't.
SHIFTED_BLOCKS = 1.2
MOST_COUPLED = 10.0  # times the mean of nodes' couplings: a node with more, as of a rigid face, covers no others
# Steps along a body over the nodes of each, from which on minimum degree takes 0.69 to 0.88 of dissection's operations
# (2 to 4.2); of 0.3 to 1.0 it takes 0.74 to 1.5 of them.
SLENDER = 1.5
# Zeros, for each of which a factor's front becomes part of another: a front more takes as long as a few thousand.
FRONT_ZEROS, SHARE_OF_ZEROS = 4000, 0.05
# Of a front, columns in a panel and rows in a tile, which the kernels' text has one by one; columns in a block, whole
# tiles, whose rows stay in the processor's nearest cache.
PANEL, TILE, BLOCK = 4, 8, 64
# Bytes for each nonzero of A while it is factorised: 25 to 55, by copies, and 1.9 to 5.1 were measured.
BYTES_FOR_CHOLMOD, BYTES_FOR_FRONTS = 60.0, 6.0
# Of stiffness and mass, for each pair of nodes, 9 and 3 entries with their columns, and a mesh with its places in them:
# 315 to 380 were measured, of which 192 are of the entries; of the shifted stiffness while it is factorised.
BYTES_OF_MATRICES, BYTES_OF_SHIFTED = 300.0, 144.0
# Vectors at the peak of a search for modes: of each mode, for each load that is solved for at a time, and beside these.
# Measured of 10 to 200 modes: 81 and 7.0 of each with one load at a time; with eight 0.67 (10 modes) to 0.96 of these.
VECTORS_OF_MODE, VECTORS_OF_BLOCK, VECTORS_BESIDE = 8, 30, 100
BYTES_FOR_RESPONSES = 125.0  # at the peak, for each unknown and load: 113 to 124 were measured

# Recovery.
STRAINED_AT_ONCE = 512  # elements whose strain or stress is found at a time
PLIES_AT_ONCE = 2**18  # plies of elements times output times whose stress is found at a time
DEFORMED_AT_ONCE = 64  # output times at which deformation is found at a time
STRESSED_FRAMES = 256  # output times at which stress is found at a time
HIGHEST_NODES = 32  # nodes whose largest stress says which others may have a larger one
CACHED_NUMBERS = 2**17  # numbers that fit into a core's cache
ENVELOPE_NODES, ENVELOPE_FRAMES = 64, 256  # nodes and output times at a time: 790 kB of stress
FATIGUE_NODES = 8  # nodes at a time in a thread
FATIGUE_ROUND = 8 * FATIGUE_NODES  # nodes between two looks at the bound
FATIGUE_STRETCHES = 256  # stretches of time, each with a bound of its own

# Tables of scenes.
MOST_TABLES = 1024  # whose unusual values are known to a process, the last used last
# Compiled code.
MOST_SHARED = 16  # systems kept in a process, the last used last
MOST_FORMS = 256  # quadratic forms of bodies whose sizes a process keeps, the last used last
MOST_LOADED = 256  # programs that stay loaded in a process, the last used last
# States that are evaluated together: the values of a mechanism's nodes at them stay in the processor's cache.
STATES_AT_ONCE = 1024
VALUES_AT_ONCE = 2**22  # numbers of states that are disturbed together, one state after the other
MOST_STEPS_KEPT = 2**20  # numbers of a kind that are kept of a march's steps to go back along them
MOST_BEGINS_KEPT = 2**24  # numbers of the states at which chosen steps begin, which are kept of a whole march

# Sweeps.
POINTS_AT_ONCE = 64  # points that share their work in a process: from half as many on, a point takes no less
RIGID_MOTIONS_AT_ONCE = 8  # of these, whose loads are found together: their values stay in the processor's cache
FINE_MARCHES_AT_ONCE = 16  # of these, marched again at some thousand times: two groups of lanes
FINE_VALUES_AT_ONCE = 2**24  # numbers of states at these times, of all of them together

# Results.
TIMES_AT_ONCE = 8192  # output times whose results are held at a time while they are written or compared
# Numbers kept for each output time. Measured: 1.0 kB a run with two rigid bodies, 0.7 kB with one body of five modes.
NUMBERS_OF_BODY = 60
NUMBERS_OF_COORDINATE = 4  # the same for each coordinate
FINE_RUNS = 2  # as many runs more for the times between outputs at which a tip's deflection is largest
ALWAYS_FIT = 1e8  # bytes, for which no memory is looked up

# Python.
# A short run has 180,000 objects, most of imports, that all stay; to look for garbage among them took 5 % of its
# time, and with 50,000, twice in a run, 4 %.
ALLOCATIONS = 200_000
