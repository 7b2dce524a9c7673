"""The card of a block: its summary, equation, ports and parameters."""

from __future__ import annotations

import functools
from typing import Any

from markupsafe import Markup

from tsmblocks.common.tables import few
from tsmblocks.common.views import no_view
from tsmblocks.html.block_facts import words
from tsmblocks.html.card import card, rows
from tsmblocks.html.pages import part
from tsmblocks.model.block import Block

view = functools.singledispatch(no_view)
NAMESPACE = ' xmlns="http://www.w3.org/1998/Math/MathML"'
"""Namespace of a formula, which HTML does not need."""
LONGEST = 60
"""Characters of a value at most."""


@view.register
def block_card(block: Block) -> str:
    """A block: its first sentence, equation, ports and parameters, those that differ from their defaults in bold."""
    ports = [(k, "in", p.unit or "any", p.about) for k, p in block.inports.items()]
    ports += [(k, "out", p.unit or "any", p.about) for k, p in block.outports.items()]
    fields = type(block).fields()
    cells = [(k, _value(getattr(block, k)), f.unit, f.about) for k, f in fields.items()]
    own = ["named" if getattr(block, k) != f.default else "" for k, f in fields.items()]
    sentence, equation, _ = words(type(block))
    parts = [_formula(equation)] if equation else []
    parts += [rows(["l:port", "l:in or out", "l:unit", "l:what it is"], ports, "Ports")] if ports else []
    parts += (
        [rows(["l:parameter", "value", "l:unit", "l:what it is"], cells, "Parameters", own, most=30)] if cells else []
    )
    parts += [part("remark", f"Source: {block.source}")] if block.source else []
    return card(type(block).__name__, sentence, *parts)


def _formula(latex: str) -> Markup:
    """A formula that the browser typesets, or its LaTeX where latex2mathml is not installed."""
    try:
        from tsmblocks.html.mathml import mathml

        return Markup(f"<p>{mathml(latex, block=True).replace(NAMESPACE, '')}</p>")
    except ImportError:
        return Markup("<pre>{}</pre>").format(latex)


def _value(value: Any) -> str:
    if isinstance(value, tuple):
        return f"[{few([_value(v) for v in value], 4)}]"
    text = f"{value:g}" if isinstance(value, float) else str(value)
    return text if len(text) <= LONGEST else f"{text[:LONGEST]}…"
