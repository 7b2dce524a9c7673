"""Files that are wrong, by mistake or on purpose: every fault said once, with its line, and in time."""

# ruff: noqa: E501 - messages stand here as they are shown

import inspect
import os
import random
import re
import subprocess
import sys
import time

import pytest
from hypothesis import HealthCheck, given, settings
from hypothesis import strategies as st

from tsmblocks.blocks import Gain, Random
from tsmblocks.common.errors import MOST_PROBLEMS, DiagramError, FileError, ParameterError, TsmError, without_controls
from tsmblocks.files import dumps, faults, load, loads, positions, reader, save, toml_text
from tsmblocks.files.shipped import shipped_folder, shipped_names
from tsmblocks.files.toml_text import MOST_BYTES
from tsmblocks.model.block import REGISTRY, Block, Input, Output, block, option, parameter
from tsmblocks.model.diagram import Diagram, Inlet

SLOW_NEEDS = ["files"]
HANGS = 120
"""Seconds. All of it is a matter of seconds; this only tells a hang from a slow machine."""

GOOD = """\
format = 1
title = "position loop"

wires = [
  "ref -> error.plus",
  "error -> pid -> drive -> motor -> error.minus",
]

[blocks]
ref = { type = "Sine" }
error = { type = "Sum" }
pid = { type = "PID", kp = 1.5 }
drive = { type = "Saturation" }

[blocks.motor]
type = "FirstOrderLag"
gain = "$k"

[inputs]

[outputs]
angle = "motor"

[values]
k = 5.0
"""


def refused(text, where="loop.toml", **options):
    """The problems with which a text is refused, and the error."""
    with pytest.raises((FileError, DiagramError)) as caught:
        loads(text, where=where, **options)
    return list(caught.value.problems), caught.value


def changed(*pairs):
    text = GOOD
    for old, new in pairs:
        assert old in text
        text = text.replace(old, new, 1)
    return text


def test_the_file_that_is_spoilt_here_is_good():
    assert loads(GOOD).title == "position loop"


# ---- a table of mistakes: (what is changed into what, all that is said) ------------------------

