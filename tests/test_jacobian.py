"""Unknowns of single experiments are eliminated experiment by experiment: the same results as from the whole matrix."""

import itertools

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

import tsmblocks as tsm
from tsmblocks.blocks import Play
from tsmblocks.fitting.column_space import column_space
from tsmblocks.fitting.identifiability import undetermined
from tsmblocks.fitting.jacobian import Jacobian
from tsmblocks.fitting.quadratic_program import quadratic_step, reduced_step
from tsmblocks.fitting.setup import pose
from tsmblocks.fitting.statistics import RANK, moved, uncertainty


def arrowhead(seed, experiments=4, common=3, own=2, samples=90, outputs=2):
    """A Jacobian with slow columns, scaled and shuffled at random, residuals at the optimum, and segments."""
    rng = np.random.default_rng(seed)
    lengths = rng.integers(samples // 2, 2 * samples, experiments)
    ends = np.cumsum([0, *(outputs * lengths)])
    rows = tuple(slice(a, b) for a, b in itertools.pairwise(ends))
    segments = [
        slice(a + k * n, a + (k + 1) * n)
        for a, n in zip(ends[:-1].tolist(), lengths.tolist(), strict=True)
        for k in range(outputs)
    ]
    counts = [own if e % 3 else max(own - 1, 0) for e in range(experiments)]
    places = rng.permutation(common + sum(counts))
    cuts = np.split(places, common + np.cumsum([0, *counts[:-1]]))
    left = np.zeros((ends[-1], max(own, 1)))
    whole = rng.standard_normal((ends[-1], common)).cumsum(axis=0) * 10.0 ** rng.uniform(-3, 3, common)
    for row, count in zip(rows, counts, strict=True):
        left[row, :count] = rng.standard_normal((row.stop - row.start, count)).cumsum(axis=0) + rng.standard_normal(
            count
        )
    J = Jacobian(whole, left, rows, cuts[0], tuple(cuts[1:]))
    r = rng.standard_normal(ends[-1])
    for k in range(1, len(r)):
        r[k] += 0.8 * r[k - 1]
    dense = J.dense()
    return J, r - dense @ np.linalg.lstsq(dense, r, rcond=None)[0], segments


@settings(max_examples=25, deadline=None)
@given(st.integers(0, 10_000), st.integers(1, 5), st.integers(0, 3), st.integers(0, 3))
def test_products_are_those_of_the_whole_matrix(seed, experiments, common, own):
    J, r, _ = arrowhead(seed, experiments, common, own, 8)
    dense, rng = J.dense(), np.random.default_rng(seed)
    assert dense.shape == J.shape
    v, w, factors = rng.standard_normal(J.shape[1]), rng.standard_normal((len(r), 2)), rng.uniform(0.5, 2, J.shape[1])
    size = max(np.abs(dense).max(initial=0.0), 1.0) * len(r)
    np.testing.assert_allclose(J @ v, dense @ v, atol=1e-13 * size)
    np.testing.assert_allclose(J.transposed_times(w), dense.T @ w, atol=1e-13 * size)
    np.testing.assert_allclose(J.norms, np.linalg.norm(dense, axis=0), rtol=1e-12)
    np.testing.assert_allclose(J.normal_matrix(), dense.T @ dense, atol=1e-13 * size**2)
    np.testing.assert_array_equal(J.scaled(factors).dense(), dense * factors)
    kept = rng.random(J.shape[1]) < 0.6
    np.testing.assert_array_equal(J.with_columns(kept).dense(), dense[:, kept])


@settings(max_examples=25, deadline=None)
@given(st.integers(0, 10_000), st.integers(1, 5), st.integers(0, 3), st.integers(0, 3))
def test_the_column_space_is_that_of_the_whole_matrix(seed, experiments, common, own):
    J, _, _ = arrowhead(seed, experiments, common, own, 12)
    space, dense = column_space(J, RANK), J.dense()
    assert space.unseen.shape[1] == 0
    np.testing.assert_allclose(space.basis.normal_matrix(), np.eye(J.shape[1]), atol=1e-9)
    np.testing.assert_allclose(dense @ space.turn, space.basis.dense(), atol=1e-8)


def with_null_directions(seed):
    """Two common columns and all own ones have a direction without effect, one own column has none, one is doubled."""
    J, r, segments = arrowhead(seed, experiments=4, common=3, own=2)
    common, own = J.common.copy(), J.own.copy()
    common[:, 1] = 2 * common[:, 0]
    for row in J.rows:
        common[row, 1] += 3 * own[row, 0]
    own[J.rows[1], 1] = 0.0
    own[J.rows[2], 1] = 5 * own[J.rows[2], 0]
    J = Jacobian(common, own, J.rows, J.common_columns, J.own_columns)
    return J, r - J.dense() @ np.linalg.lstsq(J.dense(), r, rcond=None)[0], segments


@pytest.mark.parametrize("seed", range(4))
def test_directions_without_effect_are_those_of_the_whole_matrix(seed):
    J, _, _ = with_null_directions(seed)
    few, whole = column_space(J, RANK), column_space(Jacobian.of(J.dense()), RANK)
    assert few.unseen.shape == whole.unseen.shape == (J.shape[1], 3)
    np.testing.assert_allclose(few.unseen @ few.unseen.T, whole.unseen @ whole.unseen.T, atol=1e-8)
    np.testing.assert_allclose(few.unseen.T @ few.unseen, np.eye(3), atol=1e-12)
    z = np.random.default_rng(seed).standard_normal((J.shape[0], 2))
    np.testing.assert_allclose(few.project_out(z), whole.project_out(z), atol=1e-8)


@pytest.mark.parametrize("seed", range(4))
@pytest.mark.parametrize("case", ["plain", "null directions", "bounds", "constraint", "prior", "long"])
def test_intervals_are_those_of_the_whole_matrix(seed, case):
    J, r, segments = with_null_directions(seed) if case == "null directions" else arrowhead(seed)
    if case == "long":  # a separate noise model for every segment
        J, r, segments = arrowhead(seed, experiments=3, own=1, samples=300, outputs=1)
    n = J.shape[1]
    more = {
        "bounds": {"held": np.eye(n)[[int(J.common_columns[0]), int(J.own_columns[1][0])]]},
        "constraint": {"held": np.where(np.arange(n) < 3, 1.0, 0.0)[None]},
        "prior": {"prior": np.diag(np.arange(n) * 10.0), "noise": 0.7},
    }.get(case, {})
    few, whole = uncertainty(J, r, segments, **more), uncertainty(J.dense(), r, segments, **more)
    np.testing.assert_array_equal(np.isinf(few.errors), np.isinf(whole.errors))
    scale = np.where(np.isfinite(whole.errors) & (whole.errors > 0), whole.errors, 1.0)
    for a, b in ((few.covariance, whole.covariance), (few.white, whole.white)):
        np.testing.assert_allclose(a / np.outer(scale, scale), b / np.outer(scale, scale), atol=2e-6)
    known = np.isfinite(few.errors)
    np.testing.assert_allclose(few.freedom[known], whole.freedom[known], rtol=1e-5)
    assert (case == "null directions") == bool(np.isinf(few.errors).any())
    held = {k: v for k, v in more.items() if k != "noise"}
    change = np.random.default_rng(seed).standard_normal(len(r))
    far = moved(J, change, **held), moved(J.dense(), change, **held)
    np.testing.assert_allclose(far[0] / scale, far[1] / scale, atol=1e-6)


@pytest.mark.parametrize("seed", range(3))
def test_what_is_not_identifiable_is_named_alike(seed):
    J, r, segments = with_null_directions(seed)
    names, theta = [f"p{k}" for k in range(J.shape[1])], np.ones(J.shape[1])
    few, whole = (undetermined(A, r, names, theta, uncertainty(A, r, segments)) for A in (J, J.dense()))
    assert [one.kind for one in few] == [one.kind for one in whole]
    assert [one.names for one in few[:2]] == [one.names for one in whole[:2]]
    for one in few:  # a combination of three may be written in several ways, but each has no effect
        move = np.zeros(J.shape[1])
        move[[names.index(name) for name in one.names]] = one.changes
        change = J @ move
        assert one.kind == "uncertain" or np.abs(change).max() < 1e-2 * np.abs(J.dense()).max()
    assert few[0].kind == "no influence"
    assert few[0].names == (names[J.own_columns[1][1]],)


@settings(max_examples=40, deadline=None)
@given(st.integers(0, 10_000), st.integers(1, 5), st.integers(0, 3), st.integers(0, 3), st.booleans(), st.booleans())
def test_a_reduced_step_is_the_step_of_the_whole_matrix(seed, experiments, common, own, bounded, limited_own):
    J, _, _ = arrowhead(seed, experiments, common, own, 8)
    n, rng = J.shape[1], np.random.default_rng(seed)
    if not n:
        return
    J = J.scaled(1 / J.norms)
    matrix, gradient = J.normal_matrix() + 1e-3 * np.eye(n), rng.standard_normal(n)
    some = np.concatenate([J.common_columns, *(J.own_columns[:1] if limited_own else ())]).astype(int)
    rows = np.concatenate([np.eye(n)[some], -np.eye(n)[some]]) if bounded else np.empty((0, n))
    bounds, equal = np.full(len(rows), -0.1), np.zeros(len(rows), dtype=bool)
    whole, force = quadratic_step(matrix, gradient, rows, bounds, equal)
    step, multipliers = reduced_step(matrix, gradient, rows, bounds, equal, J.own_columns)
    np.testing.assert_allclose(step, whole, atol=1e-8 * np.abs(whole).max())
    np.testing.assert_allclose(multipliers, force, atol=1e-7 * max(np.abs(force).max(initial=0.0), 1.0))
    assert not bounded or (np.abs(step[some]) <= 0.1 + 1e-9).all()


def test_what_was_recorded_is_kept_once_for_all_candidates():
    """Of a diagram with one more block only what the block adds is made; it goes with the recording."""
    t = np.arange(300) * 0.01
    record = tsm.Record("run", t, {"x_in": np.sin(t), "x_out": np.sin(t)}, {"x_in": "rad", "x_out": "rad"})
    plain = tsm.load("tendon_sheath_linear")
    first, second = (pose(d, record)[1].experiments[0] for d in (plain, plain.insert("gap", Play(), before="x_out")))
    assert first.eq is not second.eq
    assert first.measured is second.measured
    assert first.rows is second.rows
    assert not first.rows.flags.writeable
    assert pose(plain, record, hold="zero")[1].experiments[0].rows is not first.rows
