"""The command run beside a recording: what signals without a unit are taken for, and measured outputs compared."""

import json
import re

import numpy as np
import pytest

import tsmblocks as tsm
from tsmblocks.cli import main
from tsmblocks.common.errors import DataError

PLAY = "tendon_sheath_play"
T = np.arange(301) / 100
X = 40 * np.sin(2 * T)
Y = 35 * np.sin(2 * T - 0.1) + 1


@pytest.fixture
def run(tmp_path, monkeypatch, capsys):
    """Run a command beside m.csv, whose header tells no units; exit status, standard output and standard error."""
    monkeypatch.chdir(tmp_path)
    rows = "".join(f"{t:.2f},{x:.4f},{y:.4f}\n" for t, x, y in zip(T, X, Y, strict=True))
    (tmp_path / "m.csv").write_text("Time,Motor pos,Tip pos\n" + rows)

    def go(*words):
        status = main([*words])
        told = capsys.readouterr()
        return status, told.out, told.err

    return go


TOLD = ("--map", "x_in [deg]=Motor pos", "x_out [deg]=Tip pos")


def test_a_measured_output_is_compared_as_score_does(run):
    status, out, err = run("run", PLAY, "--data", "m.csv", *TOLD, "--step", "0.01")
    assert (status, err) == (0, "")
    record = tsm.read("m.csv", map={"x_in [deg]": "Motor pos", "x_out [deg]": "Tip pos"})
    (left,) = tsm.score(tsm.load(PLAY), record, step=0.01).in_degrees()
    shown = [f"{value:#.4g}" for value in (np.ptp(left.residual), left.rms, left.largest)]
    assert out.splitlines()[-1].split() == [
        "x_out",
        shown[0],
        "deg",
        shown[1],
        "deg",
        shown[2],
        "deg",
        str(len(left.t)),
    ]
    assert out.splitlines()[-2].split() == [
        "measured",
        "less",
        "run",
        "peak",
        "to",
        "peak",
        "rms",
        "largest",
        "samples",
    ]
    told = json.loads(run("run", PLAY, "--data", "m.csv", *TOLD, "--step", "0.01", "--json")[1])["measured"]
    assert [(d["output"], d["samples"]) for d in told] == [("x_out", 301)]
    assert np.rad2deg(told[0]["rms"]) == pytest.approx(left.rms, rel=1e-9)


RAM = """\
format = 1
[blocks]
ram = { type = "Gain", gain = 2e-10 }
[inputs]
p = { ports = "ram.u", unit = "Pa" }
[outputs]
x = { signal = "ram", unit = "m" }
"""


def test_outputs_are_shown_in_the_units_of_the_recording(run, tmp_path):
    (tmp_path / "ram.toml").write_text(RAM, encoding="utf-8")
    rows = "".join(f"{t:.2f},{50 * t:.4f},{t:.4f}\n" for t in T)
    (tmp_path / "ram.csv").write_text("t [s],p [bar],x [mm]\n" + rows, encoding="utf-8")
    _, out, _ = run("run", "ram.toml", "--data", "ram.csv", "--step", "0.01")
    assert re.search(r"\nx +mm +0 +3 +3\n", out)
    shown = json.loads(run("run", "ram.toml", "--data", "ram.csv", "--step", "0.01", "--json")[1])["outputs"]["x"]
    assert (shown["unit"], shown["max"]) == ("m", pytest.approx(0.003))


def test_a_run_between_the_samples_and_over_a_part_is_compared_there(run):
    words = ("run", PLAY, "--data", "m.csv", *TOLD, "--json")
    fine, part = (json.loads(run(*words, *more)[1])["measured"][0] for more in ((), ("--stop", "1.5")))
    assert (fine["samples"], part["samples"]) == (301, 151)
    record = tsm.read("m.csv", map={"x_in [deg]": "Motor pos", "x_out [deg]": "Tip pos"})
    (left,) = tsm.score(tsm.load(PLAY), record, step=1e-3)
    assert fine["rms"] == pytest.approx(left.rms, rel=1e-6)


def test_the_measurement_is_drawn_beside_the_run(run, tmp_path):
    pytest.importorskip("matplotlib").use("Agg")
    assert run("run", PLAY, "--data", "m.csv", *TOLD, "--plot", "p.svg")[0] == 0
    text = (tmp_path / "p.svg").read_text(encoding="utf-8")
    assert "measured" in text
    assert "residual" in text


def test_without_measured_outputs_nothing_is_compared(run):
    status, out, _ = run("run", PLAY, "--data", "m.csv", "--map", "x_in [deg]=Motor pos", "--json")
    assert status == 0
    assert "measured" not in json.loads(out)


