"""A picture as SVG text: self-contained, the same bytes for the same picture."""

from __future__ import annotations

from collections.abc import Iterable, Mapping
from html import escape
from typing import Any

from tsmblocks.common.errors import TsmError, near, without_controls
from tsmblocks.draw.compose import WRAP, layout
from tsmblocks.draw.picture import DARK, FRAME, LIGHT, Box, Label, Point, Wire
from tsmblocks.model.diagram import Diagram

FONT = "Helvetica, Arial, 'DejaVu Sans', sans-serif"
SMALLEST = 0.7
"""Scale below which a page lets the reader scroll rather than shrink a drawing further. Chosen: names of 8 pixels."""
THEMES = ("auto", "light", "dark")

Colours = Mapping[str, str]
"""Colours by what they mean."""


def _style() -> str:
    """Rules by which a drawing follows the colours of the screen or of its page; on paper it keeps the light ones.

    They select by the colours written in the drawing, so that a program without style sheets shows the light ones.
    """
    names = {name: f"--{name}:var(--diagram-{name},%s)" for name in LIGHT}
    light, dark = (";".join(names[name] % colours[name] for name in LIGHT) for colours in (LIGHT, DARK))
    rules = [f".block-diagram{{{light}}}", f"@media screen and (prefers-color-scheme:dark){{.block-diagram{{{dark}}}}}"]
    for name, colour in LIGHT.items():
        rules += [f'.block-diagram [{kind}="{colour}"]{{{kind}:var(--{name})}}' for kind in ("fill", "stroke")]
    rules.append("@media screen{.block-diagram:not(:root){min-width:var(--least)}}")
    return "".join(rules)


def to_svg(
    diagram: Diagram,
    *,
    highlight: Iterable[str] = (),
    values: Mapping[str, Any] | None = None,
    loops: Iterable[Any] = (),
    inside: str = "",
    parameters: bool = True,
    wrap: float = WRAP,
    theme: str = "auto",
) -> str:
    """Draw a diagram as SVG text, without external fonts or scripts.

    Signals flow from left to right, feedback runs below the blocks. A drawing that is wider than ``wrap`` goes on in
    rows below. The same diagram gives the same text.

    Parameters
    ----------
    diagram : Diagram
        What is drawn.
    highlight : iterable of str, optional
        Names of blocks that are drawn in the accent colour (``"motor.slack"`` marks ``motor``). None by default.
    values : mapping of str to str or float, optional
        Signal (``"tsm.y"``) to the text or number that is written on its wire, a number with the unit of its port.
        None by default.
    loops : iterable of LoopReport or of sequences of str, optional
        Algebraic loops (``run.loops``), whose wires are drawn in the accent colour; the signal for which each is solved
        is marked ↻. None by default.
    inside : str, optional
        Block that is a diagram, whose inside is drawn instead; ``"controller.observer"`` for one further inside.
    parameters : bool, default True
        Whether blocks show the values of their parameters, else their symbols.
    wrap : float, default 1800
        Width of a row at most [pixels]; one column of blocks may be wider.
    theme : {"auto", "light", "dark"}, default "auto"
        Colours: those of the reader's screen, or always light or dark. With ``"auto"`` the drawing is light on paper
        and in programs without style sheets; a page overrules them by ``--diagram-ink``, ``--diagram-paper``,
        ``--diagram-soft``, ``--diagram-signal``, ``--diagram-accent`` and ``--diagram-accent-fill``.

    Returns
    -------
    str
        One ``<svg>`` element.

    Raises
    ------
    TsmError
        ``diagram`` is not a diagram, or has no block, signal or diagram inside of a name given; there is no such
        theme.

    See Also
    --------
    to_png, to_pdf : The same drawing as a file.

    Examples
    --------
    >>> import tsmblocks as tsm
    >>> tsm.to_svg(tsm.load("motor_linear"), highlight=["motor"], values={"x": 0.5}).count("<rect")
    2
    """
    if theme not in THEMES:
        raise TsmError(f"there is no theme '{theme}'.{near(theme, THEMES)}")
    picture = layout(
        diagram, highlight=highlight, values=values, loops=loops, inside=inside, parameters=parameters, wrap=wrap
    )
    colours = DARK if theme == "dark" else LIGHT
    width, height = _n(picture.width), _n(picture.height)
    lines = [
        f'<svg xmlns="http://www.w3.org/2000/svg" class="block-diagram" width="{width}" height="{height}" '
        f'viewBox="0 0 {width} {height}" style="max-width:100%;height:auto;--least:{_n(SMALLEST * picture.width)}px" '
        f'role="img" aria-label={_quoted(picture.title or "block diagram")} font-family={_quoted(FONT)}>',
        *([f"<style>{_style()}</style>"] if theme == "auto" else []),
        f'<rect class="paper" width="100%" height="100%" rx="8" fill="{colours["paper"]}"/>',
        *(_text(label, colours) for label in picture.labels),
        *(_wire(wire, colours) for wire in picture.wires),
        *(_box(box, colours) for box in picture.boxes),
        "</svg>",
    ]
    return "\n".join(lines) + "\n"


