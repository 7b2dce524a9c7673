"""Fits as they are asked for: what is free, bounds, constraints, priors, starts, Ctrl-C, results and their files."""

import json
import os
import signal
import threading

import attrs
import numpy as np
import pytest

import tsmblocks as tsm
from tests.test_fit_methods import LAG, LINEAR, METHODS, REGRESSORS, noisy, sheath
from tests.test_fit_problem import STEP, TWO, T, U, record, servo
from tsmblocks.blocks import (
    PID,
    Delay,
    Drift,
    Encoder,
    FirstOrderLag,
    Gain,
    Integrator,
    Quantiser,
    Saturation,
    Step,
    Sum,
    ZeroOrderHold,
)
from tsmblocks.cli import console
from tsmblocks.common.errors import NotFinite, RunError
from tsmblocks.fitting.residuals import Problem
from tsmblocks.fitting.text import _legible

RAD = {"x_in": "rad", "x_out": "rad"}


def straight(name="a", gain=0.8, bias=0.3, sigma=0.05, seed=3):
    return record(name, units=RAD, x_in=U, x_out=noisy(gain * U + bias, sigma, seed))


def least_squares(y, regressors=REGRESSORS):
    return np.linalg.lstsq(regressors, y, rcond=None)[0]


def numbers(fit):
    return np.array(list(fit.values.values()))


# ---- what is free


def test_by_default_all_but_start_values_are_free():
    found = tsm.fit(tsm.load("motor_linear"), record(u=U, x=U), starts=1)
    assert found.names == ("motor.K", "motor.tau")
    more = tsm.fit(tsm.load("motor_linear"), record(u=U, x=U), starts=1, start_states=True)
    assert more.names == ("motor.K", "motor.tau", "motor.angle@a", "motor.speed@a")
    assert [e.is_start for e in more] == [False, False, True, True]


@pytest.mark.parametrize(
    ("free", "names"),
    [
        ("gain.gain", ["gain.gain"]),
        (["*.bias"], ["offset.bias"]),
        (["offset.bias", "gain.*"], ["gain.gain", "offset.bias"]),
        (["gain.gain", "gain.gain", "g*"], ["gain.gain"]),
        (("*",), ["gain.gain", "offset.bias"]),
    ],
)
def test_free_takes_names_and_patterns(free, names):
    assert list(tsm.fit(LINEAR, straight(), free=free, starts=1).names) == names


def test_limits_that_never_act_are_not_free():
    diagram = tsm.Diagram(title="i", blocks=dict(i=Integrator()), inputs={"u": "i"}, outputs={"y": "i"})
    assert tsm.fit(diagram, record(u=U, y=U), starts=1).names == ("i.gain",)


def test_the_result_is_least_squares_with_its_textbook_interval():
    data = straight()
    found = tsm.fit(LINEAR, data)
    expected = least_squares(data["x_out"])
    left = data["x_out"] - REGRESSORS @ expected
    sigma = np.sqrt(left @ left / (len(T) - 2))
    errors = sigma * np.sqrt(np.diag(np.linalg.inv(REGRESSORS.T @ REGRESSORS)))
    np.testing.assert_allclose(numbers(found), expected, rtol=1e-6)
    np.testing.assert_allclose([e.error for e in found], errors, rtol=0.02)  # its noise may come out a little coloured
    assert found.rms == pytest.approx(np.sqrt(np.mean(left**2)), rel=1e-9)
    assert (found.status, found.agreeing, len(found.searches)) == ("converged", 4, 4)
    assert (found["gain"].unit, found["offset.bias"].start, found["bias"].verdict) == ("", 0.0, "")


def test_local_numbers_are_found_for_each_experiment():
    data = [straight("one", bias=0.3, seed=1), straight("two", bias=-0.2, seed=2)]
    found = tsm.fit(LINEAR, data, local=["offset.bias"])
    zero = np.zeros(len(T))
    both = np.column_stack([np.tile(U, 2), np.append(zero + 1, zero), np.append(zero, zero + 1)])
    expected = least_squares(np.concatenate([r["x_out"] for r in data]), both)
    assert found.names == ("gain.gain", "offset.bias@one", "offset.bias@two")
    np.testing.assert_allclose(numbers(found), expected, rtol=1e-6)
    assert found.diagram.parameters["offset.bias"] == pytest.approx(expected[1])
    assert found.diagrams["two"].parameters["offset.bias"] == pytest.approx(expected[2])
    assert found.differences["two"].rms == pytest.approx(tsm.score(found.diagrams["two"], data[1]).rms, rel=1e-9)


def test_start_values_of_states_are_found():
    truth = dict(zip(("lag.gain", "lag.time_constant", "lag.value"), (1.4, 0.4, 0.9), strict=True))
    run = tsm.simulate(LAG, step=STEP, inputs={"u": tsm.Samples(T, U)}, parameters=truth)
    found = tsm.fit(LAG, record(u=U, y=run["y"]), start_states=True, step=STEP)
    assert found.values == pytest.approx({"lag.gain": 1.4, "lag.time_constant": 0.4, "lag.value@a": 0.9}, rel=1e-6)


def test_ties_are_followed_into_the_result():
    data = straight()
    found = tsm.fit(LINEAR, data, ties={"bias": "gain / 2"})
    expected = least_squares(data["x_out"], (U + 0.5)[:, None])[0]
    assert found.values == pytest.approx({"gain.gain": expected}, rel=1e-6)
    assert found.diagram.parameters == pytest.approx({"gain.gain": expected, "offset.bias": expected / 2}, rel=1e-6)


def test_a_number_used_twice_is_one_unknown():
    found = tsm.fit(servo(), TWO, free=["theta"], starts=1)
    assert found.names == ("theta",)
    assert found.diagram.values["theta"] == found.values["theta"]
    assert found.diagram.blocks["tsm"].theta == "$theta"


