"""Drawings: what a picture must keep whatever the diagram, and what its SVG, PNG and Mermaid must hold."""

from __future__ import annotations

import itertools
import os
import re
import subprocess
import sys
import xml.etree.ElementTree as ET
from unittest import mock

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

import tsmblocks as tsm
from tsmblocks.blocks import (
    PID,
    Constant,
    FirstOrderLag,
    Gain,
    MotorTransferFunction,
    Play,
    RateLimit,
    Saturation,
    SecondOrderLag,
    TransferFunction,
)
from tsmblocks.common.errors import TsmError
from tsmblocks.draw import layout, simplex, to_mermaid, to_pdf, to_png, to_svg
from tsmblocks.draw.detours import Detours
from tsmblocks.draw.faces import fraction, symbol_of, values_of
from tsmblocks.draw.picture import DARK, LIGHT, text_width
from tsmblocks.draw.tracks import Trunk, arrange
from tsmblocks.model.block import REGISTRY, Block, Input, Output, block, option, parameter
from tsmblocks.model.diagram import Diagram

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
        blocks={
            "ref": Source(),
            "ff": Plant(),
            "tip": Add(),
            "pid": Plant(),
            "total": Add(signs="++"),
            "error": Add(),
            "pi": Plant(),
            "motor": Plant(),
            "tsm": Plant(),
        },
        wires=[
            "ref -> ff, tip.u0",
            "tip -> pid -> total.u0",
            "ff -> total.u1",
            "total -> error.u0",
            "error -> pi -> motor -> tsm, error.u1",
            "tsm -> tip.u1",
        ],
        outputs={"x_ref": "ref", "x_in": "motor", "x_out": "tsm"},
    )


# ---- what holds of every picture


def overlap(a, b, slack=0.5):
    return a[0] < b[2] - slack and b[0] < a[2] - slack and a[1] < b[3] - slack and b[1] < a[3] - slack


def pieces(wire):
    for line in wire.lines:
        for a, b in itertools.pairwise(line):
            yield min(a[0], b[0]), min(a[1], b[1]), max(a[0], b[0]), max(a[1], b[1])


def through(piece, box):
    """Whether a line runs through a box; a circle may be passed within the corners of its square."""
    wide = (piece[0] - 0.01, piece[1] - 0.01, piece[2] + 0.01, piece[3] + 0.01)
    if not overlap(wide, box.extent, 0.1) or box.shape != "round":
        return overlap(wide, box.extent, 0.1)
    x, y = box.x + box.width / 2, box.y + box.height / 2
    nearest = min(max(x, piece[0]), piece[2]), min(max(y, piece[1]), piece[3])
    return np.hypot(nearest[0] - x, nearest[1] - y) < box.width / 2 - 0.1


def on(point, piece):
    return piece[0] <= point[0] <= piece[2] and piece[1] <= point[1] <= piece[3]


def texts(picture):
    return [*picture.labels, *(label for part in (*picture.boxes, *picture.wires) for label in part.labels)]


def assert_lawful(diagram, **options):
    picture = layout(diagram, **options)
    lines = [(wire.signal, piece) for wire in picture.wires for piece in pieces(wire)]
    for a, b in itertools.combinations(picture.boxes, 2):
        assert not overlap(a.extent, b.extent), f"{a.name} lies over {b.name}"
    for signal, piece in lines:
        assert piece[0] == piece[2] or piece[1] == piece[3], f"{signal} runs askew"
        for box in picture.boxes:
            assert not through(piece, box), f"{signal} runs through {box.name}"
    for (one, a), (two, b) in itertools.combinations(lines, 2):
        if one != two:
            assert_apart(one, a, two, b)
    assert_texts_readable(picture, lines)
    assert_connected(diagram, picture)
    frame = (0, 0, picture.width, picture.height)
    for extent in [o.extent for o in (*picture.boxes, *texts(picture))] + [p for _, p in lines]:
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
    for a, b in itertools.combinations(texts(picture), 2):
        assert not overlap(a.extent, b.extent), f"{a.text!r} lies over {b.text!r}"
    for text in texts(picture):
        assert text.size >= 9
        for signal, piece in lines:
            wide = (piece[0] - 0.6, piece[1] - 0.6, piece[2] + 0.6, piece[3] + 0.6)
            assert not overlap(wide, text.extent, 0.1), f"{signal} runs through {text.text!r}"
        for box in picture.boxes:
            if text not in box.labels:
                assert not overlap(text.extent, box.extent), f"{text.text!r} lies over {box.name}"


def assert_connected(diagram, picture):
    """Every link is drawn: the wire of its signal is one piece, from its source to arrows at its targets."""
    boxes = {(b.name, b.shape == "terminal"): b for b in picture.boxes}
    assert set(diagram.blocks) == {name for name, terminal in boxes if not terminal}
    drawn = {wire.signal: wire for wire in picture.wires}
    for signal, targets in wanted(diagram).items():
        wire = drawn[signal]
        assert targets <= set(wire.targets)
        assert len(wire.arrows) == len(wire.targets)
        name, _, port = signal.partition(".")
        assert any(touches(p, boxes[name, not port]) for line in wire.lines for p in line), signal
        assert joined(wire), f"{signal} is drawn in separate parts"
        for target in wire.targets:
            name, _, port = target.partition(".")
            box = boxes[name, not port]
            assert any(touches((a.x, a.y), box) for a in wire.arrows), f"{signal} misses {target}"


