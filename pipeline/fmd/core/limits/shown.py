"""What is shown: how much of it, and from which size on."""

# Programs that run beside.
LONGEST_MESSAGE = 160  # characters of another program's message

# Messages.
LAST_WORDS = 400  # characters at the end of another program's output
