"""The command line as a user meets it: what it prints, where, and the exit status."""

import importlib
import json
import os
import re
import subprocess
import sys
import warnings

import numpy as np
import pytest

from tsmblocks.cli import main
from tsmblocks.data import read
from tsmblocks.draw.picture import LIGHT
from tsmblocks.files import load
from tsmblocks.files.shipped import shipped_names
from tsmblocks.simulation.stability import StepWarning

PAPER = importlib.import_module("tsmblocks.demo.paper")
SIMULATE = importlib.import_module("tsmblocks.simulation.simulate")  # the package shows a function of that name

GROWS = """
format = 1
title = "Grows without bound"
wires = ["square -> integral -> square"]
[blocks]
square = { type = "Square" }
integral = { type = "Integrator", integral = 1.0 }
[outputs]
x = "integral"
"""
LAG = """
format = 1
title = "Lag"
[blocks]
lag = { type = "FirstOrderLag" }
[inputs]
x_in = { ports = "lag.u", unit = "rad" }
[outputs]
x_out = "lag"
"""
MISWIRED = """
format = 1
title = "Miswired"
wires = ["rf -> lag"]
[blocks]
ref = { type = "Sine" }
lag = { type = "FirstOrderLag" }
"""


@pytest.fixture
def here(tmp_path, monkeypatch):
    """An empty folder to work in."""
    monkeypatch.chdir(tmp_path)
    return tmp_path


@pytest.fixture
def tsm(here, capsys):
    """Run a command line; its exit status, standard output and standard error."""

    def run(*words):
        status = main([str(word) for word in words])
        told = capsys.readouterr()
        return status, told.out, told.err

    return run


def fails(outcome, *words):
    status, out, err = outcome
    assert status == 2
    assert out == ""
    assert err.startswith("tsmblocks: ")
    assert "Traceback" not in err
    for word in words:
        assert word in err


# ---- run


def test_run_tells_the_tracking_error_of_an_angle_in_degrees(tsm):
    status, out, err = tsm("run", "fig09a_without_feedforward", "--stop", 10, "--step", 0.002, "--no-step-check")
    assert (status, err) == (0, "")
    assert "tracking error x_ref - x_out  peak to peak" in out
    assert "second half, from 5 s" in out
    assert "whole run" in out
    assert out.count(" deg") == 6
    assert " rad" not in out


def test_run_json_is_one_object_with_the_same_numbers(tsm):
    status, out, err = tsm("run", "fig09a_without_feedforward", "--json")
    told = json.loads(out)
    assert (status, err) == (0, "")
    assert told["outputs"].keys() == {"x_ref", "x_out", "x_in", "u"}
    assert told["outputs"]["u"]["unit"] == "V"
    error = told["tracking_error"]["second_half"]
    assert (error["from"], error["unit"]) == (10.0, "rad")
    assert np.degrees(error["peak_to_peak"]) == pytest.approx(28.3, abs=0.5)
    assert told["tracking_error"]["whole_run"]["largest"] >= error["largest"]


def test_run_sets_parameters(tsm):
    words = ["run", "fig16_feedforward_feedback", "--stop", 5, "--json"]
    plain, other, together, tied = (
        json.loads(tsm(*words, *more)[1])["tracking_error"]["whole_run"]["rms"]
        for more in (
            [],
            ["--set", "pid.kp=0", "--set", "pid.ki=0"],
            ["--set", "pid.kp=0", "pid.ki=0"],
            ["--set", "theta=2.0"],
        )
    )
    assert other == together > plain
    assert tied not in (plain, other)


@pytest.mark.parametrize(
    ("words", "told"),
    [
        (["pid.kp=abc"], "PID.kp must be a number, got 'abc'. It is: proportional gain."),
        (["pid.kpp=1"], "PID has no parameter 'kpp'. Did you mean 'kp'?"),
        (["pdi.kp=1"], "has no parameter 'pdi.kp'. Did you mean 'pid.kp'?"),
        (["drive.low=30"], "Saturation needs low < high, got low=30, high=24."),
        (["pid.kp"], "argument --set: 'pid.kp' is not NAME=VALUE."),
        (["pid.kp=[1, 2]"], "PID.kp must be a number, got (1.0, 2.0)."),
    ],
)
def test_run_refuses_settings_with_a_hint(tsm, words, told):
    fails(tsm("run", "fig16_feedforward_feedback", "--set", *words), told)


