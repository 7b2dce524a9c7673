"""The report of a diagnosis: what the template ``report.html`` shows of it, the verdict first."""

from __future__ import annotations

import itertools
from collections.abc import Iterator, Sequence
from typing import Any

from markupsafe import Markup, escape

from tsmblocks.common.errors import TsmError
from tsmblocks.diagnosis.candidate_tables import share_across_experiments
from tsmblocks.diagnosis.details import initial_states_text, parameter_rows
from tsmblocks.diagnosis.detectable_sizes import limit_text
from tsmblocks.diagnosis.merged_notes import merged_notes
from tsmblocks.diagnosis.model_difference import changes
from tsmblocks.diagnosis.next_steps import next_steps
from tsmblocks.diagnosis.presentation import (
    DARKEST,
    Profile,
    absence_text,
    by_excess,
    by_removed,
    digits,
    display_unit,
    fitted_rms,
    floor_methods,
    floor_rows,
    floor_sentence,
    floor_text,
    in_display_units,
    output_traces,
    profile,
    size_rows,
    unit_of,
    with_interval,
)
from tsmblocks.diagnosis.quantities import acceleration_note
from tsmblocks.diagnosis.result import Diagnosis
from tsmblocks.diagnosis.script import script_lines
from tsmblocks.diagnosis.segment import Gap, NamedEffect, RankedCandidate, Segment, Trace
from tsmblocks.diagnosis.text import STATUS, indistinguishable_text
from tsmblocks.diagnosis.variants import explained
from tsmblocks.diagnosis.verdict_text import (
    candidate_title,
    in_table,
    nothing_to_remove,
    percent,
    segments_by_verdict,
    verdict_sentence,
    verdict_word,
)
from tsmblocks.draw import to_svg
from tsmblocks.fitting.parameters import is_start, numbers
from tsmblocks.html import figures
from tsmblocks.html.card import table_of
from tsmblocks.html.pages import part, rendered, sentence

MAX_TOTAL_POINTS = 12000
"""Points of one line in all traces together. Chosen: the page stays small."""
MAX_POINTS, MIN_POINTS = 500, 100
"""Points of one line at most and at least. Chosen."""
MAX_PARAMETERS = 5
"""Parameters of a candidate that are listed. Chosen: one with its own in each recording has many."""
MAX_ROWS = 10
"""Candidates of a round that were fitted and are shown at once; more are folded. Chosen."""
LINE_BREAK = Markup("<br>")


def page(diagnosis: Diagnosis, back: tuple[str, str] | None = None) -> str:
    """The whole page; the same diagnosis gives the same text. ``back``: place and name of the page it belongs to."""
    segments, effects = diagnosis.segments, diagnosis.effects
    colours = model_colours(segments)
    values = dict(
        title=f"Diagnosis: {diagnosis.diagram or 'diagram'}",
        diagnosis=diagnosis,
        back=back,
        seed=diagnosis.seed,
        experiments=diagnosis.experiments,
        in_order=segments_by_verdict(diagnosis),
        several=len(segments) > 1,
        status=STATUS.get(diagnosis.status, diagnosis.status),
        gaps=[_gap(s, g, colours) for s in segments for g in s.gaps],
        floors=list(_floors(segments)),
        line_colours=line_colours(colours),
        disagreement=lambda segment: _disagreement(diagnosis, segment),
        darkest=f"{DARKEST:g}",
        rounds=list(_rounds(segments, len(diagnosis.experiments))),
        blocks=[(e.block, e.words, e.wire.strip(), _sizes(e), _numbers(diagnosis, e)) for e in effects],
        drawn=to_svg(diagnosis.base),
        drawn_after=_marked(diagnosis) if effects else "",
        changes=changes(diagnosis.base, diagnosis.augmented, diagnosis.effects) if effects else (),
        own_numbers=[_own_numbers(s) for s in segments if parameter_rows(s) or s.cautions],
        starts=initial_states_text(diagnosis),
        script=script_lines(diagnosis),
        indistinguishable=[*filter(None, map(indistinguishable_text, effects))],
        limits=[_limits(s) for s in segments] if any(s.limits for s in segments) else (),
        tracking=_tracking(diagnosis),
        origin=_origin(diagnosis),
        notes=merged_notes(diagnosis.notes, diagnosis.experiments),
        verdict_sentence=verdict_sentence,
        next_steps=next_steps,
        percent=percent,
        plural=lambda things: "s" if len(things) > 1 else "",
        verdict_word=verdict_word,
    )
    return rendered("report.html", values)


# ---- errors and residuals -------------------------------------------------------------------------


