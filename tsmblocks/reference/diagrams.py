"""Pages of the shipped diagrams: picture, blocks and parameters, response, the file."""

from __future__ import annotations

from typing import Any

from tsmblocks.blocks import MultiSine
from tsmblocks.common.units import heading
from tsmblocks.model.block import is_reference
from tsmblocks.model.diagram import Diagram
from tsmblocks.reference import figures, rst, uses
from tsmblocks.reference.blocks import default_text, unit

DRIVE = {
    "rad": MultiSine(unit="rad"),
    "V": MultiSine(amplitudes=(1.5, 1.5), unit="V"),
    "rad/s": MultiSine(unit="rad/s"),
}
"""Source at the input of an open diagram on its page, by unit."""
STOP, STEP = 20.0, 1e-3
PLOTTED = ("x_ref", "x_in", "x_out")
"""Outputs that belong into one chart, where a diagram has them."""


def pages() -> dict[str, str]:
    """Every page by its path, the index among them."""
    made = {f"diagrams/{name}": page(name, diagram) for name, diagram in uses.shipped().items()}
    rows = [
        (rst.link(f"/diagrams/{name}", name), rst.plain(d.title), rst.plain(d.source))
        for name, d in uses.shipped().items()
    ]
    index = rst.page(
        rst.heading("Diagrams"),
        "Files that come with the toolbox. ``tsm.load(NAME)`` and every command find them by name; a file of your own "
        "is given by its path.",
        rst.table(("Diagram", "What it is", "Source"), rows, (28, 40, 32)),
        rst.contents(uses.shipped()),
    )
    return {"diagrams/index": index, **made}


def page(name: str, diagram: Diagram) -> str:
    """The page of one diagram."""
    from tsmblocks.files.shipped import shipped_folder

    text = (shipped_folder() / f"{name}.toml").read_text(encoding="utf-8")
    return rst.page(
        rst.heading(name),
        f"{rst.plain(diagram.title)}.",
        f':Source: {rst.plain(diagram.source) or "definition"}\n:In Python: ``tsm.load("{name}")``\n'
        f":At the terminal: ``tsmblocks run {name}``"
        if not diagram.inputs
        else f':Source: {rst.plain(diagram.source) or "definition"}\n:In Python: ``tsm.load("{name}")``\n'
        f":At the terminal: ``tsmblocks run {name} --data FILE``, ``tsmblocks fit {name} --data FILE``",
        "Each block leads to its page.",
        rst.html(uses.linked_picture(diagram)),
        rst.html(_chart(diagram)),
        _edges(diagram),
        _blocks(diagram),
        _structure(diagram),
        rst.heading("The file", 1),
        rst.block(text, "toml"),
    )


def _chart(diagram: Diagram) -> str:
    from tsmblocks.plots.panels import shown
    from tsmblocks.simulation.simulate import simulate

    driven = Diagram(
        title=diagram.title,
        blocks={"diagram": diagram, **{k: DRIVE[v.unit] for k, v in diagram.inports.items()}},
        wires=[f"{k} -> diagram.{k}" for k in diagram.inputs],
        outputs={**{k: k for k in diagram.inputs}, **{k: f"diagram.{k}" for k in diagram.outputs}},
    )
    run = simulate(driven, stop=STOP, step=STEP)
    names = [k for k in driven.outputs if k in PLOTTED] or list(driven.outputs)
    if not set(names) & set(diagram.outputs):
        names = list(driven.outputs)
    values = {k: shown(run[k], driven.unit(k)) for k in names}
    labels = {k: heading(k, values[k][1]) for k in names}
    signals = {k: v for k, (v, _) in values.items()}
    drawn = [figures.over_time(run.t, signals, labels)]
    x = next(k for k in ("x_in", "x_ref", *names) if k in names)
    y = "x_out" if "x_out" in names else names[-1]
    if x != y:
        late = run.t >= STOP / 2
        drawn.append(figures.over_another(signals[x][late], signals[y][late], (labels[x], labels[y])))
    return figures.side_by_side(drawn, names)


def _edges(diagram: Diagram) -> str:
    rows = [
        (rst.code(k), "input", unit(v.unit), rst.words(v.about), ", ".join(map(rst.code, diagram.inputs[k].ports)))
        for k, v in diagram.inports.items()
    ]
    rows += [(rst.code(k), "output", unit(diagram.unit(k)), "", rst.code(diagram.outputs[k])) for k in diagram.outputs]
    head = ("Name", "", "Unit", "Meaning", "Drives, or shows")
    return rst.page(rst.heading("Inputs and outputs", 1), rst.table(head, rows, (16, 12, 10, 36, 26)))


def _blocks(diagram: Diagram) -> str:
    rows = []
    for name, block in diagram.blocks.items():
        if isinstance(block, Diagram):
            rows.append((rst.code(name), rst.plain(block.title), ""))
            continue
        said = [
            f"{k} = {_value(getattr(block, k))}{_unit(f.unit)}"
            for k, f in block.fields().items()
            if f.kind != "state" or getattr(block, k)
        ]
        kind = type(block).__name__
        rows.append((rst.code(name), rst.link(f"/blocks/{kind}", kind), ", ".join(said)))
    parts = [rst.heading("Blocks and parameters", 1), rst.table(("Name", "Block", "Parameters"), rows, (18, 26, 56))]
    if diagram.values:
        shared = ", ".join(f"``${k}`` = {v:.6g}" for k, v in diagram.values.items())
        parts.append(f"Values that several blocks share: {shared}.")
    return rst.page(*parts)


def _value(value: Any) -> str:
    return f"``{value}``" if is_reference(value) else default_text(value)


def _unit(label: str) -> str:
    return f" {rst.plain(label)}" if label and "?" not in label else ""


def _structure(diagram: Diagram) -> str:
    """Numbers of parameters, signals, states and memories of the whole."""
    from tsmblocks.simulation.compiled import equations

    eq = equations(diagram)
    items = [f"{_count(len(eq.p), 'parameter')} to be set, swept and fitted, {_count(len(eq.y), 'signal')} to look at."]
    items += [
        f"{_count(len(names), what)}: {', '.join(map(rst.code, names))}."
        for names, what in ((eq.x, "continuous state"), (eq.d, "memory"))
        if names
    ]
    if eq.periods:
        items.append(f"Sampled every {', '.join(f'{p:g} s' for p in eq.periods)}.")
    return rst.page(
        rst.heading("The equations", 1),
        "How they are formed: " + rst.link("/concepts/equations") + ".",
        rst.listed(items),
    )


def _count(number: int, what: str) -> str:
    """A number with its noun, in the plural where it is not one."""
    many = what if number == 1 else f"{what[:-1]}ies" if what.endswith("y") else f"{what}s"
    return f"{number} {many}"
