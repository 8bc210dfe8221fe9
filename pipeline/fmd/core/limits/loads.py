"""Loads over time and along a way: what of them acts, jumps or bends."""

# Formulas of a way.
FARTHEST = 1e3  # metres or radians: up to there a formula's pieces are sought
NARROWER = 8.0  # times as short a range, where pieces are too many
NEAREST = 1e-2  # metres or radians: within it, a feature is weighed beside the work of the force up to there
LITTLE_WORK = 1e-8  # of force times way: less work changes nothing
SOMEWHAT_BEYOND = 1.25  # times as far: the flank of a peak is weighed beside its top
SMOOTH_REST = 0.5  # of a piece's own size: largest rest of its Taylor polynomial
TAYLOR_TERMS = 7  # of that polynomial, the last of which bounds the rest
INSET = 1e-3  # of a piece, from its ends: where it is looked at
MOST_LEVELS, MOST_PIECES = 44, 2048  # halvings of a range, and pieces of it
WIDER = 16.0  # times as much rest is allowed beside a kink, over thrice the way
GAUSS_POINTS = 32  # of each piece: exact to round-off for what is smooth in it

# Formulas of time.
QUIET = 1e-9  # of the largest value: below it nothing acts
SMALL_REST = 1e-2  # of the largest value: rest that needs no finer pieces
SMALL_KINK = 0.05  # of the largest value: change about a kink that needs none
HALVINGS = 30  # of a stretch of time in which a formula is followed
KINK_HALVINGS = 42  # of a stretch about a kink
MOST_KINKS = 512  # kinks that are followed at a time
KINK_PART = 1e-11  # of the whole time: what is left out about a kink
FIRST_PART = 0.4987  # of a piece that its first half takes: kinks at round times aren't lost between two pieces
PIECES_AT_ONCE = 8192  # pieces that are halved at a time
SHORTER = 4.0  # times as short as the pieces before: a step that suited those may miss what comes
STOPS = 64  # pieces stepped onto one by one after that

# Peaks.
LEAST_PEAK = 0.1  # of the signal's range: height of a peak that counts
LEAST_AT_START = 0.5  # of the signal's range: height of what falls or rises from the start on, to count
AROUND = 8.0  # steps: how far from its top a peak's foot is sought
DEPTH = 0.9  # of a peak's height below its top: where its width is measured
NARROW = 3.5  # steps: a wider peak is resolved, wherever the steps are
NARROWEST_PEAK = 0.9  # steps: a narrower peak falls between two samples
CARRIED = 0.2  # of a peak's impulse: largest error
MOST_PEAKS = 256  # that are looked into
MOST_STRETCHES = 64  # that are looked into between fast vibrations, those of the largest changes
WINDOWS = 16  # that are looked into among fast vibrations
WINDOW_STEPS, WINDOW_SAMPLES, MOST_SAMPLES = 64, 1024, 4096  # steps and samples of a window, and samples of all

# Motions and drives of a scene.
DRIVE_SAMPLES = 257  # times at which a drive's values are checked
PEAKS = 4  # local maxima that are looked into for a pole, which is the largest of all
POLE_HALVINGS = 40  # of the interval around a maximum
FLAT = 0.9  # part of a maximum that its surroundings have, seen from near, where the function is smooth
GROWS = 4.0  # factor by which a pole grows over the last ten halvings, and a step doesn't
JUMP, JUMP_ROUND_OFF = 1e-6, 1e-11  # relative to how much a motion and its rate change in all, and to their sizes
KINK_WIDTH = 1e-10  # of the time in which kinks are looked for: they lie within this about their times
SPANS, SHORTER_SPAN = 4, 1 / 64  # parts of the duration: kinks that are too many in the whole are followed in the first
PIECES_APART = 1e-6  # largest difference of positions and rates where pieces of a motion meet, also beside their sizes
