"""Limits of tables, messages and pictures: how much they show, and from which size on."""

# Programs that run beside.
LONGEST_MESSAGE = 160  # characters of another program's message

# Messages.
LAST_WORDS = 400  # characters at the end of another program's output
MOST_FAULTS = 20  # faults in a message
LONGEST_TEXT = 60  # letters of a value in an object's text
LONGEST_VALUE = 80  # characters of a value in a message
MANY_BODIES = 5  # bodies, whose names aren't listed

# Viewer.
POSES_OF_A_JOINT = 49  # positions of a joint that a slider passes, with those of the loops that follow
MOST_BENT = 0.02  # of the mechanism's reach: beyond it a pose that bends bodies is none that a hand could reach
COINCIDENT = 1e-6  # metres between markers that have one label

# Charts.
SWEPT_MODES = 6  # in the chart of a sweep
SWEPT_PANELS = 6  # in the chart of a sweep that asks for no results
ASKED_PANELS = 24  # frames in the chart of a sweep: results that are asked for, over each key
SWEPT_KEYS = 6  # side by side in the chart of a sweep
SWEPT_ROWS = 40  # in the table of a sweep in a terminal; its files have all
SAME_VALUE = 1e-6  # of a value: what varies less over a sweep is drawn as a level line
CHARTED_QUANTITIES = 24  # in the chart of a history
SEEN_ERROR = 0.003  # of what a chart's curve spans: a narrower band of stated error is hidden by the line
HARDLY_MOVES = 1e-3  # of the largest movement of a component: what moves less isn't drawn

# Warnings.
NAMED_RESULTS = 3  # results of a source that are named

# Terminal.
HELP_WIDTH, HELP_COLUMN = 100, 18  # characters of a line of help at most, and before what a command or option does
CAMPBELL_MODES = 8  # in the terminal's table; the file has all
CAMPBELL_LINES = 10  # rates in the terminal's table
CAMPBELL_CROSSINGS = 30  # critical rates in the terminal's table
TABLE_POLES = 20  # in the terminal's table; the files have all
LINE_POLES = 5  # named in a line
BRIEF = 5e-3  # seconds of a stage that the table of a run leaves out
SWEPT_JOINTS = 2  # columns of joints' positions in a sweep's table
MOST_WARNINGS = 3  # of a run; its summary and --explain have all
UNCUT = 10_000  # width of a table that is piped on, in characters

# Campbell diagram.
DRAWN_MODES = 10  # modes in the chart, the lowest; the table has all

# Co-simulation.
NUMBERS_A_LINE = 6  # of C's tables

# Files.
DIGITS = 10  # of numbers in tables
DECADES = 6  # of lives that a picture or a mesh tells apart

# Mechanism's picture.
FLAT_MOTION = 0.05  # least extent of a motion in a plane, over its largest
HARDLY_TURNS = 0.05  # rate of rotation that rounds to nothing in revolutions a minute [rad/s]
WEIGHTLESS = 1e-9  # gravity that is none [m/s²]

# Errors.
SEEN_BETTER = 0.002  # part of a value that a better one differs by, from which on that is shown in its place

BAND_OPACITY = 0.2  # of an error in a chart
LEAST_OF_BAND = 1e-3  # of a magnitude: where a band ends that would reach zero on a logarithmic axis

# Report.
REPORTED_MODES = 6  # whose shapes are shown
TICKS_OF_BAR = 5  # of a colour bar
BRIEF_PICTURES = 3  # on the page for those who decide
BRIEF_DOUBTS = 8  # sentences there about what is uncertain
REPORTED_ROWS = 12  # of a table
REPORTED_DIGITS = 5  # of a number in a table that is a file of its own

BORE_WALL = 1.4  # of a bore's radius: outside of what is drawn around it
