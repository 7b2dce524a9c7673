"""The early end of a search, by Ctrl-C or at a time limit, deferred until it can return its best result so far."""

from __future__ import annotations

import math
import os
import signal
import sys
import threading
import time
from collections.abc import Iterator
from contextlib import contextmanager
from contextvars import ContextVar
from typing import Any

import attrs

RAISED_AGAIN_AFTER = 0.05
"""Time [s] after which an interrupt that was swallowed is raised again. Chosen: a destructor is over by then."""


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


_DEFERRED: list[InterruptFlag] = []
"""The flags of all searches of the main thread that defer an interrupt, the innermost last."""


def checkpoint() -> None:
    """``InterruptFlag.check`` of the search that is under way, from where its flag is not at hand.

    Every simulation of a fit calls it, so that a search ends within one.
    """
    flag = _CURRENT.get()
    if flag is not None:
        flag.check()


@contextmanager
def without_checkpoints() -> Iterator[None]:
    """Let the work inside, which makes a result of what a stopped search has found, reach its end."""
    outer = _CURRENT.set(None)
    try:
        yield
    finally:
        _CURRENT.reset(outer)


@contextmanager
def defer_interrupt(time_limit: float | None = None) -> Iterator[InterruptFlag]:
    """Defer Ctrl-C to ``InterruptFlag.check``; pressed twice, it ends everything at once.

    After ``time_limit`` [s] the flag says so too. A KeyboardInterrupt at an arbitrary point could corrupt the work of
    libraries. A handler that a program has installed stays in place.
    """
    flag = InterruptFlag(deadline=math.inf if time_limit is None else time.monotonic() + time_limit)
    outer = _CURRENT.set(flag)
    in_main = threading.current_thread() is threading.main_thread()  # no other thread may set a handler
    before: Any = signal.getsignal(signal.SIGINT)
    ours = in_main and before in (signal.default_int_handler, _raise_noted)

    def pressed(*details: Any) -> None:
        if flag.stop:
            before(*details)
        flag.stop = True

    if ours:
        signal.signal(signal.SIGINT, pressed)
    if in_main:
        _DEFERRED.append(flag)
    try:
        yield flag
    finally:
        if in_main:
            _DEFERRED.pop()
        _CURRENT.reset(outer)
        if ours:
            signal.signal(signal.SIGINT, before)


_NOTED = InterruptFlag()
"""Whether Ctrl-C was pressed since the command began."""


def _interrupt_main() -> None:
    """Send SIGINT to the main thread, which ends a system call in which it waits."""
    if hasattr(signal, "pthread_kill"):
        signal.pthread_kill(threading.main_thread().ident or 0, signal.SIGINT)
    else:
        signal.raise_signal(signal.SIGINT)


def _raise_noted(*details: Any) -> None:
    _NOTED.stop = True
    signal.default_int_handler(*details)


@contextmanager
def note_interrupts(last: bool = False) -> Iterator[InterruptFlag]:
    """Yield a flag that says whether Ctrl-C was pressed, whatever exception a library has made of KeyboardInterrupt.

    Where Python would only report it, as from a destructor, it is raised again a little later. After the ``last``
    command of a process Ctrl-C is ignored: nothing is left to do.
    """
    in_main = threading.current_thread() is threading.main_thread()
    before, hook = signal.getsignal(signal.SIGINT), sys.unraisablehook
    ours = in_main and (before is signal.default_int_handler or (last and callable(before)))

    def unraisable(what: Any) -> None:
        if isinstance(what.exc_value, KeyboardInterrupt):
            threading.Timer(RAISED_AGAIN_AFTER, _interrupt_main).start()
        else:
            hook(what)

    _NOTED.stop = False
    if ours:
        sys.unraisablehook = unraisable
        signal.signal(signal.SIGINT, _raise_noted)
    try:
        yield _NOTED
    finally:
        if ours:
            signal.signal(signal.SIGINT, signal.SIG_IGN if last else before)
            sys.unraisablehook = hook


@contextmanager
def children_ignore_interrupts() -> Iterator[None]:
    """Start processes that never see Ctrl-C: this one ends them. The calling thread does not see it meanwhile."""
    if not hasattr(signal, "pthread_sigmask"):
        yield
        return
    before = signal.pthread_sigmask(signal.SIG_BLOCK, [signal.SIGINT])
    try:
        yield
    finally:
        signal.pthread_sigmask(signal.SIG_SETMASK, before)


def end_with_parent() -> None:
    """Let this process, a worker, end with its parent, which cannot notify it when it is killed."""
    from multiprocessing import parent_process

    parent = parent_process()
    if parent is None:
        return

    def watch() -> None:
        parent.join()
        os._exit(1)

    threading.Thread(target=watch, daemon=True).start()


def _interrupt_in_background() -> None:
    """What Ctrl-C would do in a process that ignores it, as those do that a script has started with &."""
    _NOTED.stop = True
    if not _DEFERRED or _DEFERRED[-1].stop:
        raise KeyboardInterrupt
    _DEFERRED[-1].stop = True


@contextmanager
def terminate_as_interrupt() -> Iterator[None]:
    """Let SIGTERM end a program as Ctrl-C does; processes that it has started end at once, as they would."""
    own, in_main = os.getpid(), threading.current_thread() is threading.main_thread()
    if not in_main or signal.getsignal(signal.SIGTERM) is not signal.SIG_DFL:
        yield
        return

    def terminated(number: int, _frame: Any) -> None:
        if os.getpid() == own and signal.getsignal(signal.SIGINT) is signal.SIG_IGN:
            _interrupt_in_background()
        elif os.getpid() == own:
            signal.raise_signal(signal.SIGINT)
        else:
            signal.signal(number, signal.SIG_DFL)
            signal.raise_signal(number)

    signal.signal(signal.SIGTERM, terminated)
    try:
        yield
    finally:
        signal.signal(signal.SIGTERM, signal.SIG_DFL)
