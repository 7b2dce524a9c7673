"""The machine code of candidates: as little of it as their few short runs pay for, with the same results."""

from __future__ import annotations

import attrs
import numpy as np
import pytest

import tsmblocks as tsm
from tsmblocks.diagnosis import model as models
from tsmblocks.diagnosis.model import ModelSettings, calibrate, pose_extended
from tsmblocks.fitting import runs

STEP, SAMPLES = 0.01, 400


@pytest.fixture(scope="module")
def base():
    """A calibrated base, its recordings and settings."""
    t = np.arange(SAMPLES) * STEP
    x = np.sin(1.3 * t) + 0.3 * np.sin(5.1 * t)
    y = 0.9 * x + np.random.default_rng(0).normal(0.0, 0.01, SAMPLES)
    records = {"run": tsm.Record("run", t, {"x_in": x, "x_out": y}, {"x_in": "rad", "x_out": "rad"})}
    settings = ModelSettings(None, {"x_out": 0.01}, ("x_out",))
    return calibrate(tsm.load("tendon_sheath_linear"), records, settings), records, settings


def extended(base):
    """The problem of the base with a play."""
    model, records, settings = base
    diagram = model.diagram.insert("gap", tsm.blocks.Play(half_width=0.05), before="x_out")
    return pose_extended(model, diagram, ["gap.half_width"], records, settings)[0]


def test_screening_and_choice_of_the_start_share_one_kernel(base, monkeypatch):
    problem, kernels = extended(base), []
    made = runs.batch_kernel
    monkeypatch.setattr(runs, "batch_kernel", lambda *a: kernels.append(made(*a)) or kernels[-1])
    sets = np.repeat(problem.unknowns.start[None], 30, axis=0)
    sets[:, problem.unknowns.names.index("gap.half_width")] = np.linspace(0.01, 0.3, 30)
    (y,) = problem.output_sets(sets)
    costs = problem.costs(sets[:2], quick=True)
    assert y.shape == (SAMPLES, 1, 30)
    assert len({id(one) for one in kernels}) == 1
    for k, theta in enumerate(sets[:2]):
        assert y[:, 0, k] - problem.experiments[0].measured[:, 0] == pytest.approx(
            problem.residuals(theta) / problem.weights[0], abs=1e-12
        )
        assert costs[k] == pytest.approx(problem.cost(theta), rel=1e-12)


def test_code_without_optimisation_gives_the_same_derivatives(base, monkeypatch):
    quick = extended(base)
    monkeypatch.setattr(models, "MAX_QUICK_STEPS", 0)
    slow = extended(base)
    assert [one.quick for one in (*quick.experiments, *slow.experiments)] == [True, False]
    theta = quick.unknowns.start + 1e-3
    (r, J), (other, own) = quick.jacobian(theta), slow.jacobian(theta)
    assert r == pytest.approx(other, rel=1e-12)
    assert J.dense() == pytest.approx(own.dense(), rel=1e-10)


def test_long_recordings_are_worth_the_optimisation(base):
    model, records, settings = base
    t = np.arange(40 * SAMPLES) * STEP
    long = {
        k: attrs.evolve(r, t=t, signals={n: np.tile(y, 40) for n, y in r.signals.items()}) for k, r in records.items()
    }
    diagram = model.diagram.insert("gap", tsm.blocks.Play(half_width=0.05), before="x_out")
    problem, setup = pose_extended(model, diagram, ["gap.half_width"], long, settings)
    assert not any(one.quick for one in (*problem.experiments, *setup.experiments))
