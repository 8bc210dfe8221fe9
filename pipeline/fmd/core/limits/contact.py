"""Contact of flexible bodies."""

# Points.
LEAST_SHARE = 0.05  # of the largest nodal force by a constant pressure: nodes with less carry none
OTHER_FACETS = 0.03  # of a face's area: difference of its nodal forces' sum from that of facets of one kind
MOST_POINTS = 1000  # that are followed at once, all of a body with no more: their flexibility takes 72 MB
MOST_OF_FACES = 20_000  # points of a body, each of which takes three static responses before the march
CONJUGATE_ROUNDS = 500  # of gradients for forces that hold all of more points than that
HELD_RESIDUAL = 1e-7  # of the work of these forces: what is left of their displacement
COLUMNS_KEPT = 256 * 2**20  # bytes of columns of points that touched once, from which on the oldest are left out
COLUMNS_AT_ONCE = 96  # static responses that are computed together

# Residual flexibility.
LEAST_FLEXIBILITY = 1e-3  # of the whole flexibility in a direction: less is left where modes are nearly complete

FORCES_RESOLVED = 1e-5  # of the largest singular value of forces over time: smaller parts have no stress of their own

# Forces.
SET_CHANGES = 200  # of the set of active points in a step, before it is given up
BLOCK_CHANGES = 30  # of these, all at once; then one after the other, which can't go round in a circle
SWEEPS = 2000  # of Gauss–Seidel in a step with friction, before they are given up
SWEEPS_PER_POINT = 0.25  # with the same points, after which their stiffness is found: it costs as much
LATE_SWEEPS = 200  # in a step, after which Newton's method is tried whatever it costs
SLOW_ROUND = 0.3  # of a round's change: a round with factors of an earlier one that leaves more has them made anew
MOST_CORRECTED = 0.5  # of a step by the same factors: what earlier ones may tell that is left of it
NEWTON_ROUNDS = 20  # of that method; it takes 1 to 10
TRIED_RATE = 4.0  # times a point's flexibility with all others held: by more, states of tall columns go in circles
KNOWN_RESPONSES = 48  # of held points that are kept: a plane's need 13 and one for each mode
ROUNDED_PLACE = 1e-14  # of what a place is the sum of
SAME_STEP = 1e-6  # of the damping's time after a step: the step's own forces are meant
SMALL_FORCE = 1e-10  # of the largest force: what is below counts as none, and so do gaps that it makes

# Steps.
LARGEST_STEP = 0.5  # of 2/ω with all points closed: beyond it, opening and closing feed the highest modes
CHOSEN_STEP = 0.25  # of the same, where the step is left to the program
HALVED_STEPS = 4  # times that a step left to the program is halved where contact makes or loses energy

CYCLES_ABOVE = 4.0  # of sub-cycling: with gaps that frames don't close in as many, nothing touches in the next one
STEPS_ABOVE = 4.0  # steps for which points stay above a plane or a rigid surface, from which on they aren't placed

LINEAR_TIMES = 8  # times at which all but contact has to be linear where steps keep its energy
EXACT_ROUNDS = 60  # of Newton's method for the forces over a step that keep the energy
EXACTLY_KEPT = 1e-11  # of the energy: what such a step may make or lose by round-off of places
FORCES_KNOWN = 1e-6  # of these forces: a change that no longer shrinks is their round-off, about a turn of the way
EVEN_SHARE = 3e-5  # of the works at a step's begin and end: where these differ by less, both count half
# Of a step, and of the time between looks: how near to its end or begin surfaces come to touch, or leave, where one
# ends there.
CHANGE_KNOWN = 1e-6
ROUNDED_FORCE = 1e3  # times the round-off of accelerations, relative: forces follow from small differences of places
MOST_CUTS = 6  # of a step, until it ends there
LONGER_AFTER_CUT = 1e3  # times such a step: the next one at most, as a rough trial may cut far before any touch

# Errors.
LOOSER = 10.0  # times a tolerance: of the march that tells the error of contacts by steps that keep it
STEPS_OF_SHOCK = 3.0  # whose tolerances an impulse may have as its error at least
SHORTER = 0.7  # of the longest step: in that march, so that steps which the tolerance doesn't limit differ, too
MORE_MODES = 2.0  # times the modes: of the run that tells what is left out of a contact's figures
FEWER_POINTS = 0.5  # of a grid's points: of the run that tells the grid's error

