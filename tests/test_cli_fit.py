"""The commands fit and compare as a user meets them: what is printed and written, refusals, Ctrl-C."""
# ruff: noqa: E501 - the text of a message stands on one line, as the user reads it

import inspect
import json
import math
from contextlib import nullcontext

import numpy as np
import pytest
from hypothesis import assume, given
from hypothesis import strategies as st

import tsmblocks as tsm
from tsmblocks.cli import console, main
from tsmblocks.cli.entry import parsers
from tsmblocks.common.tables import listed
from tsmblocks.fitting import text as telling

T = np.arange(0.0, 8.0, 0.02)
X = 50 * np.sin(1.3 * T) + 15 * np.sin(3.1 * T)
NEEDS = """
format = 1
title = "Another input"
[blocks]
g = { type = "Gain" }
[inputs]
u = { ports = "g.u", unit = "V" }
[outputs]
x_out = "g"
"""


def sheath(gain=0.9, half_width=20.0, seed=1, x=X):
    """Play as the textbook has it, in degrees, with noise of 0.3 deg."""
    middle, y = 0.0, []
    for u in x:
        middle = max(u - half_width, min(u + half_width, middle))
        y.append(gain * middle)
    return np.array(y) + np.random.default_rng(seed).normal(0.0, 0.3, len(x))


def write(name, y, *, t=T, x=X, head="t [s],x_in [deg],x_out [deg]\n"):
    rows = "".join(f"{a:.6g},{b:.6g},{c:.6g}\n" for a, b, c in zip(t, x, y, strict=True))
    with open(name, "w", encoding="utf-8") as file:
        file.write(head + rows)


@pytest.fixture
def run(tmp_path, monkeypatch, capsys):
    """Run a command line beside sheath.csv; its exit status, standard output and standard error."""
    monkeypatch.chdir(tmp_path)
    write("sheath.csv", sheath())

    def go(*words):
        status = main([str(word) for word in words])
        told = capsys.readouterr()
        return status, told.out, told.err

    return go


def stops_after(calls, monkeypatch):
    """Let Ctrl-C come with the given call of the progress line; how often it was called."""
    seen = []

    def tell(*told):
        seen.append(told)
        if len(seen) == calls:
            raise KeyboardInterrupt

    monkeypatch.setattr(console, "progress_line", lambda words, quiet: nullcontext(tell))
    return seen


# ---- fit


def test_fit_prints_the_numbers_what_is_left_and_where_they_are(run):
    status, out, err = run("fit", "tendon_sheath_play", "--data", "sheath.csv", "--out", "f.toml", "--plot", "f.png")
    assert (status, err) == (0, "")
    lines = out.splitlines()
    assert lines[0] == "Tendon sheath: play and an offset"
    assert lines[1].startswith("gauss-newton: converged; ")
    assert lines[1].endswith(" of 4 starts ended at this optimum")
    assert lines[3].split() == ["parameter", "value", "95", "%", "from", "to", "unit"]
    name, value, low, high, unit, degrees, deg = lines[4].split()
    assert (name, unit, deg) == ("play.half_width", "rad", "deg")
    assert float(low) < float(value) < float(high)
    assert float(degrees) == pytest.approx(20.0, abs=0.3)
    assert lines[5].split()[0] == "play.gain"
    assert len(lines[5].split()) == 4  # a gain has no unit and is no angle
    k = lines.index("")
    k = lines.index("", k + 1)
    assert lines[k + 1].split() == ["residual", "rms", "largest", "unit", "fit", "samples"]
    cells = lines[k + 2].split()
    assert (cells[0], cells[1], cells[4], cells[7]) == ("sheath,", "x_out", "deg", "400")
    assert 0.25 < float(cells[2]) < 0.35
    assert lines[-3:] == ["", "wrote f.toml", "wrote f.png"]
    fitted = tsm.load("f.toml").parameters
    assert np.degrees(fitted["play.half_width"]) == pytest.approx(float(degrees), rel=1e-3)