MISTAKES = {
    "block type": ([('"PID"', '"PDI"')], ["12: block 'pid': there is no block type 'PDI'. Did you mean 'PID'?"]),
    "type not text": ([('"PID"', "3")], ["12: block 'pid': the type must be text such as \"Gain\", got 3."]),
    "no type": (
        [('type = "PID"', 'typ = "PID"')],
        [
            "12: block 'pid' has no type. Write { type = \"Gain\" }, or use = another diagram. Is 'typ' meant to be 'type'?"
        ],
    ),
    "parameter": ([("kp = 1.5", "kpp = 1.5")], ["12: block 'pid': PID has no parameter 'kpp'. Did you mean 'kp'?"]),
    "parameter in a section": (
        [('gain = "$k"', 'gian = "$k"')],
        ["17: block 'motor': FirstOrderLag has no parameter 'gian'. Did you mean 'gain'?"],
    ),
    "values of the wrong kind, all at once": (
        [("kp = 1.5", 'kp = "high", ki = true, kd = [1.0], tau = -1')],
        [
            "12: block 'pid': PID.kp must be a number, got 'high'.",
            "12: block 'pid': PID.ki must be a number, got True.",
            "12: block 'pid': PID.kd must be a number, got (1.0,).",
            "12: block 'pid': PID.tau must lie in (0, inf), got -1.",
        ],
    ),
    "a table for a number": ([("1.5", "{ a = 1 }")], ["12: block 'pid': PID.kp cannot be a table, got {'a': 1}."]),
    "a choice": (
        [('"Saturation"', '"Recorded", hold = "lineer"')],
        ["13: block 'drive': Recorded.hold is 'lineer', which is not a choice. Did you mean 'linear'?"],
    ),
    "values that do not go together": (
        [('"Saturation"', '"Saturation", low = 30')],
        ["13: block 'drive': Saturation needs low < high, got low=30, high=24."],
    ),
    "a date": ([("1.5", "1979-05-27")], ["12: pid.kp is a date or time (1979-05-27), and a number or text is needed."]),
    "a time": ([("5.0", "07:32:00")], ["25: values.k is a date or time (07:32:00), and a number or text is needed."]),
    "nan": ([("1.5", "nan")], ["12: pid.kp is nan, which is not a number."]),
    "nan in values": ([("5.0", "nan")], ["25: values.k is nan, which is not a number."]),
    "infinity": ([("1.5", "inf")], ["12: block 'pid': PID.kp must be finite, got inf."]),
    "a huge number": (
        [("1.5", "1" * 30)],
        ["12: pid.kp is a whole number too large to be held exactly; write it with a point or an exponent."],
    ),
    "a huge number in hex": (
        [("1.5", "0x" + "f" * 50_000)],
        ["12: pid.kp is a whole number too large to be held exactly; write it with a point or an exponent."],
    ),
    "a number of thousands of digits": ([("1.5", "9" * 6000)], ["12: a whole number has thousands of digits."]),
    "text in values": ([("5.0", '"5"')], ["25: value 'k' must be a number, got '5'."]),
    "true in values": ([("5.0", "true")], ["25: value 'k' must be a number, got True."]),
    "reference": ([("$k", "$kk")], ["15: motor: '$kk' refers to a number that is not in values. Did you mean 'k'?"]),
    "number a block refuses": (
        [('gain = "$k"', 'time_constant = "$k"'), ("5.0", "0.0")],
        ["15: motor: FirstOrderLag.time_constant must lie in (0, inf), got 0. From values: k = 0."],
    ),
    "wire to no block": (
        [('"ref -> error', '"ref -> errer')],
        ["5: wire 'ref -> errer.plus' names block 'errer', which is not in blocks. Did you mean 'error'?"],
    ),
    "wire to no port": (
        [("error.plus", "error.pluss")],
        ["5: wire 'ref -> error.pluss': error (Sum) has no input 'pluss'. Did you mean 'plus'?"],
    ),
    "no wire": (
        [('"ref ->', '"ref -')],
        ["5: wire 'ref - error.plus' is not a chain. Write source -> target, for example error -> pid.e."],
    ),
    "open input": (
        [('  "ref -> error.plus",\n', "")],
        ["10: error.plus (Sum) is driven by nothing. Wire it, list it under inputs, or drive it with a Constant."],
    ),
    "input driven twice": (
        [("[inputs]", '[inputs]\nr = "error.plus"')],
        ["20: error.plus is driven 2 times: ref.y -> error.plus; input r -> error.plus. Join them with a Sum block."],
    ),
    "wires that are not text": (
        [('"ref -> error.plus",', '3, ["a"],')],
        [
            "4: a wire must be text such as 'error -> pid', got 3.",
            "4: a wire must be text such as 'error -> pid', got ['a'].",
        ],
    ),
    "wires = 3": (
        [("wires = [", "wires = 3\nzz = [")],
        [
            '4: wires must be a list such as ["error -> pid -> drive"], got 3.',
            "5: 'zz' is not a key of a diagram. Known here: blocks, inputs, outputs, source, title, values, wires.",
        ],
    ),
    "misspelt section": (
        [("[outputs]", "[output]")],
        ["21: 'output' is not a key of a diagram. Did you mean 'outputs'?"],
    ),
    "misspelt wires": ([("wires = [", "wire = [")], ["4: 'wire' is not a key of a diagram. Did you mean 'wires'?"]),
    "misspelt values": ([("[values]", "[vaules]")], ["24: 'vaules' is not a key of a diagram. Did you mean 'values'?"]),
    "output": (
        [('"motor"', '"motr"')],
        ["22: output 'angle' names block 'motr', which is not in blocks. Did you mean 'motor'?"],
    ),
    "output not text": (
        [('"motor"', '["motor"]')],
        ["22: output 'angle' must name one signal, such as \"motor.y\", got ['motor']."],
    ),
    "input not text": ([("[inputs]", "[inputs]\na = 3")], ["20: input 'a' must name a port, or list several, got 3."]),
    "input without ports": (
        [("[inputs]", '[inputs]\na = { unit = "rad" }')],
        ["20: input 'a' needs ports, for example ports = \"motor.u\"."],
    ),
    "misspelt ports": (
        [("[inputs]", '[inputs]\na = { port = "motor" }')],
        ["20: 'port' is not a key of input 'a'. Did you mean 'ports'?"],
    ),
    "unit": (
        [("[inputs]", '[inputs]\na = { ports = [], unit = "radd" }')],
        ["20: input 'a': 'radd' is not a unit known here. Did you mean 'rad'?"],
    ),
    "unit that overflows": (
        [("[inputs]", '[inputs]\na = { ports = [], unit = "h^9*h^9*h^9*h^9" }')],
        ["20: input 'a': 'h^9*h^9*h^9*h^9' is not a unit known here: its size is out of range."],
    ),
    "input and block": (
        [("[inputs]", "[inputs]\nref = []")],
        ["20: 'ref' is both an input of the diagram and a block; give one of them another name."],
    ),
    "name": (
        [("[outputs]", '[outputs]\n"an angle" = "motor"')],
        ["22: output name 'an angle' must be letters, digits and underscores, not starting with a digit."],
    ),
    "title in the wrong place": (
        [("[blocks]", '[blocks]\ntitle = "loop"')],
        [
            "10: block 'title' must be a table such as { type = \"Gain\" }, got 'loop'."
            " To give the diagram's title, move the line above the first [section]."
        ],
    ),
    "title": ([('"position loop"', "3")], ["2: title must be text, got 3."]),
    "twice": (
        [('gain = "$k"', "gain = 1\ngain = 2")],
        ["18: 'blocks.motor.gain' is given a second time; the first is in line 17."],
    ),
    "block twice": (
        [("[blocks.motor]", "[blocks.pid]")],
        ["15: 'blocks.pid' is given a second time; the first is in line 12."],
    ),
    "section twice": ([("[inputs]", "[blocks]")], ["19: 'blocks' is given a second time; the first is in line 9."]),
    "bracket": (
        [("[blocks]", "[blocks")],
        ["9: this is not TOML: expected ']' at the end of a table declaration (column 8: [blocks)."],
    ),
    "quotation mark": (
        [('"Sine"', '"Sine')],
        [
            '10: this is not TOML: a text is not closed; it needs a quotation mark at its end (column 23: ref = { type = "Sine }).'
        ],
    ),
    "list not closed": ([("5.0", "[")], ["26: this is not TOML: invalid value (at the end)."]),
    "later format": (
        [("format = 1", "format = 2")],
        ["1: the format is 2; this version reads format = 1, at the top of the file."],
    ),
    "format true": (
        [("format = 1", "format = true")],
        ["1: the format is True; this version reads format = 1, at the top of the file."],
    ),
    "use upward": (
        [('type = "Sine"', 'use = "../secret"')],
        ["10: block 'ref': use = '../secret' is outside the folder of this file. Name a diagram next to it or below."],
    ),
    "use from the root": (
        [('type = "Sine"', 'use = "/etc/passwd"')],
        [
            "10: block 'ref': use = '/etc/passwd' is outside the folder of this file. Name a diagram next to it or below."
        ],
    ),
    "use of a drive": (
        [('type = "Sine"', 'use = "C:secret"')],
        ["10: block 'ref': use = 'C:secret' is outside the folder of this file. Name a diagram next to it or below."],
    ),
    "use of a misspelt diagram": (
        [('type = "Sine"', 'use = "fig7_observer"')],
        [
            "10: block 'ref': use = 'fig7_observer' is neither next to this file nor among the ready-made diagrams."
            " Did you mean 'fig07_observer'?"
        ],
    ),
    "use with other keys": (
        [('type = "Saturation"', 'use = "motor_linear", sett = { motor.K = 2.0 }')],
        ["13: 'sett' is not a key of block 'drive', which uses another diagram. Did you mean 'set'?"],
    ),
    "set of no parameter": (
        [('type = "Saturation"', 'use = "motor_linear", set = { motr.K = 2.0 }')],
        ["13: block 'drive': set: there is no parameter 'motr.K'. Did you mean 'motor.K'?"],
    ),
}


