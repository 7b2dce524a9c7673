"""Machine code kept on disk from one process to the next, in a folder that this module makes and marks as its own.

Loading machine code executes it. So an entry counts only where its digest holds, which is made with a secret key of
this user over the name and the body of the entry: a folder that came with files of others cannot inject code. Nothing
else in the folder is read, replaced or deleted. Where there is no folder of the user, there is no cache.
"""

from __future__ import annotations

import hmac
import itertools
import os
import re
import stat
import sys
import time
from contextlib import suppress
from pathlib import Path

from tsmblocks.common.atomic_write import replacing

CACHE_BYTES = 200_000_000
"""Size of the cache [bytes] above which the oldest entries are deleted. Chosen: small beside a disk."""
WRITES_PER_PRUNE = 200
"""Files that a process writes between two checks of the size of the cache; the first check follows the first file."""
ABANDONED_AFTER = 3600.0
"""Age [s] from which an entry that was not finished is deleted. Chosen: writing one takes milliseconds."""
FOLDER = "machine-code"
"""The folder of the entries, in that of the user."""
MARK = "CACHEDIR.TAG"
"""File that marks a folder as a cache, which programs for backups know (Cache Directory Tagging Specification)."""
MARK_TEXT = b"Signature: 8a477f597d28d172789f06886806bc55\n# Machine code compiled by tsmblocks. It may be deleted.\n"
KEY_BYTES = 32
_MAGIC = b"tsmblocks machine code 2\n"
_DIGEST = "sha256"
_DIGEST_BYTES = 32
_ENTRY = re.compile(r"[0-9a-f]{64}\.o")
_UNFINISHED = re.compile(r"\.[0-9a-f]{40}(\.[0-9a-f]{16}|[0-9a-f]{24}\.o-\w+)\.new")
_WRITES = itertools.count()


def user_directory() -> Path | None:
    """Cache folder of this user; None where the user has none.

    A path that is not absolute counts as none: it would depend on the folder in which a program is started.
    """
    try:
        if sys.platform == "darwin":
            base = Path.home() / "Library" / "Caches"
        elif sys.platform == "win32":
            base = _absolute("LOCALAPPDATA") or Path.home() / "AppData" / "Local"
        else:
            base = _absolute("XDG_CACHE_HOME") or Path.home() / ".cache"
    except RuntimeError:  # neither HOME nor a user of this number
        return None
    return base / "tsmblocks" if base.is_absolute() else None


def cache_directory() -> Path | None:
    """Directory of cached machine code; None when switched off with ``TSMBLOCKS_CACHE=off``.

    ``TSMBLOCKS_CACHE`` may name another directory, in which the cache has its own folder.
    """
    if os.environ.get("TSMBLOCKS_CACHE", "") == "off":
        return None
    above = _absolute("TSMBLOCKS_CACHE") or user_directory()
    return above / FOLDER if above is not None else None


def read_code(name: str) -> bytes | None:
    """The machine code of this name; None where there is none, or none that this user's own process has written."""
    place = _usable()
    if place is None:
        return None
    folder, key = place
    data = _own_file(folder / f"{name}.o")
    if data is None or not data.startswith(_MAGIC):
        return None
    digest, body = data[len(_MAGIC) : len(_MAGIC) + _DIGEST_BYTES], data[len(_MAGIC) + _DIGEST_BYTES :]
    return body if hmac.compare_digest(digest, _digest(key, name, body)) else None


def write_code(name: str, body: bytes) -> None:
    """Keep machine code under this name, atomically, then check the size of the cache now and then.

    Where that is not possible (disk full, read-only, file in use), code is compiled each time.
    """
    place = _usable()
    if place is None:
        return
    folder, key = place
    path = folder / f"{name}.o"
    with suppress(OSError):
        _replace(path, _MAGIC + _digest(key, name, body) + body)
        if next(_WRITES) % WRITES_PER_PRUNE == 0:  # listing thousands of files takes longer than writing one
            prune(folder)


