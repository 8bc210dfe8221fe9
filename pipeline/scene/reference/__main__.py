"""Write the page: ``python -m pipeline.scene.reference > docs/scene.md``."""

import sys

from pipeline.scene.reference.page import write_page

if __name__ == "__main__":
    sys.stdout.write(write_page())
