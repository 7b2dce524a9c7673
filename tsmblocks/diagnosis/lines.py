"""Lines of a text for a terminal: lists, filled paragraphs, names that are cut."""

from __future__ import annotations

import textwrap
from collections.abc import Sequence

from tsmblocks.common.tables import line_width
from tsmblocks.diagnosis.segment import Segment


def cut(text: str, most: int) -> str:
    """A name in at most so many characters, with an ellipsis where it is cut."""
    return text if len(text) <= most else text[: most - 1] + "…"


def bullets(title: str, texts: Sequence[str]) -> list[str]:
    """A title with a list below it; nothing where there is nothing to list."""
    return ["\n".join([f"{title}:", *(filled(text, "- ", "  ") for text in texts)])] if texts else []


def filled(text: str, first: str = "", others: str = "") -> str:
    """A text in lines that fit a terminal; a percent sign stays with its number."""
    lines = textwrap.fill(
        text.replace(" %", "\xa0%"),
        line_width(),
        initial_indent=first,
        subsequent_indent=others,
        break_long_words=False,
        break_on_hyphens=False,
    )
    return lines.replace("\xa0", " ")


def of_segment(segment: Segment, several: bool) -> str:
    """The part that a title is about, where there are several."""
    return f" in {segment.name}" if several else ""