# ---- bounds and constraints


def test_bounds_take_patterns_and_none():
    data = straight()
    found = tsm.fit(LINEAR, data, bounds={"*": (0, None), "offset.*": (None, 0.25)})
    assert found.values["offset.bias"] == pytest.approx(0.25, abs=1e-9)
    assert found["bias"].verdict == "at its upper bound"
    assert found.values["gain.gain"] == pytest.approx(least_squares(data["x_out"] - 0.25, U[:, None])[0], rel=1e-7)


def test_a_bound_may_be_held_from_the_start():
    found = tsm.fit(LINEAR, straight(bias=-0.3), bounds={"offset.bias": (0.0, 1.0)}, starts=1)
    assert found.values["offset.bias"] == pytest.approx(0.0, abs=1e-9)
    assert found.active == ("the lower bound of offset.bias (0)",)


def test_a_small_parameter_within_its_bounds_is_at_none():
    """A leak of 1e-11 is as far from zero as a gain of one."""
    t = np.linspace(0.0, 10.0, 400)
    x, noise = np.sin(t), np.random.default_rng(1).normal(0.0, 1e-13, len(t))
    leak = tsm.Diagram(blocks={"leak": Gain(gain=2e-11)}, inputs={"x": "leak.u"}, outputs={"y": "leak"})
    measured = tsm.Record("run", t, {"x": x, "y": 1e-11 * x + noise}, {"x": "", "y": ""})
    found = tsm.fit(leak, measured, bounds={"leak.gain": (0.0, 1e-10)}, starts=1)
    assert found.active == ()
    assert found["gain"].low < 1e-11 < found["gain"].high


def test_a_bound_that_a_block_excludes_is_not_reached():
    """The best time constant of an output ahead of its input is below zero."""
    ahead = np.interp(T + 0.05, T, U)
    found = tsm.fit(LAG, record(u=U, y=ahead), free=["lag.time_constant"], start={"lag.time_constant": 0.2}, step=STEP)
    assert 0 < found.values["lag.time_constant"] < 0.01
    tsm.simulate(found.diagram, step=1e-3, stop=1e-2, inputs={"u": 0.0})  # the block takes it


def test_bounds_that_block_and_user_give_go_together():
    found = tsm.fit(
        LAG, record(u=U, y=0.7 * U), bounds={"lag.time_constant": (-5.0, 0.04)}, start={"lag.time_constant": 0.03}
    )
    assert 0 < found.values["lag.time_constant"] <= 0.04


def test_constraints_met_without_them_change_nothing():
    free = tsm.fit(LINEAR, straight(), starts=1)
    limited = tsm.fit(LINEAR, straight(), constraints="0 < gain < 3", starts=1)
    np.testing.assert_allclose(numbers(limited), numbers(free), rtol=1e-9)
    assert limited.active == ()


def test_a_constraint_that_holds_is_named():
    found = tsm.fit(LINEAR, straight(), constraints={"sum": "gain + bias < 1"})
    assert sum(found.values.values()) == pytest.approx(1.0, abs=1e-9)
    assert found.active == ("the constraint sum",)
    assert found.correlation[0, 1] == pytest.approx(-1.0, abs=1e-6)


def test_an_equality_that_leaves_nothing_open_is_said():
    found = tsm.fit(LINEAR, straight(), constraints=["gain == 1", "bias == 0.2"])
    assert found.values == pytest.approx({"gain.gain": 1.0, "offset.bias": 0.2})
    assert [e.verdict for e in found] == ["held by a constraint"] * 2


# ---- priors and weights


@pytest.mark.parametrize(("mean", "deviation"), [(0.9, 0.5), (0.9, 0.01), (1.5, 0.05)])
@pytest.mark.parametrize("sigma", [None, 0.05])
def test_priors_give_the_posterior_of_bayes(mean, deviation, sigma):
    data = straight()
    y = data["x_out"]
    found = tsm.fit(LINEAR, data, priors={"gain.gain": (mean, deviation)}, sigma=sigma)
    alone = y - REGRESSORS @ least_squares(y)
    noise = sigma or np.sqrt(alone @ alone / (len(T) - 2))
    precision = REGRESSORS.T @ REGRESSORS / noise**2 + np.diag([1 / deviation**2, 0])
    expected = np.linalg.solve(precision, REGRESSORS.T @ y / noise**2 + [mean / deviation**2, 0])
    np.testing.assert_allclose(numbers(found), expected, rtol=1e-6)
    if mean == 0.9:  # elsewhere the residual is no longer white, and the interval says so
        np.testing.assert_allclose(found.covariance, np.linalg.inv(precision), rtol=0.15, atol=1e-7)


def test_a_prior_settles_what_the_data_leave_open():
    silent = tsm.Diagram(
        title="two gains",
        blocks=dict(a=Gain(gain=1.2), b=Gain()),
        wires=["a -> b"],
        inputs={"u": "a"},
        outputs={"y": "b"},
    )
    data = record(u=U, y=noisy(1.5 * U, 0.01))
    alone = tsm.fit(silent, data)
    known = tsm.fit(silent, data, priors={"a.gain": (2.0, 0.1)})
    assert [set(u.names) for u in alone.undetermined] == [{"a.gain", "b.gain"}]
    assert known.undetermined == ()
    assert known.values == pytest.approx({"a.gain": 2.0, "b.gain": 0.75}, rel=1e-3)
    assert known["a.gain"].error == pytest.approx(0.1, rel=0.01)


def test_a_prior_may_be_for_one_experiment():
    data = [straight("one", seed=1), straight("two", seed=2)]
    found = tsm.fit(LINEAR, data, local=["offset.bias"], priors={"offset.bias@two": (0.0, 1e-5)}, sigma=0.05)
    assert abs(found.values["offset.bias@two"]) < 1e-3 < found.values["offset.bias@one"]


