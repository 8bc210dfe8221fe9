"""Rank: singular values, pivots and norms beside the largest, below which things depend on one another."""

# Markers.
WORST_RESULTANTS = 1e6  # condition of resultants of loads that a section transmits

# Shapes of bodies.
INDEPENDENT_MASS = 1e-9  # of the largest modal mass: less is left of shapes that depend on one another
# A static response with less than this part of its norm outside the modes adds nothing but round-off.
NEW_RESPONSE = 1e-4
# Residual vectors stand for flexibility that is small beside that of the modes: what is above round-off counts.
NEW_RESIDUAL_VECTOR = 1e-8

# Craig–Bampton.
NEW_SHAPE = 1e-6  # a shape with less than this part outside the others depends on them

# Reduced bodies.
INDEPENDENT_FUNCTIONS = 1e-14  # of the largest eigenvalue of the functions' covariance: less is round-off

# Second-order displacement.
FIELD_ROUND_OFF = 1e-10  # of the largest form, for the parts of a field
DEPENDENT_FIELD = 1e-12  # of a field's square, for what others leave of it

# Constraints.
DEPENDENT_CONSTRAINT = 1e-8  # of the largest singular value or pivot: constraints that others imply
DEPENDENT_PIVOT = 1e-9  # of the largest pivot, which is the square of a length
NO_PIVOT = 1e-14  # pivot over what free bodies would have: less moves nothing
REDUNDANT_EQUATION = 1e-10  # of the largest singular value of the scaled equations
SELF_STRESS_PART = 1e-6  # of a state's largest component: less is round-off

# Forms of a body.
# Added to a row's square [1/kg, of a rotation 1/(kg m²)], or the least that its length [the square's unit to the power
# of ½] or its length over others' counts: a row that vanishes isn't divided by, and others don't change.
NO_SQUARE = 1e-60

# Loops that close at the start.
RANK = 1e-8  # of the largest eigenvalue of the scaled constraints: less is none of their own
IDLE = 1e-7  # of what free bodies would do: a constraint that moves less holds by itself
