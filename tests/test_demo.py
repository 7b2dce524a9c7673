"""The demonstration: what is hidden is named, its numbers found, and less is left of the reference because of it."""

import json
import re
from functools import cache, partial
from pathlib import Path

import numpy as np
import pytest

import tsmblocks as tsm
from tests.pages import Page
from tsmblocks.cli import demo as command
from tsmblocks.cli import main
from tsmblocks.demo import paper
from tsmblocks.demo import story as module
from tsmblocks.demo.compensators import plannable
from tsmblocks.demo.mechanism import DEG, HIDDEN, NUMBERS, SAMPLE, STOP, measured, model, references, truth
from tsmblocks.demo.page import page
from tsmblocks.demo.story import AUGMENTED, FLOOR, IDENTIFIED, build_story
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
    for _, true, first, last in story(name, whole).revealed:
        assert abs(last - true) <= max(abs(first - true), 0.01 * abs(true))


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
    values = {name: first for name, _, first in tale.revealed}
    assert values == pytest.approx(NUMBERS, rel=0.15)


def test_less_is_left_of_the_reference_with_what_was_found():
    for name, least in (("position_ripple", 1.1), ("odd_nonlinearity", 1.1), ("backlash", 2.4)):
        tale = story(name)
        before, after = (tale.on(k) for k in (IDENTIFIED, AUGMENTED))
        none, plain = tale.tracked[0].error, before["feedforward (11)"].error
        assert none.peak_to_peak > 1.5 * plain.peak_to_peak
        assert after["planned"].error.peak_to_peak < min(least, 0.8 * before["planned"].error.peak_to_peak)
        assert after["planned"].error.rms < 0.5 * before["planned"].error.rms
        assert after["loop around the model"].error.rms < 1.25 * before["loop around the model"].error.rms


def test_a_gap_is_rounded_off_for_a_plan_and_hardly_moves_what_comes_out():
    sheath = truth(HIDDEN["backlash"])
    record = measured(sheath, 0)["large"]
    ends = [
        tsm.simulate(d, inputs={"x_in": (record.t, record["x_in"])}, stop=STOP, step=1e-3)["x_out"]
        for d in (sheath, plannable(sheath))
    ]
    assert np.abs(ends[0] - ends[1])[5000:].max() < 0.35 * DEG
    assert plannable(model()) == model()


@pytest.mark.parametrize("name", ["position_ripple", "none"])
def test_the_page_is_whole_and_needs_nothing_else(name):
    text = page(cases(), story(name))
    shown = Page(text)
    assert shown.open == []
    assert shown.fetched == ["found/report.html"]  # where a link leads
    assert "script" not in shown.seen
    assert [head[0] for head in shown.heads] == [*"123456", "T"]
    assert text == page(cases(), story(name))
    assert "nan" not in re.sub(r"<[^>]*>", "", text).lower().split()
    kinds = set(re.findall(r'class="line (\w+)', text))
    assert all(f".line.{kind}" in style("page.css") for kind in kinds)


def test_nothing_is_told_of_a_model_that_there_is_not():
    tale = story("none")
    chapters = [
        command._measurement_text(tale),
        command._tracking_text(tale),
        command._hidden_text(tale),
        page(cases(), tale),
    ]
    for text in map(" ".join, map(str.split, chapters)):
        for words in ("both models", AUGMENTED, "it in place", "Something is in it", "error of the model’s structure"):
            assert words not in text
    assert "With it in place the model’s other parameters come right too" in page(cases(), story("backlash"))


def test_a_chart_runs_over_two_periods_and_a_loop_over_one():
    drawn = re.findall(r'aria-label="(error[^"]*|the loop[^"]*|what arrives[^"]*)"', page(cases(), story("none")))
    assert len(drawn) == 5


def test_the_command_writes_what_the_page_says_and_it_can_be_gone_on_with(tmp_path, capsys, monkeypatch):
    monkeypatch.chdir(tmp_path)
    monkeypatch.setattr(module, "build_story", lambda name, seed, *_: story(name) if seed == 0 else None)
    assert main(["demo", "--out", "d", "--hide", "position_ripple", "--json"]) == 0
    told_json = json.loads(capsys.readouterr().out)
    assert (told_json["hidden"], told_json["effects"]) == ("position_ripple", ["position_ripple"])
    folder = tmp_path / "d"
    monkeypatch.chdir(folder)
    shown = re.findall(r"<pre>(.*?)</pre>", (folder / "index.html").read_text(encoding="utf-8"), re.DOTALL)[-1]
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
    parts = [part.split() for part in shown.split("[...]")]
    assert min(map(len, parts)) > 40
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


def test_what_is_printed_fits_a_terminal():
    tale = story("position_ripple")
    chapters = [command._paper_text(cases())]
    chapters += [
        tell(tale)
        for tell in (
            command._measurement_text,
            command._fit_text,
            command._diagnosis_text,
            command._tracking_text,
            command._hidden_text,
        )
    ]
    lines = "\n".join(chapters).splitlines()
    assert max(map(len, lines)) <= 80
    assert [line[0] for line in lines if re.match(r"\d\. ", line)] == list("123456")


def test_a_name_that_cannot_be_hidden_is_refused_with_the_near_miss(tmp_path, capsys, monkeypatch):
    monkeypatch.chdir(tmp_path)
    assert main(["demo", "--hide", "baklash"]) == 2
    assert "there is no effect to hide 'baklash'. Did you mean 'backlash'?" in capsys.readouterr().err
    assert list(tmp_path.iterdir()) == []


def test_ctrl_c_in_the_diagnosis_ends_it_with_what_was_printed(tmp_path, capsys, monkeypatch):
    def stopped(*_, **__):
        raise KeyboardInterrupt

    monkeypatch.chdir(tmp_path)
    monkeypatch.setattr(module, "diagnose", stopped)
    assert main(["demo", "--out", "d"]) == 130
    said = capsys.readouterr()
    assert "27 / 8 / 5.8" in said.out
    assert "stopped before everything was done" in said.err
    assert (tmp_path / "d/results.csv").exists()
