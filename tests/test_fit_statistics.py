"""How sure a fit is of its parameters: coverage of intervals, autocorrelation of residuals, identifiability."""

import itertools
import math
import tracemalloc
from types import SimpleNamespace

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st
from scipy import linalg, signal, stats

import tsmblocks as tsm
from tests.tolerances import EXACT
from tsmblocks.common.errors import DataError
from tsmblocks.common.rounding import plus_minus
from tsmblocks.fitting.identifiability import UNCERTAIN, Undetermined, _Wording, sizes, undetermined
from tsmblocks.fitting.inner_products import product
from tsmblocks.fitting.jacobian import Jacobian
from tsmblocks.fitting.noise_model import FEWEST, ARModel, LagProducts, best_order, fast_length, noise_models
from tsmblocks.fitting.sample_sums import summed
from tsmblocks.fitting.statistics import autocorrelation, correlation, intervals, uncertainty
from tsmblocks.fitting.text import cautions

SLOW_NEEDS = ["fitting"]


def regressors(n, p, cycles):
    """Columns as the sensitivities of a hysteresis model: a motion, an offset, a play, signs, bent curves."""
    t = np.arange(n) / n
    x = np.sin(2 * np.pi * cycles * t) + 0.4 * np.sin(2 * np.pi * 2.3 * cycles * t)
    play = np.array(list(itertools.accumulate(x, lambda z, now: min(max(z, now - 0.3), now + 0.3), initial=0.0))[1:])
    v = np.gradient(x) * n
    every = [x, np.ones(n), play, np.sign(v), np.tanh(v / 20) * x, np.abs(x), x**3]
    return np.stack(every[:p], axis=1)


def autoregressive(phi):
    def draw(n, rng):
        e = rng.standard_normal(n)
        e[0] /= math.sqrt(1 - phi**2)
        return signal.lfilter([1], [1, -phi], e)

    return draw


def filtered(n, rng):
    return signal.filtfilt(*signal.butter(2, 0.05), rng.standard_normal(n + 400))[200:-200]


def disturbed(n, rng):
    phase = rng.uniform(0, 2 * np.pi)
    return 0.3 * rng.standard_normal(n) + math.sqrt(2) * np.sin(2 * np.pi * 0.0317 * np.arange(n) + phase)


def on_top(n, rng):
    return autoregressive(0.98)(n, rng) / 5 + 0.5 * rng.standard_normal(n)


NOISES = {
    "white": lambda n, rng: rng.standard_normal(n),
    "ar 0.9": autoregressive(0.9),
    "ar 0.98": autoregressive(0.98),
    "ar 0.98 on white": on_top,
    "zero-phase filtered": filtered,
    "sine on white": disturbed,
}


def draws(count, n, p, pieces, noise, seed=0):
    """Fits of a linear model to noise: residuals, what was found (the truth being zero), and how sure."""
    rng = np.random.default_rng(seed)
    J = np.concatenate([regressors(n, p, 3 + 2 * i) * (1 + 0.3 * i) for i in range(pieces)])
    segments = [slice(i * n, i * n + n) for i in range(pieces)]
    inverse = np.linalg.pinv(J)
    for _ in range(count):
        e = np.concatenate([noise(n, rng) for _ in segments])
        theta = inverse @ e
        yield theta, uncertainty(J, e - J @ theta, segments)


def coverage(found):
    hits = []
    for theta, known in found:
        low, high = intervals(theta, known.covariance, known.freedom)
        hits.append((low < 0) & (high > 0))
    return np.mean(hits)


# ---- coverage


@pytest.mark.parametrize(
    ("n", "p", "pieces"), [(500, 1, 1), (500, 7, 1), (500, 5, 3), pytest.param(3000, 5, 1, marks=pytest.mark.slow)]
)
@pytest.mark.parametrize("name", NOISES)
def test_intervals_hold_the_truth_as_often_as_they_say(name, n, p, pieces):
    share = coverage(draws(200, n, p, pieces, NOISES[name]))
    assert share >= 0.90
    assert share <= (1.0 if name == "sine on white" else 0.98)  # a sine is bounded; no interval of it errs


def test_intervals_for_white_noise_would_be_far_too_short():
    found = [(theta, known.white) for theta, known in draws(100, 500, 3, 1, NOISES["ar 0.98"])]
    hits = [np.abs(theta) < 1.96 * np.sqrt(np.diag(white)) for theta, white in found]
    assert np.mean(hits) < 0.5


def test_quantised_residuals_of_a_dithered_signal():
    rng, J = np.random.default_rng(0), regressors(2000, 5, 3)
    inverse, step, hits = np.linalg.pinv(J), 0.01, []
    for _ in range(200):
        y = J @ [1.0, 0.3, -0.5, 0.1, 0.2] + rng.uniform(0, 1) + 0.5 * step * rng.standard_normal(len(J))
        e = np.round(y / step) * step - y + 0.3 * step * rng.standard_normal(len(J))
        theta = inverse @ e
        known = uncertainty(J, e - J @ theta)
        low, high = intervals(theta, known.covariance, known.freedom)
        hits.append((low < 0) & (high > 0))
    assert 0.90 <= np.mean(hits) <= 0.98


