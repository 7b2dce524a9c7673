"""Colours and fonts, shared by the renderers of a picture."""

from __future__ import annotations

from collections.abc import Iterable

from tsmblocks.common.errors import TsmError, in_words, near
from tsmblocks.model.diagram import Diagram

PAPER, INK, SOFT = "#ffffff", "#1a1a1a", "#5a5a5a"
ACCENT, ACCENT_FILL, SIGNAL = "#c2410c", "#fff1e8", "#1d4ed8"
FONT = "Helvetica, Arial, 'DejaVu Sans', sans-serif"
FRAME = 4
"""Distance of the two frames around a diagram inside a diagram."""


def colour(kind: str) -> str:
    """Colour of a text."""
    return {"source": SOFT, "port": SOFT, "signal": SIGNAL, "terminal": SIGNAL}.get(kind, INK)


def weight(kind: str) -> str:
    """Weight of the font of a text."""
    return "bold" if kind in ("title", "sign") else "normal"


def marked(diagram: Diagram, names: Iterable[str]) -> set[str]:
    """Blocks to highlight; a name inside a block that is a diagram marks that block.

    Raises TsmError for any other name.
    """
    if not isinstance(names, Iterable):
        raise TsmError(f"highlight takes names of blocks, got {in_words(names)}.")
    names = (names,) if isinstance(names, str) else tuple(map(str, names))
    found = set()
    for name in names:
        head, dot, _ = name.partition(".")
        if head not in diagram.blocks or (dot and not isinstance(diagram.blocks[head], Diagram)):
            hint = near(name, diagram.blocks)
            raise TsmError(f"diagram '{diagram.title}' has no block '{name}' to highlight.{hint}")
        found.add(head)
    return found
