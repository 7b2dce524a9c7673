"""Texts from files: no control character reaches a terminal or a drawing, and long ones cost linear time."""

import json
import re
import time
import xml.etree.ElementTree as ET

import numpy as np
import pytest

import tsmblocks as tsm
from tsmblocks.blocks import Constant, FirstOrderLag, Gain
from tsmblocks.cli import main
from tsmblocks.common.errors import DataError
from tsmblocks.draw import to_mermaid, to_pdf, to_png, to_svg
from tsmblocks.draw.picture import fitted, text_width

EVIL = "a\x1b[31m\x07\x00\x9b31m\u202e\r]]>%%{init: {}}%%`x`<script>\"'&#\x7f"
EVIL_NAME = f"{EVIL}\ud800\uffff"
CONTROLS = re.compile("[\x00-\x08\x0b-\x1f\x7f-\x9f\u200e\u200f\u2028-\u202e\u2066-\u2069]")


def diagram():
    return tsm.Diagram(
        title=EVIL, source=EVIL, blocks={"g": Gain()}, inputs={"u": "g"}, outputs={"y": "g"}
    ).with_parameters({"g.gain": 2.0})


@pytest.mark.parametrize("draw", [to_svg, to_mermaid])
def test_drawings_have_no_control_characters(draw):
    text = draw(diagram())
    assert not CONTROLS.search(text)
    if draw is to_svg:
        ET.fromstring(text)


def test_mermaid_reads_no_notation_in_names_and_titles():
    inner = tsm.Diagram(title=EVIL, blocks={"g": Gain()}, inputs={"u": "g"}, outputs={"y": "g"})
    text = to_mermaid(tsm.Diagram(title=EVIL, blocks={"in": inner}, inputs={"u": "in.u"}, outputs={"y": "in.y"}))
    assert "%%" not in text
    title, *lines = [line for line in text.splitlines() if line not in ("---", "flowchart LR")]
    assert json.loads(title.removeprefix("title: ")) == CONTROLS.sub("�", EVIL)
    (block,) = [line for line in lines if "b_in[[" in line]
    shown = block.split('"')[1]
    assert not re.search(r"[<>&`|\\%]", re.sub(r"<br/>|#\d+;", "", shown))


def test_pages_have_no_control_characters():
    run = tsm.simulate(diagram(), stop=0.1, inputs={"u": 1.0})
    page = run._repr_html_()
    assert "script" in page
    assert not CONTROLS.search(page)
    assert "<script>\"'" not in page


@pytest.mark.parametrize("command", [["check"], ["run", "--stop", "0.1"], ["run", "--stop", "0.1", "--json"], ["draw"]])
def test_commands_print_no_control_characters(command, tmp_path, capsys, monkeypatch):
    monkeypatch.chdir(tmp_path)
    driven = tsm.Diagram(
        title=EVIL, source=EVIL, blocks={"g": Gain(), "one": Constant()}, wires=["one -> g"], outputs={"y": "g"}
    )
    tsm.save(driven, "evil.toml")
    name, *options = command
    main([name, "evil.toml", *options, *(["--out", "evil.svg"] if name == "draw" else [])])
    captured = capsys.readouterr()
    assert captured.out + captured.err
    assert not CONTROLS.search(captured.out + captured.err)
    if "--json" in options:
        assert json.loads(captured.out)


def test_headings_of_recordings_reach_no_message(tmp_path, capsys):
    path = tmp_path / "evil.csv"
    rows = "".join(f"{k / 10},{k},x\n" for k in range(20))
    path.write_text(f"t,\x1b[31mx\x9b,y\x1b]0;title\x07\n{rows}", encoding="utf-8")
    with pytest.raises(DataError) as caught:
        tsm.read(path, only=["x", "y\x1b]0;title\x07"])
    assert not CONTROLS.search(str(caught.value))
    main(["run", "tendon_sheath_linear", "--data", str(path), "--map", "x_in=\x1b[31mx"])
    captured = capsys.readouterr()
    assert captured.err
    assert not CONTROLS.search(captured.out + captured.err)


@pytest.mark.parametrize("draw", [to_svg, to_mermaid])
def test_halves_of_characters_and_what_xml_cannot_hold_are_replaced(draw):
    one = tsm.Diagram(title=EVIL_NAME, blocks={"g": Gain()}, inputs={"u": "g"}, outputs={"y": "g"})
    text = draw(one, values={"y": EVIL_NAME}) if draw is to_svg else draw(one)
    assert "\ufffd" in text
    if draw is to_svg:
        ET.fromstring(text.encode())


@pytest.mark.parametrize(("ending", "draw"), [("png", to_png), ("pdf", to_pdf)])
def test_files_of_pictures_have_no_letters_for_control_characters(ending, draw, tmp_path):
    draw(diagram(), tmp_path / f"evil.{ending}", values={"y": "a\x1bb"})  # a letter that is missing is a warning
    assert (tmp_path / f"evil.{ending}").stat().st_size > 1000


def test_a_recording_is_shown_without_control_characters_and_with_names_cut():
    record = tsm.Record("a\x1b", [0, 1, 2, 3], {EVIL_NAME: [0, 1, 2, 3], "y" * 10_000: [0, 1, 2, 3]}, {EVIL_NAME: EVIL})
    assert not CONTROLS.search(repr(record))
    assert len(repr(record).encode()) < 500


def test_values_in_files_stay_what_they_are():
    assert tsm.loads(tsm.dumps(diagram())) == diagram()
    assert diagram().title == EVIL


# ---- time


@pytest.mark.parametrize("width", [0.0, 5.0, 40.0, 123.4, 1000.0])
@pytest.mark.parametrize("text", ["", "word", "iiiiWWWW", "a b " * 30, "é" * 20 + "e\u0301" * 20, "漢字" * 20])
def test_a_text_is_cut_where_its_longest_beginning_fits(text, width):
    found = fitted(text, 12, width)
    if text_width(text, 12) <= width:
        assert found == text
        return
    fitting = [k for k in range(len(text) + 1) if text_width(text[:k] + "…", 12) <= width]
    assert found == text[: max(fitting, default=0)].rstrip() + "…"


def test_long_titles_and_names_take_linear_time():
    name = "n" * 5000
    began = time.monotonic()
    for title in ("w " * 5000, "w" * 5000):
        to_svg(tsm.Diagram(title=title, blocks={"g": Gain()}, inputs={"u": "g"}, outputs={"y": "g"}))
    made = tsm.Diagram(
        title="d",
        blocks={name: Gain(), f"{name}b": FirstOrderLag()},
        wires=[f"{name} -> {name}b"],
        inputs={f"{name}u": name},
        outputs={f"{name}y": f"{name}b"},
    )
    to_svg(made)
    tsm.loads(tsm.dumps(made))
    run = tsm.simulate(made, stop=0.01, inputs={f"{name}u": 1.0})
    assert str(run)
    assert np.isfinite(run[f"{name}y"]).all()
    assert time.monotonic() - began < 10  # 40 s before