def wanted(diagram):
    found = {}
    for link in diagram.links:
        found.setdefault(".".join(link.source), set()).add(".".join(link.target))
    for name, ends in diagram.inlets.items():
        if ends:
            found.setdefault(name, set()).update(".".join(e) for e in ends)
    return found


def touches(point, box):
    x, y = point
    left, top, right, bottom = box.extent
    if box.shape == "round":
        return abs(np.hypot(x - (left + right) / 2, y - (top + bottom) / 2) - box.width / 2) < 0.1
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


KINDS = st.sampled_from(
    [
        Plant(),
        LongNamedElement(),
        *(Many(count=n) for n in (2, 3, 5)),
        *(Add(signs=signs) for signs in ("-", "+-", "++", "+-+", "+-+-", "++++-")),
        Times(),
        Source(),
        Scope(),
        INNER,
    ]
)
TITLES = st.sampled_from(["", "T", "A title that is a good deal longer than the picture"])


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
    outputs = {f"out{k}": s for k, s in enumerate(shown)}
    return Diagram(title=draw(TITLES), blocks=blocks, wires=wires, inputs=inputs, outputs=outputs)


@settings(deadline=None, max_examples=150)
@given(diagrams())
def test_every_picture_keeps_the_laws(diagram):
    assert_lawful(diagram)


@st.composite
def loops_beside_each_other(draw):
    """Two to four loops, some with a sensor in them, each fed by the reference or by a loop above it."""
    blocks, wires, ends, outputs = {"ref": Source()}, [], ["ref"], {}
    for k in range(draw(st.integers(2, 4))):
        chain = [f"plant{k}_{j}" for j in range(draw(st.integers(1, 4)))]
        signs = "+-" + draw(st.sampled_from(["", "+", "-"]))
        sensor = [f"sensor{k}"] * draw(st.booleans())
        blocks |= {f"error{k}": Add(signs=signs), **{name: Plant() for name in chain + sensor}}
        wires += [
            f"{draw(st.sampled_from(ends))} -> error{k}.u0",
            " -> ".join([f"error{k}", *chain]),
            " -> ".join([chain[-1], *sensor, f"error{k}.u1"]),
        ]
        wires += [f"{draw(st.sampled_from(ends + chain))} -> error{k}.u2"] * (len(signs) > 2)
        ends += chain
        outputs[f"y{k}"] = draw(st.sampled_from(chain))
    return Diagram(blocks=blocks, wires=wires, outputs=outputs)


@settings(deadline=None, max_examples=100)
@given(loops_beside_each_other())
def test_feedback_between_rows_keeps_the_laws(diagram):
    assert_lawful(diagram)


@settings(deadline=None, max_examples=40)
@given(diagrams(most=8), st.data())
def test_values_on_wires_keep_the_laws(diagram, data):
    names = [f"{n}.{p}" for n, b in diagram.blocks.items() for p in b.outports] + list(diagram.inputs)
    picked = data.draw(st.lists(st.sampled_from(names), max_size=5))
    picture = assert_lawful(diagram, values=dict.fromkeys(picked, 1.5))
    noted = {w.signal for w in picture.wires for t in w.labels if "1.5" in t.text}
    assert noted == set(picked)


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
    assert set(diagram.outputs) <= terminals | {t.text for t in root.iter(f"{SVG}text")} | tapped(root)


def tapped(root):
    """Names of outputs that are written on a wire."""
    texts = [t.text for g in root.iter(f"{SVG}g") if g.get("class") == "wire" for t in g.iter(f"{SVG}text")]
    return {name for text in texts for name in text.split(" = ")[0].split(", ")}


@given(diagrams())
@settings(deadline=None, max_examples=30)
def test_mermaid_lists_every_link(diagram):
    lines = to_mermaid(diagram).splitlines()
    arrows = [line.split() for line in lines if "-->" in line]
    pairs = sorted((line[0], line[-1]) for line in arrows)
    wanted_pairs = [(f"b_{a.source[0]}", f"b_{a.target[0]}") for a in diagram.links]
    wanted_pairs += [(f"in_{name}", f"b_{end[0]}") for name, ends in diagram.inlets.items() for end in ends]
    for name, (owner, port) in diagram.shown.items():
        wanted_pairs.append((f"b_{owner}" if owner else f"in_{port}", f"out_{name}"))
    assert pairs == sorted(wanted_pairs)


# ---- what a textbook figure looks like


def middle(picture, name, terminal=False):
    box = next(b for b in picture.boxes if b.name == name and (b.shape == "terminal") == terminal)
    return box.x + box.width / 2, box.y + box.height / 2


def lowest(wire):
    return max(p[1] for line in wire.lines for p in line)


def test_the_main_chain_is_straight_and_runs_to_the_right():
    picture = assert_lawful(cascade())
    chain = ["ref", "tip", "pid", "total", "error", "pi", "motor", "tsm"]
    spots = [middle(picture, name) for name in chain] + [middle(picture, "x_out", terminal=True)]
    assert len({y for _, y in spots}) == 1
    assert [x for x, _ in spots] == sorted(x for x, _ in spots)
    assert middle(picture, "ff")[1] < spots[0][1]