def test_many_short_segments_share_one_colour():
    share = coverage(draws(200, 30, 2, 20, NOISES["ar 0.9"]))
    assert 0.90 <= share <= 0.98
    _, known = next(draws(1, 30, 2, 20, NOISES["ar 0.9"]))
    assert FEWEST > 30
    assert {id(c.coefficients) for c in known.models} == {id(known.models[0].coefficients)}
    assert known.models[0].order > 0


def test_slow_noise_beside_white_noise_in_an_oversampled_recording():
    """The slow part is a tenth of the recording long, thousands of samples, and an autoregression sees some tens."""
    n, hits = 16_000, []
    J = regressors(n, 4, 3)
    inverse, rng = np.linalg.pinv(J), np.random.default_rng(2)
    for _ in range(60):
        e = autoregressive(math.exp(-10 / n))(n, rng) * math.sqrt(20 / n) + rng.standard_normal(n)
        theta = inverse @ e
        known = uncertainty(J, e - J @ theta)
        low, high = intervals(theta, known.covariance, known.freedom)
        hits.append((low < 0) & (high > 0))
    assert np.mean(hits, axis=0)[1] >= 0.85  # of the offset: 0.75 with an autoregression of the samples themselves
    assert 0.90 <= np.mean(hits) <= 0.98


def test_sums_keep_the_basis_and_the_variance_of_white_noise():
    n, rng = 6000, np.random.default_rng(0)
    Q = Jacobian.of(np.linalg.qr(regressors(n, 2, 2))[0])
    basis, sums, parts = summed(Q, rng.standard_normal(n), [slice(0, 2900), slice(2900, n)])
    assert [s.stop - s.start for s in parts] == [725, 775]
    assert basis.norms == pytest.approx([1.0, 1.0])
    assert np.var(sums) == pytest.approx(1.0, abs=0.1)
    rough = Jacobian.of(np.linalg.qr(rng.standard_normal((n, 2)))[0])
    assert len(summed(rough, np.zeros(n), [slice(0, n)])[1]) == n


# ---- covariance


def dense(model, n):
    return linalg.toeplitz(model.autocovariance(n))


@settings(max_examples=25, deadline=None)
@given(seed=st.integers(0, 2**31), n=st.integers(45, 120), p=st.integers(1, 4), pieces=st.integers(1, 3))
def test_the_covariance_is_the_sandwich_with_the_noise_found(seed, n, p, pieces):
    rng = np.random.default_rng(seed)
    J = rng.standard_normal((n * pieces, p)).cumsum(axis=0)
    segments = [slice(i * n, i * n + n) for i in range(pieces)]
    r = np.concatenate([autoregressive(0.8)(n, rng) for _ in segments])
    r -= J @ np.linalg.lstsq(J, r, rcond=None)[0]
    known = uncertainty(J, r, segments)
    middle = sum(J[s].T @ dense(c, n) @ J[s] for s, c in zip(segments, known.models, strict=True))
    inverse = np.linalg.inv(J.T @ J)
    np.testing.assert_allclose(
        known.covariance, inverse @ middle @ inverse, rtol=1e-7, atol=1e-9 * np.abs(middle).max()
    )
    np.testing.assert_allclose(known.white, inverse * (r @ r) / (n * pieces - p), rtol=1e-7)


def test_degrees_of_freedom_are_those_of_the_delta_method():
    rng = np.random.default_rng(5)
    J = regressors(600, 3, 4)
    r = autoregressive(0.7)(600, rng)
    r -= J @ np.linalg.lstsq(J, r, rcond=None)[0]
    known = uncertainty(J, r)
    noises = noise_models(Jacobian.of(np.linalg.qr(J)[0]), r, [slice(0, 600)])
    gains = np.linalg.pinv(J)

    def variances(a):
        return np.diag(gains @ dense(ARModel(a, noises.models[0].variance), 600) @ gains.T)

    a, k = noises.models[0].coefficients, noises.models[0].order
    assert k >= 1
    slopes = np.array([(variances(a + h) - variances(a - h)) / 2e-6 for h in 1e-6 * np.eye(k)])
    v = variances(a)
    doubt = 2 * v**2 / (600 - 3 - 2 * k) + np.einsum("ip,ij,jp->p", slopes, noises.uncertain[0], slopes)
    np.testing.assert_allclose(known.freedom, 2 * v**2 / doubt, rtol=1e-3)


def test_white_noise_leaves_the_classical_interval():
    rng = np.random.default_rng(2)
    J = rng.standard_normal((200, 2))
    r = rng.standard_normal(200)
    r -= J @ np.linalg.lstsq(J, r, rcond=None)[0]
    known = uncertainty(J, r)
    assert known.models[0].order == 0
    np.testing.assert_allclose(known.covariance, known.white, rtol=1e-3)
    np.testing.assert_allclose(known.freedom, 198.0, rtol=1e-9)
    middle = np.array([1.0, 2.0])
    low, high = intervals(middle, known.covariance, known.freedom, level=0.9)
    wide = stats.t(198).ppf(0.95) * known.errors
    np.testing.assert_allclose([low, high], [middle - wide, middle + wide], rtol=1e-9)


