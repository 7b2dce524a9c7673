"""A model error proportional to the motion with a factor that varies slowly, such as a gain or a damping that drifts.

No function of the motion predicts it, since the factor is different each time. But over a time in which the factor is
constant, the residual is proportional to the position, speed, direction or acceleration; noise is not.
"""

from __future__ import annotations

from collections.abc import Iterator, Mapping, Sequence

import attrs
import numpy as np

from tsmblocks.common.rounding import to_digits
from tsmblocks.diagnosis.evidence import (
    DRAWS,
    SIGNIFICANCE_LEVEL,
    derivatives,
    distinct_motions,
    is_material,
    scale,
    times,
)
from tsmblocks.diagnosis.model import Model
from tsmblocks.diagnosis.partition import rows_of_experiments
from tsmblocks.diagnosis.surrogates import rolled

HALVINGS = 5
"""Lengths of windows, each half of the one before. Chosen: from the third to the fiftieth part of an experiment."""
LONGEST_WINDOWS = 3
"""Windows of the longest kind in the longest experiment. Chosen: with fewer, a drift of the noise is proportional to
the motion by chance."""
PARTS = 4
"""Parts of a window, whose signs are drawn for surrogates. Chosen: so few that noise is seldom alike in two of them."""
DIRECTION_STEEPNESS = 3.0
"""Steepness of the change of direction [1 / rms speed]. Chosen: a change that is not resolved is no direction."""
LEAST_WEIGHT = 0.01
"""Mean square of a coordinate that is added to that of each window [that of the experiment]. Chosen: rests count
little."""
AS_LARGE = 0.8
"""Share of what the best windows explain from which longer ones do as well, and from which a curve does, so that the
factor does not vary with time. Chosen: one change within a window of five."""
CURVE_DEGREE = 5
"""Degree of that curve, beside the magnitude of the coordinate. Chosen: a bend, a limit or a dead zone to a tenth."""
COORDINATES = ("position", "speed", "direction", "acceleration")
"""Coordinates of each signal to which the residual may be proportional."""

Explained = tuple[tuple[int, str, str], int, np.ndarray]
"""Output, signal and coordinate; halvings of the longest windows; shares explained, of the residual and surrogates."""


@attrs.frozen
class VaryingFactor:
    """The coordinate to which a residual is proportional by a factor that varies.

    ``share`` is the share of the mean square that is proportional to it, beyond that of noise; ``window`` is the time
    [s] over which the factor is taken for constant.
    """

    signal: str
    coordinate: str
    window: float
    share: float
    significant: bool

    @property
    def material(self) -> bool:
        """Whether it is significant, and large enough to be of interest."""
        return self.significant and is_material(self.share)

    @property
    def words(self) -> str:
        """The coordinate and the time in words."""
        kind, _, name = self.signal.partition(" ")
        return (
            f"the {self.coordinate} of {name} ({kind}), by a factor that varies within about {to_digits(self.window)} s"
        )


def varying_factor(model: Model, seed: int) -> VaryingFactor | None:
    """The coordinate to which the residual is proportional by a varying factor, if to any; None where nothing moves.

    The share that a factor for each window explains is held against two kinds of surrogates, and has to exceed both:
    residuals rolled in time, which keep their autocorrelation, and residuals with random signs of their parts, which
    keep where they are large (jitter of the clock is large where the motion is fast, and is noise all the same). What a
    curve of the coordinate explains as well does not vary.
    """
    draw, t = np.random.default_rng(seed), times(model)
    counts = [max(1, round(LONGEST_WINDOWS * (x[-1] - x[0]) / max(y[-1] - y[0] for y in t))) for x in t]
    found: list[Explained] = []
    coordinates = list(_coordinates(model, t))
    of_outputs = [
        [model.r[rows] for rows in rows_of_experiments(model, output).values()]
        for output in range(len(model.setup.outputs))
    ]
    for output, residuals in enumerate(of_outputs):
        rolls = [np.column_stack([r, rolled(r, DRAWS, draw)]) for r in residuals]
        total = sum(float(r @ r) for r in residuals)
        for signal, coordinate, values in coordinates:
            every = [_explained(r, x, n, draw) for r, x, n in zip(rolls, values, counts, strict=True)]
            shares = np.sum(every, axis=0) / max(total, 1e-300)
            found += [((output, signal, coordinate), halving, own) for halving, own in enumerate(shares)]
    if not found:
        return None
    (output, *name), varying = _most_significant(found, max(x[-1] - x[0] for x in t))
    values = next(values for *own, values in coordinates if own == name)
    constant = varying.significant and _share_of_curve(of_outputs[output], values) >= AS_LARGE * varying.share
    return attrs.evolve(varying, significant=varying.significant and not constant)


