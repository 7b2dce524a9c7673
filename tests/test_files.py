"""Diagrams as files: what is written is what is read, and it reads well."""

import json
import math
import os
import stat
import tomllib
from pathlib import Path

import pytest
from hypothesis import HealthCheck, assume, given, settings
from hypothesis import strategies as st

from tsmblocks.blocks import (
    PID,
    AsymmetricBoucWen,
    Constant,
    Gain,
    Integrator,
    MotorTransferFunction,
    Product,
    Recorded,
    Saturation,
    Sine,
    Sum,
    TransferFunction,
    Triangle,
)
from tsmblocks.common.errors import DiagramError, FileError, TsmError
from tsmblocks.files import dumps, load, loads, save
from tsmblocks.files import shipped as shelf_module
from tsmblocks.files.positions import Places
from tsmblocks.files.schema import schema
from tsmblocks.files.shipped import shipped_folder, shipped_names
from tsmblocks.files.simulation_reader import KEYS
from tsmblocks.files.writer import split_wire
from tsmblocks.model.arguments import DEEPEST
from tsmblocks.model.block import REGISTRY, Block, Input, Output, block, option, parameter
from tsmblocks.model.diagram import Diagram, Inlet


def loop(**changes):
    fields = dict(
        title="position loop",
        source="a test",
        blocks=dict(
            ref=Sine(amplitude=0.96, unit="rad"),
            error=Sum(),
            pid=PID(kp="$stiffness"),
            drive=Saturation(low=-math.inf, high=12.0),
            motor=MotorTransferFunction(),
            tsm=AsymmetricBoucWen(alpha1=0.9477, alpha2=0.9333, A=-0.813, theta=4.382, delta=-0.057),
        ),
        wires=["ref -> error.plus", "error -> pid -> drive -> motor", "motor.y -> tsm -> error.minus"],
        outputs={"x_ref": "ref", "x_out": "tsm"},
        values={"stiffness": 60.0},
    )
    return Diagram(**{**fields, **changes})


TEXT = """\
format = 1
title = "position loop"
source = "a test"

wires = [
  "ref -> error.plus -> pid -> drive -> motor",
  "motor.y -> tsm -> error.minus",
]

[values]
stiffness = 60.0

[blocks]
ref = { type = "Sine", amplitude = 0.96, unit = "rad" }
error = { type = "Sum" }
pid = { type = "PID", kp = "$stiffness" }
drive = { type = "Saturation", low = -inf, high = 12.0 }
motor = { type = "MotorTransferFunction" }

[blocks.tsm]
type = "AsymmetricBoucWen"
alpha1 = 0.9477
alpha2 = 0.9333
A = -0.813
theta = 4.382
delta = -0.057

[outputs]
x_ref = "ref.y"
x_out = "tsm.y"
"""


# ---- ready-made diagrams -------------------------------------------------------------------------


@pytest.mark.parametrize("name", shipped_names())
def test_every_ready_made_diagram_loads_and_survives_writing(name):
    diagram = load(name)
    text = dumps(diagram)
    assert loads(text) == diagram
    assert dumps(loads(text)) == text
    assert diagram.where == str(shipped_folder() / f"{name}.toml")


def test_the_shelf_holds_the_promised_diagrams():
    promised = {
        *("fig07_observer", "fig08_slope", "fig09a_without_feedforward", "fig09b_feedforward"),
        *("fig16_feedforward_feedback", "tendon_sheath_linear", "tendon_sheath_symmetric"),
        *("tendon_sheath_asymmetric", "tendon_sheath_play", "motor_linear"),
    }
    assert promised <= set(shipped_names())


def test_the_shelf_holds_no_python():
    assert [p.name for p in shipped_folder().rglob("*") if p.suffix.startswith(".py") or p.name == "__pycache__"] == []


def test_an_installed_package_has_its_diagrams_inside(monkeypatch, tmp_path):
    (tmp_path / "tsmblocks" / "_diagrams").mkdir(parents=True)
    (tmp_path / "diagrams").mkdir()
    monkeypatch.setattr(shelf_module, "_PACKAGE", tmp_path / "tsmblocks")
    assert shipped_folder() == tmp_path / "tsmblocks" / "_diagrams"
    (tmp_path / "tsmblocks" / "_diagrams").rmdir()
    assert shipped_folder() == tmp_path / "diagrams"


# ---- names and paths --------------------------------------------------------------------------


