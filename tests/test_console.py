"""What leaves the command line: widths, JSON, letters a console lacks, and the line that tells how far things are."""

import io
import json
import os
import re
import subprocess
import sys
from pathlib import Path

import numpy as np
import pytest

import tsmblocks.blocks
from tsmblocks.cli import colour, console, main
from tsmblocks.cli.entry import COMMANDS
from tsmblocks.common.tables import columns, split_columns
from tsmblocks.files.shipped import shipped_names
from tsmblocks.model.block import REGISTRY

STUDY = """
format = 1
title = "Größe θ"
diagram = "fig09b_feedforward"
stop = 2
step = 0.005
[metrics]
error = "rms(x_ref - x_out)"
[vary]
theta = [4.0, 5.0]
"""


@pytest.fixture
def here(tmp_path, monkeypatch):
    """A folder with a recording and a study."""
    monkeypatch.chdir(tmp_path)
    t = np.arange(0.0, 3.0, 0.01)
    x = 0.8 * np.sin(3 * t)
    lines = [f"{a:.2f},{b:.6f},{0.8 * b + 0.02 * np.sign(c):.6f}" for a, b, c in zip(t, x, np.cos(3 * t), strict=True)]
    Path("bend.csv").write_text("\n".join(["t [s],x_in [rad],x_out [rad]", *lines]), encoding="utf-8")
    Path("study.toml").write_text(STUDY, encoding="utf-8")
    return tmp_path


class Terminal(io.StringIO):
    """A standard error that somebody looks at."""

    def isatty(self):
        return True

    def seen(self):
        """What stands there at last, and every line as it was."""
        lines = self.getvalue().split("\n")
        return [part for line in lines for part in line.split("\r")]


# ---- widths


@pytest.mark.parametrize("wide", [80, 60, 200])
@pytest.mark.parametrize("command", ["", *COMMANDS])
def test_help_fits_the_terminal(command, wide, monkeypatch, capsys):
    monkeypatch.setenv("COLUMNS", str(wide))
    assert main([*filter(None, [command]), "--help"]) == 0
    lines = capsys.readouterr().out.splitlines()
    examples = [line for line in lines if line.startswith(("  tsmblocks ", "      --", "usage:", "       "))]
    long = [line for line in lines if len(line) > wide and not (wide < 80 and line in examples)]
    assert long == []
    assert any(command in line for line in lines)


@pytest.mark.parametrize("name", sorted(REGISTRY))
def test_every_card_fits_the_terminal(name, monkeypatch, capsys):
    monkeypatch.setenv("COLUMNS", "80")
    assert main(["blocks", name]) == 0
    out = capsys.readouterr().out
    assert [line for line in out.splitlines() if len(line) > 80] == []
    assert "``" not in out
    assert ":math:" not in out


def test_the_list_of_blocks_is_as_wide_as_the_terminal(monkeypatch, capsys):
    said = {}
    for wide in (60, 80):
        monkeypatch.setenv("COLUMNS", str(wide))
        main(["blocks"])
        said[wide] = capsys.readouterr().out
        assert wide - 12 < max(map(len, said[wide].splitlines())) <= wide
    assert said[60].split() == said[80].split()


def test_words_of_the_last_column_go_on_below_themselves():
    rows = [("a", "one two three four five six seven"), ("long", "")]
    assert columns(rows, " ", (0, 1), 32) == " a     one two three four five\n       six seven\n long"
    assert columns(rows, " ", (0, 1), 20) == " a\n     one two three four five\n     six seven\n long"


def test_a_name_that_leaves_the_rest_no_room_stands_above_its_row():
    rows = [("", "rms", "unit"), ("short", "1.25", "deg"), ("a name of thirty letters or so", "12", "deg")]
    shown = ["        rms  unit", "short  1.25   deg", "a name of thirty letters or so", "         12   deg"]
    assert columns(rows, width=20).splitlines() == shown
    assert columns(rows, width=80).splitlines()[2] == "a name of thirty letters or so    12   deg"


