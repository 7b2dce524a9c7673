"""Calls that can fail, and how each does."""

from __future__ import annotations

import errno
from pathlib import Path

import attrs

KINDS = ("open", "read", "write", "close", "rename", "sync", "mkdir", "unlink", "chmod", "mmap", "fork")
"""Kinds of calls, numbered as in ``shim.c``."""
SHORT, KILLED, KILLED_HALFWAY = 0, -1, -2
"""Stand for no error: half of a read or a write; the process is killed before a call; the same in the middle of it."""
DISK = (errno.EIO, errno.ENOSPC, errno.EINTR)
WAYS = {
    "open": (errno.EACCES, errno.EIO, errno.ENOSPC, errno.EMFILE, errno.EINTR),
    "read": (errno.EIO, errno.EINTR, SHORT),
    "write": (*DISK, SHORT),
    "close": DISK,
    "rename": (errno.EACCES, *DISK),
    "sync": DISK,
    "mkdir": (errno.EACCES, errno.ENOSPC),
    "unlink": (errno.EACCES, errno.EIO),
    "chmod": (errno.EPERM, errno.EIO),
    "mmap": (errno.ENOMEM,),
    "fork": (errno.EAGAIN, errno.ENOMEM),
}
"""Errors that each kind of call can have."""
FULL = {"write", "sync", "mkdir"}
"""Kinds of calls that fail as long as a disk is full."""


@attrs.frozen(order=True)
class Trial:
    """A call, by its number in a run without faults, and how it fails; with ``lasting`` later ones fail as well."""

    call: int
    kind: str
    name: str
    error: int
    lasting: str = ""

    @property
    def words(self) -> str:
        """The trial in one line."""
        names = {SHORT: "short", KILLED: "killed", KILLED_HALFWAY: "killed halfway"}
        how = names.get(self.error) or errno.errorcode[self.error]
        return f"call {self.call}, {self.kind} {Path(self.name).name}: {how}{self.lasting and ' and ' + self.lasting}"

    @property
    def wanted(self) -> tuple[int, int, int, int]:
        """The trial as ``faults_arm`` takes it."""
        modes = (SHORT, KILLED, KILLED_HALFWAY)
        return self.call, max(self.error, 1), modes.index(self.error) + 1 if self.error in modes else 0, self.bits

    @property
    def bits(self) -> int:
        """Kinds of later calls that fail."""
        names = {"full": FULL, "gone": set(KINDS[: KINDS.index("mmap")]), "all forks": {"fork"}}.get(
            self.lasting, set()
        )
        return sum(1 << k for k, name in enumerate(KINDS) if name in names)


def trials_of(calls: tuple[tuple[str, str], ...]) -> list[Trial]:
    """Each call with each way to fail: alone, or with all that follow, on a disk that is full or gone."""
    made = []
    for number, (kind, name) in enumerate(calls, start=1):
        made += [Trial(number, kind, name, error) for error in WAYS[kind]]
        if kind not in ("mmap", "read", "close"):
            made.append(Trial(number, kind, name, KILLED))
        if kind == "write":
            made.append(Trial(number, kind, name, KILLED_HALFWAY))
        if kind == "fork":  # where vfork fails, Python tries fork
            made.append(Trial(number, kind, name, errno.EAGAIN, "all forks"))
        if kind in FULL:
            made.append(Trial(number, kind, name, errno.ENOSPC, "full"))
        if kind not in ("mmap", "fork"):
            made.append(Trial(number, kind, name, errno.EIO, "gone"))
    return made
