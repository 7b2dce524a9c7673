"""What notebooks and prompts show of results: HTML that is whole, safe, small and needs nothing, and short texts."""

import re
import subprocess
import sys

import numpy as np
import pytest
from markupsafe import escape

import tsmblocks as tsm
from tests.pages import Page
from tests.views_everywhere import LOOP, T, X, examples
from tsmblocks.blocks import LookupTable
from tsmblocks.html.pages import style
from tsmblocks.model.block import REGISTRY
from tsmblocks.studies import grid
from tsmblocks.studies.responses import Responses

NASTY = "<b>&\"'</b><script>alert(1)</script>"


@pytest.fixture(scope="module")
def things():
    """One of everything that has a card, with names that are no HTML."""
    return examples(NASTY)


KINDS = [
    "run",
    "record",
    "fit",
    "differences",
    "comparison",
    "diagnosis",
    "study",
    "responses",
    "batch",
    "reduced",
    "tuned",
    "control",
    "frequencies",
    "block",
    "source",
]


def words(html):
    return re.sub(r"\s+", " ", re.sub(r"<style>.*?</style>|<[^>]+>", " ", html))


@pytest.mark.parametrize("kind", KINDS)
def test_a_card_is_whole_safe_and_asks_for_nothing(kind, things):
    text = things[kind]._repr_html_()
    page = Page(text)
    assert page.open == []
    assert page.fetched == []
    assert not page.seen & {"script", "img", "link", "iframe", "b&"}
    assert NASTY not in text
    for asking in ("url(", "@import", "http:", "https:", "onload", "javascript"):
        assert asking not in text
    assert "nan" not in re.findall(r'd="[^"]*"', text)
    assert len(text) < 120_000


@pytest.mark.parametrize("kind", KINDS)
def test_ink_and_paper_are_those_of_the_page(kind, things):
    style = re.findall(r"<style>(.*?)</style>", things[kind]._repr_html_())
    assert len(style) == 1
    rules = re.findall(r"([^{}]+)\{", style[0])
    assert all(part.strip().startswith(".tsmblocks") for rule in rules for part in rule.split(",") if rule.strip())
    grounds = re.findall(r"background:([^;}]+)", style[0])
    assert set(grounds) == {"transparent", "var(--c)"}
    assert re.findall(r"(?<![-\w])color:([^;}]+)", style[0]) == ["inherit"] * 3


def luminance(colour):
    parts = [int(colour[k : k + 2], 16) / 255 for k in (1, 3, 5)]
    r, g, b = (v / 12.92 if v <= 0.04045 else ((v + 0.055) / 1.055) ** 2.4 for v in parts)
    return 0.2126 * r + 0.7152 * g + 0.0722 * b


def test_lines_stand_out_from_white_and_from_dark_paper():
    colours = re.findall(r"--c\d:(#\w+)", style("card.css"))
    assert len(set(colours)) == 6

    for colour in colours:
        for paper in ("#ffffff", "#111111"):
            dark, light = sorted((luminance(colour), luminance(paper)))
            assert (light + 0.05) / (dark + 0.05) > 3, colour  # WCAG 2.1, 1.4.11, for graphics


def test_a_run_shows_its_outputs_in_people_s_units(things):
    run = things["run"]
    text = words(run._repr_html_())
    assert "0 to 2 s in steps of 0.001 s (rk4), 2001 instants" in text
    assert f"x_out {np.degrees(run['x_out'].min()):.4g} {np.degrees(run['x_out'].max()):.4g}" in text
    assert f"u {run['u'].min():.4g} {run['u'].max():.4g}" in text
    assert "Other signals: ref.y" in text
    assert run._repr_html_().count('class="chart"') == 2, "angles share one, the voltage has its own"


def test_a_recording_shows_what_was_repaired_and_where_it_is_from(things):
    text = words(things["record"]._repr_html_())
    assert "600 samples, 0 to 5.99 s, every 0.01 s" in text
    assert "repaired" in text
    assert "&lt;script&gt;" in text


def test_a_fit_shows_the_printed_numbers_with_intervals(things):
    fit = things["fit"]
    text = words(fit._repr_html_())
    printed = [line.split() for line in str(fit).splitlines() if line.startswith(("gain.", "offset."))]
    assert len(printed) == 2
    for line in printed:
        assert " ".join(line[:4]) in text
    assert "residual" in text


def test_a_diagnosis_shows_verdict_effect_and_gap(things):
    text = words(things["diagnosis"]._repr_html_())
    assert "Named." in text
    assert "backlash" in text
    assert "gap width 3.458" in text
    assert "noise 0.115" in text


def test_a_study_shows_quantiles_and_where_it_is_lowest(things):
    study = things["study"]
    text = words(study._repr_html_())
    best = study.best(NASTY)
    assert f"{np.degrees(best[NASTY]):.4g}" in text
    assert f"pid.kp {best['pid.kp']:.4g}" in text


def test_a_tuning_shows_every_case_before_and_after_in_degrees(things):
    tuned = things["tuned"]
    text = words(tuned._repr_html_())
    before, after = np.degrees(tuned.worst)
    assert f"{before:.4g} before, {after:.4g} deg tuned" in text
    assert f"rms(x_ref - x_out) [deg] {before:.4g} {after:.4g}" in text


def test_numbers_of_a_block_s_own_stand_out(things):
    text = things["block"]._repr_html_()
    (own,) = re.findall(r'<tr class="named">(.*?)</tr>', text)
    assert words(own).split()[:2] == ["kp", "2"]


@pytest.mark.parametrize("name", sorted(REGISTRY))
def test_every_block_has_a_card(name):
    text = REGISTRY[name]()._repr_html_()
    assert Page(text).open == []
    assert len(text) < 20_000


