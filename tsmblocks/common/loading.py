"""Ctrl-C while the package is being imported for a command: there is nothing to finish or to report yet."""

import os
import signal
import sys

INTERRUPTED = 130
"""Exit status after Ctrl-C: 128 and the number of the signal, as shells have it."""


def _is_command() -> bool:
    """Whether this process is a command of the package: the script ``tsmblocks``, or ``python -m tsmblocks``."""
    program = sys.argv[0] if getattr(sys, "argv", None) else ""
    if program == "-m":
        return "tsmblocks" in sys.orig_argv[1:4]
    return os.path.splitext(os.path.basename(program))[0] == "tsmblocks"  # noqa: PTH119, PTH122 - pathlib takes 10 ms


def quit_quietly() -> None:
    """Let Ctrl-C end a command at once until ``main`` handles it; handlers of other programs stay as they are."""
    if _is_command() and signal.getsignal(signal.SIGINT) is signal.default_int_handler:
        try:  # noqa: SIM105 - contextlib would be one module more to import first
            signal.signal(signal.SIGINT, lambda *_: os._exit(INTERRUPTED))
        except ValueError:  # not in the main thread
            pass


quit_quietly()
