"""``python -m fmd``: the command line without its entry point."""

from fmd.cli.app import main

main()