def _gap(segment: Segment, gap: Gap, colours: Sequence[tuple[str, str]]) -> Markup:
    k, unit = display_unit(gap.unit)
    path = [f"{name} {digits(k * v)} {unit}".rstrip() for v, name in zip(gap.held_out, _models(segment), strict=True)]
    floor = f"Noise floor {digits(k * gap.noise_floor)} {unit}".rstrip() + f" ({floor_text(gap)})"
    caption = f"Rms error of {gap.output} on held-out data: {', '.join(path)}. {floor}."
    if gap.whitened:
        beside = [f"{name} {digits(k * v)}" for v, name in zip(gap.whitened, _models(segment), strict=True)]
        own = f"noise floor {digits(k * gap.sensor_floor)} {unit}".rstrip()
        caption += f" Beside what noise of the inputs adds: {', '.join(beside)}; {own}."
    return part("figure", figures.gap_bars(segment, gap), caption, [*colours, *figures.OF_BARS])


def _floors(segments: Sequence[Segment]) -> Iterator[dict[str, Any]]:
    """Where each estimated noise floor comes from, and what each recording alone shows."""
    for gap in (g for s in segments for g in s.gaps if g.parts is not None):
        head, *rows = floor_rows(gap) or [()]
        table = table_of([head, *rows], {0, 4}, f"Noise of {gap.output} by recording", None) if rows else ""
        text = floor_sentence(gap)
        yield {"words": text[0].upper() + text[1:], "table": table, "methods": "; ".join(floor_methods(gap))}


def _models(segment: Segment) -> list[str]:
    """The models whose errors are compared: the base, and with each effect added."""
    return ["before" if segment.effects else "the model", *(f"with {e.block}" for e in segment.effects)]


def model_colours(segments: Sequence[Segment]) -> list[tuple[str, str]]:
    """What the colours of models mean on a page about some segments."""
    if any(s.effects for s in segments):
        between = [("between", "in between")] if any(len(s.effects) > 1 for s in segments) else []
        return [("before", "before"), *between, ("after", "with the reported effects")]
    if all(s.verdict == "none" for s in segments):
        return [("after", "the model")]
    quiet = [("after", "the model, nothing missing")] if any(s.verdict == "none" for s in segments) else []
    return [("before", "the model, something missing" if quiet else "the model"), *quiet]


def line_colours(colours: Sequence[tuple[str, str]]) -> list[tuple[str, ...]]:
    """What the colours of signals and residuals mean; lines of models in between are not drawn."""
    measured, noise = figures.OF_LINES
    return [measured, *((*one, "line") for one in colours if one[0] != "between"), noise]