def test_columns_that_are_too_many_stand_in_several_tables():
    rows = [("case", "first", "tuned", "second", "tuned"), ("a", "1", "2", "3", "4")]
    assert split_columns(rows) == columns(rows)
    first, second = split_columns(rows, width=22).split("\n\n")
    assert first == columns([row[:3] for row in rows])
    assert second == columns([(row[0], *row[3:]) for row in rows])
    assert split_columns(rows, width=3).count("\n\n") == 3, "what fits nowhere stands alone"


@pytest.mark.parametrize("name", shipped_names())
def test_what_run_and_check_say_of_a_ready_made_diagram_fits(name, here, monkeypatch, capsys):
    monkeypatch.setenv("COLUMNS", "80")
    monkeypatch.setenv("NO_COLOR", "1")
    monkeypatch.setattr("sys.stdout.isatty", lambda: True)
    assert main(["check", name]) == 0
    told = capsys.readouterr().out
    from tsmblocks.files import load

    wanted = list(load(name).inports)
    Path("plain.csv").write_text(Path("bend.csv").read_text("utf-8").replace(" [rad]", ""), "utf-8")
    data = ["--data", "plain.csv", "--map", f"{wanted[0]}=x_in"] if wanted else ["--stop", "1"]
    assert main(["run", name, *data]) == 0
    told += capsys.readouterr().out
    assert "ok; " in told
    assert " s in steps of 0.001 s" in told
    assert [line for line in told.splitlines() if len(line) > 80] == []


@pytest.mark.parametrize(
    "words",
    [
        ["fit", "tendon_sheath_prandtl_ishlinskii", "--starts", "1"],
        ["compare", "tendon_sheath_linear", "tendon_sheath_play", "--starts", "1"],
        ["compare", "tendon_sheath_linear", "tendon_sheath_play", "--starts", "1", "--each"],
        ["diagnose", "tendon_sheath_linear", "--noise-floor", "0.01", "--effects", "backlash", "position_ripple"],
    ],
    ids=lambda words: " ".join(words[:1] + words[-1:]),
)
def test_tables_of_experiments_with_long_names_fit(words, here, capsys):
    names_ = [
        f"bend_at_{angle}_degrees_and_{turn}_of_the_handle" for angle in (60, 90) for turn in ("half", "a_full_turn")
    ]
    for name in names_:
        Path(f"{name}.csv").write_text(Path("bend.csv").read_text("utf-8"), "utf-8")
    assert main([*words, "--data", *(f"{name}.csv" for name in names_)]) == 0
    out = capsys.readouterr().out
    folded = [line for line in out.splitlines() if not line.startswith("  tsmblocks ")]  # a command is copied whole
    assert [line for line in folded if len(line) > 80] == []
    assert "bend_at_60_degrees" in out


def test_tables_of_studies_with_long_names_fit(here, capsys):
    text = STUDY.replace("error = ", '"peak to peak of the tracking error after the start [deg]" = ')
    text = text.replace("theta =", '"drive.high" = [12.0, 24.0]\n"motor.tau" = [0.02, 0.03]\ntheta =')
    Path("long.toml").write_text(text, encoding="utf-8")
    assert main(["study", "long.toml"]) == 0
    out = capsys.readouterr().out
    assert [line for line in out.splitlines() if len(line) > 80] == []
    assert "drive.high" in out


def test_a_line_for_programs_is_not_folded(capsys):
    main(["check", "fig16_feedforward_feedback"])
    assert len(capsys.readouterr().out.splitlines()) == 1


# ---- JSON


def test_every_command_that_prints_results_takes_json(capsys):
    for command in COMMANDS:
        main([command, "--help"])
        assert ("--json" in capsys.readouterr().out) == (command != "completion")