def test_sigma_has_a_unit_of_its_own():
    data = straight(sigma=0.0)
    turned = data.converted({"x_out": "deg"})
    prior = {"gain.gain": (0.5, 0.01)}
    plain = tsm.fit(LINEAR, data, priors=prior, sigma=np.radians(2.0))
    for given in ("2deg", {"x_out": "2 deg"}, f"{np.radians(2.0)} rad"):
        for one in (data, turned):
            np.testing.assert_allclose(numbers(tsm.fit(LINEAR, one, priors=prior, sigma=given)), numbers(plain))


def test_sigma_says_what_outputs_count():
    diagram = tsm.Diagram(
        title="twice",
        blocks=dict(k=Gain(), more=Gain(gain=10.0)),
        wires=["k -> more"],
        inputs={"u": "k"},
        outputs={"y": "k", "z": "more"},
    )
    data = record(u=U, y=1.0 * U, z=13.0 * U)
    for sigma in ({"y": 0.1, "z": 5.0}, {"y": 0.3, "z": 0.1}):
        found = tsm.fit(diagram, data, free=["k.gain"], sigma=sigma)
        w = np.array([1 / sigma["y"] ** 2, 100 / sigma["z"] ** 2])
        assert found.values["k.gain"] == pytest.approx(w @ [1.0, 1.3] / w.sum(), rel=1e-6)


# ---- windows


def test_each_experiment_has_its_window():
    one, two = straight("one", gain=0.8, sigma=0.0), straight("two", gain=0.6, sigma=0.0)
    found = tsm.fit(LINEAR, [one, two], window={"one": (0.5, 1.0), "two": (2.0, None)}, sigma=0.1)
    here = np.concatenate([(T >= 0.5) & (T <= 1.0), T >= 2.0])
    y, rows = np.concatenate([one["x_out"], two["x_out"]])[here], np.tile(REGRESSORS, (2, 1))[here]
    np.testing.assert_allclose(numbers(found), least_squares(y, rows), rtol=1e-6)
    assert [len(d.t) for d in found.differences] == [51, 101]


def test_a_simulation_runs_from_the_start_of_its_recording_whatever_counts():
    truth = {"play.half_width": 0.15, "play.gain": 0.9, "offset.bias": 0.1}
    play = tsm.load("tendon_sheath_play")
    run = tsm.simulate(play, step=STEP, inputs={"x_in": tsm.Samples(T, U)}, parameters=truth)
    found = tsm.fit(play, record(units=RAD, x_in=U, x_out=run["x_out"]), window=(1.0, 3.0), step=STEP)
    assert found.values == pytest.approx(truth, rel=1e-6)


# ---- starts and seeds


@pytest.mark.parametrize("method", METHODS)
def test_same_seed_same_bytes(method):
    diagram, truth, _ = sheath()
    run = tsm.simulate(diagram, step=STEP, inputs={"x_in": tsm.Samples(T, U)}, parameters=truth)
    data = record(units=RAD, x_in=U, x_out=noisy(run["x_out"], 0.02))
    options = dict(method=method, starts=3, iterations=8, step=STEP)
    first, again, other = (tsm.fit(diagram, data, seed=seed, **options) for seed in (5, 5, 6))
    assert json.dumps(first.to_dict()) == json.dumps(again.to_dict())
    assert json.dumps(first.to_dict()) != json.dumps(other.to_dict())


def test_more_starts_find_what_one_does_not():
    """An oscillation of unknown frequency: from far off there is no way down."""
    t = 0.01 * np.arange(600)
    swing = tsm.Diagram(title="swing", blocks=dict(s=tsm.blocks.Sine(amplitude=1.0, frequency=0.6)), outputs={"y": "s"})
    data = record(t=t, y=np.sin(2 * np.pi * 2.1 * t))
    options = dict(free=["s.frequency"], bounds={"s.frequency": (0.3, 4.0)})
    assert tsm.fit(swing, data, starts=1, **options).rms > 0.5
    found = tsm.fit(swing, data, starts=8, **options)
    assert found.values["s.frequency"] == pytest.approx(2.1, rel=1e-6)
    assert 1 <= found.agreeing < 8
    assert len(found.searches) == 8


@pytest.mark.parametrize("method", METHODS)
def test_a_limit_of_iterations_is_a_status(method):
    diagram, *_ = sheath()
    found = tsm.fit(diagram, record(units=RAD, x_in=U, x_out=0.7 * U), method=method, iterations=1, starts=1)
    assert found.status == "limit"
    assert "stopped at the limit of iterations; it may not have converged" in str(found)
    assert found.rms <= tsm.score(diagram, record(units=RAD, x_in=U, x_out=0.7 * U), step=found.step).rms


def test_a_perfect_fit_has_converged():
    for method in ("gauss-newton", "ipopt"):
        found = tsm.fit(LINEAR, straight(sigma=0.0), method=method)
        assert found.status == "converged", method
        assert found.rms < 1e-12
        assert found.agreeing == 4


# ---- progress and Ctrl-C


@pytest.mark.parametrize(
    ("method", "stages"), [("gauss-newton", {"gauss-newton"}), ("ipopt", {"ipopt"}), ("ga", {"genetic", "nelder-mead"})]
)
def test_progress_is_told(method, stages):
    told = []
    found = tsm.fit(LINEAR, straight(), method=method, starts=1, progress=lambda *now: told.append(now))
    assert {stage for stage, _, _ in told} == stages
    counts = [count for stage, count, _ in told if stage == told[-1][0]]
    assert counts == sorted(counts)
    assert told[-1][2] == pytest.approx(found.rms, rel=1e-3)


SHEATH = sheath()[0]