def test_json_is_one_object_with_the_same_numbers_and_the_repairs(run):
    write("rep.csv", np.repeat(sheath(), 2), t=np.repeat(T, 2), x=np.repeat(X, 2))
    words = ["fit", "tendon_sheath_play", "--data", "rep.csv", "--free", "play.*", "--starts", 1]
    status, out, err = run(*words, "--json", "--out", "f.toml")
    told = json.loads(out)
    assert (status, err) == (0, "")
    repair = "400 rows repeated the time of the row before (rows 3, 5, 7, 9, 11, …), with the same values; each group was replaced by its mean, leaving 400 of 800 samples."
    assert told["data"] == [{"experiment": "rep", "origin": "rep.csv", "samples": 400, "notes": [repair]}]
    assert told["written"] == ["f.toml"]
    numbers = {e["name"]: e["value"] for e in told["estimates"]}
    assert numbers.keys() == {"play.half_width", "play.gain"}
    assert tsm.load("f.toml").parameters["play.gain"] == numbers["play.gain"]
    status, out, err = run(*words)
    assert err == f"note: rep.csv: {repair}\n"
    assert "repeated" not in out


def test_files_without_a_header_and_signals_of_other_names(run):
    plain = json.loads(run("fit", "tendon_sheath_play", "--data", "sheath.csv", "--json")[1])["estimates"]
    write("bare.txt", sheath(), head="")
    write("named.csv", sheath(), head="time [s],motor [deg],tip [deg]\n")
    for words in (
        ["--data", "bare.txt", "--columns", "t, x_in [deg], x_out [deg]"],
        ["--data", "named.csv", "--map", "x_in=motor", "x_out=tip", "t=time"],
        ["--data", "named.csv", "--map", "x_in=motor", "--map", "x_out=tip"],
    ):
        assert json.loads(run("fit", "tendon_sheath_play", *words, "--json")[1])["estimates"] == plain


def test_numbers_of_each_experiment_are_written_for_each(run):
    write("other one.csv", sheath(gain=0.6, seed=2))
    words = ["fit", "tendon_sheath_play", "--data", "sheath.csv", "other one.csv", "--local", "play.gain"]
    status, out, _ = run(*words, "--out", "f.toml")
    assert status == 0
    assert "all, x_out" in out
    assert out.splitlines()[-2:] == ["wrote f_sheath.toml", "wrote f_other_one.toml"]
    gains = [tsm.load(name).parameters["play.gain"] for name in ("f_sheath.toml", "f_other_one.toml")]
    assert gains == pytest.approx([0.9, 0.6], abs=0.02)
    assert run(*words[:-2], "--out", "f.toml")[1].splitlines()[-1] == "wrote f.toml"


def test_bounds_constraints_ties_and_priors_reach_the_fit(run):
    words = ["fit", "tendon_sheath_play", "--data", "sheath.csv", "--json", "--starts", 1]
    more = ["--bounds", "play.gain=:0.8", "offset.bias=-0.01:", "--set", "play.gain=0.7", "--window", "1:7"]
    told = json.loads(run(*words, *more, "--constraint", "half_width > 0.1")[1])
    gain = next(e for e in told["estimates"] if e["name"] == "play.gain")
    assert (gain["start"], gain["value"], gain["verdict"]) == (0.7, 0.8, "at its upper bound")
    assert told["active"] == ["the upper bound of play.gain (0.8)"]
    assert told["differences"]["items"][0]["samples"] == 301
    told = json.loads(run(*words, "--tie", "half_width=2 * bias", "--prior", "offset.bias=0.25:1e-5")[1])
    assert {e["name"]: e["value"] for e in told["estimates"]}["offset.bias"] == pytest.approx(0.25, abs=1e-3)


