"""What delays a held input passes its jumps on: at whole steps as they are, else as the mean over the step."""

from itertools import pairwise

import numpy as np
import pytest

import tsmblocks as tsm
from tsmblocks.blocks import DeadTime, Delay, Derivative, FirstOrderLag, Gain, Step, Sum, ZeroOrderHold
from tsmblocks.common.errors import DiagramError

H, LAG = 0.1, 0.7
T = np.arange(0.0, 20.0 + H / 2, H)
U = np.where(T < 0.5, 0.0, np.repeat(np.random.default_rng(1).normal(size=60), 4)[: len(T)])


def late(block, **more):
    """A lag behind a delay of the input."""
    return tsm.Diagram(
        title="late",
        blocks={"late": block, "lag": FirstOrderLag(time_constant=LAG), **more},
        wires=["late -> lag"],
        inputs={"u": "late"},
        outputs={"y": "lag", "z": "late"},
    )


def exact(delay, t=T, u=U, lag=LAG):
    """The lag behind a delayed staircase that is zero before the start, from jump to jump in closed form."""
    jumps, value, y = t + delay, 0.0, [0.0]
    for begin, end in pairwise(t):
        inside = jumps[(jumps > begin + 1e-9) & (jumps < end - 1e-9)]
        for a, b in zip([begin, *inside], [*inside, end], strict=True):
            k = np.searchsorted(t, (a + b) / 2 - delay, side="right") - 1
            level = u[k] if k >= 0 else 0.0
            value = level + (value - level) * np.exp(-(b - a) / lag)
        y.append(value)
    return np.array(y)


@pytest.mark.parametrize("backend", ["llvm", "casadi"])
@pytest.mark.parametrize(
    ("method", "whole", "parts"), [("rk4", 1e-5, 3e-3), ("heun", 3e-3, 5e-3), ("sdirk4", 1e-6, 3e-3)]
)
@pytest.mark.parametrize("block", [DeadTime, Delay])
def test_a_lag_behind_a_delayed_staircase_against_its_closed_form(block, method, whole, parts, backend):
    for delay in [0.0, 0.04, 0.1, 0.25, 0.3, 1.0, 1.03]:
        if block is Delay and delay < H:
            continue
        d = late(block(time=delay))
        run = tsm.simulate(d, inputs={"u": (T, U)}, hold="zero", step=H, method=method, backend=backend, stop=T[-1])
        rms = np.sqrt(np.mean((run["y"] - exact(delay)) ** 2))
        assert rms < (whole if round(delay / H, 9).is_integer() else parts), delay


@pytest.mark.parametrize("block", [DeadTime(time=3 * H), Delay(time=3 * H)])
def test_a_delay_of_whole_steps_keeps_jumps_as_they_are(block):
    run = tsm.simulate(late(block), inputs={"u": (T, U)}, hold="zero", step=H, stop=T[-1])
    np.testing.assert_allclose(run["z"][3:], U[:-3], atol=1e-14)


@pytest.mark.parametrize("block", [DeadTime(time=2.25 * H), Delay(time=2.25 * H)])
def test_any_other_delay_gives_the_mean_over_each_step(block):
    run = tsm.simulate(late(block), inputs={"u": (T, U)}, hold="zero", step=H, stop=T[-1])
    np.testing.assert_allclose(run["z"][3:], 0.75 * U[1:-2] + 0.25 * U[:-3], atol=1e-12)


def test_before_the_start_there_is_the_first_value_or_the_initial_one():
    u = U + 2.0
    for block, before in [
        (DeadTime(time=4.5 * H), 2.0),
        (DeadTime(time=4.5 * H, start="value", initial=-1.0), -1.0),
        (DeadTime(time=0.5 * H, start="value", initial=-1.0), -1.0),
        (Delay(time=4.5 * H, initial=-1.0), -1.0),
    ]:
        run = tsm.simulate(late(block), inputs={"u": (T, u)}, hold="zero", step=H, stop=T[-1])
        n = int(block.time / H)
        np.testing.assert_allclose(run["z"][:n], before, atol=1e-12)
        assert run["z"][n] == pytest.approx((before + 2.0) / 2)
        np.testing.assert_allclose(run["z"][n + 1 :], (u[1 : len(u) - n] + u[: -n - 1]) / 2, atol=1e-12)


def test_what_is_made_of_held_inputs_alone_is_delayed_so_too_and_what_moves_is_not():
    held = tsm.Diagram(
        blocks={"double": Gain(gain=2.0), "both": Sum(), "one": DeadTime(time=2 * H), "two": DeadTime(time=H)},
        wires=["double -> both.plus", "both -> one -> two"],
        inputs={"u": "double", "v": "both.minus"},
        outputs={"z": "two"},
    )
    v = np.where(T < 3.0, 0.0, 1.0)
    how = dict(step=H, stop=T[-1])
    run = tsm.simulate(held, inputs={"u": (T, U), "v": (T, v)}, hold="zero", **how)
    np.testing.assert_allclose(run["z"][3:], (2 * U - v)[:-3], atol=1e-14)
    run = tsm.simulate(held, inputs={"u": (T, U), "v": (T, np.sin(T))}, hold={"u": "zero", "v": "cubic"}, **how)
    np.testing.assert_allclose(run["z"][3:], (2 * U - np.sin(T))[:-3], atol=1e-12)  # a curve, known at the steps


def test_a_step_inside_the_diagram_comes_out_of_a_dead_time_as_a_step():
    d = tsm.Diagram(
        blocks={"s": Step(time=1.0, after=1.0), "late": DeadTime(time=5 * H), "lag": FirstOrderLag(time_constant=LAG)},
        wires=["s -> late -> lag"],
        outputs={"y": "lag"},
    )
    run = tsm.simulate(d, step=H, stop=5.0)
    after = np.maximum(run.t - 1.5, 0.0)
    np.testing.assert_allclose(run["y"], 1 - np.exp(-after / LAG), atol=1e-5)


