"""The command diagnose as a user meets it: what is printed and written, refusals, Ctrl-C."""
# ruff: noqa: E501 - the text of a message stands on one line, as the user reads it

import json
import signal
import sys
import time
from contextlib import nullcontext

import numpy as np
import pytest

import tsmblocks as tsm
from tsmblocks.cli import console, main
from tsmblocks.common.errors import ParameterError
from tsmblocks.fitting.noise import given_floors

T = np.arange(0.0, 6.0, 0.02)
X = 50 * np.sin(1.3 * T) + 20 * np.sin(5.1 * T)
NOISE = 0.2
BASE = ("tendon_sheath_linear", "--data", "full.csv", "half.csv", "--noise-floor", "0.2deg")
FEW = ("--effects", "backlash", "drift", "dead_time")


def played(x, half_width=1.5, gain=0.92, seed=1):
    """Play as the textbook has it, in degrees, behind a gain, with noise."""
    middle, y = 0.0, []
    for u in gain * x:
        middle = max(u - half_width, min(u + half_width, middle))
        y.append(middle)
    return np.array(y) + np.random.default_rng(seed).normal(0.0, NOISE, len(x))


def write(name, x, y, head="t [s],x_in [deg],x_out [deg]\n", t=T):
    rows = "".join(f"{a:.6g},{b:.6g},{c:.6g}\n" for a, b, c in zip(t, x, y, strict=True))
    with open(name, "w", encoding="utf-8") as file:
        file.write(head + rows)


@pytest.fixture
def run(tmp_path, monkeypatch, capsys):
    """Run `diagnose` beside full.csv and half.csv; its exit status, standard output and standard error."""
    monkeypatch.chdir(tmp_path)
    write("full.csv", X, played(X))
    write("half.csv", X / 2, played(X / 2, seed=2))

    def go(*words):
        status = main(["diagnose", *(str(word) for word in words)])
        told = capsys.readouterr()
        return status, told.out, told.err

    return go


def test_the_text_begins_with_what_was_found(run):
    status, out, err = run(*BASE, *FEW)
    assert (status, err) == (0, "")
    assert out.startswith(
        "NAMED. Unmodelled effect between x_in and x_out: a backlash gap (backlash on\noffset.y -> x_out, gap width 3."
    )
    assert "wrote" not in out


def test_details_follow_the_summary_on_request(run):
    _, summary, _ = run(*BASE, *FEW)
    assert "candidates, round" not in summary
    status, out, _ = run(*BASE, *FEW, "--details")
    assert status == 0
    *kept, more = summary.rstrip().split("\n\n")
    assert more.startswith("Details, with --details")
    assert out.startswith("\n\n".join(kept))
    assert "with --details" not in out
    assert all(words in out for words in ("candidates, round 1", "detection limits", "in a script:"))
    _, json_only, _ = run(*BASE, *FEW, "--details", "--json")
    json.loads(json_only)


def test_three_files_are_written_into_a_new_folder(run, tmp_path):
    status, out, _ = run(*BASE, *FEW, "--out", "a/found")
    assert status == 0
    assert out.endswith("\n\nwrote a/found/diagnosis.json\nwrote a/found/augmented.toml\nwrote a/found/report.html\n")
    facts = json.loads((tmp_path / "a/found/diagnosis.json").read_text(encoding="utf-8"))
    assert facts["verdict"] == "named"
    assert facts["experiments"] == ["full", "half"]
    assert [e["name"] for e in facts["effects"]] == ["backlash"]
    augmented = tsm.load(tmp_path / "a/found/augmented.toml")
    run_ = tsm.simulate(augmented, inputs={"x_in": (T, np.radians(X))}, stop=5.0, step=0.01)
    assert augmented.blocks["backlash"].half_width == pytest.approx(np.radians(1.5), rel=0.1)
    assert np.isfinite(run_["x_out"]).all()
    assert (tmp_path / "a/found/report.html").read_text(encoding="utf-8").startswith("<!DOCTYPE html>")