@pytest.mark.parametrize("mistake", MISTAKES)
def test_each_mistake_is_said_once_in_its_line(mistake):
    pairs, expected = MISTAKES[mistake]
    problems, error = refused(changed(*pairs))
    assert [re.sub(r" It is: [^.]*\.", "", problem) for problem in problems] == [f"loop.toml:{t}" for t in expected]
    assert "loop.toml" in str(error).split("\n")[0]


def test_a_number_that_is_refused_is_said_with_its_meaning():
    problems, _ = refused(changed(("kp = 1.5", "tau = -1")))
    assert problems[0].endswith("got -1. It is: time constant of the derivative filter [s].")


WITHOUT_A_LINE = {
    "empty": ("", "the file is empty. A diagram begins with format = 1 and has [blocks]."),
    "comments only": ("# to do\n\n", "the file is empty. A diagram begins with format = 1 and has [blocks]."),
    "no format": (
        changed(("format = 1\n", "")),
        "there is no format; this version reads format = 1, at the top of the file.",
    ),
    "no blocks": ("format = 1\n", "there are no [blocks]."),
}


@pytest.mark.parametrize("mistake", WITHOUT_A_LINE)
def test_what_is_missing_has_no_line(mistake):
    text, expected = WITHOUT_A_LINE[mistake]
    problems, _ = refused(text)
    assert problems == [f"loop.toml: {expected}"]


def test_all_faults_of_a_file_are_said_at_once_and_no_echoes():
    text = changed(
        ('"ref -> error.plus",', '"ref -> error.pluss",'),
        ('type = "PID", kp = 1.5', 'type = "PDI", kp = "high"'),
        ('{ type = "Saturation" }', '{ type = "Saturation", lwo = 1 }'),
        ('gain = "$k"', "gain = nan"),
        ('angle = "motor"', 'angle = "motor.x"\nother = "mtor"'),
    )
    problems, error = refused(text)
    assert type(error) is FileError
    assert [p.partition(": ")[0] for p in problems] == [f"loop.toml:{n}" for n in (5, 12, 13, 17, 23)]


def test_faults_of_the_wiring_alone_are_a_diagram_error():
    _, error = refused(changed(("error.plus", "error.pluss")))
    assert type(error) is DiagramError
    assert (error.diagram, error.where) == ("position loop", "loop.toml")
    _, error = refused(changed(("error.plus", "error.pluss"), ('title = "position loop"\n', "")))
    assert error.diagram == "loop"


@pytest.mark.parametrize("key", ["blocks", "inputs", "outputs", "values", "wires", "title", "source"])
@pytest.mark.parametrize(
    "value", ["3", "'a'", "[]", "[[]]", "{}", "true", "1979-05-27", "nan", "[{ a = 1 }]", "[1, 'a']"]
)
def test_any_kind_of_value_in_any_place_is_answered(key, value):
    rest = {"blocks": "[blocks]\na = { type = 'Constant' }\n", "outputs": "[outputs]\nx = 'a'\n"}
    rest.pop(key, None)
    text = f"format = 1\n{key} = {value}\n" + "".join(rest.values())
    try:
        loads(text, where="x.toml")
    except TsmError as error:
        lines = str(error).split("\n")
        assert len(lines) == 2 or (key, value) == ("wires", "[1, 'a']")
        assert lines[1].startswith(("  1. x.toml:2: ", "  1. x.toml:3: ", "  1. x.toml:4: "))
    else:
        assert value in ("{}", "[]", "'a'")


# ---- diagrams inside --------------------------------------------------------------------------


def test_faults_inside_are_named_by_their_whole_path():
    text = (
        "format = 1\n[blocks.motor]\nwires = ['limit -> missing']\n"
        "[blocks.motor.blocks]\nlimit = { type = 'Saturation', lo = 1 }\nlag = { type = 'FirstOrderLag', gain = nan }\n"
    )
    problems, _ = refused(text)
    assert problems == [
        "loop.toml:3: wire 'limit -> missing' names block 'missing', which is not in blocks. Known here: lag, limit.",
        "loop.toml:5: block 'motor.limit': Saturation has no parameter 'lo'. Did you mean 'low'?",
        "loop.toml:6: motor.lag.gain is nan, which is not a number.",
    ]


