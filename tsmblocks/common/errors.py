"""Every exception that the package raises on purpose, and functions for the text of messages.

    TsmError
    ├── BlockError          one block
    │   ├── ParameterError      a value outside its bounds, of the wrong kind, or of an unknown name
    │   └── EquationError       equations that do not cover what the block declares
    ├── DiagramError        blocks and wires that do not fit together (all faults at once)
    │   └── AlgebraicLoop       a signal that depends on itself at one instant
    ├── FileError           a diagram or data file that cannot be understood
    ├── DataError           measured data that cannot be used as they are
    └── RunError            a failure during a simulation
        └── NotFinite           NaN or infinity, with the block in which it appeared first

Every message says where, what, what was expected, and suggests the nearest known name.
"""

from __future__ import annotations

import opcode
import re
import sys
from collections.abc import Iterable, Sequence
from difflib import get_close_matches
from typing import Any

__all__ = [
    "AlgebraicLoop",
    "BlockError",
    "DataError",
    "DiagramError",
    "EquationError",
    "FileError",
    "NotFinite",
    "ParameterError",
    "RunError",
    "TsmError",
]

MOST_PROBLEMS = 20
"""Problems of one message that are printed; the others are counted. Chosen: a screen of text."""
MOST_CHARACTERS = 1500
"""Characters of one problem that are printed (a loop may have thousands of blocks). Chosen: a screen of text."""


CONTROLS = re.compile(
    "[\x00-\x08\x0b-\x1f\x7f-\x9f\u061c\u200e\u200f\u2028-\u202e\u2066-\u2069\ud800-\udfff\ufffe\uffff]"
)
"""Characters that control a terminal, end lines, or reverse the direction of text, and those that no text in UTF-8 or
XML can hold; not tabs and new lines."""


def without_controls(text: str) -> str:
    """A text whose control characters are replaced by one that is visible."""
    return CONTROLS.sub("�", text)


class TsmError(Exception):
    """Base of every exception that this package raises on purpose. Its text is meant for the user."""

    def __str__(self) -> str:
        return without_controls(super().__str__())


class BlockError(TsmError):
    """A fault of one block, independent of the diagram that contains it."""


class ParameterError(BlockError):
    """A parameter out of bounds, of the wrong kind, or of an unknown name."""


class EquationError(BlockError):
    """A block whose equations and declarations disagree."""


class DiagramError(TsmError):
    """Blocks and wires that do not fit together.

    Parameters
    ----------
    diagram : str
        Title of the diagram.
    problems : sequence of str
        One sentence for each fault.
    where : str, default ""
        ``file:line`` where the diagram was written.
    """

    def __init__(self, diagram: str, problems: Sequence[str], where: str = "") -> None:
        self.diagram, self.problems, self.where = diagram, tuple(problems), where
        super().__init__(diagram, self.problems, where)

    def __str__(self) -> str:
        place = f" ({self.where})" if self.where else ""
        return without_controls(f"diagram '{self.diagram}'{place} has {numbered(self.problems)}")


class AlgebraicLoop(DiagramError):
    """A signal whose value at one instant depends on itself.

    Parameters
    ----------
    diagram, problems, where : str, sequence of str and str
        As for ``DiagramError``.
    path : sequence of str, default ()
        Signals around the loop; the first and the last are the same.
    """

    def __init__(self, diagram: str, problems: Sequence[str], where: str = "", path: Sequence[str] = ()) -> None:
        super().__init__(diagram, problems, where)
        self.path = tuple(path)


class FileError(TsmError):
    """A file that cannot be understood.

    Parameters
    ----------
    path : str
        Name of the file.
    problems : sequence of str
        One sentence for each fault.
    """

    def __init__(self, path: str, problems: Sequence[str]) -> None:
        self.path, self.problems = path, tuple(problems)
        super().__init__(path, self.problems)

    def __str__(self) -> str:
        return without_controls(f"{self.path} has {numbered(self.problems)}")


class DataError(TsmError):
    """Measured data that cannot be used as they are."""


class RunError(TsmError):
    """A failure during a simulation. ``run`` holds the result up to there, if any."""

    run: Any = None


class NotFinite(RunError):
    """NaN or infinity in a signal, with the ``block`` in which it appeared first and the ``time`` [s]."""

    block: str = ""
    time: float = float("nan")


def numbered(problems: Sequence[str]) -> str:
    """``2 problems:`` and the list, each problem on separate lines."""
    count = f"{len(problems)} problem{'s' if len(problems) != 1 else ''}"
    shown = [*problems[:MOST_PROBLEMS]]
    if len(problems) > MOST_PROBLEMS:
        shown.append(f"and {len(problems) - MOST_PROBLEMS} more.")
    texts = [_printable(clip(text, MOST_CHARACTERS)).replace("\n", "\n     ") for text in shown]
    return "\n".join([f"{count}:", *(f"  {n}. {text}" for n, text in enumerate(texts, 1))])


def _printable(text: str) -> str:
    """A text without control characters, which could control the terminal."""
    return "".join(c if c.isprintable() or c == "\n" else "�" for c in text)


def near(name: object, known: Iterable[str], most: int = 8, otherwise: str = "") -> str:
    """`` Did you mean 'x'?`` when a known name is close, otherwise the known names, followed by ``otherwise``.

    Names without a dot come first, as those of the outputs of a diagram beside the ports of its blocks.
    """
    choices = sorted({str(k) for k in known}, key=lambda k: ("." in k, k))
    if close := nearest(name, choices):
        return f" Did you mean '{clip(close)}'?"
    return f"{known_here(choices, most)}{otherwise}"


