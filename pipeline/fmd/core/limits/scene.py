"""Scenes: how precisely and how long they may be written."""

# Formulas.
MOST_DEPTH = 16  # values that a formula holds at a time: compiled code has room for them
LONGEST_FORMULA = 500  # characters

# Values.
LONGEST_QUANTITY = 60  # characters of a number with its unit
MOST_CUT_PIECES = 1000  # of a part
MOST_SECTORS = 1000  # of a cyclic body
MOST_POINTS = 100_000  # of a sweep
RANGE_DIGITS = 9  # of a value between the ends of a range
LONGEST_SYMBOL = 3  # letters; only words have a plural
SQUARE = 1e-3  # cosine between two axes that are written with few digits
SHORTEST_DIRECTION = 1e-100  # largest component of a direction

# Tables.
CLOSES = 1e-6  # of its largest value: a table that repeats ends so close to its beginning
MOST_REPEATED_ROWS = 200_000  # of a table that repeats, up to the simulation's end
MOST_ELONGATIONS = 200  # rows of a force over elongation: it becomes compiled code
MOST_TABLE_BYTES = 50_000_000  # of a table's file
MOST_ROWS = 100_000  # of a table over time: it becomes pieces of a motion or load
FEWEST_ROWS = 2  # of a table: one has no course
MOST_SCENE_BYTES = 1_000_000  # of a scene's file: more is no scene
SCENES_KEPT = 16  # texts of scene files that stay parsed: a sweep reads one again at each of its points
FORMULAS_KEPT = 512  # formulas and units that stay parsed, for the same reason

# Scenes written for a CAD part.
MOST_MARKERS = 40  # faces that become markers, the largest
LONGEST_NAME = 40  # letters of a marker's name
WEIGHTS = 20.0  # force of the push over the part's weight as steel
LIGHT_LINK, LIGHT_RADIUS = 1e-3, 1e-2  # mass [kg] and radius of inertia [m] of a robot's moving link that has none
SKEW_INERTIA = 1e-9  # products of inertia beside the moments that are none
STOP_ANGLE, STOP_LENGTH = 0.01, 1e-3  # over which a robot's stop grows to its whole stiffness [rad or m]
STOP_LOADS = 1.0  # largest efforts of its motor that a stop bears over that way
STEEL = 7850.0  # density by which the push is chosen [kg/m³]
MOST_HELD = 0.2  # of the part's surface
SPEED = 60.0  # length of the part over the duration of the push [m/s]
