"""``diagnose``: find where a model and recordings disagree, name what is missing, add it, and show the gap shrink."""

from __future__ import annotations

from collections.abc import Callable, Iterable, Mapping, Sequence
from fnmatch import fnmatchcase
from typing import Any

import attrs
import numpy as np

from tsmblocks.common import arguments
from tsmblocks.common.arguments import as_integer
from tsmblocks.common.errors import DataError, ParameterError, near
from tsmblocks.common.interrupt import Asked as Stop
from tsmblocks.common.interrupt import kept
from tsmblocks.common.tables import listed
from tsmblocks.common.version import __version__
from tsmblocks.data import Record
from tsmblocks.data.conditioning import all_conditioned
from tsmblocks.diagnosis.consequence import consequence
from tsmblocks.diagnosis.cross_validation import time_blocks
from tsmblocks.diagnosis.forward_selection import (
    SearchContext,
    SearchRound,
    accepted_count,
    exchange_effects,
    forward_search,
)
from tsmblocks.diagnosis.initial_states import clip_idle_memories, refine_memories, reset_idle_memories
from tsmblocks.diagnosis.model import Model, ModelSettings, calibrate
from tsmblocks.diagnosis.noise_floor import NoiseFloors, lowered_noise_floors, noise_floors, propagated_input_noise
from tsmblocks.diagnosis.partition import (
    Part,
    experiment_of,
    has_lasting_memory,
    in_whole_diagram,
    partition,
    split_into_pieces,
    total_delay,
)
from tsmblocks.diagnosis.presentation import in_display_units
from tsmblocks.diagnosis.refinement import with_fine_step
from tsmblocks.diagnosis.result import Consequence, Diagnosis, Segment
from tsmblocks.diagnosis.script import diagram_source
from tsmblocks.diagnosis.settings import Provenance, Simulated, recorded
from tsmblocks.diagnosis.summary import PartDiagnosis, segment_summary
from tsmblocks.effects import Effect, catalogue
from tsmblocks.fitting.experiments import Window, compared, signal_of, span
from tsmblocks.fitting.input_checks import standing
from tsmblocks.fitting.noise import asked_floors
from tsmblocks.fitting.parameters import chosen
from tsmblocks.fitting.setup import Data, recordings, windows, without_units
from tsmblocks.model.diagram import Diagram
from tsmblocks.simulation.arguments import as_diagram

MIN_SAMPLES = 200
"""Samples of all experiments together that a diagnosis takes at least."""

