"""A fit says where the noise of a measured input moves a parameter out of its interval."""

from types import SimpleNamespace

import numpy as np
import pytest

import tsmblocks as tsm
from tsmblocks.blocks import FirstOrderLag, Play
from tsmblocks.cli.recordings import with_condition_option

T = np.arange(0, 30, 0.01)
X = 10 * np.sin(2 * np.pi * 0.2 * T) + 5 * np.sin(2 * np.pi * 0.53 * T)


def diagram(block):
    return tsm.Diagram(
        blocks={"block": block}, inputs={"motor": tsm.Inlet(["block"], unit="deg")}, outputs={"tip": "block"}
    )


def recorded(block, noise, x=X):
    random = np.random.default_rng(1)
    y = tsm.simulate(diagram(block), inputs={"motor": (T, x)}, step=0.01)["tip"]
    signals = {"motor": x + noise * random.standard_normal(len(T)), "tip": y + 0.03 * random.standard_normal(len(T))}
    return tsm.Record("run", T, signals, {"motor": "deg", "tip": "deg"})


def noted(block, data):
    return [text for text in tsm.fit(diagram(block), data, starts=1).notes if "noise" in text]


def test_noise_that_moves_the_width_of_a_play_out_of_its_interval_is_reported():
    """The interval of half_width left out the true 1.5, and nothing was said."""
    block = Play(half_width=1.5, gain=0.8)
    data = recorded(block, 0.03)
    (said,) = noted(block, data)
    assert said.startswith("motor has noise that moves block.half_width by ")
    assert said.endswith("of its interval, which does not cover it. Filter it first: conditioned(['motor']).")
    assert with_condition_option(said, SimpleNamespace(conditioned=False)).endswith("Filter it first: --condition.")
    conditioned = data.conditioned(["motor"])
    assert noted(block, conditioned) == []
    fits = [tsm.fit(diagram(block), one, starts=1)["block.half_width"].value for one in (data, conditioned)]
    assert abs(fits[1] - 1.5) < 0.4 * abs(fits[0] - 1.5)


@pytest.mark.parametrize(
    ("block", "noise", "x"),
    [
        (Play(half_width=1.5, gain=0.8), 0.0, X),
        (Play(half_width=1.5, gain=0.8), 0.0, 10 * np.arcsin(np.sin(1.2 * T))),
        (FirstOrderLag(gain=0.8, time_constant=0.3), 0.03, X),
    ],
    ids=["no noise", "corners without noise", "a lag averages it"],
)
def test_what_moves_no_parameter_needs_no_word(block, noise, x):
    assert noted(block, recorded(block, noise, x)) == []


def test_the_fast_part_of_a_command_is_no_noise_of_it():
    """It drives the outputs: filtering takes something from them. A controller makes it of the noise of a sensor."""
    block = Play(half_width=1.5, gain=0.8)
    command = X + 0.05 * np.random.default_rng(1).standard_normal(len(T))
    exact = recorded(block, 0.0, command)
    assert noted(block, exact) == []
