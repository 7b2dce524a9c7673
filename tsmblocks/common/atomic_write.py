"""Atomic replacement of files: a reader finds the old file or the new one, never a part."""

from __future__ import annotations

import errno
import io
import os
import re
import stat
from collections.abc import Iterator, Mapping
from contextlib import contextmanager, suppress
from functools import partial
from pathlib import Path
from typing import Any, BinaryIO

NAME_CHARACTERS = 40
"""Characters of the target's name in that of the new file. Chosen: together they stay below what systems allow."""
MAT_HEADER = b"MATLAB 5.0 MAT-file, written by tsmblocks".ljust(116)
"""The text at the beginning of a MAT file, of that length (MAT-File Format, MathWorks)."""
TIMES = {"svg": ("Date",), "pdf": ("CreationDate",)}
"""Metadata that hold the time of writing, by format, as matplotlib calls them."""
SETTLING_DRAWS = 3
"""Draws after which the panels of matplotlib's constrained layout stay where they are. Measured."""
_CLIP = re.compile(rb'(id="|url\(#)(p[0-9a-f]{10})(?=["\)])')


@contextmanager
def replacing(target: str | os.PathLike[str], *, private: bool = False) -> Iterator[BinaryIO]:
    """Open a new file beside the old one, which takes its place in one step when all is written.

    Its name is new and unique, so that threads, processes and links in a shared folder cannot conflict. Where the
    target is a link, the file that it leads to is replaced; a device or a pipe is written to directly; a file without
    write permission is not replaced. A ``private`` file, which can be made again, is readable by this user only,
    replaces a link itself, and is not synchronised to the disk. Raises OSError that names the target, which then has
    not changed.
    """
    real = Path(target) if private else Path(os.path.realpath(target))
    old = None if private else _mode(real, str(target))
    if old is not None and not stat.S_ISREG(old):
        with real.open("wb") as file:
            yield file
        return
    fresh = real.with_name(f".{real.name[:NAME_CHARACTERS]}.{os.urandom(8).hex()}.new")
    try:
        with open(fresh, "xb", opener=partial(os.open, mode=0o600 if private else 0o666)) as file:
            yield file
            if not private:
                file.flush()
                os.fsync(file.fileno())
        if old is not None and old != fresh.stat().st_mode:  # some file systems refuse what changes nothing
            fresh.chmod(stat.S_IMODE(old))
        fresh.replace(real)
    except OSError as error:
        if error.filename in (None, str(fresh)):  # a full disk, or the folder
            raise OSError(error.errno, error.strerror, str(target)) from None
        raise
    finally:
        with suppress(OSError):
            fresh.unlink(missing_ok=True)
    if not private:
        _sync_folder(real.parent)


def _mode(real: Path, target: str) -> int | None:
    """Kind and permissions of a file; None where there is none. Raises OSError for a folder and a protected file."""
    try:
        mode = real.stat().st_mode
    except FileNotFoundError:
        return None
    except OSError as error:
        raise OSError(error.errno, error.strerror, target) from None
    if stat.S_ISDIR(mode):
        raise IsADirectoryError(errno.EISDIR, os.strerror(errno.EISDIR), target)
    if not os.access(real, os.W_OK):  # the folder alone might allow it
        raise PermissionError(errno.EACCES, os.strerror(errno.EACCES), target)
    return mode


def _sync_folder(folder: Path) -> None:
    """Make a new file name survive a loss of power, where the system supports it."""
    with suppress(OSError):  # the file is in its place already
        handle = os.open(folder, os.O_RDONLY)
        try:
            os.fsync(handle)
        finally:
            os.close(handle)


def replace_file(target: str | os.PathLike[str], text: str) -> None:
    """Replace a file by a text in UTF-8. Raises OSError as ``replacing``."""
    with replacing(target) as file:
        file.write(text.encode())


def replace_mat(target: str | os.PathLike[str], variables: Mapping[str, Any], *, long_names: bool = False) -> None:
    """Replace a file by variables in MATLAB's format 5, without the time of writing. Raises as ``replacing``."""
    from scipy.io import savemat

    made = io.BytesIO()
    savemat(made, dict(variables), long_field_names=long_names)
    with replacing(target) as file:
        file.write(MAT_HEADER)
        file.write(made.getbuffer()[len(MAT_HEADER) :])


def replace_figure(
    target: str | os.PathLike[str], figure: Any, *, dpi: float, metadata: Mapping[str, None] | None = None
) -> None:
    """Replace a file by a figure of matplotlib, in the format of its ending; ``metadata`` are left out.

    By default the time of writing is left out, so that equal figures give equal files. Raises OSError as ``replacing``.
    """
    from matplotlib import rc_context

    kind = Path(target).suffix[1:].lower() or None
    without = metadata or dict.fromkeys(TIMES.get(str(kind), ()))
    with rc_context({"svg.hashsalt": "tsmblocks"}), replacing(target) as file:
        made = io.BytesIO() if kind == "svg" else file
        for _ in range(SETTLING_DRAWS if figure.get_layout_engine() else 0):
            figure.draw_without_rendering()
        figure.savefig(made, format=kind, dpi=dpi, metadata=without)
        if isinstance(made, io.BytesIO):
            file.write(_numbered_clips(made.getvalue()))


def _numbered_clips(svg: bytes) -> bytes:
    """Number the clip paths in the order in which they occur: matplotlib derives their names from memory addresses."""
    names: dict[bytes, bytes] = {}
    return _CLIP.sub(lambda one: one[1] + names.setdefault(one[2], b"clip%d" % len(names)), svg)
