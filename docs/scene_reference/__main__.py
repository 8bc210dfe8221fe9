"""Write the page: ``python -m docs.scene_reference > docs/scene.md``."""

import sys

from docs.scene_reference.page import write_page

if __name__ == "__main__":
    sys.stdout.write(write_page())