# Results.
DEEP_START = 1e-6  # of the body's size: how deep it may be in the ground at the start
ROUNDED_START = 1e-6  # of the largest force: less at the start is of an interference that is the round-off of places
LOST_ENERGY = 0.01  # of kinetic energy, contact's or its heat: more that contact's steps make or lose is warned of
MADE_ENERGY = 0.005  # of the same: more that they make, beside which the energy of the rest swings by some 0.3 %
ASLANT = 0.5  # [rad]: how far a picture of a face's pressure is taken beside its normal, and above it
FEW_ON_MESH = 12  # points of a curved face that are pressed: fewer tell the force to less than 2 %
FEW_POINTS = 32  # of a grid that are pressed: fewer tell the largest pressure to less than 2 %
UNFELT = 0.05  # of a contact's own deflection, or a spring's stretch: more that gaps, or it, don't feel is warned of
UNSEEN_DEPTH = 0.01  # of points' largest extent, a radius, a box's least extent: how deep what feels no force may go
FACE_ALIKE = 0.5  # cosine between normals of two faces where these are nearest, from which on one is inside out
RIGID_BESIDE = 10.0  # times the E of a face of elements: what is stiffer takes less than a tenth of the deflection
BETWEEN_NODES = 0.2  # of a radius: elements between whose nodes a ball goes deeper by less of its radius than that
PLACES_ON_SURFACE = 4.0  # to a rigid surface's radius, or a box's least extent: where depths are looked for
PLACES_ON_SIDE = 8, 100  # of a triangle: least and most of these places
BETWEEN_OUTPUTS = 0.01  # of the largest force or pressure: more that is between output times makes instants there
SHOCK_TIMES = 1000  # instants between output times, spread over where contacts press most there
DEPTH_FRAMES = 120  # output times at which depths between nodes are looked for

# Contact of two bodies.
SHARP_EDGE = 30.0  # [degrees]: corners of triangles whose normals differ by more are looked for on the other face
RIDGE_BEGIN = 0.01  # of a triangle's height: a place by a side that is nearer than that is on the side
RIDGE_END = 0.05  # of the same: from here on the triangle's own normal holds
LEAST_RIDGE = 1e-3  # [rad]: half the angle between triangles, below which they count as flat
EDGE_SOFTNESS = 1.0  # of the own flexibility of a point on an edge: more for such a contact, beside the face's points
BEYOND_RIM = 0.02  # of a triangle's size: how far beyond a face's rim a point still touches it
FACING = 0.2  # cosine of the angle between outward normals, above which surfaces don't face each other
DEEP_ENTRY = 0.1  # of a triangle's size: how deep a point may be in a body where it is first seen there
NEAR_TRIANGLES = 32  # that are kept for a point
NEAR_RADIUS = 1.5  # of the largest triangle: distance up to which triangles are kept
MOVED_PART = 0.5  # of that distance: when surfaces have moved on by it, triangles near points are found again
SMALLEST_RADIUS = 1e-3  # of the same, down to which it is shortened where a point has too many triangles
WIDER_BAND = 2.0  # times the largest displacement by the forces: gaps that are kept among those that may close
BANDS = 20  # times that the points that may close are chosen again in a step before it is given up
TURNED_BLOCKS = 1e-3  # change of rotations and weights from which on flexibilities between points are found again
STIFF_BELOW = 1e-4  # share of a point's flexibility below which what it goes over may give way anywhere alike
TURNED_NORMALS = 1e-4  # change of normals from which on those along normals are

# Tangents.
WAY_BESIDE = 1e-6  # [m]: how far places and rotations go to either side along a tangent
NUMBERS_BESIDE = 1e-4  # of numbers: how far they go to either side
TOO_LITTLE_BESIDE = 1e-12  # [m]: of a tangent that moves no point, as if it moved them by this

