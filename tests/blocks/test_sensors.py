"""Sensors against numpy."""

from __future__ import annotations

import numpy as np
import pytest

from tests.blocks.helpers import assert_sound, refuses, value
from tsmblocks.blocks.sensors import Bias, Encoder, GainError, SensorNoise
from tsmblocks.blocks.sources import Random

ANGLES = np.linspace(-7, 7, 301)


@pytest.mark.parametrize("block", [Bias(), GainError(), Encoder(), Encoder(rounding="down"), SensorNoise()])
def test_sound(block):
    assert_sound(block)


def test_encoder():
    count = 2 * np.pi / 100
    for u in ANGLES:
        nearest = value(Encoder(counts=100), u=u)["y"]
        assert nearest == pytest.approx(count * np.floor(u / count + 0.5), abs=1e-12)
        assert abs(nearest - u) <= count / 2 + 1e-12
        down = value(Encoder(counts=100, rounding="down"), u=u)["y"]
        assert -1e-12 <= u - down <= count + 1e-12


def test_bias():
    assert value(Bias(bias=0.25), u=1.0)["y"] == 1.25
    assert value(GainError(error=0.25), u=2.0)["y"] == 2.5


def test_noise_is_added_and_is_that_of_a_random_source():
    block = SensorNoise(std=0.5, seed=4, interval=0.01)
    assert value(block, u=2.0, w=-3.0)["y"] == 0.5
    ours, theirs = block.tapes(0.0, 1.0)["w"], Random(seed=4, interval=0.01).tapes(0.0, 1.0)["w"]
    assert ours.t.tolist() == theirs.t.tolist()
    assert ours.y.tolist() == theirs.y.tolist()


def test_refuses_bad_values():
    refuses("Encoder.counts must lie in (0, inf), got 0. It is: counts per revolution [1/rev].", Encoder, counts=0)
    refuses("SensorNoise.std must lie in [0, inf), got -0.1. It is: standard deviation.", SensorNoise, std=-0.1)
    refuses("Bias has no parameter 'value'. Known here: bias.", Bias, value=1.0)
