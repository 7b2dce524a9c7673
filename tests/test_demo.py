"""The demonstration: what is hidden is named, its numbers found, and less is left of the reference because of it."""

import json
import re
from functools import cache, partial
from pathlib import Path
from types import SimpleNamespace

import numpy as np
import pytest

import tsmblocks as tsm
from tests.pages import Page, faults, unexplained
from tsmblocks.cli import demo as command
from tsmblocks.cli import main
from tsmblocks.demo import compensators, findings, paper
from tsmblocks.demo import story as module
from tsmblocks.demo.compensators import FEEDFORWARD, LOOP, PLANNED, plannable
from tsmblocks.demo.mechanism import DEG, HIDDEN, NUMBERS, SAMPLE, STOP, measured, model, references, truth
from tsmblocks.demo.page import page
from tsmblocks.demo.story import AUGMENTED, FLOOR, IDENTIFIED, build_story
from tsmblocks.demo.text import TITLES, paper_text, story_text
from tsmblocks.html.pages import style

SLOW_NEEDS = ["demo", "diagrams/*"]
SHOWN = ("position_ripple", "none")
"""What the README shows, and what is not there: told with the whole catalogue."""


def story(name, whole=None):
    """The story of what is hidden, with the ``whole`` catalogue, or with few effects of it for candidates."""
    return told_with(name, None if name in SHOWN or whole else tuple(sorted(HIDDEN.keys() - {"none"})))


@cache
def told_with(name, effects):
    with pytest.MonkeyPatch.context() as patched:
        patched.setattr(module, "diagnose", partial(module.diagnose, effects=effects))
        return build_story(name, seed=0)


@cache
def cases():
    made = paper.cases()[:1]
    assert paper.run(made)
    return made


def test_names_on_the_command_line_are_those_that_can_be_hidden():
    assert set(command.NAMES) == set(HIDDEN)


def test_sensors_round_and_their_noise_is_what_the_floor_says():
    sheath = truth(HIDDEN["none"])
    records = measured(sheath, seed=3)
    assert set(records) == set(references())
    for record in records.values():
        assert len(record) == round(STOP / SAMPLE) + 1
        assert record.step == pytest.approx(SAMPLE)
        x_out = tsm.simulate(sheath, inputs={"x_in": (record.t, record["x_in"])}, stop=STOP, step=1e-3, hold="cubic")
        left = record["x_out"] - np.interp(record.t, x_out.t, x_out["x_out"])
        assert np.std(left) == pytest.approx(FLOOR, rel=0.06)
        steps = record["x_out"] / (0.05 * DEG)
        assert steps == pytest.approx(np.round(steps), abs=1e-6)


def test_other_noise_with_another_seed_and_the_same_with_the_same():
    sheath = truth(HIDDEN["backlash"])
    one, same, other = (measured(sheath, seed)["small"]["x_out"] for seed in (1, 1, 2))
    assert np.array_equal(one, same)
    assert not np.array_equal(one, other)


WHOLE = [pytest.param(name, True, marks=pytest.mark.slow) for name in HIDDEN if name not in SHOWN]


@pytest.mark.parametrize(("name", "whole"), [*((name, None) for name in HIDDEN if name != "none"), *WHOLE])
def test_what_is_hidden_is_named_and_the_numbers_come_right(name, whole):
    found = story(name, whole).diagnosis
    assert [effect.name for effect in found.effects] == [name]
    (gap,) = found.worst.gaps
    assert gap.held_out[0] > 3 * FLOOR
    assert gap.held_out[-1] < 1.05 * FLOOR
    tale = story(name, whole)
    first, last = tale.fit.diagram.parameters, found.augmented.parameters
    for key, true in NUMBERS.items():
        assert abs(last[f"tsm.{key}"] - true) <= max(abs(first[f"tsm.{key}"] - true), 0.01 * abs(true))


def test_the_size_of_the_gap_and_of_the_ripple_are_found():
    (gap,) = story("backlash").diagnosis.effects
    assert gap.wire.strip() == "x_in -> tsm.x"
    assert gap.parameters["half_width"].value == pytest.approx(1.5 * DEG, rel=0.02)
    (ripple,) = story("position_ripple").diagnosis.effects
    sizes = [ripple.parameters[k].value for k in ("cosine", "sine", "cycles")]
    assert sizes == pytest.approx([0.36 * DEG, 0.48 * DEG, 8.0], rel=0.03)


