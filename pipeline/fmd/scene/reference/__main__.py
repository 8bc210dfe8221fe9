"""Write the page: ``python -m fmd.scene.reference > docs/scene.md``."""

import sys

from fmd.scene.reference.page import write_page

if __name__ == "__main__":
    sys.stdout.write(write_page())
