"""Which experiment tells two effects apart: against refits to what the experiment would have shown."""

from types import SimpleNamespace

import attrs
import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

import tsmblocks as tsm
from tsmblocks.blocks import DeadTime, Drift, Gain, GainDrift, Lag, Sine
from tsmblocks.diagnosis.discrimination import (
    EXPERIMENT_SAMPLES,
    candidate_motions,
    fisher_information,
    separating_experiment,
    separation,
    separations,
)
from tsmblocks.diagnosis.model import ModelSettings, calibrate, optimized, pose_extended
from tsmblocks.diagnosis.presentation import digits
from tsmblocks.effects import Span, catalogue

STEP = 0.01
SIGMA = 0.01
T = np.arange(1500) * STEP
SLOW = 0.2


def behind(block, gain=1.0):
    """A gain, and a block behind it."""
    return tsm.Diagram(
        title="behind a gain",
        blocks={"gain": Gain(gain=gain), "late": block},
        wires=["gain -> late"],
        inputs={"x": "gain"},
        outputs={"y": "late"},
    )


def moved(frequency, name="slow", late=0.05, noise=True):
    """A sine, and what a dead time makes of it."""
    x, y = (np.sin(2 * np.pi * frequency * (T - shift)) for shift in (0.0, late))
    y = np.where(late > T, 0.0, y)
    y = y + SIGMA * np.random.default_rng(3).standard_normal(len(T)) * noise
    return tsm.Record(name, T, {"x": x, "y": y}, {})


ASKED = ModelSettings(None, {"y": SIGMA}, ("y",))


@pytest.fixture(scope="module")
def models():
    """A dead time and a lag, both fitted to a slow sine."""
    records = {"slow": moved(SLOW)}
    dead, lag = (calibrate(behind(block), records, ASKED) for block in (DeadTime(time=0.03), Lag(time_constant=0.03)))
    return records, dead, lag


def grown(model, records, new):
    """How much the sum of squares grows, in variances of the noise, when a model has to fit another recording too."""
    squares = []
    for some in (records, {**records, "new": new}):
        problem, setup = pose_extended(model, model.fitted_diagram, (), some, ASKED)
        squares.append(float(np.sum(optimized(problem, setup, problem.unknowns.start, 1e-6).r ** 2)))
    return squares[1] - squares[0]


@pytest.mark.parametrize("frequency", [0.5, 1.0, 2.0])
def test_the_separation_is_what_a_refit_would_leave(models, frequency):
    records, dead, lag = models
    late = dead.values["late.time"]
    new = moved(frequency, "new", late, noise=False)
    new = new.with_signal("y", dead.values["gain.gain"] * new["y"])
    foretold = separation(lag, fisher_information(lag), {"new": new}, ASKED)
    assert len(T) * foretold**2 == pytest.approx(grown(lag, records, new), rel=0.15, abs=0.5)


def test_a_model_is_not_told_from_itself(models):
    _, dead, _ = models
    late = dead.values["late.time"]
    new = moved(1.0, "new", late, noise=False)
    new = new.with_signal("y", dead.values["gain.gain"] * new["y"])
    assert separation(dead, fisher_information(dead), {"new": new}, ASKED) < 1e-2


def standing_for(model, effect):
    """What is known of a candidate that was fitted."""
    return SimpleNamespace(model=model, candidate=SimpleNamespace(effect=effect))


def effect(name):
    return next(e for e in catalogue() if e.name == name)


def test_fast_motion_tells_a_dead_time_from_a_lag(models):
    records, dead, lag = models
    one, other = standing_for(dead, effect("dead_time")), standing_for(lag, effect("first_order_lag"))
    told = {s.words: s.size for s in separations(one, [other], records, ASKED)}
    slow = next(size for words, size in told.items() if words.startswith("a slow ramp"))
    chirp = next(size for words, size in told.items() if words.startswith("a chirp of"))
    assert chirp > 3 * slow
    best = separating_experiment(one, [other], records, ASKED)
    words = max(told, key=told.get)
    assert best == f"{words} (expected difference {digits(told[words])} times the noise)"


