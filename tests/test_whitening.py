"""Residuals whose errors are correlated, whitened, against dense matrices and published densities."""

import attrs
import numpy as np
import pytest
from scipy.linalg import sqrtm
from scipy.stats import multivariate_normal

import tsmblocks as tsm
from tsmblocks.blocks import FirstOrderLag
from tsmblocks.fitting.setup import pose
from tsmblocks.fitting.whitening import Whitening

DRAW = np.random.default_rng(3)
CAUSES = DRAW.standard_normal((12, 3)) * [4.0, 1.0, 0.2]
COVARIANCE = np.eye(12) + CAUSES @ CAUSES.T


def test_whitening_is_the_inverse_root_of_the_covariance():
    found = Whitening.of(CAUSES)
    root = np.linalg.inv(sqrtm(COVARIANCE).real)
    assert found.whitened(np.eye(12)) == pytest.approx(root, abs=1e-12)
    values = DRAW.standard_normal(12)
    assert found.restored(found.whitened(values)) == pytest.approx(values, abs=1e-12)
    assert found.variances == pytest.approx(np.diag(COVARIANCE) - 1, abs=1e-12)


@pytest.mark.parametrize("factor", [0.5, 1.0, 3.0])
def test_deviance_against_the_normal_density(factor):
    r, other = DRAW.standard_normal((2, 12))
    density = multivariate_normal(np.zeros(12), np.eye(12) + factor**2 * CAUSES @ CAUSES.T)
    found = Whitening.of(CAUSES).scaled(factor)
    difference = found.deviance(r) - found.deviance(other)
    assert difference == pytest.approx(-2 * (density.logpdf(r) - density.logpdf(other)), abs=1e-9)
    alone = multivariate_normal(np.zeros(12), np.eye(12))
    assert found.deviance(r) - r @ r == pytest.approx(-2 * (density.logpdf(r) - alone.logpdf(r)), abs=1e-9)


def test_errors_next_to_nothing_need_no_whitening():
    assert Whitening.of(1e-3 * CAUSES) is None


def problem():
    t = np.arange(0, 2, 0.05)
    lag = tsm.Diagram(
        blocks=dict(lag=FirstOrderLag(gain=2.0, time_constant=0.3)), inputs=dict(u="lag"), outputs=dict(y="lag")
    )
    u, y = np.sin(5 * t), np.cos(3 * t)
    recordings = {name: tsm.Record(name, t, dict(u=a, y=b), {}) for name, a, b in (("one", u, y), ("two", y, u))}
    made, _ = pose(lag, recordings)
    whitening = Whitening.of(DRAW.standard_normal((len(t), 4)))
    return made, attrs.evolve(made, whitening={1: whitening}), whitening


def test_a_problem_whitens_residuals_derivatives_and_costs_alike():
    plain, whitened, whitening = problem()
    theta, rows = plain.unknowns.start * 1.1, plain.rows[1]
    r, other = plain.residuals(theta), whitened.residuals(theta)
    assert other[plain.rows[0]] == pytest.approx(r[plain.rows[0]])
    assert other[rows] == pytest.approx(whitening.whitened(r[rows]))
    assert whitened.restored(other) == pytest.approx(r)
    _, J = plain.jacobian(theta)
    same, changed = whitened.jacobian(theta)
    assert same == pytest.approx(other)
    assert changed.dense()[rows] == pytest.approx(whitening.whitened(J.dense()[rows]))
    cost, gradient, matrix = whitened.normal(theta)
    assert cost == pytest.approx(0.5 * other @ other)
    assert gradient == pytest.approx(changed.dense().T @ other)
    assert matrix == pytest.approx(changed.dense().T @ changed.dense())
    assert whitened.costs(np.array([theta, 0.9 * theta])) == pytest.approx([cost, whitened.cost(0.9 * theta)])


def test_samples_that_were_not_measured_stay_without_weight():
    plain, whitened, whitening = problem()
    one = plain.experiments[1]
    counted = np.ones((len(one.t), 1))
    counted[5:9] = 0.0
    experiments = plain.experiments[0], attrs.evolve(one, counted=counted)
    masked = attrs.evolve(whitened, experiments=experiments)
    theta, rows = plain.unknowns.start * 1.1, plain.rows[1]
    expected = whitening.whitened(plain.residuals(theta)[rows] * counted[:, 0])
    assert masked.residuals(theta)[rows] == pytest.approx(expected)
    _, y = masked.output_sets(np.array([theta]))
    assert masked.residuals_of(1, y)[:, 0] == pytest.approx(expected)


def test_two_outputs_are_whitened_together():
    t = np.arange(0, 2, 0.05)
    pair = tsm.Diagram(
        blocks=dict(fast=FirstOrderLag(time_constant=0.1), slow=FirstOrderLag(time_constant=0.5)),
        inputs=dict(u=["fast.u", "slow.u"]),
        outputs=dict(y="fast", z="slow"),
    )
    signals = dict(u=np.sin(5 * t), y=np.cos(3 * t), z=np.sin(t))
    made, _ = pose(pair, tsm.Record("one", t, signals, {}))
    whitening = Whitening.of(DRAW.standard_normal((2 * len(t), 3)))
    whitened, theta = attrs.evolve(made, whitening={0: whitening}), made.unknowns.start
    r, J = made.jacobian(theta)
    other, changed = whitened.jacobian(theta)
    assert other == pytest.approx(whitening.whitened(r))
    assert changed.dense() == pytest.approx(whitening.whitened(J.dense()))
    assert whitened.normal(theta)[2] == pytest.approx(changed.dense().T @ changed.dense())
    (y,) = whitened.output_sets(np.array([theta]))
    assert whitened.residuals_of(0, y)[:, 0] == pytest.approx(other)
