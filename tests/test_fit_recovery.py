"""Fits find the numbers that made the data, from everywhere and by every method, and intervals keep their word."""

import math
from pathlib import Path

import attrs
import numpy as np
import pytest
from scipy import stats

import tsmblocks as tsm
from tests.derivatives import DERIVATIVES, JUMPS, SMOOTH
from tests.identification import (
    ENCODER,
    NOISE,
    NOISES,
    ROUGH,
    SIGNALS,
    TRUTH,
    Bench,
    autoregressive,
    distance,
    hits,
    searches,
    white,
)
from tests.tolerances import BACKENDS
from tsmblocks.fitting import summary as summing_up
from tsmblocks.fitting.setup import pose

SLOW_NEEDS = ["fitting", "diagrams/*.toml"]
DRAWS = 200


@pytest.fixture(scope="module")
def bench():
    return Bench()


# ---- recovery


@pytest.mark.parametrize(("method", "count"), [("gauss-newton", 100), ("ipopt", 25), ("ga", 5)])
def test_every_start_ends_at_the_truth(bench, method, count):
    fits = searches(bench, method, count)
    assert {fit.status for fit in fits} == {"converged"}
    values = np.array([[fit[name].value for name in TRUTH] for fit in fits])
    errors = np.array([fits[0][name].error for name in TRUTH])
    assert (np.ptp(values, axis=0) < (0.1 if method == "ga" else 1e-3) * errors).all()
    assert distance(fits[0]) < stats.chi2(len(TRUTH)).ppf(0.95)
    for name, value in TRUTH.items():
        assert fits[0][name].low < value < fits[0][name].high
        assert fits[0][name].error < 0.02 * abs(value)  # an interval that holds everything would say nothing


def test_what_is_left_is_the_noise(bench):
    fit = searches(bench, "gauss-newton", 1)[0]
    expected = math.hypot(NOISE, ENCODER / math.sqrt(12))  # rounding adds the variance of a uniform error
    assert fit.rms == pytest.approx(expected, rel=5 / math.sqrt(2 * 3 * len(bench.t)))


# ---- coverage


def mostly_slow(names, quick):
    """Parameters of a test of which only one is not slow."""
    return [name if name == quick else pytest.param(name, marks=pytest.mark.slow) for name in names]


def kept(found):
    """Whether shares of hits are what intervals of 95 % have, as far as so many draws can tell.

    One parameter: the middle 99.9 % of the binomial distribution. Their mean: 90 to 98 %; parameters that
    err together make it no surer than one of them, and for 200 draws that is some three deviations.
    """
    draws = stats.binom(len(found), 0.95)
    each = found.sum(axis=0)
    return bool((draws.ppf(5e-4) <= each).all() and (each <= draws.ppf(1 - 5e-4)).all() and 0.9 <= found.mean() <= 0.98)


@pytest.mark.parametrize("noise", mostly_slow(NOISES, "AR(1) 0.9"))
def test_intervals_hold_the_truth_as_often_as_they_say(bench, noise):
    found = hits(bench, NOISES[noise], DRAWS)
    assert kept(found), found.mean(axis=0)


@pytest.mark.parametrize("name", mostly_slow(SIGNALS, "two tones"))
def test_intervals_from_one_recording(bench, name):
    found = hits(bench, autoregressive, DRAWS, (name,), first=DRAWS)
    assert kept(found), found.mean(axis=0)