def test_without_degrees_of_freedom_an_interval_is_that_of_a_normal_distribution():
    low, high = intervals(np.array([0.0]), np.array([[4.0]]))
    np.testing.assert_allclose([low[0], high[0]], stats.norm.ppf([0.025, 0.975]) * 2, rtol=1e-12)


def test_what_is_held_does_not_move():
    rng = np.random.default_rng(3)
    J, e = regressors(800, 3, 4), NOISES["ar 0.9"](800, rng)
    two = J[:, [0, 2]]
    r = e - two @ np.linalg.lstsq(two, e, rcond=None)[0]
    known = uncertainty(J, r, held=np.array([[0.0, 5.0, 0.0]]))
    alone = uncertainty(two, r)
    np.testing.assert_array_equal(known.covariance[1], np.zeros(3))
    np.testing.assert_allclose(known.covariance[np.ix_([0, 2], [0, 2])], alone.covariance, rtol=1e-8)
    np.testing.assert_allclose(known.freedom[[0, 2]], alone.freedom, rtol=1e-6)
    assert known.freedom[1] == math.inf
    assert np.isnan(correlation(known.covariance)[1, 0])


def test_a_constraint_holds_its_combination():
    rng = np.random.default_rng(3)
    J, r = regressors(800, 3, 4), rng.standard_normal(800)
    known = uncertainty(J, r, held=np.array([[1.0, 0.0, -2.0]]))
    move = np.array([1.0, 0.0, -2.0])
    assert known.covariance[0, 0] > 0
    np.testing.assert_allclose(move @ known.covariance, 0.0, atol=1e-15)
    np.testing.assert_allclose(correlation(known.covariance)[0, 2], 1.0, rtol=1e-9)


def test_all_held():
    J, r = regressors(100, 2, 3), np.random.default_rng(0).standard_normal(100)
    known = uncertainty(J, r, held=np.eye(2))
    np.testing.assert_array_equal(known.covariance, np.zeros((2, 2)))


def test_a_prior_is_one_more_measurement():
    rng, sigma, deviation = np.random.default_rng(4), 0.5, 0.2
    J, r = regressors(300, 2, 3), sigma * rng.standard_normal(300)
    J[:, 1] *= 1e-3
    r -= J @ np.linalg.lstsq(J, r, rcond=None)[0]
    prior = np.diag([0.0, (sigma / deviation) ** 2])
    known = uncertainty(J, r, prior=prior, noise=sigma)
    stacked = np.linalg.inv(J.T @ J / sigma**2 + np.diag([0.0, deviation**-2]))
    np.testing.assert_allclose(known.covariance, stacked, rtol=0.2, atol=1e-5)
    np.testing.assert_allclose(known.errors[1], deviation, rtol=0.01)
    assert uncertainty(J, r).errors[1] > 10 * deviation


def test_what_the_data_leave_open_is_infinitely_uncertain():
    rng = np.random.default_rng(6)
    J = np.column_stack([regressors(400, 2, 3), np.zeros(400)])
    J = np.column_stack([J, J[:, 0] * 3])
    r = rng.standard_normal(400)
    known = uncertainty(J, r)
    assert list(np.isinf(known.errors)) == [True, False, True, True]
    assert np.isnan(known.covariance[0, 1])
    assert np.isfinite(known.covariance[1, 1])
    low, high = intervals(np.zeros(4), known.covariance, known.freedom)
    assert (low[0], high[0]) == (-math.inf, math.inf)
    np.testing.assert_allclose(known.covariance[1, 1], uncertainty(J[:, :2], r).covariance[1, 1], rtol=1e-6)


@pytest.mark.parametrize("scale", [(1e9, 1.0, 1e-7, 1e3), (1e90, 1.0, 1e-90, 1e3)])
def test_parameters_of_very_different_size_are_no_trouble(scale):
    rng = np.random.default_rng(7)
    J, r = regressors(400, 4, 3), autoregressive(0.9)(400, rng)
    scale = np.array(scale)
    a, b = uncertainty(J, r), uncertainty(J * scale, r)
    np.testing.assert_allclose(b.covariance * np.outer(scale, scale), a.covariance, rtol=1e-6)
    np.testing.assert_allclose(b.freedom, a.freedom, rtol=1e-6)


def test_a_perfect_fit_is_perfectly_sure():
    known = uncertainty(regressors(100, 2, 3), np.zeros(100))
    assert known.errors.max() < 1e-100


@pytest.mark.parametrize("r", [np.ones(200), np.arange(200.0), np.eye(1, 200)[0], np.sin(0.3 * np.arange(200))])
def test_residuals_that_are_no_noise_give_finite_figures(r):
    known = uncertainty(regressors(200, 2, 3), r)
    assert np.isfinite(known.covariance).all()
    assert (known.errors > 0).all()
    assert (known.freedom >= 2).all()