def hard():
    rng = np.random.default_rng(0)
    return record(units=RAD, x_in=U, x_out=0.7 * U + 0.1 * np.sign(np.gradient(U)) + 0.01 * rng.standard_normal(len(U)))


@pytest.mark.parametrize(
    "options",
    [dict(method="gauss-newton"), dict(method="ipopt"), dict(method="ga"), dict(method="ipopt", segments=4)],
    ids=["gauss-newton", "ipopt", "ga", "pieces"],
)
@pytest.mark.parametrize("after", [1, 3])
def test_stopping_in_progress_keeps_the_best(options, after):
    calls, told = 0, []

    def progress(stage, count, rms):
        nonlocal calls
        calls += 1
        told.append(rms)
        if calls == after:
            raise KeyboardInterrupt

    begun = tsm.score(SHEATH, hard(), step=STEP).rms
    found = tsm.fit(SHEATH, hard(), progress=progress, step=STEP, **options)
    assert found.status == "interrupted"
    assert calls == after
    assert "interrupted; these are the best parameters so far" in str(found)
    assert found.rms <= begun * (1 + 1e-9)
    if options.get("segments") is None:
        assert found.rms <= min(told) * (1 + 1e-9)


@pytest.mark.parametrize("method", METHODS)
@pytest.mark.parametrize("after", [1, 2, 5, 40])
def test_stopping_in_a_simulation_keeps_the_best(method, after, monkeypatch):
    calls = 0

    def broken(name):
        whole = getattr(Problem, name)

        def now(self, *args):
            nonlocal calls
            calls += 1
            if calls == after:
                raise KeyboardInterrupt
            return whole(self, *args)

        return now

    # where a search begins and what a result is made of are not the search
    for name in ("normal",) if method != "ga" else ("costs",):
        monkeypatch.setattr(Problem, name, broken(name))
    begun = tsm.score(SHEATH, hard(), step=STEP).rms
    found = tsm.fit(SHEATH, hard(), method=method, step=STEP, starts=1 if method == "ga" else 9)
    assert found.status == "interrupted"
    assert found.rms <= begun * (1 + 1e-9)
    assert found.searches[0].cost == pytest.approx(min(s.cost for s in found.searches))


def test_ctrl_c_itself_is_kept_until_a_search_can_stop():
    before, calls = signal.getsignal(signal.SIGINT), 0

    def press(*_):
        nonlocal calls
        calls += 1
        if calls == 2:
            os.kill(os.getpid(), signal.SIGINT)

    found = tsm.fit(SHEATH, hard(), starts=9, step=STEP, progress=press)
    assert found.status == "interrupted"
    assert calls <= 3
    assert signal.getsignal(signal.SIGINT) is before


def test_ctrl_c_twice_ends_at_once():
    def press(*_):
        os.kill(os.getpid(), signal.SIGINT)
        os.kill(os.getpid(), signal.SIGINT)
        raise AssertionError

    found = tsm.fit(SHEATH, hard(), starts=2, step=STEP, progress=press)
    assert found.status == "interrupted"  # the second one arrives in the search, which gives what it has


def test_a_fit_in_a_thread_leaves_signals_alone():
    ends = []
    thread = threading.Thread(target=lambda: ends.append(tsm.fit(LINEAR, straight()).status))
    thread.start()
    thread.join()
    assert ends == ["converged"]


# ---- what goes wrong in simulations


def feedback():
    return tsm.Diagram(
        title="loop",
        blocks=dict(error=Sum(signs="+-"), k=Gain(gain=2.0), i=Integrator()),
        wires=["error -> k -> i -> error.minus"],
        inputs={"r": "error.plus"},
        outputs={"y": "i"},
    )


def loop_data():
    return record("bench 3", r=U, y=tsm.simulate(feedback(), step=STEP, inputs={"r": tsm.Samples(T, U)})["y"])


def test_a_start_that_runs_away_names_experiment_and_block():
    with pytest.raises(NotFinite) as caught:
        tsm.fit(feedback(), loop_data(), start={"k.gain": -5000.0}, starts=1)
    assert caught.value.block == "i"
    assert str(caught.value).startswith("experiment 'bench 3' cannot be simulated: i.integral = ")
    assert caught.value.run is not None


def test_other_starts_survive_one_that_runs_away():
    found = tsm.fit(
        feedback(),
        loop_data(),
        start={"k.gain": -5000.0},
        bounds={"k.gain": (-5000.0, 250.0)},
        starts=3,
        free=["k.gain"],
        step=STEP,
    )
    assert found.values["k.gain"] == pytest.approx(2.0, rel=1e-3)


@pytest.mark.parametrize("method", METHODS)
def test_places_that_run_away_are_stepped_back_from(method):
    found = tsm.fit(
        feedback(),
        loop_data(),
        free=["k.gain"],
        start={"k.gain": 0.1},
        bounds={"k.gain": (-1e4, 1e4)},
        method=method,
        starts=1,
    )
    assert found.values["k.gain"] == pytest.approx(2.0, rel=1e-2)


def pushed(time=1.0):
    """A lag behind a step, and what it gives for a step at 2.345 s with noise of 0.01, each 0.01 s."""
    lag = tsm.Diagram(
        blocks={"push": Step(time=time), "lag": FirstOrderLag()}, wires=["push -> lag"], outputs={"y": "lag"}
    )
    t = np.arange(0.0, 10.0, 0.01)
    y = np.where(t > 2.345, 1 - np.exp(-np.maximum(t - 2.345, 0.0) / 0.7), 0.0)
    return lag, record(t=t, units={"y": ""}, y=y + 0.01 * np.random.default_rng(0).standard_normal(len(t)))


