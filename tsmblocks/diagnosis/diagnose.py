"""``diagnose``: find where a model and recordings disagree, name the unmodelled effect, add it, validate held out.

For each part of the diagram (``_diagnosed``): filter the noise of inputs, estimate the noise floor, fit the base
(``preparation``), search for effects round by round, exchange early choices, and refine the step.
"""

from __future__ import annotations

import contextlib
import functools
import math
from collections.abc import Collection, Iterable, Mapping, Sequence
from typing import Any

import attrs
import numpy as np

from tsmblocks.common.arguments import as_positive
from tsmblocks.common.errors import RunError
from tsmblocks.common.interpolation import AUTO, Hold
from tsmblocks.common.interrupt import defer_interrupt, without_checkpoints
from tsmblocks.common.one_thread import on_one_thread
from tsmblocks.diagnosis.acceptance import accepted_count
from tsmblocks.diagnosis.arguments import Request, checked
from tsmblocks.diagnosis.assembly import assembled
from tsmblocks.diagnosis.commands import OtherCommands, delays_if_held
from tsmblocks.diagnosis.credibility import notes_on_moved
from tsmblocks.diagnosis.cross_validation import time_blocks
from tsmblocks.diagnosis.diagnosed_part import DiagnosedPart, Omission
from tsmblocks.diagnosis.effects_or_noise import beside_inputs, exceeds_noise, without_effects_of_noise
from tsmblocks.diagnosis.evidence import Evidence, evidence
from tsmblocks.diagnosis.exchange import exchange_effects
from tsmblocks.diagnosis.exchangeable import exchange_notes
from tsmblocks.diagnosis.forward_selection import forward_search
from tsmblocks.diagnosis.initial_states import clip_idle_memories
from tsmblocks.diagnosis.input_noise import correlated_noise, factor_beside, input_noise_rms, noise_left_in
from tsmblocks.diagnosis.model import Model, ProgressCallback, nearest
from tsmblocks.diagnosis.noise_floor import doubtful_floors, noise_level
from tsmblocks.diagnosis.outliers import outlier_notes
from tsmblocks.diagnosis.partition import partition
from tsmblocks.diagnosis.plain_states import with_plain_states
from tsmblocks.diagnosis.preparation import DELAY, Prepared, prepared, prepared_again
from tsmblocks.diagnosis.quantities import recorded_units
from tsmblocks.diagnosis.recurring_events import without_recurring_events
from tsmblocks.diagnosis.refinement import limit_notes, with_fine_step
from tsmblocks.diagnosis.result import Diagnosis
from tsmblocks.diagnosis.search_rounds import SearchContext, SearchRound
from tsmblocks.diagnosis.stand_in import stands_in
from tsmblocks.diagnosis.time_and_distance import only_frequency
from tsmblocks.diagnosis.undetermined import determined_count, without_undetermined
from tsmblocks.diagnosis.varying_factor import varying_factor
from tsmblocks.fitting.recordings import Data
from tsmblocks.fitting.scale_notes import scale_notes_before
from tsmblocks.fitting.text import flipped_gains
from tsmblocks.model.diagram import Diagram

MANY_TIMES = 5.0
"""Error of an output over that which its sensor and the inputs explain, from which it is a model error. Chosen: noise
of inputs is taken for up to four times what is seen of it."""


