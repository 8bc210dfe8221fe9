"""Modes and static shapes: residuals, pairs, and what counts as rigid."""

# Shapes of bodies.
ELASTIC_PART = 1e-6  # of a shape's norm: more of it may not be rigid motion
NO_STIFFNESS = 1e-14  # of the highest ω²: below it a shape has no stiffness
# Round-off in motions that no load excites grows from one generation to the next if they are softer than those that
# are; of what is excited, the first generation holds the softest but for a part of its frequency.
SOFTER = 0.5

# Craig–Bampton.
INTERFACE_DEFECT = 1e-7  # part of a unit by which constraint modes may move an interface where they shouldn't
RIGID_DEFECT = 1e-6  # part of a rigid motion that the Craig–Bampton space may miss
RIGID_REST = 1e-7  # of a shape's size: less that is left without its rigid motion is none
# Of an upper bound of the lowest elastic eigenvalue: Lanczos leaves 1e-12, an elastic mode a fiftieth or more.
ZERO_EIGENVALUE = 3e-7
MOVES_FREELY = 1e-2  # of the largest motion without stiffness beside rigid ones: a point with more is named
NAMED_AT_MOST = 3  # of such points in a message
ROBUST_FITS = 30  # of rigid motions to those without stiffness
# Of that bound: static responses take 12 to 15 solutions where a tenth of it takes 8 to 10, but with a third already
# round-off of rigid motions leaves modes of bars that joints hold, 300 times as long as deep, too large a residual.
SHIFT = 0.3
SHIFT_OF_CYCLIC = 0.002  # of a propeller's bound, which is 20 to 30 times too high: 10 to 13 solutions, 22 by 0.3
ELASTIC_FREQUENCY = 1e-6  # of the highest eigenvalue's root: frequencies below are rigid motions

# Eigenproblem.
LARGEST_RESIDUAL = 1e-6  # of a mode, over its elastic force, in the norm of the mass
LARGEST_OVERLAP = 1e-8  # largest entry of ΦᵀMΦ − 1
ROUNDED_RESIDUAL = 1e-3  # residuals beyond the limit, if round-off explains them: λ is good to 1e-6
# Lanczos stops at this residual: an eigenvalue is then good to its square, a shape to itself over the gap. It must
# stay below 1e-8, where single vectors have been seen to lose one of a pair.
LANCZOS_RESIDUAL = 1e-9
# The same of further vectors that are left out of the search for missed modes, in which they would take steps.
NEARLY_CONVERGED = 1e-6
BLOCK_RESTARTS = 100  # of the method with blocks of vectors
PASSES = 5  # in which vectors of a block become orthonormal: two, and more where they nearly depend on one another
SINGULAR = 1e-13  # of its diagonal: a smaller pivot of a factor is round-off
BASIS_BLOCKS = 6  # blocks beyond the wanted modes in a basis: with 10, two solutions less of 24
DEPENDENT = 1e-13  # of a block's vectors: what is left of them outside the basis is round-off
EVEN = 1e-4  # ratio of squares of a block's directions, from which on one product makes them orthonormal to 1e-12
LEFT = 1e-2  # part of the square of what one pass takes off, from which on what it leaves needs no other
LANCZOS_TRIES = 3  # runs of Lanczos's method, each outside the modes of those before, until no mode is missed
MOST_DENSE = 4000  # unknowns up to which all modes are computed in half a minute
DENSE_FROM = 0.25  # of as many or fewer unknowns: more Lanczos vectors take longer than all modes do
SPARE_MODES = 3  # modes of each harmonic beyond its share
SLEPC_RESIDUAL = 1e-10  # at which SLEPc's iterations stop
# Of Lanczos's method that looks for missed modes: a Ritz value converges only after some.
FEWEST_STEPS, FEWEST_BLOCKS, MOST_STEPS = 10, 4, 60
SEED = 100  # of its start: from that of a search it would miss the same, and these have 0, 1 …
TOUCHING = 1e-6  # by which a missed eigenvalue of the inverse is larger than the last mode's, over that one
EQUAL_EIGENVALUES = 1e-5  # part of the highest eigenvalue, within which another one counts as its equal

# Equivalent models.
NO_FREQUENCY = 1e-12  # of the largest ω²: a mode below it is a rigid motion, or has no stiffness
MASSLESS = 1e-12  # of the largest modal mass
OWN_FRAME = 1e-6  # of the largest shape

# Static shapes.
STATIC_RESIDUAL = 1e-6  # largest residual in the energy norm, as that of modes
ROUNDED_STATIC_RESIDUAL = 1e-4  # the same, if round-off explains it
CONVERGED_RESIDUAL = 1e-10  # in the energy norm: a further round of conjugate gradients would gain a digit or two
GRADIENT_ROUNDS = 6  # rounds of conjugate gradients, each of which gains four digits
ROUND_GAIN = 1e-4  # by which a round has to make the residual smaller
GRADIENT_STEPS = 100  # in a round: a factor of K that is nearly exact needs few
# Residuals beyond their limit count as round-off up to this many times what round-off of one product leaves. Free
# bodies were found to have twice that, thin bars that are clamped at a face ten times.
OF_ROUND_OFF = 100.0
RITZ_GENERATIONS = 4  # of static responses, each to the inertia of the one before

# Families and pairs.
SAME_FREQUENCY = 1e-6  # relative difference of frequencies that count as one
CLEAR_PARITY = 0.9  # parity of a static deflection: those of an interface askew have any
# Relative difference up to which the highest of a basis and its successor count as a pair: symmetric bodies on meshes
# that aren't quite symmetric have pairs that differ by the error of discretisation.
PAIR = 1e-3
# Of a field's energy, up to which K's round-off counts for nothing: derivatives by steps of 2e-3 are then good to 1e-8.
# Of ω², 0 to 2.5 times the machine epsilon and ``Σ K_ii φ_i²`` were measured, of bars and blocks.
ROUNDED_ENERGY = 1e-11
ROUNDED_PAIR = 1e-7  # of ω², up to which two differ by round-off alone: it leaves 1e-9 between those of a square bar

# Check before a march.
SAMPLED_TIMES = 401  # times of the motion at which loads and rates are looked at
# ∫ φ'² dx of a slender body's lowest modes is 1.2 (clamped) to 6 (hinged) times the largest φ² over its length.
SLOPES = 10.0
RINGING = 0.02  # Share of a motion that rings, where a change of frequency adds up to one of phase.
NEGLIGIBLE_TERMS = 1e-2  # Terms that change a stiffness by less than this part of the wanted error are left out.
# Error of a part that turns, over the change of its pieces' stiffness by their own inertia: 0.1 to 0.3 were measured.
OF_PIECES = 0.3
RIGID_LEAPFROGS = 1e6  # leapfrog steps of a march of rigid bodies
MOST_RADIANS = 1e6  # of its highest frequency that are followed
RIGID_IMPLICIT_STEPS = 4000  # of generalised-α beyond that
GROWTH = 3.0  # A deflection that grows by more than e³ has left what geometric stiffness describes.
CLOSED_BY_DEFORMING = 1e-6  # m or rad: a gap that bodies close by deforming, not one of round-off
SUSPECT = 0.5  # of its buckling load on a body alone: what loops or elements hold is looked at as a whole
MOMENTS = 41  # at which the stiffness of what loops or elements hold is looked at
