"""A window of the recordings: what is compared, what is told of it; and recordings in which nothing moves."""

import json
from dataclasses import replace

import numpy as np
import pytest

import tsmblocks as tsm
from tests.hidden import Spec, cases
from tests.hidden_bases import diagnosed
from tsmblocks.common.errors import DataError


def touched():
    """A gain with backlash in two recordings; while the first second is recorded, somebody moves the sensor."""
    t = np.arange(0.0, 6.0, 0.01)
    noise, made = np.random.default_rng(4), {}
    for name, size in (("large", 1.0), ("small", 0.3)):
        x = size * (0.8 * np.sin(1.3 * t) + 0.3 * np.sin(3.1 * t))
        y = play(0.95 * x, 0.03) + noise.normal(0.0, 0.004, t.size) + np.where(t < 1.0, 0.2 * np.sin(20 * t), 0.0)
        made[name] = tsm.Record(name, t, {"x_in": x, "x_out": y}, {"x_in": "rad", "x_out": "rad"})
    return made


def play(x, half_width):
    middle, y = 0.0, []
    for u in x:
        middle = max(u - half_width, min(u + half_width, middle))
        y.append(middle)
    return np.array(y)


def test_only_what_lies_in_the_window_is_compared():
    base, records, some = tsm.load("tendon_sheath_linear"), touched(), ["backlash", "drift", "jump"]
    assert tsm.diagnose(base, records, effects=some).verdict == "unknown"
    said = tsm.diagnose(base, records, effects=some, window=(1.0, 5.0))
    assert [e.name for e in said.effects] == ["backlash"]
    assert said.effects[0].parameters["half_width"].value == pytest.approx(0.03, rel=0.03)
    assert said.segments[0].noise_floor["x_out"] == pytest.approx(0.004, rel=0.1)
    assert said.windows == {"large": (1.0, 5.0), "small": (1.0, 5.0)}
    assert [(t.t[0], t.t[-1], len(t.t)) for t in said.segments[0].traces] == [(1.0, 5.0, 401)] * 2
    assert "- all experiments: only 1 s to 5 s is compared.\n" in str(said)
    assert json.loads(said.to_json())["windows"] == {"large": [1.0, 5.0], "small": [1.0, 5.0]}


def test_a_window_may_differ_by_experiment():
    records = touched()
    said = tsm.diagnose(
        tsm.load("tendon_sheath_linear"), records, effects=["drift"], noise_floor=0.004, window={"small": (1.0, None)}
    )
    assert said.windows == {"small": (1.0, 5.99)}
    assert [len(t.t) for t in said.segments[0].traces] == [600, 500]


def test_the_memory_before_the_window_counts():
    """What is compared begins inside the gap, and the motion before it has taken it to its side."""
    records = touched()
    record = {"large": records["large"].part(0.5, None)}
    said = tsm.diagnose(
        tsm.load("tendon_sheath_play"),
        record,
        free=["play.half_width"],
        start_states=False,
        condition=False,
        effects=["drift"],
        noise_floor=0.004,
        window=(2.0, None),
    )
    fit = tsm.fit(tsm.load("tendon_sheath_play"), record, free=["play.half_width"], window=(2.0, None), hold="cubic")
    assert said.base.parameters["play.half_width"] == pytest.approx(fit.values["play.half_width"], rel=1e-3)


def test_a_window_of_a_plant_that_integrates_is_cut_into_pieces():
    (case,) = cases([Spec("motor_closed", "coulomb_friction", amplitude=0.05, seed=3)], step=2e-3)
    kept = {n: {k: v[::3] for k, v in case.experiments[n].items()} for n in ("sine", "odd_multisine")}
    window = {n: (e["t"][0] + 1.0, e["t"][0] + 3.5) for n, e in kept.items()}
    said = diagnosed(replace(case, experiments=kept), effects=["coulomb_friction"], window=window)
    assert [e.name for e in said.effects] == ["coulomb_friction"]
    for trace in said.segments[0].traces:
        low, high = window[trace.experiment.partition("#")[0]]
        assert low <= trace.t[0] < trace.t[-1] <= high


@pytest.mark.parametrize(
    ("window", "message"),
    [
        (
            (1.0, 1.5),
            "a diagnosis takes at least 200 samples of all experiments together, and there are 102: with "
            "fewer, no effect is distinguishable from chance.",
        ),
        (
            (9.0, None),
            "experiment 'large': the window from 9 s on holds 0 samples, and at least 4 are needed; it "
            "was recorded from 0 to 5.99 s.",
        ),
        ((3.0, 2.0), "window must be two times in order, got (3, 2) s."),
        ({"lrage": (0.0, 3.0)}, "window: there is no experiment 'lrage'. Did you mean 'large'?"),
        (2.0, "window must be a pair (start, stop) in s, None for an end, got 2."),
    ],
)
def test_windows_that_are_none_are_refused(window, message):
    with pytest.raises(DataError) as caught:
        tsm.diagnose(tsm.load("tendon_sheath_linear"), touched(), window=window)
    assert str(caught.value) == message


# ---- recordings in which nothing moves


@pytest.mark.parametrize("base", ["tendon_sheath_linear", "tendon_sheath_play"])
@pytest.mark.parametrize(("x", "y"), [(0.2, "rest"), (0.2, "noise"), (0.0, "rest"), ("moves", "rest")])
def test_what_stands_still_shows_nothing_and_breaks_nothing(base, x, y):
    t, draw = np.arange(0.0, 3.0, 0.01), np.random.default_rng(5)
    signals = {
        "x_in": np.sin(2 * t) if x == "moves" else np.full(t.size, x),
        "x_out": np.full(t.size, 0.05) + (1e-3 * draw.normal(size=t.size) if y == "noise" else 0.0),
    }
    still = tsm.Record("still", t, signals, {"x_in": "rad", "x_out": "rad"})
    said = tsm.diagnose(tsm.load(base), still, noise_floor=1e-3)
    assert said.verdict == "none"
    assert json.loads(said.to_json())["detection_limits"]["backlash"] is None
    assert " backlash," in str(said).partition("not testable with these data")[2].replace("\n", " ")
