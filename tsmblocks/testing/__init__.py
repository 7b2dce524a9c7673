"""Tests for users: promises that every block keeps, and guards of tracking errors.

``promises`` and ``loops`` check a block. ``tracking`` compares metrics of a diagram with a baseline; ``guards`` reads
what to compare from a file, and ``plugin`` makes both available in pytest.
"""

from importlib import import_module
from typing import TYPE_CHECKING, Any

from tsmblocks.common.errors import near

if TYPE_CHECKING:
    from tsmblocks.testing.promises import PROMISES, BrokenPromise, broken_promises, checks_for, promise

__all__ = ["PROMISES", "BrokenPromise", "broken_promises", "checks_for", "promise"]


def __getattr__(name: str) -> Any:
    if name not in __all__:
        raise AttributeError(f"tsmblocks.testing has no '{name}'.{near(name, __all__)}")
    import_module("tsmblocks.testing.loops")  # adds a promise. Not before: every run of pytest imports this package
    return getattr(import_module("tsmblocks.testing.promises"), name)


def __dir__() -> list[str]:
    return __all__