@pytest.mark.parametrize(
    "words",
    [
        ["run", "fig09b_feedforward", "--stop", "1", "--out", "run.csv"],
        ["fit", "tendon_sheath_linear", "--data", "bend.csv", "--starts", "1", "--out", "f.toml", "--plot", "f.png"],
        ["compare", "tendon_sheath_linear", "--data", "bend.csv", "--starts", "1"],
        ["diagnose", "tendon_sheath_linear", "--data", "bend.csv", "--noise-floor", "0.01", "--effects", "backlash"],
        ["study", "study.toml", "--out", "s.csv"],
        ["draw", "fig09b_feedforward"],
        ["check", "fig09b_feedforward", "study.toml"],
        ["export", "eq11_compensator", "--out", "c.c"],
        ["blocks"],
        ["blocks", "Play"],
    ],
    ids=" ".join,
)
def test_json_is_one_object_and_nothing_else(words, here, capsys):
    status = main([*words, "--json"])
    told = capsys.readouterr()
    assert isinstance(json.loads(told.out, parse_constant=pytest.fail), dict)
    assert (status, told.err) == (2 if "check" in words else 0, "")


def test_check_gives_the_faults_of_each_file(here, capsys):
    Path("bad.toml").write_text('format = 1\nwires = ["rf -> lag"]\n[blocks]\nlag = { type = "Lga" }\n', "utf-8")
    assert main(["check", "bad.toml", "nothing.toml", "motor_linear", "--json"]) == 2
    told = json.loads(capsys.readouterr().out)
    bad, missing, sound = told["files"]
    assert told["faulty"] == 2
    assert any("Lga" in fault for fault in bad["faults"])
    assert "nothing.toml" in missing["faults"][0]
    assert (sound["sound"], sound["states"], sound["inputs"]) == (True, 2, {"u": "V"})


def test_numbers_of_numpy_are_numbers_and_what_is_none_is_null(capsys):
    console.print_json(
        {
            "nan": float("nan"),
            "inf": np.float64("-inf"),
            "whole": np.int64(3),
            "yes": np.bool_(True),
            "array": np.array([[1.0, np.nan], [np.inf, 2.5]]),
            "path": Path("a"),
            "pair": (1, None),
            1: np.float32(0.5),
        }
    )
    assert json.loads(capsys.readouterr().out, parse_constant=pytest.fail) == {
        "nan": None,
        "inf": None,
        "whole": 3,
        "yes": True,
        "array": [[1.0, None], [None, 2.5]],
        "path": "a",
        "pair": [1, None],
        "1": 0.5,
    }


def test_what_is_no_value_of_json_is_a_fault_of_ours():
    with pytest.raises(TypeError):
        console.print_json({"what": object()})


# ---- letters


def tsmblocks(*words, encoding):
    place = {**os.environ, "PYTHONIOENCODING": encoding, "PYTHONUTF8": "0", "COLUMNS": "80"}
    done = subprocess.run(
        [sys.executable, "-m", "tsmblocks", *words], capture_output=True, timeout=120, check=False, env=place
    )
    assert b"Traceback" not in done.stderr
    return done.returncode, done.stdout.decode(encoding), done.stderr.decode(encoding)


@pytest.mark.parametrize("encoding", ["cp1252", "ascii", "cp437"])
def test_no_letter_is_too_much_for_a_console(encoding, here):
    calls = (
        ["blocks"],
        ["blocks", "DiscretePID"],
        ["study", "study.toml"],
        ["check", "study.toml", "höhe→.toml"],
        ["run", "fig09b_feedforward", "--stop", "1"],
        ["rün"],
        ["diagnose", "--help"],
        ["fit", "tendon_sheath_linear", "--data", "bend.csv", "--starts", "1"],
    )
    said = {" ".join(words): tsmblocks(*words, encoding=encoding) for words in calls}
    assert [status for status, *_ in said.values()] == [0, 0, 0, 2, 0, 2, 0, 0]
    card, study = said["blocks DiscretePID"][1], said["study study.toml"][1]
    if encoding == "ascii":
        assert "Source: Astrom and Hagglund" in card
        assert "Grosse theta" in study
        assert "hohe->.toml" in said["check study.toml höhe→.toml"][2]
    else:
        assert "Source: Åström and Hägglund" in card
        assert "Größe" in study


