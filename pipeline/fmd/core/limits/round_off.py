"""Round-off: what is nothing beside the largest of its kind, by how it was computed."""

EXACT = 1e-14  # of what a few operations give: coordinates, products, differences of read numbers
SUMMED = 1e-12  # of sums of many terms: products of matrices, integrals, turns of axes
SOLVED = 1e-9  # of what equations or eigenproblems were solved for, and of places of nodes in meshes
ENLARGED = 2.0**40  # times multipliers that move positions: forces as large as those of accelerations, or larger
