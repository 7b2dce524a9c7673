"""Signals that a recording may have under another name than the diagram: another spelling, a word more."""

from __future__ import annotations

from collections.abc import Collection, Iterable, Iterator

from tsmblocks.common.errors import bare_name, nearest
from tsmblocks.data.missing_units import map_argument


def other_spelling(name: str, known: Iterable[str]) -> str:
    """The only known name that differs by case, spaces and punctuation alone; ``""`` where there is none."""
    found = [k for k in known if k != name and bare_name(k) == bare_name(name)]
    return found[0] if len(found) == 1 else ""


def spelling_notes(wanted: Collection[str], used: Collection[str], unused: Iterable[str]) -> Iterator[str]:
    """A sentence for each wanted signal that is missing, and that one of those ``unused`` may be by its name."""
    signals, rest = {*wanted}, [*unused]
    others = [k for k in (*used, *rest) if k not in signals]
    for name in wanted:
        if name not in used and (other := other_spelling(name, others) or nearest(name, rest)):
            yield f"there is no '{name}', and '{other}' is not used. To use it, map it: {map_argument(name, other)}."
