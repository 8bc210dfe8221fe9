"""Scenes: how precisely and how long they may be written, and which sizes are possible or usual."""

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
LIGHT_SHARE = 1e-6  # of the mass and inertia of a robot's body: what stands between two joints that it has
NAMED_SHAPES = 6  # of a robot's that pictures leave out, at most
SKEW_INERTIA = 1e-9  # products of inertia beside the moments that are none
STOP_ANGLE, STOP_LENGTH = 0.01, 1e-3  # over which a robot's stop grows to its whole stiffness [rad or m]
STOP_LOADS = 1.0  # largest efforts of its motor that a stop bears over that way
STEEL = 7850.0  # density by which the push is chosen, and of an assembly's parts [kg/m³]
COAXIAL = 1e-3  # of an assembly's round faces: angle between axes [rad], their distance and the gap of bores by radius
BORE_CLEARANCE = 0.1  # of a bore's radius: by how much a pin in it may be thinner
MOST_HELD = 0.2  # of the part's surface
SPEED = 60.0  # length of the part over the duration of the push [m/s]

# Possible and usual sizes.
POSSIBLE = {
    "length": (1e-12, 1e12),
    "stress": (1e-9, 1e18),
    "density": (1e-9, 1e8),  # a stub that stands for a machine's mass may have 1e7
    "time": (1e-18, 1e12),
    "frequency": (1e-12, 1e18),
    "mass": (1e-30, 1e18),
    "speed": (1e-30, 299_792_458.0),
}
"""Least size but 0 and greatest size of quantities by their kind, in SI units: between atoms and planets."""

ANY_SIZE = (1e-60, 1e60)  # of a quantity of any other kind, and of plain numbers: squares and cubes stay numbers

USUAL_OF_BODIES = {
    "E": (1e5, 1.3e12, "Pa", "rubber has about 1e6, steel 2.1e11, diamond 1.1e12"),
    "nu": (0.0, 0.495, "", "metals have about 0.3; of rubber nearly no volume change is left"),
    "rho": (10.0, 23_000.0, "kg/m^3", "foam has about 30, water 1000, steel 7850, osmium 22590"),
    "mass": (1e-9, 1e8, "kg", "a grain of sand has 1e-6, a ship 1e8"),
    "length": (1e-6, 1e4, "m", "a wind turbine's blade has 100"),
    "depth": (1e-7, 1e3, "m", "a sheet of paper has 1e-4"),
    "width": (1e-7, 1e3, "m", "a sheet of paper has 1e-4"),
    "diameter": (1e-6, 1e3, "m", "a wind turbine has 200"),
}
"""Usual values of keys of bodies: least, greatest, unit and examples."""

USUAL_OF_FILES = (
    ("the diagonal of its box", 1e-5, 1e3, "m", "a wind turbine's blade has 100"),
    ("its lowest frequency", 1e-2, 1e9, "Hz", "a wind turbine's blade has 0.5, a cantilever of a microscope 1e5"),
)
"""Usual sizes of bodies from files: what, least, greatest, unit and examples."""

USUAL_OF_MOTION = {
    "angular rate": (2e4, "rad/s", "a turbocharger has 2e4, about 190 000 rpm"),
    "speed": (3e3, "m/s", "a rifle's bullet has 1e3"),
}
"""Greatest usual rates by the kind of quantity: size, unit and example."""

PRESSED = 10.0  # widths beyond a stop, from which on a start there is unusual
POOR_QUALITY = 0.05  # least scaled Jacobian of a usable mesh: thinner elements are stiff and their stress is wrong
LUMPING_COUNTS = 1e-3  # relative change of a frequency by lumped masses, from which on a run warns of it
# Half wave of a mode over the thickness of its layers, below which a run warns: from there to 3 thicknesses (a square
# plate's a/h of 10 to 4) deflections by one mean shear grow from 1 to 8 % too large.
THICK_LAYERS = 7.0
MIDSURFACE_COUNTS = 0.01  # share of a solid's volume by which its midsurface is off, from which on a run warns of it
LOST_FACES = 8  # of a solid that its midsurface leaves out: names in a message