@pytest.mark.parametrize("encoding", ["cp1252", "ascii", "utf-8"])
def test_json_is_json_in_every_encoding(encoding, here):
    status, out, err = tsmblocks("study", "study.toml", "--json", encoding=encoding)
    assert (status, err) == (0, "")
    assert json.loads(out)["title"] == "Größe θ"
    assert out.isascii() == (encoding != "utf-8")
    assert json.loads(out.encode(encoding))["title"] == "Größe θ"  # whoever reads it takes it for UTF-8


def test_letters_are_told_by_likeness():
    letters = {
        "→": "->",
        "θ": "theta",
        "Ω": "Omega",
        "é": "e",
        "½": "1/2",
        "漢": "?",
        "µ": "u",
        "²": "^2",
        "⁴": "^4",
        "₂": "2",
        "∫": "int",
        "⌋": ")",
        "\udcff": "?",
    }
    assert {one: console.ascii_letter(one) for one in letters} == letters


def test_the_streams_are_left_as_they_were(monkeypatch):
    stream = io.TextIOWrapper(io.BytesIO(), encoding="cp1252", errors="strict")
    monkeypatch.setattr(sys, "stdout", stream)
    assert main(["blocks", "--json"]) == 0
    assert stream.errors == "strict"


# ---- colour and weight

RED, BOLD_GREEN, PLAIN = "\x1b[1;31m", "\x1b[1;32m", "\x1b[0m"


@pytest.mark.parametrize(
    ("environment", "terminal", "coloured"),
    [
        ({}, True, True),
        ({}, False, False),
        ({"NO_COLOR": "1"}, True, False),
        ({"NO_COLOR": ""}, True, True),
        ({"TERM": "dumb"}, True, False),
        ({"CLICOLOR": "0"}, True, False),
        ({"FORCE_COLOR": "1"}, False, True),
        ({"FORCE_COLOR": "0"}, False, False),
        ({"CLICOLOR_FORCE": "1", "TERM": "dumb"}, False, True),
        ({"FORCE_COLOR": "1", "NO_COLOR": "1"}, True, False),
    ],
)
def test_colours_are_for_terminals_and_obey_the_environment(environment, terminal, coloured, monkeypatch):
    for name in ("NO_COLOR", "FORCE_COLOR", "CLICOLOR_FORCE", "CLICOLOR"):
        monkeypatch.delenv(name, raising=False)
    monkeypatch.setenv("TERM", "xterm")
    for name, value in environment.items():
        monkeypatch.setenv(name, value)
    stream = Terminal() if terminal else io.StringIO()
    monkeypatch.setattr(sys, "stderr", stream)
    assert main(["run", "nothing_of_that_name"]) == 2
    assert ("\x1b" in stream.getvalue()) == coloured
    assert stream.getvalue().startswith(f"{RED}tsmblocks: {PLAIN}" if coloured else "tsmblocks: ")


def test_what_a_reader_looks_for_stands_out():
    text = (
        "NONE. No unmodelled effect is detectable.\n\nname    rms [deg]\nbend        1.25\n\nbeware:\n- a: b\n\n"
        "beware in u -> y:\n- a: b\n\n"
        "changes from the fitted base model:\n+ gap -> x\n- u -> x\n\ngap:\n  width  3.4 deg\n"
    )
    seen = re.findall("\x1b\\[([0-9;]+)m(.*?)\x1b\\[0m", colour.emphasised(text))
    assert seen == [
        ("1;32", "NONE"),
        ("1", "name    rms [deg]"),
        ("1;33", "beware:"),
        ("1;33", "beware in u -> y:"),
        ("1", "changes from the fitted base model:"),
        ("32", "+ gap -> x"),
        ("1", "gap:"),
    ]
    assert re.sub("\x1b\\[[0-9;]*m", "", colour.emphasised(text)) == text