Tell = Callable[[str, int, int], None]
Inside = Mapping[str, Window] | None
"""The part of each experiment that counts [s]; None where all of them count."""


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
    hold: str = "cubic",
    progress: Tell | None = None,
) -> Diagnosis:
    """Find what a model misses, name it, add it to the diagram, and show how the gap shrinks on data held out.

    ``experiments`` is a recording, a list of them or a mapping by name, as for ``tsm.fit``; several with different
    amplitudes and frequencies tell more than one. Signals are matched by name to the diagram's inputs and outputs.

    First the diagram is cut at its measured signals (a closed loop stays whole) and its own numbers are fitted:
    ``free`` names them (patterns; by default all but start values), and with ``start_states`` states start anew in
    each experiment. Then each effect of the catalogue (``effects`` names some, patterns allowed) is tried on
    every wire where it can stand, fitted together with the base, and judged by what it leaves on blocks of time
    held out: it is named where it removes 6 % of the noise's variance at least, more than chance does, and half
    of what can be explained. What cannot be told from it with these data is listed beside it.

    What is compared: ``outputs`` (by default all that were measured) in ``window`` (start, stop) [s], which may differ
    by experiment; the simulation runs from the start of the recording all the same.

    ``noise_floor`` is the rms noise of the outputs with its unit, one for all or by output (``"0.06deg"``,
    ``{"x_out": "0.06deg"}``); a number alone is in the unit of the recordings and of the diagram, and refused where
    those differ. By default it is looked for in the recordings (repeats, periods, rests). ``condition`` takes the noise
    out of measured inputs (zero phase, held still at rest), since it would move hysteresis. ``step`` [s] is that of
    the simulation; by default one is chosen for the base, and the last model gets a finer one where its intervals
    would not cover the error of the step. ``seed`` makes the random parts repeatable: same data, same seed, same
    result. ``progress(stage, done, of)`` is called now and then. Ctrl-C ends the search; what was found is returned
    with ``status`` ``"interrupted"``, and before the first candidates were fitted it goes on as KeyboardInterrupt.

    Raises DataError (signals, samples), ParameterError (names, floors), and what ``tsm.fit`` raises.
    """
    arguments.as_callback(progress, "stage, done and of")
    records, diagram = recordings(experiments), as_diagram(diagram)
    inside = None if window is None else windows(window, records)
    measured = _measured(records, diagram, outputs, inside)
    effects_chosen, seed = _chosen(effects), as_integer("seed", seed, 0)
    if free is not None:
        chosen(diagram, free)  # names nobody has are told before any work
    given = asked_floors(noise_floor, diagram, records, measured)
    settings = ModelSettings(
        None if free is None else tuple(arguments.as_names("free", free, "tsm.*")),
        {},
        (),
        arguments.as_bool("start_states", start_states),
        step,
        integrator,
        hold,
        seed=seed,
        window=inside,
    )
    done, stopped = list[PartDiagnosis](), False
    spans = {k: (float(t[0]), float(t[-1])) for k, t in _compared(records, inside).items() if len(t) < len(records[k])}
    notes = without_units(records, diagram, measured)
    notes += [f"{name}: {text}" for name, r in records.items() for text in r.notes]
    notes += [f"{name}: only {low:g} s to {high:g} s is compared." for name, (low, high) in spans.items()]
    with kept() as stop, np.errstate(over="ignore", invalid="ignore"):  # trials that run away are left out
        tell = _told(progress, stop)
        for part in partition(diagram, measured):
            try:
                work = _work(part, records, settings, effects_chosen, given, condition, tell, notes)
            except _Stopped as one:
                work, stopped = one.work, True
            if work is not None:
                done.append(work)
            if stopped:
                break
    if not done:
        raise KeyboardInterrupt
    rests_on = Provenance(
        __version__,
        diagram_source(diagram),
        recorded(records, [*diagram.inputs, *diagram.outputs]),
        _options(settings, effects, condition, done),
    )
    made = _result(diagram, spans, tuple(records), done, seed, notes, "interrupted" if stopped else "done")
    return attrs.evolve(made, given=diagram, simulated=_simulated(done, condition), provenance=rests_on)


def _options(
    settings: ModelSettings, effects: Iterable[str] | None, condition: bool, done: Sequence[PartDiagnosis]
) -> dict[str, str]:
    """What the diagnosis was told to do, in words."""
    steps = sorted({trial.times.h for work in done for trial in work.final.setup.trials})
    floors = {
        k: f"{work.floors.given.get(k) or in_display_units(v, work.part.diagram.unit(k))} ({work.floors.method[k]})"
        for work in done
        for k, v in work.floors.sigma.items()
    }
    return {
        "noise floor": ", ".join(f"{k} {words}" for k, words in floors.items()),
        "effects": "all of the catalogue" if effects is None else ", ".join(arguments.as_names("effects", effects, "")),
        "free": "all but start values" if settings.free is None else ", ".join(settings.free),
        "start states": "found in each experiment" if settings.start_states else "as in the diagram",
        "inputs": "noise taken out (zero phase)" if condition else "as they are",
        "step": f"{' to '.join(f'{h:.4g}' for h in (steps[:1] + steps[1:][-1:]))} s"
        f" ({'given' if settings.step is not None else 'found'})",
        "integrator": settings.integrator,
        "hold": settings.hold,
        "seed": str(settings.seed),
    }


def _simulated(done: Sequence[PartDiagnosis], condition: bool) -> Simulated:
    """How the last models were simulated, with the start values that were found."""
    starts, steps, cut = dict[str, dict[str, float]](), dict[str, float](), dict[str, tuple[float, float, float]]()
    for work in done:
        last = work.final
        for trial in last.setup.trials:
            own = {
                i.parameter: float(v)
                for i, v in zip(last.problem.unknowns.items, last.theta, strict=True)
                if i.experiment == trial.name
            }
            starts.setdefault(trial.name, {}).update(own)
            steps[trial.name] = trial.times.h
            if experiment_of(trial.name) != trial.name:
                cut[trial.name] = float(trial.record.t[0]), float(trial.t[0]), float(trial.record.t[-1])
    how = done[0].search.settings
    inputs = tuple(dict.fromkeys(k for work in done for k in work.part.diagram.inputs)) if condition else ()
    outputs = tuple(k for work in done for k in work.part.outputs)
    return Simulated(starts, steps, outputs, inputs, how.integrator, how.hold, cut)