def _n(value: float) -> str:
    return f"{value:.2f}".rstrip("0").rstrip(".")


def _escaped(text: str) -> str:
    return escape(without_controls(text), quote=False)


def _quoted(value: str) -> str:
    """The value of an attribute."""
    return '"' + _escaped(value).replace('"', "&quot;") + '"'


def _text(label: Label, colours: Colours, accent: bool = False) -> str:
    anchor = "" if label.anchor == "start" else f' text-anchor="{label.anchor}"'
    bold = f' font-weight="{label.weight}"' if label.weight != "normal" else ""
    return (
        f'<text x="{_n(label.x)}" y="{_n(label.y)}" font-size="{_n(label.size)}"{anchor}{bold} '
        f'fill="{colours[label.colour(accent)]}">{_escaped(label.text)}</text>'
    )


def _path(line: Iterable[Point]) -> str:
    return "M" + " L".join(f"{_n(x)} {_n(y)}" for x, y in line)


def _polygon(corners: Iterable[Point], rest: str) -> str:
    return f'<polygon points="{" ".join(f"{_n(x)},{_n(y)}" for x, y in corners)}" {rest}/>'


def _wire(wire: Wire, colours: Colours) -> str:
    ink, path = colours[wire.colour], " ".join(map(_path, wire.lines))
    parts = [f'<path d="{path}" fill="none" stroke="{ink}" stroke-width="1.4" stroke-linejoin="round"/>']
    parts += [_polygon(arrow.corners, f'fill="{ink}"') for arrow in wire.arrows]
    parts += [_circle(p, 3, f'fill="{ink}"') for p in wire.dots]
    parts += [_circle(p, 3, f'fill="{colours["paper"]}" stroke="{ink}" stroke-width="1.4"') for p in wire.taps]
    parts += [_text(label, colours) for label in wire.labels]
    return _group("wire", "data-signal", wire.signal, wire.about, parts)


def _circle(middle: Point, radius: float, rest: str) -> str:
    return f'<circle cx="{_n(middle[0])}" cy="{_n(middle[1])}" r="{_n(radius)}" {rest}/>'


def _group(kind: str, attribute: str, name: str, about: str, parts: list[str]) -> str:
    title = f"<title>{_escaped(about)}</title>" if about else ""
    return f'<g class="{kind}" {attribute}={_quoted(name)}>{title}{"".join(parts)}</g>'


def _box(box: Box, colours: Colours) -> str:
    ink, fill = (colours[name] for name in box.colours)
    pen = f'fill="{fill}" stroke="{ink}" stroke-width="{2.4 if box.accent else 1.6}"'
    if box.shape in ("round", "terminal"):
        parts = [_circle((box.x + box.width / 2, box.y + box.height / 2), box.width / 2, pen)]
    elif box.shape == "triangle":
        parts = [_polygon(box.corners, f'{pen} stroke-linejoin="round"')]
    else:
        parts = [_rect(box.x, box.y, box.width, box.height, f'rx="{_n(box.rim)}" {pen}')]
    if box.shape == "double":
        inner = f'rx="1" fill="none" stroke="{ink}" stroke-width="1"'
        parts.append(_rect(box.x + FRAME, box.y + FRAME, box.width - 2 * FRAME, box.height - 2 * FRAME, inner))
    parts += [f'<path d="{_path(stroke)}" stroke="{ink}" stroke-width="1.2"/>' for stroke in box.strokes]
    parts += [_text(label, colours, box.accent) for label in box.labels]
    attribute = "data-terminal" if box.shape == "terminal" else "data-block"
    return _group(box.shape, attribute, box.name, box.about, parts)


def _rect(x: float, y: float, width: float, height: float, rest: str) -> str:
    return f'<rect x="{_n(x)}" y="{_n(y)}" width="{_n(width)}" height="{_n(height)}" {rest}/>'
