"""Recordings of different sampling rates: each is simulated at its own step, with candidates as with the base."""

import numpy as np
import pytest

import tsmblocks as tsm
from tsmblocks.diagnosis.model import ModelSettings, calibrate, pose_extended
from tsmblocks.fitting.recordings import recordings

STEPS = {"slow": 0.02, "medium": 0.01, "fast": 0.005}
MODEL = tsm.load("tendon_sheath_linear")


def measured(disturbance=None, steps=STEPS):
    """A recording at each step: a gain, noise of 0.01, and an added disturbance of the time."""
    made = {}
    for seed, (name, step) in enumerate(steps.items()):
        draw, t = np.random.default_rng(seed), step * np.arange(int(20.0 / step))
        x = np.sin(1.1 * t + seed) + 0.4 * np.sin(4.3 * t)
        y = 0.9 * x + draw.normal(0.0, 0.01, len(t)) + (0.0 if disturbance is None else disturbance(t + 3.7 * seed))
        made[name] = tsm.Record(name, t, {"x_in": x, "x_out": y}, {"x_in": "rad", "x_out": "rad"})
    return made


@pytest.mark.parametrize("order", [("slow", "medium", "fast"), ("fast", "slow", "medium")])
def test_candidates_keep_the_step_of_each_recording(order):
    records, settings = (
        recordings(measured(steps={k: STEPS[k] for k in order})),
        ModelSettings(None, {"x_out": 0.01}, ("x_out",)),
    )
    model = calibrate(MODEL, records, settings)
    diagram = model.fitted_diagram.insert("gap", tsm.blocks.Play(), before="x_out")
    _, setup = pose_extended(model, diagram, ["gap.half_width"], records, settings)
    own = {one.name: one.times.h for one in model.setup.experiments}
    assert {one.name: one.times.h for one in setup.experiments} == own
    assert len(set(own.values())) == len(own)
    assert all((STEPS[k] / h) == pytest.approx(round(STEPS[k] / h)) for k, h in own.items())


@pytest.mark.parametrize(
    ("frequency", "steps"),
    [
        pytest.param(50.03, STEPS, id="above half the slower rates"),
        pytest.param(49.6, {"one": 0.01, "two": 0.01}, id="near half the only rate"),
    ],
)
def test_mains_hum_is_named_with_its_frequency(frequency, steps):
    records = measured(lambda t: 0.008 * np.sin(2 * np.pi * frequency * t), steps)
    found = tsm.diagnose(MODEL, records, effects=["periodic_disturbance", "jump", "drift"])
    (one,) = found.effects
    assert one.name == "periodic_disturbance"
    assert one.parameters["frequency"].value == pytest.approx(frequency, abs=0.01)


def test_noise_at_several_rates_is_no_disturbance():
    found = tsm.diagnose(MODEL, measured(), effects=["periodic_disturbance", "jump", "drift"])
    assert found.verdict == "none"


@pytest.mark.parametrize("order", [("slow", "fast"), ("fast", "slow")])
def test_runs_of_a_fit_have_the_step_of_their_recording(order):
    fit = tsm.fit(MODEL, measured(steps={k: STEPS[k] for k in order}), starts=1)
    steps = {name: float(run.t[1] - run.t[0]) for name, run in fit.runs.items()}
    assert steps == pytest.approx({name: fit.diagram.simulation.step_of(name) for name in order})
    assert steps["fast"] < steps["slow"]
    assert fit.step == pytest.approx(steps["fast"])