def test_a_segment_of_few_samples_beside_a_long_one():
    rng = np.random.default_rng(8)
    J, r = rng.standard_normal((1003, 2)), rng.standard_normal(1003)
    known = uncertainty(J, r, [slice(0, 1000), slice(1000, 1002), slice(1002, 1003), slice(1003, 1003)])
    np.testing.assert_allclose(known.covariance, known.white, rtol=0.2, atol=1e-4)
    assert len(known.models) == 3


@pytest.mark.parametrize(
    ("J", "r", "segments", "message"),
    [
        (
            np.ones((3, 3)),
            np.ones(3),
            None,
            "3 samples do not determine the uncertainty of 3 parameters: more samples than parameters are needed.",
        ),
        (
            np.ones((9, 3)),
            np.ones(8),
            None,
            "a Jacobian of shape (N, p) and N residuals are needed, got shapes (9, 3) and (8,).",
        ),
        (
            np.full((9, 3), np.nan),
            np.ones(9),
            None,
            "residuals and their Jacobian must be finite to determine the uncertainty of a fit.",
        ),
        (np.ones((9, 3)), np.ones(9), [slice(0, 5)], "the segments must cover each of the 9 residuals once."),
    ],
)
def test_what_cannot_be_judged_is_refused(J, r, segments, message):
    with pytest.raises(DataError) as caught:
        uncertainty(J, r, segments)
    assert str(caught.value) == message


def test_correlation_is_that_of_numpy():
    sample = np.random.default_rng(0).standard_normal((50, 3)).cumsum(axis=1)
    np.testing.assert_allclose(correlation(np.cov(sample.T)), np.corrcoef(sample.T), rtol=1e-12)


# ---- the noise model


STABLE = st.lists(st.complex_numbers(max_magnitude=0.9), min_size=0, max_size=2)


@settings(deadline=None)
@given(roots=STABLE, n=st.integers(1, 400))
def test_autocovariance_of_an_autoregression(roots, n):
    a = -np.atleast_1d(np.real(np.poly([*roots, *np.conj(roots)])))[1:]
    got = ARModel(a, 2.0).autocovariance(n)
    impulse = signal.lfilter([1], np.r_[1, -a], np.eye(1, 4000)[0])
    wanted = 2.0 * signal.correlate(impulse, impulse, method="direct" if n < 3 else "fft")[3999 : 3999 + n]
    np.testing.assert_allclose(got, wanted, rtol=0, atol=1e-6 * wanted[0])  # roots may meet, which costs digits


def test_autocovariance_of_noise_that_outlasts_the_record():
    roots = [0.9999, 0.999 * np.exp(0.3j), 0.999 * np.exp(-0.3j), -0.5]
    model = ARModel(-np.real(np.poly(roots))[1:], 1.0)
    impulse = signal.lfilter([1], np.r_[1, -model.coefficients], np.eye(1, 300_000)[0])
    wanted = [impulse[k:] @ impulse[: len(impulse) - k] for k in (0, 1, 50, 199)]
    np.testing.assert_allclose(model.autocovariance(200)[[0, 1, 50, 199]], wanted, rtol=1e-6)


def test_autocovariance_of_one_slow_pole():
    got = ARModel(np.array([0.999]), 3.0).autocovariance(5000)
    np.testing.assert_allclose(got, 3.0 / (1 - 0.999**2) * 0.999 ** np.arange(5000), rtol=1e-9)


@settings(deadline=None)
@given(
    seed=st.integers(0, 2**31),
    lengths=st.lists(st.integers(1, 60), min_size=1, max_size=4),
    m=st.integers(1, 3),
    k=st.integers(0, 8),
)
def test_lag_products_are_sums_of_products(seed, lengths, m, k):
    rng = np.random.default_rng(seed)
    parts = [rng.standard_normal((m, n)) for n in lengths]
    wanted = np.zeros((k + 1, k + 1, m, m))
    for z, i, j in itertools.product(parts, range(k + 1), range(k + 1)):
        for t in range(k, z.shape[1]):
            wanted[i, j] += np.outer(z[:, t - i], z[:, t - j])
    found, root, weights = LagProducts.of(parts, k), rng.standard_normal((m, m)), rng.standard_normal(k + 1)
    outer = root @ root.T
    np.testing.assert_allclose(found.along(outer), np.einsum("ijmn,mn->ij", wanted, outer), rtol=1e-9, atol=1e-9)
    filtered = np.einsum("i,j,ijmn->mn", weights, weights, wanted)
    np.testing.assert_allclose(found.filtered(weights), filtered, rtol=1e-9, atol=1e-9)


def test_lag_products_of_many_segments_take_little_memory():
    """A simulation that restarts every second has hundreds of segments and of initial states."""
    parts, k, m = list(np.random.default_rng(0).standard_normal((50, 100, 60))), 20, 100
    tracemalloc.start()
    LagProducts.of(parts, k)
    peak = tracemalloc.get_traced_memory()[1]
    tracemalloc.stop()
    assert peak < 8 * (1.5 * (k + 1) * m**2 + 5 * len(parts) * k * m)


