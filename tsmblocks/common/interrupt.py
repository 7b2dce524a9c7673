"""Ctrl-C during a search: kept until the search stands where it can give its best so far."""

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
        """Raise KeyboardInterrupt when it was; for places where a search can stop."""
        if self.stop:
            raise KeyboardInterrupt


@contextmanager
def defer_interrupt() -> Iterator[InterruptFlag]:
    """Keep Ctrl-C for ``InterruptFlag.check``; pressed twice, it ends everything at once.

    An exception out of nowhere would surprise libraries in the middle of their work. A program that has a
    handler of its own keeps it.
    """
    asked = InterruptFlag()
    ours = threading.current_thread() is threading.main_thread()
    if not ours or signal.getsignal(signal.SIGINT) is not signal.default_int_handler:
        yield asked
        return

    def pressed(*where: Any) -> None:
        if asked.stop:
            signal.default_int_handler(*where)
        asked.stop = True

    signal.signal(signal.SIGINT, pressed)
    try:
        yield asked
    finally:
        signal.signal(signal.SIGINT, signal.default_int_handler)
