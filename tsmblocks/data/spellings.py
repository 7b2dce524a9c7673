"""Signals that a recording has under another spelling than the diagram: another case, spaces, underscores."""

from __future__ import annotations

from collections.abc import Iterable, Iterator

from tsmblocks.common.errors import bare_name
from tsmblocks.data.missing_units import map_argument


def other_spelling(name: str, known: Iterable[str]) -> str:
    """The only known name that differs by case, spaces and punctuation alone; ``""`` where there is none."""
    found = [k for k in known if k != name and bare_name(k) == bare_name(name)]
    return found[0] if len(found) == 1 else ""


def spelling_notes(wanted: Iterable[str], known: Iterable[str]) -> Iterator[str]:
    """A sentence for each wanted signal that is missing and is there under another spelling."""
    names, signals = [*known], [*wanted]
    others = [k for k in names if k not in signals]
    for name in signals:
        if name not in names and (other := other_spelling(name, others)):
            yield f"there is no '{name}', and '{other}' is not used. To use it, map it: {map_argument(name, other)}."
