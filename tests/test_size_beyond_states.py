"""What the size of a memory gains beyond the states that it may begin from."""

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st

import tsmblocks as tsm
from tsmblocks.blocks import PID, DahlFriction, Gain, Integrator, Sum
from tsmblocks.diagnosis import screening
from tsmblocks.diagnosis.size_beyond_states import size_beyond_states
from tsmblocks.fitting.column_space import SQUARED_EFFECT_TOLERANCE, column_space
from tsmblocks.fitting.jacobian import Jacobian

OWNER = np.repeat([0, 1], [1200, 800])
T = np.r_[np.arange(1200.0), np.arange(800.0)] / 100
FADES = np.exp(-T / 2.0)[:, None]
FOLLOWS = (np.sin(2 * np.pi * 0.3 * T) + 0.2 * T)[:, None]
CONSTANT = np.ones((2000, 1))


def found(r, noise=None, draws=99):
    base = column_space(Jacobian.of(CONSTANT), SQUARED_EFFECT_TOLERANCE)
    noise = np.random.default_rng(7).standard_normal((2000, draws)) if noise is None else noise
    return size_beyond_states(FOLLOWS, FADES, OWNER, base, r, base.project_out(noise))


def plain(r):
    """The same by least squares."""

    def rest(*columns):
        A = np.column_stack([CONSTANT, FADES * (OWNER[:, None] == [0, 1]), *columns])
        return float(np.sum((r - A @ np.linalg.lstsq(A, r, rcond=None)[0]) ** 2))

    return rest() - rest(FOLLOWS)


@given(st.integers(0, 10_000), st.floats(-2, 2), st.floats(-5, 5))
def test_the_gain_is_that_of_least_squares(seed, size, start):
    r = np.random.default_rng(seed).standard_normal(2000) + size * FOLLOWS[:, 0] + start * FADES[:, 0]
    assert found(r, draws=2).gain == pytest.approx(plain(r), rel=1e-3, abs=0.02)


def test_gains_in_noise_are_those_of_one_size():
    every = found(np.zeros(2000), draws=4000).noise_gains
    assert np.mean(every) == pytest.approx(1.0, abs=0.1)  # chi-squared with one degree of freedom
    assert np.quantile(every, 0.95) == pytest.approx(3.84, rel=0.1)


def test_what_fades_from_the_start_of_each_experiment_tells_nothing_of_the_size():
    noise = np.random.default_rng(3).standard_normal(2000)
    apart = np.where(OWNER == 0, 30.0, -20.0) * FADES[:, 0]
    assert found(noise + apart).gain == pytest.approx(found(noise).gain, abs=1e-3)
    assert found(apart).is_noise


def test_what_follows_the_motion_does():
    noise = np.random.default_rng(3).standard_normal(2000)
    assert not found(noise + 0.5 * FOLLOWS[:, 0]).is_noise


def test_the_state_of_a_friction_is_moved_by_its_own_range_and_not_by_that_of_the_force(monkeypatch):
    """Dahl's state is a number below one, on a wire that carries thousands of rad/s^2: friction stays an effect."""
    blocks = {"error": Sum(signs="+-"), "pid": PID(kp=20.0, ki=2000.0, kd=0.03, tau=0.0004), "net": Sum(signs="+--")}
    blocks |= {"torque": Gain(gain=40_000.0, unit="rad/s^2"), "speed": Integrator(), "angle": Integrator()}
    blocks |= {"damping": Gain(gain=30.0, unit="rad/s^2"), "spring": Gain(gain=8900.0, unit="rad/s^2")}
    around = ["error -> pid -> torque -> net.plus", "speed -> angle -> error.minus"]
    around += ["speed -> damping -> net.minus1", "angle -> spring -> net.minus2"]
    common = dict(inputs={"ref": tsm.Inlet(("error.plus",), "rad", "")}, outputs={"angle": "angle", "current": "pid"})
    model = tsm.Diagram(title="mirror", blocks=blocks, wires=[*around, "net -> speed"], **common)
    rubs = {"rub": DahlFriction(sigma0=70_000.0, coulomb=480.0), "left": Sum(signs="+-")}
    rubbing = [*around, "net -> left.plus", "speed -> rub -> left.minus", "left -> speed"]
    plant = tsm.Diagram(title="plant", blocks={**blocks, **rubs}, wires=rubbing, **common)
    t, noise, records = np.arange(0.0, 0.25, 0.00025), np.random.default_rng(2), {}
    for name, f in {"slow": 11.0, "fast": 37.0}.items():
        ref = 0.03 * np.sin(2 * np.pi * f * t) + 0.015 * np.sin(2 * np.pi * 2.7 * f * t)
        run = tsm.simulate(plant, inputs={"ref": (t, ref)}, stop=t[-1], step=t[1], hold="cubic")
        signals = {"ref": ref, "angle": run["angle"] + noise.normal(0.0, 5e-5, t.size)}
        signals["current"] = run["current"] + noise.normal(0.0, 0.004, t.size)
        records[name] = tsm.Record(name, t, signals, {"ref": "rad", "angle": "rad", "current": ""})
    moved, own = [], screening._Screening._half_range
    monkeypatch.setattr(screening._Screening, "_half_range", lambda *args: moved.append(own(*args)) or moved[-1])
    found = tsm.diagnose(model, records, effects=["presliding_friction"], hold="cubic")
    assert 0 < moved[0] <= 1
    assert [one.name for one in found.effects] == ["presliding_friction"]
    assert found.effects[0].sizes["friction"].value == pytest.approx(480.0, rel=0.05)
