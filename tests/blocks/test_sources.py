"""Sources against closed forms."""

from __future__ import annotations

import numpy as np
import pytest
from scipy.integrate import cumulative_simpson
from scipy.signal import sawtooth

from tests.blocks.helpers import assert_sound, refuses
from tsmblocks.blocks.sources import (
    Chirp,
    Constant,
    MultiSine,
    Ramp,
    Random,
    Recorded,
    Sine,
    Staircase,
    Step,
    Triangle,
    white_noise,
)
from tsmblocks.model.block import signals

ALL = [Chirp, Constant, MultiSine, Ramp, Random, Recorded, Sine, Staircase, Step, Triangle]


def over(block, t):
    """The signal at each instant, from the equations alone."""
    none = signals((), ())
    return np.array([float(block.outputs(at, none, none)["y"]) for at in t])


@pytest.mark.parametrize("cls", ALL)
def test_sound(cls):
    assert_sound(cls())


@pytest.mark.parametrize("cls", ALL)
def test_unit_is_that_of_what_it_drives_unless_asked_for(cls):
    assert cls().outports["y"].unit == "?y"
    assert cls(unit="deg").outports["y"].unit == "deg"
    assert cls(unit="deg").outports["y"].about == cls().outports["y"].about
    refuses(f"{cls.__name__}.unit: 'grad' is not a unit known here. Did you mean 'rad'?", cls, unit="grad")


def test_constant():
    assert over(Constant(value=2.5), [-1.0, 0.0, 7.0]).tolist() == [2.5, 2.5, 2.5]


def test_step_jumps_at_its_time_whatever_the_rounding_of_the_grid():
    step = Step(time=0.3, before=-1.0, after=4.0)
    assert over(step, [0.0, 0.299, 0.3, 0.1 * 3, 9.0]).tolist() == [-1.0, -1.0, 4.0, 4.0, 4.0]
    for h in (0.1, 0.01, 0.001, 1 / 3, 1 / 7):
        times = np.arange(2000) * h
        for k in (1, 3, 6, 29, 57, 1999):
            jump = over(Step(time=sum([h] * k)), times)
            assert int(np.argmax(jump)) == k


def test_ramp():
    assert over(Ramp(start=1.0, slope=-2.0, initial=3.0), [0.0, 1.0, 1.5, 4.0]).tolist() == [3, 3, 2, -3]


def test_sine_has_the_papers_numbers():
    t = np.linspace(-3, 20, 301)
    assert over(Sine(), t) == pytest.approx(np.deg2rad(55) * np.sin(2 * np.pi * 0.2 * t), abs=1e-12)
    shifted = Sine(amplitude=2.0, frequency=3.0, phase=0.4, offset=-1.0)
    assert over(shifted, t) == pytest.approx(-1 + 2 * np.sin(6 * np.pi * t + 0.4), abs=1e-12)


def test_multisine_has_the_papers_numbers():
    t = np.linspace(0, 20, 301)
    expected = np.deg2rad(28) * (np.sin(2 * np.pi * 0.2 * t) + np.sin(2 * np.pi * 0.5 * t))
    assert over(MultiSine(), t) == pytest.approx(expected, abs=1e-12)
    three = MultiSine(amplitudes=(1, 2, 3), frequencies=(0.5, 1, 2), phases=(0, 1, 2))
    expected = np.sin(np.pi * t) + 2 * np.sin(2 * np.pi * t + 1) + 3 * np.sin(4 * np.pi * t + 2)
    assert over(three, t) == pytest.approx(expected, abs=1e-11)


def test_chirp_is_the_sine_of_the_integral_of_its_frequency():
    t = np.linspace(0, 15, 150001)
    chirp = Chirp(amplitude=2.0, f0=0.5, f1=3.0, duration=10.0)
    frequency = 0.5 + 2.5 * np.minimum(t, 10.0) / 10.0
    turns = cumulative_simpson(frequency, x=t, initial=0.0)
    assert over(chirp, t[::500]) == pytest.approx(2 * np.sin(2 * np.pi * turns[::500]), abs=1e-8)
    near = over(chirp, [10 - 1e-9, 10 + 1e-9])
    assert near[0] == pytest.approx(near[1], abs=1e-6)


def test_triangle():
    t = np.linspace(0.01, 12, 500)
    expected = 3 * sawtooth(2 * np.pi * 0.4 * t + np.pi / 2, 0.5)
    assert over(Triangle(amplitude=3.0, frequency=0.4), t) == pytest.approx(expected, abs=1e-12)