@pytest.mark.slow
def test_that_check_notices_intervals_made_for_white_noise(bench, monkeypatch):
    honest = summing_up.uncertainty

    def naive(*args, **options):
        known = honest(*args, **options)
        return attrs.evolve(known, covariance=known.white, freedom=np.full_like(known.freedom, np.inf))

    monkeypatch.setattr(summing_up, "uncertainty", naive)
    assert not kept(hits(bench, autoregressive, DRAWS // 4))
    assert kept(hits(bench, white, DRAWS // 4))


# ---- derivatives


def test_no_shipped_diagram_is_left_out_silently():
    shipped = {path.stem for path in (Path(__file__).parents[1] / "diagrams").glob("*.toml")}
    assert set(DERIVATIVES) == shipped


@pytest.mark.parametrize("name", sorted(SMOOTH))
def test_the_derivatives_of_a_fit_equal_central_differences(name):
    """Through the fit: two experiments, weights, ties of shared numbers, sampled inputs, every second step compared."""
    diagram, t = tsm.load(name), np.arange(0, 3.0005, 2e-3)
    if "ref" in diagram.blocks:  # no velocity that is exactly zero on a step: at a kink every method picks a side
        diagram = diagram.with_parameters({"ref.frequency": 0.213, "ref.phase": 0.2})
    records = []
    for k, phase in enumerate((0.2, 1.1)):
        driven = {u: 0.9 * np.sin(1.3 * t + phase) for u in diagram.inputs}
        records.append(tsm.Record(f"run {k}", t, {**driven, **dict.fromkeys(diagram.outputs, 0 * t)}, {}))
    problem = pose(
        diagram,
        records,
        free=SMOOTH[name],
        sigma={y: 0.5 + k for k, y in enumerate(diagram.outputs)},
        window=(0.5, None),
        step=1e-3,
        hold="cubic",
    )[0]
    theta = problem.unknowns.start
    r, jacobian = problem.jacobian(theta)
    jacobian = jacobian.dense()
    np.testing.assert_allclose(r, problem.residuals(theta), rtol=0, atol=BACKENDS)
    for k, unknown in enumerate(problem.unknowns.names):
        shares = []
        for size in (1e-3, 1e-4, 1e-5, 1e-7):  # a difference has an error of its own, least at a size that varies
            expected = difference(problem, theta, k, size * max(abs(theta[k]), 0.1))
            shares.append(np.abs(jacobian[:, k] - expected) / max(1.0, np.abs(expected).max()))
        # a difference across a kink that moves with the parameter is itself of first order: a few instants
        assert min(np.quantile(share, 0.99) for share in shares) < 1e-6, unknown
        assert name in JUMPS or min(share.max() for share in shares) < 1e-3, unknown


def difference(problem, theta, k, size):
    """Central difference with one Richardson step, so that its own error is of fourth order."""

    def slope(e):
        side = e * np.eye(len(theta))[k]
        return (problem.residuals(theta + side) - problem.residuals(theta - side)) / (2 * e)

    return (4 * slope(size / 2) - slope(size)) / 3


@pytest.mark.parametrize("name", ["tendon_sheath_asymmetric", "tendon_sheath_generalized"])
def test_sums_side_by_side_equal_those_one_by_one(name):
    """Lanes run piece by piece and in threads; the number of samples and the window fall where they like."""
    diagram = tsm.load(name)
    rng = np.random.default_rng(5)
    for samples, window, step in ((1999, None, 5e-3), (2001, (3.0, None), 5e-3), (4003, (0.013, 17.0), 2.5e-3)):
        t = np.arange(samples) * 5e-3
        records = [
            tsm.Record(f"run {k}", t, {"x_in": np.sin(t + k), "x_out": rng.standard_normal(samples)}, {})
            for k in range(2)
        ]
        problem = pose(
            diagram,
            records,
            free=["tsm.*"],
            local=("offset.bias",),
            priors={"tsm.A": (-0.9, 0.2)},
            sigma=0.1,
            window=window,
            step=step,
        )[0]
        thetas = problem.unknowns.start * rng.uniform(0.9, 1.1, (70, len(problem.unknowns.start)))
        for sets in (thetas[:3], thetas[:11], thetas):
            expected = [problem.cost(theta) for theta in sets]
            np.testing.assert_allclose(problem.costs(sets), expected, rtol=1e-11)


def test_rough_numbers_are_none_of_the_truth():
    """The searches above have some way to go."""
    assert all(abs(ROUGH[name] / value - 1) > 0.04 for name, value in TRUTH.items())
