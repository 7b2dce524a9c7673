"""Blocks and effects of one's own: Python files that are run before anything else a command does."""

from __future__ import annotations

import argparse
import contextlib
import importlib
import importlib.util
import sys
import traceback
from collections.abc import Iterable
from pathlib import Path

from tsmblocks.cli.common import UsageError
from tsmblocks.cli.console import note
from tsmblocks.common.errors import TsmError


def own_argument(parser: argparse.ArgumentParser) -> None:
    """Declare --with."""
    parser.add_argument(
        "--with",
        dest="own",
        metavar="FILE",
        action="append",
        default=[],
        help="a Python file to run first: blocks and effects that it defines are known; may be given again",
    )


def bring(paths: Iterable[str]) -> None:
    """Import each file under its name, as ``import`` would, so that worker processes find it too.

    What they print goes beside the answers of the command, which another program may read.
    Raises UsageError for what is no Python file, has a name that is taken, or ends with an error.
    """
    for path in map(Path, paths):
        _look_at(path)
        known = getattr(sys.modules.get(path.stem), "__file__", None)
        if known is None or Path(known).resolve() != path.resolve():
            _bring(path.resolve(), str(path))


def _look_at(path: Path) -> None:
    """Refuse what cannot be imported under its name."""
    if path.suffix != ".py":
        raise UsageError(f"--with takes Python files, and '{path}' does not end in .py.")
    if not path.is_file():
        raise UsageError(f"--with {path}: there is no such file.")
    if not path.stem.isidentifier():
        raise UsageError(f"--with {path}: '{path.stem}' is no name that Python could import. Rename the file.")
    try:
        other = importlib.util.find_spec(path.stem)
    except ValueError:  # what is run itself, __main__, has none
        other = None
    place = other and other.origin
    folder = other and not place and other.submodule_search_locations is not None and path.stem not in sys.modules
    if other and not folder and not (place and Path(place).resolve() == path.resolve()):
        raise UsageError(f"--with {path}: there is a module named '{path.stem}' already. Rename the file.")


def _bring(path: Path, shown: str) -> None:
    import tsmblocks.blocks  # noqa: F401 - the package's own come first, so that what is new is the file's
    from tsmblocks.effects import catalogue
    from tsmblocks.model.block import REGISTRY

    before = (len(REGISTRY), len(catalogue()))
    sys.path.insert(0, str(path.parent))
    try:
        with contextlib.redirect_stdout(sys.stderr):
            importlib.import_module(path.stem)
    except (Exception, SystemExit) as error:
        raise UsageError(f"{_place(error, path, shown)}: {_said(error, path)}") from None
    if before == (len(REGISTRY), len(catalogue())):
        note(f"{shown} defines no block that files may name, and registers no effect.")


def _place(error: BaseException, path: Path, shown: str) -> str:
    """The last line of the file that was being run, or read."""
    lines = [frame.lineno for frame in traceback.extract_tb(error.__traceback__) if frame.filename == str(path)]
    if isinstance(error, SyntaxError) and error.filename == str(path):
        lines.append(error.lineno)
    return f"{shown}:{lines[-1]}" if lines else shown


def _said(error: BaseException, path: Path) -> str:
    """An error of such a file as one sentence; those of the package need no name."""
    own = isinstance(error, SyntaxError) and error.filename == str(path)  # else its text has the file and the line
    text = error.msg if isinstance(error, SyntaxError) and own else str(error)
    said = text if isinstance(error, TsmError) else f"{type(error).__name__}: {text}".rstrip(": ")
    return said if said.endswith((".", "?", "!")) else f"{said}."