REFUSED = [
    ([], "the following arguments are required: DIAGRAM. Name it before the options. 'tsmblocks fit --help' shows what it takes."),
    (["tendon_sheath_play"], "give --data FILE with the signals x_in, x_out."),
    (["tendon_sheath_play", "--data", "tendon_sheath_linear"],
     "--data takes recordings, and 'tendon_sheath_linear' is a diagram. Name diagrams before the options."),
    (["tendon_sheath_play", "--data", "sheath.csv", "./sheath.csv"],
     "--data names ./sheath.csv twice; it would count as two experiments."),
    (["tendon_sheath_play", "--data", "sheth.csv"], "there is no file sheth.csv. Did you mean 'sheath.csv'?"),
    (["tendon_sheath_play", "sheath.csv"], "fit takes no argument 'sheath.csv'. Recordings follow --data."),
    (["+", "--map", "x_inn=motor"], "--map x_inn=…: there is no signal 'x_inn' to compare. Did you mean 'x_in'?"),
    (["+", "--map", "motor angle=x_in [deg]"],
     "--map motor angle=…: there is no signal 'motor angle' to compare. --map takes NAME=COLUMN: the other way round that is --map 'x_in [deg]=motor angle'."),
    (["+", "--map", "x_in [deg]=motor", "x_in=tip"], "--map names 'x_in' twice, for the columns 'motor' and 'tip'."),
    (["+", "--bounds", "play.gain"],
     "argument --bounds: 'play.gain' is not NAME=LOW:HIGH, such as tsm.theta=0.1:50. 'tsmblocks fit --help' shows what it takes."),
    (["+", "--bounds", "play.gain=a:1"],
     "argument --bounds: 'a' is not a number. 'tsmblocks fit --help' shows what it takes."),
    (["+", "--bounds", "play.gain=2:3"],
     "'play.gain' starts at 1, outside its bounds of 2 to 3. Start inside: --set play.gain=…, or other bounds."),
    (["+", "--bounds", "play.gain=3:2"],
     "bounds of 'play.gain': the lower one must be below the upper one, got (3, 2)."),
    (["+", "--tie", "play.gain"],
     "argument --tie: 'play.gain' is not NAME=EXPRESSION, such as alpha2=alpha1. 'tsmblocks fit --help' shows what it takes."),
    (["+", "--prior", "play.gain=1"],
     "argument --prior: 'play.gain=1' is not NAME=MEAN:DEVIATION, such as tsm.theta=5:0.5. 'tsmblocks fit --help' shows what it takes."),
    (["+", "--window", "-1:5"],
     "argument --window: expected one argument. A value that begins with a minus is written --window=-… 'tsmblocks fit --help' shows what it takes."),
    (["+", "--window", "5"],
     "argument --window: '5' is not START:STOP in s, such as 2.5:10 or 5:. 'tsmblocks fit --help' shows what it takes."),
    (["+", "--segments", "3"],
     "--segments 3 (multiple shooting) needs --method ipopt, got 'gauss-newton'."),
    (["+", "--method", "newton"], "there is no method 'newton' of fitting. Did you mean 'gauss-newton'?"),
    (["+", "--out", "f.csv"], "'f.csv' must end in .toml."),
    (["+", "--out", "nowhere/f.toml"], "there is no folder 'nowhere' to write f.toml into."),
    (["+", "--plot", "f.gif"], "'f.gif' must end in .png, .svg or .pdf."),
]  # fmt: skip


@pytest.mark.parametrize(("words", "told"), REFUSED, ids=[told[:40] for _, told in REFUSED])
def test_fit_refuses_with_one_message(run, words, told):
    given = ["tendon_sheath_play", "--data", "sheath.csv", *words[1:]] if words[:1] == ["+"] else words
    assert run("fit", *given) == (2, "", f"tsmblocks: {told}\n")


def test_a_pattern_that_matches_nothing_names_the_near_miss(run):
    status, out, err = run("fit", "tendon_sheath_play", "--data", "sheath.csv", "--free", "ply.gain")
    assert (status, out) == (2, "")
    assert err.startswith("tsmblocks: free 'ply.gain' names no parameter of 'Tendon sheath: play and an offset'.")
    assert "play.gain" in err


def test_a_figure_that_cannot_be_drawn_is_refused_before_the_work(run, monkeypatch):
    import sys

    seen = stops_after(0, monkeypatch)
    monkeypatch.setitem(sys.modules, "matplotlib.figure", None)
    words = ["fit", "tendon_sheath_play", "--data", "sheath.csv", "--plot", "f.png"]
    assert run(*words) == (2, "", 'tsmblocks: Plots need matplotlib: pip install "tsmblocks[plots]"\n')
    assert seen == []


def test_ctrl_c_gives_the_best_so_far_and_writes_it(run, monkeypatch):
    words = ["fit", "tendon_sheath_play", "--data", "sheath.csv", "--starts", 1]
    seen = stops_after(2, monkeypatch)
    status, out, err = run(*words, "--out", "f.toml")
    assert (status, len(seen)) == (130, 2)
    assert "gauss-newton: interrupted; these are the best parameters so far\n" in out
    assert out.endswith("\nwrote f.toml\n")
    assert err == (
        "tsmblocks: stopped before the search was over; what you see and what was written is the best so far.\n"
    )
    assert "play.gain" in tsm.load("f.toml").parameters
    stops_after(2, monkeypatch)
    assert run(*words)[2].endswith("what you see is the best so far.\n")