def test_json_is_what_the_file_holds_and_where_the_data_are_from(run, tmp_path):
    status, out, err = run(*BASE, *FEW, "--out", "found", "--json")
    facts = json.loads(out)
    assert (status, err) == (0, "")
    assert facts.pop("written") == [f"found/{name}" for name in ("diagnosis.json", "augmented.toml", "report.html")]
    assert [d["experiment"] for d in facts.pop("data")] == ["full", "half"]
    assert facts == json.loads((tmp_path / "found/diagnosis.json").read_text(encoding="utf-8"))


def test_the_same_seed_gives_the_same_bytes(run, tmp_path):
    for name in ("one", "two"):
        assert run(*BASE, *FEW, "--seed", 5, "--out", name)[0] == 0
    for name in ("diagnosis.json", "augmented.toml", "report.html"):
        assert (tmp_path / "one" / name).read_bytes() == (tmp_path / "two" / name).read_bytes()


def test_a_figure_is_drawn_on_request(run, tmp_path):
    pytest.importorskip("matplotlib")
    status, out, _ = run(*BASE, "--effects", "drift", "--plot", "found.png")
    assert (status, out[-len("wrote found.png\n") :]) == (0, "wrote found.png\n")
    assert (tmp_path / "found.png").read_bytes().startswith(b"\x89PNG")


@pytest.mark.parametrize(
    "words",
    [("0.2deg",), ("x_out=0.2deg",), ("x_out = 0.2 deg",), (f"{np.radians(0.2)}rad",), ("x_out=3.490658504mrad",)],
)
def test_a_floor_may_have_a_unit_and_an_output(run, words):
    _, out, _ = run(*BASE[:4], "--effects", "drift", "--noise-floor", *words, "--json", "--no-condition")
    gap = json.loads(out)["gap"]
    assert gap["noise_floor"] == pytest.approx(np.radians(0.2), rel=1e-5)
    assert gap["noise_floor_from"] == "given"


def test_a_floor_without_an_output_goes_to_those_it_measures():
    diagram = tsm.Diagram(
        title="two",
        blocks={"a": tsm.blocks.Gain(), "b": tsm.blocks.Gain()},
        inputs={"u": tsm.Inlet("a.u", unit="V"), "x": tsm.Inlet("b.u", unit="rad")},
        outputs={"i": "a", "y": "b"},
    )
    signals = {"u": T, "x": T, "i": T, "y": T}
    records = {"e": tsm.Record("e", T, signals, {"u": "V", "x": "rad", "i": "V", "y": "rad"})}
    outputs = ("i", "y")
    asked = lambda given: given_floors(given, diagram, records, outputs)  # noqa: E731 - four times the same
    assert asked(["2mV"]) == {"i": (0.002, "2 mV")}
    assert asked(["2mV", "y=1deg"]) == {"i": (0.002, "2 mV"), "y": (pytest.approx(np.radians(1)), "1 deg")}
    assert asked(["i=0.5", "y=0.5"]) == asked({"i": 0.5, "y": 0.5}) == {"i": (0.5, "0.5 V"), "y": (0.5, "0.5 rad")}
    assert asked([]) == asked(None) == {}
    assert given_floors(0.5, diagram, records, ("y",)) == {"y": (0.5, "0.5 rad")}
    for number in (0.5, ["0.5"]):
        with pytest.raises(ParameterError) as refused:
            asked(number)
        assert str(refused.value) == (
            "noise_floor=0.5 has no unit, and the outputs differ: i in V, y in rad. "
            "Give one for each: 'i=0.5V' 'y=0.5rad'."
        )


def test_a_number_means_the_unit_of_recording_and_diagram_or_is_refused(run):
    words = (*BASE[:4], "--effects", "drift", "--noise-floor")
    assert run(*words, "0.06") == (
        2,
        "",
        (
            "tsmblocks: --noise-floor 0.06 has no unit, and x_out is in deg in the recording 'full' but compared in "
            "rad: write '0.06deg' or '0.06rad'.\n"
        ),
    )
    assert run(*words, "x_out=0.06")[2] == run(*words, "0.06")[2]


