"""Tests for users: promises that every block keeps, and guards of tracking errors.

``promises`` checks a block. ``tracking`` compares metrics of a diagram with a baseline; ``guards`` reads what to
compare from a file, and ``plugin`` makes both available in pytest.
"""

from tsmblocks.testing import loops
from tsmblocks.testing.promises import PROMISES, BrokenPromise, broken_promises, checks_for, promise

__all__ = ["PROMISES", "BrokenPromise", "broken_promises", "checks_for", "loops", "promise"]