def test_faults_of_a_used_file_carry_its_name(tmp_path):
    (tmp_path / "part.toml").write_text("format = 1\n[blocks]\n\ng = { type = 'Gian' }\n")
    (tmp_path / "broken.toml").write_text("format = 1\n[blocks\n")
    text = (
        "format = 1\nwires = ['a -> b']\n[blocks]\na = { use = 'part' }\nb = { use = 'part' }\nc = { use = 'broken' }\n"
    )
    problems, _ = refused(text, folder=tmp_path)
    assert problems == [
        f"{tmp_path}/part.toml:4: block 'g': there is no block type 'Gian'. Did you mean 'Gain'?",
        f"{tmp_path}/broken.toml:2: this is not TOML: expected ']' at the end of a table declaration (column 8: [blocks).",
    ]


def test_files_that_use_each_other_are_shown_as_a_ring(tmp_path):
    for name, other in (("a", "b"), ("b", "c"), ("c", "a"), ("start", "a")):
        (tmp_path / f"{name}.toml").write_text(f"format = 1\n[blocks]\nx = {{ use = '{other}' }}\n")
    with pytest.raises(FileError) as caught:
        load(tmp_path / "start.toml")
    assert caught.value.problems == (
        f"{tmp_path}/c.toml:3: block 'x': the files use each other in a cycle: a.toml -> b.toml -> c.toml -> a.toml.",
    )
    (tmp_path / "a.toml").write_text("format = 1\n[blocks]\nx = { use = 'a' }\n")
    with pytest.raises(FileError, match=r"a\.toml:3: block 'x': .* in a cycle: a\.toml -> a\.toml\."):
        load(tmp_path / "a.toml")


def test_a_hundred_levels_of_files_are_refused(tmp_path):
    for k in range(100):
        (tmp_path / f"f{k}.toml").write_text(f"format = 1\n[blocks]\nx = {{ use = 'f{k + 1}' }}\n")
    with pytest.raises(FileError) as caught:
        load(tmp_path / "f0.toml")
    assert caught.value.problems == (f"{tmp_path}/f63.toml:3: diagrams are nested more than 64 deep.",)


def test_a_hundred_levels_in_one_file_are_refused():
    text = "format = 1\n" + "".join(f"[{'.'.join(['blocks.x'] * k)}]\nwires = []\n" for k in range(1, 78))
    problems, _ = refused(text)
    assert problems == ["loop.toml:128: diagrams are nested more than 64 deep."]


def test_few_files_cannot_add_up_to_billions_of_blocks(tmp_path):
    for k in range(40):
        uses = "".join(f"x{n} = {{ use = 'f{k + 1}' }}\n" for n in range(10))
        (tmp_path / f"f{k}.toml").write_text(f"format = 1\n[blocks]\n{uses}")
    (tmp_path / "f40.toml").write_text("format = 1\n[blocks]\na = { type = 'Constant' }\n")
    began = time.perf_counter()
    with pytest.raises(FileError) as caught:
        load(tmp_path / "f0.toml")
    assert len(caught.value.problems) == 1
    assert "there are 200,000 blocks, with those of the diagrams in use; at most 100,000 are read." in str(caught.value)
    assert time.perf_counter() - began < HANGS


def test_what_is_no_text_and_no_diagram_is_said():
    assert refused(b"format = 1")[0] == ["loads takes the text of a diagram, got b'format = 1'. For a file, use load."]
    with pytest.raises(FileError, match=r"only a Diagram can be written, got 'a\.toml'\."):
        dumps("a.toml")


# ---- files that cannot be read ----------------------------------------------------------------


def fault_of(path):
    with pytest.raises(FileError) as caught:
        load(path)
    (problem,) = caught.value.problems
    return problem


def test_a_misspelt_name_is_answered_with_a_near_one():
    assert fault_of("fig16_feedforward_fedback") == (
        "there is no file 'fig16_feedforward_fedback', and no ready-made diagram of that name."
        " Did you mean 'fig16_feedforward_feedback'?"
    )


def test_a_name_that_is_near_to_none_is_answered_with_where_they_are_listed():
    assert fault_of("slider").startswith(
        "there is no file 'slider', and no ready-made diagram of that name. Known here: "
    )
    assert fault_of("slider").endswith(f", … ({len(shipped_names())} in all). `tsmblocks diagrams` lists them.")


def test_a_misspelt_file_is_answered_with_a_near_one(tmp_path):
    (tmp_path / "loop.toml").write_text(GOOD)
    assert fault_of(tmp_path / "lop.toml") == f"{tmp_path}/lop.toml: there is no such file. Did you mean 'loop.toml'?"
    assert fault_of(tmp_path / "no" / "x.toml") == f"{tmp_path}/no/x.toml: there is no such file."


def test_a_name_without_its_ending_is_helped(tmp_path, monkeypatch):
    monkeypatch.chdir(tmp_path)
    (tmp_path / "mine.toml").write_text(GOOD)
    assert fault_of("mine") == "'mine' is not among the ready-made diagrams. For the file, write 'mine.toml'."


def test_a_folder_is_not_a_file(tmp_path):
    assert fault_of(tmp_path) == f"{tmp_path}: this is a folder, and a file is needed."


@pytest.mark.skipif(not os.path.exists("/dev/zero"), reason="needs a device that never ends")
def test_a_device_is_not_a_file():
    assert fault_of("/dev/zero") == "/dev/zero: there is no such file."