def test_nothing_is_named_where_nothing_is_hidden():
    tale = story("none")
    assert tale.diagnosis.verdict == "none"
    assert tale.on(AUGMENTED) == {}
    values = tale.fit.diagram.parameters
    assert {name: values[f"tsm.{name}"] for name in NUMBERS} == pytest.approx(NUMBERS, rel=0.15)


def test_less_is_left_of_the_reference_with_what_was_found():
    for name, least in (("position_ripple", 1.1), ("odd_nonlinearity", 1.1), ("backlash", 2.4)):
        tale = story(name)
        before, after = (tale.on(k) for k in (IDENTIFIED, AUGMENTED))
        none, plain = tale.tracked[0].error, before[FEEDFORWARD].error
        assert none.peak_to_peak > 1.5 * plain.peak_to_peak
        assert after[PLANNED].error.peak_to_peak < min(least, 0.8 * before[PLANNED].error.peak_to_peak)
        assert after[PLANNED].error.rms < 0.5 * before[PLANNED].error.rms
        assert after[LOOP].error.rms < before[LOOP].error.rms


def test_a_gap_is_rounded_off_for_a_plan_and_hardly_moves_what_comes_out():
    sheath = truth(HIDDEN["backlash"])
    record = measured(sheath, 0)["large"]
    ends = [
        tsm.simulate(d, inputs={"x_in": (record.t, record["x_in"])}, stop=STOP, step=1e-3)["x_out"]
        for d in (sheath, plannable(sheath))
    ]
    assert np.abs(ends[0] - ends[1])[5000:].max() < 0.35 * DEG
    assert plannable(model()) == model()


def test_the_reveal_comes_first_in_sizes_that_a_person_would_measure():
    hidden, found = findings.headline(story("position_ripple"))
    assert hidden == "Hidden: an eccentric pulley at the tip, ±0.6 deg every 45 deg."
    sizes = r"amplitude (\S+) ± (\S+) deg \(true: 0.6 deg\), period (\S+) ± (\S+) deg \(true: 45 deg\)\."
    size, off, period, off_period = map(float, re.search(sizes, found).groups())
    assert size == pytest.approx(0.6, abs=2 * off)
    assert period == pytest.approx(45.0, abs=2 * off_period)
    assert off < 0.01
    rows = findings.revealed(story("position_ripple"))
    assert [row.name for row in rows] == ["amplitude", "period", "position of a crest", *NUMBERS]
    assert [row.true for row in rows[:3]] == ["0.6 deg", "45 deg", "6.641 deg"]  # atan2(0.48, 0.36) / 8
    assert rows[0].without == "-"
    assert rows[3].without == f"{story('position_ripple').fit.diagram.parameters['tsm.alpha1']:.4g}"


def test_where_nothing_is_hidden_nothing_is_found_and_no_size_is_shown():
    tale = story("none")
    assert findings.headline(tale)[1] == "Found: no unmodelled effect is detectable with these data."
    assert [row.name for row in findings.revealed(tale)] == list(NUMBERS)
    assert len(findings.heading(tale)) == 3


def test_the_size_of_a_gap_and_of_a_lever_are_those_of_the_hidden_block():
    (gap, *_), (slope, middle, *_) = (findings.revealed(story(name)) for name in ("backlash", "odd_nonlinearity"))
    assert (gap.name, gap.true) == ("gap width", "3 deg")
    assert (slope.true, middle.true) == ("20 %", "17.19 deg")  # 0.06 / 0.3, and 0.3 rad


@pytest.mark.parametrize("name", HIDDEN)
def test_a_true_value_outside_its_interval_is_said_to_be(name):
    rows, text = findings.revealed(story(name)), findings.intervals(story(name))
    outside = [row.name for row in rows if not row.inside]
    assert (
        re.findall(r"([\w ]+) \(off by", text.removeprefix("Outside the interval: ").replace(" and ", ", ")) == outside
    )
    assert ("Every true value lies within its interval." in text) == (not outside)


