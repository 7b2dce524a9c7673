"""Ctrl-C during a search, deferred until the search can return its best result so far."""

from __future__ import annotations

import signal
import threading
from collections.abc import Iterator
from contextlib import contextmanager
from typing import Any

import attrs


@attrs.define
class InterruptFlag:
    """Whether Ctrl-C was pressed."""

    stop: bool = False

    def check(self) -> None:
        """Raise KeyboardInterrupt if it was; called where a search can stop."""
        if self.stop:
            raise KeyboardInterrupt


@contextmanager
def defer_interrupt() -> Iterator[InterruptFlag]:
    """Defer Ctrl-C to ``InterruptFlag.check``; pressed twice, it ends everything at once.

    A KeyboardInterrupt at an arbitrary point could corrupt the work of libraries. A handler that a program has
    installed stays in place.
    """
    flag = InterruptFlag()
    in_main = threading.current_thread() is threading.main_thread()  # no other thread may set a handler
    if not in_main or signal.getsignal(signal.SIGINT) is not signal.default_int_handler:
        yield flag
        return

    def pressed(*details: Any) -> None:
        if flag.stop:
            signal.default_int_handler(*details)
        flag.stop = True

    signal.signal(signal.SIGINT, pressed)
    try:
        yield flag
    finally:
        signal.signal(signal.SIGINT, signal.default_int_handler)
