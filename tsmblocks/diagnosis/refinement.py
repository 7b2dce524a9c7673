"""The last model at a step at which its confidence intervals cover the discretisation error."""

from __future__ import annotations

from collections.abc import Collection

import attrs
import numpy as np

from tsmblocks.common.errors import TsmError
from tsmblocks.common.interrupt import checkpoint
from tsmblocks.diagnosis.determined import uncertainty_of_effects
from tsmblocks.diagnosis.model import FINE_TOLERANCE, Model, end_at, optimized
from tsmblocks.fitting.identifiability import UNCERTAIN
from tsmblocks.fitting.result import Fit
from tsmblocks.fitting.setup import FINEST
from tsmblocks.fitting.statistics import intervals, uncertainty
from tsmblocks.fitting.step_size import COVERED, halved, limit_note, shift_note, shifts
from tsmblocks.fitting.summary import summarise


def with_fine_step(model: Model, given: bool) -> tuple[Model, list[str]]:
    """A model refitted at finer steps until halving the step moves no parameter beyond its interval, and notes.

    Candidates are compared at one step, chosen for the base; with an effect in front of a plant that depends on rates
    the same step may bias the parameters. A step that was ``given`` stays, with a note on the bias.
    Raises KeyboardInterrupt where the search is to end.
    """
    first = model.setup.experiments[0].times.h
    if len(model.r) <= len(model.theta):
        return model, []
    while True:
        checkpoint()
        if (half := halved(model.problem, model.setup)) is None:
            return model, []
        problem, setup = half
        estimate = uncertainty(model.J, model.r, model.problem.segments, held=_active_bounds(model))
        low, high = intervals(model.theta, estimate.covariance, estimate.freedom)
        off = shifts(model.r, problem.residuals(model.theta), model.J, (high - low) / 2, held=_active_bounds(model))
        step = model.setup.experiments[0].times.h
        if given or not np.max(off, initial=0.0) > COVERED or step / 2 < first / FINEST or not np.isfinite(off).all():
            refitted = (
                f"the parameters were refitted at a step of {step:.3g} s, since they depended on the step of "
                f"{first:.3g} s at which the candidates were compared."
            )
            return model, [refitted] * (step != first) + shift_note(model.problem.unknowns.names, off, step)
        model = optimized(problem, setup, model.theta, FINE_TOLERANCE)


def limit_notes(model: Model, corners: Collection[str] = ()) -> list[str]:
    """Limits that the parameters common to all experiments reached: bounds, and the limit of the step.

    At the lower bound of one of ``corners`` (full names), which smooth a corner, that is sharp, and no note is made.
    """
    items, low = model.problem.unknowns.items, model.theta - model.problem.unknowns.low
    high, notes = model.problem.unknowns.high - model.theta, limit_note(model.problem, model.theta)
    for k in np.flatnonzero(model.at_bound & ~model.is_local):
        side, bound = ("lower", items[k].low) if low[k] <= high[k] else ("upper", items[k].high)
        if side == "lower" and items[k].parameter in corners:
            continue
        notes.append(f"{items[k].name} ended at its {side} bound ({bound:.4g} {items[k].unit}".rstrip() + ").")
    return notes


def as_fit(model: Model, base: Model, corners: Collection[str] = ()) -> Fit | None:
    """The model as a result of ``tsm.fit``, with the uncertainty by which its effects are judged beside the ``base``.

    Bounds of effects are those of the search: an interval that is wider than these may be narrow; ``corners`` are sharp
    at theirs, as for ``limit_notes``. None where the parameters are ones that a fit refuses.
    """
    found = end_at(model.problem, model.theta)
    known = uncertainty_of_effects(model, base) if len(model.r) > len(model.theta) else None
    try:
        fit = summarise(model.problem, model.setup, "gauss-newton", [found], known)
    except TsmError:
        return None
    added = {e.name for e in fit if (e.high - e.low) / 2 <= abs(e.value)} - set(base.problem.unknowns.names)
    kept = tuple(one for one in fit.undetermined if one.kind != UNCERTAIN or added.isdisjoint(one.names))
    active = tuple(text for text in fit.active if "lower" not in text or set(corners).isdisjoint(text.split()))
    return attrs.evolve(fit, undetermined=kept, active=active)


def _active_bounds(model: Model) -> np.ndarray | None:
    """Gradients (m, n) of the active bounds."""
    return np.eye(len(model.theta))[model.at_bound] if model.at_bound.any() else None
