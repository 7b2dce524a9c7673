"""Residual location: the coordinates of the motion along which the residual is predictable."""

from __future__ import annotations

import itertools
from collections.abc import Mapping

import numpy as np

from tsmblocks.common.displayed_units import times
from tsmblocks.common.units import base_unit, is_unit
from tsmblocks.diagnosis.cross_validation import TimeBlocks
from tsmblocks.diagnosis.segment import ResidualCoordinate

BIN_COUNT = 24
"""Bins of a coordinate, each with as many samples. Chosen: hundreds of samples in each, and half periods resolved."""
JOINT_BIN_COUNT = 8
"""Bins of each of two coordinates taken together. Chosen: 64 joint bins."""
MAX_COORDINATES = 3
"""Coordinates reported. Chosen."""
MIN_COORDINATE_SHARE = 0.05
"""Share of the excess from which a coordinate is reported. Chosen."""
REST_SPEED_SHARE = 0.02
"""Speed, as a share of its rms, below which a motion is at rest. Chosen: above numerical differentiation noise."""
MIN_BIN_SAMPLES = 10
"""Samples of the other folds beyond which the mean of a bin is used. Chosen."""
_SINCE = "since the last reversal, with the sign of the direction"
COORDINATES = {
    "position": (0, "the error depends on the position"),
    "direction": (None, "the sign of the error depends on the direction"),
    "direction x position": (0, "the error grows with the position, with the sign of the direction"),
    "speed": (1, "the error depends on the speed"),
    "acceleration": (2, "the error depends on the acceleration"),
    "distance since reversal": (0, f"the error depends on the distance {_SINCE}"),
    "time since reversal": ("s", f"the error depends on the time {_SINCE}"),
    "session time": ("s", "the error drifts over the recordings"),
    "experiment": (None, "the error differs from experiment to experiment"),
}
"""Of each coordinate the order of the derivative of the motion that gives its unit, or the unit (None: it has none),
and the meaning of a dependence on it."""

MOTIONS = ("", "1", "rad", "m")
"""Units of signals that are motions; a coordinate of any other signal is called by the signal's name."""
OF_A_SIGNAL = {
    "the direction": "the direction of {}",
    "position": "{}",
    "speed": "rate of {}",
    "acceleration": "second derivative of {}",
    "the {}": "{}",
}
"""Words for a coordinate of a motion, and for that of a signal which is none, such as a voltage."""


def words_for(text: str, signal: str, unit: str) -> str:
    """A text on coordinates of a signal [unit]: of a voltage ``u`` the ``position`` is ``u``."""
    text = text.replace("session time", "time")
    if not signal or not is_unit(unit) or base_unit(unit) in MOTIONS:
        return text
    for motion, other in OF_A_SIGNAL.items():
        text = text.replace(motion, other)
    return text.replace("{}", signal)


def axis_title(coordinate: str, signal: str, unit: str) -> str:
    """The title of an axis of a coordinate of a signal [unit]; where it has the sign of the direction, it says so."""
    signed = coordinate.endswith("since reversal")
    return f"{'signed ' if signed else ''}{words_for(coordinate, signal, unit)}"


def coordinate_unit(coordinate: str, unit: str) -> str:
    """The unit of a coordinate of a signal [unit], displayed as the signal is; empty where none is known."""
    order, _ = COORDINATES[coordinate]
    if not isinstance(order, int):
        return order or ""
    for _ in range(order if unit else 0):
        unit = times(unit, "s", -1)
    return unit


def coordinates(t: np.ndarray, x: np.ndarray, experiment: int) -> dict[str, np.ndarray]:
    """Coordinates (n,) that may predict the residual, from the motion ``x`` (n,) at the instants ``t`` (n,) [s]."""
    v = np.gradient(x, t)
    a = np.gradient(v, t)
    still = np.abs(v) < REST_SPEED_SHARE * np.sqrt(np.mean(v**2)) if np.any(v) else np.ones(len(v), dtype=bool)
    side = np.where(still, 0.0, np.sign(v))
    moving = np.flatnonzero(side)
    if len(moving):  # at rest the direction of the last motion remains
        side = side[np.maximum.accumulate(np.where(side != 0, np.arange(len(side)), moving[0]))]
    last_reversal = np.maximum.accumulate(np.where(np.diff(side, prepend=side[0]) != 0, np.arange(len(side)), 0))
    return {
        "position": x,
        "direction": side,
        "direction x position": side * x,
        "speed": v,
        "acceleration": a,
        "distance since reversal": side * np.abs(x - x[last_reversal]),
        "time since reversal": side * (t - t[last_reversal]),
        "session time": t,
        "experiment": np.full(len(t), float(experiment)),
    }


def residual_coordinates(
    r: np.ndarray, known: Mapping[str, np.ndarray], blocks: TimeBlocks, excess: float, of: tuple[str, str] = ("", "")
) -> tuple[ResidualCoordinate, ...]:
    """The coordinates that predict most of the residual ``r`` (N,), on held-out blocks.

    ``excess`` is the mean square of ``r`` above the noise's; ``of`` are name and unit of the signal that moves.
    """
    if excess <= 0:
        return ()
    varying = {name: values for name, values in known.items() if np.ptp(values) > 0}  # of one experiment none differs
    shares = {name: _share(r, binned(values, BIN_COUNT), blocks.fold, excess) for name, values in varying.items()}
    found = [
        ResidualCoordinate(name, min(share, 1.0), words_for(COORDINATES[name][1], *of))
        for name, share in shares.items()
    ]
    best = sorted(found, key=lambda one: -one.share)[:MAX_COORDINATES]
    return tuple(one for one in best if one.share >= MIN_COORDINATE_SHARE)


def explainable_share(r: np.ndarray, known: Mapping[str, np.ndarray], blocks: TimeBlocks, excess: float) -> float:
    """Largest share of the excess that two coordinates together predict on held-out blocks."""
    if excess <= 0:
        return 0.0
    pairs = itertools.combinations([binned(values, JOINT_BIN_COUNT) for values in known.values()], 2)
    shares = (_share(r, one * JOINT_BIN_COUNT + other, blocks.fold, excess) for one, other in pairs)
    return min(max([0.0, *shares]), 1.0)


def binned(values: np.ndarray, count: int) -> np.ndarray:
    """The bin of each sample, bins of about equal counts; a coordinate of few values has a bin for each."""
    own = np.unique(values)
    if len(own) <= count:
        return np.searchsorted(own, values)
    edges = np.quantile(values, np.linspace(0, 1, count + 1)[1:-1])
    return np.searchsorted(np.unique(edges), values)


def _share(r: np.ndarray, bins: np.ndarray, fold: np.ndarray, excess: float) -> float:
    """Fall of the mean square, as a share of the excess, when each bin's mean over the other folds is subtracted."""
    count, folds = int(bins.max()) + 1, int(fold.max()) + 1
    place = bins * folds + fold
    total = np.bincount(place, r, count * folds).reshape(count, folds)
    number = np.bincount(place, minlength=count * folds).reshape(count, folds)
    others = number.sum(axis=1, keepdims=True) - number
    mean = (total.sum(axis=1, keepdims=True) - total) / np.maximum(others, 1)
    remaining = r - np.where(others > MIN_BIN_SAMPLES, mean, 0.0).ravel()[place]
    return float((np.mean(r**2) - np.mean(remaining**2)) / excess)
