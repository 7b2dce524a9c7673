"""A base is calibrated to its best optimum: memories begin where recordings do, and the step follows the parameters."""

from types import SimpleNamespace

import attrs
import numpy as np
import pytest

import tsmblocks as tsm
from tsmblocks.blocks import FirstOrderLag, Gain, Play
from tsmblocks.diagnosis.base_search import better_base
from tsmblocks.diagnosis.initial_states import refine_memories
from tsmblocks.diagnosis.model import ModelSettings, calibrate, model_at, pose_model, with_accurate_step
from tsmblocks.fitting.gauss_newton import gauss_newton
from tsmblocks.fitting.memories import memory_edges, placed
from tsmblocks.fitting.optimizer import OptimizerResult
from tsmblocks.fitting.setup import pose

PLAY = tsm.load("tendon_sheath_play")
NOISE = 0.004


def recordings(seed):
    """Three recordings of a play that begin away from zero, anywhere in the slack."""
    rng, made, t = np.random.default_rng(seed), {}, np.arange(0, 12, 0.02)
    for k in range(3):
        waves = [rng.uniform(0.1, 0.5) * np.sin(2 * np.pi * f * t + rng.uniform(0, 6)) for f in (0.2, 0.53, 0.9)]
        x = sum(waves) + rng.uniform(-0.8, 0.8)
        began = x[0] + 0.12 * rng.choice([-1, 1]) * rng.uniform(0, 1)
        true = {"play.half_width": 0.12, "play.gain": 0.9, "play.m": began, "offset.bias": 0.05}
        run = tsm.simulate(PLAY.with_parameters(true), inputs={"x_in": (t, x)}, step=0.02, stop=t[-1])
        y = run["x_out"] + rng.normal(0, NOISE, t.size)
        made[f"r{k}"] = tsm.Record(f"r{k}", t, {"x_in": x, "x_out": y}, {"x_in": "rad", "x_out": "rad"})
    return made


SETTINGS = ModelSettings(free=None, sigma={"x_out": NOISE}, outputs=("x_out",))


@pytest.mark.parametrize("seed", [3, 17, 18])
@pytest.mark.parametrize("starts", [1, 4])
def test_a_fit_finds_plays_that_begin_away_from_zero(seed, starts):
    model = PLAY.with_parameters({"play.half_width": 0.3})
    fit = tsm.fit(model, recordings(seed), start_states=True, starts=starts)
    assert 0.95 < fit.differences.rms / NOISE < 1.05
    assert fit["play.half_width"].value == pytest.approx(0.12, abs=0.003)


@pytest.mark.parametrize("seed", [3, 17])
def test_a_diagnosis_calibrates_plays_that_begin_away_from_zero(seed):
    model = calibrate(PLAY.with_parameters({"play.half_width": 0.3}), recordings(seed), SETTINGS)
    assert 0.95 < refine_memories(model).residual_rms["x_out"] < 1.05


def posed(diagram, record, **options):
    return pose(diagram, record, start_states=True, **options)[0]


def test_edges_of_a_play_are_a_half_width_to_each_side_of_its_input():
    (record, *_) = recordings(0).values()
    problem = posed(PLAY.with_parameters({"play.half_width": 0.25}), record)
    ((low, high),) = memory_edges(problem, problem.unknowns.start, 0).values()
    assert (low, high) == pytest.approx((record["x_in"][0] - 0.25, record["x_in"][0] + 0.25))


def test_a_play_behind_another_begins_around_the_middle_of_the_first():
    diagram = tsm.Diagram(
        blocks={"a": Play(half_width=0.1), "g": Gain(gain=2.0), "b": Play(half_width=0.3)},
        wires=["a -> g -> b"],
        inputs={"u": "a"},
        outputs={"y": "b"},
    )
    t = np.arange(0, 5, 0.01)
    problem = posed(diagram, tsm.Record("r", t, {"u": 5 + np.sin(t), "y": 10 + np.sin(t)}, {}))
    names, edges = problem.unknowns.names, memory_edges(problem, problem.unknowns.start, 0)
    found = {names[k].partition("@")[0]: v for k, v in edges.items()}
    assert found["a.m"] == pytest.approx((4.9, 5.1))
    assert found["b.m"] == pytest.approx((9.7, 10.3))


def test_states_that_are_not_forgotten_in_a_step_stay_as_they_are():
    t = np.arange(0, 5, 0.01)
    lag = tsm.Diagram(blocks={"s": FirstOrderLag()}, inputs={"u": "s"}, outputs={"y": "s"})
    problem = posed(lag, tsm.Record("r", t, {"u": np.sin(t) + 3, "y": np.sin(t) + 3}, {}))
    assert np.array_equal(placed(problem, problem.unknowns.start), problem.unknowns.start)


def slow_record(time_constant):
    rng, t = np.random.default_rng(0), np.arange(0, 4000, 10.0)
    u = np.sin(2 * np.pi * t / 700) + 0.4 * np.sin(2 * np.pi * t / 161)
    y = u
    if time_constant:
        run = tsm.simulate(lagging(time_constant), inputs={"u": (t, u)}, step=0.25, stop=t[-1])
        y = np.interp(t, run.t, run["y"])
    return tsm.Record("r", t, {"u": u, "y": y + rng.normal(0, 0.002, t.size)}, {})