# ---- compare


MODELS = ("tendon_sheath_linear", "tendon_sheath_play")


def test_compare_ranks_and_writes_the_best(run):
    status, out, err = run("compare", *MODELS, "--data", "sheath.csv", "--out", "b.toml", "--plot", "b.png")
    assert (status, err) == (0, "")
    lines = out.splitlines()
    assert lines[0] == "fitted to the first 50 % of each recording, ranked on the rest"
    assert lines[2].startswith("play fits best: its error is ")
    assert lines[5] == "model   parameters  rms held-out [deg]  rms in-sample [deg]"
    assert [line.split()[:2] for line in lines[6:8]] == [["play", "3"], ["linear", "2"]]
    assert all(0.2 < float(cell) < 0.4 for cell in lines[6].split()[2:])
    assert lines[-3:] == ["", "wrote b.toml", "wrote b.png"]
    assert np.degrees(tsm.load("b.toml").parameters["play.half_width"]) == pytest.approx(20.0, abs=0.5)


def test_compare_takes_the_names_it_prints(run):
    words = ["--data", "sheath.csv", "--starts", "1", "--step", "0.02", "--json"]
    full = run("compare", "tendon_sheath_linear", "tendon_sheath_play", *words)
    assert run("compare", "linear", "play", *words) == full


def test_the_name_of_a_model_elsewhere_is_told_in_full(run):
    assert run("fit", "asymmetric", "--data", "sheath.csv") == (
        2,
        "",
        (
            "tsmblocks: asymmetric: there is no file 'asymmetric', and no ready-made diagram of that "
            "name. Did you mean 'tendon_sheath_asymmetric'?\n"
        ),
    )


def test_compare_says_what_was_fitted(run):
    write("other.csv", sheath(seed=2))
    words = ["compare", "tendon_sheath_linear", "--data", "sheath.csv", "other.csv", "--starts", 1]
    for more, told in (
        (["--train", 1], "fitted to all samples"),
        (["--train", "0:5"], "fitted to 0:5 s of each recording, ranked on the rest"),
        (["--train", 1, "--held-out", "other"], "fitted to all samples; not fitted at all: other"),
    ):
        assert run(*words, *more)[1].splitlines()[0] == told


def test_a_model_that_cannot_be_fitted_is_named_with_the_reason(run, tmp_path):
    (tmp_path / "needs.toml").write_text(NEEDS)
    status, out, err = run("compare", "tendon_sheath_play", "needs.toml", "--data", "sheath.csv", "--starts", 1)
    assert (status, err) == (0, "")
    assert "could not be fitted:\n- needs: sheath.csv: 'Another input' needs its input 'u'" in out
    status, out, err = run("compare", "needs.toml", "tendon_sheath_linear", "--data", "sheath.csv", "--train", "50:60")
    assert (status, out) == (2, "")


def test_compare_with_no_model_that_fits_is_a_failure(run, tmp_path):
    (tmp_path / "a.toml").write_text(NEEDS)
    (tmp_path / "b.toml").write_text(NEEDS.replace("[V]", "[A]").replace("u = {", "w = {"))
    status, out, err = run("compare", "a.toml", "b.toml", "--data", "sheath.csv")
    assert (status, out) == (2, "")
    assert err.startswith(
        "tsmblocks: none of the models could be fitted. a: sheath.csv: 'Another input' needs its input"
    )
    assert "b: sheath.csv: 'Another input' needs its input 'w'" in err


def test_ctrl_c_ends_a_comparison_and_says_what_was_not_reached(run, monkeypatch):
    stops_after(2, monkeypatch)
    status, out, err = run("compare", *MODELS, "--data", "sheath.csv")
    assert status == 130
    assert "- linear: interrupted; these are the best parameters so far.\n" in out
    assert err == (
        "tsmblocks: stopped before the search was over; what you see is the best so far. Not reached: play.\n"
    )