def test_a_compensator_that_gets_worse_with_the_better_model_is_explained():
    lever = findings.worse(story("odd_nonlinearity"))
    assert lever[0].startswith("The feedforward, Eq. 11, gets worse with the better model, from 11 to 20 deg peak")
    assert "had absorbed part of what was hidden (alpha1 1.00, true 0.91)" in lever[0]
    before, after = (
        SimpleNamespace(error=SimpleNamespace(peak_to_peak=peaks, rms=rms))
        for peaks, rms in ((5.26, 0.84), (6.06, 0.6))
    )
    assert findings._why(story("backlash"), LOOP, before, after).startswith(
        "The loop around the model gets worse from 5.3 to 6.1 deg peak to peak, though its rms falls from 0.84 to 0.60 "
        "deg: it hunts about the upper reversal"
    )
    assert findings.worse(story("position_ripple")) == findings.worse(story("none")) == []


def test_tracking_errors_have_the_digits_that_hold_where_a_loop_hunts():
    assert [findings.rounded(x) for x in (29.23, 6.366, 0.9545, 0.6, 4.0)] == ["29", "6.4", "0.95", "0.60", "4.0"]
    tale = story("position_ripple")
    theta = tale.fit.diagram.parameters["tsm.theta"]
    near = tale.fit.diagram.with_parameters({"tsm.theta": theta * (1 + 1e-9)})
    loop = compensators._loop(tale.mechanism)
    runs = [compensators._tracked("", "", compensators._around(loop, model)) for model in (tale.fit.diagram, near)]
    once, again = (run.error for run in runs)
    assert once.peak_to_peak != again.peak_to_peak  # it is sensitive to rounding
    assert once.peak_to_peak == pytest.approx(again.peak_to_peak, rel=0.03)
    assert once.rms == pytest.approx(again.rms, rel=0.01)


def test_page_report_and_terminal_have_one_set_of_numbers(tmp_path):
    tale = story("position_ripple")
    shown = [page(cases(), tale, {}), (tale.diagnosis.save(tmp_path) / "report.html").read_text("utf-8")]
    shown = [re.sub(r"<[^>]*>", " ", one).replace("&nbsp;", " ") for one in shown]
    for words in ("0.6013 ± 0.0041 deg", "45.069 ± 0.099 deg", "from 0.400 to 0.101 deg rms"):
        assert all(words in " ".join(one.split()) for one in (*shown, story_text(tale)))
    first, base = tale.fit.diagram.parameters, tale.diagnosis.base.parameters
    assert {k: first[f"tsm.{k}"] for k in NUMBERS} == pytest.approx({k: base[f"tsm.{k}"] for k in NUMBERS}, rel=1e-4)
    assert "see the page of the demonstration" in shown[1]


@pytest.mark.parametrize("name", ["position_ripple", "none"])
def test_the_page_is_whole_and_needs_nothing_else(name):
    text = page(cases(), story(name), {"Recordings": ["recordings/small.csv"]})
    shown = Page(text)
    assert shown.open == []
    assert shown.fetched == []
    assert [one for one in shown.links if not one.startswith("#")] == ["found/report.html", "recordings/small.csv"]
    assert "script" not in shown.seen
    assert shown.heads == [*TITLES.values(), "Files beside this page", "To go on"]
    assert faults(text) == []
    assert unexplained(text) == set()
    assert text == page(cases(), story(name), {"Recordings": ["recordings/small.csv"]})
    assert "nan" not in re.sub(r"<[^>]*>", "", text).lower().split()
    kinds = set(re.findall(r'class="line (\w+)', text))
    assert all(f".line.{kind}" in style("page.css") for kind in kinds)


def test_nothing_is_told_of_a_model_that_there_is_not():
    tale = story("none")
    for text in (" ".join(story_text(tale).split()), " ".join(page(cases(), tale, {}).split())):
        for words in ("both models", AUGMENTED, "model's structure", "The model does not have it"):
            assert words not in text


def test_how_many_effects_were_tried_is_said():
    count = len(story("position_ripple").diagnosis.worst.effects_tried)
    assert count > 15
    assert f"{count} effects of the catalogue were tried" in " ".join(story_text(story("position_ripple")).split())


