"""``python -m fmd``: the command line without its entry point."""

from fmd.cli.start import main

main()