def test_feedback_runs_below_the_blocks_and_the_inner_loop_above_the_outer():
    picture = layout(cascade())
    wires = {w.signal: w for w in picture.wires}
    floor = max(b.y + b.height for b in picture.boxes)
    assert floor < lowest(wires["motor.y"]) < lowest(wires["tsm.y"])
    up = [a for w in ("motor.y", "tsm.y") for a in wires[w].arrows if (a.dx, a.dy) == (0, -1)]
    assert len(up) == 2  # both enter their sums from below
    assert all(len(wires[w].dots) == 1 for w in ("ref.y", "motor.y", "tsm.y"))


def test_signals_that_go_on_are_read_off_the_wire_and_the_last_one_ends_in_a_terminal():
    picture = layout(cascade())
    assert [b.name for b in picture.boxes if b.shape == "terminal"] == ["x_out"]
    texts = {t.text for w in picture.wires for t in w.labels}
    assert texts == {"x_ref", "x_in"}
    assert sum(len(w.taps) for w in picture.wires) == 2


def test_state_feedback_leaves_from_the_output_not_from_the_middle():
    observer = Diagram(
        title="Fig. 7",
        blocks={
            "forward": Plant(),
            "abs": Plant(),
            "times": Times(),
            "theta": Plant(),
            "delta": Plant(),
            "sum": Add(signs="+-+"),
            "zeta": Plant(),
        },
        wires=[
            "forward -> sum.u0",
            "abs -> times.u1, delta",
            "times -> theta -> sum.u1",
            "delta -> sum.u2",
            "sum -> zeta -> times.u2",
        ],
        inputs={"v": ["abs.u", "forward.u"]},
        outputs={"zeta_hat": "zeta"},
    )
    picture = assert_lawful(observer)
    order = ["abs", "times", "theta", "sum", "zeta"]
    assert [middle(picture, n)[0] for n in order] == sorted(middle(picture, n)[0] for n in order)
    assert "zeta_hat" in [b.name for b in picture.boxes if b.shape == "terminal"]


def test_a_sensor_stands_in_the_feedback_path_and_points_left():
    loop = Diagram(
        title="Sensor",
        blocks={"error": Add(), "plant": Plant(), "motor": Plant(), "sensor": Plant(), "filter": Plant()},
        wires=["error -> plant -> motor -> sensor -> filter -> error.u1"],
        inputs={"r": "error.u0"},
        outputs={"y": "motor"},
    )
    picture = assert_lawful(loop)
    x, y = middle(picture, "sensor")
    assert y > max(middle(picture, name)[1] for name in ("error", "plant", "motor"))
    assert y == middle(picture, "filter")[1]
    assert middle(picture, "filter")[0] < x
    sensor = box_of(picture, "sensor")
    (arrow,) = [a for w in picture.wires for a in w.arrows if touches((a.x, a.y), sensor)]
    assert (arrow.dx, arrow.dy) == (-1, 0)


def box_of(picture, name):
    return next(b for b in picture.boxes if b.name == name)


def test_signs_stand_beside_the_inputs_of_a_sum():
    tall = Diagram(
        blocks={"sum": Add(signs="+-+-")}, inputs={f"r{k}": f"sum.u{k}" for k in range(4)}, outputs={"y": "sum"}
    )
    for diagram, signs in ((tall, "++−−"), (INNER, "+−")):
        picture = assert_lawful(diagram)
        assert sorted(t.text for t in box_of(picture, "sum").labels if t.kind == "sign") == sorted(signs)
    assert box_of(layout(tall), "sum").shape == "tall"


def test_port_names_are_written_only_where_there_are_several():
    diagram = Diagram(
        blocks={"many": Many(count=2), "one": LongNamedElement(), "plant": Plant()},
        wires=["many.y -> one.a", "one.z -> plant"],
        inputs={"r": ["many.in0", "many.in1"]},
    )
    picture = assert_lawful(diagram)
    written = {b.name: [t.text for t in b.labels if t.kind == "port"] for b in picture.boxes}
    assert written == {"r": [], "many": ["in0", "in1", "y"], "one": ["z"], "plant": []}  # rate is not wired


def test_a_diagram_inside_is_framed_twice_and_says_what_it_is():
    outer = Diagram(title="Outer", blocks={"inner": INNER}, inputs={"r": "inner.r"}, outputs={"y": "inner.y"})
    box = box_of(assert_lawful(outer), "inner")
    assert box.shape == "double"
    assert "<loop>" in " ".join(t.text for t in box.labels)
    group = next(g for g in ET.fromstring(to_svg(outer)).iter(f"{SVG}g") if g.get("data-block") == "inner")
    assert len(list(group.iter(f"{SVG}rect"))) == 2


def test_a_diagram_without_blocks_is_a_title():
    picture = layout(Diagram(title="Nothing yet", blocks={}))
    assert [t.text for t in picture.labels] == ["Nothing yet"]
    ET.fromstring(to_svg(Diagram(blocks={})))


def test_a_symbol_with_a_fraction_is_stacked():
    assert fraction("1/(Ts+1)") == ("1", "Ts+1")
    assert fraction("(a+b)(c+d)/e") == ("(a+b)(c+d)", "e")
    assert fraction("F₊ / F₋") == ()
    assert fraction("a/b/c") == ()
    assert fraction("PID") == ()