@pytest.mark.parametrize("name", ["", "  ", "a\0b", "x" * 5000, "x" * 5000 + ".toml", 3, None, b"motor_linear"])
def test_what_is_no_name_is_said(name):
    assert len(fault_of(name)) < 400


def test_a_file_that_may_not_be_read(tmp_path, monkeypatch):
    from pathlib import Path

    (tmp_path / "a.toml").write_text(GOOD)
    monkeypatch.setattr(Path, "open", lambda *_: (_ for _ in ()).throw(PermissionError(13, "Permission denied")))
    assert fault_of(tmp_path / "a.toml") == f"{tmp_path}/a.toml: cannot be read: permission denied."


@pytest.mark.parametrize(
    ("data", "said"),
    [
        (
            b"format = 1\ntitle = '\xe9'\n",
            ":2: the text is not UTF-8 (byte 0xe9 is not allowed in it). Save it as UTF-8.",
        ),
        (GOOD.encode("utf-16"), ":1: the text is not UTF-8 (it seems to be UTF-16). Save it as UTF-8."),
        (b"format = 1\x00\n", ":1: this is not TOML: expected newline or end of document after a statement"),
        (b"format = 1\rtitle = 'old'\r", ":1: this is not TOML: expected newline or end of document after a statement"),
        (b"\x7fELF\x02\x01\x01", ":1: this is not TOML: invalid statement"),
        (b"", ": the file is empty."),
    ],
)
def test_bytes_that_are_no_text(tmp_path, data, said):
    path = tmp_path / "a.toml"
    path.write_bytes(data)
    assert fault_of(path).startswith(f"{path}{said}")


def test_a_file_cannot_steer_the_terminal():
    _, error = refused('format = 1\ntitle = 3\n"\\u001b[31m\\u202e" = 1\n[blocks]\n')
    assert all(c.isprintable() or c == "\n" for c in str(error))


# ---- size -------------------------------------------------------------------------------------

MANY = {
    "wires of no block": lambda n: "format = 1\nblocks = {}\nwires = [\n" + '"a -> b",\n' * n(90_000) + "]\n",
    "a million wires": lambda n: "format = 1\nblocks = {}\nwires = [\n" + '"aaa -> b",\n' * n(1_000_000) + "]\n",
    "one wire of ten megabytes": lambda n: 'format = 1\nblocks = {}\nwires = ["' + "a->" * n(3_500_000) + 'b"]\n',
    "a name of ten megabytes": lambda n: 'format = 1\nblocks = {}\nwires = ["' + "a" * n(10_000_000) + '->b"]\n',
    "a key of ten megabytes": lambda n: "format = 1\n" + "a" * n(10_000_000) + " = 1\n[blocks]\n",
    "a title of ten megabytes": lambda n: 'format = 1\nblocks = 3\ntitle = "' + "a" * n(10_000_000) + '"\n',
    "signs of ten megabytes": lambda n: (
        'format = 1\n[blocks]\na = { type = "Sum", signs = "' + "+" * n(10_000_000) + '" }\n'
    ),
    "a type of ten megabytes": lambda n: 'format = 1\n[blocks]\na = { type = "' + "a" * n(10_000_000) + '" }\n',
    "two million numbers": lambda n: (
        "format = 1\n[blocks]\na = { type = 'PID', kp = [" + "1.5," * n(2_000_000) + "] }\n"
    ),
    "brackets": lambda n: "a = " + "[" * n(1_000_000),
    "tables in tables": lambda n: "a = " + "{ b = " * n(1_000_000),
    "dots": lambda n: ".".join(["a"] * n(1_000_000)) + " = 1",
    "dots of numbers": lambda n: ".".join(["1"] * n(1_000_000)) + " = 1",
    "quoted dots": lambda n: ".".join(['"a"'] * n(1_000_000)) + " = 1",
    "quotation marks": lambda n: "a = " + '"' * n(10_000_000),
    "escapes": lambda n: 'a = "' + "\\" * n(10_000_000),
    "an open text of many lines": lambda n: 'a = """' + '""\n' * n(3_000_000),
    "blocks of no type": lambda n: (
        "format = 1\n[blocks]\n" + "".join(f"a{k} = {{ type = 'Gian' }}\n" for k in range(n(80_000)))
    ),
    "blocks not wired": lambda n: (
        "format = 1\n[blocks]\n" + "".join(f"a{k} = {{ type = 'Gain' }}\n" for k in range(n(80_000)))
    ),
    "unknown keys": lambda n: "format = 1\nblocks = {}\n" + "".join(f"k{k} = 1\n" for k in range(n(200_000))),
    "keys in a deep table": lambda n: (
        f"[{'.'.join(['a'] * 150)}]\n" + "".join(f"k{k} = 1\n" for k in range(n(100_000)))
    ),
    "references": lambda n: (
        "format = 1\n[blocks]\n" + "".join(f"a{k} = {{ type = 'Gain', gain = '$b{k}' }}\n" for k in range(n(20_000)))
    ),
    "more than may be": lambda _: "#" * (MOST_BYTES + 1),
}
"""Texts with ``n`` of what is much in them."""


@pytest.mark.parametrize("share", [0.1, pytest.param(1.0, marks=pytest.mark.slow)])
@pytest.mark.parametrize("case", MANY)
def test_a_large_file_is_refused_in_seconds_with_one_short_message(case, share):
    text = MANY[case](lambda count: round(share * count))
    began = time.perf_counter()
    _, error = refused(text)
    assert time.perf_counter() - began < HANGS
    assert len(str(error)) < 20_000
    assert str(error).count("\n") <= MOST_PROBLEMS + 1


