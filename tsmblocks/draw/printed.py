"""A picture as a PNG or PDF file, by matplotlib."""

from __future__ import annotations

from collections.abc import Iterable, Mapping
from pathlib import Path
from typing import Any

from tsmblocks.common.arguments import is_number
from tsmblocks.common.atomic_write import replace_figure
from tsmblocks.common.errors import TsmError, in_words, without_controls
from tsmblocks.common.memory import refuse_too_large
from tsmblocks.draw.compose import WRAP, layout
from tsmblocks.draw.picture import FRAME, LIGHT, Box, Label, Picture, Point, Wire
from tsmblocks.model.diagram import Diagram

DPI = 100
POINT = 72 / DPI
"""One pixel of the picture in points, matplotlib's unit of lines and letters."""
MOST_PIXELS = 2**16 - 1
"""Pixels of a file in one direction. Chosen: as many as other programs show."""
PIXEL_BYTES = 8
"""Bytes of memory for a pixel. Derived: four of the canvas, and four of its copy that is written."""


def to_png(
    diagram: Diagram,
    path: str | Path,
    scale: float = 2,
    *,
    highlight: Iterable[str] = (),
    values: Mapping[str, Any] | None = None,
    loops: Iterable[Any] = (),
    inside: str = "",
    parameters: bool = True,
    wrap: float = WRAP,
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
        Names of blocks in the accent colour, as for ``to_svg``. None by default.
    values : mapping of str to str or float, optional
        Texts and numbers on wires, as for ``to_svg``. None by default.
    loops : iterable of LoopReport or of sequences of str, optional
        Algebraic loops in the accent colour, as for ``to_svg``. None by default.
    inside : str, optional
        Block that is a diagram, whose inside is drawn instead, as for ``to_svg``.
    parameters : bool, default True
        Whether blocks show the values of their parameters, else their symbols.
    wrap : float, default 1800
        Width of a row at most [pixels], as for ``to_svg``.

    Raises
    ------
    TsmError
        As for ``to_svg``; ``path`` has another ending; matplotlib is not installed.

    See Also
    --------
    to_svg, to_pdf : The same drawing in other formats.

    Examples
    --------
    >>> import tsmblocks as tsm
    >>> tsm.to_png(tsm.load("motor_linear"), "motor.png", scale=3)  # doctest: +SKIP
    """
    drawing: dict[str, Any] = dict(highlight=highlight, values=values, loops=loops)
    drawing |= dict(inside=inside, parameters=parameters, wrap=wrap)
    if not is_number(scale) or scale <= 0:
        raise TsmError(f"scale must be a positive number, got {in_words(scale)}.")
    _print(diagram, Path(path), ".png", DPI * scale, drawing, {"Software": None})


def to_pdf(
    diagram: Diagram,
    path: str | Path,
    *,
    highlight: Iterable[str] = (),
    values: Mapping[str, Any] | None = None,
    loops: Iterable[Any] = (),
    inside: str = "",
    parameters: bool = True,
    wrap: float = WRAP,
) -> None:
    """Draw a diagram into a PDF file of one page, made of lines and letters that can be searched.

    Parameters
    ----------
    diagram : Diagram
        What is drawn.
    path : str or Path
        File that is written; its name ends in ``.pdf``.
    highlight : iterable of str, optional
        Names of blocks in the accent colour, as for ``to_svg``. None by default.
    values : mapping of str to str or float, optional
        Texts and numbers on wires, as for ``to_svg``. None by default.
    loops : iterable of LoopReport or of sequences of str, optional
        Algebraic loops in the accent colour, as for ``to_svg``. None by default.
    inside : str, optional
        Block that is a diagram, whose inside is drawn instead, as for ``to_svg``.
    parameters : bool, default True
        Whether blocks show the values of their parameters, else their symbols.
    wrap : float, default 1800
        Width of a row at most [pixels], as for ``to_svg``.

    Raises
    ------
    TsmError
        As for ``to_svg``; ``path`` has another ending; matplotlib is not installed.

    See Also
    --------
    to_svg, to_png : The same drawing in other formats.

    Examples
    --------
    >>> import tsmblocks as tsm
    >>> tsm.to_pdf(tsm.load("motor_linear"), "motor.pdf", highlight=["motor"])  # doctest: +SKIP
    """
    drawing: dict[str, Any] = dict(highlight=highlight, values=values, loops=loops)
    drawing |= dict(inside=inside, parameters=parameters, wrap=wrap)
    _print(diagram, Path(path), ".pdf", DPI, drawing, dict.fromkeys(("CreationDate", "Creator", "Producer")))


def _print(
    diagram: Diagram, path: Path, ending: str, dpi: float, drawing: Mapping[str, Any], metadata: Mapping[str, None]
) -> None:
    """Write the file, in the size of the drawing; ``metadata`` left out so that equal diagrams give equal files."""
    known = {".png": "to_png", ".pdf": "to_pdf", ".svg": "to_svg"}
    found = path.suffix.lower()
    if found != ending:
        hint = f" That is what {known[found]} makes." if found in known else ""
        raise TsmError(f"{known[ending]} writes {ending} files, got '{path.name}'.{hint}")
    try:
        from matplotlib import rc_context
        from matplotlib.figure import Figure
    except ImportError as error:
        how = 'pip install "tsmblocks[plots]"'
        raise TsmError(f"a PNG or PDF file needs matplotlib; install it with: {how}") from error
    picture = layout(diagram, **drawing)
    scale = dpi / DPI
    size = PIXEL_BYTES * scale**2 * picture.width * picture.height
    if max(picture.width, picture.height) * scale > MOST_PIXELS:
        raise TsmError(
            f"a drawing of {picture.width:.0f} by {picture.height:.0f} is too large at scale {scale:g}: "
            f"at most {MOST_PIXELS:,} pixels are drawn in each direction. Take a smaller scale or wrap, or a PDF file."
        )
    refuse_too_large(size, "drawing it", "Take a smaller scale.", TsmError)
    figure = Figure(figsize=(picture.width / DPI, picture.height / DPI), dpi=dpi, facecolor=LIGHT["paper"])
    axes = figure.add_axes((0.0, 0.0, 1.0, 1.0))
    axes.set(xlim=(0, picture.width), ylim=(picture.height, 0))
    axes.set_axis_off()
    _paint(axes, picture)
    with rc_context({"pdf.fonttype": 42}):  # letters that other programs can search and edit
        replace_figure(path, figure, dpi=dpi, metadata=metadata)


def _paint(axes: Any, picture: Picture) -> None:
    for wire in picture.wires:
        _wire(axes, wire)
    for box in picture.boxes:
        _box(axes, box)
    for label in (*picture.labels, *(label for wire in picture.wires for label in wire.labels)):
        _text(axes, label)


def _text(axes: Any, label: Label, accent: bool = False) -> None:
    align = {"start": "left", "middle": "center", "end": "right"}[label.anchor]
    font = dict(size=label.size * POINT, weight=label.weight, family="DejaVu Sans", color=LIGHT[label.colour(accent)])
    plain = dict(parse_math=False, usetex=False)
    axes.text(label.x, label.y, without_controls(label.text), ha=align, va="baseline", zorder=5, **font, **plain)


def _line(axes: Any, points: Iterable[Point], color: str, width: float, zorder: float) -> None:
    from matplotlib.lines import Line2D

    pen: dict[str, Any] = dict(color=color, linewidth=width * POINT, zorder=zorder)
    axes.add_line(Line2D(*zip(*points, strict=True), solid_joinstyle="round", solid_capstyle="butt", **pen))


def _wire(axes: Any, wire: Wire) -> None:
    from matplotlib.patches import Circle, Polygon

    ink = LIGHT[wire.colour]
    for line in wire.lines:
        _line(axes, line, ink, 1.4, 1)
    for arrow in wire.arrows:
        axes.add_patch(Polygon(arrow.corners, closed=True, facecolor=ink, edgecolor="none", zorder=2))
    for spot, fill in [(p, ink) for p in wire.dots] + [(p, LIGHT["paper"]) for p in wire.taps]:
        axes.add_patch(Circle(spot, 3, facecolor=fill, edgecolor=ink, linewidth=1.4 * POINT, zorder=2))


def _box(axes: Any, box: Box) -> None:
    from matplotlib.patches import Circle, FancyBboxPatch, Polygon

    def frame(inset: float, rim: float, **pen: Any) -> None:
        width, height = box.width - 2 * inset, box.height - 2 * inset
        style = f"round,pad=0,rounding_size={rim}"
        axes.add_patch(FancyBboxPatch((box.x + inset, box.y + inset), width, height, boxstyle=style, **pen))

    ink, fill = (LIGHT[name] for name in box.colours)
    pen: dict[str, Any] = dict(facecolor=fill, edgecolor=ink, linewidth=(2.4 if box.accent else 1.6) * POINT, zorder=3)
    if box.shape in ("round", "terminal"):
        axes.add_patch(Circle((box.x + box.width / 2, box.y + box.height / 2), box.width / 2, **pen))
    elif box.shape == "triangle":
        axes.add_patch(Polygon(box.corners, closed=True, joinstyle="round", **pen))
    else:
        frame(0, box.rim, **pen)
    if box.shape == "double":
        frame(FRAME, 1, facecolor="none", edgecolor=ink, linewidth=POINT, zorder=4)
    for stroke in box.strokes:
        _line(axes, stroke, ink, 1.2, 4)
    for label in box.labels:
        _text(axes, label, box.accent)