def test_two_feedbacks_enter_a_sum_from_below_and_never_run_over_the_top():
    """The second one used to enter from above, by a wire around everything."""
    for signs in ("+--", "---"):
        fed = {"+--": {"inputs": {"r": "error.u0"}, "wires": []}, "---": {"wires": ["last -> error.u0"]}}[signs]
        wires = ["error -> first -> middle -> last -> error.u2", "middle -> error.u1", *fed["wires"]]
        blocks = {"error": Add(signs=signs), "first": Plant(), "middle": Plant(), "last": Plant()}
        picture = assert_lawful(
            Diagram(blocks=blocks, wires=wires, inputs=fed.get("inputs", {}), outputs={"y": "last"})
        )
        top = min(b.y for b in picture.boxes)
        assert all(y > top for w in picture.wires for line in w.lines for _, y in line)
        up = [a for w in picture.wires for a in w.arrows if (a.dx, a.dy) == (0, -1)]
        assert len({a.x for a in up}) == 2


def chain(count, back=()):
    """Blocks one behind the other, with feedback between places."""
    sums = {j for _, j in back}
    blocks = {f"b{k}": Add() if k in sums else Plant() for k in range(count)}
    wires = [f"b{k} -> b{k + 1}.{'u0' if k + 1 in sums else 'u'}" for k in range(count - 1)]
    wires += [f"b{i} -> b{j}.u1" for i, j in back]
    return Diagram(title="chain", blocks=blocks, wires=wires, inputs={"u": "b0"}, outputs={"y": f"b{count - 1}"})


def test_a_hundred_blocks_go_on_in_rows():
    """They used to make one row of 8,942 pixels."""
    picture = assert_lawful(chain(100, back=[(40, 30), (62, 12), (99, 3)]))
    assert picture.width <= 1800
    rows = sorted({b.y for b in picture.boxes if b.shape == "box"})
    assert 4 <= len(rows) <= 8
    assert picture.height < 2000
    assert layout(chain(5)) == layout(chain(5), wrap=5000)


def test_rows_are_as_even_as_they_can_be():
    for count in (20, 27, 45):
        blocks = [b for b in layout(chain(count), wrap=1000).boxes if b.shape == "box"]
        held = [sum(b.y == y for b in blocks) for y in sorted({b.y for b in blocks})]
        assert len(held) > 1
        assert max(held) - min(held) <= 1


@settings(deadline=None, max_examples=60)
@given(diagrams(), st.sampled_from([300, 500, 800]))
def test_drawings_in_rows_keep_the_laws(diagram, wrap):
    assert_lawful(diagram, wrap=wrap)


@settings(deadline=None, max_examples=40)
@given(loops_beside_each_other(), st.sampled_from([300, 500]))
def test_feedback_across_rows_keeps_the_laws(diagram, wrap):
    assert_lawful(diagram, wrap=wrap)


