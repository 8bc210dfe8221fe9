"""Files: what is read of them, and how large they may be."""

# Meshes and matrices.
DEEPEST_SETS = 50  # levels of sets that name sets
LARGEST_COORDINATE = 1e30  # of the coordinates of a mesh, in its unit: a volume is still finite
MOST_MESH_BYTES = 2_000_000_000  # of a mesh's file: more doesn't fit into the memory of most machines
SYMMETRIC = 1e-7  # largest difference from the transpose, of the largest entry
ISOTROPIC = 1e-6  # difference of masses along x, y and z
IN_LINE = 1e-6  # second moment of a marker's nodes across a line, over the sum of all: they lie in it
MOST_MATRIX_BYTES = 4_000_000_000  # of a matrix's file: more doesn't fit into the memory of most machines
MOST_MATRIX_ROWS = 10**8  # that a file may say of a sparse matrix, whose rows take 0.4 GB before an entry is read
SHOWN_OF_LINE = 40  # characters of a line of a file that a message quotes
MOST_UNKNOWNS = 10_000  # of a superelement, whose matrices are dense: 0.8 GB each
ARM_BY_DIGITS = 1e-6  # of an arm, by which coefficients of nine digits may miss it
UPRIGHT_BEAM = 1e-4  # slope against z below which Ansys lays a beam's y axis along the global one
SAME_LINE = 1e-9  # sine of the angle between the arms of a coordinate system's three points: they lie on a line

# What another program has computed for a body without elements.
UNMATCHED_FIELD = 1e-3  # part of a shape's deformation or of a load that isn't a combination of the given ones
NOT_SCALAR = 1e-4  # of a geometric stiffness: difference between directions, and force of a translation
LARGEST_CASE = 1e-2  # deformation of a load case, of the body's size: digits of K + K_G are left for K_G

# Free bodies' matrices.
RIGID_FORCE = 1e-5  # force of a rigid motion over the sum of its terms
# Stiffness of a rigid motion over that of the smoothest deformation: a frequency is off by half of it.
SUPPORT_STIFFNESS = 2e-3
FASTEST_WAVE = 100e3  # m/s as nodes tell it, which is up to five times too much; diamond has 18e3
LEAST_MOMENT = 1e-8  # of the largest moment of inertia; a wire 10,000 times as long as it is thick has 1.5e-8
RIGID_INERTIA = 1e-4  # part of a superelement's mass that may depend on the direction
FITTED_MODES = 20  # modes of a superelement that masses of points of known motion are fitted to
EVEN_MASS = 1e-3  # part of modal masses that counts as alike along x, y and z, where points tell another
LEAST_STRAIN = 1e-8  # weight of the strain of what lies between points that move as they should
SEEN_MASS = 0.25  # least part of a mode's mass that such points must have to tell its Coriolis forces
DENSEST = 30e3  # kg/m³; osmium has 22.6
DEPENDENT_SHAPES = 1e-6  # of the largest of some shapes, each of length 1

# Programs that run beside.
MOST_TAGS = 1000  # integer cell data of more values aren't numbers of parts

# Reduced bodies.
MARKER_ARM = 0.01  # of the body's size, from a marker to its nodes
MOST_NUMBERS = 10**8  # in a file for MBDyn
SAME_MASS = 1e-6  # difference of masses that two records hold, over the largest
MOST_ENTRIES = 10**7  # of a matrix in a standard input data file
SAME_INTEGRAL = 1e-4  # of the largest entry: terms that hold the same integral, in files of six digits
# Of the largest entry of Me. Less is what a file of few digits, or of seventeen, loses when terms are subtracted.
STIFFENS, LOST_BY_SUBTRACTION = 1e-6, 1e-9
LONGEST_LINE = 4096  # of the loads, which OpenFAST reads as text
MOST_COORDINATES = 10_000  # of a body in a file for OpenFAST