def near_file(name: str, files: Iterable[str]) -> str:
    """As ``near`` for files of a folder, whose names are compared without their ends: all of them may be ``.csv``."""
    stems = {file.rpartition(".")[0] or file: file for file in files}
    if close := nearest(name.rpartition(".")[0] or name, stems):
        return f" Did you mean '{clip(stems[close])}'?"
    return known_here(sorted(stems.values()), 8)


def known_here(choices: Sequence[str], most: int) -> str:
    """`` Known here: a, b.`` with the first names; how many there are where that is not all."""
    if not choices:
        return " There are none."
    more = f", … ({len(choices)} in all)" if len(choices) > most else ""
    return f" Known here: {', '.join(map(clip, choices[:most]))}{more}."


def nearest(name: object, known: Iterable[str]) -> str:
    """The known name that is close to another, or ``""``.

    Close is, in this order: a difference in case, spaces and punctuation; the only name whose first words these are; a
    difference of a letter or two; the only name that contains the word (``play`` is ``tendon_sheath_play``); a similar
    spelling; the only name that begins so; an end that differs by a letter or two; the only name that is a word of it
    (``gear_ratio`` is ``gear``). A single letter does not count as a word, nor two letters as a beginning.
    """
    choices, text = sorted({str(k) for k in known}), str(name)
    likely, plain = _likely(text, choices), text.casefold()
    words = {k: f"_{k.casefold()}_".replace(".", "_").replace("/", "_") for k in choices}
    close = (
        [k for k in choices if k.casefold() == plain]
        or _only([k for k in choices if bare_name(k) == bare_name(text)])
        or _only([k for k in choices if len(plain) > 2 and k.casefold().startswith((f"{plain}_", f"{plain}."))])
        or get_close_matches(text, likely, 1, 0.85)
        or _only([k for k in choices if len(plain) > 1 and f"_{plain}_" in words[k]])
        or get_close_matches(text, likely, 1, 0.6)
        or _only([k for k in choices if len(plain) > 2 and k.casefold().startswith(plain)])
        or _with_end(plain, choices)
        or _only([k for k in choices if len(k) > 1 and words[k] in f"_{plain}_"])
    )
    return close[0] if close else ""


def bare_name(name: str) -> str:
    """A name without case, spaces and punctuation."""
    return re.sub(r"[\W_]+", "", name).casefold()


def _only(found: list[str]) -> list[str]:
    """The names found where there is exactly one, else none."""
    return found if len(found) == 1 else []


def _with_end(plain: str, choices: list[str]) -> list[str]:
    """The name whose last words differ by a letter or two: ``lineer`` is near ``tendon_sheath_linear``."""
    ends = {k[m.end() :].casefold(): k for k in choices for m in re.finditer("_", k)} if len(plain) > 3 else {}
    return [ends[end] for end in get_close_matches(plain, ends, 1, 0.8)]


def _likely(name: str, choices: list[str]) -> list[str]:
    """Names worth comparing: a long text, or thousands of names, would take seconds."""
    if len(name) > 100:
        return []
    if len(choices) <= 1000:
        return choices
    return [k for k in choices if k[:1] == name[:1] and abs(len(k) - len(name)) <= 2][:1000]


def clip(text: str, limit: int = 100) -> str:
    """A text for a message: no longer than ``limit`` characters."""
    return text if len(text) <= limit else text[: limit - 1] + "…"


def in_words(value: object, limit: int = 60) -> str:
    """A value for a message: short, on one line."""
    if isinstance(value, float):
        return f"{value:g}"
    if isinstance(value, type):
        return f"the class {value.__name__}"
    shape = getattr(value, "shape", ()) if hasattr(value, "dtype") else ()
    if len(shape) > 1 or max(shape, default=0) > 8:
        return f"an array of shape {tuple(shape)}"
    if type(value).__module__ == "numpy" and shape == () and hasattr(value, "item"):
        return in_words(value.item(), limit)  # releases of NumPy differ in how they show a number
    try:
        return clip(" ".join(repr(value).split()), limit)
    except Exception:  # an object that cannot be shown, or lists too deep in each other
        return f"a {type(value).__name__}"


def several(names: Sequence[str], what: str) -> str:
    """``no input``, ``1 input (u)`` or ``2 inputs (u1, u2)``."""
    if not names:
        return f"no {what}"
    return f"{len(names)} {what}{'s' if len(names) > 1 else ''} ({clip(', '.join(names))})"


def no_such_name(module: str, name: str, hint: str) -> AttributeError | ImportError:
    """The error that the ``__getattr__`` of a module raises: an ImportError with the hint for ``from module import``.

    There Python replaces the text of an AttributeError; to that of any other access it adds the nearest name itself,
    unless the error has a name already.
    """
    text, caller = f"{module} has no '{name}'.{hint}", sys._getframe(2)
    importing = caller.f_code.co_code[caller.f_lasti] == opcode.opmap["IMPORT_FROM"]
    if importing and f"{module}.{name}" not in sys.modules:  # a module half imported is found there
        return ImportError(text, name=module)
    return AttributeError(text, name=name)
