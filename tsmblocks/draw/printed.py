"""A picture as a PNG or PDF file, by matplotlib."""

from __future__ import annotations

from collections.abc import Iterable, Mapping
from pathlib import Path
from typing import Any

from tsmblocks.common.errors import TsmError
from tsmblocks.draw.compose import layout
from tsmblocks.draw.picture import Box, Label, Picture, Wire
from tsmblocks.draw.style import ACCENT, ACCENT_FILL, FRAME, INK, PAPER, colour, marked, weight
from tsmblocks.model.diagram import Diagram, required_diagram

DPI = 100
POINT = 72 / DPI
"""One pixel of the picture in points, matplotlib's unit of lines and letters."""


def to_png(
    diagram: Diagram,
    path: str | Path,
    scale: float = 2,
    *,
    highlight: Iterable[str] = (),
    values: Mapping[str, Any] | None = None,
) -> None:
    """Draw a diagram into a PNG file.

    Parameters
    ----------
    diagram : Diagram
        What is drawn.
    path : str or Path
        File that is written; its name ends in ``.png``.
    scale : float, default 2
        Pixels of the file for each pixel of the SVG drawing.
    highlight : iterable of str, optional
        Names of blocks that are drawn in the accent colour (``"motor.slack"`` marks ``motor``). None by default.
    values : mapping of str to str or float, optional
        Signal (``"tsm.y"``) to the text or number that is written on its wire, a number with the unit of its port.
        None by default.

    Raises
    ------
    TsmError
        ``diagram`` is not a diagram, or has no block or signal of a name given; ``path`` has another ending;
        matplotlib is not installed.

    See Also
    --------
    to_svg, to_pdf : The same drawing in other formats.

    Examples
    --------
    >>> import tsmblocks as tsm
    >>> tsm.to_png(tsm.load("motor_linear"), "motor.png", scale=3)  # doctest: +SKIP
    """
    _fits(path, ".png")
    _figure(diagram, highlight, values, DPI * scale).savefig(
        Path(path), format="png", dpi=DPI * scale, metadata={"Software": None}
    )


def to_pdf(
    diagram: Diagram, path: str | Path, *, highlight: Iterable[str] = (), values: Mapping[str, Any] | None = None
) -> None:
    """Draw a diagram into a PDF file of one page, made of lines and letters that can be searched.

    Parameters
    ----------
    diagram : Diagram
        What is drawn.
    path : str or Path
        File that is written; its name ends in ``.pdf``.
    highlight : iterable of str, optional
        Names of blocks that are drawn in the accent colour (``"motor.slack"`` marks ``motor``). None by default.
    values : mapping of str to str or float, optional
        Signal (``"tsm.y"``) to the text or number that is written on its wire, a number with the unit of its port.
        None by default.

    Raises
    ------
    TsmError
        ``diagram`` is not a diagram, or has no block or signal of a name given; ``path`` has another ending;
        matplotlib is not installed.

    See Also
    --------
    to_svg, to_png : The same drawing in other formats.

    Examples
    --------
    >>> import tsmblocks as tsm
    >>> tsm.to_pdf(tsm.load("motor_linear"), "motor.pdf", highlight=["motor"])  # doctest: +SKIP
    """
    _fits(path, ".pdf")
    figure = _figure(diagram, highlight, values, DPI)
    import matplotlib

    with matplotlib.rc_context({"pdf.fonttype": 42}):  # letters that other programs can search and edit
        figure.savefig(Path(path), format="pdf", metadata={"CreationDate": None, "Creator": None, "Producer": None})


def _fits(path: str | Path, ending: str) -> None:
    if Path(path).suffix.lower() != ending:
        known = {".png": "to_png", ".pdf": "to_pdf", ".svg": "to_svg"}
        other = known.get(Path(path).suffix.lower())
        hint = f" That is what {other} makes." if other else ""
        raise TsmError(f"{known[ending]} writes {ending} files, got '{Path(path).name}'.{hint}")


