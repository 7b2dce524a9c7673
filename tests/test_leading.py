"""Columns that were exchanged: the output runs ahead of the input, and no gap does that."""

import numpy as np

import tsmblocks as tsm
from tsmblocks.fitting.input_checks import runs_ahead

T = np.arange(0.0, 12.0, 0.01)
X = 0.8 * np.sin(1.1 * T) + 0.4 * np.sin(2.6 * T)
NAMES = ("x_in", "x_out")


def late(by, noise=0.003):
    return 0.9 * np.interp(T - by, T, X, left=0.0) + noise * np.random.default_rng(0).standard_normal(len(T))


def gap(u, half=0.05):
    y, at = np.empty_like(u), 0.0
    for k, value in enumerate(u):
        y[k] = at = min(max(at, value - half), value + half)
    return y


def test_the_time_by_which_an_output_runs_ahead():
    words = runs_ahead(NAMES, T, X, late(-0.02), 0.9 * X)
    assert words == (
        "x_out leads x_in by 0.02 s, and the model has no such lead: were the two exchanged, or was one recorded late?"
    )


def test_what_is_late_in_proportion_or_noise_does_not_run_ahead():
    noise = np.random.default_rng(1).standard_normal(len(T))
    for y in (late(0.1), late(0.0), gap(X), noise, 0 * T, 0.9 * X):
        assert runs_ahead(NAMES, T, X, y, 0.9 * X) == ""
    assert runs_ahead(NAMES, T, 0 * T, late(-0.1), 0 * T) == ""
    assert runs_ahead(NAMES, T[:2], X[:2], X[:2], X[:2]) == ""


def test_a_model_that_runs_ahead_as_much_is_no_wonder():
    assert runs_ahead(NAMES, T, X, late(-0.1), late(-0.09, 0.0)) == ""
    speed = np.gradient(X, T)
    assert runs_ahead(NAMES, T, X, speed, 0.5 * speed) == ""


def test_a_lead_of_another_form_than_that_of_the_simulation_is_none():
    y = late(-0.1, 0.0)
    assert runs_ahead(NAMES, T, X, y, 0.9 * X)
    unlike = 0.5 * np.sin(0.9 * T + 2.0) + 0.4 * X
    assert runs_ahead(NAMES, T, X, y, unlike) == ""


def exchange_effects():
    y = gap(X) + 0.003 * np.random.default_rng(2).standard_normal(len(T))
    return tsm.Record("run", T, {"x_in": y, "x_out": X}, {"x_in": "rad", "x_out": "rad"})


def test_a_fit_to_columns_that_were_exchanged_says_so():
    found = tsm.fit(tsm.load("tendon_sheath_play"), exchange_effects())
    (words,) = [text for text in found.notes if " leads " in text]
    assert words.startswith("run: x_out leads x_in by 0.0")
    assert words.endswith(" s, and the model has no such lead: were the two exchanged, or was one recorded late?")


def test_a_diagnosis_of_columns_that_were_exchanged_says_so_beside_the_name():
    found = tsm.diagnose(
        tsm.load("tendon_sheath_play"), exchange_effects(), noise_floor="0.003 rad", effects=["backlash", "creep"]
    )
    assert found.verdict != "none"
    assert " But x_out leads x_in by 0.0" in found.sentence
    assert found.sentence.endswith("were the two exchanged, or was one recorded late?")


def test_what_is_explained_hardly_better_than_by_the_mean_is_told():
    """A motion inside the gap: nothing follows."""
    x = 0.03 * np.sin(1.9 * T)
    y = gap(x) + 0.003 * np.random.default_rng(3).standard_normal(len(T))
    found = tsm.fit(
        tsm.load("tendon_sheath_play"), tsm.Record("run", T, {"x_in": x, "x_out": y}, dict(x_in="rad", x_out="rad"))
    )
    assert 0 < found.differences["run"].fit_percent < 1
    assert "run: the diagram explains x_out hardly better than its mean does." in found.notes
