"""The memory that a program may take, and an error for larger data before they are made."""

from __future__ import annotations

import os
import sys
from contextlib import suppress
from pathlib import Path

from tsmblocks.common.errors import DataError

SHARE = 0.8
"""Share of the free memory that one thing may take. Chosen: the rest of the program needs some too."""
SMALL = 50_000_000
"""Bytes up to which nothing is measured. Chosen: every machine has them, and a look takes 0.1 ms."""
_GROUPS = (
    (Path("/sys/fs/cgroup/memory.max"), Path("/sys/fs/cgroup/memory.current"), Path("/sys/fs/cgroup/memory.stat")),
    (
        Path("/sys/fs/cgroup/memory/memory.limit_in_bytes"),
        Path("/sys/fs/cgroup/memory/memory.usage_in_bytes"),
        Path("/sys/fs/cgroup/memory/memory.stat"),
    ),
)
"""Limit, use and its parts of a group of processes, as containers have it: of Linux' control groups 2 and 1."""


def free_memory() -> float:
    """Bytes that this process may still take: those of the machine, of its container, of its own limit; else inf."""
    return min(_of_machine(), _of_container(), _of_process())


def refuse_too_large(size: float, what: str, hint: str = "", error: type[Exception] = DataError) -> None:
    """Raise an error when ``what`` takes more memory, ``size`` [bytes], than is free; ``hint`` suggests a remedy."""
    if size <= SMALL:
        return
    free = free_memory()
    if size > SHARE * free:
        raise error(
            f"{what} would take {size_text(size)} of memory, and {size_text(free)} are free."
            f"{f' {hint}' if hint else ''}"
        )


def size_text(size: float) -> str:
    """``7.5 GB``, ``120 MB``."""
    number, unit = (size / 1e9, "GB") if size >= 1e9 else (size / 1e6, "MB")
    return f"{float(f'{number:.3g}'):,.10g} {unit}"


def _of_machine() -> float:
    with suppress(OSError, ValueError, IndexError):
        for line in Path("/proc/meminfo").read_text(encoding="utf-8").splitlines():
            if line.startswith("MemAvailable:"):
                return 1024.0 * int(line.split()[1])
    with suppress(AttributeError, OSError, ValueError):  # where the system does not say what is free, what it has
        return float(os.sysconf("SC_PHYS_PAGES") * os.sysconf("SC_PAGE_SIZE"))
    return float("inf")


def _of_container() -> float:
    for limit, used, parts in _GROUPS:
        with suppress(OSError, ValueError):
            most, now = int(limit.read_text(encoding="utf-8")), int(used.read_text(encoding="utf-8"))
            rows = (line.split() for line in parts.read_text(encoding="utf-8").splitlines())
            cached = next((int(row[1]) for row in rows if row[0] in ("inactive_file", "total_inactive_file")), 0)
            return float(max(most - now + cached, 0))
    return float("inf")


def _of_process() -> float:
    if sys.platform == "win32":
        return float("inf")
    import resource

    most, _ = resource.getrlimit(resource.RLIMIT_AS)
    if most == resource.RLIM_INFINITY:
        return float("inf")
    with suppress(OSError, ValueError, IndexError):
        pages = int(Path("/proc/self/statm").read_text(encoding="utf-8").split()[0])
        return float(max(most - pages * os.sysconf("SC_PAGE_SIZE"), 0))
    return float(most)
