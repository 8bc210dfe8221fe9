"""Parts that are cut into pieces."""

# Cuts.
SAME_WEIGHT = 1e-2  # of the largest: sections whose weights differ by less, by distant loads, have equal ones
CONTACT = 0.01  # of the largest cut's area: pieces that touch in less aren't welded
GRID = 0.7312e-12  # of the extent: places of nodes are rounded to this, so that equal pieces are equal to the bit
MOVES = 5  # rounds in which a marker's elements, and those that come loose, move to another piece
MOST_OF_PIECE = 0.5  # of a piece's volume: a marker's face whose elements fill more isn't moved into one piece

# Comparison with the whole part.
COMPARED_FREQUENCIES = 3  # lowest frequencies that are compared
FAMILIES = 4  # times as many of the part, of which one family has some

# Number of pieces.
FEWEST_PIECES, MOST_PIECES_TRIED = 2, 128  # pieces of a part that are proposed

# Warnings.
PIECES_FREQUENCIES, PIECES_DEFLECTIONS = 0.05, 0.01  # relative errors of a part in pieces that are warned of
