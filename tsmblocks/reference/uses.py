"""Who uses a block: shipped diagrams and effects, and links from pictures to the pages of blocks."""

from __future__ import annotations

import functools
import re
from collections.abc import Iterator

import attrs

import tsmblocks.blocks as public_blocks
from tsmblocks.draw import layout, to_svg
from tsmblocks.effects.catalogue import catalogue
from tsmblocks.effects.effect import Effect
from tsmblocks.files import load
from tsmblocks.files.shipped import shipped_names
from tsmblocks.html.pages import part
from tsmblocks.model.block import Block
from tsmblocks.model.diagram import Diagram

ROWS = (600.0, 740.0)
"""Widths of the rows of a drawing on a card [pixels]."""
HIGHEST = 320.0
"""Height up to which a drawing is in such rows; a higher one is in one row, on a card as wide as the page [pixels]."""


@functools.cache
def shipped() -> dict[str, Diagram]:
    """Every ready-made diagram by name."""
    return {name: load(name) for name in shipped_names()}


def types_in(block: Block | Diagram) -> Iterator[str]:
    """Names of the classes of all blocks in a diagram, or of the one block."""
    if isinstance(block, Diagram):
        for inner in block.blocks.values():
            yield from types_in(inner)
    else:
        yield type(block).__name__


def diagrams_with(name: str) -> list[str]:
    """Shipped diagrams that hold a block of this class."""
    return [key for key, diagram in shipped().items() if name in types_in(diagram)]


@functools.cache
def effects() -> dict[str, list[Effect]]:
    """The variants of each effect of the toolbox, by name."""
    found: dict[str, list[Effect]] = {}
    for effect in catalogue():
        found.setdefault(effect.name, []).append(effect)
    return found


def effects_with(name: str) -> list[str]:
    """Effects that put a block of this class on a wire."""
    return [key for key, some in effects().items() if any(name in types_in(one.block) for one in some)]


def small_picture(diagram: Diagram) -> str:
    """The drawing of a diagram on a card, which has its title: in rows where these are few, and without numbers."""
    bare = attrs.evolve(diagram, title="", source="")
    for width in ROWS:
        drawn = layout(bare, parameters=False, wrap=width)
        if drawn.width <= width and drawn.height <= HIGHEST:
            return part("drawing", to_svg(bare, parameters=False, wrap=width), False)
    return part("drawing", to_svg(bare, parameters=False), True)


def linked_picture(diagram: Diagram, up: str = "../") -> str:
    """The drawing of a diagram, each block a link to its page; ``up`` is the way from the page to the root."""

    def linked(found: re.Match[str]) -> str:
        block = diagram.blocks.get(found[2])
        if type(block) is not getattr(public_blocks, type(block).__name__, None):  # a diagram, or a user's block
            return found[0]
        return f'<a href="{up}blocks/{type(block).__name__}.html">{found[0]}</a>'

    drawn = re.sub(r'<g class="[a-z]+" (data-block)="([^"]*)">.*?</g>', linked, to_svg(diagram), flags=re.DOTALL)
    return part("picture", drawn.replace('role="img"', 'role="group"', 1))  # an image has no links inside