@pytest.mark.parametrize("time", [0.0, 1.0, 8.0])
@pytest.mark.parametrize("method", METHODS)
def test_the_instant_of_a_step_is_found_though_the_outputs_have_no_slope_by_it(method, time):
    found = tsm.fit(*pushed(time), free=["lag.time_constant", "push.time"], method=method)
    assert found["push.time"].low < 2.345 < found["push.time"].high
    assert 0.0014 < found["push.time"].error < 0.004  # half a step of 0.01 s is not seen at all, by RK4
    assert found["lag.time_constant"].low < 0.7 < found["lag.time_constant"].high
    assert found.agreeing == len(found.searches)


def test_values_between_two_jumps_are_as_good_as_each_other():
    """The instant of a step without noise: the interval covers the stages of a step between which it may lie."""
    lag, _ = pushed()
    truth = tsm.simulate(lag, stop=10.0, step=0.01)
    found = tsm.fit(lag, record(t=truth.t, units={"y": ""}, y=truth["y"]), free=["push.time"], start={"push.time": 3.0})
    assert found["push.time"].low < 1.0 < found["push.time"].high < 1.01
    assert not found.undetermined


@pytest.mark.parametrize("begin", [0.0105, 0.0125, 0.02])
def test_the_interval_of_a_quantiser_is_found(begin):
    rough = tsm.Diagram(blocks={"q": Quantiser()}, inputs={"u": "q"}, outputs={"y": "q"})
    y = np.round(U / 0.01) * 0.01 + 2e-4 * np.random.default_rng(1).standard_normal(len(T))
    found = tsm.fit(rough, record(u=U, y=y, units={"u": "", "y": ""}), start={"q.interval": begin})
    assert found["q.interval"].value == pytest.approx(0.01, rel=1e-4)


def test_a_limit_is_found_that_begins_where_nothing_reaches_it():
    limited = tsm.Diagram(blocks={"clip": Saturation(low=-9.0, high=9.0)}, inputs={"u": "clip"}, outputs={"y": "clip"})
    y = np.clip(U, -0.5, 9.0) + 1e-3 * np.random.default_rng(1).standard_normal(len(T))
    found = tsm.fit(limited, record(u=U, y=y, units={"u": "", "y": ""}))
    assert found["clip.low"].low < -0.5 < found["clip.low"].high < -0.499
    assert found["clip.high"].verdict == "no influence"
    assert found["clip.high"].value == 9.0


def test_ctrl_c_while_values_are_tried_keeps_what_was_found():
    def stop(stage, *_):
        if stage == "jumps":
            raise KeyboardInterrupt

    found = tsm.fit(*pushed(), free=["lag.time_constant", "push.time"], progress=stop, starts=1)
    assert found.status == "interrupted"


def test_a_delay_behind_samples_is_found_to_the_step():
    wired = tsm.Diagram(
        blocks={"hold": ZeroOrderHold(period=0.1), "late": Delay(time=0.02), "lag": FirstOrderLag()},
        wires=["hold -> late -> lag"],
        inputs={"u": "hold"},
        outputs={"y": "lag"},
    )
    truth = wired.with_parameters({"late.time": 0.054})
    y = tsm.simulate(truth, inputs={"u": (T, np.sin(3 * T))}, stop=T[-1], step=1e-3)["y"][
        :: round((T[1] - T[0]) / 1e-3)
    ]
    given = tsm.Record("a", T, {"u": np.sin(3 * T), "y": y}, {"u": "", "y": ""})
    found = tsm.fit(wired, given, free=["late.time"], bounds={"late.time": (0.002, 0.2)}, step=1e-3)
    assert found["late.time"].value == pytest.approx(0.054, abs=1.1e-3)
    assert not found.undetermined


LATE = tsm.Diagram(
    blocks={"late": Delay(time=0.1), "lag": FirstOrderLag()},
    wires=["late -> lag"],
    inputs={"u": "late"},
    outputs={"y": "lag"},
)


def late_by(time, step=1e-3):
    """What ``LATE`` with a delay of ``time`` gives for a sine, sampled as ``T``."""
    every = round((T[1] - T[0]) / step)
    truth = LATE.with_parameters({"late.time": time})
    y = tsm.simulate(truth, inputs={"u": (T, np.sin(3 * T))}, stop=T[-1], step=step)["y"][::every]
    return tsm.Record("a", T[: len(y)], {"u": np.sin(3 * T[: len(y)]), "y": y}, {"u": "", "y": ""})


@pytest.mark.parametrize("method", METHODS)
def test_a_delay_is_found_without_bounds(method):
    """Starts are spread over places that are shorter than a step, too; those cannot be run."""
    found = tsm.fit(LATE, late_by(0.054), free=["late.time"], method=method)
    assert found["late.time"].value == pytest.approx(0.054, rel=1e-3)


def test_a_delay_shorter_than_the_step_ends_at_the_step():
    found = tsm.fit(LATE, late_by(0.004), free=["late.time"], step=0.01)
    assert found["late.time"].value == pytest.approx(0.01)
    assert found["late.time"].verdict == "at its lower bound"


def test_a_delay_that_follows_another_number_is_found():
    found = tsm.fit(
        LATE,
        late_by(0.025),
        free=["lag.time_constant"],
        start={"lag.time_constant": 0.3},
        step=0.01,
        ties={"late.time": "lag.time_constant / 2"},
    )
    assert found["lag.time_constant"].value == pytest.approx(0.05, rel=1e-3)


def test_a_delay_that_starts_shorter_than_the_step_is_refused():
    with pytest.raises(RunError, match=r"delay of late\.past is 0\.005 s, shorter than the step of 0\.01 s"):
        tsm.fit(LATE, late_by(0.054), free=["late.time"], start={"late.time": 0.005}, step=0.01)