class _Stopped(Exception):
    """Ctrl-C came; ``work`` is what was found for the part until then."""

    def __init__(self, work: PartDiagnosis | None) -> None:
        super().__init__()
        self.work = work


def _told(progress: Tell | None, stop: Stop) -> Tell:
    def tell(stage: str, count: int, of: int) -> None:
        stop.check()
        if progress is not None:
            progress(stage, count, of)

    return tell


def _measured(
    records: Mapping[str, Record], diagram: Diagram, outputs: Sequence[str] | None, inside: Inside
) -> tuple[str, ...]:
    """The outputs that were measured. Raises DataError where there are too few samples to judge by."""
    asked = None if outputs is None else arguments.as_names("outputs", outputs, "x_out")
    names = compared(records, diagram, asked)
    total = sum(len(t) for t in _compared(records, inside).values())
    if total < MIN_SAMPLES:
        raise DataError(
            f"a diagnosis takes at least {MIN_SAMPLES} samples of all experiments together, and there are "
            f"{total}: with fewer, no effect can be told from chance."
        )
    found = tuple(k for k in names if diagram.shown[k][0])
    if not found:
        raise DataError(
            f"of '{diagram.title}' only {', '.join(names)} was measured, which is an input of the diagram "
            "itself: there is nothing in between to diagnose."
        )
    for name, record in records.items():  # before anything is filtered, which would spread it
        for k in (*(k for k in diagram.inports if k in record), *found):
            signal_of(name, record, k, diagram.unit(k))
    return found


def _compared(records: Mapping[str, Record], inside: Inside) -> dict[str, np.ndarray]:
    """The instants [s] of each experiment that count. Raises DataError where next to none do."""
    return {name: r.t if inside is None else r.t[span(name, r, inside[name])] for name, r in records.items()}


def _chosen(names: Iterable[str] | None) -> tuple[Effect, ...]:
    """The effects asked for. Raises ParameterError for a pattern that names none."""
    every = catalogue()
    if names is None:
        return every
    known, kept_names = {e.name for e in every}, set[str]()
    patterns = arguments.as_names("effects", names, "backlash")
    if not patterns:
        raise ParameterError("effects names no effect to look for. Leave it out to look for all of the catalogue.")
    for pattern in patterns:
        hits = {k for k in known if fnmatchcase(k, pattern)}
        if not hits:
            raise ParameterError(f"effects: '{pattern}' names no effect of the catalogue.{near(pattern, known)}")
        kept_names |= hits
    return tuple(e for e in every if e.name in kept_names)


def _work(
    part: Part,
    raw: Mapping[str, Record],
    settings: ModelSettings,
    effects: tuple[Effect, ...],
    given: Mapping[str, tuple[float, str]],
    condition: bool,
    tell: Tell,
    notes: list[str],
) -> PartDiagnosis | None:
    """Everything that is done for one part."""
    names = tuple(part.diagram.inputs)
    tell("conditioned", 0, 1)
    records = all_conditioned(raw, names) if condition else dict(raw)
    notes += [f"{name}: {text}" for name, r in records.items() for text in r.notes if text not in raw[name].notes]
    notes += [f"{name}: {text}" for name, r in raw.items() for text in standing(r, names, settings.hold)]
    counts = _cut(raw, settings.window)
    found = _floors(counts, part, given)
    own = attrs.evolve(settings, sigma=found.sigma, outputs=part.outputs, free=_free(settings, part.diagram))
    rounds: list[SearchRound] = []
    search: SearchContext | None = None
    try:
        if has_lasting_memory(part.diagram, records, own):
            late = total_delay(part.diagram)
            records, windows = split_into_pieces(_cut(records, settings.window), late)
            raw, own = split_into_pieces(counts, late)[0], attrs.evolve(own, window=windows)
            notes.append(f"{part.name}: the plant never forgets where it began, so it is started anew every second.")
        base = _calibrated(part, records, own, tell)
        found, words = lowered_noise_floors(found, base.residual_rms, counts, part.diagram)
        notes += words
        if found.sigma != own.sigma:
            own = attrs.evolve(own, sigma=found.sigma)
            base = _calibrated(part, records, own, tell)
        floor = 1 + (propagated_input_noise(base, raw, names, settings.seed) if condition else 0.0)
        search = SearchContext(records, own, effects, time_blocks(base.problem), floor, tell)
        forward_search(base, {}, search, rounds)
        rounds = exchange_effects(rounds, search)
    except KeyboardInterrupt:
        if search is None or not rounds:
            raise _Stopped(None) from None
        count = accepted_count(rounds, search)
        raise _Stopped(PartDiagnosis(part, search, found, rounds, count, rounds[count].base)) from None
    count = accepted_count(rounds, search)
    final, words = with_fine_step(clip_idle_memories(rounds[count].base), settings.step is not None)
    notes += [f"{part.name}: {text}" for text in words]
    return PartDiagnosis(part, search, found, rounds, count, final)


