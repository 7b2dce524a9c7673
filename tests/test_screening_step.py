"""The step of screening: longer than that of the model, where that makes many steps."""

import numpy as np
import pytest

import tsmblocks as tsm
from tests.test_diagnosis_parts import fitted, recordings
from tsmblocks.diagnosis import screening_step
from tsmblocks.diagnosis.model import optimized
from tsmblocks.diagnosis.screening_step import MAX_ERROR, screening_model
from tsmblocks.fitting.step_size import halved


@pytest.fixture(scope="module")
def fine():
    """A model at an eighth of the step of its recordings."""
    model = fitted(records=recordings())
    problem, setup = model.problem, model.setup
    for _ in range(3):
        problem, setup = halved(problem, setup) or (problem, setup)
    return optimized(problem, setup, model.theta)


def steps(model):
    return [one.times.h for one in model.setup.experiments]


def test_a_model_of_few_steps_is_screened_at_its_own(fine):
    assert screening_model(fine) is fine


def test_one_of_many_steps_is_screened_at_longer_ones(fine, monkeypatch):
    monkeypatch.setattr(screening_step, "MAX_STEPS", 100)
    found = screening_model(fine)
    assert steps(found) == pytest.approx([one.record.step for one in fine.setup.experiments])
    assert found.theta is fine.theta
    assert found.r == pytest.approx(found.problem.residuals(fine.theta))
    error, measured = found.r - fine.r, np.concatenate([e.measured[:, 0] for e in fine.problem.experiments])
    assert np.mean(error**2) <= MAX_ERROR * np.var(measured * fine.problem.weights[0])


def test_no_longer_than_the_error_allows(fine, monkeypatch):
    monkeypatch.setattr(screening_step, "MAX_STEPS", 100)
    monkeypatch.setattr(screening_step, "MAX_ERROR", -1.0)
    assert steps(screening_model(fine)) == steps(fine)


def test_candidates_gain_as_much_in_longer_steps(monkeypatch):
    """The same diagnosis with a longest run that makes its screening coarse, and with one that does not."""
    plant = tsm.load("tendon_sheath_linear").insert("gap", tsm.blocks.Play(half_width=0.05), after="offset")
    records, noise = {}, np.random.default_rng(1)
    for name, record in recordings().items():
        run = tsm.simulate(plant, inputs={"x_in": (record.t, record["x_in"])}, stop=record.t[-1], step=record.step)
        signal = run["x_out"] + noise.normal(0.0, 0.004, len(record.t))
        records[name] = record.with_signal("x_out", signal, "rad")
    model = tsm.load("tendon_sheath_linear")
    how = dict(effects=["backlash", "dead_time"], step=records[name].step / 4, noise_floor=0.004)
    whole = tsm.diagnose(model, records, **how)
    monkeypatch.setattr(screening_step, "MAX_STEPS", 100)
    quick = tsm.diagnose(model, records, **how)
    gains = [{(c.name, c.wire, c.round): c.share for c in one.worst.ranking} for one in (whole, quick)]
    assert gains[0].keys() == gains[1].keys()
    widths = [one.effects[0].sizes["gap width"].value for one in (whole, quick)]
    assert whole.effects[0].name == "backlash"
    assert widths[1] == pytest.approx(widths[0], rel=1e-3)
