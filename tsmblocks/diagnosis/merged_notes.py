"""Notes of a diagnosis for its reader: those that repeat for several experiments are merged."""

from __future__ import annotations

import re
from collections.abc import Sequence

from tsmblocks.common.tables import listed

PLACEHOLDER = "\0"
"""Replaces each number while notes are compared."""
_NUMBER = re.compile(r"(?:\d{4}-\d\d-\d\d )?\d\d:\d\d:\d\d(?:\.\d+)?|(?<![\w.])\d+(?:\.\d+)?(?:e[-+]?\d+)?(?![\w.]*\w)")


def merged_notes(notes: Sequence[str], experiments: Sequence[str]) -> list[str]:
    """Notes with the same text for several experiments as one, their numbers as a range."""
    groups: dict[str, list[tuple[str, list[str]]]] = {}
    for note in notes:
        name, colon, text = note.partition(": ")
        own = bool(colon) and name in experiments
        key = _NUMBER.sub(PLACEHOLDER, text) if own else note
        groups.setdefault(key, []).append((name if own else "", _NUMBER.findall(text) if own else []))
    result = []
    for key, found in groups.items():
        names = [name for name, _ in found if name]
        if not names:
            result.append(key)
            continue
        text = key
        for column in zip(*(numbers for _, numbers in found), strict=True):
            text = text.replace(PLACEHOLDER, _range(column), 1)
        result.append(f"{_experiments_text(names, experiments)}: {text}")
    return result


def _experiments_text(names: Sequence[str], experiments: Sequence[str]) -> str:
    return "all experiments" if len(names) == len(experiments) > 1 else listed(names, 5)


def _range(texts: Sequence[str]) -> str:
    """The smallest and largest of numbers or clock times given as text."""
    clock = any(":" in text for text in texts)
    low, high = (end(texts) if clock else end(texts, key=float) for end in (min, max))
    return low if low == high else f"{low} to {high}" if clock else f"{low}–{high}"