def test_what_was_repaired_is_told_once(run):
    times = np.append(T, T[-1])
    for name, x in (("full.csv", X), ("half.csv", X / 2)):
        write(name, np.append(x, x[-1]), np.append(played(x), 0.0), t=times)
    status, out, err = run(*BASE, "--effects", "drift")
    assert (status, err) == (0, "")
    assert out.count("repeated the time of the row before") == 1
    assert "- all experiments: 1 row repeated the time of the row before" in out
    status, out, err = run(*BASE, "--effects", "drift", "--free", "nothing.*")
    assert (status, out) == (2, "")
    assert err.count("repeated the time of the row before") == 2


def test_a_floor_in_another_unit_is_doubted(run):
    _, out, _ = run(*BASE[:-1], "0.2rad", "--effects", "backlash")
    assert "NONE." in out
    assert "the noise floor given for x_out (11.5 deg) is above the residual of the base (1." in " ".join(out.split())
    assert "so no effect can be found: is it in the right unit (rad)?" in " ".join(out.split())
    assert "right unit" not in run(*BASE, "--effects", "backlash")[1]


def test_names_of_effects_are_patterns(run):
    _, out, _ = run(*BASE, "--effects", "dr*", "jump", "--json")
    assert {r["name"] for r in json.loads(out)["ranking"]} == {"drift", "jump"}


def test_inputs_are_left_alone_on_request(run):
    notes = [
        json.loads(run(*BASE, "--effects", "drift", "--json", *more)[1])["notes"] for more in ((), ("--no-condition",))
    ]
    assert any("x_in" in text for text in notes[0])
    assert not any("x_in" in text for text in notes[1])


def test_a_window_is_typed_as_for_fit(run):
    status, out, _ = run(*BASE, *FEW, "--window", "1:", "--json")
    facts = json.loads(out)
    assert status == 0
    assert facts["windows"] == {"full": [1.0, 5.98], "half": [1.0, 5.98]}
    assert [e["name"] for e in facts["effects"]] == ["backlash"]
    assert "full: only 1 s to 5.98 s is compared." in facts["notes"]


def test_only_what_is_free_is_fitted(run, tmp_path):
    assert run(*BASE, "--effects", "drift", "--free", "offset.*", "--out", "found")[0] == 0
    augmented, base = tsm.load(tmp_path / "found/augmented.toml"), tsm.load("tendon_sheath_linear")
    assert augmented.parameters["gain.gain"] == base.parameters["gain.gain"]
    assert augmented.parameters["offset.bias"] != base.parameters["offset.bias"]


# ---- refusals


@pytest.mark.parametrize(
    ("words", "message"),
    [
        (
            (),
            "the following arguments are required: DIAGRAM. Name it before the options. 'tsmblocks diagnose --help' shows what it takes.",
        ),
        (("tendon_sheath_linear",), "give --data FILE with the signals x_in, x_out."),
        (("tendon_sheath_linaer", "--data", "full.csv"), None),
        ((*BASE, "--effects", "drfit"), "--effects: 'drfit' names no effect of the catalogue. Did you mean 'drift'?"),
        (
            (*BASE[:4], "--noise-floor", "0.2V"),
            "--noise-floor 0.2V: 'V' cannot be converted to the unit of x_out [rad].",
        ),
        (
            (*BASE[:4], "--noise-floor", "0.2dge"),
            "--noise-floor 0.2dge: 'dge' is not a unit known here. Did you mean 'deg'?",
        ),
        (
            (*BASE[:4], "--noise-floor", "x_uot=0.2deg"),
            "--noise-floor: 'x_uot' is not compared here. Did you mean 'x_out'?",
        ),
        ((*BASE, "0.3deg"), "--noise-floor gives x_out two values; name each output once."),
        (
            (*BASE[:4], "--noise-floor", "much"),
            "--noise-floor: 'much' is not VALUE, VALUE with a unit, or OUTPUT=VALUE, such as 0.05deg or x_out=0.05deg.",
        ),
        ((*BASE[:4], "--noise-floor", "0"), "--noise-floor: '0' is not finite and above 0."),
        ((*BASE[:4], "--noise-floor", "1e999"), "--noise-floor: '1e999' is not finite and above 0."),
        (
            (*BASE, "--seed", "-1"),
            "argument --seed: '-1' is not a whole number of at least 0. 'tsmblocks diagnose --help' shows what it takes.",
        ),
        (
            (*BASE, "--out", "full.csv"),
            "--out: 'full.csv' is a file; name a folder for diagnosis.json, augmented.toml and report.html.",
        ),
        (
            (*BASE, "--out", "found.html"),
            "--out: 'found.html' is the name of a file; name a folder for diagnosis.json, "
            "augmented.toml and report.html, such as 'found'.",
        ),
        ((*BASE, "--plot", "found.gif"), "'found.gif' must end in .png, .svg or .pdf."),
        (
            (*BASE, "--outputs", "x_uot"),
            "diagram 'Tendon sheath: a gain and an offset' has no output 'x_uot'. Did you mean 'x_out'?",
        ),
        (
            (*BASE, "--rows", "1:81"),
            "a diagnosis takes at least 200 samples of all experiments together, and there are 160: with fewer, no effect is distinguishable from chance.",
        ),
        ((*BASE, "--noise-flor", "1"), "diagnose takes no option '--noise-flor'. Did you mean '--noise-floor'?"),
    ],
)
def test_refusals_say_what_to_do(run, words, message):
    status, out, err = run(*words)
    assert (status, out) == (2, "")
    if message is not None:
        assert err == f"tsmblocks: {message}\n"