def lagging(time_constant):
    return tsm.Diagram(blocks={"s": FirstOrderLag(time_constant=time_constant)}, inputs={"u": "s"}, outputs={"y": "s"})


def test_the_step_follows_a_lag_that_is_faster_than_the_first_step_allows():
    fit = tsm.fit(lagging(60.0), slow_record(1.5), starts=1)
    assert fit.step < 10.0
    assert fit["s.time_constant"].value == pytest.approx(1.5, abs=0.2)
    model = calibrate(lagging(60.0), {"r": slow_record(1.5)}, ModelSettings(None, {"y": 0.002}, ("y",), False))
    assert model.values["s.time_constant"] == pytest.approx(1.5, abs=0.2)


def test_starts_that_ended_at_one_optimum_count_though_the_step_is_halved_for_the_best():
    fit = tsm.fit(lagging(60.0), slow_record(1.5), starts=4)
    assert fit.step < 10.0
    assert fit.agreeing == len(fit.searches) == 4
    costs = [one.cost for one in fit.searches]
    assert costs == sorted(costs)
    assert not any("starts ended at this optimum: more" in text for text in str(fit).splitlines())


@pytest.mark.parametrize("step", [None, 10.0])
def test_a_lag_at_the_limit_of_the_step_is_said(step):
    fit = tsm.fit(lagging(60.0), slow_record(0.0), starts=1, step=step)
    assert fit.step == 10.0
    (said,) = (text for text in fit.notes if text.startswith("s.value"))
    finer, advice = (
        ("", "Give a smaller step, or fix them")
        if step
        else (", and so it does at finer steps", "Fix them, or give bounds; the model may lack an effect")
    )
    assert said == (
        f"s.value changes as fast as a step of 10 s can simulate{finer}: the parameters that set how fast follow from "
        f"the step and not from the data. {advice}."
    )


def test_an_effect_is_compared_with_the_base_at_the_parameters_found_beside_it():
    problem, setup = pose_model(PLAY, recordings(0), SETTINGS, None)
    poor = model_at(problem, setup, OptimizerResult(problem.unknowns.start, 0.0, "stalled", 0, 0))
    best = calibrate(PLAY, recordings(0), SETTINGS)
    named = SimpleNamespace(model=SimpleNamespace(values={**best.values, "effect.size": 3.0}))
    better = better_base(poor, named, 1.0)
    assert better.mean_square == pytest.approx(best.mean_square, rel=1e-3)
    assert better_base(better, named, 1.0) is None


STICKING = """
format = 1
title = "Slide"
wires = ["push.y -> speed -> place", "speed -> rub -> push.minus"]
[blocks]
push = { type = "Sum", signs = "+-" }
speed = { type = "Integrator" }
place = { type = "Integrator" }
rub = { type = "CoulombFriction", level = 0.8, smoothing = 3e-4 }
[inputs]
u = { ports = "push.plus", unit = "m/s^2" }
[outputs]
x = { signal = "place", unit = "m" }
"""


@pytest.fixture(scope="module")
def sliding():
    """A slide with dry friction that was simulated at a step of 0.1 ms, and recorded each 5 ms."""
    diagram, t = tsm.loads(STICKING), np.arange(0.0, 4.0, 0.005)
    u = 2.0 * np.sin(2 * np.pi * 0.7 * t) + 0.9 * np.sin(2 * np.pi * 1.9 * t)
    run = tsm.simulate(diagram, inputs={"u": (t, u)}, step=1e-4, stop=t[-1])
    x = run["x"][::50] + np.random.default_rng(0).normal(0.0, 2e-5, t.size)
    return diagram, {"r": tsm.Record("r", t, {"u": u, "x": x}, {"u": "m/s^2", "x": "m"})}


@pytest.mark.parametrize("given", [None, 0.005])
def test_the_step_is_halved_where_it_changes_the_residuals_materially(sliding, given):
    diagram, records = sliding
    settings = ModelSettings(free=("rub.level",), sigma={"x": 2e-5}, outputs=("x",), step=given)
    problem, setup = pose_model(diagram, records, attrs.evolve(settings, step=0.005), settings.free)
    rough = model_at(problem, setup, gauss_newton(problem, problem.unknowns.start))
    better = with_accurate_step(rough, settings)
    if given is not None:
        assert better is rough
        return
    assert better.setup.steps["r"] <= 0.005 / 4
    assert abs(better.values["rub.level"] - 0.8) < abs(rough.values["rub.level"] - 0.8) / 2
    assert better.mean_square < 0.5 * rough.mean_square
    assert with_accurate_step(better, settings).setup.steps == better.setup.steps


def test_a_step_at_which_halving_changes_next_to_nothing_stays():
    model = calibrate(PLAY, recordings(3), SETTINGS)
    assert with_accurate_step(model, SETTINGS) is model
