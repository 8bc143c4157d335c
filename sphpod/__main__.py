"""``python -m sphpod`` is the command ``sphpod``."""

import sys

from sphpod.command import main

sys.exit(main())