def test_feedback_across_rows_keeps_to_the_left_margin():
    """It used to run to the right end of each row and back, twice across the picture."""
    picture = assert_lawful(tsm.load("fig16_feedforward_feedback"), wrap=800)
    boxes = {box.name: box for box in picture.boxes if box.shape != "terminal"}
    assert len({boxes[name].y // 100 for name in ("pid", "controller", "motor")}) == 3
    for signal, target in (("tsm.y", "tip_error"), ("motor.y", "error")):
        wire = next(one for one in picture.wires if one.signal == signal)
        middle = boxes[target].x + boxes[target].width / 2
        above = [p for p in pieces(wire) if min(p[1], p[3]) < boxes["motor"].y]
        assert max(max(p[0], p[2]) for p in above) == pytest.approx(middle)
    assert crossings(picture) == 0


def test_feedback_from_within_a_row_that_is_passed_is_drawn_all_the_same():
    """A signal with a receiver in each row has a branch at which it cannot turn off to the margin."""
    loop = chain(9, back=[(8, 1), (8, 4)])
    for wrap in (500, 700, 900):
        assert_lawful(loop, wrap=wrap)
    nested_loops = chain(12, back=[(11, 1), (10, 2), (8, 5), (7, 6)])
    for wrap in (400, 600, 900):
        assert_lawful(nested_loops, wrap=wrap)


def crossings(picture):
    """How often wires of two signals cross."""
    lines = [(wire.signal, piece) for wire in picture.wires for piece in pieces(wire)]
    return sum(
        one != two
        and a[0] == a[2]
        and b[1] == b[3]
        and min(b[0], b[2]) < a[0] < max(b[0], b[2])
        and min(a[1], a[3]) < b[1] < max(a[1], a[3])
        for (one, a), (two, b) in itertools.permutations(lines, 2)
    )


@settings(deadline=None, max_examples=40)
@given(loops_beside_each_other(), st.sampled_from([300, 500]))
def test_wires_at_the_margin_cross_no_more_wires(diagram, wrap):
    with_margin = crossings(layout(diagram, wrap=wrap))
    with mock.patch.object(Detours, "of", lambda boxes, wires, starts, crossed: plain(len(starts))):
        assert with_margin <= crossings(layout(diagram, wrap=wrap))


def plain(rows):
    return Detours((frozenset(),) * rows, (frozenset(),) * rows)


@pytest.mark.parametrize(
    ("symbol", "said"),
    [
        ("(x-ζ̂)/αₓ", "(x−ζ̂)/αₓ"),
        ("e^(-Ts)", "e^(−Ts)"),
        ("u(t-T)", "u(t−T)"),
        ("T/(z-1)", "T/(z−1)"),
        ("Bouc-Wen", "Bouc-Wen"),
        ("table 2-D", "table 2-D"),
        ("on/off-switch", "on/off-switch"),
    ],
)
def test_a_minus_in_a_formula_is_no_hyphen(symbol, said):
    class Named:
        pass

    Named.symbol = symbol
    assert symbol_of(Named()) == said


def test_a_gain_is_a_triangle_with_its_number():
    loop = Diagram(
        blocks={"error": Add(), "gain": Gain(gain=-0.25), "plant": Plant(), "sensor": Gain(gain=123.456)},
        wires=["error -> gain -> plant -> sensor -> error.u1"],
        inputs={"r": "error.u0"},
        outputs={"y": "plant"},
    )
    picture = assert_lawful(loop)
    ahead, back = box_of(picture, "gain"), box_of(picture, "sensor")
    assert [t.text for t in ahead.labels if t.kind == "symbol"] == ["−0.25"]
    assert [t.text for t in back.labels if t.kind == "symbol"] == ["123.5"]
    assert ahead.corners[2][0] == ahead.x + ahead.width  # the tip, where the signal leaves
    assert back.corners[2][0] == back.x
    for box in (ahead, back):
        (text,) = [t for t in box.labels if t.kind == "symbol"]
        left, _, right, _ = text.extent
        top, bottom = text.y - 0.73 * text.size, text.y  # of digits
        (base, low), (_, high), (tip, y) = box.corners
        for x, edge in ((left, top), (right, top), (left, bottom), (right, bottom)):
            assert abs(edge - y) <= (low - high) / 2 * (tip - x) / (tip - base) + 0.5
    assert [t.text for t in box_of(layout(loop, parameters=False), "gain").labels if t.kind == "symbol"] == ["K"]


def test_blocks_show_the_values_of_their_parameters():
    def written(block):
        alone = Diagram(blocks={"b": block}, inputs={k: f"b.{k}" for k in block.inports})
        labels = box_of(layout(alone), "b").labels
        return [t.text for t in labels if t.kind == "symbol"]

    assert written(Constant(value=0.5)) == ["0.5"]
    assert written(Constant(value=np.pi / 6, unit="rad")) == ["30 deg"]
    assert written(TransferFunction(num=[2.0], den=[0.02, 1.0, 0.0])) == ["2", "0.02s²+s"]
    assert written(TransferFunction(num=[1.0, -3.0], den=[1.0, 0.0, 4e-7])) == ["s−3", "s²+4e−7"]
    assert written(FirstOrderLag(gain=3, time_constant=0.1)) == ["3", "0.1s+1"]
    assert written(MotorTransferFunction(K=2, tau=1)) == ["2", "s(s+1)"]
    assert written(SecondOrderLag(gain=1, omega=10, zeta=0.7))[-1] == "K 1, ω 10, ζ 0.7"
    assert written(Saturation(low=-24, high=24)) == ["sat", "−24 … 24"]
    assert written(PID(kp=1.5, ki=2, kd=0)) == ["PID", "kp 1.5, ki 2, kd 0"]
    assert written(TransferFunction(num=[1.0], den=[1.23456 + k for k in range(9)])) == ["b(s)", "a(s)"]  # too long


@pytest.mark.parametrize(
    ("block", "unit", "text"),
    [
        (Saturation(low=-24, high=24), "V", "−24 … 24 V"),
        (Saturation(low=-np.pi, high=np.pi), "rad", "−180 … 180 deg"),
        (Play(half_width=np.pi / 60), "rad", "± 3 deg"),
        (Play(half_width=0.05), "", "± 0.05"),
        (RateLimit(rising=np.pi, falling=-np.pi), "rad", "−180 … 180 deg/s"),
        (RateLimit(rising=5, falling=-5), "V", "−5 … 5 V/s"),
        (RateLimit(rising=5, falling=-5), "", "−5 … 5 /s"),
    ],
)
def test_values_are_shown_in_the_unit_of_their_signal(block, unit, text):
    source = Constant(value=1.0, **({"unit": unit} if unit else {}))
    diagram = Diagram(blocks={"source": source, "b": block}, wires=["source -> b"])
    labels = box_of(layout(diagram), "b").labels
    assert [t.text for t in labels if t.kind == "symbol"][-1] == text


def test_every_block_of_the_package_has_a_text_with_its_values():
    with_values = [kind for kind in REGISTRY.values() if kind.symbol_with_values]
    assert len(with_values) > 30
    for kind in with_values:
        text = values_of(kind(), lambda _: "")
        assert text, kind
        assert "{" not in text


def test_a_faulty_pattern_leaves_the_symbol():
    @block(register=False)
    class Own(Block):
        symbol = "own"
        symbol_with_values = "{size} of {nothing}"
        size: float = parameter(default=1.0, about="size")
        y = Output("any")

    (text,) = [t.text for t in box_of(layout(Diagram(blocks={"b": Own()})), "b").labels if t.kind == "symbol"]
    assert text == "own"


def test_long_names_are_written_in_full():
    """They used to be cut at some twenty characters."""
    long = "velocity_of_the_distal_end_in_the_workspace"
    diagram = Diagram(
        title="A title that says rather a lot. " * 4,
        blocks={long: Plant(), "sum": Add()},
        wires=[f"{long} -> sum.u1"],
        inputs={"reference_position_of_the_motor": ["sum.u0", f"{long}.u"]},
        outputs={"y": "sum"},
    )
    picture = assert_lawful(diagram)
    assert "".join(t.text for t in box_of(picture, long).labels if t.kind == "name") == long
    (terminal,) = [b for b in picture.boxes if b.name == "reference_position_of_the_motor"]
    assert "".join(t.text for t in terminal.labels) == terminal.name
    assert not any("…" in t.text for t in texts(picture))


def test_the_inside_of_a_diagram_is_drawn_on_request():
    outer = Diagram(title="Outer", blocks={"loop": INNER, "ref": Source()}, wires=["ref -> loop.r"])
    whole = Diagram(title="Whole", blocks={"axis": outer})
    picture = layout(whole, inside="axis.loop")
    assert {b.name for b in picture.boxes} == {b.name for b in layout(INNER).boxes}
    assert picture.title == "axis.loop: " + INNER.title
    assert layout(whole, inside="axis.loop", highlight=["plant"]) != picture
    with pytest.raises(TsmError, match=r"diagram 'Whole' has no diagram 'axes' inside. Did you mean 'axis'\?"):
        to_svg(whole, inside="axes")
    with pytest.raises(TsmError, match=r"'axis' of diagram 'Whole' has no diagram 'ref' inside. Known here: loop"):
        to_svg(whole, inside="axis.ref")


def contrast(one, two):
    """Contrast of two colours by WCAG 2.2."""

    def luminance(colour):
        parts = np.array([int(colour[k : k + 2], 16) / 255 for k in (1, 3, 5)])
        linear = np.where(parts <= 0.04045, parts / 12.92, ((parts + 0.055) / 1.055) ** 2.4)
        return linear @ [0.2126, 0.7152, 0.0722]

    high, low = sorted((luminance(one), luminance(two)), reverse=True)
    return (high + 0.05) / (low + 0.05)


@pytest.mark.parametrize("colours", [LIGHT, DARK])
def test_every_text_is_readable_in_both_themes(colours):
    for name in ("ink", "soft", "signal", "accent"):
        assert contrast(colours[name], colours["paper"]) >= 4.5
    assert contrast(colours["accent"], colours["accent-fill"]) >= 4.5


def test_a_drawing_follows_the_theme_and_stays_light_on_paper():
    """It used to be white on a dark page."""
    text = to_svg(cascade(), highlight=["tsm"])
    style = text.partition("<style>")[2].partition("</style>")[0]
    assert "@media screen and (prefers-color-scheme:dark)" in style
    drawn = text.partition("</style>")[2]
    used = set(re.findall(r"(?:fill|stroke)=\"(#\w+)\"", drawn))
    assert used == set(LIGHT.values())  # what a program without style sheets draws
    for colour in used:
        assert f'[fill="{colour}"]' in style
        assert f'[stroke="{colour}"]' in style
    light, dark = to_svg(cascade(), theme="light"), to_svg(cascade(), theme="dark")
    assert "<style" not in light + dark
    assert set(re.findall(r"#\w{6}", light)) <= set(LIGHT.values())
    assert set(re.findall(r"#\w{6}", dark)) <= set(DARK.values())
    with pytest.raises(TsmError, match=r"no theme 'drak'. Did you mean 'dark'\?"):
        to_svg(cascade(), theme="drak")


# ---- SVG, PNG, names


def test_the_same_diagram_gives_the_same_bytes():
    one = cascade()
    assert to_svg(one) == to_svg(cascade())
    assert to_svg(one) == to_svg(one._with(wires=list(reversed(one.links))))


DIGEST = """
import hashlib
from tsmblocks.draw import to_svg
from tsmblocks.files import load
from tsmblocks.files.shipped import shipped_names
print(hashlib.sha256("".join(to_svg(load(name)) for name in shipped_names()).encode()).hexdigest())
"""


def test_the_same_diagram_gives_the_same_bytes_in_every_session():
    made = {
        subprocess.run(
            [sys.executable, "-c", DIGEST], env={**os.environ, "PYTHONHASHSEED": seed}, check=True, capture_output=True
        ).stdout
        for seed in "0145"
    }
    assert len(made) == 1


def test_loops_beside_each_other_are_closed_in_their_own_rows():
    blocks = {"ref": Source()}
    wires = []
    for k in range(3):
        blocks |= {f"error{k}": Add(), f"plant{k}": Plant()}
        wires += [f"ref -> error{k}.u0", f"error{k} -> plant{k} -> error{k}.u1"]
    picture = layout(Diagram(blocks=blocks, wires=wires, outputs={f"y{k}": f"plant{k}" for k in range(3)}))
    tops = {b.name: b.y for b in picture.boxes}
    lows = [lowest(next(w for w in picture.wires if w.signal == f"plant{k}.y")) for k in range(3)]
    assert tops["plant0"] < lows[0] < tops["plant1"] < lows[1] < tops["plant2"] < lows[2]


def test_texts_are_escaped():
    diagram = Diagram(title='a < b & "c"', source="d > e & f", blocks={"ref": Source()})
    root = ET.fromstring(to_svg(diagram))
    texts = [t.text for t in root.iter(f"{SVG}text")]
    assert {'a < b & "c"', "d > e & f"} <= set(texts)
    assert root.get("aria-label") == 'a < b & "c"'


def test_svg_needs_nothing_from_outside():
    text = to_svg(cascade(), highlight=["tsm"], values={"x_out": 1.0})
    for word in ("<script", "<image", "url(", "@import", "href"):
        assert word not in text
    assert text.count("http") == 1  # the name of the SVG language


def test_highlight_colours_the_named_blocks_only():
    def inks(svg):
        groups = [g for g in ET.fromstring(svg).iter(f"{SVG}g") if g.get("data-block")]
        return {g.get("data-block"): next(iter(g.iter(f"{SVG}text"))).get("fill") for g in groups}

    plain, marked = inks(to_svg(cascade())), inks(to_svg(cascade(), highlight=["tsm"]))
    assert {name for name in plain if plain[name] != marked[name]} == {"tsm"}
    outer = Diagram(blocks={"inner": INNER, "ref": Source()}, wires=["ref -> inner.r"])
    assert to_svg(outer, highlight="inner.plant") == to_svg(outer, highlight=["inner"])
    with pytest.raises(TsmError, match=r"no block 'tms' to highlight. Did you mean 'tsm'\?"):
        to_svg(cascade(), highlight=["tms"])


def test_values_are_written_with_their_unit():
    picture = layout(cascade(), values={"tsm": -0.5, "x_in": 1.25, "ref.y": "start"})
    texts = {t.text for w in picture.wires for t in w.labels}
    assert texts == {"−0.5 rad", "x_in = 1.25 rad", "x_ref = start"}
    outer = Diagram(blocks={"inner": INNER, "ref": Source()}, wires=["ref -> inner.r"])
    assert layout(outer, values={"inner.plant.y": 3.0}) == layout(outer)  # out of sight
    with pytest.raises(TsmError, match=r"no signal 'pidd'.*Did you mean 'pid'\?"):
        layout(cascade(), values={"pidd": 1.0})
    with pytest.raises(TsmError, match="must be a number or text"):
        layout(cascade(), values={"pid": [1.0, 2.0]})


def test_png_has_the_size_of_the_picture(tmp_path):
    pytest.importorskip("matplotlib")
    from matplotlib.image import imread

    for scale in (1, 2):
        to_png(cascade(), tmp_path / "a.png", scale=scale, highlight=["tsm"], values={"pid": 1.0})
        picture = layout(cascade(), values={"pid": 1.0})
        pixels = imread(tmp_path / "a.png")
        assert np.allclose(pixels.shape[:2], (picture.height * scale, picture.width * scale), atol=1)
        assert pixels[..., :3].min() < 0.2
    to_png(Diagram(blocks={"inner": INNER}, inputs={"r": "inner.r"}), str(tmp_path / "b.png"))
    first = (tmp_path / "b.png").read_bytes()
    to_png(Diagram(blocks={"inner": INNER}, inputs={"r": "inner.r"}), str(tmp_path / "b.png"))
    assert first == (tmp_path / "b.png").read_bytes()


@pytest.mark.parametrize("scale", [0, -1, float("nan"), float("inf"), "2", None])
def test_png_needs_a_scale(scale, tmp_path):
    with pytest.raises(TsmError) as caught:
        to_png(tsm.load("motor_linear"), tmp_path / "d.png", scale)
    assert str(caught.value) == f"scale must be a positive number, got {scale!r}."


def test_png_larger_than_can_be_drawn(tmp_path, monkeypatch):
    motor = tsm.load("motor_linear")
    with pytest.raises(TsmError) as caught:
        to_png(motor, tmp_path / "d.png", 1000)
    assert str(caught.value) == (
        "a drawing of 502 by 178 is too large at scale 1000: at most 65,535 pixels are drawn in each direction. Take a "
        "smaller scale or wrap, or a PDF file."
    )
    monkeypatch.setattr("tsmblocks.common.memory.free_memory", lambda: 1e9)
    with pytest.raises(TsmError, match=r"drawing it would take 7.15 GB of memory, .* Take a smaller scale\."):
        to_png(motor, tmp_path / "d.png", 100)
    assert not list(tmp_path.iterdir())


@pytest.mark.parametrize(
    ("options", "text"),
    [
        ({"values": "x"}, """values must be a mapping by name, such as {"motor.y": 0.5}, got 'x'."""),
        ({"values": {1: 2}}, 'values takes names, such as {"motor.y": 0.5}, got 1.'),
        ({"values": {"x": 10**400}}, f"the value to write on 'x' must be a number or text, got 1{'0' * 58}…."),
        ({"loops": 1}, "loops takes algebraic loops or lists of the signals around each, got 1."),
        ({"loops": ["motor.y"]}, "loops takes algebraic loops or lists of the signals around each, got 'motor.y'."),
        ({"parameters": "no"}, "parameters must be True or False, got 'no'."),
        ({"inside": "."}, "diagram 'Motor as a linear transfer function' has no diagram '' inside. There are none."),
        ({"theme": []}, "there is no theme '[]'. Known here: auto, dark, light."),
    ],
)
def test_every_option_of_a_drawing_is_checked(options, text):
    with pytest.raises(TsmError) as caught:
        to_svg(tsm.load("motor_linear"), **options)
    assert str(caught.value) == text


def test_png_goes_into_png_files(tmp_path):
    with pytest.raises(TsmError) as error:
        to_png(cascade(), tmp_path / "motor.pdf")
    assert str(error.value) == ("to_png writes .png files, got 'motor.pdf'. That is what to_pdf makes.")
    with pytest.raises(TsmError, match=r"^to_pdf writes .pdf files, got 'motor.tex'.$"):
        to_pdf(cascade(), tmp_path / "motor.tex")
    assert list(tmp_path.iterdir()) == []


def test_pdf_has_one_page_of_the_picture_and_its_letters(tmp_path):
    pytest.importorskip("matplotlib")
    kept = [tmp_path / "a.pdf", tmp_path / "b.pdf"]
    for path in kept:
        to_pdf(cascade(), path, highlight=["tsm"], values={"pid": 1.0})
    picture, text = layout(cascade(), values={"pid": 1.0}), kept[0].read_bytes()
    assert text.startswith(b"%PDF")
    assert text.count(b"/Type /Page ") == 1
    box = [float(v) for v in re.search(rb"/MediaBox \[ ([\d. ]+) \]", text)[1].split()]
    assert box == pytest.approx([0, 0, 0.72 * picture.width, 0.72 * picture.height], abs=0.1)
    assert b"/FontFile2" in text
    assert b"/Subtype /Image" not in text
    assert text == kept[1].read_bytes()


def test_png_without_matplotlib_says_what_to_install(monkeypatch, tmp_path):
    monkeypatch.setitem(sys.modules, "matplotlib.figure", None)
    with pytest.raises(TsmError, match=r'pip install "tsmblocks\[plots\]"'):
        to_png(cascade(), tmp_path / "a.png")


def test_mermaid_codes_what_would_be_its_own_notation():
    diagram = Diagram(
        title='the "best" one',
        blocks={"end": INNER, "sum": Add()},
        wires=["end.y -> sum.u0"],
        inputs={"r": ["end.r", "sum.u1"]},
        outputs={"y": "sum"},
    )
    text = to_mermaid(diagram)
    assert text.startswith('---\ntitle: "the \\"best\\" one"\n---\nflowchart LR\n')
    assert '  b_end[["end<br/>Inner #60;loop#62; #38; more words than fit on a line"]]\n' in text
    assert '  b_end -->|"y → u0"| b_sum\n' in text


# ---- the parts


@settings(deadline=None, max_examples=100)
@given(st.data())
def test_simplex_finds_the_cheapest_positions(data):
    from scipy.optimize import linprog

    count = data.draw(st.integers(2, 8))
    pairs = [(k, k + 1) for k in range(count - 1)]
    two = st.tuples(st.integers(0, count - 1), st.integers(0, count - 1)).filter(lambda p: p[0] < p[1])
    pairs += data.draw(st.lists(two, max_size=12))
    least, weight = st.integers(-4, 6), st.integers(0, 9)
    rules = [simplex.Rule(u, v, data.draw(least), data.draw(weight)) for u, v in pairs]
    start = [0] * count
    for v in range(count):
        start[v] = max([start[r.tail] + r.least for r in rules if r.head == v], default=0)
    found = simplex.positions(count, rules, start)
    assert all(found[r.head] - found[r.tail] >= r.least for r in rules)
    rows = np.zeros((len(rules), count))
    for k, r in enumerate(rules):
        rows[k, r.tail], rows[k, r.head] = 1, -1
    cost = -rows.T @ [r.weight for r in rules]
    best = linprog(cost, rows, [-r.least for r in rules], bounds=[(None, None)] * count)
    assert np.dot(cost, found) == pytest.approx(best.fun, abs=1e-6)


def test_two_signals_that_change_places_are_kept_apart():
    trunks = arrange([Trunk("a", [0.0], [40.0]), Trunk("b", [40.0], [0.0])])
    assert len(trunks) == 3  # one goes over a height in between
    spans = {(t.owner, t.track, t.low, t.high) for t in trunks}
    assert len({track for _, track, _, _ in spans}) == 3


def test_text_widths_are_not_underestimated():
    pytest.importorskip("matplotlib")
    from matplotlib.font_manager import FontProperties, findfont
    from matplotlib.ft2font import FT2Font

    font = FT2Font(findfont(FontProperties(family="DejaVu Sans")))
    font.set_size(100, 72)
    for text in ("Feedforward plus PID feedback", "tip_error", "αₓ(v)x + ζ", "ζ̂ = 0.31 rad/s", "W" * 9, "il" * 9):
        font.set_text(text)
        assert text_width(text, 100) >= font.get_width_height()[0] / 64 * 0.99


@pytest.mark.parametrize("count", [3, 12, 24])
def test_signals_that_fan_into_one_block_do_not_cross(count):
    blocks = {"f": Many(count=count), **{f"c{k}": Plant() for k in range(count)}}
    fan = Diagram(
        title="fan",
        blocks=blocks,
        wires=[f"c{k} -> f.in{k}" for k in range(count)],
        inputs={"u": [f"c{k}.u" for k in range(count)]},
    )
    into = [list(pieces(wire)) for wire in assert_lawful(fan).wires if wire.signal != "u"]
    assert len(into) == count
    for (_, one), (_, two) in itertools.permutations([(n, p) for n, parts in enumerate(into) for p in parts], 2):
        crossed = one[0] < two[0] < one[2] and two[1] < one[1] < two[3]  # one lies flat, two stands upright
        assert not crossed
