"""Colour and weight on a terminal: what a reader looks for first, by the form of a line. Files and pipes have none."""

from __future__ import annotations

import os
import re
import sys
from typing import Any

BOLD, RED, GREEN, YELLOW, BLUE = 1, 31, 32, 33, 34
"""Codes of ANSI terminals, whose colours the reader has chosen for their own paper."""
A_NUMBER = r"[-+]?[\d.]+(?:e[-+]?\d+)?(?: {2}| (?!%)|$)"
TABLE_HEAD = rf"(?:\A|(?<=\n\n)|(?<=:\n))(?=[^\n]*\S {{2,}}\S)(?![^\n]* {{2}}{A_NUMBER})[^\n]+(?=\n)"
"""The first line of a part of the text, where it has cells and none of them is a number."""
EMPHASIS: tuple[tuple[str, tuple[int, ...]], ...] = (
    (r"^NONE(?=\.)", (BOLD, GREEN)),
    (r"^NAMED(, INCOMPLETE|, REST UNEXPLAINED)?(?=\.)", (BOLD, BLUE)),
    (r"^UNKNOWN(?=\.)", (BOLD, YELLOW)),
    (r"^(?:beware(?: in .+)?|could not be fitted):$", (BOLD, YELLOW)),
    (r"^tsmblocks: (?:warning:)?", (BOLD, RED)),
    (r"^note:", (BOLD,)),
    (r"(?<=: )ok(?=; )", (GREEN,)),
    (r"^\+ .*", (GREEN,)),
    (r"^\* .*", (BOLD,)),
    (r"^(?=[^-*+~ ])[^\n]*:$", (BOLD,)),
    (r"^\d\. .*", (BOLD,)),
    (TABLE_HEAD, (BOLD,)),
    (r"(?:\A|(?<=\n\n))[a-z]+$", (BOLD,)),
    (r"^usage:", (BOLD,)),
)
"""Forms of lines, and their codes: verdicts, warnings, what was added, titles of lists, first rows of tables."""
_FORMS = re.compile("|".join(f"(?P<k{k}>{form})" for k, (form, _) in enumerate(EMPHASIS)), re.MULTILINE)


def wanted(stream: Any) -> bool:
    """Whether a stream shows colours: a terminal, unless the environment says otherwise.

    ``NO_COLOR`` forbids them; ``FORCE_COLOR`` and ``CLICOLOR_FORCE`` demand them; ``CLICOLOR=0`` and ``TERM=dumb``
    keep them from terminals.
    """
    if os.environ.get("NO_COLOR"):
        return False
    for name in ("FORCE_COLOR", "CLICOLOR_FORCE"):
        if name in os.environ and os.environ[name] != "0":
            return True
    if os.environ.get("TERM") == "dumb" or os.environ.get("CLICOLOR") == "0" or not stream.isatty():
        return False
    return sys.platform != "win32" or bool({"WT_SESSION", "ANSICON", "TERM"} & os.environ.keys())  # others show codes


def emphasised(text: str) -> str:
    """The text, with codes around what has one of the forms."""

    def coded(found: re.Match[str]) -> str:
        codes = ";".join(map(str, EMPHASIS[int((found.lastgroup or "k0")[1:])][1]))
        return f"\x1b[{codes}m{found[0]}\x1b[0m" if found[0] else ""

    return _FORMS.sub(coded, text)
