"""Periodic motions: how near they close, and how exactly what disturbs them is followed."""

SEARCH_TOLERANCE = 1e-8  # of the steps of the search, over the wanted error
CLOSES = 1e-3  # last correction, over the wanted error, beside the largest value of each kind of coordinate
CORRECTIONS = 40  # of Newton's method
ADDED_UP = 1e3  # tolerances: what the steps of a period may be off by together
FOLLOWED = 0.03  # part of a gap that may be left of it by the directions in which disturbances are followed
ASTRAY = 10.0  # times the gap before: a correction that leaves more is halved
KEPT_SLOPES = 0.05  # part of the gap before: with less left, disturbances followed before go on to serve
SAME_MULTIPLIER = 1e-4  # error of a multiplier that is told
SAMPLES = 64  # of a period, for the largest values of coordinates
JUST_BEFORE = 1.0 - 1e-9  # of a period: a load that jumps at its end hasn't jumped yet
NOT_PERIODIC = 1e-6  # accelerations a period later may differ by, beside the largest along the motion
GROWS = 1e-3  # modulus of a multiplier above 1 that is neither round-off nor of a motion that nothing holds
SHOWN_MULTIPLIERS = 5  # on the terminal