def _calibrated(part: Part, records: Mapping[str, Record], settings: ModelSettings, tell: Tell) -> Model:
    tell("calibrated", 0, 1)
    found = calibrate(part.diagram, records, settings, lambda *_: tell("calibrated", 0, 1))
    return reset_idle_memories(refine_memories(found))


def _cut(records: Mapping[str, Record], inside: Inside) -> dict[str, Record]:
    """What counts of each recording."""
    return {name: r if inside is None else r.part(*inside[name]) for name, r in records.items()}


def _free(settings: ModelSettings, diagram: Diagram) -> tuple[str, ...] | None:
    """The patterns that name something in this part; None for all."""
    if settings.free is None:
        return None
    known = list(diagram.parameters)
    return tuple(p for p in settings.free if any(fnmatchcase(k, p) for k in known))


def _floors(records: Mapping[str, Record], part: Part, given: Mapping[str, tuple[float, str]]) -> NoiseFloors:
    mine = {k: v for k, v in given.items() if k in part.outputs}
    return noise_floors(records, part.diagram, part.outputs, mine)


def _result(
    diagram: Diagram,
    spans: Mapping[str, tuple[float, float]],
    experiments: tuple[str, ...],
    done: Sequence[PartDiagnosis],
    seed: int,
    notes: list[str],
    status: str,
) -> Diagnosis:
    segments = tuple(segment_summary(work, diagram) for work in done)
    order = {"named": 2, "unknown": 1, "none": 0}
    verdict = max((s.verdict for s in segments), key=lambda v: order[v])
    said = [s.sentence for s in sorted(segments, key=lambda s: -order[s.verdict]) if s.verdict == verdict]
    if status == "interrupted":
        said.insert(0, "Provisional, since the search was stopped before its end:")
    base, augmented = _whole(diagram, done, False), _whole(diagram, done, True)
    means = _consequence(done, segments)
    return Diagnosis(
        diagram.title,
        experiments,
        seed,
        verdict,
        " ".join(said),
        tuple(e for s in segments for e in s.effects),
        segments,
        base,
        augmented,
        None if isinstance(means, str) else means,
        tuple(dict.fromkeys(notes)),
        status,
        spans,
        no_consequence=means if isinstance(means, str) else "",
    )


def _whole(diagram: Diagram, done: Sequence[PartDiagnosis], with_effects: bool) -> Diagram:
    """The whole diagram with the numbers found, and with the named blocks in place."""
    made = diagram
    for work in done:
        last = work.models[-1 if with_effects else 0]
        for one in work.named if with_effects else ():
            c = one.candidate
            made = in_whole_diagram(c.site, work.part).put(made, c.block, last.fitted_diagram.blocks[c.block])
        items = last.problem.unknowns.items
        own = {i.parameter: float(v) for i, v in zip(items, last.theta, strict=True) if not i.experiment}
        made = made.untied(own).with_parameters(own)
    named = [one.candidate.block for work in done for one in work.named] if with_effects else []
    return made.rewire(title=f"{diagram.title}, with {listed(named, 3)}".lstrip(", ")) if named else made


def _consequence(done: Sequence[PartDiagnosis], segments: Sequence[Segment]) -> Consequence | str:
    """What the effects named mean for control, for the last part with one input and one output that has any."""
    for work, segment in zip(reversed(done), reversed(segments), strict=True):
        if segment.effects:
            return consequence(work.models[0], work.models[-1])
    return ""
