"""A picture as SVG text: self-contained, the same bytes for the same picture."""

from __future__ import annotations

from collections.abc import Iterable, Mapping
from html import escape
from typing import Any

from tsmblocks.common.errors import TsmError
from tsmblocks.draw.compose import layout
from tsmblocks.draw.picture import Arrow, Box, Label, Point, Wire
from tsmblocks.draw.style import ACCENT, ACCENT_FILL, FONT, FRAME, INK, PAPER, colour, marked, weight
from tsmblocks.model.diagram import Diagram, required_diagram


def to_svg(diagram: Diagram, *, highlight: Iterable[str] = (), values: Mapping[str, Any] | None = None) -> str:
    """Draw a diagram as SVG text, without external fonts or scripts.

    Signals flow from left to right, feedback runs below the blocks. The background is white, so that the drawing is
    readable on a dark page too. The same diagram gives the same text.

    Parameters
    ----------
    diagram : Diagram
        What is drawn.
    highlight : iterable of str, optional
        Names of blocks that are drawn in the accent colour (``"motor.slack"`` marks ``motor``). None by default.
    values : mapping of str to str or float, optional
        Signal (``"tsm.y"``) to the text or number that is written on its wire, a number with the unit of its port.
        None by default.

    Returns
    -------
    str
        One ``<svg>`` element.

    Raises
    ------
    TsmError
        ``diagram`` is not a diagram, or has no block or signal of a name given.

    See Also
    --------
    to_png, to_pdf : The same drawing as a file.

    Examples
    --------
    >>> import tsmblocks as tsm
    >>> tsm.to_svg(tsm.load("motor_linear"), highlight=["motor"], values={"x": 0.5}).count("<rect")
    2
    """
    accent = marked(required_diagram(diagram, "drawn", TsmError), highlight)
    picture = layout(diagram, values=values)
    width, height = _n(picture.width), _n(picture.height)
    lines = [
        f'<svg xmlns="http://www.w3.org/2000/svg" width="{width}" height="{height}" '
        f'viewBox="0 0 {width} {height}" style="max-width:100%;height:auto" role="img" '
        f"aria-label={_quoted(picture.title or 'block diagram')} font-family={_quoted(FONT)}>",
        f'<rect class="paper" width="100%" height="100%" rx="8" fill="{PAPER}"/>',
        *(_text(label) for label in picture.labels),
        *(_wire(wire) for wire in picture.wires),
        *(_box(box, box.name in accent and box.shape != "terminal") for box in picture.boxes),
        "</svg>",
    ]
    return "\n".join(lines) + "\n"


def _n(value: float) -> str:
    return f"{value:.2f}".rstrip("0").rstrip(".")


def _quoted(value: str) -> str:
    """The value of an attribute."""
    return '"' + escape(value, quote=False).replace('"', "&quot;") + '"'


def _points(points: Iterable[Point]) -> str:
    return " ".join(f"{_n(x)},{_n(y)}" for x, y in points)


def _text(label: Label, accent: bool = False) -> str:
    anchor = "" if label.anchor == "start" else f' text-anchor="{label.anchor}"'
    bold = f' font-weight="{weight(label.kind)}"' if weight(label.kind) != "normal" else ""
    fill = ACCENT if accent and label.kind in ("name", "symbol") else colour(label.kind)
    return (
        f'<text x="{_n(label.x)}" y="{_n(label.y)}" font-size="{_n(label.size)}"{anchor}{bold} '
        f'fill="{fill}">{escape(label.text, quote=False)}</text>'
    )


def _wire(wire: Wire) -> str:
    path = " ".join("M" + " L".join(f"{_n(x)} {_n(y)}" for x, y in line) for line in wire.lines)
    parts = [f'<path d="{path}" fill="none" stroke="{INK}" stroke-width="1.4" stroke-linejoin="round"/>']
    parts += [_arrow(arrow) for arrow in wire.arrows]
    parts += [f'<circle cx="{_n(x)}" cy="{_n(y)}" r="3" fill="{INK}"/>' for x, y in wire.dots]
    parts += [
        f'<circle cx="{_n(x)}" cy="{_n(y)}" r="3" fill="{PAPER}" stroke="{INK}" stroke-width="1.4"/>'
        for x, y in wire.taps
    ]
    parts += [_text(label) for label in wire.labels]
    return _group("wire", "data-signal", wire.signal, wire.about, parts)


def _arrow(arrow: Arrow) -> str:
    return f'<polygon points="{_points(arrow.corners)}" fill="{INK}"/>'


def _group(kind: str, attribute: str, name: str, about: str, parts: list[str]) -> str:
    title = f"<title>{escape(about, quote=False)}</title>" if about else ""
    return f'<g class="{kind}" {attribute}={_quoted(name)}>{title}{"".join(parts)}</g>'


def _box(box: Box, accent: bool) -> str:
    parts = _outline(box, accent)
    parts += [
        f'<path d="M{_n(a[0])} {_n(a[1])} L{_n(b[0])} {_n(b[1])}" stroke="{ACCENT if accent else INK}" '
        f'stroke-width="1.2"/>'
        for a, b in box.strokes
    ]
    parts += [_text(label, accent) for label in box.labels]
    attribute = "data-terminal" if box.shape == "terminal" else "data-block"
    return _group(box.shape, attribute, box.name, box.about, parts)


def _outline(box: Box, accent: bool) -> list[str]:
    ink, fill = (ACCENT, ACCENT_FILL) if accent else (INK, PAPER)
    pen = f'fill="{fill}" stroke="{ink}" stroke-width="{2.4 if accent else 1.6}"'
    if box.shape in ("round", "terminal"):
        x, y = box.x + box.width / 2, box.y + box.height / 2
        return [f'<circle cx="{_n(x)}" cy="{_n(y)}" r="{_n(box.width / 2)}" {pen}/>']
    found = [_rect(box.x, box.y, box.width, box.height, f'rx="{_n(box.rim)}" {pen}')]
    if box.shape == "double":
        inner = f'rx="1" fill="none" stroke="{ink}" stroke-width="1"'
        width, height = box.width - 2 * FRAME, box.height - 2 * FRAME
        found.append(_rect(box.x + FRAME, box.y + FRAME, width, height, inner))
    return found


def _rect(x: float, y: float, width: float, height: float, rest: str) -> str:
    return f'<rect x="{_n(x)}" y="{_n(y)}" width="{_n(width)}" height="{_n(height)}" {rest}/>'
