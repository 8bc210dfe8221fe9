"""Compiled code: how long it may get, and how it is laid out."""

# Formulas.
MOST_FACTORS = 16  # of a whole power in a formula that is written as products
FAR_ANGLE = 1e9  # angle [rad] beyond which sine and cosine need more digits of π than the short reduction has
TINY_SQUARE = 1e-300  # Pa²: the square of a von Mises stress whose root has a derivative at no stress, too

# Constants.
STRUCTURAL = (0.0, 1.0, -1.0)  # numbers that stand in code themselves: what they simplify is a mechanism's structure
DOUBLES_IN_LINE = 8  # of the processor's cache
DOUBLES_AT_ONCE = 4  # of a matrix's column or of coordinates, in loops of kernels

# Long programs.
LONG_PROGRAM = 12_000  # operations, some 70 kB of machine code: from here on, parts that are alike share it
# Effort of the code generator, 0 … 3. Of long programs, whose code has to be read anew each time, 1 takes half of the
# time that 3 does (2.1 s of 3.9 for 91,000 operations), and they run as fast (6.4 µs for 6.3).
MOST_EFFORT, LONG_EFFORT = 3, 1
MOST_IN_PART = 2500  # operations of a part: LLVM's time for a function grows faster than it does
MOST_COPIED = 32  # vector registers that a function copies to or from the parts' arrays: LLVM compares all pairs
MOST_ON_STACK = 1 << 19  # doubles between a program's parts: half of the 8 MB that a thread's stack has
STANDING = (*STRUCTURAL, 0.5)  # numbers that stand in shared code: as an exponent, 0.5 is a square root

# Kept code.
FIRST_CONSTANT = 2.0  # number that stands for the first constant; those that stand for themselves are smaller

# Products.
UNROLLED = 16  # columns up to which a matrix is multiplied without a loop, its columns in the code
MOST_GROUPED = 128  # products of whole registers up to which rows that share columns are multiplied without a loop
ACCUMULATORS = 8  # vector registers that a product sums in: enough to hide the latency of ``fma``
CHUNKS_AT_ONCE = 4  # vector registers of oscillators that go through a loop of steps together
MOST_LATE = 2  # slow accelerations whose effects on a cycle are made ready before they are known: more cost more
COLUMNS_AT_ONCE = 4  # columns of a product that are summed one after the other: others hide the latency of ``fma``
ROWS_AT_ONCE = 4  # rows, into two sums that don't wait for each other
SQUARE_SIDE = 8  # rows and columns of the square blocks of a product that is written out

# Loads in fixed steps.
MOST_TOGETHER = 16  # coordinates: beyond, products of matrices without loops compile for too long
MOST_IN_LEAP = 60_000  # bytes of code of accelerations: beyond, a step that calls it is as fast as one of its own
MOST_UNROLLED = 64  # fast coordinates: beyond, code without loops takes longer to compile than it saves
BYTES_OF_OPERATION = 6.0  # of machine code, five to eight where it is long

# Kernels.
KERNEL_LEVEL = 1  # effort of LLVM's passes, 0 … 3: 2 and 3 compile for longer, and marches take as long
ROUNDS_AT_ONCE = 4  # of unrolled loops: reversible cycles of 20 to 60 modes take 0.6 … 0.9 of the time, by 2 or 8 more