def test_a_refused_diagnosis_leaves_no_empty_folder(run, tmp_path):
    words = (*BASE, "--outputs", "x_uot", "--out")
    (tmp_path / "old").mkdir()
    for folder in ("new", "old"):
        assert run(*words, folder)[0] == 2
    assert not (tmp_path / "new").exists()
    assert (tmp_path / "old").is_dir()


def test_an_output_without_noise_asks_for_the_floor(run):
    write("full.csv", X, 0 * X)
    status, out, err = run("tendon_sheath_linear", "--data", "full.csv", *FEW)
    assert (status, out) == (2, "")
    assert err == (
        "note: full.csv: x_out never changes (it is 0 throughout).\n"
        "tsmblocks: no noise was found in x_out, so the residual has no scale. Give the noise floor "
        "with its unit: --noise-floor …rad.\n"
    )


# ---- Ctrl-C, and the line of progress


def stops(monkeypatch, stage, after=0):
    """Let Ctrl-C come with a stage of the search, when it was told of it often enough."""
    told = []

    def tell(name, done, of):
        told.append(name)
        if told.count(stage) > after:
            raise KeyboardInterrupt

    monkeypatch.setattr(console, "progress_line", lambda words, quiet: nullcontext(tell))
    return told


def test_ctrl_c_before_anything_was_found_says_so(run, monkeypatch, tmp_path):
    stops(monkeypatch, "calibrated")
    assert run(*BASE, *FEW, "--out", "found") == (130, "", "tsmblocks: stopped before everything was done.\n")
    assert not (tmp_path / "found").exists()


def test_ctrl_c_keeps_what_was_found(run, monkeypatch, tmp_path):
    told = stops(monkeypatch, "never")
    run(*BASE, *FEW)
    last = len([name for name in told if name == "tried"])
    stops(monkeypatch, "tried", last - 1)
    status, out, err = run(*BASE, *FEW, "--out", "found")
    assert status == 130
    assert "interrupted; these are the results until then." in out
    assert err.endswith(
        "tsmblocks: stopped before the search was over; what you see and what was written is the best so far.\n"
    )
    facts = json.loads((tmp_path / "found/diagnosis.json").read_text(encoding="utf-8"))
    assert facts["status"] == "interrupted"
    assert {r["name"] for r in facts["ranking"]} == {"backlash", "drift", "dead_time"}


