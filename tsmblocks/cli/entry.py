"""Arguments in, exit status out: 0 done, 2 bad usage or input, 130 stopped by Ctrl-C or SIGTERM, 1 anything else.

Only argparse is imported here; each command imports what it needs when it is run.
"""

from __future__ import annotations

import errno
import os
import sys
import traceback
import warnings
from collections.abc import Sequence
from contextlib import suppress
from pathlib import Path

from tsmblocks.cli import (
    blocks,
    check,
    compare,
    completion,
    demo,
    diagnose,
    diagrams,
    draw,
    export,
    extensions,
    fit,
    reference,
    run,
    study,
)
from tsmblocks.cli.common import INTERRUPTED, Formatter, Parser, UsageError
from tsmblocks.cli.console import OUTPUT, columns, print_error, readable_streams
from tsmblocks.common.errors import TsmError, near
from tsmblocks.common.interrupt import InterruptFlag, note_interrupts, terminate_as_interrupt
from tsmblocks.common.tables import as_wide_as
from tsmblocks.common.version import __version__

MODULES = (run, fit, compare, diagnose, study, draw, check, export, diagrams, blocks, reference, demo, completion)
COMMANDS = {module.__name__.rpartition(".")[2]: module for module in MODULES}
"""Modules of the commands by name, in the order of the help."""
ABOUT = """Block diagrams for mechanisms with friction, backlash and hysteresis.

  tsmblocks run fig16_feedforward_feedback --plot run.png
  tsmblocks diagnose tendon_sheath_linear --data sheath.csv --out found
  tsmblocks blocks Play

'tsmblocks COMMAND --help' has the options of a command, and examples.
"""
"""Help of the program."""
CLOSED = {"diagrams", "reference", "demo", "completion"}
"""Commands that use only the blocks of the package; all others take --with."""


def main(argv: Sequence[str] | None = None) -> int:
    """Run one command; the exit status. Nothing is raised; messages are printed on standard error.

    Without ``argv`` it is the command of this process, at whose end Ctrl-C is ignored: nothing is left to be stopped.
    """
    try:
        with (
            note_interrupts(argv is None) as noted,
            readable_streams(),
            warnings.catch_warnings(),
            terminate_as_interrupt(),
            as_wide_as(columns()),
        ):
            _simplify_warnings()
            return _flushed(_guarded(list(sys.argv[1:] if argv is None else argv), noted))
    except KeyboardInterrupt:  # a second one, while the first was being reported
        return INTERRUPTED


def _guarded(argv: list[str], noted: InterruptFlag) -> int:
    """Run one command and turn every exception into a message; the exit status."""
    try:
        return _dispatch(argv)
    except SystemExit as stop:  # --help and --version
        return int(stop.code or 0)
    except KeyboardInterrupt:
        return _stopped()
    except TsmError as error:
        print_error(str(error))
        return 2
    except OSError as error:
        return _refused_by_system(error)
    except MemoryError as error:
        print_error(f"there is not enough memory{f': {error}' if str(error) else ''}.")
        return 2
    except Exception:
        if noted.stop:  # what a library has made of KeyboardInterrupt
            return _stopped()
        traceback.print_exc()
        print_error("this is a fault of the program, not of your input; please report it with the lines above.")
        return 1


def _stopped() -> int:
    print_error("stopped before everything was done.")
    return INTERRUPTED


def _flushed(status: int) -> int:
    """Write the output that is still buffered; the exit status. After one message nothing more is reported."""
    try:
        sys.stdout.flush()
    except OSError as error:
        return status or _refused_by_system(error)
    finally:
        _discard_unwritten()
    return status


def _refused_by_system(error: OSError) -> int:
    """Report an error of the system, if it is one; the exit status."""
    if _is_closed_pipe(error):  # the reader has what it wanted
        return 0
    print_error(f"{error.filename}: {error.strerror}." if error.filename and error.strerror else str(error))
    return 2


def _is_closed_pipe(error: OSError) -> bool:
    """Whether the reader of a pipe is gone; the error differs between systems."""
    windows = sys.platform == "win32" and error.errno == errno.EINVAL and error.filename in (None, OUTPUT)
    return isinstance(error, BrokenPipeError) or windows


def _discard_unwritten() -> None:
    """Let streams that cannot be written lead nowhere, or Python would report it again at the end of the process."""
    for stream in (getattr(one, "unfiltered", one) for one in (sys.stdout, sys.stderr)):
        try:
            stream.flush()
        except OSError:
            with suppress(OSError), Path(os.devnull).open("wb") as nowhere:
                os.dup2(nowhere.fileno(), stream.fileno())
                stream.flush()


def _dispatch(argv: list[str]) -> int:
    parser, known_to = parsers()
    if not argv:
        parser.print_help(sys.stderr)
        return 2
    if argv[0] == "help":  # as other programs have it
        argv = [*argv[1:2], "--help"]
    if not argv[0].startswith("-") and argv[0] not in COMMANDS:
        raise UsageError(f"there is no command '{argv[0]}'.{near(argv[0], COMMANDS)}")
    args, extra = parser.parse_known_args(argv)
    if extra:
        raise UsageError(f"{args.command} takes no {_refused(extra[0], known_to[args.command].options())}")
    extensions.import_files(getattr(args, "extensions", ()))
    args.parsers, args.helps = parsers, {name: module.HELP for name, module in COMMANDS.items()}
    return int(COMMANDS[args.command].execute(args))


def _refused(extra: str, options: Sequence[str]) -> str:
    """An argument that is not known, with a hint; it may be a recording among the diagrams."""
    word = extra.partition("=")[0]
    if word.startswith("-"):
        return f"option '{word}'.{near(word, options, most=20)}"
    there = os.path.isfile(extra)  # noqa: PTH113 - a name too long to be one raises nothing here
    recording = there and "--data" in options and not extra.endswith(".toml")
    return f"argument '{word}'.{' Recordings follow --data.' if recording else ''}"


def parsers() -> tuple[Parser, dict[str, Parser]]:
    """The parser of the program, and that of each command."""
    parser = Parser(prog="tsmblocks", description=ABOUT, allow_abbrev=False, formatter_class=Formatter)
    parser.add_argument("--version", action="version", version=f"tsmblocks {__version__}")
    inside = parser.add_subparsers(dest="command", metavar="COMMAND", required=True, parser_class=Parser)
    made = {}
    for name, module in COMMANDS.items():
        made[name] = inside.add_parser(
            name, help=module.HELP, description=module.__doc__, allow_abbrev=False, formatter_class=Formatter
        )
        module.arguments(made[name])
        if name not in CLOSED:
            extensions.with_argument(made[name])
    return parser, made


def _simplify_warnings() -> None:
    """Print warnings for the user as one line each, and suppress those of libraries for developers."""
    if not sys.warnoptions:
        warnings.simplefilter("ignore")
        warnings.simplefilter("always", UserWarning)
    warnings.showwarning = lambda message, *_, **__: print_error(f"warning: {message}")
