"""User-defined blocks and effects: Python files that are imported before a command runs."""

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
from tsmblocks.cli.console import print_note
from tsmblocks.common.errors import TsmError


def with_argument(parser: argparse.ArgumentParser) -> None:
    """Declare --with."""
    first = "a Python file to import first, for blocks and effects that it defines; may be repeated"
    parser.add_argument("--with", dest="extensions", metavar="FILE", action="append", default=[], help=first)


def import_files(paths: Iterable[str]) -> None:
    """Import each file under its name, as ``import`` would, so that worker processes find it too.

    What they print goes to standard error, since another program may read the results of the command.
    Raises UsageError for a file that is no Python file, has the name of another module, or raises an error.
    """
    for path in map(Path, paths):
        _check_path(path)
        known = getattr(sys.modules.get(path.stem), "__file__", None)
        if known is None or Path(known).resolve() != path.resolve():
            _import_file(path.resolve(), str(path))


def _check_path(path: Path) -> None:
    """Raise UsageError for a file that cannot be imported under its name."""
    if path.suffix != ".py":
        raise UsageError(f"--with takes Python files, and '{path}' does not end in .py.")
    if not path.is_file():
        raise UsageError(f"--with {path}: there is no such file.")
    if not path.stem.isidentifier():
        raise UsageError(f"--with {path}: '{path.stem}' is not a name that Python can import. Rename the file.")
    try:
        other = importlib.util.find_spec(path.stem)
    except ValueError:  # __main__ has none
        other = None
    place = other and other.origin
    folder = other and not place and other.submodule_search_locations is not None and path.stem not in sys.modules
    if other and not folder and not (place and Path(place).resolve() == path.resolve()):
        raise UsageError(f"--with {path}: there is a module named '{path.stem}' already. Rename the file.")


def _import_file(path: Path, shown: str) -> None:
    import tsmblocks.blocks  # noqa: F401 - registered first, so that all later ones are of the file
    from tsmblocks.effects import catalogue
    from tsmblocks.model.block import REGISTRY

    before = (len(REGISTRY), len(catalogue()))
    sys.path.insert(0, str(path.parent))
    try:
        with contextlib.redirect_stdout(sys.stderr):
            importlib.import_module(path.stem)
    except (Exception, SystemExit) as error:
        raise UsageError(_described(error, path, shown)) from None
    if before == (len(REGISTRY), len(catalogue())):
        print_note(f"{shown} defines no block that files may name, and registers no effect.")


def _described(error: BaseException, path: Path, shown: str) -> str:
    """The last line of the file that was running or being parsed, and the error as one sentence.

    The class of the error is named unless the package raised it.
    """
    lines = [frame.lineno for frame in traceback.extract_tb(error.__traceback__) if frame.filename == str(path)]
    text = str(error) if isinstance(error, TsmError) else f"{type(error).__name__}: {error}".rstrip(": ")
    if isinstance(error, SyntaxError) and error.filename == str(path):
        lines.append(error.lineno)
        text = f"{type(error).__name__}: {error.msg}"  # without file and line, which the message has already
    place = f"{shown}:{lines[-1]}" if lines else shown
    return f"{place}: {text}" if text.endswith((".", "?", "!")) else f"{place}: {text}."
