"""Oscillations that are one with another in the model."""

from types import SimpleNamespace

import numpy as np
import pytest

from tsmblocks import blocks as b
from tsmblocks.diagnosis.oscillation import repeats_another

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