def prune(folder: Path) -> None:
    """Delete entries that were not finished, and the oldest entries above the limit; nothing else is touched."""
    entries, now = [], time.time()
    with os.scandir(folder) as found:
        for file in found:
            if not file.is_file(follow_symlinks=False):
                continue
            about = file.stat(follow_symlinks=False)
            if _ENTRY.fullmatch(file.name):
                entries.append((about.st_mtime, about.st_size, Path(file.path)))
            elif _UNFINISHED.fullmatch(file.name) and now - about.st_mtime > ABANDONED_AFTER:
                _delete(Path(file.path), 0)
    total = sum(size for _, size, _ in entries)
    for _, size, path in sorted(entries):
        if total <= CACHE_BYTES:
            return
        if _delete(path, len(_MAGIC)):
            total -= size


def _delete(path: Path, least: int) -> bool:
    """Delete a file that begins as this module begins its files, by ``least`` bytes; whether it did."""
    with suppress(OSError):  # another process may be quicker
        with path.open("rb") as file:
            start = file.read(len(_MAGIC))
        if len(start) >= least and _MAGIC.startswith(start):
            path.unlink()
            return True
    return False


# ---- places


def _absolute(variable: str) -> Path | None:
    path = Path(os.environ.get(variable, ""))
    return path if path.is_absolute() else None


def _usable() -> tuple[Path, bytes] | None:
    """The folder of the entries, made if needed, and the key; None where others could write there, or none is ours."""
    folder, user = cache_directory(), user_directory()
    if folder is None or user is None or not (_private(folder.parent) and _private(folder) and _marked(folder)):
        return None
    key = _key(user)
    return None if key is None else (folder, key)


def _private(directory: Path) -> bool:
    """Make the directory if needed; whether only this user can write to it."""
    try:
        directory.mkdir(mode=0o700, parents=True, exist_ok=True)
        info = directory.stat()
    except (OSError, ValueError):
        return False
    if sys.platform == "win32":  # a user's own folder is protected there
        return True
    return info.st_uid == os.getuid() and not stat.S_IMODE(info.st_mode) & 0o022


def _marked(folder: Path) -> bool:
    """Whether the folder is one of this module's; an empty one becomes one."""
    mark = folder / MARK
    if _own_file(mark) == MARK_TEXT:
        return True
    with suppress(OSError):
        if all(_is_ours(path.name) for path in folder.iterdir()):
            _replace(mark, MARK_TEXT)
            return True
    return False


def _is_ours(name: str) -> bool:
    return bool(_ENTRY.fullmatch(name) or _UNFINISHED.fullmatch(name) or name.lstrip(".").startswith(MARK))


def _key(user: Path) -> bytes | None:
    """The secret key of this user, made where there is none."""
    path = user / "key"
    if not _private(user):
        return None
    found = _own_file(path)
    if found is None or len(found) != KEY_BYTES:
        with suppress(OSError):
            _replace(path, os.urandom(KEY_BYTES))
        found = _own_file(path)  # where two processes make one, the last one stays
    return found if found is not None and len(found) == KEY_BYTES else None


def _own_file(path: Path) -> bytes | None:
    """The content of a file of this user that is no link; None of any other."""
    with suppress(OSError):
        about = path.stat(follow_symlinks=False)
        if stat.S_ISREG(about.st_mode) and (sys.platform == "win32" or about.st_uid == os.getuid()):
            return path.read_bytes()
    return None


def _replace(path: Path, content: bytes) -> None:
    """Write a file that only this user can read, in one step. Raises OSError, and then leaves nothing behind."""
    with replacing(path, private=True) as file:
        file.write(content)


def _digest(key: bytes, name: str, body: bytes) -> bytes:
    return hmac.digest(key, name.encode() + b"\n" + body, _DIGEST)
