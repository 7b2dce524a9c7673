"""Every exception the package raises on purpose, and the helpers that word them.

    TsmError
    ├── BlockError          a block, taken alone
    │   ├── ParameterError      a value outside its bounds, of the wrong kind, or of an unknown name
    │   └── EquationError       equations that do not cover what the block declares
    ├── DiagramError        blocks and wires that do not fit together (all faults at once)
    │   └── AlgebraicLoop       a signal that depends on itself at one instant
    ├── FileError           a diagram or data file that cannot be understood
    ├── DataError           measured data that cannot be used as they are
    └── RunError            something that happened while time was running
        └── NotFinite           NaN or infinity, with the block where it was born

Every message says where, what, what was expected, and suggests the near miss.
"""

from __future__ import annotations

import re
from collections.abc import Iterable, Sequence
from difflib import get_close_matches
from typing import Any


class TsmError(Exception):
    """Anything this package refuses on purpose. Its text is meant for the user as it stands."""


class BlockError(TsmError):
    """A fault of one block, whatever diagram it stands in."""


class ParameterError(BlockError):
    """A parameter out of bounds, of the wrong kind, or of an unknown name."""


class EquationError(BlockError):
    """A block whose equations and declarations disagree."""


class DiagramError(TsmError):
    """Blocks and wires that do not fit together.

    ``diagram`` is the diagram's title, ``problems`` one sentence per fault, ``where`` the
    file (and line) it was written in.
    """

    def __init__(self, diagram: str, problems: Sequence[str], where: str = "") -> None:
        self.diagram, self.problems, self.where = diagram, tuple(problems), where
        super().__init__(diagram, self.problems, where)

    def __str__(self) -> str:
        place = f" ({self.where})" if self.where else ""
        return f"diagram '{self.diagram}'{place} has {numbered(self.problems)}"


class AlgebraicLoop(DiagramError):
    """A signal whose value at one instant depends on itself.

    ``path`` lists the signals around the loop, first and last being the same.
    """

    def __init__(self, diagram: str, problems: Sequence[str], where: str = "", path: Sequence[str] = ()) -> None:
        super().__init__(diagram, problems, where)
        self.path = tuple(path)


class FileError(TsmError):
    """A file that cannot be understood. ``path`` names it, ``problems`` lists the faults."""

    def __init__(self, path: str, problems: Sequence[str]) -> None:
        self.path, self.problems = path, tuple(problems)
        super().__init__(path, self.problems)

    def __str__(self) -> str:
        return f"{self.path} has {numbered(self.problems)}"


class DataError(TsmError):
    """Measured data that cannot be used as they are."""


class RunError(TsmError):
    """Something went wrong while time was running. ``run`` holds the result up to there, if any."""

    run: Any = None


class NotFinite(RunError):
    """NaN or infinity, with the ``block`` it was born in and the ``time`` [s] it happened at."""

    block: str = ""
    time: float = float("nan")


def numbered(problems: Sequence[str]) -> str:
    """``2 problems:`` and the list, each on lines of its own."""
    count = f"{len(problems)} problem{'s' if len(problems) != 1 else ''}"
    shown = [*problems[:MOST_PROBLEMS]]
    if len(problems) > MOST_PROBLEMS:
        shown.append(f"and {len(problems) - MOST_PROBLEMS} more.")
    lines = [f"  {n}. " + _printable(clip(text, LONGEST)).replace("\n", "\n     ") for n, text in enumerate(shown, 1)]
    return "\n".join([f"{count}:", *lines])


def _printable(text: str) -> str:
    """Return a text that cannot steer the terminal it is shown on, whatever a file put into it."""
    return "".join(c if c.isprintable() or c == "\n" else "�" for c in text)


MOST_PROBLEMS = 20
"""A broken file of ten thousand wires should not print ten thousand lines."""
LONGEST = 1500
"""Characters of one problem that are shown; a loop of a thousand blocks need not be read in full."""


def near(name: object, known: Iterable[str], most: int = 8, otherwise: str = "") -> str:
    """`` Did you mean 'x'?`` when a known name is close, otherwise the choices.

    Close is what differs in a letter or two; then the one choice that holds the name as a word of its own (``play``
    is ``tendon_sheath_play``); then what is spelt much alike; then the only one that begins so, or that ends nearly so.
    ``otherwise`` is said after the choices.
    """
    choices, text = sorted({str(k) for k in known}), str(name)
    likely, plain = _likely(text, choices), text.casefold()
    close = [k for k in choices if k.casefold() == plain] or get_close_matches(text, likely, 1, 0.85)
    close = close or _with_word(plain, choices) or get_close_matches(text, likely, 1, 0.6)
    begun = [k for k in choices if k.casefold().startswith(plain)] if len(plain) > 2 and not close else []
    close = (begun if len(begun) == 1 else close) or _with_end(plain, choices)
    if close:
        return f" Did you mean '{clip(close[0])}'?"
    if not choices:
        return f" There are none.{otherwise}"
    more = f", … ({len(choices)} in all)" if len(choices) > most else ""
    return f" Known here: {', '.join(map(clip, choices[:most]))}{more}.{otherwise}"


def _with_end(plain: str, choices: list[str]) -> list[str]:
    """The choice whose words at its end are a letter or two off: ``lineer`` is near ``tendon_sheath_linear``."""
    ends = {k[m.end() :].casefold(): k for k in choices for m in re.finditer("_", k)} if len(plain) > 3 else {}
    return [ends[end] for end in get_close_matches(plain, ends, 1, 0.8)]


def _with_word(plain: str, choices: list[str]) -> list[str]:
    """The choice that has a name in small letters among its words, where there is just one and it is no letter."""
    found = [k for k in choices if f"_{plain}_" in f"_{k.casefold()}_".replace(".", "_").replace("/", "_")]
    return found if len(found) == 1 and len(plain) > 1 else []


def _likely(name: str, choices: list[str]) -> list[str]:
    """The choices worth comparing: comparing a long text, or with thousands, would take seconds."""
    if len(name) > 100:
        return []
    if len(choices) <= 1000:
        return choices
    return [k for k in choices if k[:1] == name[:1] and abs(len(k) - len(name)) <= 2][:1000]


def clip(text: str, limit: int = 100) -> str:
    """A text as a message may show it: no longer than ``limit``."""
    return text if len(text) <= limit else text[: limit - 1] + "…"


def in_words(value: object, limit: int = 60) -> str:
    """A value as a message may show it: short, on one line."""
    if isinstance(value, float):
        return f"{value:g}"
    if isinstance(value, type):
        return f"the class {value.__name__}"
    shape = getattr(value, "shape", ()) if hasattr(value, "dtype") else ()
    if len(shape) > 1 or max(shape, default=0) > 8:
        return f"an array of shape {tuple(shape)}"
    return clip(" ".join(repr(value).split()), limit)


def several(names: Sequence[str], what: str) -> str:
    """``no input``, ``1 input (u)`` or ``2 inputs (u1, u2)``."""
    if not names:
        return f"no {what}"
    return f"{len(names)} {what}{'s' if len(names) > 1 else ''} ({clip(', '.join(names))})"