def _share_of_curve(residuals: Sequence[np.ndarray], values: Sequence[np.ndarray]) -> float:
    """Share of the sum of squares of residuals that one curve of a coordinate explains in all experiments."""
    r, x = np.concatenate([one - one.mean() for one in residuals]), np.concatenate(values)
    x = x / max(float(np.abs(x).max()), 1e-300)
    basis = np.column_stack([np.polynomial.legendre.legvander(x, CURVE_DEGREE), np.abs(x)])
    rest = r - basis @ np.linalg.lstsq(basis, r, rcond=None)[0]
    return 1 - float(rest @ rest) / max(float(r @ r), 1e-300)


def _most_significant(found: Sequence[Explained], length: float) -> tuple[tuple[int, str, str], VaryingFactor]:
    """The coordinate and window whose share is farthest above the maxima of both kinds of surrogates, with its name."""
    noise = np.array([shares for *_, shares in found])[:, 1:].reshape(len(found), 2, DRAWS)
    share = np.array([shares[0] for *_, shares in found])
    mean, spread = noise.mean(axis=2), np.maximum(noise.std(axis=2), 1e-12)
    distance = (share[:, None] - mean) / spread
    critical = np.quantile(
        ((noise - mean[:, :, None]) / spread[:, :, None]).max(axis=0), 1 - SIGNIFICANCE_LEVEL, axis=1
    )
    best, significant = int(np.argmax((distance / critical).min(axis=1))), (distance > critical).all(axis=1)
    name, halving, _ = found[best]
    removed = share - mean.max(axis=1)
    longer = (  # of a factor that changes once the shortest windows tell most, and most of them are not needed
        halved
        for k, (alike, halved, _) in enumerate(found)
        if alike == name and significant[k] and removed[k] >= AS_LARGE * removed[best]
    )
    return name, VaryingFactor(
        *name[1:],
        length / (LONGEST_WINDOWS << min(longer, default=halving)),
        float(removed[best]),
        bool(significant[best]),
    )


def _explained(r: np.ndarray, x: np.ndarray, longest: int, draw: np.random.Generator) -> np.ndarray:
    """Sum of squares that a factor of ``x`` (N,) for each window explains, shape (halvings, 1 + 2 draws).

    Of the residual, the first column of ``r`` (N, 1 + draws), of its rolled surrogates, the other columns, and of
    surrogates with random signs of the parts of the windows. ``longest`` is the number of the longest windows.
    """
    edges = np.linspace(0, len(x), (PARTS * longest << (HALVINGS - 1)) + 1).astype(int)[:-1]
    products, weight = np.add.reduceat(r * x[:, None], edges, axis=0), np.add.reduceat(x * x, edges)
    result = []
    for halving in range(HALVINGS):
        windows = longest << halving
        parts = products.reshape(PARTS * windows, -1, r.shape[1]).sum(axis=1)
        parts = np.column_stack([parts, draw.choice([-1.0, 1.0], size=(len(parts), DRAWS)) * parts[:, :1]])
        least = LEAST_WEIGHT * float(x @ x) / windows + 1e-300
        moments = parts.reshape(windows, PARTS, -1).sum(axis=1)
        result.append((moments**2 / (weight.reshape(windows, -1).sum(axis=1) + least)[:, None]).sum(axis=0))
    return np.array(result)


def _coordinates(model: Model, t: Sequence[np.ndarray]) -> Iterator[tuple[str, str, list[np.ndarray]]]:
    """Signal, coordinate and its values in each experiment, without their mean."""
    for signal, values in distinct_motions(model).items():
        middle, reach = scale(values)
        every: Mapping[str, list[np.ndarray]] = {name: [] for name in COORDINATES}
        for own, x in zip(t, values, strict=True):
            s, v, a = derivatives(own, x, middle, reach)
            for name, one in zip(COORDINATES, (s, v, np.tanh(DIRECTION_STEEPNESS * v), a), strict=True):
                every[name].append(one - one.mean())
        for name, columns in every.items():
            yield signal, name, columns
