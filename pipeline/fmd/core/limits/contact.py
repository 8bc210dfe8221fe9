"""Contact of flexible bodies."""

# Points.
LEAST_SHARE = 0.05  # of the largest nodal force by a constant pressure: nodes with less carry none
MOST_POINTS = 1000  # of a body: their flexibility takes 72 MB
COLUMNS_AT_ONCE = 96  # static responses that are computed together

# Residual flexibility.
LEAST_FLEXIBILITY = 1e-3  # of the whole flexibility in a direction: less is left where modes are nearly complete

# Forces.
SET_CHANGES = 200  # of the set of active points in a step, before it is given up
BLOCK_CHANGES = 30  # of these, all at once; then one after the other, which can't go round in a circle
SWEEPS = 2000  # of Gauss–Seidel in a step with friction, before they are given up
ROUNDED_PLACE = 1e-14  # of what a place is the sum of
SMALL_FORCE = 1e-10  # of the largest force: what is below counts as none, and so do gaps that it makes

# Steps.
LARGEST_STEP = 0.5  # of 2/ω with all points closed: beyond it, opening and closing feed the highest modes
CHOSEN_STEP = 0.25  # of the same, where the step is left to the program

STEPS_ABOVE = 4.0  # steps for which a body's points stay above a plane, from which on they aren't placed

# Results.
DEEP_START = 1e-6  # of the body's size: how deep it may be in the ground at the start
LOST_ENERGY = 0.01  # of the largest kinetic energy: more that contact's steps make or lose is warned of
UNSEEN_DEPTH = 0.01  # of the largest extent of the points: how much deeper nodes may go that carry no pressure