def test_every_file_by_itself(run):
    write("stiff.csv", sheath(gain=0.6, half_width=25.0, seed=3))
    words = ["compare", *MODELS, "--data", "sheath.csv", "stiff.csv", "--each", "--starts", 2]
    status, out, err = run(*words, "--out", "b.toml", "--plot", "b.png")
    assert (status, err) == (0, "")
    lines = out.splitlines()
    assert lines[2] == "rms held-out [deg], each file fitted separately; * marks the best"
    assert lines[4].split() == ["model", "sheath", "stiff", "all"]
    assert [line.split()[0] for line in lines[5:7]] == ["play", "linear"]
    assert [cell.endswith("*") for cell in lines[5].split()[1:]] == [True] * 3
    cells = [float(cell.rstrip("*")) for cell in lines[6].split()[1:]]
    assert cells[2] == pytest.approx(math.hypot(*cells[:2]) / math.sqrt(2), rel=1e-3)
    assert lines[-3:] == ["wrote b_sheath.toml", "wrote b_stiff.toml", "wrote b.png"]
    gains = [tsm.load(f"b_{name}.toml").parameters["play.gain"] for name in ("sheath", "stiff")]
    assert gains == pytest.approx([0.9, 0.6], abs=0.03)
    told = json.loads(run(*words, "--json")[1])
    assert told["each"].keys() == {"sheath", "stiff"}
    assert [model["name"] for model in told["each"]["stiff"]["models"]] == ["play", "linear"]


def test_each_has_no_held_out_files(run):
    assert run("compare", *MODELS, "--data", "sheath.csv", "--each", "--held-out", "sheath") == (
        2,
        "",
        "tsmblocks: --each fits every file, so none can be held out; leave out --held-out.\n",
    )


def test_a_wide_table_of_files_stands_on_its_side():
    record = tsm.Record("r", T, {"x_in": np.radians(X), "x_out": np.radians(sheath())}, {"x_in": "rad", "x_out": "rad"})
    one = tsm.compare(list(MODELS), record, starts=1)
    narrow = telling.by_file({"a": one, "b": one}).splitlines()
    wide = telling.by_file({f"instrument {k}": one for k in range(9)}).splitlines()
    assert narrow[2].split() == ["model", "a", "b", "all"]
    assert wide[2].split() == ["file", "play", "linear"]
    assert [line.split("  ")[0] for line in wide[3:13]] == [f"instrument {k}" for k in range(9)] + ["all"]
    assert wide[12].split()[1:] == [line.split()[-1] for line in narrow[3:5]]
    assert max(map(len, wide)) <= 80


# ---- what is said


def flat(**more):
    """A recording whose input rests."""
    still = np.zeros(len(T))
    return tsm.Record("flat", T, {"x_in": still, "x_out": still + 0.1}, {"x_in": "rad", "x_out": "rad"}, **more)


def test_what_to_beware_of_is_told_once_and_in_lines_of_eighty():
    fit = tsm.fit(tsm.load("tendon_sheath_asymmetric"), flat())
    said = str(fit)
    assert (
        "- tsm.alpha1, tsm.alpha2, tsm.A, tsm.theta and tsm.delta have no influence on\n"
        "  the outputs in these experiments.\n" in said
    )
    assert said.count("no influence on") == 1
    assert max(map(len, said.splitlines())) <= 80


def test_pairs_that_move_together_are_told_unless_a_combination_says_it():
    fit = tsm.fit(
        tsm.load("tendon_sheath_symmetric"),
        tsm.Record("r", T, {"x_in": np.radians(X), "x_out": np.radians(sheath())}, {"x_in": "rad", "x_out": "rad"}),
    )
    together = [set(u.names) for u in fit.undetermined]
    assert any({"tsm.alpha_zeta", "tsm.A"} <= names for names in together)
    told = [text for text in telling.cautions(fit) if "hard to distinguish" in text]
    for a, b, c in telling.tangled(fit):
        assert (f"{a} and {b} are hard to distinguish (correlation {c:+.3f})." in told) != any(
            {a, b} <= names for names in together
        )


