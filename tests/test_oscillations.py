"""Oscillations that are one with another in the model."""

from types import SimpleNamespace

import numpy as np
import pytest

import tsmblocks as tsm
from tsmblocks import blocks as b
from tsmblocks.diagnosis.oscillation import follows_motion, is_of_a_tone, repeats_another

REACH = np.pi / 4  # a signal with a range of a quarter turn


def model_and_candidate(kind, name, value, other, other_kind=None):
    """A candidate whose block has a parameter ``name``, beside another block with the same in the model."""
    parts = {"new": kind(), "old": (other_kind or kind)()}
    items = [SimpleNamespace(parameter=f"{k}.{name}") for k in parts]
    times = [SimpleNamespace(record=SimpleNamespace(t=np.array([0.0, span]))) for span in (4.0, 10.0)]
    problem = SimpleNamespace(unknowns=SimpleNamespace(items=items))
    model = SimpleNamespace(problem=problem, theta=np.array([value, other]), setup=SimpleNamespace(experiments=times))
    scales = SimpleNamespace(wire=SimpleNamespace(reach=REACH))
    return model, SimpleNamespace(block="new", diagram=SimpleNamespace(blocks=parts), scales=scales)


@pytest.mark.parametrize(
    ("kind", "name", "value", "other", "same"),
    [
        (b.Disturbance, "frequency", 2.0, 2.049, True),  # half a period apart after 10 s from 0.05 Hz on
        (b.Disturbance, "frequency", 2.0, 2.051, False),
        (b.Ripple, "cycles", 20.0, 21.99, True),  # a quarter turn: half a period from 2 /rad on
        (b.Ripple, "cycles", 20.0, 22.01, False),
        (b.Ripple, "cycles", 20.0, -20.5, True),
    ],
)
def test_two_that_stay_within_half_a_period_are_one(kind, name, value, other, same):
    assert repeats_another(*model_and_candidate(kind, name, value, other)) == same


def test_another_kind_of_block_is_another_oscillation():
    assert not repeats_another(*model_and_candidate(b.Disturbance, "frequency", 2.0, 2.0, b.Ripple))


def test_without_a_scale_no_period_over_a_position_is_judged():
    model, one = model_and_candidate(b.Ripple, "cycles", 20.0, 20.0)
    one.scales = None
    assert not repeats_another(model, one)


T = np.arange(0.0, 20.0, 0.01)
TONES = np.sin(2 * np.pi * 0.31 * T) + 0.05 * np.sin(2 * np.pi * 7.31 * T + 1.0)
STEPS = np.sign(np.sin(0.5 * T**1.7))  # of ever shorter periods


def with_frequency(frequency, motions, left=0.0):
    """A model with an oscillation that leaves ``left`` of unit residuals, which the base leaves of each experiment."""
    noise = 0.01 * np.random.default_rng(4).standard_normal(len(T))
    records = {f"r{k}": tsm.Record(f"r{k}", T, {"u": u + noise}, {"u": "V"}) for k, u in enumerate(motions)}
    setup = SimpleNamespace(
        experiments=[SimpleNamespace(record=one, name=name) for name, one in records.items()], outputs={"y": None}
    )
    segments = [slice(k * len(T), (k + 1) * len(T)) for k in range(len(motions))]
    item = SimpleNamespace(parameter="new.frequency")
    problem = SimpleNamespace(unknowns=SimpleNamespace(items=[item]), segments=segments)
    differences = np.ones(len(motions) * len(T))
    base = SimpleNamespace(differences=differences)
    model = SimpleNamespace(
        problem=problem,
        theta=np.array([frequency]),
        setup=setup,
        diagram=SimpleNamespace(inputs={"u": None}),
        differences=differences * np.repeat(np.broadcast_to(left, len(motions)), len(T)),
    )
    return model, base, SimpleNamespace(free=("new.frequency",))


@pytest.mark.parametrize(
    ("frequency", "tone"),
    [(7.31, True), (7.31 + 0.024, True), (7.31 + 0.03, False), (5.0, False), (0.31, True)],
    ids=["small tone", "within half the resolution", "beside it", "elsewhere", "main tone"],
)
def test_an_oscillation_at_a_tone_of_the_input_is_no_disturbance(frequency, tone):
    assert is_of_a_tone(*with_frequency(frequency, [TONES])) is tone


@pytest.mark.parametrize("of_motion", [is_of_a_tone, follows_motion])
@pytest.mark.parametrize(
    ("left", "follows"),
    [([0.0, 0.8, 0.8], True), ([0.0, 0.5, 0.5], False), ([0.8, 0.0, 0.0], False), ([0.0, 1.0, 1.0], True)],
)
def test_an_oscillation_follows_the_motion_where_it_explains_most_in_motions_of_its_frequency(of_motion, left, follows):
    assert of_motion(*with_frequency(0.31, [TONES, STEPS, STEPS], left)) is follows


@pytest.mark.parametrize(("frequency", "follows"), [(0.31, True), (5 * 0.31, True), (9.3 * 0.31, False), (0.36, False)])
def test_harmonics_of_the_motion_follow_it(frequency, follows):
    assert follows_motion(*with_frequency(frequency, [TONES])) is follows


def test_a_slow_motion_is_no_period_whose_harmonics_follow_it():
    slow = np.sin(2 * np.pi * 0.8 * T / T[-1])
    assert not follows_motion(*with_frequency(5 * 0.8 / T[-1], [slow]))


LAG = tsm.Diagram(
    blocks={"lag": b.FirstOrderLag(time_constant=0.1)}, inputs={"u": tsm.Inlet("lag", unit="rad")}, outputs={"y": "lag"}
)


def disturbed(sign, phase):
    """A motion, or the opposite one, and an error of 0.83 Hz that is no harmonic of it."""
    t = np.arange(0.0, 20.0, 0.01)
    u = sign * sum(np.sin(2 * np.pi * f * t + k) for k, f in enumerate((0.31, 0.47, 1.13, 1.71)))
    y = np.asarray(tsm.simulate(LAG, inputs={"u": (t, u)}, step=0.01)["y"])
    noise = 0.01 * np.random.default_rng(int(10 * phase) + 5).standard_normal(len(t))
    y = y + 0.05 * np.sin(2 * np.pi * 0.83 * t + phase) + noise
    return tsm.Record(f"{sign}", t, {"u": u, "y": y}, {"u": "rad", "y": "rad"})


@pytest.mark.parametrize(("second", "named"), [(np.pi, False), (np.pi + 1.0, True)])
def test_an_oscillation_that_turns_with_the_motion_is_no_disturbance(second, named):
    records = [disturbed(1, 0.0), disturbed(-1, second)]
    found = tsm.diagnose(LAG, records, effects=["periodic_disturbance"], noise_floor="0.01rad")
    assert [one.name for one in found.effects] == ["periodic_disturbance"] * named
    assert ("it comes back with the motion" in found.details()) != named
