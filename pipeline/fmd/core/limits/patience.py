"""Patience: seconds, tries and sizes up to which something is waited for."""

# Programs that run beside.
# For a mesh's file in a process of its own, whatever its size and for each MB of it.
READING_SECONDS, READING_SECONDS_PER_MB = 60.0, 2.0
READING_BYTES, READING_BYTES_PER_BYTE = 2 << 30, 60  # of memory, and for each byte of the file
VISUAL_SECONDS = 300  # until a file that is only shown is read
COMPILING_SECONDS = 600.0  # for one binary

# Eigenproblem.
LOOK_SECONDS = 0.002  # between two looks for a command

# Files.
ABANDONED_SECONDS = 3600.0  # seconds; no file takes as long to be written

# Progress.
SHOW_AFTER_SECONDS = 1.0  # before progress is shown at all
SAY_AFTER_SECONDS = 10.0  # between two lines about tasks where there is no terminal
SOLVING = 0.8  # part of the time of stiffening that its static responses take: 0.76 and 0.8 of two solids
OF_TWO_MESHES = 0.7  # part of the time of errors by another mesh that its modes and more modes take
OF_MORE_MODES = 0.25  # part of that which the latter take, whose factor is there: of a rotor of 49,000 unknowns
WITH_RATES = 0.9  # part of the time of a rotor's errors after which only its rates are left
JUDGED_AFTER = 0.5  # seconds of a march from which on its progress forecasts the rest

# Clusters.
ANSWERS_WITHIN = 10  # seconds until a cluster answers
WORKS_WITHIN = 60  # seconds until it works; it may start its workers when there is work
POINT_TRIES = 2  # of a point of a sweep whose process ends
ROUNDS_OF_POINTS = 4  # in which each process gets points of a sweep, so that none is idle at the end

# Shapes.
CAD_SECONDS = 1800  # until a CAD file is meshed
CAD_SECONDS_PER_ELEMENT = 0.01  # for each expected element, beside those for reading a file; Gmsh takes a tenth of it

# Work and precision.
MARCH_SECONDS = 2.0  # a march longer than this ends its method's range

# Sources.
SETTLED_NS = 2_000_000_000  # since a file was last written [ns]: less may be within a tick of its clock
