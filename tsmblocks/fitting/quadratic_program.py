"""The step of a Gauss-Newton method: a small strictly convex quadratic programme, by a dual active set."""

from __future__ import annotations

import numpy as np

from tsmblocks.common.errors import RunError

CLOSE = 1e-11
"""A constraint missed by less (in scaled units) counts as met."""
SINGULAR = 1e-15
"""Eigenvalues of a matrix are not taken below this share of the largest one: less is rounding."""


class Infeasible(RunError):
    """No point meets all constraints of a step."""


def quadratic_step(
    matrix: np.ndarray, gradient: np.ndarray, rows: np.ndarray, bounds: np.ndarray, equal: np.ndarray
) -> tuple[np.ndarray, np.ndarray]:
    r"""Minimise a strictly convex quadratic under linear constraints.

    .. math:: \min_d \tfrac12 d^T H d + g^T d \quad\text{with}\quad R d \ge b

    ``matrix`` H (n, n) positive definite, ``gradient`` g (n,), ``rows`` R (m, n), ``bounds`` b (m,); where
    ``equal`` (m,) the row holds with equality. Returns d (n,) and the multipliers (m,). Raises
    Infeasible. Source: Goldfarb and Idnani, Math. Programming 27 (1983) 1, with dense factors made anew
    at each change, since n is small.
    """
    values, vectors = np.linalg.eigh(matrix)
    inverse = vectors / np.maximum(values, SINGULAR * values[-1]) @ vectors.T
    d = -inverse @ gradient
    size = np.sqrt(np.einsum("ij,jk,ik->i", rows, inverse, rows)) + 1e-300
    active: list[int] = []
    force = np.zeros(len(bounds))
    sign = np.ones(len(bounds))
    for _ in range(50 * (len(bounds) + len(d) + 1)):
        missed = (rows @ d - bounds) / size
        missed = np.where(equal, -np.abs(missed), missed)
        missed[active] = 0.0
        worst = int(np.argmin(missed)) if len(missed) else 0
        if not len(missed) or missed[worst] >= -CLOSE * (1 + abs(bounds[worst]) / size[worst]):
            return d, force * sign
        sign[worst] = -1.0 if equal[worst] and rows[worst] @ d > bounds[worst] else 1.0
        d = _enter(worst, d, inverse, rows * sign[:, None], bounds * sign, equal, active, force)
    raise Infeasible("the step of the fit did not settle on a set of active constraints.")


def _enter(
    p: int,
    d: np.ndarray,
    inverse: np.ndarray,
    rows: np.ndarray,
    bounds: np.ndarray,
    equal: np.ndarray,
    active: list[int],
    force: np.ndarray,
) -> np.ndarray:
    """Bring constraint ``p`` into the active set, dropping those that let go; changes ``active`` and ``force``."""
    while True:
        normal = inverse @ rows[p]
        held = rows[active]
        share = np.linalg.lstsq(held @ inverse @ held.T, held @ normal, rcond=None)[0] if active else np.empty(0)
        move = normal - inverse @ held.T @ share if active else normal
        gain = float(move @ rows[p])
        loose = [(force[k] / s, k) for k, s in zip(active, share, strict=True) if s > 1e-13 and not equal[k]]
        longest, leaving = min(loose, default=(np.inf, -1))
        needed = float(bounds[p] - rows[p] @ d)
        whole = needed / gain if gain > 1e-12 * float(normal @ rows[p]) else np.inf
        length = min(longest, whole)
        if not np.isfinite(length):
            raise Infeasible("no step meets all constraints at once.")
        if np.isfinite(whole):
            d = d + length * move
        force[active] -= length * share
        force[p] += length
        if whole <= longest:
            active.append(p)
            return d
        active.remove(leaving)
        force[leaving] = 0.0
