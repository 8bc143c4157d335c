"""``python -m sphpod`` is the command ``sphpod``."""

import sys

from sphpod.command import main

if __name__ == "__main__":
    sys.exit(main())
