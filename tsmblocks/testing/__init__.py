"""Checks that users' own blocks can have for the asking: the promises every block keeps."""

from tsmblocks.testing.promises import PROMISES, BrokenPromise, broken_promises, checks_for, promise

__all__ = ["PROMISES", "BrokenPromise", "broken_promises", "checks_for", "promise"]
