"""The command line ``fmd``: one module a command, each with its own printing."""