def test_a_file_is_loaded_by_any_kind_of_path(tmp_path, monkeypatch):
    monkeypatch.chdir(tmp_path)
    save(loop(), "mine.toml")
    save(loop(), "other")
    for path in ("mine.toml", "./mine.toml", tmp_path / "mine.toml", "other", Path("other"), "./other"):
        assert load(path) == loop()


def test_a_folder_of_results_does_not_hide_the_ready_made_diagram(tmp_path, monkeypatch):
    monkeypatch.chdir(tmp_path)
    (tmp_path / "motor_linear").mkdir()
    assert load("motor_linear").title == load(shipped_folder() / "motor_linear.toml").title


def test_a_file_of_that_name_is_taken_before_the_shelf(tmp_path, monkeypatch):
    monkeypatch.chdir(tmp_path)
    save(loop(), "motor_linear")
    assert load("motor_linear") == loop()


# ---- writing ----------------------------------------------------------------------------------


def test_a_file_reads_as_if_written_by_hand():
    assert dumps(loop()) == TEXT
    assert loads(TEXT) == loop()


def test_a_diagram_inside_is_written_in_place():
    inner = Diagram(
        title="drive",
        blocks=dict(limit=Saturation(low=-24.0, high="$most"), motor=MotorTransferFunction()),
        wires=["limit -> motor"],
        inputs={"u": Inlet("limit", unit="V", about="wanted voltage"), "spare": []},
        outputs={"x": "motor.y", "echo": "u"},
        values={"most": 9.0},
    )
    outer = Diagram(
        blocks=dict(drive=inner, one=Constant(unit="V")), wires=["one -> drive.u"], inputs={"s": "drive.spare"}
    )
    assert (
        dumps(outer)
        == """\
format = 1

wires = [
  "one -> drive.u",
]

[blocks]
one = { type = "Constant", unit = "V" }

[blocks.drive]
title = "drive"
wires = [
  "limit -> motor",
]

[blocks.drive.values]
most = 9.0

[blocks.drive.blocks]
limit = { type = "Saturation", high = "$most" }
motor = { type = "MotorTransferFunction" }

[blocks.drive.inputs]
u = { ports = "limit.u", unit = "V", about = "wanted voltage" }
spare = []

[blocks.drive.outputs]
x = "motor.y"
echo = "u"

[inputs]
s = "drive.spare"
"""
    )
    assert loads(dumps(outer)) == outer


def test_an_empty_diagram_can_be_kept():
    empty = Diagram(blocks={})
    nested = Diagram(title="shell", blocks={"inside": empty})
    assert loads(dumps(empty)) == empty
    assert loads(dumps(nested)) == nested


def test_diagrams_to_the_deepest_level_are_written_and_read():
    deep = Diagram(blocks=dict(one=Constant()))
    for _ in range(DEEPEST - 1):
        deep = Diagram(blocks=dict(inside=deep))
    assert deep.depth == DEEPEST
    assert loads(dumps(deep)) == deep


def test_long_lists_and_long_wires_are_folded():
    times = tuple(0.1 * k for k in range(200))
    many = {f"g{k}": Gain(gain=k) for k in range(60)}
    chain = " -> ".join(["record", *many])
    fan = "record -> " + ", ".join(f"h{k}" for k in range(60))
    blocks = dict(record=Recorded(times=times, values=times), **many, **{f"h{k}": Gain() for k in range(60)})
    diagram = Diagram(blocks=blocks, wires=[chain, fan])
    text = dumps(diagram)
    assert max(map(len, text.splitlines())) <= 100
    assert loads(text) == diagram


def test_a_wire_that_cannot_be_shortened_is_left_alone():
    long = "a" * 120
    assert split_wire(f"{long} -> b") == [f"{long} -> b"]
    assert split_wire("a -> b") == ["a -> b"]


@pytest.mark.parametrize("value", [-0.0, 5e-324, 1.7976931348623157e308, 0.1, 1e16, 123456789.123, -1e-7])
def test_numbers_come_back_to_the_last_bit(value):
    again = loads(dumps(Diagram(blocks=dict(one=Constant(value=value))))).blocks["one"].value
    assert math.copysign(1, again) == math.copysign(1, value)
    assert again.hex() == value.hex()


@pytest.mark.parametrize(
    "title", ['"', "\\", "a\nb", "tab\t", "\x00\x1b\x7f", "ζ̇ = A·v", "'''", '"""', " ", "\r\n", "\u2028"]
)
def test_any_title_survives(title):
    diagram = loop(title=title, source=title)
    assert loads(dumps(diagram)) == diagram


def test_half_a_character_is_refused():
    with pytest.raises(
        FileError, match=r"title is 'a.*d800', with an incomplete character in it, which a file cannot hold"
    ):
        dumps(loop(title="a\ud800"))