def test_a_file_on_disk_is_not_read_beyond_the_limit(tmp_path):
    path = tmp_path / "big.toml"
    with path.open("wb") as file:
        file.truncate(10**12)  # a hole, no terabyte
    assert fault_of(path) == f"{path}: a diagram file holds at most 20 MB. Recordings belong in data files."


def test_a_large_sound_file_loads_in_seconds():
    chain = "".join(f'  "b{k} -> b{k + 1}",\n' for k in range(4999))
    blocks = "".join(f'b{k} = {{ type = "Gain" }}\n' for k in range(5000))
    began = time.perf_counter()
    diagram = loads(f"format = 1\nwires = [\n{chain}]\n[blocks]\n{blocks}[inputs]\nu = 'b0'\n")
    assert loads(dumps(diagram)) == diagram
    assert time.perf_counter() - began < HANGS


# ---- nothing is run ---------------------------------------------------------------------------


def test_loading_imports_and_runs_nothing_that_a_file_names():
    names = [
        "os.system",
        "__import__",
        "builtins.eval",
        "Block",
        "tsmblocks.blocks.PID",
        "Diagram",
        "object",
        "__class__",
    ]
    for name in names:
        problems, _ = refused(f"format = 1\n[blocks]\na = {{ type = '{name}' }}\n")
        assert f"there is no block type '{name}'" in problems[0]
    for key in ("__class__", "check", "replace", "_fields", "self", "__init__"):
        problems, _ = refused(f"format = 1\n[blocks]\na = {{ type = 'Gain', {key} = 1 }}\n")
        assert problems[0].startswith(f"loop.toml:3: block 'a': Gain has no parameter '{key}'.")


def test_reading_a_file_needs_no_heavy_library():
    code = (
        "import sys; from tsmblocks.files import load; load('fig16_feedforward_feedback');"
        "print([m for m in ('scipy', 'control', 'matplotlib', 'pandas') if m in sys.modules])"
    )
    done = subprocess.run([sys.executable, "-c", code], capture_output=True, text=True, check=True)
    assert done.stdout.strip() == "[]"


# ---- anything at all --------------------------------------------------------------------------

SHELF = [(shipped_folder() / f"{name}.toml").read_bytes() for name in shipped_names()]
WORDS = [
    b'"',
    b"'",
    b'"""',
    b"[",
    b"]",
    b"{",
    b"}",
    b"=",
    b".",
    b",",
    b"->",
    b"$",
    b"\n",
    b"nan",
    b"inf",
    b"-1",
    b"1e400",
    b"true",
    b"#",
    b"use",
    b"type",
    b"set",
    b"[blocks]",
    b"[blocks.x]",
    b"wires",
    b"\xff",
    b"\x00",
    b"\xef\xbb\xbf",
    b"99999999999999999999",
    b"1979-05-27",
    b"{ type = 'Sum', signs = '' }",
    b"{ use = 'fig07_observer' }",
]


def answered(data):
    """Loads, or is refused with a message that can be shown."""
    try:
        loads(data.decode("utf-8-sig"), where="x.toml")
    except UnicodeDecodeError:
        return
    except TsmError as error:
        shown = str(error)
        assert shown


@settings(deadline=None, max_examples=250, suppress_health_check=list(HealthCheck))
@given(st.randoms(use_true_random=False), st.integers(1, 8), st.sampled_from(SHELF))
def test_a_spoilt_file_is_loaded_or_refused(rng: random.Random, count, data):
    for _ in range(count):
        at, to = sorted(rng.randrange(len(data) + 1) for _ in range(2))
        kind = rng.randrange(5)
        if kind == 0:
            data = data[:at] + bytes([rng.randrange(256)]) + data[at + 1 :]
        elif kind == 1:
            data = data[:at] + rng.choice(WORDS) + data[at:]
        elif kind == 2:
            data = data[:at] + data[min(to, at + 30) :]
        elif kind == 3:
            data = data[:at] + data[at : min(to, at + 80)] + data[at:]
        else:
            data = data.replace(rng.choice(data.split() or [b"x"]), rng.choice(WORDS), 1)
    answered(data)


@settings(deadline=None, max_examples=150, suppress_health_check=list(HealthCheck))
@given(st.lists(st.sampled_from([*WORDS, b" ", b"\n", b"a", b"format = 1\n", b"1"]), max_size=40).map(b"".join))
def test_a_heap_of_toml_is_loaded_or_refused(data):
    answered(data)
    answered(b"format = 1\n[blocks]\na = { type = 'Gain' }\n" + data)


toml_values = st.recursive(
    st.one_of(st.integers(), st.floats(), st.booleans(), st.text(max_size=8), st.datetimes(), st.just("$a")),
    lambda inner: (
        st.lists(inner, max_size=3)
        | st.dictionaries(st.sampled_from(["type", "use", "wires", "blocks", "ports", "a"]), inner, max_size=3)
    ),
    max_leaves=8,
)


@settings(deadline=None, max_examples=150, suppress_health_check=list(HealthCheck))
@given(st.dictionaries(st.sampled_from(["wires", "blocks", "inputs", "outputs", "values", "title"]), toml_values))
def test_tables_of_any_shape_are_loaded_or_refused(table):
    import tomli_w

    answered(tomli_w.dumps({"format": 1, "blocks": {}, **table}).encode("utf-8", "replace"))


