"""The early end of a search, by Ctrl-C or at a time limit, deferred until it can return its best result so far."""

from __future__ import annotations

import math
import os
import signal
import threading
import time
from collections.abc import Iterator
from contextlib import contextmanager
from contextvars import ContextVar
from typing import Any

import attrs


class TimeLimitReached(KeyboardInterrupt):
    """The time limit of a search is over: it ends as after Ctrl-C."""


@attrs.define
class InterruptFlag:
    """Whether Ctrl-C was pressed, and the ``deadline`` [s] on the monotonic clock."""

    stop: bool = False
    deadline: float = math.inf

    @property
    def timed_out(self) -> bool:
        """Whether the time limit is over."""
        return time.monotonic() >= self.deadline

    def check(self) -> None:
        """Raise KeyboardInterrupt if it was, or TimeLimitReached; called where a search can stop."""
        if self.stop:
            raise KeyboardInterrupt
        if self.timed_out:
            raise TimeLimitReached


_CURRENT: ContextVar[InterruptFlag | None] = ContextVar("_CURRENT", default=None)
"""The flag of the innermost search."""


def checkpoint() -> None:
    """``InterruptFlag.check`` of the search that is under way, from where its flag is not at hand."""
    flag = _CURRENT.get()
    if flag is not None:
        flag.check()


@contextmanager
def defer_interrupt(time_limit: float | None = None) -> Iterator[InterruptFlag]:
    """Defer Ctrl-C to ``InterruptFlag.check``; pressed twice, it ends everything at once.

    After ``time_limit`` [s] the flag says so too. A KeyboardInterrupt at an arbitrary point could corrupt the work of
    libraries. A handler that a program has installed stays in place.
    """
    flag = InterruptFlag(deadline=math.inf if time_limit is None else time.monotonic() + time_limit)
    outer = _CURRENT.set(flag)
    in_main = threading.current_thread() is threading.main_thread()  # no other thread may set a handler
    ours = in_main and signal.getsignal(signal.SIGINT) is signal.default_int_handler

    def pressed(*details: Any) -> None:
        if flag.stop:
            signal.default_int_handler(*details)
        flag.stop = True

    if ours:
        signal.signal(signal.SIGINT, pressed)
    try:
        yield flag
    finally:
        _CURRENT.reset(outer)
        if ours:
            signal.signal(signal.SIGINT, signal.default_int_handler)


@contextmanager
def terminate_as_interrupt() -> Iterator[None]:
    """Let SIGTERM end a program as Ctrl-C does; processes that it has started end at once, as they would."""
    own, in_main = os.getpid(), threading.current_thread() is threading.main_thread()
    if not in_main or signal.getsignal(signal.SIGTERM) is not signal.SIG_DFL:
        yield
        return

    def terminated(number: int, _frame: Any) -> None:
        if os.getpid() == own:
            signal.raise_signal(signal.SIGINT)
        else:
            signal.signal(number, signal.SIG_DFL)
            signal.raise_signal(number)

    signal.signal(signal.SIGTERM, terminated)
    try:
        yield
    finally:
        signal.signal(signal.SIGTERM, signal.SIG_DFL)
