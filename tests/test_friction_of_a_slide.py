"""Forms of friction of a mass that a measured force drives, on recordings made by Euler's method."""

from __future__ import annotations

import numpy as np
import pytest

import tsmblocks as tsm
from tests.slides import recorded, slide

FRICTION = ["coulomb_friction", "asymmetric_friction", "viscous_friction", "parameter_change", "offset", "load_offset"]


def diagnosed(resistance):
    (effect,) = tsm.diagnose(slide(), recorded(resistance=resistance), effects=FRICTION).effects
    return effect


def holds(text, size):
    """Whether the interval of a size as a force, ``1.104 ± 0.004 N``, holds a number, or nearly."""
    value, half = (float(part.split()[0]) for part in text.split(" ± "))
    return abs(value - size) < 2 * half


def test_dry_friction_with_a_level_for_each_direction_is_one_effect():
    """It was named Coulomb friction and an offset of the output."""
    effect = diagnosed(lambda t, v: 1.5 * np.tanh(v / 1e-3) - 0.45 * np.abs(np.tanh(v / 1e-3)))
    assert effect.name == "asymmetric_friction"
    assert holds(effect.as_force["friction forwards"], 1.05)
    assert holds(effect.as_force["friction backwards"], 1.95)


def test_dry_friction_that_is_alike_in_both_directions_is_coulomb_friction():
    effect = diagnosed(lambda t, v: 1.5 * np.tanh(v / 1e-3))
    assert effect.name == "coulomb_friction"
    assert holds(effect.as_force["friction"], 1.5)


def test_viscous_friction_that_changes_at_an_instant():
    """It was named a change of the gain, with a viscous friction of another sign."""
    effect = diagnosed(lambda t, v: 6.0 * v * (t > 4.3))
    assert (effect.name, effect.words) == ("parameter_change", "a sudden change of the viscous friction")
    time = effect.sizes["time"]
    assert time.value == pytest.approx(4.3, abs=max(2 * (time.high - time.low), 0.02))