def test_the_best_order_is_that_of_separate_regressions():
    rng = np.random.default_rng(1)
    x = signal.lfilter([1], [1, -1.2, 0.5, 0.1, -0.3], rng.standard_normal(700))
    most, scores = 12, []
    for k in range(most + 1):
        lags = np.column_stack([np.zeros(700 - most), *(x[most - i : 700 - i] for i in range(1, k + 1))])
        left = x[most:] - lags @ np.linalg.lstsq(lags, x[most:], rcond=None)[0]
        n = 700 - most
        scores.append(n * np.log(left @ left) + 2 * (k + 1) * n / (n - k - 2))
    assert best_order(LagProducts.of([x[None]], most).along(np.eye(1)), 700 - most) == int(np.argmin(scores))


def test_a_fit_does_not_hide_the_slowness_of_noise():
    """Least squares on the residuals finds noise too quick: an offset and slow motions take the slow part away."""
    plain, restricted, rng = [], [], np.random.default_rng(0)
    basis = np.linalg.qr(regressors(400, 3, 2))[0]
    for _ in range(100):
        e = autoregressive(0.98)(400, rng)
        r = e - basis @ (basis.T @ e)
        for found, q in ((plain, 0), (restricted, 3)):
            model = noise_models(Jacobian.of(basis[:, :q]), r, [slice(0, 400)]).models[0]
            found.append(math.sqrt(model.variance) / (1 - model.coefficients.sum()))
    truth = 50.0  # what noise of frequency zero amounts to
    assert np.median(plain) < 0.75 * truth
    assert abs(np.median(restricted) / truth - 1) < 0.2


@settings(deadline=None)
@given(m=st.integers(1, 40), n=st.integers(1, 40), q=st.integers(1, 40), long=st.sampled_from([0, 1]))
def test_products_in_pieces(m, n, q, long):
    rng = np.random.default_rng(m + 40 * n + 1600 * q)
    m, n = (m, n + 3000) if long else (m + 3000, n)
    a, b = rng.standard_normal((m, n)), rng.standard_normal((n, q))
    np.testing.assert_allclose(product(a, b), a @ b, rtol=1e-9, atol=1e-9)


@settings(deadline=None)
@given(n=st.integers(1, 10**6))
def test_a_quick_length_is_even_and_no_longer_than_needed(n):
    length = fast_length(n)
    assert n <= length <= max(1.25 * n, n + 1)
    assert length % 2 == 0
    assert length in {f << k for f in (1, 3, 5, 9, 15) for k in range(1, 21)}


# ---- what residuals tell


def test_the_autocorrelation_of_white_noise_stays_in_its_band():
    rng = np.random.default_rng(0)
    found = [autocorrelation(rng.standard_normal(400)) for _ in range(400)]
    inside = [np.mean(np.abs(rho[1:]) < band) for rho, band in found]
    assert 0.94 < np.mean(inside) < 0.97


def test_autocorrelation_against_the_formula():
    e = autoregressive(0.5)(200, np.random.default_rng(1))
    found, band = autocorrelation(e, lags=10)
    np.testing.assert_allclose(found, np.correlate(e, e, "full")[199:210] / (e @ e), rtol=EXACT)
    assert band == pytest.approx(1.96 / math.sqrt(200), rel=1e-4)


def test_residuals_that_vanish_or_are_few_have_no_autocorrelation():
    assert np.isnan(autocorrelation(np.zeros(50))[0]).all()
    assert len(autocorrelation(np.ones(3))[0]) == 1  # too short for a single lag


# ---- what data leave open


BOUC_WEN = ("tsm.alpha_x", "tsm.alpha_zeta", "tsm.A", "tsm.beta", "tsm.gamma", "tsm.n", "offset.bias")


def bouc_wen(names, x, t, noise=1e-3, **changed):
    """Jacobian and residuals of the symmetric Bouc-Wen diagram fitted to itself with noise."""
    diagram = tsm.load("tendon_sheath_symmetric").with_parameters(changed.pop("parameters", {}))
    run = tsm.sensitivities(diagram, names, outputs=["x_out"], stop=t[-1], step=t[1], inputs={"x_in": x})
    J = run.jacobian[:, 0, :]
    e = noise * np.random.default_rng(0).standard_normal(len(J))
    r = e - J @ (np.linalg.pinv(J) @ e)
    theta = np.array([diagram.parameters[name] for name in names])
    return undetermined(J, r, names, theta, uncertainty(J, r), **changed)


T = np.arange(2501) * 0.004
TWO_TONES = 0.9 * np.sin(2 * np.pi * 0.3 * T) + 0.3 * np.sin(2 * np.pi * 0.71 * T)