def test_a_block_that_is_not_registered_is_refused():
    @block(register=False)
    class Secret(Block):
        u = Input("in")
        y = Output("out")

    diagram = Diagram(
        title="t", blocks=dict(a=Constant(), b=Diagram(blocks=dict(s=Secret()), inputs={"u": "s"})), wires=["a -> b"]
    )
    with pytest.raises(FileError) as caught:
        dumps(diagram)
    assert str(caught.value) == (
        "diagram 't' has 1 problem:\n  1. block 'b.s': Secret is not registered, so no file can name it."
    )


# ---- any diagram ------------------------------------------------------------------------------

numbers = st.floats(allow_nan=False, allow_infinity=False)
blocks_of_any_kind = st.one_of(
    st.builds(Gain, gain=st.one_of(numbers, st.sampled_from(["$a", "$b2"]))),
    st.builds(Constant, value=numbers),
    st.builds(Sum, signs=st.text("+-", min_size=1, max_size=4)),
    st.builds(Product, n=st.integers(1, 3)),
    st.builds(Saturation, low=st.just(-math.inf), high=st.floats(0, 1e300) | st.just(math.inf)),
    st.builds(Integrator, reset=st.booleans()),
    st.builds(TransferFunction, num=st.tuples(numbers), den=st.tuples(st.floats(0.1, 1e9), numbers, st.just("$a"))),
    st.builds(Triangle, unit=st.sampled_from(["", "rad"])),
)
identifiers = st.from_regex(r"[A-Za-z_][A-Za-z0-9_]{0,40}", fullmatch=True)


@st.composite
def diagrams(draw, level=0):
    """Diagrams that may be odd to look at but are sound."""
    inner = st.deferred(lambda: diagrams(level + 1))
    kinds = blocks_of_any_kind if level > 1 else st.one_of(blocks_of_any_kind, inner)
    blocks = draw(st.dictionaries(identifiers, kinds, max_size=5))
    outs = [f"{n}.{p}" for n, b in blocks.items() for p in b.outports]
    wires, free = [], []
    for name, made in blocks.items():
        for port in made.inports:
            driver = draw(st.sampled_from([*outs, None, None]))
            wires += [] if driver is None else [f"{driver} -> {name}.{port}"]
            free += [f"{name}.{port}"] if driver is None else []
    names = draw(st.lists(identifiers.filter(lambda n: n not in blocks), min_size=1, max_size=3, unique=True))
    groups = {name: [] for name in names}
    for port in free:
        groups[draw(st.sampled_from(names))].append(port)
    about = st.builds(Inlet, ports=st.just(()), about=st.text(st.characters(codec="utf-8"), max_size=90))
    inputs = {n: Inlet(ports, about=draw(about).about) for n, ports in groups.items()}
    shown = draw(st.dictionaries(identifiers, st.sampled_from([*outs, *names]), max_size=3))
    title = draw(st.text(st.characters(codec="utf-8"), max_size=20))
    try:
        return Diagram(
            title=title,
            blocks=blocks,
            wires=wires,
            inputs=inputs,
            outputs=shown,
            values={"a": 1.5, "b2": draw(numbers)},
        )
    except DiagramError:  # units that do not agree
        assume(False)


@settings(deadline=None, max_examples=150, suppress_health_check=list(HealthCheck))
@given(diagrams())
def test_any_diagram_survives_a_file(diagram):
    text = dumps(diagram)
    again = loads(text)
    assert again == diagram
    assert dumps(again) == dumps(loads(dumps(again)))


@settings(deadline=None, max_examples=80, suppress_health_check=list(HealthCheck))
@given(diagrams())
def test_every_key_of_a_file_has_its_line(diagram):
    text = dumps(diagram)
    lines, places = text.split("\n"), Places(text)

    def follow(value, path):
        if path:
            assert path in places.lines
            assert isinstance(path[-1], int) or path[-1] in lines[places.line(*path) - 1]
        if isinstance(value, dict):
            for key, inner in value.items():
                follow(inner, (*path, key))
        if isinstance(value, list):
            for k, inner in enumerate(value):
                if isinstance(inner, str):
                    assert json.dumps(inner, ensure_ascii=False) in lines[places.line(*path, k) - 1]

    follow(tomllib.loads(text), ())


# ---- places in files written by hand ----------------------------------------------------------