def test_a_block_shows_its_equation_typeset_or_as_it_is_written(things, monkeypatch):
    text = things["block"]._repr_html_()
    formula = re.search(r"<math.*?</math>", text)[0]
    assert "<msub>" in formula
    assert "Paper, Eq (15)" in text
    monkeypatch.setitem(sys.modules, "tsmblocks.html.mathml", None)
    plain = things["block"]._repr_html_()
    assert "<pre>" in plain
    assert "k_P e" in plain
    assert Page(plain).open == []


def test_what_is_large_stays_small():
    t = np.linspace(0.0, 1000.0, 200_001)
    names = [f"s{k}" for k in range(300)]
    units = {name: ("rad", "V", "N", "A", "s", "m", "kg")[k % 7] for k, name in enumerate(names)}
    wide = tsm.Record("wide", t, {name: np.sin(k + t) for k, name in enumerate(names)}, units, notes=("x",) * 1000)
    text = wide._repr_html_()
    assert len(text) < 250_000
    assert "(300 in all)" in text
    assert "(1000 in all)" in text
    long = LookupTable(points=tuple(map(float, range(5000))), values=tuple(map(float, range(5000))))
    assert len(long._repr_html_()) < 10_000
    assert repr(long) == (
        "LookupTable(points=(0.0, 1.0, 2.0, … 5000 in all), values=(0.0, 1.0, 2.0, … 5000 in all), "
        "interpolation='linear', outside='hold')"
    )


def test_signals_that_are_missing_or_flat_are_drawn_all_the_same():
    empty = tsm.Record("empty", [], {"x": []}, {})
    flat = tsm.Record("flat", T, {"x": np.zeros(len(T)), "y": np.full(len(T), np.nan), "z": X * 1e308}, {"x": "rad"})
    for one in (empty, flat):
        assert Page(one._repr_html_()).open == []
        assert "NaN" not in one._repr_html_()


def test_responses_that_are_not_finite_are_told_and_names_stay_text():
    one = Responses("r", T, {NASTY: np.full((2, len(T)), np.nan)}, {})
    assert f"{escape(NASTY)}: no run is finite all along." in one._repr_html_()


def test_a_card_needs_no_matplotlib_and_no_pandas():
    code = (
        "import sys, tsmblocks as tsm; run = tsm.simulate(tsm.load('fig16_feedforward_feedback'), stop=0.1); "
        "run._repr_html_(); print({'matplotlib', 'pandas', 'xarray'} & set(sys.modules))"
    )
    done = subprocess.run([sys.executable, "-c", code], capture_output=True, text=True, timeout=120, check=True)
    assert done.stdout.strip() == "set()"


def test_a_diagram_is_its_picture():
    assert LOOP._repr_svg_() == tsm.to_svg(LOOP)


# ---- at the prompt

SHORT = {
    "run": "Run(… 0 to 2 s, 2001 instants, x_ref, x_out, x_in, u, ref.y, … (23 in all))",
    "record": "Record(… 0 to 5.99 s, 600 samples, x_in [rad], x_out [rad])",
    "fit": "Fit(… converged, 2 numbers, rms 1.",
    "differences": "Differences(… …, x_out, rms 1.",
    "comparison": "Comparison(best 'play' of 2: play, …",
    "diagnosis": "Diagnosis(… named: backlash on ",
    "study": "Results(… 3 of 3 runs, metrics …",
    "responses": "Responses('Feedforward plus PID feedback of the tip', 3 runs, 101 instants, x_ref, x_out, x_in, u)",
    "batch": "Batch(2 sets of pid.kp, results x_ref, x_out, x_in, u)",
    "reduced": "Batch(50 sets of pid.kp, results last)",
    "tuned": "Tuned(pid.kp 2; rms(x_ref - x_out) [deg] 0.",
    "control": "OptimalControl(… u, ",
    "frequencies": "FrequencyResponse(… x over u, 2 frequencies, sizes 0.1, 0.2)",
    "block": "PID(kp=2.0, ki=0.0, kd=0.0, tau=0.01, integral=0.0, smooth=0.0)",
    "source": "Sine(amplitude=0.9599310885968813, frequency=0.2, ",
}


@pytest.mark.parametrize("kind", KINDS)
def test_a_prompt_is_told_in_a_line(kind, things):
    said = repr(things[kind]).replace(repr(NASTY) + ",", "…").replace(NASTY, "…")
    assert said.startswith(SHORT[kind])
    assert "\n" not in said
    assert len(said) < 200


def test_what_else_is_told_in_a_line():
    eq = tsm.equations(LOOP)
    motor = tsm.load("motor_linear")
    said = {
        repr(LOOP): "Diagram('Feedforward plus PID feedback of the tip', 10 blocks, outputs x_ref [rad], x_out [rad], "
        "x_in [rad], u [V])",
        repr(motor): "Diagram('Motor as a linear transfer function', 1 block, inputs u [V], outputs x [rad])",
        repr(eq): "Equations('Feedforward plus PID feedback of the tip', 8 states, 29 parameters, outputs x_ref, "
        "x_out, x_in, u)",
        repr(tsm.Stepper(motor, step=0.01)): "Stepper('Motor as a linear transfer function', t = 0 s in steps of "
        "0.01 s)",
        repr(tsm.sensitivities(LOOP, ["pid.kp"], stop=0.1)): "Sensitivities(x_ref, x_out, x_in, u by pid.kp, 101 "
        "instants)",
        repr(grid({"pid.kp": [1.0, 2.0]})): "Plan(columns={'pid.kp': array([1., 2.])}, kind='grid')",
    }
    assert list(said) == list(said.values())
