"""Parts of a page of HTML that needs no network and no scripts: the document, tables, keys of colours, pictures."""

from __future__ import annotations

from collections.abc import Iterable, Sequence
from html import escape

from tsmblocks.html.style import CSS

WIDE, TEXTS = 5, 2
"""Columns, and columns of words, beyond which a table is moved sideways on a phone and not squeezed."""


def document(title: str, parts: Iterable[str]) -> str:
    """The whole page; ``title`` is text, the parts are HTML."""
    return (
        f'<!DOCTYPE html>\n<html lang="en"><head><meta charset="utf-8"><title>{escape(title)}</title>'
        '<meta name="viewport" content="width=device-width,initial-scale=1">'
        f'<meta name="color-scheme" content="light dark"><style>{CSS}</style></head>\n<body>\n'
        + "\n".join(parts)
        + "\n</body></html>\n"
    )


def table(names: Sequence[str], rows: Iterable[Sequence[str]], kinds: Sequence[str] = ()) -> str:
    """Cells are HTML already; a name that begins with ``l:`` is of a column that is flush left.

    ``kinds`` are classes of the rows, none where it is empty.
    """
    sides = [' class="l"' if name.startswith("l:") else "" for name in names]
    head = "".join(f"<th{side}>{escape(name.removeprefix('l:'))}</th>" for name, side in zip(names, sides, strict=True))
    body = []
    for place, row in enumerate(rows):
        kind = f' class="{kinds[place]}"' if kinds and kinds[place] else ""
        cells = "".join(f"<td{side}>{cell}</td>" for cell, side in zip(row, sides, strict=True))
        body.append(f"<tr{kind}>{cells}</tr>")
    wide = ' class="wide"' if len(names) > WIDE else ' class="text"' if sum(map(bool, sides)) > TEXTS else ""
    inner = f"<thead><tr>{head}</tr></thead><tbody>{''.join(body)}</tbody>"
    return f'<div class="scroll" tabindex="0"><table{wide}>{inner}</table></div>'


def key(items: Sequence[tuple[str, str]]) -> str:
    """What colours mean: pairs of a colour of the style sheet (or ``hollow``) and words."""
    shown = []
    for colour, words in items:
        style = "--c:transparent;--b:var(--ink)" if colour == "hollow" else f"--c:var({colour})"
        shown.append(f'<span style="{style}">{escape(words)}</span>')
    return f'<div class="key">{"".join(shown)}</div>'


def sentence(words: str) -> str:
    """A sentence as HTML; a number and its percent sign stay together."""
    return escape(words).replace(" %", "&nbsp;%").replace(" ± ", "&nbsp;±&nbsp;").replace(" -&gt;", "&nbsp;→")


def picture(svg: str) -> str:
    """A drawing on white ground, moved sideways where it is wider than the page."""
    return f'<div class="picture" tabindex="0">{svg}</div>'
