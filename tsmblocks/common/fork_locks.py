"""Locks that stay usable in a child process, which a fork leaves with one thread and with the locks of all others."""

from __future__ import annotations

import os
import threading
import weakref
from collections.abc import Callable
from contextlib import AbstractContextManager


class RenewedLock:
    """A lock that is free in a child process, even if another thread of the parent held it at the fork.

    For data that every holder of the lock sets up again.
    """

    def __init__(self) -> None:
        self._lock = threading.Lock()
        _RENEWED.add(self)

    def __enter__(self) -> None:
        self._lock.acquire()

    def __exit__(self, *_: object) -> None:
        self._lock.release()

    def renew(self) -> None:
        """Replace the lock by a free one."""
        self._lock = threading.Lock()


_RENEWED: weakref.WeakSet[RenewedLock] = weakref.WeakSet()


def _renew_all() -> None:
    for lock in list(_RENEWED):
        lock.renew()


def hold_over_forks(at_rest: Callable[[], AbstractContextManager[None]]) -> None:
    """Enter a context before each fork and leave it afterwards, in both processes: the child finds consistent data."""
    entered: list[AbstractContextManager[None]] = []

    def before() -> None:
        context = at_rest()
        context.__enter__()
        entered.append(context)

    def after() -> None:
        entered.pop().__exit__(None, None, None)

    if hasattr(os, "register_at_fork"):  # where processes can fork
        os.register_at_fork(before=before, after_in_parent=after, after_in_child=after)


if hasattr(os, "register_at_fork"):
    os.register_at_fork(after_in_child=_renew_all)