def test_a_chart_runs_over_two_periods_and_a_loop_over_one():
    drawn = re.findall(r'aria-label="(error[^"]*|the loop[^"]*|output against[^"]*)"', page(cases(), story("none"), {}))
    assert len(drawn) == 5


def test_the_command_writes_what_the_page_says_and_it_can_be_gone_on_with(tmp_path, capsys, monkeypatch):
    monkeypatch.chdir(tmp_path)
    monkeypatch.setattr(module, "build_story", lambda name, seed, *_: story(name) if seed == 0 else None)
    assert main(["demo", "--out", "d", "--hide", "position_ripple", "--json"]) == 0
    told_json = json.loads(capsys.readouterr().out)
    assert (told_json["hidden"], told_json["effects"]) == ("position_ripple", ["position_ripple"])
    folder = tmp_path / "d"
    monkeypatch.chdir(folder)
    shown = re.findall(r"<pre[^>]*>(.*?)</pre>", (folder / "index.html").read_text(encoding="utf-8"), re.DOTALL)[-1]
    links = [one for one in Page((folder / "index.html").read_text("utf-8")).links if not one.startswith("#")]
    assert {path.relative_to(folder).as_posix() for path in folder.rglob("*.*")} == {*links, "index.html"}
    assert Page((folder / "found/report.html").read_text("utf-8")).links[0] == "../index.html"
    diagnose, run, *_ = shown.split("\n")
    assert main([*diagnose.split()[1:], "--effects", "position_ripple", "backlash", "--json"]) == 0
    assert json.loads(capsys.readouterr().out)["verdict"] == "named"
    assert main(run.split()[1:]) == 0
    assert tsm.load(folder / "identified.toml").parameters["tsm.theta"] == pytest.approx(4.6, rel=0.05)


def test_what_the_readme_shows_is_what_the_demo_prints(tmp_path, capsys, monkeypatch):
    """Word by word; numbers may differ in what another processor rounds otherwise."""
    monkeypatch.chdir(tmp_path)
    monkeypatch.setattr(module, "build_story", lambda *_: story("position_ripple"))
    assert main(["demo"]) == 0
    printed = capsys.readouterr().out.split()
    text = (Path(__file__).parents[1] / "README.md").read_text(encoding="utf-8")
    (shown,) = re.findall(r"<!-- main-output -->\n```\n(.*?)```", text, re.DOTALL)
    parts = [part.split() for part in shown.split("[...]") if part.strip()]
    assert min(map(len, parts)) > 20
    begin = 0
    for part in parts:
        begin = next((k for k in range(begin, len(printed)) if printed[k : k + 4] == part[:4]), len(printed))
        assert [word for pair in zip(part, printed[begin:], strict=False) if not alike(*pair) for word in pair] == []
        begin += len(part)
        assert begin <= len(printed)


def alike(shown, printed):
    try:
        return float(printed.strip("().,")) == pytest.approx(float(shown.strip("().,")), rel=0.03)
    except ValueError:
        return shown == printed


@pytest.mark.parametrize("name", HIDDEN)
def test_what_is_printed_fits_a_terminal(name):
    lines = f"{story_text(story(name))}\n{paper_text(cases())}".splitlines()
    assert max(map(len, lines)) <= 80
    assert [line for line in lines if re.match(r"\d\. ", line)] == [
        f"{k}. {title}" for k, title in enumerate(TITLES.values(), 1)
    ]


def test_a_name_that_cannot_be_hidden_is_refused_with_the_near_miss(tmp_path, capsys, monkeypatch):
    monkeypatch.chdir(tmp_path)
    assert main(["demo", "--hide", "baklash"]) == 2
    assert "there is no effect to hide 'baklash'. Did you mean 'backlash'?" in capsys.readouterr().err
    assert list(tmp_path.iterdir()) == []


def test_ctrl_c_in_the_diagnosis_ends_it(tmp_path, capsys, monkeypatch):
    def stopped(*_, **__):
        raise KeyboardInterrupt

    monkeypatch.chdir(tmp_path)
    monkeypatch.setattr(module, "diagnose", stopped)
    assert main(["demo", "--out", "d"]) == 130
    said = capsys.readouterr()
    assert said.out == ""
    assert "stopped before everything was done" in said.err