@settings(deadline=None, max_examples=200, suppress_health_check=list(HealthCheck))
@given(st.data())
def test_blocks_with_any_values_are_loaded_or_refused(data):
    import tomli_w

    from tsmblocks.model.block import REGISTRY

    kind = data.draw(st.sampled_from(sorted(REGISTRY)))
    fields = sorted(REGISTRY[kind].fields())
    sensible = st.integers(-3, 9) | st.floats(-3, 9) | st.sampled_from(["$a", "", "+", "rad^-", "h^99"])
    values = data.draw(st.dictionaries(st.sampled_from(fields or ["x"]), toml_values | sensible | st.lists(sensible)))
    block = {**values, "type": kind}
    answered(tomli_w.dumps({"format": 1, "blocks": {"b": block}, "values": {"a": 1}}).encode("utf-8", "replace"))


@pytest.mark.parametrize(
    ("line", "said"),
    [
        ("a = { use = 3 }", "block 'a': use must name a diagram, got 3."),
        (
            'a = { use = "motor_linear", set = 3 }',
            "block 'a': set must be a table such as { \"drive.high\" = 12.0 }, got 3.",
        ),
        (
            'a = { use = "motor_linear", set = { "motor.k" = 1.0 } }',
            "block 'a': set: there is no parameter 'motor.k'. Did you mean 'motor.K'?",
        ),
        (
            'a = { use = "motor_linear", set = { motor.K = [1.0] } }',
            "block 'a': set: motor: MotorTransferFunction.K must be a number, got (1.0,). "
            "It is: speed per volt at the output shaft [rad/(s*V)].",
        ),
        (
            'a = { use = "motor_linear", set = { motor.K = "$k" } }',
            f"block 'a': set: {shipped_folder() / 'motor_linear.toml'}:6: motor: '$k' refers to a number that is not in "
            "values. There are none.",
        ),
        (
            f'a = {{ type = "Constant", unit = "{"m" * 20_000}" }}',
            "block 'a': Constant.unit is a text of 20,000 characters; at most 10,000 are read.",
        ),
    ],
    ids=["name", "table", "parameter", "value", "reference", "text"],
)
def test_what_a_block_of_another_file_is_not(line, said):
    text = f'format = 1\ntitle = "t"\n[blocks]\n{line}\n'
    with pytest.raises(FileError) as caught:
        loads(text, where="t.toml")
    assert f"t.toml:4: {said}" in caught.value.problems


def test_what_is_no_name_of_a_file_is_no_place_to_save():
    with pytest.raises(FileError, match=r"a file is named by text or a path, got 3\."):
        save(load("motor_linear"), 3)


def test_what_python_itself_refuses_in_a_number():
    with pytest.raises(FileError, match=r"t\.toml:2: a whole number has thousands of digits"):
        loads(f"format = 1\nx = {'1' * 5000}\n", where="t.toml")


def test_wires_of_a_block_that_could_not_be_read_are_no_faults_and_are_shown_by_its_name():
    blocks = '[blocks]\na = { type = "Nope" }\nb = { type = "Gain" }\nc = { type = "Sine" }\n'
    problems, _ = refused(f'format = 1\nwires = ["c -> b", "b -> a", "c -> a"]\n{blocks}')
    assert [p.partition("Known")[0] for p in problems] == ["loop.toml:4: block 'a': there is no block type 'Nope'. "]
    problems, _ = refused(f'format = 1\nwires = ["a -> b", "c -> b"]\n{blocks}')
    assert problems[0] == "loop.toml:2: b.u is driven 2 times: a -> b.u; c.y -> b.u. Join them with a Sum block."


def test_a_name_too_long_for_the_system_is_said():
    problems, _ = refused(f'format = 1\n[blocks]\na = {{ use = "{"a" * 300}" }}\n')
    assert problems == [f"loop.toml:3: block 'a': use = '{'a' * 99}…' cannot be read: file name too long."]


@pytest.mark.parametrize(
    ("text", "said"),
    [
        ('"a\\x" = 1\n', "1: this is not TOML: unescaped '\\' in a string (column 5: \"a\\x\" = 1)."),
        ("a = 1\na.b = 2\n", "2: this is not TOML: cannot overwrite a value (column 8: a.b = 2)."),
    ],
    ids=["escape", "overwritten"],
)
def test_what_toml_refuses_is_said_with_its_line(text, said):
    assert refused(text)[0] == [f"loop.toml:{said}"]


def test_a_fault_that_tomllib_gives_no_place_is_said(monkeypatch):
    def fail(text):
        raise toml_text.tomllib.TOMLDecodeError("something else")

    monkeypatch.setattr(toml_text.tomllib, "loads", fail)
    assert refused("format = 1\n")[0] == ["loop.toml:1: this is not TOML: something else."]


def test_keys_without_end_are_read_no_further(monkeypatch):
    monkeypatch.setattr(positions, "MOST_KEYS", 3)
    said = ["loop.toml:4: the file holds more than 3 keys and texts; it is not read further."]
    assert refused("a = 1\nb = 1\nc = 1\nd = 1\ne = 1\n")[0] == said


@pytest.mark.parametrize(
    ("limit", "line", "said"),
    [
        (
            "MOST_BLOCKS",
            'b = { use = "motor_linear" }',
            "5: up to block 'b' there are 2 blocks, with those of the diagrams in use; at most 1 are read.",
        ),
        ("MOST_LINKS", 'b = "x"', "2: the wires hold 3 connections; at most 1 are read."),
    ],
)
def test_more_than_is_read_is_one_fault_beside_the_others(limit, line, said, monkeypatch):
    monkeypatch.setattr(reader, limit, 1)
    text = f'format = 1\nwires = ["a -> c, d, e"]\n[blocks]\na = {{ type = "Sine", gain = 1 }}\n{line}\n'
    problems, _ = refused(text)
    assert f"loop.toml:{said}" in problems
    assert not any("c" in p.split("'") for p in problems)


