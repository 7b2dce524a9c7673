"""Tests for users: checks of their blocks, effects, readers and diagrams, and guards of tracking errors.

``promises`` and ``loops`` check a block, ``effect_checks``, ``reader_checks`` and ``diagram_checks`` what their names
say. ``tracking`` compares metrics of a diagram with a baseline; ``guards`` reads
what to compare from a file, and ``plugin`` makes both available in pytest.
"""

from importlib import import_module
from typing import TYPE_CHECKING, Any

from tsmblocks.common.errors import near, no_such_name

if TYPE_CHECKING:
    from tsmblocks.testing.diagram_checks import check_diagram
    from tsmblocks.testing.effect_checks import check_effect
    from tsmblocks.testing.promises import PROMISES, BrokenPromise, broken_promises, checks_for, promise
    from tsmblocks.testing.reader_checks import check_reader
    from tsmblocks.testing.suites import ChecksFailed

__all__ = [
    "PROMISES",
    "BrokenPromise",
    "ChecksFailed",
    "broken_promises",
    "check_diagram",
    "check_effect",
    "check_reader",
    "checks_for",
    "promise",
]
_HOMES = {
    "ChecksFailed": "suites",
    "check_diagram": "diagram_checks",
    "check_effect": "effect_checks",
    "check_reader": "reader_checks",
}
"""Modules of names that are not in ``promises``."""


def __getattr__(name: str) -> Any:
    if name not in __all__:
        raise no_such_name(__name__, name, near(name, __all__))
    import_module("tsmblocks.testing.loops")  # adds a promise. Not before: every run of pytest imports this package
    return getattr(import_module(f"tsmblocks.testing.{_HOMES.get(name, 'promises')}"), name)


def __dir__() -> list[str]:
    return __all__
