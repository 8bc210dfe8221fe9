"""Derivatives of results by numbers of a scene, and fits to measurements."""

# Derivatives by differences, extrapolated from those over two steps, the longer of which is given.
# Of a number, between whole motions, and where it changes bodies' modes: those solved anew are 1e-8 to 4e-7 off by
# round-off of slender bodies' stiffness, which put derivatives by a modulus 1e-4 off at a tenth of this.
DIFFERENCE = 2e-3
NEAR_DIFFERENCE = 2e-4  # else, between motions that a tangent moves
# Between motions that are drawn back after each part: of six loops that are sub-cycled, round-off was up to 1.4e-8 of
# derivatives at 1e-4, up to 9e-9 at this.
DRAWN_DIFFERENCE = 4e-4
# Of the change from the extrapolation over two distances to that over both doubled, for the stated error: of those
# loops, errors beyond the reference's own were up to 1.3 times this change.
BETWEEN_EXTRAPOLATIONS = 2.0
SAME_SHAPE = 0.02  # of a shape's size: what it may change by where motions are drawn back
PARTS = 200  # of a motion
TRIED_TIMES = 8  # at which loads are compared, to see if they change in proportion to a number
TRIED_MOVES = 1e-2  # of positions beside the start [m, rad or modal coordinate], at which equations are compared so
# By the adjoint of a march.
# Numbers. Of benchmarks/gradients.csv: by 32 a gradient by springs takes a little more than by tangents, one by masses
# a little less.
FEWEST_BY_ADJOINT = 32
WEIGHTS_LEFT = 1e-8  # of the sum of parts of weights, which corrections are to bring to 0
READ_DIFFERENCE = 1e-4  # of a coordinate's largest value, between motions that a result is read from
LEAST_READ_DIFFERENCE = 1e-7  # the same of a coordinate that stays near 0 [m, rad or modal coordinate, or their rates]

FEWEST_SAMPLES = 40  # scenes within tolerances, of whose results an interval of 95 % is told
JUMP = 0.05  # per cent per per cent that a largest value gains elsewhere, from which on it is said to jump

# Designs.
SAME_MODE = 0.5  # modal assurance criterion from which on a mode of another design is the same
MET = 1e-4  # relative violation of a limit that counts as none; a limit as near to its bound is active
OPTIMUM = 1e-6  # relative change of what is minimised at which a search ends
MOST_BANDS = 4  # that a result must stay out of: each doubles the number of searches
MOST_DESIGNS = 60  # steps of a search
ENDLESS = 10.0  # logarithm of how far a result without end is above its bound
KEPT_DESIGNS = 5  # of a search, beside the first: their meshes and matrices take memory
FRONT = 7  # designs of a front of two aims
SAME_AIM = 1e-3  # logarithm of the second aim's ratio between both best designs, below which there is no front
STATIONARY = 0.02  # of the aim's gradient that may be left at an optimum

# Fits to measurements.
NORMAL_95 = 1.959963984540054  # standard deviations to each side that hold 95 % of a normal distribution
DETERMINED = 0.5  # largest half-width of a 95 % interval, of the number's logarithm or relative, that a fit begins with
NOISE_ORDER = 4  # of the differences of successive values by which the noise of a channel is estimated
GAP = 5.0  # times the median distance of places in a chart's line: beyond it the line is broken
WHOLE_WINDOW = 1.5  # of the median time that such a difference takes: a longer one lies over a gap
STRONG_CORRELATION = 0.9  # from which on two numbers are named together
CLOCK_DIFFERENCE = 0.05  # of the time between two samples: a step for derivatives by shifts of clocks
AT_BOUND = 1e-4  # of the way between two bounds: a number so near to one is said to be at it
# Probability of white residuals' correlations, below which they are said not to be white. A false minimum of a bar's
# modulus, 19 % off with an interval of 1 %, had 0.0055.
WHITE = 0.01
# Probability of chi-squared, or of correlations of residuals whose noise is estimated, below which another minimum is
# looked for by parts. Of 113 fits of a vibration with noise of 2 to 200 % of its deviation, given or estimated, 16
# ended in false minima, all below 4e-10; of the others three were below 0.01, none below 0.002.
DOUBTFUL = 0.01
FIRST_PARTS = (1 / 16, 1 / 8, 1 / 4, 1 / 2)  # of histories, which are fitted one after the other then
LAGS = 10  # samples up to which correlations of residuals are looked at
POOR_FIT = 1e-3  # probability of chi-squared below which noise alone doesn't explain the residuals
SAME_CHI2 = 0.1  # difference of chi-squared of two searches that count as having come to the same numbers
UNLIKE_SIZE = 20.0  # of deviations over time, measured and of the scene at first: from which on a unit may be wrong
MOST_EVALUATIONS = 50  # of a fit
FIT_TOLERANCE = 1e-5  # of the change of chi-squared and of the numbers at which a fit ends