@on_one_thread
def diagnose(
    diagram: Diagram,
    experiments: Data,
    *,
    free: Iterable[str] | None = None,
    noise_floor: Any = None,
    effects: Iterable[str] | None = None,
    outputs: Sequence[str] | None = None,
    window: Any = None,
    start_states: bool = True,
    condition: bool = True,
    seed: int = 0,
    step: float | None = None,
    integrator: str = "rk4",
    hold: Hold = AUTO,
    bounds: Mapping[str, Any] | None = None,
    local: Iterable[str] | None = None,
    time_limit: float | None = None,
    progress: ProgressCallback | None = None,
) -> Diagnosis:
    """Name the effect that a model lacks, add its block to the diagram, and validate it on held-out data.

    The diagram is cut at its measured signals (a closed loop stays whole) and its own parameters are fitted. Then each
    effect of the catalogue is tried on every admissible signal, fitted together with the base, and judged by its loss
    on held-out time blocks. It is named where it removes at least 6 % of the noise variance, significantly, and half of
    the variance above the noise floor. Effects that are indistinguishable from it with these data are listed beside it.

    After Ctrl-C, or at the time limit, the effects named so far are returned with ``status`` ``"interrupted"`` or
    ``"limit"``.

    Parameters
    ----------
    diagram : Diagram
        The model. Signals of the recordings are matched by name to its inputs and outputs.
    experiments : Record, list of Record, mapping of str to Record, or path
        The recordings, as for ``tsm.fit``; several with different amplitudes and frequencies separate more effects.
    free : iterable of str, optional
        Names or patterns of the parameters of the diagram that are fitted. Default: all but initial states
        and those that a block declares as known.
    noise_floor : float, str or mapping of str to these, optional
        Rms noise of the outputs, one for all or by output: ``"0.06deg"``, ``{"x_out": "0.06deg"}``. A number is in the
        unit of the recordings, of the diagram and of all outputs, and refused where those differ. Default: estimated
        from the recordings (repeats, periods, rests).
    effects : iterable of str, optional
        Names or patterns of the effects to try. Default: all of the catalogue.
    outputs : sequence of str, optional
        The outputs that are compared. Default: all that were measured.
    window : pair of float, or mapping of str to pairs, optional
        The part (start, stop) [s] that is compared, one for all or by experiment; the simulation starts with the
        recording all the same. Default: all of it.
    start_states : bool, default True
        Whether initial states are estimated for each experiment.
    condition : bool, default True
        Whether noise of measured inputs, which would drive hysteresis, is filtered out (zero phase, held at rest).
    seed : int, default 0
        Seed of the random parts: the same data and the same seed give the same result.
    step : float, optional
        Step [s] of the simulation. Default: chosen, finer where confidence intervals would not cover its error.
    integrator : str, default "rk4"
        Integration method, as for ``tsm.simulate``.
    hold : {"auto", "zero", "linear", "cubic"}, or mapping of str to these, default "auto"
        How inputs are interpolated between samples, one for all or by input, as for ``tsm.simulate``.
    bounds : mapping of str to (float, float), optional
        Lower and upper bounds of parameters of the diagram, by name or pattern, as for ``tsm.fit``.
    local : iterable of str, optional
        Names or patterns of parameters of the diagram with a separate value in each experiment.
    time_limit : float, optional
        Time [s] after which the search ends as after Ctrl-C; the results until then are summarised. Default: none.
    progress : callable, optional
        Called as ``progress(stage, done, of)`` now and then.

    Returns
    -------
    Diagnosis
        Verdict, effects with confidence intervals, errors before and after, and the augmented diagram.

    Raises
    ------
    DataError
        For missing signals, fewer than 200 samples in all, or outputs without any noise.
    ParameterError
        For unknown names, or a noise floor in an unclear unit.
    RunError
        At the time limit before the first candidates were fitted.
    KeyboardInterrupt
        After Ctrl-C before the first candidates were fitted.

    Examples
    --------
    >>> import numpy as np, tsmblocks as tsm
    >>> t = np.arange(0.0, 10.0, 0.02)
    >>> x, model = np.sin(1.3 * t) + 0.3 * np.sin(5.1 * t), tsm.load("tendon_sheath_linear")
    >>> worn = model.insert("gap", tsm.blocks.Play(half_width=0.05), before="x_out")
    >>> y = tsm.simulate(worn, inputs={"x_in": (t, x)}, stop=t[-1], step=0.02)["x_out"]
    >>> y += np.random.default_rng(0).normal(0.0, 0.01, t.size)
    >>> record = tsm.Record("run", t, {"x_in": x, "x_out": y}, {"x_in": "rad", "x_out": "rad"})
    >>> tsm.diagnose(model, record, noise_floor=0.01, effects=["backlash", "drift"])
    Diagnosis('Tendon sheath: a gain and an offset', named: backlash on offset.y -> x_out)
    """
    request = checked(
        diagram,
        experiments,
        free=free,
        noise_floor=noise_floor,
        effects=effects,
        outputs=outputs,
        window=window,
        start_states=start_states,
        condition=condition,
        seed=seed,
        step=step,
        integrator=integrator,
        hold=hold,
        bounds=bounds,
        local=local,
        progress=progress,
    )
    limit = None if time_limit is None else as_positive("time_limit", time_limit)
    done, interrupted, notes = list[DiagnosedPart](), False, _notes_before(request)
    with defer_interrupt(limit) as stop, np.errstate(over="ignore", invalid="ignore"):  # of diverged simulations

        def report(stage: str, count: int, of: int) -> None:
            stop.check()
            if progress is not None:
                progress(stage, count, of)

        parts, given = iter(partition(request.diagram, request.measured)), request
        while not interrupted and (part := next(parts, None)) is not None:
            try:
                ready = prepared(part, given, report)
                one, interrupted, more = _diagnosed_beside_noise(ready, report)
                done, notes, given = [*done, one], [*notes, *more], ready.request_of_next_part
            except KeyboardInterrupt:  # before the first candidates of this part were fitted
                interrupted = True
        timed_out = interrupted and stop.timed_out and not stop.stop
    if not done:
        raise _without_result(limit) if timed_out else KeyboardInterrupt
    notes += [f"the search ended at its time limit of {limit:g} s."] if timed_out else []
    return assembled(request, done, notes, "limit" if timed_out else "interrupted" if interrupted else "done")