def test_run_writes_results_and_figures(tsm, here):
    for name in ("a.csv", "a.npz", "a.mat"):
        status, out, _ = tsm("run", "fig09a_without_feedforward", "--stop", 2, "--every", 10, "--out", name)
        assert (status, f"wrote {name}" in out) == (0, True)
        record = read(here / name)
        assert set(record.names) == {"x_ref", "x_out", "x_in", "u"}
        np.testing.assert_allclose(record.t, np.arange(201) / 100, atol=1e-12)
    assert tsm("run", "fig09a_without_feedforward", "--stop", 2, "--plot", "a.png", "--json")[0] == 0
    assert (here / "a.png").read_bytes().startswith(b"\x89PNG")


def test_run_takes_measured_inputs(tsm, here):
    (here / "lag.toml").write_text(LAG)
    (here / "m.csv").write_text("t [s],motor [deg]\n" + "".join(f"{k / 10},{k}\n{k / 10},{k}\n" for k in range(31)))
    status, out, err = tsm("run", "lag.toml", "--data", "m.csv", "--map", "x_in=motor", "--out", "o.csv")
    assert status == 0
    assert "0 to 3 s in steps of 0.001 s" in out
    assert "note: m.csv: 31 rows repeated the time" in err
    assert "output" in out
    last = read(here / "o.csv")["x_out"][-1]
    assert 0.9 * np.radians(30) < last < np.radians(30)
    status, out, err = tsm("run", "lag.toml", "--data", "m.csv", "--map", "x_in=motor", "--json")
    assert (status, err) == (0, "")
    assert "31 rows repeated" in json.loads(out)["notes"][0]


def test_run_says_what_an_input_without_a_unit_is_taken_for(tsm, here):
    (here / "lag.toml").write_text(LAG)
    (here / "m.txt").write_text("".join(f"{k} {k}\n" for k in range(5)))
    _, _, err = tsm("run", "lag.toml", "--data", "m.txt", "--columns", "t,x_in")
    assert err == (
        "note: m.txt: x_in has no unit and is taken to be in rad. Where that is wrong, give the unit: "
        "--map 'x_in [deg]=x_in'.\n"
    )
    out = tsm("run", "lag.toml", "--data", "m.txt", "--columns", "t, x_in [deg]", "--rows", "2:", "--json")[1]
    in_header = json.loads(out)
    assert in_header["start"] == 1.0
    words = ["run", "lag.toml", "--data", "m.txt", "--columns", "t,x", "--rows", "2:", "--json"]
    _, out, err = tsm(*words, "--map", "x_in [deg]=x")
    assert err == ""
    assert json.loads(out)["outputs"] == in_header["outputs"]


def test_run_without_its_data(tsm, here):
    (here / "lag.toml").write_text(LAG)
    (here / "m.csv").write_text("t,motor [deg]\n0,1\n1,2\n2,3\n3,4\n")
    fails(tsm("run", "lag.toml"), "needs its input x_in. Give --data FILE with a column 'x_in [rad]', or with --map")
    fails(tsm("run", "lag.toml", "--data", "m.csv"), "m.csv: there is no column 'x_in'.", "--map 'x_in=COLUMN'.")
    fails(
        tsm("run", "lag.toml", "--data", "m.csv", "--map", "x_inn=motor"),
        "no input or output 'x_inn'. Did you mean 'x_in'?",
    )
    fails(tsm("run", "lag.toml", "--data", "n.csv"), "there is no file n.csv. Known here: ")
    fails(tsm("run", "fig09b_feedforward", "--data", "m.csv"), "has no inputs, so there is nothing")
    fails(tsm("run", "lag.toml", "--data", "m.csv", "--map", "x_in=motor", "--hold", "linaer"), "no hold 'linaer'")
    fails(tsm("run", "lag.toml", "--data", "m.csv", "--map", "x_in=motor", "--stop", 9), "known from 0 to 3 s")


