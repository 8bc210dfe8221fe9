"""Meshes: what is accepted, mended and found in them."""

# Elements.
NEARLY_INCOMPRESSIBLE = 0.49  # Poisson's ratio above which the volume strains are added

# Repair.
COINCIDENT_NODES = 1e-5  # distance over the shortest edge
BENT_EDGE = 0.3  # distance of a mid-edge node from its edge's middle over the edge's length
MAJORITY = 0.9  # share of the elements that have to agree on another order of nodes
STRAIGHTENING_ROUNDS = 5  # rounds in which bent edges of inverted elements are straightened

# Markers.
OUTSIDE = 1e-3  # of the body's extent: CAD's curved faces and a mesh's differ by less
STRAIGHT_EDGE = 1e-6  # smallest over largest second moment of an edge that has no width

# Extent of a clamped face over the body's reach from it, from which on it is rigid by default: averaged, frequencies of
# stubs and plates are far off, those of slender bars hardly (benchmarks/clamps.csv, docs/modelling.md), and rigid,
# stress at the face's edge has no limit.
BROAD_CLAMP = 0.25

# Selection.
FACE_IN_PLANE = 1e-5  # distance of a face's nodes from a plane, of the body's extent
NODES_ON_EDGE = 1e-6  # distance of nodes from an edge, of the body's extent
SHARP_ANGLE = 40.0  # between the normals of two facets, from which on their edge ends a face [degrees]
REENTRANT_ANGLE = 50.0  # the same, from which on a re-entrant edge is no fillet, of two elements or more [degrees]
NEAREST_ELEMENTS = 24  # elements to search for a point

# Partition into pieces.
DIFFUSION_SHIFT = 1e-3  # of the second eigenvalue's size: diffusion itself is singular
CUT_WINDOW = 0.4  # of a piece's volume: how far a cut may be from an even division to find a gap between two elements
WIDE_GAP = 0.2  # of the widest gap: less is no gap between layers
DIVISIONS = 8  # divisions that METIS tries; that with the smallest cuts is taken
UNBALANCED = 400  # thousandths by which a piece of METIS may exceed the mean
FINEST_WEIGHT = 10_000  # weights of METIS are whole multiples of the largest over this
FRAGMENT = 0.02  # of a piece's volume: loose elements up to this much move to the piece beside them

# Sectors.
SAME_PLACE = 1e-6  # distance of nodes that coincide when turned, of the body's extent
SAME_CUT = 1e-5  # the same of the two cuts of a sector in a file, which has fewer digits, of the sector's extent

# Shapes.
CAD_ELEMENTS = 4000  # of a mesh whose size nobody gave; around bores and fillets there are more
CAD_DIGITS = 2  # of the size of elements that nobody gave

# Links.
DEEPEST_LINKS = 20  # links that hang on links
ON_A_LINE = 1e-9  # smallest over largest second moment of nodes that lie on a line
RIGID_RESIDUAL = 1e-6  # of an equation's coefficients, in rotations times the body's extent: digits of a deck
IDLE_TURN = 1e-10  # stiffness and inertia of a node's rotation over the largest about its axes, that resist nothing
IDLE = 1e-10  # square of a link's displacements over the largest, by motions in which the nodes tied to it stand still

# Ties.
TIE_WITHIN = 0.1  # how far apart two facets may be, of the square root of one's area: a polygon's from its circle
TIE_COVERED = 0.05  # share of a facet that has others before it, from which on its nodes follow these
TIE_FACING = 0.5  # cosine of the angle between two facets' normals from which on they face each other
TIE_SHARE = 3 / 8  # of a mid-edge node's function that each corner beside it takes: no function is below zero then
TIE_WHOLE = 0.99  # share of an edge from which on all of it is tied: corners may lie beside
TIE_PAIRS_AT_ONCE = 1000  # pairs of facets
TIE_PLACES = 3  # of Gauss's rule along a shell's edge, which integrates products of linear and linked functions

# Shells.
MOST_HALVINGS = 4  # of a file's shells, each of which makes four times as many
INNER_TYING = 1e-4  # distance of MITC3+'s inner tying points from the centroid, as published
SHELL_FOLD = 30.0  # between the normals of two elements, from which on a shell has a fold on their edge [degrees]
ALIKE_DIRECTORS = 1e-3  # second over first moment of a node's directors, below which they are one line
DIRECTION_ALONG_NORMAL = 0.05  # sine of the angle between layers' direction and the normal: less is none in the shell

# Beams.
FULLEST_TUBE = 0.8  # area of a tube that stands for a section's numbers, of the rectangle with its radii of inertia
MOST_TUBES = 20  # for one section; one that needs more is a rod without stiffness in bending
STIFF_IN_SHEAR = 1e6  # of the area, which resists shear where a section by its numbers has none of it
ROUND_CORNERS = 24  # of the polygon of its area that a circle is drawn as, a multiple of 4; they are 0.6 % too far out

# Cuts.
SAME_WEIGHT = 1e-2  # of the largest: sections whose weights differ by less, by distant loads, have equal ones
TRACTION_MODES = 12  # of a part whose tractions weight the warping of its cuts, by six motions each
NEW_TRACTION = 1e-4  # what others don't have of a mode's tractions, over the largest mode's: less isn't independent
CONTACT = 0.01  # of the largest cut's area: pieces that touch in less aren't welded
GRID = 0.7312e-12  # of the extent: places of nodes are rounded to this, so that equal pieces are equal to the bit
MOVES = 5  # rounds in which a marker's elements, and those that come loose, move to another piece
MOST_OF_PIECE = 0.5  # of a piece's volume: a marker's face whose elements fill more isn't moved into one piece

# Comparison with the whole part.
COMPARED_FREQUENCIES = 3  # lowest frequencies that are compared
FAMILIES = 4  # times as many of the part, of which one family has some

# Number of pieces.
FEWEST_PIECES, MOST_PIECES_TRIED = 2, 128  # pieces of a part that are proposed

SEAM_PLACES = 6  # of Gauss's rule across a shell's thickness, and each way across a beam's section, that follow solids

# Warnings.
PIECES_FREQUENCIES, PIECES_DEFLECTIONS = 0.05, 0.01  # relative errors of a part in pieces that are warned of
