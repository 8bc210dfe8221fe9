"""The command ``fmd --install-completion``: apart, since no other command needs what it loads."""

from cyclopts.completion.install import create_install_completion_command

from fmd.cli.app import app

install = create_install_completion_command(app.install_completion, True)
"""Write the shell's completions of commands and options, and the line of its start that reads them."""
