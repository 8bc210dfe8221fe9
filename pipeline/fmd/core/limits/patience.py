"""Patience: seconds, tries and sizes up to which something is waited for."""

# Programs that run beside.
# For a mesh's file in a process of its own, whatever its size and for each MB of it.
READING_SECONDS, READING_SECONDS_PER_MB = 60.0, 2.0
READING_BYTES, READING_BYTES_PER_BYTE = 2 << 30, 60  # of memory, and for each byte of the file

# Eigenproblem.
LOOK_SECONDS = 0.002  # between two looks for a command
