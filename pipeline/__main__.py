"""``python -m pipeline``: the command line without its entry point."""

from pipeline.cli.app import main

main()