# Near field on a half-space.
FIT_ROUNDS = 20  # of Newton's method for the lowest place of a surface
ONE_QUADRIC = 1e-7  # of the largest singular value: a second one below means that a face is on many quadrics
OFF_SURFACE = 1e-4  # of a face's size: nodes farther from a quadric are on none
LEAST_CURVED = 1e-3  # of a face's size over its radius: less counts as flat
LINE_CONTACT = 1e-3  # of the largest curvature: with less across a face touches along a line
APART = 2.5  # distances of points, from which on the mesh tells their flexibility
RING = 5.0  # distances of points, up to which it tells what is left at the contact
SMOOTHED = 1.5  # distances of points, over which modes and flexibility are smoothed
AROUND = 3.0  # distances of points, within which those are that a face has around a place
ONE_BALL = 0.02  # of a radius: differences of curvatures, and of the centre of mass from theirs, of what rolls
GRID_LAG = 0.75  # of a rectangle: how far a lowest place may be from the middle of a grid that follows it
GRID_MARGIN = 1.45  # of a contact's expected width: what its grid has, which may lag by a rectangle
RESOLVED_BY_MESH = 2.5  # distances of points: grids wider than twice that leave the near field to the mesh
DEEPEST = 0.75  # of a contact's width: depth down to which the largest stress is looked for
DEPTHS_BELOW = 30  # depths at which it is
COLUMNS_BELOW = 16  # rectangles below which it is
CARRYING = 0.05  # of a grid point's force on a node: nodes with more have a stress that elements don't show
UNSEEN_WEIGHT = 1e-6  # of a node: one with less everywhere is left out

# Gears.
GEAR_FORCES_SETTLE = 1e-10  # of the load: change of the forces on pairs of teeth, below which they have settled
GEAR_PASSES = 100  # in which they have to
COARSER_GEARS = 1.5  # elements each way over those that the error by the mesh is found with
ROLL_PASSES = 100  # of Newton's method for the roll angle without backlash
ROUNDED_ROLL = 1e-12  # of this angle: a correction that is its round-off
OVERLOAD = 4.0  # times the torque that is given: up to which forces between teeth in motion are tabulated
APPROACHES = 24  # at which they are
USUAL_MESH_STIFFNESS = 1.5e10  # [N/m²]: of steel gears over their width, from which the search of the largest begins
PLACES_OF_PITCH = 128  # within a pitch, at which they are
LEFT_OUT_FORCE = 2e-4  # of the largest force: what products of curves of approach and place may leave out of the table
HARDLY_PRESSED = 1e-6  # of the largest approach in that table: teeth that are pressed by less count as apart
LARGE_TABLE_ERROR = 0.02  # of the load: error of a table of forces between teeth that is warned of
LIGHT_TEETH = 0.02  # of a gear's inertia: what teeth that aren't meshed would add is warned of from here on
SKEWED_GEARS = 1e-6  # of the distance of axes: gears whose middles are farther apart along these don't mesh
JAMMED = 1e-9  # of the distance of axes without backlash: less by more jams the teeth

# Rigid bodies.
PARALLEL_EDGES = 1e-4  # square of the sine of the angle between edges of boxes, below which they don't cross
BESIDE_EDGE = 0.2  # sine of the angle by which a normal may leave the faces beside an edge: of faces on one another
CROSSING_EDGES = 8  # of two boxes that are expected to touch at once
USUAL_ROUNDING = 0.05  # of the least extent of a box: radius of its edges and corners where none is given
LEAST_RESTITUTION = 0.05  # below it a damper of a shock would be stiffer than the surface
PRIMITIVE_DEPTH = 1e-5  # of a radius: how deep a surface is pressed at least in what steps are chosen by
SHOCK_STEPS = 0.25  # of the step that is chosen elsewhere: forces of round surfaces rise as a power of the depth
SAME_TIME = 1e-12  # of a time: a state that is no later than the last step by more has its forces
LAW_ROWS = 24  # depths at which the force of a pin is computed
LAW_STRIPS = 100  # strips that its contact is divided into
WIDEST_ANGLE = 0.7853981633974483  # [rad]: half of a pin's contact in a bore, up to which a half-space tells it
LEAST_ANGLE = 1e-4  # [rad]: the same at the first of these depths
ROUND_ENOUGH = 1e-5  # difference of curvatures, of the larger one, that counts as none
FLATTEST = 1e-12  # (b/a)² of an elliptic contact
SOFTEST_DENT = 10.0  # of the expected flexibility: more that a round surface has at rest, hardly pressed, is left out
