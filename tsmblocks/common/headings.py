"""Headings of columns and axes: a name with its unit in brackets."""

from __future__ import annotations

import re

from tsmblocks.common.units import is_unit

_HEADING = re.compile(r"\s*(.*?)\s*(?:\[([^\]]*)\]|\(([^)]*)\))?\s*", re.DOTALL)


def split_heading(text: str) -> tuple[str, str]:
    """Name and unit of ``"x_in [deg]"`` or ``"x_in (deg)"``; the unit is ``""`` when none is given.

    Round brackets that hold no unit belong to the name: ``x (cmd)``, and ``angle (m2)``, which is that of motor 2.
    """
    match = _HEADING.fullmatch(text)
    assert match is not None  # every part is optional
    if match[3] is not None and (not is_unit(match[3]) or re.fullmatch(r"\s*\w+[23]\s*", match[3])):
        return text.strip(), ""
    return match[1], (match[2] or match[3] or "").strip()


def heading(name: str, unit: str) -> str:
    """``name [unit]``, or the name alone when no unit is known."""
    return f"{name} [{unit}]" if unit else name


def unambiguous_heading(name: str, unit: str) -> str:
    """The heading; with empty brackets where a name alone would be split: ``f(x) []`` is not ``f`` in ``x``."""
    plain = heading(name, unit)
    return plain if split_heading(plain) == (name, unit) else f"{name} [{unit}]"
