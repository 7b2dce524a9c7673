"""Which experiment tells two effects apart: against refits to what the experiment would have shown."""

from types import SimpleNamespace

import numpy as np
import pytest

import tsmblocks as tsm
from tsmblocks.blocks import DeadTime, Gain, Lag
from tsmblocks.common.rounding import to_digits
from tsmblocks.diagnosis import discrimination
from tsmblocks.diagnosis.discrimination import (
    Separation,
    fisher_information,
    separating_experiment,
    separation,
    separations,
)
from tsmblocks.diagnosis.model import ModelSettings, calibrate, optimized, pose_extended
from tsmblocks.effects import catalogue

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
    more = ", rms; 0.24 is enough" if told[words] < 1 else ""
    assert best == f"{words} (expected difference {to_digits(told[words])} times the noise{more})"


def test_of_several_the_hardest_to_tell_counts(models):
    records, dead, lag = models
    one, other = standing_for(dead, effect("dead_time")), standing_for(lag, effect("first_order_lag"))
    same = standing_for(dead, effect("rate_dependence"))
    assert max(s.size for s in separations(one, [other, same], records, ASKED)) < 1e-2
    said = separating_experiment(one, [other, same], records, ASKED)
    assert said.startswith(effect("dead_time").separates)
    assert "; with a larger range or a higher speed than recorded, since no motion that was tried" in said
    assert said.endswith(" times the noise; 0.24 is needed)")


def test_no_experiment_is_proposed_whose_difference_is_too_small_to_name_an_effect(models, monkeypatch):
    records, dead, lag = models
    one, other = standing_for(dead, effect("dead_time")), standing_for(lag, effect("first_order_lag"))
    for size, proposed in ((0.108, False), (0.25, True)):
        monkeypatch.setattr(discrimination, "separations", lambda *_, size=size: [Separation("a chirp", size)])
        said = separating_experiment(one, [other], records, ASKED)
        assert said.startswith("a chirp (expected difference") is proposed
        assert ("separates them (expected difference 0.11 times the noise; 0.24 is needed)" in said) is not proposed


def test_for_an_effect_of_time_nothing_shorter_than_the_recordings_is_proposed(models, monkeypatch):
    records, dead, lag = models
    monkeypatch.setattr(discrimination, "separations", lambda *_: [Separation("a chirp", 2.0)])
    drift, other = standing_for(dead, effect("drift")), standing_for(lag, effect("first_order_lag"))
    for samples, proposed in ((1000, False), (2500, True)):  # the recordings have 1500
        monkeypatch.setattr(discrimination, "EXPERIMENT_SAMPLES", samples)
        assert (separating_experiment(drift, [other], records, ASKED) == effect("drift").separates) is not proposed
        assert separating_experiment(other, [standing_for(lag, effect("dead_time"))], records, ASKED)[:7] == "a chirp"
