"""Drawings: what a picture must keep whatever the diagram, and what its SVG, PNG and Mermaid must hold."""

from __future__ import annotations

import itertools
import subprocess
import sys
import xml.etree.ElementTree as ET

import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from tsmblocks.block import Block, Input, Output, block, option
from tsmblocks.diagram import Diagram
from tsmblocks.draw import layout, to_mermaid, to_png, to_svg
from tsmblocks.errors import TsmError

SVG = "{http://www.w3.org/2000/svg}"


@block(register=False)
class Plant(Block):
    symbol = "K/(Ts+1)"
    u = Input("force")
    y = Output("place", "rad")


@block(register=False)
class LongNamedElement(Block):
    a = Input("first")
    rate = Input("its rate", rate_of="a")
    y = Output("one")
    z = Output("two")


@block(register=False)
class Many(Block):
    symbol = "f"
    count: int = option(default=3, about="inputs")
    y = Output("one")
    z = Output("two")

    @property
    def inports(self):
        return {f"in{k}": Input("any") for k in range(self.count)}


@block(register=False)
class Add(Block):
    symbol = "Σ"
    signs: str = option(default="+-", about="signs")
    y = Output("sum")

    @property
    def inports(self):
        return {f"u{k}": Input("term") for k in range(len(self.signs))}


@block(register=False)
class Times(Block):
    symbol = "×"
    u1 = Input("factor")
    u2 = Input("factor")
    y = Output("product")


@block(register=False)
class Source(Block):
    symbol = "sin"
    y = Output("any")


@block(register=False)
class Scope(Block):
    u = Input("any")


INNER = Diagram(
    title="Inner <loop> & more words than fit on a line",
    blocks={"sum": Add(), "plant": Plant()},
    wires=["sum -> plant -> sum.u1"],
    inputs={"r": "sum.u0"},
    outputs={"y": "plant", "e": "sum"},
)


def cascade() -> Diagram:
    """Fig. 16 in outline: two loops, one inside the other, and a path ahead."""
    return Diagram(
        title="Cascade",
        source="Fig. 16",
        blocks={"ref": Source(), "ff": Plant(), "tip": Add(), "pid": Plant(), "total": Add(signs="++"), "error": Add(),
                "pi": Plant(), "motor": Plant(), "tsm": Plant()},
        wires=["ref -> ff, tip.u0", "tip -> pid -> total.u0", "ff -> total.u1", "total -> error.u0",
               "error -> pi -> motor -> tsm, error.u1", "tsm -> tip.u1"],
        outputs={"x_ref": "ref", "x_in": "motor", "x_out": "tsm"},
    )  # fmt: skip


# ---- what holds of every picture


def overlap(a, b, slack=0.5):
    return a[0] < b[2] - slack and b[0] < a[2] - slack and a[1] < b[3] - slack and b[1] < a[3] - slack


def pieces(wire):
    for line in wire.lines:
        for a, b in itertools.pairwise(line):
            yield min(a[0], b[0]), min(a[1], b[1]), max(a[0], b[0]), max(a[1], b[1])


def on(point, piece):
    return piece[0] <= point[0] <= piece[2] and piece[1] <= point[1] <= piece[3]


def assert_lawful(diagram, **options):
    picture = layout(diagram, **options)
    lines = [(wire.signal, piece) for wire in picture.wires for piece in pieces(wire)]
    for a, b in itertools.combinations(picture.boxes, 2):
        assert not overlap(a.extent, b.extent), f"{a.name} lies over {b.name}"
    for signal, piece in lines:
        assert piece[0] == piece[2] or piece[1] == piece[3], f"{signal} runs askew"
        for box in picture.boxes:
            wide = (piece[0] - 0.01, piece[1] - 0.01, piece[2] + 0.01, piece[3] + 0.01)
            assert not overlap(wide, box.extent, 0.1), f"{signal} runs through {box.name}"
    for (one, a), (two, b) in itertools.combinations(lines, 2):
        if one != two:
            assert_apart(one, a, two, b)
    assert_texts_readable(picture, lines)
    assert_connected(diagram, picture)
    frame = (0, 0, picture.width, picture.height)
    for extent in [b.extent for b in picture.boxes] + [t.extent for t in picture.texts] + [p for _, p in lines]:
        assert overlap(extent, frame, -1)
        assert extent[0] >= 0
        assert extent[1] >= 0
        assert extent[2] <= frame[2]
        assert extent[3] <= frame[3]
    return picture


def assert_apart(one, a, two, b):
    """Two signals may cross; they may not run on one line, nor may one end or turn on the other."""
    for dim in (0, 1):
        if a[dim] == a[dim + 2] == b[dim] == b[dim + 2]:
            assert min(a[3 - dim], b[3 - dim]) < max(a[1 - dim], b[1 - dim]), f"{one} and {two} share a line"
    for first, second in ((a, b), (b, a)):
        for point in (first[:2], first[2:]):
            assert not on(point, second), f"{one} and {two} touch"


def assert_texts_readable(picture, lines):
    for a, b in itertools.combinations(picture.texts, 2):
        assert not overlap(a.extent, b.extent), f"{a.text!r} lies over {b.text!r}"
    for text in picture.texts:
        assert text.size >= 9
        for signal, piece in lines:
            assert not overlap((piece[0] - 0.6, piece[1] - 0.6, piece[2] + 0.6, piece[3] + 0.6), text.extent, 0.1), (
                f"{signal} runs through {text.text!r}")  # fmt: skip
        for box in picture.boxes:
            if text not in box.labels:
                assert not overlap(text.extent, box.extent), f"{text.text!r} lies over {box.name}"