def test_places_in_a_text_that_uses_all_of_toml():
    text = '''# a comment with "quotes" and [brackets] = {}
a."b\\"c".d = [ "x", # with a comment
  'y', [ "z" ], { q = "w",  r = [ 1, 2,
  "s" ] },
  "last" ]
1.2 = 07:32:00

[ t . "u v" ]   # spaces
v = """
[not.a.table]
""\\""" \'\'\'
"""
w = 1979-05-27 07:32:00
x = \'\'\'one = "two"
\'\'\'
y.z = { use = "q", set = { "a.b" = 2 } }
[[many]]
m = 1
[[many]]
m = 2
[after]
n = [[1, 2], [3]]
'''
    tomllib.loads(text)
    expected = {
        ("a",): 2,
        ("a", 'b"c'): 2,
        ("a", 'b"c', "d"): 2,
        ("a", 'b"c', "d", 0): 2,
        ("a", 'b"c', "d", 1): 3,
        ("a", 'b"c', "d", 2, 0): 3,
        ("a", 'b"c', "d", 3, "q"): 3,
        ("a", 'b"c', "d", 3, "r"): 3,
        ("a", 'b"c', "d", 3, "r", 2): 4,
        ("a", 'b"c', "d", 4): 5,
        ("1",): 6,
        ("1", "2"): 6,
        ("t",): 8,
        ("t", "u v"): 8,
        ("t", "u v", "v"): 9,
        ("t", "u v", "w"): 13,
        ("t", "u v", "x"): 14,
        ("t", "u v", "y"): 16,
        ("t", "u v", "y", "z"): 16,
        ("t", "u v", "y", "z", "use"): 16,
        ("t", "u v", "y", "z", "set"): 16,
        ("t", "u v", "y", "z", "set", "a.b"): 16,
        ("many",): 17,
        ("many", "m"): 18,
        ("after",): 21,
        ("after", "n"): 22,
    }
    assert Places(text).lines == expected


def test_a_path_that_is_not_there_has_the_line_of_what_is_around_it():
    places = Places("[blocks]\n\npid = { type = 'PID' }\n")
    assert places.line("blocks", "pid", "kp") == 3
    assert places.line("blocks", "motor", "type") == 1
    assert places.line("wires") is None


# ---- other files ------------------------------------------------------------------------------


def write(folder, name, text):
    path = folder / name
    path.parent.mkdir(parents=True, exist_ok=True)
    path.write_text(text)
    return path


USER = """\
format = 1
wires = ['one -> part']
[blocks]
one = {{ type = 'Constant' }}
part = {{ {} }}
[outputs]
y = 'part'
"""
GAIN = """\
format = 1
[blocks]
g = { type = 'Gain', gain = '$k' }
[inputs]
u = 'g'
[outputs]
y = 'g'
[values]
k = 2
"""


def test_a_block_may_be_another_file(tmp_path):
    write(tmp_path, "part.toml", GAIN)
    write(tmp_path, "more/part.toml", GAIN.replace("2", "5"))
    for use, k in (("part", 2.0), ("part.toml", 2.0), ("more/part", 5.0), ("./more/part.toml", 5.0)):
        made = load(write(tmp_path, "user.toml", USER.format(f"use = '{use}'")))
        assert made.parameters == {"one.value": 1.0, "part.k": k}


def test_a_neighbour_comes_before_the_shelf(tmp_path):
    text = (
        USER.format("use = 'motor_linear'")
        .replace("wires = ['one -> part']", "inputs = { u = 'part' }")
        .replace("one = { type = 'Constant' }\n", "")
    )
    assert "part.k" not in loads(text.replace("y = 'part'", "y = 'part.x'")).parameters
    write(tmp_path, "motor_linear.toml", GAIN)
    assert "part.k" in loads(text, folder=tmp_path).parameters


def test_numbers_of_another_file_can_be_set(tmp_path):
    write(tmp_path, "part.toml", GAIN)
    write(tmp_path, "outer.toml", USER.format("use = 'part', set = { k = 7 }"))
    assert load(tmp_path / "outer.toml").parameters["part.k"] == 7.0
    for numbers_given in (
        "'part.k' = 3, 'one.value' = 4",
        "part.k = 3, one.value = 4",
        "part = { k = 3 }, one.value = 4",
    ):
        text = f"format = 1\n[blocks]\no = {{ use = 'outer', set = {{ {numbers_given} }} }}\n"
        assert loads(text, folder=tmp_path).parameters == {"o.one.value": 4.0, "o.part.k": 3.0}