@pytest.mark.parametrize("block", [DeadTime(time=0.33), Delay(time=0.33)])
def test_an_input_that_changes_between_steps_is_averaged_over_them(block):
    """What comes out is as exact as the step is short, and neither early nor late on average."""
    t = np.sort(np.random.default_rng(2).uniform(0.0, 20.0, 60))
    u = np.random.default_rng(0).normal(size=len(t))
    t[0] = u[0] = 0.0
    d, how = late(block), dict(inputs={"u": (t, u)}, hold="zero", stop=19.0)
    coarse, fine = (tsm.simulate(d, step=step, **how) for step in (0.1, 1e-3))
    for name, most in (("y", 0.012), ("z", 0.5)):
        error = coarse[name] - fine[name][::100]
        assert np.sqrt(np.mean(error**2)) < most
        assert abs(np.mean(error)) < 0.02 * np.std(fine[name])
    half = tsm.simulate(d, step=0.05, **how)["y"][::2] - fine["y"][::100]
    assert np.sqrt(np.mean(half**2)) < 0.4 * np.sqrt(np.mean((coarse["y"] - fine["y"][::100]) ** 2))


def test_steps_of_a_stepper_and_of_a_batch_and_derivatives_are_those_of_the_run():
    d = late(DeadTime(time=0.27))
    how = dict(inputs={"u": (T, U)}, hold="zero", step=H, stop=T[-1])
    run = tsm.simulate(d, **how)
    stepper = tsm.Stepper(d, step=H)
    made = [stepper.step({"u": u})["y"] for u in U[:-1]]
    np.testing.assert_allclose(made, [*run["y"][1:]], atol=1e-12)
    batch = tsm.simulate_batch(d, {"late.time": [0.27, 0.31]}, **how)
    np.testing.assert_allclose(batch["y"][0], run["y"], atol=1e-12)
    found = tsm.sensitivities(d, ["late.time"], **how)
    beside = [tsm.simulate(d, parameters={"late.time": 0.27 + e}, **how)["y"] for e in (-1e-5, 1e-5)]
    np.testing.assert_allclose(
        found.jacobian[:, found.signals.index("y"), 0], (beside[1] - beside[0]) / 2e-5, atol=1e-7
    )


def recording(name, t, u, delay, lag, noise=0.01, seed=0):
    y = exact(delay, t, u, lag) + noise * np.random.default_rng(seed).standard_normal(len(t))
    return tsm.Record(name, t, {"u": u, "y": y}, {"u": "", "y": ""})


@pytest.mark.parametrize("block", [DeadTime(time=1.0), Delay(time=1.5)])
@pytest.mark.parametrize("delay", [1.0, 1.7, 2.35])
def test_the_dead_time_of_a_step_test_is_found_without_a_shift(block, delay):
    """A curve through the steps began each jump half a step early, and the delay was half a step too long."""
    t = np.arange(0.0, 200.0, 1.0)
    u = np.where(t < 5, 0.0, np.sign(np.sin(2 * np.pi * t / 43)))
    model = tsm.Diagram(
        blocks={"late": block, "lag": FirstOrderLag(time_constant=4.0)},
        wires=["late -> lag"],
        inputs={"u": "late"},
        outputs={"y": "lag"},
    )
    given = recording("steps", t, u, delay, 6.0)
    found = tsm.fit(model, given, free=["late.time", "lag.time_constant"], step=1.0, bounds={"late.time": (1.0, 10.0)})
    assert found["late.time"].value == pytest.approx(delay, abs=0.05)
    assert found["lag.time_constant"].value == pytest.approx(6.0, abs=0.1)


def test_recordings_with_and_without_a_held_input_are_fitted_together():
    t = np.arange(0.0, 100.0, 0.5)
    steps = np.where(t < 5, 0.0, np.sign(np.sin(2 * np.pi * t / 43)))
    smooth = np.sin(0.3 * t)
    model = late(DeadTime(time=2.0))
    fine = np.arange(0.0, 100.0, 0.01)
    truth = model.with_parameters({"late.time": 1.3, "lag.time_constant": 5.0})
    y = tsm.simulate(truth, inputs={"u": (fine, np.sin(0.3 * fine))}, step=0.01, stop=99.5)["y"][::50]
    given = {
        "held": recording("held", t, steps, 1.3, 5.0, noise=1e-3),
        "smooth": tsm.Record("smooth", t, {"u": smooth, "y": y}, {"u": "", "y": ""}),
    }
    found = tsm.fit(model, given, free=["late.time", "lag.time_constant"], step=0.5, outputs=["y"])
    assert found["late.time"].value == pytest.approx(1.3, abs=0.01)
    assert found["lag.time_constant"].value == pytest.approx(5.0, abs=0.02)


def test_the_derivative_of_delayed_samples_is_refused_and_that_of_a_delayed_input_is_that_of_its_curve():
    d = tsm.Diagram(
        blocks={"late": Delay(time=2 * H), "rate": Derivative()},
        wires=["late -> rate"],
        inputs={"u": "late"},
        outputs={"y": "rate"},
    )
    run = tsm.simulate(d, inputs={"u": (T, U)}, hold="zero", step=H, stop=T[-1])
    assert np.abs(run["y"]).max() > 1.0
    sampled = d.insert("z", ZeroOrderHold(period=2 * H), before="late.u")
    with pytest.raises(DiagramError, match=r"is the derivative of late\.y, which depends on z\.y, a sampled"):
        tsm.simulate(sampled, inputs={"u": (T, U)}, hold="zero", step=H, stop=T[-1])