def test_colours_are_in_no_json_and_in_no_file(here, monkeypatch, capsys):
    monkeypatch.setenv("FORCE_COLOR", "1")
    fit = ["fit", "tendon_sheath_linear", "--data", "bend.csv", "--starts", "1"]
    assert main([*fit, "--json"]) == 0
    assert "\x1b" not in capsys.readouterr().out
    assert main([*fit, "--out", "fitted.toml"]) == 0
    assert "\x1b[1mparameter " in capsys.readouterr().out
    assert "\x1b" not in Path("fitted.toml").read_text(encoding="utf-8")
    assert main(["completion", "bash"]) == 0
    assert "\x1b" not in capsys.readouterr().out


def test_codes_of_a_file_steer_no_terminal(here, monkeypatch, capsys):
    monkeypatch.setenv("FORCE_COLOR", "1")
    Path("study.toml").write_text(STUDY.replace("Größe θ", "a\\u001b[31mb"), encoding="utf-8")
    main(["study", "study.toml"])
    assert "\x1b[31m" not in capsys.readouterr().out


@pytest.mark.parametrize("wide", [80, 120])
def test_tables_and_texts_use_the_terminal(wide, here, monkeypatch, capsys):
    monkeypatch.setenv("COLUMNS", str(wide))
    names = ["a_recording_with_a_name_of_some_length_1.csv", "a_recording_with_a_name_of_some_length_2.csv"]
    for name in names:
        Path(name).write_text(Path("bend.csv").read_text(encoding="utf-8"), encoding="utf-8")
    few = ["--noise-floor", "0.002rad", "--effects", "backlash", "drift"]
    assert main(["diagnose", "tendon_sheath_linear", "--data", *names, *few]) == 0
    out = capsys.readouterr().out
    report = out.partition("in a script:")[0]  # code is not wrapped
    assert max(map(len, report.splitlines())) <= wide
    assert (f"{Path(names[0]).stem} " in report) == (wide == 120)  # cut at 28 letters in lines of 80


# ---- how far things are


def watched(monkeypatch, wide=80, term="xterm"):
    stream = Terminal()
    clock = iter(range(1000))
    monkeypatch.setattr(sys, "stderr", stream)
    monkeypatch.setattr(console.time, "monotonic", lambda: next(clock))
    monkeypatch.setenv("COLUMNS", str(wide))
    monkeypatch.setenv("TERM", term)
    return stream


def test_progress_is_one_line_that_is_gone_at_the_end(monkeypatch):
    stream = watched(monkeypatch)
    with console.progress_line(console.search_progress("fitting", 3)) as tell:
        tell("first", 100, 0.5)
        tell("b", 2, 0.25)
    first, second = "fitting by first, start 1 of 3: 100 runs, rms 0.5", "fitting by b, start 2 of 3: 2 runs, rms 0.25"
    assert stream.seen() == ["", first, second.ljust(len(first)), " " * len(second), ""]
    assert "\n" not in stream.getvalue()
    assert "\x1b" not in stream.getvalue()


def test_progress_is_gone_after_ctrl_c_too_and_cut_to_the_terminal(monkeypatch):
    stream = watched(monkeypatch, wide=20)

    def work():
        with console.progress_line(console.percent_progress("a very long piece of work")) as tell:
            tell(0.5)
            raise KeyboardInterrupt

    with pytest.raises(KeyboardInterrupt):
        work()
    assert stream.seen() == ["", "a very long piece o", " " * 19, ""]


