"""``python -m tsmblocks.cli``."""

import sys

from tsmblocks.cli.entry import main

sys.exit(main())