def test_a_map_the_wrong_way_round_is_told_the_right_way(run):
    wrong = ("run", PLAY, "--data", "m.csv", "--map", "Motor pos=x_in [deg]")
    said = run(*wrong)[2]
    assert said == (
        f"tsmblocks: --map Motor pos=…: '{PLAY}' has no input or output 'Motor pos'. --map takes NAME=COLUMN: the "
        "other way round that is --map 'x_in [deg]=Motor pos'.\n"
    )
    assert run(*wrong[:-1], said.rpartition("--map ")[2].strip(".'\n"))[0] == 0


def test_one_name_of_two_columns_is_refused_and_one_column_of_two_names_is_told(run):
    words = ("run", PLAY, "--data", "m.csv", "--map", "x_in [deg]=Motor pos")
    assert run(*words, "x_in=Tip pos") == (
        2,
        "",
        "tsmblocks: --map names 'x_in' twice, for the columns 'Motor pos' and 'Tip pos'.\n",
    )
    status, _, err = run(*words, "x_out [deg]=Motor pos")
    assert (status, err) == (0, "note: m.csv: x_in and x_out are the same column, 'Motor pos'.\n")


def test_a_name_that_is_neither_input_nor_output_is_refused(run):
    assert run("run", PLAY, "--data", "m.csv", "--map", "x_in=Motor pos", "x_uot=Tip pos") == (
        2,
        "",
        f"tsmblocks: --map x_uot=…: '{PLAY}' has no input or output 'x_uot'. Did you mean 'x_out'?\n",
    )


UNTOLD = (
    "note: small.csv: x_in and x_out have no unit and are taken to be in rad. Where that is wrong, give the unit: "
    "--map 'x_in [deg]=Motor pos'.\n"
)
FOUR = [("run", PLAY), ("fit", PLAY, "--starts", "1"), ("compare", "play", "--starts", "1"), ("diagnose", PLAY)]
BARE = ("--map", "x_in=Motor pos", "x_out=Tip pos")


@pytest.mark.parametrize("command", FOUR[:3], ids=lambda words: words[0])
def test_signals_without_a_unit_are_told_once_and_first(run, command, tmp_path):
    rows = "".join(f"{t:.2f},{x / 40:.4f},{y / 40:.4f}\n" for t, x, y in zip(T, X, Y, strict=True))
    (tmp_path / "small.csv").write_text("Time,Motor pos,Tip pos\n" + rows)
    _, out, err = run(*command, "--data", "small.csv", *BARE)
    assert err == UNTOLD
    if command[0] != "run":
        assert "x_in and x_out have no unit and are taken to be in rad." in " ".join(out.split())
    assert "no unit" not in "".join(run(*command, "--data", "small.csv", *TOLD)[1:])


@pytest.mark.parametrize("command", FOUR, ids=lambda words: words[0])
def test_angles_of_many_turns_without_a_unit_are_refused(run, command):
    status, out, err = run(*command, "--data", "m.csv", *BARE)
    assert (status, out) == (2, "")
    assert err == (
        "tsmblocks: m.csv: x_in and x_out have no unit and reach 40 and 36, which in rad would be 6.37 and 5.73 "
        "turns: they are probably in deg. Give the units: --map 'x_in [deg]=Motor pos' 'x_out [deg]=Tip pos', or "
        "[rad] where that is meant.\n"
    )
    assert run(*command, "--data", "m.csv", *BARE, "--json")[2] == err


def test_radians_that_are_told_are_believed(run):
    words = ("run", PLAY, "--data", "m.csv", "--map", "x_in [rad]=Motor pos", "x_out [rad]=Tip pos")
    assert run(*words)[::2] == (0, "")


CALLS = {
    "fit": lambda *records: tsm.fit(tsm.load(PLAY), [*records], starts=1),
    "compare": lambda *records: tsm.compare(["linear", "play"], [*records], starts=1),
    "diagnose": lambda *records: tsm.diagnose(tsm.load(PLAY), [*records], noise_floor=0.5),
    "score": lambda *records: tsm.score(tsm.load(PLAY), [*records]),
}


@pytest.mark.parametrize("call", CALLS.values(), ids=CALLS)
def test_calls_refuse_angles_of_many_turns_without_a_unit(call):
    """One such recording is enough."""
    small = tsm.Record("small", T, {"x_in": X / 40, "x_out": Y / 40}, {})
    with pytest.raises(DataError) as told:
        call(small, tsm.Record("m", T, {"x_in": X, "x_out": Y / 40}, {}))
    assert str(told.value) == (
        "m: x_in has no unit and reaches 40, which in rad would be 6.37 turns: it is probably in deg. "
        "Give the unit: units={'x_in': 'deg'}, or 'rad' where that is meant."
    )


