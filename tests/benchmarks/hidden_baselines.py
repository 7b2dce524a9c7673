"""What others would say of the same residual: sparse regression on a library of functions of position and speed.

A term stands for every effect that it could mean, and a name counts as right if any of them is; that is generous.
What the base leaves is regressed, as the diagnosis shows it: measured less simulated, with the base fitted.
"""

from __future__ import annotations

import sys
from collections.abc import Sequence
from functools import cache
from typing import Any

import numpy as np

from tsmblocks.diagnosis.decision import MIN_VARIANCE_REDUCTION

THRESHOLD = 0.1
"""Coefficient, of columns and residual scaled to unit rms, below which STLSQ drops a term."""
RIDGE = 0.05
"""STLSQ's weight against large coefficients: its own default."""
MEANS = {
    "1": ("drift", "jump", "load_offset", "creep"),
    "x": ("saturation", "parameter_change", "creep"),
    "v": ("dead_time", "first_order_lag", "resonance", "rate_dependence"),
    "a": ("first_order_lag", "resonance", "dead_time"),
    "x^2": ("even_nonlinearity", "dead_zone"),
    "|x|": ("even_nonlinearity", "dead_zone"),
    "x^3": ("odd_nonlinearity", "saturation"),
    "x|x|": ("odd_nonlinearity", "saturation"),
    "sgn v": ("backlash", "coulomb_friction", "nonlocal_memory"),
    "x sgn v": ("asymmetric_hysteresis", "position_dependent_friction", "nonlocal_memory"),
    "x^2 sgn v": ("asymmetric_hysteresis", "position_dependent_friction", "nonlocal_memory"),
    "|x| sgn v": ("position_dependent_friction", "nonlocal_memory", "backlash"),
    "|v|": ("rate_dependence", "asymmetric_friction", "asymmetric_hysteresis"),
    "v|v|": ("rate_dependence", "rate_limit", "quadratic_drag"),
    "v^3": ("rate_limit", "rate_dependence"),
    "v^2": ("rate_dependence",),
    "x v": ("position_dependent_friction", "rate_dependence"),
    "t": ("drift", "creep", "jump"),
    "t^2": ("drift", "creep"),
    **{f"{f} {n}x": ("position_ripple",) for n in range(3, 16) for f in ("cos", "sin")},
}
"""Term -> effects that it may stand for."""


def baseline(segment: Any) -> dict[str, dict[str, Any]]:
    """What each way names for the residual of a segment: terms, effects, share of the excess removed in sample."""
    r, table, known = _data(segment)
    names, columns = list(table), np.column_stack(list(table.values()))
    noise = float(segment.noise_floor[segment.outputs[0]]) ** 2
    excess = max(float(np.mean(r**2)) - noise, 1e-300)
    made = {"first term by error reduction": _named(names, [_strongest(columns, r)], columns, r, excess, noise)}
    clear, rest = _without(columns, known), _without(r[:, None], known)[:, 0]
    best = [_strongest(clear, rest)]
    made["first term, base's signals taken off"] = _named(names, best, clear, rest, excess, noise)
    chosen = _stlsq(columns, r)
    if chosen is not None:
        made["PySINDy, STLSQ"] = _named(names, chosen, columns, r, excess, noise)
    return made


def _data(segment: Any) -> tuple[np.ndarray, dict[str, np.ndarray], np.ndarray]:
    """Residual (N,), library (each N,), and signals of the base (N, 3) that it can scale and shift by itself."""
    parts, residual, simulated = [], [], []
    for trace in segment.traces:
        v = np.gradient(trace.drive, trace.t)
        parts.append((trace.drive, v, np.gradient(v, trace.t), trace.t))
        residual.append(trace.measured - trace.before)
        simulated.append(trace.before)
    x, v, a, t = (np.concatenate(one) for one in zip(*parts, strict=True))
    still = np.abs(v) < 0.02 * np.sqrt(np.mean(v**2))
    side, t = np.where(still, 0.0, np.sign(v)), (t - t.mean()) / np.ptp(t)
    table = {
        "1": np.ones_like(x),
        "x": x,
        "v": v,
        "a": a,
        "x^2": x**2,
        "|x|": np.abs(x),
        "x^3": x**3,
        "x|x|": x * np.abs(x),
        "sgn v": side,
        "x sgn v": side * x,
        "x^2 sgn v": side * x**2,
        "|x| sgn v": side * np.abs(x),
        "|v|": np.abs(v),
        "v|v|": v * np.abs(v),
        "v^3": v**3,
        "v^2": v**2,
        "x v": x * v,
        "t": t,
        "t^2": t**2,
    }
    for n in range(3, 16):
        table |= {f"cos {n}x": np.cos(n * x), f"sin {n}x": np.sin(n * x)}
    y = np.concatenate(simulated)
    return np.concatenate(residual), table, np.column_stack([np.ones_like(x), x, y])


def _strongest(columns: np.ndarray, r: np.ndarray) -> int:
    size = np.sqrt((columns**2).sum(axis=0))
    return int(np.argmax(np.abs(columns.T @ r) / np.where(size > 1e-9 * size.max(), size, np.inf)))


def _without(columns: np.ndarray, known: np.ndarray) -> np.ndarray:
    basis, _ = np.linalg.qr(known)
    return columns - basis @ (basis.T @ columns)


def _named(
    names: Sequence[str], chosen: Sequence[int], columns: np.ndarray, r: np.ndarray, excess: float, noise: float
) -> dict[str, Any]:
    """Terms from strongest to weakest; the first says what is named, if all together are worth a name."""
    if not len(chosen):
        return dict(terms=[], names=[], removed=0.0)
    used = columns[:, chosen]
    weights = np.linalg.lstsq(used, r, rcond=None)[0]
    fall = float(np.mean(r**2) - np.mean((r - used @ weights) ** 2))
    order = np.argsort(-np.abs(weights) * np.sqrt((used**2).mean(axis=0)))
    terms = [names[chosen[k]] for k in order]
    return dict(
        terms=terms,
        names=list(MEANS[terms[0]]) if fall > MIN_VARIANCE_REDUCTION * noise else [],
        removed=min(fall / excess, 1.0),
    )


def _stlsq(columns: np.ndarray, r: np.ndarray) -> list[int] | None:
    optimizer = _optimizer()
    if optimizer is None:
        return None
    size = np.sqrt((columns**2).mean(axis=0))
    optimizer.fit(columns / size, r[:, None] / np.sqrt(np.mean(r**2)))
    return [int(k) for k in np.flatnonzero(np.ravel(optimizer.coef_))]


@cache
def _optimizer() -> Any:
    try:
        import pysindy
    except ImportError as error:
        print(f"PySINDy is left out, its rows will be missing: {error}", file=sys.stderr, flush=True)
        return None
    return pysindy.STLSQ(threshold=THRESHOLD, alpha=RIDGE)
