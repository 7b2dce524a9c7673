"""``python -m tsmblocks``."""

import sys

from tsmblocks.cli import main

sys.exit(main())