@pytest.mark.parametrize(
    ("words", "told"),
    [
        (["fig16_feedforwrd_feedback"], "Did you mean 'fig16_feedforward_feedback'?"),
        (["fig09b_feedforward", "--stpo", "3"], "run takes no option '--stpo'. Did you mean '--stop'?"),
        (["fig09b_feedforward", "--stop", "ten"], "argument --stop: 'ten' is not a number."),
        (["fig09b_feedforward", "--stop", "-1"], "the run must end after it starts"),
        (["fig09b_feedforward", "--step", "0"], "step must be a positive number of seconds"),
        (["fig09b_feedforward", "--every", "0"], "'0' is not a whole number of at least 1"),
        (["fig09b_feedforward", "--method", "rk5"], "there is no method 'rk5'. Did you mean 'rk4'?"),
        (["fig09b_feedforward", "--backend", "gpu"], "there is no back end 'gpu'."),
        (["fig09b_feedforward", "--rows", "3"], "'3' is not FIRST:LAST, such as 1:26328"),
        (["fig09b_feedforward", "--out", "a.xlsx"], "'a.xlsx' must end in .csv, .npz or .mat."),
        (["fig09b_feedforward", "--out", "nowhere/a.csv"], "there is no folder 'nowhere' to write a.csv into."),
        (["fig09b_feedforward", "--plot", "a.gif"], "'a.gif' must end in .png, .svg or .pdf."),
        (["fig09b_feedforward", "extra"], "run takes no argument 'extra'.\n"),
        (
            [],
            "the following arguments are required: DIAGRAM. Name it before the options. 'tsmblocks run --help' shows "
            "what it takes.",
        ),
    ],
)
def test_run_refuses_with_one_message(tsm, words, told):
    fails(tsm("run", *words), told)


def test_a_run_that_breaks_off_keeps_what_there_was(tsm, here):
    (here / "grows.toml").write_text(GROWS)
    status, out, err = tsm("run", "grows.toml", "--stop", 2, "--out", "g.csv")
    assert (status, out) == (2, "")
    assert "note: the run up to t =" in err
    assert "square" in err
    assert read(here / "g.csv").t[-1] == pytest.approx(1.0, abs=0.05)


def test_a_step_that_is_too_long_is_warned_of(tsm, monkeypatch):
    monkeypatch.setattr(sys, "warnoptions", [])  # as where nobody asks for other warnings
    _, _, err = tsm("run", "fig09a_without_feedforward", "--stop", 0.1, "--step", 0.01)
    assert "tsmblocks: warning: diagram 'Motor position loop" in err
    assert "too long for the fastest pole" in err


def test_ctrl_c_gives_the_result_so_far(tsm, here, monkeypatch):
    def stop(_):
        raise KeyboardInterrupt

    whole = SIMULATE.simulate
    monkeypatch.setattr(SIMULATE, "simulate", lambda d, **k: whole(d, **{**k, "progress": stop}))
    status, out, err = tsm("run", "fig09a_without_feedforward", "--stop", 100, "--out", "part.csv")
    assert status == 130
    assert "tracking error" in out
    assert "stopped at t =" in err
    assert 0 < read(here / "part.csv").t[-1] < 100


def test_ctrl_c_in_the_demo_leaves_what_was_done(tsm, here, monkeypatch):
    def once(d, **k):
        monkeypatch.setattr(PAPER, "simulate", stopped)
        return SIMULATE.simulate(d, **k)

    def stopped(d, **k):
        return SIMULATE.simulate(d, **k, progress=raised)

    def raised(_):
        raise KeyboardInterrupt

    monkeypatch.setattr(PAPER, "simulate", once)
    monkeypatch.setattr("tsmblocks.demo.story.build_story", lambda *_: None)
    monkeypatch.setattr("tsmblocks.demo.text.story_text", lambda _: "the story")
    monkeypatch.setattr("tsmblocks.cli.demo._write_story", lambda *_: {})
    status, out, err = tsm("demo", "--out", "d")
    assert (status, "stopped early" in err) == (130, True)
    assert out.startswith("the story")
    assert "55 deg at 0.2 Hz" in out
    assert not (here / "d/index.html").exists()
    assert len((here / "d/results.csv").read_text().splitlines()) == 2


