"""``python -m fmd``: the command line without its entry point."""

import os
import sys

# Python looks for modules in the working folder first; what lies beside a scene isn't to be run.
if sys.path[:1] == [os.getcwd()] and not os.path.isfile(os.path.join(sys.path[0], "fmd", "__main__.py")):
    del sys.path[0]

from fmd.cli.start import main

main()