def test_of_several_the_hardest_to_tell_counts(models):
    records, dead, lag = models
    one, other = standing_for(dead, effect("dead_time")), standing_for(lag, effect("first_order_lag"))
    same = standing_for(dead, effect("rate_dependence"))
    assert max(s.size for s in separations(one, [other, same], records, ASKED)) < 1e-2
    said = separating_experiment(one, [other, same], records, ASKED)
    assert said.startswith(effect("dead_time").separates)
    assert said.endswith(
        ", in a larger range or at a higher speed than recorded: no motion within these separates them"
    )


def test_a_clock_that_began_long_before_changes_no_foretold_experiment():
    """An offset that drifts and a gain that does: what tells them apart is not how long the clock had run."""
    told = []
    for start in (0.0, 1e4):
        x, noise = 1.0 + 0.1 * np.sin(2 * np.pi * SLOW * T), SIGMA * np.random.default_rng(3).standard_normal(len(T))
        records = {"a": tsm.Record("a", T + start, {"x": x, "y": x + 0.01 * T + noise}, {})}
        models = [
            calibrate(behind(block), records, attrs.evolve(ASKED, free=["gain.gain", "late.rate"]))
            for block in (Drift(since=start), GainDrift(since=start))
        ]
        one, other = (standing_for(m, effect(n)) for m, n in zip(models, ("drift", "parameter_change"), strict=True))
        told.append({s.words: s.size for s in separations(one, [other], records, ASKED)})
    assert told[1] == pytest.approx(told[0], rel=1e-3)


def test_what_stands_alone_needs_no_experiment(models):
    records, dead, _ = models
    one = standing_for(dead, effect("dead_time"))
    assert separating_experiment(one, [], records, ASKED) == ""
    assert separating_experiment(one, [standing_for(dead, effect("dead_time"))], records, ASKED) == ""


def test_what_nothing_moves_gets_the_words_of_the_effect():
    free = tsm.Diagram(title="alone", blocks={"s": Sine()}, outputs={"y": "s"})
    records = {"a": tsm.Record("a", T, {"y": np.sin(2 * np.pi * T)}, {})}
    model = calibrate(free, records, ASKED)
    one, other = standing_for(model, effect("drift")), standing_for(model, effect("jump"))
    assert separating_experiment(one, [other], records, ASKED) == effect("drift").separates


@settings(deadline=None)
@given(low=st.floats(-1e3, 1e3), reach=st.floats(1e-6, 1e6), speed=st.floats(1e-3, 1e3), step=st.floats(1e-5, 10.0))
def test_no_motion_is_larger_or_faster_than_what_was_recorded(low, reach, speed, step):
    fastest = speed * reach / (EXPERIMENT_SAMPLES * step)
    span = Span(low, low + 2 * reach, reach, fastest, fastest)
    for motion in candidate_motions(span, step, "rad"):
        assert motion.values.shape == (EXPERIMENT_SAMPLES,)
        assert np.all(np.isfinite(motion.values))
        assert motion.values.min() >= low - 1e-9 * (abs(low) + reach)
        assert motion.values.max() <= low + 2 * reach + 1e-9 * (abs(low) + reach)
        assert np.max(np.abs(np.diff(motion.values))) <= 1.03 * fastest * step


def test_a_motion_as_lively_as_a_sine_allows_every_one():
    span = Span(-1.0, 1.0, 0.7, 3.0, 2 * np.pi * 0.7)
    words = [motion.words for motion in candidate_motions(span, 0.01, "rad")]
    assert len(words) == len(set(words)) == 8
    assert "a chirp of 5.73 deg from 0.160 to 4.90 Hz, 25.0 s" in words