def test_of_faults_without_end_the_first_are_said(monkeypatch):
    monkeypatch.setattr(faults, "MOST_FAULTS", 3)
    problems, _ = refused("format = 1\n[blocks]\n" + "".join(f'a{k} = {{ type = "Nope{k}" }}\n' for k in range(9)))
    assert [p.partition(": ")[0] for p in problems] == ["loop.toml:3", "loop.toml:4", "loop.toml:5"]


@pytest.mark.parametrize("name", ["", " a", "a\\b", "a\u202eb"])
def test_what_is_no_name_of_a_diagram_is_not_looked_for(name):
    problems, _ = refused(f"format = 1\n[blocks]\na = {{ use = '{name}' }}\n")
    assert [without_controls(p) for p in problems] == [
        f"loop.toml:3: block 'a': use = '{without_controls(name)}' is not the name of a diagram."
    ]


def test_a_caller_deep_in_its_stack_gets_a_message():
    nested = f"format = 1\nx = {'[' * 150}{']' * 150}\n[blocks]\n"

    def refused_below(calls):
        return refused_below(calls - 1) if calls else refused(nested)[0][0]

    refused_below(0)
    room = sys.getrecursionlimit() - len(inspect.stack(0))
    said = {refused_below(room - left) for left in range(100, room, 25)}
    assert said == {
        "loop.toml: tables are nested too deep.",
        "loop.toml:2: 'x' is not a key of a diagram. Known here: blocks, inputs, outputs, source, title, values, wires.",
        "loop.toml: brackets are nested too deep.",
    }


class Careless(Block):
    """A block of which the author did not foresee all values."""

    gain: float = parameter(default=1.0, about="factor")
    u = Input("any signal")
    y = Output("the signal")

    def check(self):
        """Check the numbers."""
        assert isinstance(self.gain, str) or 1 / (self.gain - 3)

    def outputs(self, t, x, u):
        return {"y": self.gain * u.u}


def test_values_that_the_author_of_a_block_did_not_foresee_are_said(tmp_path, monkeypatch):
    monkeypatch.setitem(REGISTRY, "Careless", block(Careless, register=False))
    said = "loop.toml:3: block 'a': Careless cannot be made of these values: float division by zero."
    assert refused('format = 1\n[blocks]\na = { type = "Careless", gain = 3.0 }\n')[0] == [said]
    (tmp_path / "part.toml").write_text(
        'format = 1\n[blocks]\na = { type = "Careless" }\n[inputs]\nu = "a"\n[outputs]\ny = "a"\n'
    )
    whole = 'format = 1\n[blocks]\np = { use = "part", set = { "a.gain" = 3.0 } }\n'
    assert refused(whole, folder=tmp_path)[0] == ["loop.toml:3: block 'p': set: float division by zero"]
    problems, _ = refused('format = 1\n[blocks]\na = { type = "Careless", gain = "$k" }\n[values]\nk = 3.0\n')
    assert problems == ["loop.toml: the blocks cannot be put together: float division by zero"]


@pytest.mark.parametrize("unit", [3, ["rad"]])
def test_a_unit_is_text(unit):
    with pytest.raises(DiagramError, match=re.escape(f"input 'u': a unit must be text such as 'rad/s', got {unit}.")):
        Diagram(blocks={"g": Gain()}, inputs={"u": Inlet(["g"], unit=unit)})


def test_what_a_file_cannot_hold_is_said_in_characters_that_can_be_shown():
    unwritable = Diagram(title="a\ud800", blocks={"g": Gain()}, inputs={"u": Inlet(["g"], about=3)})
    with pytest.raises(FileError) as caught:
        dumps(unwritable)
    assert str(caught.value).encode().decode() == (
        "diagram 'a\\ud800' has 2 problems:\n"
        "  1. title is 'a\\ud800', with an incomplete character in it, which a file cannot hold.\n"
        "  2. u.about is 3, which a file cannot hold."
    )


@block(register=False)
class Opened(Block):
    """A block with options of which the items have any type."""

    items: tuple = option(default=(), about="anything")
    u = Input("any signal")
    y = Output("the signal")

    def outputs(self, t, x, u):
        return {"y": u.u}


@pytest.mark.parametrize(
    ("options", "said"),
    [
        ({"items": (float("nan"),)}, "b.items is nan, which a file cannot hold."),
        ({"items": (None,)}, "b.items is None, which a file cannot hold."),
    ],
    ids=["nan", "none"],
)
def test_options_that_a_file_would_not_give_back_are_not_written(options, said, monkeypatch):
    monkeypatch.setitem(REGISTRY, "Opened", Opened)
    with pytest.raises(FileError) as caught:
        dumps(Diagram(blocks={"b": Opened(**options)}, inputs={"u": "b"}))
    assert caught.value.problems == (said,)


@pytest.mark.parametrize("seed", [2**53 + 1, -(2**60)])
def test_a_whole_number_that_would_be_rounded_is_refused(seed):
    with pytest.raises(
        ParameterError, match=r"^Random\.seed (is \d.*, a whole number too large to be held exactly|must)"
    ):
        Random(seed=seed)
    assert Random(seed=2**53 - 1).seed == 2**53 - 1