def test_calls_note_what_was_taken_for_radians():
    record = tsm.Record("m", T, {"x_in": X / 4, "x_out": Y / 4}, {})
    said = "m: x_in and x_out have no unit and are taken to be in rad."
    quick = dict(starts=1, step=0.01)
    assert tsm.fit(tsm.load(PLAY), record, **quick).notes[0] == said
    found = tsm.compare(["linear", "play"], record, **quick)
    assert found.notes == (said,)
    assert "- m: x_in and x_out have no unit" in str(found)
    made = tsm.diagnose(tsm.load("tendon_sheath_linear"), record, noise_floor=0.5, effects=["drift"], step=0.01)
    assert made.notes[0] == said
    assert made.segments[0].gaps[0].given == "0.5 rad given"


def test_the_way_to_say_milliseconds_is_taken(run, tmp_path):
    text = (tmp_path / "m.csv").read_text().splitlines()
    rows = [f"{1000 * float(line.partition(',')[0]):g},{line.partition(',')[2]}" for line in text[1:]]
    (tmp_path / "ms.csv").write_text("\n".join([text[0], *rows]) + "\n")
    words = ("run", PLAY, "--data", "ms.csv", *TOLD, "--step")
    err = run(*words, "1")[2]
    assert err.startswith("note: ms.csv: Time has no unit and was taken to be in s, which makes 10 s from row to row.")
    way = err.rpartition("--map ")[2].strip(".'\n")
    status, out, err = run(*words, "0.01", "--map", way)
    assert (status, err) == (0, "")
    assert "0 to 3 s in steps of 0.01 s" in out


# ---- noise of the inputs


SYMMETRIC = "tendon_sheath_symmetric"
NOISY = ("--data", "noisy.csv", "--step", "0.02")
TAKE_OUT = "which drives hysteresis and friction. Filter it first: --condition."


@pytest.fixture
def noisy(tmp_path):
    """Write noisy.csv, in which the input of hysteresis is measured with noise; what was written."""
    t, rng = np.arange(501) / 50, np.random.default_rng(3)
    x = 40 * np.sin(2 * t) + rng.normal(0.0, 1.0, len(t))
    y = 35 * np.sin(2 * t - 0.1) + rng.normal(0.0, 0.1, len(t))
    rows = "".join(f"{a:.2f},{b!r},{c!r}\n" for a, b, c in zip(t, x.tolist(), y.tolist(), strict=True))
    (tmp_path / "noisy.csv").write_text("t [s],x_in [deg],x_out [deg]\n" + rows)
    return tsm.Record("noisy", t, {"x_in": x, "x_out": y}, {"x_in": "deg", "x_out": "deg"})


COMMANDS = [
    ("run", SYMMETRIC, *NOISY),
    ("fit", SYMMETRIC, *NOISY, "--free", "offset.bias", "--starts", "1"),
    ("compare", "symmetric", *NOISY, "--starts", "1"),
]


@pytest.mark.parametrize("command", COMMANDS, ids=lambda words: words[0])
def test_noise_of_an_input_is_told_with_the_option_that_takes_it_out(run, noisy, command):
    status, out, err = run(*command)
    assert status == 0
    said = " ".join((out + err).split())
    assert said.count("x_in is noisy: its path is ") == said.count(TAKE_OUT) == 1
    assert "filtered(" not in said
    status, out, err = run(*command, "--condition")
    assert status == 0
    assert "is noisy" not in out + err
    (note,) = [text for text in noisy.conditioned(["x_in"]).notes if "was filtered" in text]
    assert err.startswith(f"note: noisy.csv: {note}\n")
    facts = json.loads(run(*command, "--json")[1])
    assert any(text.endswith(TAKE_OUT) for text in facts["notes"])


def test_a_call_names_the_call_that_takes_the_noise_out(noisy):
    (said,) = tsm.compare(["tendon_sheath_symmetric", "play"], noisy, starts=1, step=0.02).notes
    assert said.startswith("noisy: x_in is noisy: ")
    assert said.endswith("Filter it first: filtered('x_in').")


def test_conditioned_inputs_are_those_of_a_diagnosis(run, noisy):
    words = ("run", SYMMETRIC, *NOISY, "--condition", "--json")
    (left,) = json.loads(run(*words)[1])["measured"]
    (same,) = tsm.score(tsm.load(SYMMETRIC), noisy.conditioned(["x_in"]), step=0.02)
    assert left["rms"] == pytest.approx(same.rms, rel=1e-6)
