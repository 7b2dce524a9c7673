"""Atomic replacement of files: a reader finds the old file or the new one, never a part."""

from __future__ import annotations

import errno
import os
from collections.abc import Iterator, Mapping
from contextlib import contextmanager, suppress
from pathlib import Path
from typing import Any, BinaryIO

NAME_CHARACTERS = 40
"""Characters of the target's name in that of the new file. Chosen: together they stay below what systems allow."""


@contextmanager
def replacing(target: str | os.PathLike[str]) -> Iterator[BinaryIO]:
    """Open a new file beside the old one, which takes its place in one step when all is written.

    Its name is new and nobody else's, so that threads, processes and links in a shared folder cannot meet there. Of a
    link the file that it leads to is replaced; a device or a pipe is written to as it is. Raises OSError that names the
    target, which then has not changed.
    """
    real = Path(os.path.realpath(target))
    if real.exists() and not real.is_file():
        if real.is_dir():
            raise IsADirectoryError(errno.EISDIR, os.strerror(errno.EISDIR), str(target))
        with real.open("wb") as file:
            yield file
        return
    fresh = real.with_name(f".{real.name[:NAME_CHARACTERS]}.{os.urandom(8).hex()}.new")
    try:
        with fresh.open("xb") as file:
            yield file
            file.flush()
            os.fsync(file.fileno())
        if real.exists():
            fresh.chmod(real.stat().st_mode)
        fresh.replace(real)
    except OSError as error:
        if error.filename in (None, str(fresh)):  # a full disk, or the folder
            raise OSError(error.errno, error.strerror, str(target)) from None
        raise
    finally:
        with suppress(OSError):
            fresh.unlink(missing_ok=True)


def replace_file(target: str | os.PathLike[str], text: str) -> None:
    """Replace a file by a text in UTF-8. Raises OSError as ``replacing``."""
    with replacing(target) as file:
        file.write(text.encode())


def replace_figure(
    target: str | os.PathLike[str], figure: Any, *, dpi: float, metadata: Mapping[str, None] | None = None
) -> None:
    """Replace a file by a figure of matplotlib, in the format of its ending. Raises OSError as ``replacing``."""
    with replacing(target) as file:
        figure.savefig(file, format=Path(target).suffix[1:].lower() or None, dpi=dpi, metadata=metadata)