def test_progress_is_quiet_where_nobody_looks(monkeypatch):
    stream = watched(monkeypatch)
    with console.progress_line(console.percent_progress("x"), quiet=True) as tell:
        assert tell is None
    assert stream.getvalue() == ""


@pytest.mark.parametrize("dumb", [True, False])
def test_a_file_has_a_line_of_progress_for_each_stage_of_long_work(dumb, monkeypatch):
    stream, now = watched(monkeypatch, term="dumb") if dumb else io.StringIO(), [0.0]
    monkeypatch.setattr(sys, "stderr", stream)
    monkeypatch.setattr(console.time, "monotonic", lambda: now[0])
    calls = [(0.0, "a", 1), (9.0, "a", 2), (11.0, "a", 3), (12.0, "a", 4), (13.5, "b", 5), (40.0, "b", 6), (80, "b", 7)]
    with console.progress_line(lambda stage, done: f"{stage} {done}") as tell:
        for now[0], stage, done in calls:
            tell(stage, done)
    assert stream.getvalue().splitlines() == ["after 11 s: a 3", "after 14 s: b 5", "after 1 min 20 s: b 7"]


def test_work_of_no_stages_has_a_line_at_times(monkeypatch, capsys):
    now = [0.0]
    monkeypatch.setattr(console.time, "monotonic", lambda: now[0])
    with console.progress_line(lambda done: f"{done:g}") as tell:
        for now[0] in (0.0, 5.0, 20.0, 21.0, 90.0):
            tell(now[0] / 100)
    assert capsys.readouterr().err.splitlines() == ["after 20 s: 0.2", "after 1 min 30 s: 0.9"]


def test_progress_is_shown_as_often_as_it_can_be_read(monkeypatch):
    stream = watched(monkeypatch)
    clock = iter([0.0, 0.01, 0.02, 0.2, 0.21])
    monkeypatch.setattr(console.time, "monotonic", lambda: next(clock))
    with console.progress_line(console.percent_progress("x")) as tell:
        for share in (0.1, 0.2, 0.3, 0.4):
            tell(share)
    assert stream.seen()[1:3] == ["x: 10 % done", "x: 40 % done"]


def test_the_time_that_is_left_is_that_of_the_work_so_far():
    now = [0.0]
    left = console.TimeLeft(lambda: now[0])
    said = []
    for now[0], done in ((0.0, 0.0), (0.5, 0.05), (4.0, 0.0), (10.0, 0.25), (30.0, 0.5), (60.0, 1.0)):
        said.append(left(done))
    assert said == ["", "", "", ", about 30 s left", ", about 30 s left", ""]
    assert left(0.5, "another") == ""
    now[0] = 160.0
    assert left(0.75, "another") == ", about 1 min 40 s left"


def test_a_comparison_says_which_fit_it_is_at():
    from tsmblocks.cli import compare

    words = compare._progress(["play", "linear"], 2)
    said = [words(name, runs, 0.5) for name, runs in (("play", 9), ("play", 2), ("linear", 3), ("play", 4))]
    assert said == [
        "fitting play, 1 of 4, start 1: 9 runs, rms 0.5",
        "fitting play, 1 of 4, start 2: 2 runs, rms 0.5",
        "fitting linear, 2 of 4, start 1: 3 runs, rms 0.5",
        "fitting play, 3 of 4, start 1: 4 runs, rms 0.5",
    ]


@pytest.mark.parametrize("command", ["run", "fit", "study"])
def test_commands_leave_nothing_of_it_on_a_terminal(command, here, monkeypatch, capsys):
    stream = watched(monkeypatch)
    words = {
        "run": ["fig09b_feedforward", "--stop", "100"],
        "study": ["study.toml"],
        "fit": ["tendon_sheath_linear", "--data", "bend.csv", "--starts", "2"],
    }
    assert main([command, *words[command]]) == 0
    assert stream.seen()[-1] == stream.seen()[-2].strip() == ""
    assert any(part.strip() for part in stream.seen()), "something was told on the way"