def _notes_before(request: Request) -> list[str]:
    """Notes on the recordings, and on what the diagram's own parameters show of them."""
    given = request.settings
    more = scale_notes_before(
        request.diagram,
        request.records,
        outputs=request.measured,
        window=given.window,
        step=given.step,
        integrator=given.integrator,
        hold=given.hold,
    )
    return request.notes + more


def _without_result(limit: float | None) -> RunError:
    """The error at a time limit [s] before the first candidates were fitted."""
    return RunError(
        f"the time limit of {limit:g} s was over before the first candidates were fitted, so there is no verdict. "
        "Give it more time, fewer effects or shorter recordings."
    )


def _diagnosed_beside_noise(ready: Prepared, progress: ProgressCallback) -> tuple[DiagnosedPart, bool, list[str]]:
    """As ``_diagnosed``, and once more with residuals that are not whitened where a model error is not named.

    Beside noise of the inputs, effects that act as an input does are less distinct. An error that is far above such
    noise needs no whitening.
    """
    one, interrupted, notes = _diagnosed(ready, progress)
    if interrupted or ready.plain is None or one.count or not (_is_unknown(one) or _is_far_above_noise(one)):
        return one, interrupted, notes
    try:
        other, interrupted, more = _diagnosed(ready.plain, progress)
    except KeyboardInterrupt:  # before its first candidates were fitted
        return one, True, notes
    return (other, interrupted, more) if other.count or _is_unknown(other) else (one, interrupted, notes)


def _is_unknown(one: DiagnosedPart) -> bool:
    """Whether no effect is named, and more than noise is left."""
    return not one.count and (one.leaves_predictable or one.is_irregular)


def _is_far_above_noise(one: DiagnosedPart) -> bool:
    """Whether the error of an output is many times that of its sensor and of the inputs."""
    rms = one.final.residual_rms_beside({})
    least = one.search.noise.low
    return any(value > MANY_TIMES * math.sqrt(least + one.correlated_noise.get(k, 0.0)) for k, value in rms.items())


def _diagnosed(ready: Prepared, progress: ProgressCallback) -> tuple[DiagnosedPart, bool, list[str]]:
    """All steps for one part of the diagram, whether Ctrl-C ended the search early, and notes.

    Where a model with effects shows inputs to be commands, the search restarts.
    """
    part, request = ready.part, ready.request
    predicted, rounds = evidence(ready.base, request.settings.seed), list[SearchRound]()
    search, interrupted, omitted, notes = _context(ready, predicted, progress), False, list[Omission](), list[str]()
    try:
        forward_search(ready.base, {}, search, rounds)
        rounds, notes, omitted = _revised(rounds, search, ready)
        rounds, final, more, gone = _at_fine_step(rounds, search)
        count, notes, omitted = accepted_count(rounds, search), [*notes, *more], [*omitted, *gone]
    except OtherCommands as shown:
        with contextlib.suppress(KeyboardInterrupt):
            return _diagnosed(prepared_again(ready, shown.found, progress), progress)
        interrupted = True
    except KeyboardInterrupt:
        if not rounds:
            raise
        interrupted = True
    with without_checkpoints():
        if interrupted:
            final = rounds[count := determined_count(rounds, accepted_count(rounds, search))].base
        found, final_notes = _judged(ready, search, rounds, count, final, predicted, interrupted)
    notes = [f"{part.name}: {text}" for text in ([] if found.count < count else notes)]
    every = [*request.wrong_readings, *ready.notes, *notes, *final_notes]
    return attrs.evolve(found, omitted=omitted), interrupted, every