@pytest.mark.parametrize(
    ("up", "down", "levels"),
    [
        (2, 2, [0, 1, 2, 1, 0, -1, -2, -1, 0, 1, 2]),
        (3, 0, [0, 1, 2, 3, 2, 1, 0, 1, 2, 3]),
        (0, 2, [0, -1, -2, -1, 0, -1]),
        (1, 2, [0, 1, 0, -1, -2, -1, 0, 1]),
    ],
)
def test_staircase(up, down, levels):
    stairs = Staircase(height=0.5, dwell=0.1, up=up, down=down)
    on_the_step = over(stairs, (np.arange(len(levels)) + 0.5) * 0.1)
    on_its_edge = over(stairs, np.arange(len(levels)) * 0.1)
    assert on_the_step.tolist() == on_its_edge.tolist() == [0.5 * k for k in levels]


def test_noise_depends_on_seed_and_instant_only():
    whole = white_noise(7, 0.01, 0.0, 10.0)
    later = white_noise(7, 0.01, 3.333, 5.0)
    early = white_noise(7, 0.01, -2.0, 0.5)
    lookup = dict(zip(np.rint(whole.t / 0.01), whole.y, strict=True))
    for part in (later, early):
        shared = [(k, y) for k, y in zip(np.rint(part.t / 0.01), part.y, strict=True) if k in lookup]
        assert len(shared) > 50
        assert all(lookup[k] == y for k, y in shared)
    assert later.t[0] <= 3.333
    assert later.t[-1] + 0.01 > 5.0
    assert early.t[0] <= -2.0
    assert whole.hold == "zero"
    first = int(np.flatnonzero(np.rint(whole.t / 0.01) == 0)[0])
    assert whole.y[first:].tolist() == np.random.default_rng(7).standard_normal(len(whole.y) - first).tolist()
    assert not np.array_equal(whole.y, white_noise(8, 0.01, 0.0, 10.0).y)


def test_random_is_scaled_noise():
    random = Random(std=0.5, mean=2.0, seed=3, interval=0.1)
    tape = random.tapes(0.0, 2000.0)["w"]
    none = signals((), ())
    y = [random.outputs(0.0, none, signals(("w",), (w,)))["y"] for w in tape.y]
    assert np.mean(y) == pytest.approx(2.0, abs=0.02)
    assert np.std(y) == pytest.approx(0.5, abs=0.02)
    assert np.diff(tape.t) == pytest.approx(0.1)


def test_recorded_hands_its_samples_on():
    record = Recorded(times=[0, 1, 2.5, 3], values=(1, -1, 4, 0), hold="cubic", gain=2.0, offset=0.5)
    tape = record.tapes(0.0, 10.0)["w"]
    assert (tape.t.tolist(), tape.y.tolist(), tape.hold) == ([0, 1, 2.5, 3], [1, -1, 4, 0], "cubic")
    none = signals((), ())
    assert record.outputs(0.0, none, signals(("w",), (-1.0,)))["y"] == -1.5
    assert record == Recorded(times=(0, 1, 2.5, 3), values=(1, -1, 4, 0), hold="cubic", gain=2.0, offset=0.5)


def test_refuses_what_does_not_go_together():
    refuses(
        "MultiSine needs one amplitude, one frequency and one phase for each sine, "
        "got 3 amplitudes, 2 frequencies and 2 phases.",
        MultiSine,
        amplitudes=(1, 2, 3),
    )
    refuses(
        "MultiSine needs one amplitude, one frequency and one phase for each sine, "
        "got 0 amplitudes, 0 frequencies and 0 phases.",
        MultiSine,
        amplitudes=(),
        frequencies=(),
        phases=(),
    )
    refuses("Chirp.duration must lie in (0, inf), got 0. It is: how long the sweep takes [s].", Chirp, duration=0)
    refuses("Random.std must lie in [0, inf), got -1. It is: standard deviation.", Random, std=-1)
    refuses(
        "Random.seed must be a whole number in [0, inf), got 0.5. "
        "It is: seed; with the block's name it fixes the noise.",
        Random,
        seed=0.5,
    )
    refuses(
        "Random.interval must lie in (0, inf), got 0. It is: time for which each number is held [s].",
        Random,
        interval=0.0,
    )
    refuses("Staircase needs at least one step, got up=0, down=0.", Staircase, up=0, down=0)
    refuses(
        "Recorded needs one value for each instant, got 2 times and 3 values.", Recorded, times=(0, 1), values=(0, 1, 2)
    )
    refuses("Recorded.times must increase, but times[1]=1 and times[2]=1.", Recorded, times=(0, 1, 1), values=(0, 1, 2))
    refuses("Recorded.values[1] must be a finite number, got nan.", Recorded, times=(0, 1), values=(0, np.nan))
    refuses("Recorded.times[1] must be a finite number, got 'a'.", Recorded, times=(0, "a"), values=(0, 1))
    refuses(
        "Recorded with hold='cubic' needs at least 4 samples, got 3.",
        Recorded,
        times=(0, 1, 2),
        values=(0, 1, 2),
        hold="cubic",
    )
    refuses(
        "Recorded.hold is 'cubical', which is not a choice. Did you mean 'cubic'? It is: signal between samples.",
        Recorded,
        hold="cubical",
    )
