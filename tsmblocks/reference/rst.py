"""Pieces of reStructuredText, which Sphinx reads: headings, tables, code, formulas, HTML as it is."""

from __future__ import annotations

import re
import textwrap
from collections.abc import Iterable, Sequence

LEVELS = "=-~^"


def plain(text: str) -> str:
    """A text in which nothing is markup."""
    return re.sub(r"([\\*`|]|_(?=\W|$)|(?<=\s)_|^[-+](?=\s))", r"\\\1", " ".join(text.split()))


def words(text: str) -> str:
    """A text as docstrings have it: ``code`` stays code, all else is plain."""
    parts = re.split(r"(``.+?``|:math:`.+?`)", " ".join(text.split()))
    return "".join(part if k % 2 else re.sub(r"([\\*|]|_(?=\W|$))", r"\\\1", part) for k, part in enumerate(parts))


def code(text: str) -> str:
    """A name in the type of code; what has no text has none."""
    return f"``{text}``" if text.strip() else ""


def heading(text: str, level: int = 0) -> str:
    """A heading; level 0 is the page's."""
    return f"{text}\n{LEVELS[level] * max(len(text), 4)}\n"


def link(target: str, text: str = "") -> str:
    """A link to a page, by its path from the root."""
    return f":doc:`{text} <{target}>`" if text else f":doc:`{target}`"


def table(head: Sequence[str], rows: Iterable[Sequence[str]], widths: Sequence[int] = ()) -> str:
    """A table of cells that are markup already; nothing where there are no rows. ``widths`` are shares.

    On a narrow page the meaning or the parameters, if the last column, stand below the other cells of their row.
    """
    rows = list(rows)
    if not rows:
        return ""
    shares = f"   :widths: {' '.join(map(str, widths))}\n" if widths else ""
    kind = "   :class: meaning\n" if head[-1] in ("Meaning", "Parameters") else ""
    lines = [f".. list-table::\n   :header-rows: 1\n{kind}{shares}"]
    for row in (head, *rows):
        lines += [f"   {'*' if not k else ' '} - {cell}" for k, cell in enumerate(row)]
    return "\n".join(lines) + "\n"


def section(title: str, head: Sequence[str], rows: Iterable[Sequence[str]], widths: Sequence[int]) -> str:
    """A table below a heading; nothing where there are no rows."""
    made = table(head, rows, widths)
    return f"{heading(title, 1)}\n{made}" if made else ""


def listed(items: Iterable[str]) -> str:
    """A list of markup."""
    return "\n".join(f"- {item}" for item in items) + "\n"


def block(text: str, language: str) -> str:
    """Code as it is typed."""
    return f".. code-block:: {language}\n\n{textwrap.indent(text.rstrip(), '   ')}\n"


def html(text: str) -> str:
    """HTML that goes into the page as it is."""
    return f".. raw:: html\n\n{textwrap.indent(text, '   ')}\n"


def image(path: str, words: str) -> str:
    """A picture, and what it shows in words, in a box that scrolls on a narrow page."""
    return f".. container:: plot\n\n   .. image:: {path}\n      :alt: {words}\n"


def formula(latex: str) -> str:
    """A displayed formula."""
    return f".. math::\n\n{textwrap.indent(latex, '   ')}\n"


def contents(pages: Iterable[str]) -> str:
    """What lies below a page, in its order, for the navigation; it does not show on the page itself."""
    return "\n".join([".. toctree::\n   :hidden:\n", *(f"   {name}" for name in pages)]) + "\n"


def indexed(words: Iterable[str]) -> str:
    """Words by which the search finds a page first; they do not show on it."""
    entries = "".join(f"   ! single: {word}\n" for word in words)
    return f".. index::\n{entries}" if entries else ""


def page(*parts: str) -> str:
    """Parts one below the other."""
    return "\n".join(part.rstrip() + "\n" for part in parts if part.strip())