def test_the_state_of_bouc_wen_has_no_size_of_its_own():
    (only,) = bouc_wen(BOUC_WEN, TWO_TONES, T)
    assert only.kind == "combination"
    assert only.names == ("tsm.alpha_zeta", "tsm.A", "tsm.beta", "tsm.gamma")
    # alpha_zeta c, A / c, beta c^(n-1), gamma c^(n-1); A and gamma are negative
    np.testing.assert_allclose(only.changes, [1.0, 1.0, 0.0217, -0.0217], rtol=1e-6)
    assert only.effect < 1e-9
    assert only.words == (
        "tsm.alpha_zeta and tsm.A are determined only in combination: with tsm.alpha_zeta 1 % higher and tsm.A 1 % "
        "closer to zero (and tsm.beta and tsm.gamma adjusted), the outputs stay the same."
    )


def test_a_product_is_told_in_shares_of_what_was_found():
    """However far the search began from there: what is 1 % of one factor is 1 % of the other."""
    k, m = 4.0, 0.5
    x = np.sin(np.arange(500) * 0.1)
    J, e = np.column_stack([m * x, k * x]), 0.01 * np.random.default_rng(0).standard_normal(500)
    theta = np.array([k, m])
    (only,) = undetermined(J, e, ["k", "m"], theta, uncertainty(J, e), scales=np.array([4.0, 2.0]))
    assert only.words.startswith("k and m are determined only in combination: with k 1 % higher and m 1 % lower, ")
    assert only.changes == pytest.approx((1.0, -0.25))


def test_a_parameter_that_was_found_near_zero_moves_by_a_number():
    x = np.sin(np.arange(500) * 0.1)
    J, e = np.column_stack([x, x]), 0.01 * np.random.default_rng(0).standard_normal(500)
    (only,) = undetermined(J, e, ["a", "b"], np.array([2.0, 0.0]), uncertainty(J, e), scales=np.array([2.0, 1.0]))
    assert only.words.startswith("a and b are determined only in combination: with a 1 % higher and b 0.02 lower, ")


def test_a_combination_of_many_is_told_by_the_largest():
    x = np.sin(np.arange(500) * 0.1)
    moved = Jacobian.of(np.array([x] * 9).T)
    one = _Wording(tuple("abcdefghi"), moved, 0.01, np.ones(9), np.ones(9), ("",) * 9).combination(
        np.linspace(1, 0.2, 9), exact=False
    )
    assert one.words == (
        "a, b, c, d, e and 4 more are indistinguishable with these data: with a 1 % higher, b 0.9 % higher, c 0.8 % "
        "higher, d 0.7 % higher, e 0.6 % higher and 4 more changed, the outputs change by 4 times the residual, but "
        "as slowly as that does."
    )
    assert len(one.names) == 9


def test_initial_states_in_a_combination_are_mentioned_beside_its_parameters():
    x = np.sin(np.arange(500) * 0.1)
    moved, names = Jacobian.of(np.column_stack([x, x, x])), ("gain", "gap.gain", "gap.m@rec1")
    one = _Wording(names, moved, 0.01, np.ones(3), np.ones(3), ("",) * 3).combination(
        np.array([1.0, -0.6, -0.4]), exact=True, nearest=True
    )
    assert one.names == names
    assert one.words == (
        "gain and gap.gain are determined only in combination: with gain 1 % higher and gap.gain 0.6 % lower (and "
        "gap.m@rec1 adjusted), the outputs stay the same. Of values that fit equally well, those closest to the "
        "diagram's own are reported."
    )


def test_with_the_scale_fixed_bouc_wen_is_determined():
    names = [name for name in BOUC_WEN if name != "tsm.alpha_zeta"]
    assert bouc_wen(names, TWO_TONES, T) == ()


def test_motion_in_one_direction_does_not_tell_how_unloading_goes():
    names = [name for name in BOUC_WEN if name not in ("tsm.alpha_zeta", "tsm.n")]
    (only,) = bouc_wen(names, 0.3 * T, T)
    assert only.names == ("tsm.beta", "tsm.gamma")
    np.testing.assert_allclose(only.changes, [2.272 / 4.206, 1.0], rtol=1e-6)  # beta + gamma is all that matters


def test_both_at_once_are_told_apart():
    first, second = bouc_wen(BOUC_WEN, 0.3 * T, T)
    assert first.names == ("tsm.beta", "tsm.gamma")
    assert second.names[:2] == ("tsm.alpha_zeta", "tsm.A")


def test_what_does_not_reach_the_output_has_no_influence():
    found = bouc_wen(BOUC_WEN, TWO_TONES, T, parameters={"tsm.alpha_zeta": 0.0})
    assert [(u.kind, u.names, u.changes, u.effect) for u in found[:3]] == [
        ("no influence", (name,), (1.0,), 0.0) for name in ("tsm.A", "tsm.beta", "tsm.gamma")
    ]
    assert found[0].words == "tsm.A has no influence on the outputs in these experiments."


def test_noise_can_hide_what_data_could_tell():
    names = [name for name in BOUC_WEN if name not in ("tsm.alpha_zeta", "offset.bias")]
    found = bouc_wen(names, TWO_TONES, T, noise=0.7)
    assert {u.kind for u in found} == {"combination", "uncertain"}
    assert all("are indistinguishable with these data" in u.words for u in found if u.kind == "combination")
    assert "tsm.gamma" in {name for u in found for name in u.names}


