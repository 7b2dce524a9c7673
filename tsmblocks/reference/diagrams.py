"""Pages of the shipped diagrams: picture, blocks and parameters, response, the file."""

from __future__ import annotations

from typing import Any

from tsmblocks.blocks import MultiSine, Sine
from tsmblocks.common.headings import heading
from tsmblocks.files.shipped import shipped_folder
from tsmblocks.html.pages import part
from tsmblocks.model.block import is_reference
from tsmblocks.model.diagram import Diagram
from tsmblocks.plots.panels import shown
from tsmblocks.reference import figures, rst, uses
from tsmblocks.reference.blocks import default_text, unit
from tsmblocks.simulation.compiled import equations
from tsmblocks.simulation.simulate import simulate

DRIVE = {
    "rad": MultiSine(unit="rad"),
    "V": MultiSine(amplitudes=(1.5, 1.5), unit="V"),
    "rad/s": MultiSine(unit="rad/s"),
    "N*m": MultiSine(amplitudes=(6.0, 3.0), unit="N*m"),
}
"""Source at the input of an open diagram on its page, by unit."""
STOP, STEP = 20.0, 1e-3
STOPS, STEPS = {"two_tanks": 600.0}, {"sampled_position_loop": 2e-4, "two_tanks": 0.05}
"""Lengths of runs for which ``STOP`` is too short, and steps of those for which ``STEP`` is too long or short [s]."""
DRIVES = {"two_tanks": Sine(offset=3.0, amplitude=1.0, frequency=0.005, unit="V")}
"""Sources of diagrams whose input has to stay on one side of zero."""
PLOTTED = ("x_ref", "x_in", "x_out")
"""Outputs that belong into one chart, where a diagram has them."""


def pages() -> dict[str, str]:
    """Every page by its path, the index among them."""
    found = uses.shipped()
    cards = [(f"{name}.html", name, diagram.title, uses.small_picture(diagram)) for name, diagram in found.items()]
    index = rst.page(
        rst.heading("Diagrams"),
        rst.indexed(("Shipped diagrams", "Ready-made diagrams", "Library of diagrams")),
        "Files that come with the package. ``tsm.load(NAME)`` and every command find them by name; a file of your own "
        "is given by its path.",
        rst.html(part("gallery", cards)),
        rst.contents(found),
    )
    return {"diagrams/index": index, **{f"diagrams/{name}": page(name, diagram) for name, diagram in found.items()}}


def page(name: str, diagram: Diagram) -> str:
    """The page of one diagram."""
    data = f" --data FILE``, ``tsmblocks fit {name} --data FILE" if diagram.inputs else ""
    return rst.page(
        rst.heading(name),
        f"{rst.plain(diagram.title)}.",
        f':Source: {rst.plain(diagram.source) or "definition"}\n:In Python: ``tsm.load("{name}")``\n'
        f":At the terminal: ``tsmblocks run {name}{data}``",
        "Each block leads to its page.",
        rst.html(uses.linked_picture(diagram)),
        rst.html(_chart(name, diagram)),
        _edges(diagram),
        _blocks(diagram),
        _structure(diagram),
        rst.heading("The file", 1),
        rst.block((shipped_folder() / f"{name}.toml").read_text(encoding="utf-8"), "toml"),
    )


def _chart(name: str, diagram: Diagram) -> str:
    driven = Diagram(
        title=diagram.title,
        blocks={"diagram": diagram, **{k: DRIVES.get(name, DRIVE[v.unit]) for k, v in diagram.inports.items()}},
        wires=[f"{k} -> diagram.{k}" for k in diagram.inputs],
        outputs={**{k: k for k in diagram.inputs}, **{k: f"diagram.{k}" for k in diagram.outputs}},
    )
    stop = STOPS.get(name, STOP)
    run = simulate(driven, stop=stop, step=STEPS.get(name, STEP))
    names = [k for k in driven.outputs if k in PLOTTED]
    if not set(names) & set(diagram.outputs):
        names = list(driven.outputs)
    values = {k: shown(run[k], driven.unit(k)) for k in names}
    labels = {k: heading(k, unit) for k, (_, unit) in values.items()}
    signals = {k: v for k, (v, _) in values.items()}
    drawn = [figures.over_time(run.t, signals, labels)]
    x = next(k for k in ("x_in", "x_ref", *names) if k in names)
    y = "x_out" if "x_out" in names else names[-1]
    if x != y:
        late = run.t >= stop / 2
        drawn.append(figures.over_another(signals[x][late], signals[y][late], (labels[x], labels[y])))
    return figures.side_by_side(drawn, names)


def _edges(diagram: Diagram) -> str:
    rows: list[tuple[str, ...]] = [
        (rst.code(k), "input", unit(v.unit), rst.words(v.about), ", ".join(map(rst.code, diagram.inputs[k].ports)))
        for k, v in diagram.inports.items()
    ]
    rows += [(rst.code(k), "output", unit(diagram.unit(k)), "", rst.code(diagram.outputs[k])) for k in diagram.outputs]
    head, widths = ("Name", "Kind", "Unit", "Meaning", "Drives, or shows"), (16, 12, 10, 36, 26)
    kept = [k for k in range(len(head)) if any(row[k] for row in rows)]  # outputs alone have no meaning
    cells = [[row[k] for k in kept] for row in rows]
    return rst.section("Inputs and outputs", [head[k] for k in kept], cells, [widths[k] for k in kept])


def _blocks(diagram: Diagram) -> str:
    rows = []
    for name, block in diagram.blocks.items():
        if isinstance(block, Diagram):
            rows.append((rst.code(name), rst.plain(block.title), ""))
            continue
        values = [
            f"{k} = {_value(getattr(block, k), f.unit)}"
            for k, f in block.fields().items()
            if f.kind != "state" or getattr(block, k)
        ]
        kind = type(block).__name__
        rows.append((rst.code(name), rst.link(f"/blocks/{kind}", kind), ", ".join(values)))
    shared = ", ".join(f"``${k}`` = {v:.6g}" for k, v in diagram.values.items())
    return rst.page(
        rst.section("Blocks and parameters", ("Name", "Block", "Parameters"), rows, (18, 26, 56)),
        f"Values that several blocks share: {shared}." if shared else "",
    )


def _value(value: Any, unit: str) -> str:
    text = f"``{value}``" if is_reference(value) else default_text(value)
    return f"{text} {rst.plain(unit)}" if unit and "?" not in unit else text


def _structure(diagram: Diagram) -> str:
    """Numbers of parameters, signals, states and memories of the whole."""
    eq = equations(diagram)
    items = [f"{_count(len(eq.p), 'parameter')} to be set, swept and fitted, {_count(len(eq.y), 'signal')} to look at."]
    for names, what in ((eq.x, "continuous state"), (eq.d, "memory")):
        if names:
            items.append(f"{_count(len(names), what)}: {', '.join(map(rst.code, names))}.")
    if eq.periods:
        items.append(f"Sampled every {', '.join(f'{p:g} s' for p in eq.periods)}.")
    formed = f"How they are formed: {rst.link('/concepts/equations')}."
    return rst.page(rst.heading("The equations", 1), formed, rst.listed(items))


def _count(number: int, what: str) -> str:
    """A number with its noun, in the plural where it is not one."""
    many = what if number == 1 else f"{what[:-1]}ies" if what.endswith("y") else f"{what}s"
    return f"{number} {many}"