def _judged(
    ready: Prepared,
    search: SearchContext,
    rounds: list[SearchRound],
    count: int,
    final: Model,
    predicted: Evidence,
    interrupted: bool,
) -> tuple[DiagnosedPart, list[str]]:
    """What the last model leaves, whether its effects only take the place of what is missing, and notes on it."""
    part, seed = ready.part, ready.settings.seed
    left = predicted if final is ready.base else evidence(final, seed)
    varying = varying_factor(final, seed)
    if not interrupted and stands_in(rounds, count, predicted, left, varying, search):
        count, final, left = 0, rounds[0].base, predicted
        varying = varying_factor(final, seed)
    notes = doubtful_floors(ready.floors, final.residual_rms, recorded_units(final.setup))
    final = nearest(final, part.diagram.parameters) if count else final
    last, final = final, final if interrupted else with_plain_states(final)
    factor = factor_beside(last)
    judged = DiagnosedPart(
        part,
        search,
        ready.floors,
        rounds,
        count,
        final,
        predicted,
        left,
        varying,
        filtered=ready.filtered,
        correlated_noise=correlated_noise(last, factor),
        input_factor=factor,
        beside_inputs=None if interrupted else beside_inputs(last, ready.errors_of_inputs),
    )
    noise = search.noise_variance if count and not interrupted else 0.0
    own = _notes_on(last, part.diagram, noise, judged.corners)
    notes += [f"{part.name}: {text}" for text in [*own, *outlier_notes(last)]]
    if not count and not judged.in_doubt:
        notes += [f"{part.name}: {text}" for text in notes_on_moved(final, part.diagram.parameters)]
    if interrupted:
        return attrs.evolve(judged, stopped=True), notes
    delays = [one.candidate.block for one in judged.named if one.candidate.effect.family == DELAY]
    return attrs.evolve(judged, delays_if_held=tuple(delays_if_held(final, delays, ready.may_be_held))), notes


def _context(ready: Prepared, predicted: Evidence, progress: ProgressCallback) -> SearchContext:
    """What all rounds of the search for effects in a part share."""
    request, inputs = ready.request, ready.part.diagram.inputs
    noise = noise_level(ready.floors, ready.input_noise.left, predicted.rest)
    removed = input_noise_rms(ready.part.diagram, ready.records, ready.raw, ready.filtered)
    kept = noise_left_in(ready.part.diagram, ready.raw, ready.noises)
    blocks, line = time_blocks(ready.base.problem), only_frequency(ready.records, tuple(inputs))
    data = ready.records, ready.settings, request.effects
    exceeds = functools.partial(exceeds_noise, lambda: ready.errors_of_inputs)
    checks = ready.check, ready.check_named, exceeds
    return SearchContext(*data, blocks, noise, progress, line, removed, kept, *checks, ready.part.diagram.parameters)


def _revised(
    rounds: list[SearchRound], search: SearchContext, ready: Prepared
) -> tuple[list[SearchRound], list[str], list[Omission]]:
    """The rounds with effects that hold beside all the others, notes on them, and the effects that were left out."""
    rounds, undetermined = without_undetermined(exchange_effects(rounds, search), search)
    rounds, notes, recurring = without_recurring_events(rounds, search)
    rounds, from_inputs = without_effects_of_noise(rounds, search, ready.errors_of_inputs)
    return rounds, notes, [*undetermined, *recurring, *from_inputs]


def _at_fine_step(
    rounds: list[SearchRound], search: SearchContext
) -> tuple[list[SearchRound], Model, list[str], list[Omission]]:
    """The last model at a sufficient step and notes on that; effects that are not determined there are left out."""
    omitted = list[Omission]()
    while True:
        count = accepted_count(rounds, search)
        final, notes = with_fine_step(clip_idle_memories(rounds[count].base), search.settings.step is not None)
        last = attrs.evolve(rounds[count], base=final)
        left, gone = without_undetermined([*rounds[:count], last, *rounds[count + 1 :]], search)
        if not gone:
            return rounds, final, notes, omitted
        rounds, omitted = left, [*omitted, *gone]


def _notes_on(final: Model, diagram: Diagram, noise_variance: float, corners: Collection[str]) -> list[str]:
    """Notes on the parameters of the last model: limits, signs, and, with a noise variance, what may be exchanged.

    ``corners`` are smoothings, which are sharp at their lower limit.
    """
    exchanged = exchange_notes(final, noise_variance) if noise_variance > 0 else []
    return [*limit_notes(final, corners), *flipped_gains(diagram.parameters, final.values), *exchanged]