def test_a_fault_of_ours_is_told_apart(tsm, monkeypatch):
    monkeypatch.setattr(SIMULATE, "simulate", lambda *_, **__: 1 / 0)
    status, out, err = tsm("run", "fig09a_without_feedforward")
    assert (status, out) == (1, "")
    assert "ZeroDivisionError" in err
    assert "this is a fault of the program, not of your input" in err


# ---- draw, check, blocks


def test_draw_shows_the_inside_of_a_block_and_goes_on_in_rows(tsm, here):
    loop = "fig09b_elementary"
    assert tsm("draw", loop, "--inside", "compensator.observer", "--out", "inside.svg")[0] == 0
    assert 'data-block="decay"' in (here / "inside.svg").read_text(encoding="utf-8")
    assert tsm("draw", loop, "--inside", "compensator", "--out", "inside.mmd")[0] == 0
    assert "b_quotient" in (here / "inside.mmd").read_text(encoding="utf-8")
    fails(tsm("draw", loop, "--inside", "compensater"), "Did you mean 'compensator'?")
    assert tsm("draw", loop, "--wrap", "600", "--out", "rows.svg")[0] == 0
    assert int(re.search(r'width="(\d+)"', (here / "rows.svg").read_text(encoding="utf-8"))[1]) <= 600


def test_draw_writes_what_the_ending_asks_for(tsm, here):
    for name, start in (("a.svg", "<"), ("a.mmd", "flowchart"), ("a.png", "\x89PNG"), ("a.pdf", "%PDF")):
        status, out, _ = tsm("draw", "fig09b_feedforward", "--out", name)
        assert (status, out) == (0, f"wrote {name}\n")
        assert start in (here / name).read_bytes().decode("latin-1")[:200]
    assert tsm("draw", "fig09b_feedforward")[1] == "wrote fig09b_feedforward.svg\n"
    fails(tsm("draw", "fig09b_feedforward", "--out", "a.jpg"), "must end in .svg, .png, .pdf or .mmd.")


def test_draw_with_other_numbers_and_blocks_marked(tsm, here):
    (here / "gain.toml").write_text(
        'format = 1\ntitle = "Gain"\n[blocks]\na = { type = "Gain", gain = 2.0 }\n'
        '[inputs]\nu = "a"\n[outputs]\ny = "a"\n'
    )
    tsm("draw", "gain.toml", "--out", "plain.svg")
    said = tsm("draw", "gain.toml", "--set", "a.gain=17.25", "--highlight", "a", "--out", "marked.svg")
    assert said[:2] == (0, "wrote marked.svg\n")
    plain, marked = ((here / f"{name}.svg").read_text(encoding="utf-8") for name in ("plain", "marked"))
    pictures = [text.partition("</style>")[2] for text in (plain, marked)]
    assert [text.count(f'"{LIGHT["accent"]}"') > 1 for text in pictures] == [False, True]
    assert [text.count(">17.25<") for text in pictures] == [0, 1]
    fails(tsm("draw", "fig16_feedforward_feedback", "--highlight", "pidd"), "Did you mean 'pid'?")
    assert tsm("draw", "gain.toml", "--symbols", "--theme", "dark", "--out", "plain.svg")[0] == 0
    assert {">K<", '"#161718"'} <= set(re.findall(r'>K<|"#161718"', (here / "plain.svg").read_text(encoding="utf-8")))
    fails(tsm("draw", "fig16_feedforward_feedback", "--highlight", "pid", "--out", "a.mmd"), "Mermaid")
    fails(tsm("draw", "fig16_feedforward_feedback", "--set", "pid.kpp=1"), "Did you mean 'kp'?")