def test_a_controller_sampled_ten_times_between_two_samples_is_fitted():
    """The step is a tenth of what lies between samples, which halving never reaches."""
    loop = tsm.load("sampled_position_loop")
    run = tsm.simulate(loop, stop=4.0, step=1e-3)
    noise = np.random.default_rng(0).normal(0.0, 1e-4, len(run.t[::10]))
    y = run["x_out"][::10] + noise
    found = tsm.fit(
        loop,
        record(t=run.t[::10], units={"x_out": "rad"}, x_out=y),
        free=["controller.kp"],
        start={"controller.kp": 40.0},
        starts=1,
    )
    assert found.step in (0.001, 0.0005, 0.00025)
    assert found["controller.kp"].value == pytest.approx(loop.parameters["controller.kp"], rel=1e-2)


def test_what_has_a_slope_is_found_by_it_beside_a_delay_behind_samples():
    """Differences lead to the delay; they must not leave the time constant where they saw no more."""
    wired = tsm.Diagram(
        blocks={"hold": ZeroOrderHold(period=0.1), "late": Delay(time=0.02), "lag": FirstOrderLag()},
        wires=["hold -> late -> lag"],
        inputs={"u": "hold"},
        outputs={"y": "lag"},
    )
    t = 0.01 * np.arange(1001)
    true = {"late.time": 0.31, "lag.time_constant": 0.3}
    y = tsm.simulate(wired, parameters=true, inputs={"u": (t, np.sin(3 * t))}, step=0.01, stop=10.0)["y"]
    y += 0.002 * np.random.default_rng(0).standard_normal(len(t))
    given = tsm.Record("a", t, {"u": np.sin(3 * t), "y": y}, {"u": "", "y": ""})
    both = tsm.fit(wired, given, free=list(true), bounds={"late.time": (0.01, 0.6)}, step=0.01)
    there = wired.with_parameters({"late.time": both.values["late.time"]})
    alone, found = tsm.fit(there, given, free=["lag.time_constant"], step=0.01), both["lag.time_constant"]
    assert found.value == pytest.approx(alone.values["lag.time_constant"], abs=0.1 * found.error)


@pytest.mark.parametrize("free", [["a.time"], ["a.time", "b.time"]])
def test_an_instant_is_found_from_zero_too(free):
    """There differences over a share of the number itself would be over nothing."""
    steps = tsm.Diagram(
        blocks={"a": Step(time=0.0), "b": Step(time=4.0), "d": Sum(), "lag": FirstOrderLag()},
        wires=["a -> d.plus", "b -> d.minus", "d -> lag"],
        outputs={"y": "lag"},
    ).with_parameters({"lag.time_constant": 0.7})
    run = tsm.simulate(steps, parameters={"a.time": 1.0}, stop=10.0, step=0.01)
    y = run["y"] + 0.01 * np.random.default_rng(0).standard_normal(len(run.t))
    found = tsm.fit(steps, tsm.Record("a", run.t, {"y": y}, {"y": ""}), free=free, starts=1)
    assert found.values["a.time"] == pytest.approx(1.0, abs=0.01)
    assert not found.undetermined


def test_what_is_known_is_free_where_it_is_named_only():
    read = tsm.Diagram(
        blocks={"gain": Gain(), "encoder": Encoder(), "drift": Drift()},
        wires=["gain -> encoder -> drift"],
        inputs={"u": "gain"},
        outputs={"y": "drift"},
    )
    data = record(u=U, y=1.2 * U + 0.01 * T, units={"u": "rad", "y": "rad"})
    assert tsm.fit(read, data).names == ("gain.gain", "drift.rate", "drift.curve")
    assert tsm.fit(read, data, free=["*"]).names == ("gain.gain", "drift.rate", "drift.curve")
    named = tsm.fit(read, data, free=["gain.*", "encoder.counts"], starts=1)
    assert "encoder.counts" in named.names
    assert [text.partition(".")[0] for text in named.notes if "usually known" in text] == ["encoder"]


def test_a_term_of_a_controller_that_is_switched_off_stays_off():
    """A derivative gain that was never written took up a missing dead time, with its filter."""
    loop = tsm.Diagram(
        blocks={"e": Sum(signs="+-"), "pi": PID(kp=2.0, ki=3.0), "lag": FirstOrderLag(time_constant=0.5)},
        wires=["e -> pi -> lag -> e.minus"],
        inputs={"r": "e.plus"},
        outputs={"y": "lag"},
    )
    run = tsm.simulate(loop, inputs={"r": (T, U)}, stop=T[-1], step=T[1] - T[0])
    data = record(r=U, y=noisy(run["y"], 0.001))
    kept = ["pi.kp", "pi.ki", "lag.gain", "lag.time_constant"]
    assert list(tsm.fit(loop, data, starts=1).names) == kept
    assert list(tsm.fit(loop, data, free=["*"], starts=1).names) == kept
    named = tsm.fit(loop, data, free=["pi.kd", "lag.time_constant"], starts=1)
    assert "pi.kd" in named.names
    assert not any("usually known" in text for text in named.notes)
    derivative = loop.with_parameters({"pi.kd": 0.1})
    assert {"pi.kd", "pi.tau"} <= set(tsm.fit(derivative, data, starts=1).names)


# ---- what data cannot tell


def test_a_parameter_that_nothing_excites_is_named():
    still = record(units=RAD, x_in=np.zeros(len(T)), x_out=noisy(np.full(len(T), 0.2), 0.01))
    found = tsm.fit(LINEAR, still)
    assert [(u.kind, u.names) for u in found.undetermined] == [("no influence", ("gain.gain",))]
    assert found["gain"].verdict == "no influence"
    assert np.isnan([found["gain"].error, found["gain"].low, found["gain"].high]).all()
    assert found["bias"].low < 0.2 < found["bias"].high
    assert "a: the input x_in never changes, so it excites nothing." in found.notes
    assert "gain.gain has no influence on the outputs in these experiments." in str(found)