def assert_connected(diagram, picture):
    """Every link is drawn: the wire of its signal is one piece, leaves its source and has an arrow at each target."""
    boxes = {(b.name, b.shape == "terminal"): b for b in picture.boxes}
    assert set(diagram.blocks) == {name for name, terminal in boxes if not terminal}
    drawn = {wire.signal: wire for wire in picture.wires}
    for signal, targets in wanted(diagram).items():
        wire = drawn[signal]
        assert targets <= set(wire.targets)
        assert len(wire.arrows) == len(wire.targets)
        name, _, port = signal.partition(".")
        assert any(touches(p, boxes[name, not port].extent) for line in wire.lines for p in line), signal
        assert joined(wire), f"{signal} is drawn in separate parts"
        for target in wire.targets:
            name, _, port = target.partition(".")
            box = boxes[name, not port]
            assert any(touches((a.x, a.y), box.extent) for a in wire.arrows), f"{signal} does not reach {target}"


def wanted(diagram):
    found = {}
    for link in diagram.links:
        found.setdefault(".".join(link.source), set()).add(".".join(link.target))
    for name, ends in diagram.inlets.items():
        if ends:
            found.setdefault(name, set()).update(".".join(e) for e in ends)
    return found


def touches(point, extent):
    x, y = point
    left, top, right, bottom = extent
    inside = left - 0.1 <= x <= right + 0.1 and top - 0.1 <= y <= bottom + 0.1
    return inside and min(abs(x - left), abs(x - right), abs(y - top), abs(y - bottom)) < 0.1


def joined(wire):
    parts = list(pieces(wire))
    seen, line = {0}, [0]
    for k in line:
        for other, piece in enumerate(parts):
            ends = [piece[:2], piece[2:], parts[k][:2], parts[k][2:]]
            if other not in seen and any(on(p, piece) and on(p, parts[k]) for p in ends):
                seen.add(other)
                line.append(other)
    return len(seen) == len(parts)


KINDS = st.sampled_from([Plant(), LongNamedElement(), Many(), Many(count=2), Many(count=5), Add(), Add(signs="++"), Add(signs="+-+"),
                         Add(signs="+-+-"), Add(signs="++++-"), Times(), Source(), Scope(), INNER])  # fmt: skip


@st.composite
def diagrams(draw, most=14):
    kinds = draw(st.lists(KINDS, min_size=1, max_size=most))
    names = [draw(st.sampled_from(["b", "gain", "a_rather_long_name_"])) + str(k) for k in range(len(kinds))]
    blocks = dict(zip(names, kinds, strict=True))
    inputs = {f"r{k}": [] for k in range(draw(st.integers(0, 3)))}
    sources = [f"{n}.{p}" for n, b in blocks.items() for p in b.outports]
    if not sources and not inputs:
        inputs = {"r": []}
    wires = []
    for name, kind in blocks.items():
        for port, spec in kind.inports.items():
            if getattr(spec, "rate_of", "") and draw(st.booleans()):
                continue
            driver = draw(st.sampled_from(sources + list(inputs)))
            if driver in inputs:
                inputs[driver].append(f"{name}.{port}")
            else:
                wires.append(f"{driver} -> {name}.{port}")
    shown = draw(st.lists(st.sampled_from(sources + list(inputs)), max_size=4))
    return Diagram(title=draw(st.sampled_from(["", "T", "A title that is a good deal longer than the picture"])),
                   blocks=blocks, wires=wires, inputs=inputs, outputs={f"out{k}": s for k, s in enumerate(shown)})  # fmt: skip


@settings(deadline=None, max_examples=150)
@given(diagrams())
def test_every_picture_keeps_the_laws(diagram):
    assert_lawful(diagram)


@settings(deadline=None, max_examples=40)
@given(diagrams(most=8), st.data())
def test_values_on_wires_keep_the_laws(diagram, data):
    names = [f"{n}.{p}" for n, b in diagram.blocks.items() for p in b.outports] + list(diagram.inputs)
    picked = data.draw(st.lists(st.sampled_from(names), max_size=5))
    picture = assert_lawful(diagram, values={name: 1.5 for name in picked})
    shown = {w.signal for w in picture.wires for t in w.labels if "1.5" in t.text}
    assert shown == {n for n in picked if n not in diagram.inputs or diagram.inlets[n] or n in diagram.outputs.values()} | (
        shown & set(picked))  # fmt: skip


@settings(deadline=None, max_examples=30)
@given(diagrams())
def test_svg_is_xml_that_holds_every_block_and_signal(diagram):
    root = ET.fromstring(to_svg(diagram))
    found = {g.get("data-block") for g in root.iter(f"{SVG}g")} - {None}
    assert found == set(diagram.blocks)
    signals = {g.get("data-signal") for g in root.iter(f"{SVG}g")} - {None}
    assert set(wanted(diagram)) <= signals
    terminals = {g.get("data-terminal") for g in root.iter(f"{SVG}g")} - {None}
    assert set(diagram.inputs) <= terminals