def _disagreement(diagnosis: Diagnosis, segment: Segment) -> Iterator[dict[str, Any]]:
    """Profiles of each output of a segment, the experiment that is worst, and the others to be opened."""
    count = sum(len(output_traces(s, g.output)) for s in diagnosis.segments for g in s.gaps)
    points = max(MIN_POINTS, min(MAX_POINTS, MAX_TOTAL_POINTS // max(count, 1)))
    explained = bool(segment.effects)
    for gap in segment.gaps:
        profiles = [profile(segment, gap.output, w.coordinate) for w in segment.where[:2]]
        traces = by_excess(output_traces(segment, gap.output))
        worst, *others = [_experiment(segment, gap, one, points) for one in traces]
        quiet = segment.verdict == "none"
        drawn = [profile_figure(one, explained=explained, quiet=quiet) for one in profiles if one]
        yield {"name": gap.output, "profiles": drawn, "worst": worst, "others": others}


def _experiment(segment: Segment, gap: Gap, trace: Trace, points: int) -> dict[str, Any]:
    k, unit = display_unit(trace.unit)
    before, after = (digits(k * v) for v in fitted_rms(trace))
    charts, quiet = [], segment.verdict == "none"
    for loop in [False, True] if len(trace.drive) else [False]:
        charts.append(figures.signals_chart(trace, points, loop=loop, quiet=quiet))
        charts.append(figures.residual_chart(trace, gap.noise_floor, points, loop=loop, quiet=quiet))
    change = f"rms {before} → {after} {unit}" if before != after else f"rms {before} {unit}"
    made = [part("figure", chart) for chart in charts]
    return {"experiment": trace.experiment, "output": trace.output, "rms": change, "charts": made}


def profile_figure(curve: Profile, *, explained: bool, quiet: bool) -> Markup:
    """The mean residual along a coordinate, with what its colours mean."""
    dots = [("after" if quiet else "before", f"mean residual{' before' if explained else ''}, ± standard error", "dot")]
    if explained:
        dots += [("after", "mean residual after", "dot"), ("after", "contribution of the effects", "dash")]
    return part("figure", figures.residual_over_coordinate(curve, explained=explained, quiet=quiet), "", dots)


# ---- candidates and diagrams ---------------------------------------------------------------------


def _rounds(segments: Sequence[Segment], experiments: int) -> Iterator[dict[str, Any]]:
    known = set[str]()
    for segment, number in dict.fromkeys((s, r.round) for s in segments for r in s.ranking):
        rows = [r for r in segment.ranking if r.round == number]
        fitted = by_removed(r for r in rows if r.fitted)
        at_once = [k < MAX_ROWS or r.named or r.in_set for k, r in enumerate(fitted)]
        shown = [*itertools.compress(fitted, at_once)]
        yield {
            "segment": segment.name,
            "number": number,
            "fitted": [_ranked(r, experiments) for r in shown],
            "weaker": [_ranked(r, experiments) for r, is_shown in zip(fitted, at_once, strict=True) if not is_shown],
            "kinds": ["named" if r.named else "" for r in shown],
            "variants": explained(fitted, known),
            "nothing": nothing_to_remove(fitted) if fitted else "",
            "rest": [(*_where(r), in_table(r.share), r.words) for r in rows if not r.fitted],
        }


def _ranked(r: RankedCandidate, experiments: int) -> tuple[str, ...]:
    values = []
    for name, value in r.parameters.items():
        bound = Markup(" <small>at its bound</small>") if name in r.at_bound else ""
        text = in_display_units(value, r.units.get(name, ""))
        values.append(Markup('<span class="whole">{} {}{}</span>').format(name, text, bound))
    outcome = "named" if r.named else r.why_not
    shares = (in_table(r.share), in_table(share_across_experiments(r, experiments)))
    shown = values if len(values) <= MAX_PARAMETERS + 1 else values[:MAX_PARAMETERS]
    shown += [Markup("<small>and {} more</small>").format(len(values) - len(shown))] * (len(shown) < len(values))
    return (*_where(r), *shares, outcome, f"{r.t:.1f}", f"{r.line:.1f}", r.words, LINE_BREAK.join(shown))


def _where(r: RankedCandidate) -> tuple[str, ...]:
    return candidate_title(r), r.wire.strip()


def _marked(diagnosis: Diagnosis) -> str:
    try:
        return to_svg(diagnosis.augmented, highlight=[e.block for e in diagnosis.effects])
    except TsmError:  # a user's effect may put its block elsewhere
        return to_svg(diagnosis.augmented)


def _sizes(effect: NamedEffect) -> Markup:
    """The sizes of an effect with intervals, one on each line."""
    texts = [f"{name} {text}" for name, text in size_rows(effect)]
    return LINE_BREAK.join(map(escape, [*texts, *filter(None, [absence_text(effect)])]))


def _numbers(diagnosis: Diagnosis, effect: NamedEffect) -> Markup:
    """The fitted parameters of an effect's block where it is present, with intervals, and its other ones."""
    seen = [(name, q) for name, q in effect.parameters.items() if not effect.is_absent(name)]
    shown = [Markup("{} {}").format(name, with_interval(q)) for name, q in seen]
    known, parameters = numbers(diagnosis.augmented), diagnosis.augmented.parameters
    fitted = {name.partition("@")[0] for name in effect.parameters}
    for full, value in parameters.items():
        block, _, name = full.partition(".")
        if block == effect.block and name not in fitted and not is_start(known[full]):
            text = in_display_units(value, unit_of(diagnosis.augmented, full))
            shown.append(Markup("<small>{} {} (not fitted)</small>").format(name, text))
    return LINE_BREAK.join(shown)


def _own_numbers(segment: Segment) -> dict[str, Any]:
    """The diagram's own parameters with intervals, and the cautions of a fit."""
    head, *rows = parameter_rows(segment) or [()]
    cells = [head, *([sentence(text) for text in row] for row in rows)]
    cautions = [sentence(text) for text in segment.cautions]
    caption = f"Parameters of {segment.name}"
    table = table_of(cells, {0, 4, 6}, caption, None) if rows else ""
    return {"table": table, "cautions": cautions, "segment": segment.name}


# ---- limits, control, provenance --------------------------------------------------------------------


def _limits(segment: Segment) -> dict[str, Any]:
    named = {one.name for one in segment.effects}
    shown = (m for m in segment.limits if m.value is not None or m.name not in named)
    ordered = sorted(shown, key=lambda m: m.value is None)
    rows = [(m.name, limit_text(m), m.wire, m.excites) for m in ordered]
    kinds = ["blind" if m.value is None else "" for m in ordered]
    return {"segment": segment.name, "rows": rows, "kinds": kinds, "note": acceleration_note(ordered)}


def _tracking(diagnosis: Diagnosis) -> dict[str, Any] | None:
    tracking = diagnosis.consequence
    if tracking is None:
        return None
    k, unit = display_unit(tracking.unit)
    names = ("no compensation", "compensator from the base model", "compensator from the augmented model")
    runs = zip(names, (tracking.none, tracking.base, tracking.augmented), strict=True)
    rows = [(name, digits(k * peak), digits(k * rms)) for name, (peak, rms) in runs]
    return {"reference": tracking.reference, "unit": unit, "rows": rows, "words": tracking.words}


def _origin(diagnosis: Diagnosis) -> list[tuple[str, str]]:
    """Version, diagram, recordings and options."""
    provenance = diagnosis.provenance
    if provenance is None:
        return []
    diagram = ", ".join(filter(None, [provenance.source, diagnosis.first.title]))
    rows = {"tsmblocks": provenance.version, "diagram": diagram}
    recordings = [(one.experiment, one.words) for one in provenance.recordings]
    return [(name, sentence(words)) for name, words in (*rows.items(), *recordings, *provenance.options.items())]