@pytest.mark.parametrize("ratio", [1e-3, 1e-6, 1e-9])
def test_a_weak_direction_that_the_noise_does_not_hide_is_known(ratio):
    """As of a plant that runs away: one direction is felt a thousand million times more than another."""
    rng = np.random.default_rng(5)
    Q, V = np.linalg.qr(rng.standard_normal((400, 2)))[0], np.array([[0.8, 0.6], [-0.6, 0.8]])
    sizes = 1e6 / ratio * np.array([1.0, ratio])
    noise = rng.standard_normal(400)
    r = noise - Q @ (Q.T @ noise)
    known = uncertainty(Q @ np.diag(sizes) @ V.T, r)
    expected = (r @ r) / 398 * V @ np.diag(sizes**-2.0) @ V.T
    np.testing.assert_allclose(known.white, expected, rtol=1e-15 / ratio + 1e-9)
    assert undetermined(Q @ np.diag(sizes) @ V.T, r, ["a", "b"], np.ones(2), known) == ()


def test_one_uncertain_parameter_does_not_drag_others_in():
    t = np.linspace(0, 1, 400)
    J = np.column_stack([np.ones(400), 0.18 * (t + 5.0)])  # a tenth of the first makes up for the second
    r = 1.5 * np.random.default_rng(1).standard_normal(400)
    (only,) = undetermined(J, r, ["level", "slope"], np.array([10.0, 1.0]), uncertainty(J, r))
    assert (only.kind, only.names) == ("uncertain", ("slope",))


def test_a_perfect_fit_still_names_what_is_redundant():
    (only,) = bouc_wen(BOUC_WEN[:5], TWO_TONES, T, noise=0.0)
    assert only.effect == math.inf  # nothing to compare with
    assert only.words.endswith("the outputs stay the same.")


def well_posed(seed, n, p):
    rng = np.random.default_rng(seed)
    J = rng.standard_normal((n, p)) * 10 ** rng.uniform(-4, 4, p)
    theta = rng.uniform(0.5, 2, p) * np.where(rng.random(p) < 0.5, -1, 1) / np.linalg.norm(J, axis=0)
    r = rng.standard_normal(n)
    r -= J @ np.linalg.lstsq(J, r, rcond=None)[0]
    return J, 1e-2 * r / np.linalg.norm(r), theta


@settings(max_examples=40, deadline=None)
@given(seed=st.integers(0, 2**31), n=st.integers(60, 300), p=st.integers(1, 7))
def test_nothing_is_named_where_everything_is_determined(seed, n, p):
    J, r, theta = well_posed(seed, n, p)
    assert undetermined(J, r, [f"b.p{i}" for i in range(p)], theta, uncertainty(J, r)) == ()


@settings(max_examples=40, deadline=None)
@given(seed=st.integers(0, 2**31), n=st.integers(80, 300), p=st.integers(2, 6), data=st.data())
def test_a_redundancy_put_in_is_the_one_named(seed, n, p, data):
    J, r, theta = well_posed(seed, n, p)
    i, j = data.draw(st.lists(st.integers(0, p - 1), min_size=2, max_size=2, unique=True))
    J[:, j] = J[:, i] * theta[i] / theta[j]
    (only,) = undetermined(J, r, [f"b.p{k}" for k in range(p)], theta, uncertainty(J, r))
    assert set(only.names) == {f"b.p{i}", f"b.p{j}"}
    np.testing.assert_allclose(np.abs(only.changes), 1.0, rtol=1e-6)
    assert only.effect < 1e-6


def test_a_single_parameter_that_noise_hides():
    J, r, theta = well_posed(1, 200, 3)
    J[:, 1] *= 1e-4
    known = uncertainty(J, r)
    (only,) = undetermined(J, r, ["a", "b", "c"], theta, known)
    half = intervals(theta, known.covariance, known.freedom)[1][1] - theta[1]
    assert only.kind == "uncertain"
    assert only.words == (
        f"b is poorly determined: {plus_minus(theta[1], half)}, a confidence interval wider than its value."
    )
    big = sizes(theta, 1e9 * theta, np.full(3, -np.inf), np.full(3, np.inf))
    assert undetermined(J, r, ["a", "b", "c"], theta, known, scales=big) == ()


def test_an_interval_wider_than_the_bounds():
    J, r, theta = well_posed(1, 200, 2)
    known = uncertainty(J, r)
    half = intervals(theta, known.covariance, known.freedom)[1] - theta
    room = half * [10, 0.9]
    low, high = theta - room, theta + room
    (only,) = undetermined(J, r, ["a", "b"], theta, known, low=low, high=high)
    assert only.words == (
        f"b is poorly determined: {plus_minus(theta[1], half[1])}, a confidence interval wider than its bounds."
    )


def test_priors_and_bounds_settle_what_data_cannot():
    J, r, theta = well_posed(2, 200, 3)
    J[:, 2] = 0.0
    names = ["a", "b", "c"]
    (open_,) = undetermined(J, r, names, theta, uncertainty(J, r))
    assert open_.names == ("c",)
    held = np.eye(3)[2:]
    assert undetermined(J, r, names, theta, uncertainty(J, r, held=held), held=held) == ()
    prior = np.diag([0.0, 0.0, np.mean(r**2) / (0.1 * theta[2]) ** 2])
    assert undetermined(J, r, names, theta, uncertainty(J, r, prior=prior), prior=prior) == ()


