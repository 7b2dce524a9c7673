"""A worn servo and a ball on a beam, recorded by others: what is named, and what is left on the second half."""

import numpy as np
import pytest

import tsmblocks as tsm


def left_behind(diagram, records, split):
    """Rms of each output after ``split`` [s], simulated from initial states alone."""
    second = {name: r.part(r.t[0] + split, None) for name, r in records.items()}
    return tsm.fit(diagram, second, free=[], start_states=True).differences.rms


@pytest.fixture
def others(measured):
    folder = measured / "others"
    if not folder.is_dir():
        pytest.skip("needs the recordings others/ beside the measured data")
    return folder


def test_the_command_of_the_servo_is_late(others):
    """Fitted to the first half; an autoregressive model of order 10 leaves 0.246 deg on the second."""
    records = {name: tsm.read(others / f"{name}.csv") for name in ("servo_1", "servo_2")}
    first = {name: r.part(r.t[0], r.t[0] + 20.2) for name, r in records.items()}
    few = ["dead_time", "first_order_lag", "position_ripple", "nonlocal_memory", "backlash", "rate_limit"]
    found = tsm.diagnose(tsm.load(others / "servo.toml"), first, effects=few)
    assert found.effects[0].name == "dead_time"
    assert found.effects[0].wire == "x_in -> loop.u"
    assert left_behind(found.augmented, records, 20.2) < np.deg2rad(0.25)


def test_the_ball_tips_the_beam(others):
    """The force grows with the position; an impulse response of 60 samples leaves 0.050 m on the second half."""
    record = tsm.read(others / "ballbeam.csv")
    few = ["stiffness", "viscous_friction", "load_offset", "coulomb_friction", "nonlocal_memory"]
    found = tsm.diagnose(tsm.load(others / "ballbeam.toml"), record, effects=few)
    assert found.effects[0].name == "stiffness"
    assert found.effects[0].parameters["force.gain"].high < 0
    assert left_behind(found.augmented, {"ball": record}, 50.0) < 0.025