def test_a_terminal_is_told_how_far_the_search_is_and_how_long_the_rest_takes():
    from tsmblocks.cli import diagnose

    now = [0.0]
    told = diagnose._Progress(clock=lambda: now[0])
    assert told("conditioned", 0, 1) == "preparing the recordings"
    assert told("calibrated", 0, 1) == "fitting the model as it is"
    assert told("tried", 0, 64) == "search 1: screening candidate 1 of 64"
    assert told("fitted", 0, 5) == "search 1: fitting candidate 1 of 5"
    now[0] = 6.0
    assert told("fitted", 2, 5) == "search 1: fitting candidate 3 of 5, about 9 s left"
    now[0] = 600.0
    assert told("fitted", 3, 5) == "search 1: fitting candidate 4 of 5, about 6 min 40 s left"
    assert told("tried", 0, 64) == "search 2: screening candidate 1 of 64"
    assert told("fitted", 0, 5) == "search 2: fitting candidate 1 of 5"
    limited = diagnose._Progress(300.0, clock=lambda: now[0])
    now[0] += 250.0
    assert limited("tried", 0, 9) == "search 1: screening candidate 1 of 9; ends in 50 s at most"


def test_a_time_limit_ends_the_search_with_what_was_found(run, monkeypatch, tmp_path):
    """The clock of the search is turned on when the last round begins."""
    told, clock = stops(monkeypatch, "never"), time.monotonic
    run(*BASE, *FEW)
    last, ahead = told.count("tried"), [0.0]
    monkeypatch.setattr(time, "monotonic", lambda: clock() + ahead[0])

    def tell(name, done, of):
        told.append(name)
        if told.count("tried") == last:
            ahead[0] = 1e6

    told.clear()
    monkeypatch.setattr(console, "progress_line", lambda words, quiet: nullcontext(tell))
    status, out, err = run(*BASE, *FEW, "--time-limit", "1e5", "--out", "found")
    assert (status, err) == (0, "")  # it is what was asked for
    assert "the search ended at its time limit of 100000 s." in " ".join(out.split())
    assert "ended at the time limit; these are the results until then." in out
    assert out.startswith("SEARCH ENDED AT ITS TIME LIMIT. ")
    assert json.loads((tmp_path / "found/diagnosis.json").read_text(encoding="utf-8"))["status"] == "limit"
    assert "ended at the time limit" in (tmp_path / "found/report.html").read_text(encoding="utf-8")
    monkeypatch.setattr(console, "progress_line", lambda words, quiet: nullcontext(None))
    status, out, err = run(*BASE, *FEW, "--time-limit", "1e-9")
    assert (status, out) == (2, "")
    assert "the time limit of 1e-09 s was over before the first candidates were fitted" in err
    status, out, err = run(*BASE, *FEW, "--time-limit", "-3")
    assert (status, out) == (2, "")
    assert "--time-limit must be" in err


@pytest.mark.skipif(sys.platform == "win32", reason="a process there has no SIGTERM to catch")
def test_sigterm_ends_a_command_as_ctrl_c_does(run, monkeypatch):
    def tell(name, done, of):
        signal.raise_signal(signal.SIGTERM)

    before = signal.getsignal(signal.SIGTERM)
    monkeypatch.setattr(console, "progress_line", lambda words, quiet: nullcontext(tell))
    assert run(*BASE, *FEW) == (130, "", "tsmblocks: stopped before everything was done.\n")
    assert signal.getsignal(signal.SIGTERM) is before


@pytest.mark.skipif(sys.platform == "win32", reason="a process there has no SIGTERM to catch")
def test_sigterm_ends_a_command_that_ignores_ctrl_c(run, monkeypatch):
    """A shell without job control has the commands that a script starts with & ignore SIGINT."""

    def tell(name, done, of):
        signal.raise_signal(signal.SIGTERM)

    monkeypatch.setattr(console, "progress_line", lambda words, quiet: nullcontext(tell))
    before = signal.signal(signal.SIGINT, signal.SIG_IGN)
    try:
        assert run(*BASE, *FEW) == (130, "", "tsmblocks: stopped before everything was done.\n")
        assert signal.getsignal(signal.SIGINT) is signal.SIG_IGN
    finally:
        signal.signal(signal.SIGINT, before)


def test_a_fault_and_a_note_do_not_say_the_same(run, tmp_path):
    """The note on a misspelled column proposed what the error before it did."""
    text = "t [s],x_in [rad],x_oot [rad]\n" + "\n".join(f"{0.01 * k},{0.1 * k % 1},0.5" for k in range(200))
    (tmp_path / "a.csv").write_text(text)
    status, _, err = run(BASE[0], "--data", "a.csv")
    assert status == 2
    assert err.count("--map") == 1