def test_start_values_of_many_experiments_are_told_as_one():
    """A play that a motion across it sets soon, whatever it began with."""
    t = np.arange(0.0, 6.0, 0.02)
    x, y, at = 0.8 * np.sin(1.3 * t), np.empty(300), -0.05
    for k, u in enumerate(x):
        y[k] = at = min(max(at, u - 0.05), u + 0.05)
    draw = np.random.default_rng(1)
    records = [
        tsm.Record(
            name,
            t,
            {"x_in": x, "x_out": 0.9 * y + 0.002 * draw.standard_normal(len(t))},
            {"x_in": "rad", "x_out": "rad"},
        )
        for name in "abcd"
    ]
    fit = tsm.fit(tsm.load("tendon_sheath_play"), records, start_states=True)
    silent = [e.name for e in fit.estimates if e.name.startswith("play.m@") and "no influence" in e.verdict]
    assert len(silent) > 2
    told = [text for text in telling.cautions(fit) if "no influence" in text]
    assert len(told) == 1
    assert told[0].startswith(f"play.m in {len(silent)} experiments (")
    assert told[0].endswith(") has no influence on the outputs there.")


@pytest.mark.parametrize("backend", ["llvm", "casadi"])
def test_a_random_set_that_runs_away_does_not_take_the_others_with_it(backend):
    record = tsm.Record("r", T, {"x_in": np.radians(X), "x_out": np.radians(sheath())}, {"x_in": "rad", "x_out": "rad"})
    fit = tsm.fit(tsm.load("tendon_sheath_asymmetric"), record, starts=3, iterations=2, backend=backend)
    assert len(fit.searches) == 3


@given(st.floats(-1e4, 1e4), st.floats(1e-5, 1e3))
def test_numbers_are_shown_to_a_tenth_of_their_interval(value, half):
    assume(half > 1e-4 * abs(value))  # beyond, seven digits are all that is shown
    show = telling._digits(value, value - half, value + half)
    for number in (value, value - half, value + half):
        assert abs(float(show(number)) - number) <= 0.1 * half
        assert show(number) != "-0"


def test_what_is_known_well_is_not_shown_to_the_last_bit():
    show = telling._digits(1 / 3, 1 / 3 - 1e-12, 1 / 3 + 1e-12)
    assert show(1 / 3) == "0.3333333"
    assert telling._digits(1 / 3, math.nan, math.nan)(1 / 3) == "0.3333"
    assert telling._digits(0.51, 0.461, 0.559)(0.51) == "0.510"
    assert telling._digits(3.2e7, 3.1e7, 3.3e7)(3.2e7) == "3.20e+07"


def test_lists_are_cut_where_nobody_would_read_on():
    assert listed("a") == "a"
    assert listed("ab") == "a and b"
    assert listed("abcdef") == "a, b, c, d, e and f"
    assert listed("abcdefg") == "a, b, c, d, e and 2 more"


def test_help_fits_a_terminal(run, monkeypatch):
    monkeypatch.setenv("COLUMNS", "80")
    said = (("fit", "tendon_sheath_play", ("parameters:", "search:")), ("compare", "play", ("fits:",)))
    for command, model, groups in said:
        status, out, err = run(command, "--help")
        assert (status, err) == (0, "")
        assert max(map(len, out.splitlines())) <= 80
        for group in ("measured data:", *groups, "results:"):
            assert f"\n{group}\n" in out
        assert f"  tsmblocks {command} {model} " in out


def test_messages_are_folded_on_a_terminal_only(capsys, monkeypatch):
    text = "a file: " + "several words " * 12
    console.print_note(text)
    assert len(capsys.readouterr().err.splitlines()) == 1
    monkeypatch.setenv("COLUMNS", "60")
    monkeypatch.setattr("sys.stderr.isatty", lambda: True)
    console.print_note(text)
    lines = capsys.readouterr().err.splitlines()
    assert max(map(len, lines)) <= 60
    assert " ".join(line.strip() for line in lines) == f"note: {text}".strip()
    assert all(line.startswith("  ") for line in lines[1:])


@pytest.mark.parametrize("command", ["fit", "compare", "diagnose"])
def test_what_a_recording_has_in_place_of_the_outputs_is_named(command, tmp_path, capsys):
    (tmp_path / "a.csv").write_text("t [s],x_in [rad],tip\n" + "".join(f"{k},{k % 3},{k}\n" for k in range(9)))
    assert main([command, "tendon_sheath_linear", "--data", str(tmp_path / "a.csv")]) == 2
    assert "the recording has x_in, tip. Map one when reading" in capsys.readouterr().err


@pytest.mark.parametrize(
    ("command", "function"),
    [("run", tsm.simulate), ("fit", tsm.fit), ("compare", tsm.compare), ("diagnose", tsm.diagnose)],
)
def test_a_command_holds_inputs_as_its_function_does(command, function):
    _, commands = parsers()
    assert commands[command].get_default("hold") == inspect.signature(function).parameters["hold"].default


