"""A time and a distance at one frequency: neither is named as if the other were excluded."""

from types import SimpleNamespace

import numpy as np
import pytest

import tsmblocks as tsm
from tsmblocks import blocks as b
from tsmblocks.diagnosis.cross_validation import TimeBlocks
from tsmblocks.diagnosis.decision import Verdict
from tsmblocks.diagnosis.time_and_distance import only_frequency, with_distances_first

T = np.arange(0.0, 20.0, 0.02)
NAMES = ["dead_time", "backlash", "first_order_lag"]


def record(x, y=None, name="run"):
    return tsm.Record(name, T, {"x_in": x, "x_out": x if y is None else y}, {"x_in": "rad", "x_out": "rad"})


def sine(f=0.5, size=1.0):
    return size * np.sin(2 * np.pi * f * T)


def test_one_motion_has_one_frequency():
    assert only_frequency({"a": record(sine())}, ["x_in"]) == pytest.approx(0.5, abs=0.03)
    triangle = np.arcsin(np.sin(2 * np.pi * 0.5 * T))
    assert only_frequency({"a": record(triangle), "b": record(triangle)}, ["x_in"]) == pytest.approx(0.5, abs=0.03)


@pytest.mark.parametrize(
    "motions",
    [
        [sine() + 0.5 * sine(1.3)],
        [sine(), sine(1.0)],
        [sine(), sine(size=0.5)],
        [np.random.default_rng(0).normal(size=T.size)],
        [np.zeros(T.size)],
    ],
    ids=["two tones", "two frequencies", "two amplitudes", "noise", "rest"],
)
def test_several_motions_have_none(motions):
    assert only_frequency({str(k): record(x) for k, x in enumerate(motions)}, ["x_in"]) is None


def shifted(block, motions):
    """Recordings of a gain with a block behind it."""
    plain = tsm.load("tendon_sheath_linear")
    made, records, rng = plain.insert("hidden", block, before="x_out"), [], np.random.default_rng(4)
    for k, x in enumerate(motions):
        run = tsm.simulate(made, inputs={"x_in": (T, x)}, stop=T[-1], step=0.01, hold="cubic", log="outputs")
        y = np.interp(T, run.t, run["x_out"]) + rng.normal(0.0, 0.05, T.size)
        records.append(record(x, y, f"run{k}"))
    return tsm.diagnose(plain, records, noise_floor=0.05, effects=NAMES)


def test_at_one_frequency_a_gap_is_named_with_the_delay_beside_it():
    """A small gap and a delay of the same phase differ by less than the noise."""
    (effect,) = shifted(b.Play(half_width=0.05), [sine()]).effects
    assert effect.name == "backlash"
    assert set(effect.also_possible) & {"dead_time", "first_order_lag"}
    assert "second frequency" in effect.separating_experiment
    assert "0.250 or 1.00 Hz" in effect.separating_experiment


def test_at_two_frequencies_the_delay_is_named():
    (effect,) = shifted(b.DeadTime(time=0.08), [sine(0.2), sine(1.0, 0.6)]).effects
    assert effect.name == "dead_time"
    assert "backlash" not in effect.also_possible
    assert "second frequency" not in effect.separating_experiment


def candidate(name, count, loss):
    effect = SimpleNamespace(effect=SimpleNamespace(name=name))
    return SimpleNamespace(candidate=effect, parameter_count=count, loss=loss, tenable=True, disqualifying_bounds=())


@pytest.mark.parametrize(
    ("more", "frequency", "named"),
    [(0, None, "backlash"), (1, None, "backlash"), (5, None, "dead_time"), (5, 0.5, "backlash")],
)
def test_many_parameters_of_a_distance_are_no_better_than_one_time(more, frequency, named):
    """At several frequencies a time has a shape of its own, which six parameters of a memory can draw as well."""
    one = TimeBlocks(np.zeros(1, int), np.zeros(1, int), np.zeros(1, int), np.ones(1))
    time, distance = candidate("dead_time", 3, 2.0), candidate("backlash", 3 + more, 1.9)
    verdict = Verdict((distance, time), named=time, indistinguishable=(time,))
    assert with_distances_first(verdict, np.array([10.0]), one, frequency).named.candidate.effect.name == named