def test_check_counts_or_lists_the_faults(tsm, here):
    status, out, err = tsm("check", "fig16_feedforward_feedback", "tendon_sheath_asymmetric")
    assert (status, err) == (0, "")
    first, second = out.splitlines()
    assert first.startswith(
        "fig16_feedforward_feedback: ok; 10 blocks, 8 states, 29 parameters (19 of them free in a fit)"
    )
    assert "inputs: none; outputs: x_ref [rad], x_out [rad], x_in [rad], u [V]" in first
    assert "inputs: x_in [rad]; outputs: x_out" in second
    (here / "bad.toml").write_text(MISWIRED)
    status, out, err = tsm("check", "bad.toml", "fig09b_feedforward")
    assert status == 2
    assert "fig09b_feedforward: ok" in out
    assert "Did you mean 'ref'?" in err
    assert "1 of 2 files have faults." in err


def test_blocks_lists_families(tsm):
    out = tsm("blocks")[1]
    assert out.index("sources\n") < out.index("hysteresis\n") < out.index("sensors\n")
    assert "  PID " in out
    listed = json.loads(tsm("blocks", "--json")[1])
    assert listed["hysteresis"]["AsymmetricBoucWen"].startswith("Tendon-sheath transmission")
    assert "StateSpace" in listed["linear"]


def test_diagrams_lists_names_and_titles(tsm):
    status, out, err = tsm("diagrams")
    assert (status, err) == (0, "")
    lines = out.splitlines()
    assert [line.split()[0] for line in lines[: lines.index("")] if not line.startswith(" ")] == shipped_names()
    assert all(len(line) <= 80 for line in lines)
    listed = json.loads(tsm("diagrams", "--json")[1])
    assert listed == {name: load(name).title for name in shipped_names()}
    assert "Tendon sheath: play and an offset" in out


def test_a_block_has_a_card(tsm):
    out = tsm("blocks", "pid")[1]
    for part in ("PID (control)", "k_P e", "Source: Paper, Eq (15)", "proportional gain", "in (0, inf)"):
        assert part in out
    card = json.loads(tsm("blocks", "AsymmetricBoucWen", "--json")[1])
    theta = next(p for p in card["parameters"] if p["name"] == "theta")
    assert (theta["default"], theta["unit"], theta["low"], theta["high"]) == (5.034, "1/rad", 0.0, None)
    assert card["inputs"][1]["rate_of"] == "x"
    fails(tsm("blocks", "PDI"), "there is no block 'PDI'. Did you mean 'PID'?")


def test_every_block_has_a_card(tsm):
    for blocks in json.loads(tsm("blocks", "--json")[1]).values():
        for name, words in blocks.items():
            assert words.endswith("."), name
            status, out, _ = tsm("blocks", name)
            assert (status, "Source: " in out) == (0, True)


# ---- demo


def test_demo_repeats_the_paper(tsm, here):
    t = np.arange(0, 12, 0.025)
    rows = [f"{a:.3f}, {b:.6f}" for a, b in zip(t, 60 * np.sin(t), strict=True)]
    (here / "calib.txt").write_text("\n".join(rows))
    data = ["--data", "calib.txt", "--columns", "t,x_ref"]
    status, out, err = tsm("demo", "--out", "d", "--hide", "none", *data, "--column", "x_ref [deg]")
    assert status == 0, err
    assert "27 / 8 / 5.8" in out
    assert "the feedforward leaves 13 deg" in " ".join(out.split())
    assert "x_ref as measured, 11.97 s" in out
    table = np.genfromtxt(here / "d/results.csv", delimiter=",", dtype=str, skip_header=1, usecols=(1, 2), max_rows=9)
    for name, low, high in (("fig09a", 26, 30), ("fig09b", 12, 16), ("fig16", 6, 10)):
        errors = [float(value) for diagram, value in table if diagram.startswith(name)]
        assert len(errors) == 3
        assert low < min(errors) <= max(errors) < high
    made = {path.name for path in (here / "d").iterdir()}
    for case in ("sine", "two_sines", "no_period", "measured"):
        assert {f"tracking_{case}.png", f"loop_{case}.png"} <= made
    assert {"fig16_feedforward_feedback.svg", "fig16_feedforward_feedback.png", "results.csv", "index.html"} <= made