def test_a_file_used_many_times_is_read_once(tmp_path, monkeypatch):
    from tsmblocks.files import block_reader as file_blocks

    reads = []
    monkeypatch.setattr(file_blocks, "load_text", lambda path: reads.append(path) or path.read_text())
    write(tmp_path, "part.toml", GAIN)
    blocks = "".join(f"p{k} = {{ use = 'part' }}\n" for k in range(20))
    wires = ", ".join(f"'one -> p{k}'" for k in range(20))
    made = loads(f"format = 1\nwires = [{wires}]\n[blocks]\none = {{ type = 'Constant' }}\n{blocks}", folder=tmp_path)
    assert len(made.blocks) == 21
    assert len(reads) == 1


# ---- what is lenient --------------------------------------------------------------------------


def test_whole_numbers_crlf_and_a_byte_order_mark_are_welcome(tmp_path):
    text = TEXT.replace("60.0", "60").replace("12.0", "12")
    path = tmp_path / "windows.toml"
    path.write_bytes(b"\xef\xbb\xbf" + text.replace("\n", "\r\n").encode())
    assert load(path) == loop()
    assert loads("\ufeff" + text.replace("\n", "\r\n")) == loop()


def test_wires_and_names_know_their_lines():
    diagram = loads(TEXT, where="loop.toml")
    assert {str(link): link.place for link in diagram.links}["motor.y -> tsm.x"] == "loop.toml:7"
    with pytest.raises(DiagramError, match=r"\n  1\. loop\.toml:15: error\.plus \(Sum\) is driven by nothing"):
        diagram.rewire(cut=["ref -> error.plus"])


# ---- saving -----------------------------------------------------------------------------------


def test_saving_replaces_the_file_in_one_step(tmp_path):
    path = tmp_path / "a.toml"
    save(loop(), path)
    assert path.read_bytes().decode() == TEXT
    path.chmod(0o640)
    save(loop(title="new"), path)
    assert load(path).title == "new"
    assert stat.S_IMODE(path.stat().st_mode) == 0o640
    assert os.listdir(tmp_path) == ["a.toml"]


def test_saving_through_a_link_keeps_the_link(tmp_path):
    save(loop(), tmp_path / "a.toml")
    (tmp_path / "link.toml").symlink_to(tmp_path / "a.toml")
    save(loop(title="new"), tmp_path / "link.toml")
    assert (tmp_path / "link.toml").is_symlink()
    assert load(tmp_path / "a.toml").title == "new"


def test_a_failure_leaves_the_old_file(tmp_path, monkeypatch):
    path = tmp_path / "a.toml"
    save(loop(), path)
    monkeypatch.setattr(os, "fsync", lambda _: (_ for _ in ()).throw(OSError(28, "No space left on device")))
    with pytest.raises(FileError, match=r"a\.toml: cannot be written: no space left on device\."):
        save(loop(title="new"), path)
    assert load(path) == loop()
    assert os.listdir(tmp_path) == ["a.toml"]


@pytest.mark.parametrize("path", ["missing/a.toml", ".", "a\0b", "x" * 5000])
def test_what_cannot_be_written_is_said(tmp_path, monkeypatch, path):
    monkeypatch.chdir(tmp_path)
    with pytest.raises(TsmError, match="cannot be written: "):
        save(loop(), path)
    assert os.listdir(tmp_path) == []


# ---- the schema -------------------------------------------------------------------------------


def test_the_schema_knows_every_block_and_field():
    made = schema()
    assert json.loads(json.dumps(made, allow_nan=False)) == made
    for name, cls in REGISTRY.items():
        assert set(made["$defs"][name]["properties"]) == {"type", *cls.fields()}
    assert made["$defs"]["PID"]["properties"]["tau"]["anyOf"][0] == {"type": "number", "exclusiveMinimum": 0.0}
    assert made["required"] == ["format", "blocks"]
    assert set(made["properties"]["simulation"]["properties"]) == set(KEYS)


def test_no_block_has_a_field_that_a_file_could_not_tell_apart():
    assert [name for name, cls in REGISTRY.items() if "type" in cls.fields()] == []


def test_a_block_with_a_field_named_type_is_refused():
    @block
    class _Typed(Block):
        type: str = option(default="a", about="a name that files need for themselves")
        k: float = parameter(default=1.0, about="a number")
        y = Output("out")

    try:
        with pytest.raises(FileError, match="its parameter 'type' cannot be distinguished from the block's type"):
            dumps(Diagram(blocks=dict(a=_Typed())))
    finally:
        del REGISTRY["_Typed"]


@pytest.mark.parametrize("folder", [".", "..", "/"])
def test_a_folder_is_no_diagram(folder):
    with pytest.raises(FileError):
        load(folder)