def test_a_constraint_settles_a_redundancy():
    J, r, theta = well_posed(2, 200, 3)
    J[:, 2] = J[:, 1]
    assert len(undetermined(J, r, ["a", "b", "c"], theta, uncertainty(J, r))) == 1
    held = np.array([[0.0, 1.0, -2.0]])
    assert undetermined(J, r, ["a", "b", "c"], theta, uncertainty(J, r, held=held), held=held) == ()
    along = np.array([[0.0, 1.0, 1.0]])  # says nothing of the difference, which is what is open
    assert len(undetermined(J, r, ["a", "b", "c"], theta, uncertainty(J, r, held=along), held=along)) == 1


def test_sizes():
    theta, start = np.array([2.0, -1.0, 1e-4, 1e-4, 5.0]), np.array([1.0, -3.0, 0.0, 0.0, 0.0])
    low, high = np.array([-np.inf, 0.0, -4.0, 0.0, -np.inf]), np.array([np.inf, 9.0, 4.0, np.inf, np.inf])
    np.testing.assert_array_equal(sizes(theta, start, low, high), [2.0, 3.0, 4.0, 1.0, 5.0])


def test_a_residual_that_is_all_but_periodic_leaves_an_interval():
    """Its autoregression is so close to growing that rounding may eat the variance of a mean; white noise is left."""
    t = np.arange(600) * 0.01
    r = np.sin(1.3 * t) + 0.4 * np.sin(5.1 * t) + 1e-3 * np.random.default_rng(0).normal(size=t.size)
    r -= r.mean()
    seen = uncertainty(np.ones((600, 1)), r)
    assert seen.covariance[0, 0] > 0
    record = tsm.Record("rest", t, {"x_in": np.ones(600), "x_out": 5 + r}, {"x_in": "rad", "x_out": "rad"})
    fit = tsm.fit(tsm.load("tendon_sheath_linear"), record, free=["offset.bias"], starts=1)
    assert fit["offset.bias"].verdict == ""
    assert fit["offset.bias"].low < fit["offset.bias"].value < fit["offset.bias"].high


def test_very_many_combinations_are_told_without_trying_all_ways_to_write_them():
    """Of 60 numbers 20 combinations matter: there are 4e15 ways to leave 19 of the numbers out."""
    rng = np.random.default_rng(0)
    J = rng.standard_normal((400, 20)) @ rng.standard_normal((20, 60))
    r = rng.standard_normal(400)
    known = uncertainty(J, r)
    found = undetermined(J, r, [f"k{i}" for i in range(60)], np.ones(60), known)
    assert len(found) == 40


def test_of_combinations_of_initial_states_a_few_are_listed_and_the_rest_is_counted():
    def mix(*names):
        return Undetermined("combination", names, (1.0, -1.0), 0.0, f"{' and '.join(names)} are indistinguishable.")

    found = tuple(mix(f"a@r{k}", f"b@r{k}") for k in range(9))
    fit = SimpleNamespace(
        agreeing=2,
        status="interrupted",
        differences=(),
        searches=(1, 2),
        undetermined=(*found, mix("gain", "a@r1")),
        active=(),
        correlation=np.eye(2),
        names=("gain", "a@r1"),
        notes=(),
        estimates=(),
    )
    *shown, more = cautions(fit)
    assert shown == [f"a@r{k} and b@r{k} are indistinguishable." for k in range(2)] + [
        "gain and a@r1 are indistinguishable."
    ]
    assert more == "7 more combinations of initial states are indistinguishable with these data."


def test_initial_states_of_many_experiments_that_are_hardly_determined_are_one_remark():
    """A recording in pieces has hundreds of them."""
    names = ("gain", *(f"motor.speed@r1#{k}" for k in range(60)))
    found = tuple(Undetermined(UNCERTAIN, (name,), (1.0,), 0.0, f"{name} is poorly determined.") for name in names)
    fit = SimpleNamespace(
        agreeing=2,
        status="interrupted",
        differences=(),
        searches=(1, 2),
        undetermined=found,
        active=(),
        correlation=np.eye(61),
        names=names,
        notes=(),
        estimates=(),
    )
    first, second = cautions(fit)
    assert first == "gain is poorly determined."
    assert second.startswith("motor.speed in 60 experiments (r1#0, r1#1")
    assert second.endswith("is poorly determined: a confidence interval is wider than the value or its bounds.")
    fit.estimates = tuple(SimpleNamespace(name=name, start=1.0, value=1.0, is_start=name != "gain") for name in names)
    assert cautions(fit)[1].startswith("The initial value of motor.speed in 60 experiments (r1#0, r1#1")
    fit.undetermined = found[:2]
    assert cautions(fit)[1] == "The initial value of motor.speed in r1#0 is poorly determined."