def test_demo_refuses_half_a_measurement(tsm, here):
    (here / "m.csv").write_text("t,x\n0,1\n1,2\n2,3\n3,4\n")
    fails(tsm("demo", "--data", "m.csv"), "needs both --data FILE and --column NAME")
    fails(tsm("demo", "--data", "m.csv", "--column", "x"), "'x' has no unit", "--column 'x [deg]'")
    fails(tsm("demo", "--data", "m.csv", "--column", "y [deg]"), "there is no column 'y'.")
    assert not (here / "tsmblocks-demo").exists()
    (here / "taken").write_text("")
    fails(tsm("demo", "--out", "taken"), "taken: File exists.")


# ---- the program itself


def test_unknown_commands_and_none(tsm):
    assert tsm("help") == tsm("--help")
    assert tsm("help", "fit") == tsm("fit", "--help")
    fails(tsm("rum", "x"), "there is no command 'rum'. Did you mean 'run'?")
    status, out, err = tsm()
    assert (status, out) == (2, "")
    assert "COMMAND" in err


def test_help_and_version(tsm):
    assert tsm("--version")[1].startswith("tsmblocks ")
    for words in (["--help"], ["run", "--help"], ["demo", "--help"]):
        status, out, err = tsm(*words)
        assert (status, err) == (0, "")
        assert "usage: tsmblocks" in out


def python(*words, **options):
    return subprocess.run([sys.executable, *words], capture_output=True, text=True, timeout=120, check=False, **options)


def test_it_runs_as_a_module():
    done = python("-m", "tsmblocks.cli", "rum")
    assert (done.returncode, done.stdout) == (2, "")
    assert python("-m", "tsmblocks", "--version").stdout.startswith("tsmblocks ")


def test_the_command_line_starts_without_the_heavy_libraries():
    heavy = "{'scipy', 'matplotlib', 'control', 'pandas', 'llvmlite'}"
    code = f"import sys, tsmblocks.cli; print({heavy} & set(sys.modules))"
    assert python("-c", code).stdout.strip() == "set()"


@pytest.mark.skipif(os.name == "nt", reason="a reader that goes away shows otherwise on Windows")
def test_a_reader_that_goes_away_is_no_fault():
    code = (
        "import subprocess, sys; words = [sys.executable, '-m', 'tsmblocks', 'blocks']; "
        "p = subprocess.Popen(words, stdout=subprocess.PIPE); p.stdout.close(); print(p.wait())"
    )
    done = python("-c", code)
    assert (done.stdout.strip(), done.stderr) == ("0", "")


def test_without_matplotlib_the_way_out_is_told(tsm, monkeypatch):
    monkeypatch.setitem(sys.modules, "matplotlib.figure", None)
    status, out, err = tsm("run", "fig09a_without_feedforward", "--stop", 1, "--plot", "a.png")
    assert (status, out) == (2, ""), "it is told before the run"
    assert 'Plots need matplotlib: pip install "tsmblocks[plots]"' in err


SERVO = """
format = 1
title = "Servo with a short transient inside"
wires = ["ref -> err.plus", "m.y -> err.minus", "err -> pid -> limit -> m.u"]
[blocks]
ref = { type = "Step", time = 1.3, unit = "rad" }
err = { type = "Sum", signs = "+-" }
pid = { type = "PID", kp = 2.0, ki = 5.0, kd = 0.1 }
limit = { type = "Saturation", low = -24.0, high = 24.0 }
m = { type = "DCMotor", L = 0.00055 }
[outputs]
pos = "m.y"
"""


def test_the_step_is_looked_at_as_from_python(tsm, here):
    (here / "servo.toml").write_text(SERVO)
    arguments = dict(method="sdirk2", step=1e-3, stop=10.0)
    with pytest.warns(StepWarning) as given:
        SIMULATE.simulate(load("servo.toml"), **arguments)
    with warnings.catch_warnings(record=True) as missed:  # the transient of the current shows in no output
        warnings.simplefilter("always")
        SIMULATE.simulate(load("servo.toml"), log="outputs", **arguments)
    assert not missed
    _, _, err = tsm("run", "servo.toml", "--method", "sdirk2", "--step", 0.001, "--stop", 10)
    assert " ".join(str(given[0].message).split()) in " ".join(err.split())