def test_sources_that_run_by_the_clock_of_a_recording_are_told_of_one_that_does_not_begin_at_zero():
    lag = tsm.Diagram(
        blocks={"push": Step(time=0.0), "lag": FirstOrderLag()}, wires=["push -> lag"], outputs={"y": "lag"}
    )
    y = 1 - np.exp(-2 * T)
    at_zero, later = (tsm.Record("a", T + begin, {"y": y}, {"y": ""}) for begin in (0.0, 3.7))
    words = (
        "a: no measured signal drives the diagram. Its sources use the time of the recording, and it is at rest until "
        "the recording begins, at 3.7 s."
    )
    assert words in tsm.fit(lag, later, free=["lag.time_constant"]).notes
    assert not any(
        "Its sources use the time" in text for text in tsm.fit(lag, at_zero, free=["lag.time_constant"]).notes
    )


def test_a_constant_input_leaves_gain_and_offset_together():
    found = tsm.fit(LINEAR, record(units=RAD, x_in=np.ones(len(T)), x_out=noisy(np.ones(len(T)), 0.01)))
    assert [set(u.names) for u in found.undetermined] == [{"gain.gain", "offset.bias"}]
    assert {e.verdict for e in found} == {"not determined"}


def test_nothing_at_all_to_learn_from():
    zeros = np.zeros(len(T))
    found = tsm.fit(LINEAR, record(units=RAD, x_in=zeros, x_out=zeros))
    assert found["gain"].verdict == "no influence"
    assert found.values["offset.bias"] == 0.0
    json.dumps(console.json_value(found.to_dict()), allow_nan=False)


def test_a_diagram_that_explains_nothing_is_told():
    noise = np.random.default_rng(0).standard_normal(len(T))
    found = tsm.fit(
        LINEAR,
        record(units=RAD, x_in=U, x_out=noise),
        free=["gain.gain"],
        bounds={"gain.gain": (5, 9)},
        start={"gain.gain": 6.0},
    )
    assert found.notes == ("a: the diagram explains x_out no better than its mean does.",)


# ---- recordings


def test_data_come_as_records_lists_mappings_frames_and_files(tmp_path):
    pandas = pytest.importorskip("pandas")
    data = straight()
    np.savetxt(
        tmp_path / "rig.csv",
        np.column_stack([T, data["x_in"], data["x_out"]]),
        delimiter=",",
        comments="",
        header="t [s],x_in [rad],x_out [rad]",
        fmt="%.17g",
    )
    frame = pandas.DataFrame({"t [s]": T, "x_in [rad]": data["x_in"], "x_out [rad]": data["x_out"]})
    expected = numbers(tsm.fit(LINEAR, data))
    for given, names in (
        (frame, None),
        (tmp_path / "rig.csv", ["rig"]),
        (str(tmp_path / "rig.csv"), ["rig"]),
        ([data], ["a"]),
        ({"bend 60": data}, ["bend 60"]),
    ):
        found = tsm.fit(LINEAR, given)
        np.testing.assert_allclose(numbers(found), expected, rtol=1e-6)
        assert names is None or list(found.records) == names


def test_two_records_of_one_name_are_told_apart():
    found = tsm.fit(LINEAR, [straight("rig", seed=1), straight("rig", seed=2), straight("other")])
    assert list(found.records) == ["rig#1", "rig#2", "other"]


def test_units_are_those_of_the_ports():
    data = straight()
    mixed = tsm.Record("a", T, {"x_in": np.rad2deg(U), "x_out": 1e3 * data["x_out"]}, {"x_in": "deg", "x_out": "mrad"})
    one, other = tsm.fit(LINEAR, data), tsm.fit(LINEAR, mixed)
    np.testing.assert_allclose(numbers(other), numbers(one), rtol=1e-9)
    assert other.differences["a"].unit == "rad"
    assert one.notes == other.notes == ()


def test_a_signal_without_unit_is_taken_in_the_ports_and_that_is_noted():
    found = tsm.fit(LINEAR, tsm.Record("a", T, {"x_in": U, "x_out": U}, {"x_in": "rad"}))
    assert found.notes == ("a: x_out has no unit and is taken to be in rad.",)


def test_a_step_that_shows_in_the_numbers_is_told():
    """A lag that turns out far faster than where the search began, and so than the step that was chosen there."""
    fast = tsm.simulate(LAG, step=1e-4, inputs={"u": tsm.Samples(T, U)}, parameters={"lag.time_constant": 0.006})
    found = tsm.fit(LAG, record(u=U, y=fast["y"][:: round(STEP / 1e-4)]), starts=1)
    assert len(found.notes) == 1
    assert found.notes[0].startswith("halving the step of 0.01 s moves ")


# ---- the result


@pytest.fixture(scope="module")
def fitted():
    diagram, truth, _ = sheath()
    records = []
    for seed, scale in ((1, 1.0), (2, 0.7)):
        one = {**truth, "offset.bias": 0.05 + 0.02 * seed}
        run = tsm.simulate(diagram, step=STEP, inputs={"x_in": tsm.Samples(T, scale * U)}, parameters=one)
        y = noisy(run["x_out"], 0.01, seed)
        records.append(tsm.Record(f"bend {seed}", T, {"x_in": scale * U, "x_out": y}, RAD))
    return tsm.fit(diagram, records, local=["offset.bias"], starts=2)


def test_the_fitted_diagram_scores_as_the_fit_does(fitted, tmp_path):
    path = fitted.save(tmp_path / "fitted.toml")
    again = tsm.load(path)
    assert again == fitted.diagram
    first = tsm.score(again, fitted.records["bend 1"], step=fitted.step)
    assert first.rms == pytest.approx(fitted.differences["bend 1"].rms, rel=1e-9)
    assert tsm.score(again, fitted.records["bend 2"], step=fitted.step).rms > fitted.differences["bend 2"].rms


