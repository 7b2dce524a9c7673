"""What a residual far above the noise looks like: a few samples, initial states, fixed parameters, or the model."""

from __future__ import annotations

from collections.abc import Sequence
from typing import TYPE_CHECKING

import numpy as np

from tsmblocks.common.tables import listed
from tsmblocks.fitting.column_space import ColumnSpace
from tsmblocks.fitting.inner_products import square
from tsmblocks.fitting.parameters import is_start, numbers
from tsmblocks.fitting.residuals import Problem
from tsmblocks.fitting.score import Difference
from tsmblocks.fitting.setup import Setup
from tsmblocks.model.diagram import Diagram

if TYPE_CHECKING:
    from tsmblocks.fitting.result import Fit

FEW = 5
"""Samples that are a few. Chosen: a dropout or a knock of a sensor lasts no longer."""
MOST_OF_IT = 0.8
"""Share of the sum of squares that is most of it. Chosen."""
MIN_SAMPLES = 100
"""Samples of which a few are conspicuous. Chosen: noise has no such share in five of them."""
START_RATIO = 4.0
"""Largest residual, over the rms beyond the first tenth, from which it has decayed. Chosen: the response to wrong
initial states is largest in the first samples, that to an input is zero there; no motion has peaks as high."""
MOST_FIXED = 50
"""Fixed parameters that are looked at. Chosen: for the run time, a simulation each."""
EXPLAINED = 0.3
"""Share of the sum of squares that a change of one fixed parameter removes where it is named. Chosen."""
RELATIVE_STEP = 1e-4
"""Step of the derivatives by fixed parameters, relative to them. Chosen: far above rounding, and small."""
ABSORBED = 1e-6
"""Squared effect of a fixed parameter, as a share, up to which the free ones absorb it. Chosen."""
NAMED = 3
"""Fixed parameters that are named."""


def cause_text(fit: Fit, own: Sequence[Difference], *, only_fast: bool) -> str:
    """What the residual of an output, ``own`` by experiment, may come from, as the end of a sentence.

    ``only_fast``: the noise that is known is that from sample to sample, and slow noise may be larger.
    """
    if starts_wrong(fit, own):
        return (
            "it is largest at the start and decays, so the initial states may be wrong: "
            "estimate them (start_states=True, --start-states)."
        )
    held = "a bound or constraint prevents a better fit, or " if fit.active else ""
    if names := fit.fixed_in_doubt.get(own[0].output):
        held += f"{listed(names, NAMED)}, kept fixed, may be wrong (free=, --free), or "
    slow = " or the noise is slow" if only_fast else ""
    return (
        f"{held}the model lacks an effect{slow}, and the intervals do not cover it. "
        "A diagnosis (tsm.diagnose, tsmblocks diagnose) searches for it."
    )


def starts_wrong(fit: Fit, own: Sequence[Difference]) -> bool:
    """Whether a residual is that of initial states that were not estimated: by far largest in the first samples."""
    d = max(own, key=lambda one: one.largest)
    size, tenth = np.abs(d.residual), len(d.t) // 10
    decays = size.argmax() < FEW and d.largest >= START_RATIO * np.sqrt(np.mean(size[tenth:] ** 2))
    has_states = any(map(is_start, numbers(fit.diagram).values()))
    return bool(decays and has_states and not any(e.is_start for e in fit.estimates))


def spike_text(own: Sequence[Difference]) -> str:
    """Which few samples hold most of the square of a residual; empty where no few do."""
    squares = np.concatenate([d.residual**2 for d in own])
    order = np.argsort(-squares)[:FEW]
    shares = np.cumsum(squares[order]) / squares.sum()
    if len(squares) < MIN_SAMPLES or shares[-1] < MOST_OF_IT:
        return ""
    count = int(np.argmax(shares >= MOST_OF_IT)) + 1
    t, names = np.concatenate([d.t for d in own]), np.repeat([d.experiment for d in own], [len(d.t) for d in own])
    where = f"t = {t[order[0]]:.6g} s of {names[order[0]]}"
    place = f"one sample, at {where}" if count == 1 else f"{count} samples, the largest at {where}"
    return f"{100 * shares[count - 1]:.0f} % of its square in {place}"


def fixed_in_doubt(
    problem: Problem, setup: Setup, theta: np.ndarray, residuals: np.ndarray, space: ColumnSpace
) -> dict[str, tuple[str, ...]]:
    """Fixed parameters of which one, with the free ones adjusted, would remove much of the residual, by output.

    The prediction is linear, ``space`` that of the free ones; those that remove most come first.
    """
    names = _fixed(problem, setup.diagram)
    changes = _changes(problem, theta, names)
    left, own = space.project_out(residuals[:, None])[:, 0], space.project_out(changes)
    found: dict[str, tuple[str, ...]] = {}
    for i, output in enumerate(setup.outputs):
        rows = np.concatenate([np.arange(s.start, s.stop) for s in problem.segments[i :: len(setup.outputs)]])
        shares = {}
        for name, whole, z in zip(names, changes.T, own.T, strict=True):
            if square(z) > ABSORBED * square(whole):
                after = left[rows] - z[rows] * (z @ left) / square(z)
                shares[name] = 1 - square(after) / square(residuals[rows])
        doubted = sorted((k for k, share in shares.items() if share >= EXPLAINED), key=lambda k: -shares[k])
        found |= {output: tuple(doubted)} if doubted else {}
    return found


def _fixed(problem: Problem, diagram: Diagram) -> list[str]:
    """Parameters that are neither free, tied nor initial states."""
    unknowns = problem.unknowns
    moved = {item.parameter for item in unknowns.items} | {unknowns.order[k] for k in unknowns.tied}
    kept = [k for k, fields in numbers(diagram).items() if k in unknowns.order and not is_start(fields)]
    return [k for k in kept if k not in moved][:MOST_FIXED]


def _changes(problem: Problem, theta: np.ndarray, names: Sequence[str]) -> np.ndarray:
    """Change (samples, names) of the weighted outputs by a small change of each parameter; 0 where not finite."""
    unknowns, columns = problem.unknowns, np.zeros((problem.samples, len(names)))
    for e, (experiment, rows) in enumerate(zip(problem.experiments, problem.rows, strict=True)):
        p = unknowns.parameters(theta, e)
        before = experiment.residuals(experiment.outputs(p))
        for j, name in enumerate(names):
            moved, k = p.copy(), unknowns.order.index(name)
            with np.errstate(over="ignore", invalid="ignore"):  # of an infinite parameter
                moved[k] += RELATIVE_STEP * (abs(p[k]) or 1.0)
                after = experiment.residuals(experiment.outputs(moved))
            columns[rows, j] = ((after - before) * problem.weights).ravel(order="F")
    return np.where(np.isfinite(columns).all(axis=0), columns, 0.0)