def _figure(diagram: Diagram, highlight: Iterable[str], values: Mapping[str, Any] | None, dpi: float) -> Any:
    """A matplotlib figure of the drawing, in its size."""
    try:
        from matplotlib.figure import Figure
    except ImportError as error:
        how = 'pip install "tsmblocks[plots]"'
        raise TsmError(f"a PNG or PDF file needs matplotlib; install it with: {how}") from error
    accent = marked(required_diagram(diagram, "drawn", TsmError), highlight)
    picture = layout(diagram, values=values)
    figure = Figure(figsize=(picture.width / DPI, picture.height / DPI), dpi=dpi, facecolor=PAPER)
    axes = figure.add_axes((0.0, 0.0, 1.0, 1.0))
    axes.set(xlim=(0, picture.width), ylim=(picture.height, 0))
    axes.set_axis_off()
    _paint(axes, picture, accent)
    return figure


def _paint(axes: Any, picture: Picture, accent: set[str]) -> None:
    for wire in picture.wires:
        _wire(axes, wire)
    for box in picture.boxes:
        _box(axes, box, box.name in accent and box.shape != "terminal")
    for label in (*picture.labels, *(label for wire in picture.wires for label in wire.labels)):
        _text(axes, label)


def _text(axes: Any, label: Label, accent: bool = False) -> None:
    fill = ACCENT if accent and label.kind in ("name", "symbol") else colour(label.kind)
    font = dict(size=label.size * POINT, weight=weight(label.kind), family="DejaVu Sans")
    align = {"start": "left", "middle": "center", "end": "right"}[label.anchor]
    axes.text(
        label.x,
        label.y,
        label.text,
        ha=align,
        va="baseline",
        color=fill,
        zorder=5,
        parse_math=False,
        usetex=False,
        **font,
    )


def _line(axes: Any, points: Any, color: str, width: float, zorder: float) -> None:
    from matplotlib.lines import Line2D

    xs, ys = zip(*points, strict=True)
    axes.add_line(
        Line2D(
            xs, ys, color=color, linewidth=width * POINT, solid_joinstyle="round", solid_capstyle="butt", zorder=zorder
        )
    )


def _wire(axes: Any, wire: Wire) -> None:
    from matplotlib.patches import Circle, Polygon

    for line in wire.lines:
        _line(axes, line, INK, 1.4, 1)
    for arrow in wire.arrows:
        axes.add_patch(Polygon(arrow.corners, closed=True, facecolor=INK, edgecolor="none", zorder=2))
    for spot, fill in [(p, INK) for p in wire.dots] + [(p, PAPER) for p in wire.taps]:
        axes.add_patch(Circle(spot, 3, facecolor=fill, edgecolor=INK, linewidth=1.4 * POINT, zorder=2))


def _box(axes: Any, box: Box, accent: bool) -> None:
    from matplotlib.patches import Circle, FancyBboxPatch

    ink, fill = (ACCENT, ACCENT_FILL) if accent else (INK, PAPER)
    width = (2.4 if accent else 1.6) * POINT
    pen: dict[str, Any] = dict(facecolor=fill, edgecolor=ink, linewidth=width, zorder=3)
    if box.shape in ("round", "terminal"):
        axes.add_patch(Circle((box.x + box.width / 2, box.y + box.height / 2), box.width / 2, **pen))
    else:
        axes.add_patch(
            FancyBboxPatch(
                (box.x, box.y), box.width, box.height, boxstyle=f"round,pad=0,rounding_size={box.rim}", **pen
            )
        )
    if box.shape == "double":
        pen |= dict(facecolor="none", linewidth=POINT, zorder=4)
        width, height = box.width - 2 * FRAME, box.height - 2 * FRAME
        axes.add_patch(
            FancyBboxPatch((box.x + FRAME, box.y + FRAME), width, height, boxstyle="round,pad=0,rounding_size=1", **pen)
        )
    for stroke in box.strokes:
        _line(axes, stroke, ink, 1.2, 4)
    for label in box.labels:
        _text(axes, label, accent)