def test_runs_are_the_simulations_behind_the_differences(fitted):
    assert list(fitted.runs) == ["bend 1", "bend 2"]
    for name, run in fitted.runs.items():
        d = fitted.differences[name]
        np.testing.assert_allclose(np.interp(d.t, run.t, run["x_out"]), d.simulated, atol=1e-9)
        assert np.isfinite(run["tsm.y"]).all()  # all signals are kept


def test_differences_are_measured_less_simulated(fitted):
    d = fitted.differences["bend 1"]
    np.testing.assert_array_equal(d.measured, fitted.records["bend 1"]["x_out"])
    np.testing.assert_array_equal(d.residual, d.measured - d.simulated)
    assert d.rms == pytest.approx(np.sqrt(np.mean(d.residual**2)))
    assert d.largest == np.abs(d.residual).max()
    assert d.relative == pytest.approx(np.linalg.norm(d.residual) / np.linalg.norm(d.measured))
    share = np.linalg.norm(d.residual) / np.linalg.norm(d.measured - d.measured.mean())
    assert d.fit_percent == pytest.approx(100 * (1 - share))
    assert d.to("deg").rms == pytest.approx(np.rad2deg(d.rms))
    np.testing.assert_allclose(d.inputs["x_in"][0], fitted.records["bend 1"]["x_in"])
    both = np.concatenate([x.residual for x in fitted.differences])
    assert fitted.rms == pytest.approx(np.sqrt(np.mean(both**2)))


def test_covariance_and_correlation_go_together(fitted):
    errors = np.array([e.error for e in fitted])
    np.testing.assert_allclose(np.sqrt(np.diag(fitted.covariance)), errors, rtol=1e-12)
    np.testing.assert_allclose(fitted.correlation * np.outer(errors, errors), fitted.covariance, rtol=1e-9)
    assert fitted.covariance.shape == (len(fitted.names),) * 2


def test_the_truth_lies_in_the_intervals(fitted):
    _, truth, _ = sheath()
    expected = {**truth, "offset.bias@bend 1": 0.07, "offset.bias@bend 2": 0.09}
    inside = [e.low < expected[e.name] < e.high for e in fitted]
    assert len(inside) == 7
    assert sum(inside) >= 6  # one in 20 may lie outside


def test_an_offset_and_an_asymmetry_that_do_the_same_are_named():
    """With the start of zeta free too, delta / theta is an offset like any other."""
    diagram, truth, _ = sheath()
    run = tsm.simulate(diagram, step=STEP, inputs={"x_in": tsm.Samples(T, U)}, parameters=truth)
    data = record(units=RAD, x_in=U, x_out=noisy(run["x_out"], 0.01))
    found = tsm.fit(diagram, data, start_states=True, step=STEP, starts=1)
    together = next(set(u.names) for u in found.undetermined if u.kind == "combination")
    assert {"tsm.delta", "offset.bias", "tsm.zeta@a"} <= together
    assert {found[name].verdict for name in together} == {"not determined"}
    assert all(np.isnan([found[name].low, found[name].high]).all() for name in together)  # one of the two is said


def test_all_of_it_is_plain_json(fitted):
    told = fitted.to_dict()
    assert json.loads(json.dumps(console.json_value(told), allow_nan=False))["format"] == 1
    assert [e["name"] for e in told["estimates"]] == list(fitted.names)
    assert told["differences"]["items"][1]["experiment"] == "bend 2"
    assert told["starts"]["tried"] == 2
    assert told["starts"]["rms"][0] == pytest.approx(fitted.rms, rel=1e-9)
    held = tsm.fit(LINEAR, straight(), bounds={"gain.gain": (0.9, 1.0)})
    assert console.json_value(held.to_dict())["estimates"][0]["low"] is None


def test_it_reads_as_a_table_and_a_list_of_what_to_beware_of(fitted):
    text = str(fitted)
    assert text.startswith("Tendon sheath: the proposed asymmetric model and an offset\ngauss-newton: converged")
    assert all(name in text for name in (*fitted.names, "bend 1, x_out", "95 %", "deg"))
    assert "nan" not in text


def test_it_can_be_drawn(fitted):
    pytest.importorskip("matplotlib").use("Agg")
    figure = fitted.plot()
    assert len(figure.axes) >= 3


def test_estimates_are_had_by_name_or_its_end(fitted):
    assert fitted["theta"] is fitted["tsm.theta"]
    assert fitted["bias@bend 2"].name == "offset.bias@bend 2"
    assert [e.name for e in fitted] == list(fitted.names)
    assert set(fitted.values) == set(fitted.names)
    assert attrs.asdict(fitted["theta"]) == fitted["theta"].to_dict()


def test_a_gain_has_the_unit_of_its_output_over_that_of_its_input():
    spring = tsm.Diagram(
        title="spring",
        blocks={"spring": Gain(gain=0.5)},
        inputs={"x": tsm.Inlet(["spring.u"], unit="mm")},
        outputs={"F": "spring"},
        output_units={"F": "kN"},
    )
    data = tsm.Record("pull", T, {"x": U, "F": noisy(0.3 * U, 0.01)}, {"x": "mm", "F": "kN"})
    found = tsm.fit(spring, data, starts=1)
    assert found["spring.gain"].unit == "kN/mm"
    assert next(line for line in str(found).splitlines() if line.startswith("spring.gain")).endswith(" kN/mm")


def test_a_value_beside_a_wide_interval_keeps_its_size():
    assert _legible(2.6, "3") == "2.6"
    assert _legible(0.193, "0") == "0.193"
    assert _legible(-0.0241, "-0.024") == "-0.024"
    assert _legible(0.0, "0") == "0"