def test_an_input_that_was_held_between_samples_is_held(tmp_path, capsys):
    """A delay is half a sample longer where the input is taken to run straight from one sample to the next."""
    t = 0.02 * np.arange(400)
    late = tsm.Diagram(
        blocks={"late": tsm.blocks.Delay(time=0.05), "lag": tsm.blocks.FirstOrderLag()},
        wires=["late -> lag"],
        inputs={"u": "late"},
        outputs={"y": "lag"},
    )
    y = tsm.simulate(late, inputs={"u": (t, np.sin(3 * t))}, hold="zero", stop=t[-1], step=1e-3)["y"][::20]
    tsm.Record("a", t, {"u": np.sin(3 * t), "y": y}, {"u": "", "y": ""}).save(tmp_path / "a.csv")
    tsm.save(late.with_parameters({"late.time": 0.08}), tmp_path / "late.toml")
    found = {}
    for hold in ("zero", "linear"):
        assert (
            main(
                [
                    "fit",
                    str(tmp_path / "late.toml"),
                    "--data",
                    str(tmp_path / "a.csv"),
                    "--free",
                    "late.time",
                    "--step",
                    "0.001",
                    "--hold",
                    hold,
                    "--json",
                ]
            )
            == 0
        )
        (one,) = json.loads(capsys.readouterr().out)["estimates"]
        found[hold] = one["value"]
    assert found["zero"] == pytest.approx(0.05, rel=1e-3)
    assert found["linear"] == pytest.approx(0.06, abs=1.5e-3)


def test_the_noise_that_is_given_weighs_the_outputs(run):
    """Beside a prior the data count the less, the larger their noise."""
    words = ["fit", "tendon_sheath_play", "--data", "sheath.csv", "--starts", 1, "--json"]
    gains = []
    for sigma in ("0.01deg", "x_out=3deg", "60deg"):
        status, out, _ = run(*words, "--free", "play.gain", "--prior", "play.gain=0.5:0.01", "--sigma", sigma)
        assert status == 0
        (one,) = json.loads(out)["estimates"]
        gains.append(one["value"])
    assert gains[0] > gains[1] > gains[2]
    assert gains[2] == pytest.approx(0.5, abs=0.02)


@pytest.mark.parametrize(
    ("sigma", "said"),
    [
        pytest.param("loud", "--sigma: 'loud' is not VALUE, VALUE with a unit, or OUTPUT=VALUE", id="no number"),
        pytest.param("x_uot=1deg", "--sigma: 'x_uot' is not compared here. Did you mean 'x_out'?", id="another output"),
        pytest.param("1mm", "--sigma 1mm: 'mm' cannot be converted to the unit of x_out [rad].", id="another quantity"),
    ],
)
def test_a_noise_that_is_none_is_refused(run, sigma, said):
    status, out, err = run("fit", "tendon_sheath_play", "--data", "sheath.csv", "--sigma", sigma)
    assert (status, out) == (2, "")
    assert said in err


def test_models_are_compared_with_some_parameters_free(run):
    words = ["compare", "play", "linear", "--data", "sheath.csv", "--starts", 1, "--json"]
    status, out, _ = run(*words, "--free", "play.gain", "gain.*")
    assert status == 0
    free = {row["name"]: [one["name"] for one in row["fit"]["estimates"]] for row in json.loads(out)["models"]}
    assert {name: [k for k in those if "@" not in k] for name, those in free.items()} == {
        "play": ["play.gain"],
        "linear": ["gain.gain"],
    }
    status, out, err = run(*words, "--free", "play.gian")
    assert (status, out) == (2, "")
    assert "--free: no model has a parameter 'play.gian'. Did you mean 'play.gain'?" in err


def test_a_free_parameter_of_a_comparison_is_named_by_its_place_in_a_list(run):
    words = ["compare", "prandtl_ishlinskii", "--data", "sheath.csv", "--starts", 1, "--json"]
    status, out, _ = run(*words, "--free", "tsm.weights[1]")
    assert status == 0
    (row,) = json.loads(out)["models"]
    assert [one["name"] for one in row["fit"]["estimates"] if "@" not in one["name"]] == ["tsm.weights[1]"]
