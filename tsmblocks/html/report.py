"""A diagnosis as one page of HTML that needs no network and no scripts: the verdict first, then what it rests on."""

from __future__ import annotations

from collections.abc import Sequence
from html import escape

from tsmblocks.common.errors import TsmError
from tsmblocks.common.tables import listed
from tsmblocks.diagnosis.model_difference import difference
from tsmblocks.diagnosis.presentation import (
    by_excess,
    digits,
    fitted_rms,
    for_people,
    in_display_units,
    output_traces,
    profile,
    unit_of,
    with_interval,
)
from tsmblocks.diagnosis.result import Diagnosis, Gap, RankedCandidate, Segment, Trace
from tsmblocks.diagnosis.script import script_lines
from tsmblocks.diagnosis.text import (
    STATUS,
    candidate_title,
    column_titles,
    initial_states_text,
    limit_text,
    merged_notes,
    parameter_rows,
    percent,
    segments_by_verdict,
    share_across_experiments,
    verdict_sentence,
)
from tsmblocks.draw import to_svg
from tsmblocks.fitting.parameters import is_start, numbers
from tsmblocks.html import figures
from tsmblocks.html.document import document, key, picture, sentence, table

ROOM = 12000
"""Points of a line in all traces together, so that the page stays small."""
MOST, LEAST = 500, 100
"""Points of one line at most and at least."""
WORDS = {"named": "Found", "unknown": "Unknown effect", "none": "Nothing missing"}


def page(diagnosis: Diagnosis) -> str:
    """The whole page; the same diagnosis gives the same text."""
    title = f"Diagnosis: {diagnosis.diagram or 'diagram'}"
    parts = [_head(diagnosis, title)]
    for build in (
        _gaps,
        _disagreement,
        _ranking,
        _diagrams,
        _own_numbers,
        _script,
        _confusion,
        _limits,
        _consequence,
        _provenance,
        _notes,
    ):
        body = build(diagnosis)
        if body:
            parts.append(body)
    return document(title, parts)


# ---- verdict and gap -----------------------------------------------------------------------------


def _head(diagnosis: Diagnosis, title: str) -> str:
    boxes = []
    for segment in segments_by_verdict(diagnosis):
        word = WORDS.get(segment.verdict, segment.verdict)
        boxes.append(
            f'<div class="verdict {escape(segment.verdict)}"><p><b class="word">{escape(word)}.</b> '
            f"{sentence(verdict_sentence(segment))}</p></div>"
        )
    named = ", ".join(diagnosis.experiments)
    count = len(diagnosis.experiments)
    stopped = "" if diagnosis.status == "done" else f" <b>{escape(STATUS.get(diagnosis.status, diagnosis.status))}.</b>"
    about = f"{count} experiment{'s' if count > 1 else ''}: {named}."
    return f'<h1>{escape(title)}</h1>\n{"".join(boxes)}\n<p class="soft">{escape(about)}{stopped}</p>'


def _gaps(diagnosis: Diagnosis) -> str:
    shown = [(segment, gap) for segment in diagnosis.segments for gap in segment.gaps]
    charts = "".join(
        f"<figure>{figures.gap_bars(s, g)}<figcaption>{_gap_words(s, g)}</figcaption></figure>" for s, g in shown
    )
    between = any(len(s.effects) > 1 for s in diagnosis.segments)
    any_named = any(s.effects for s in diagnosis.segments)
    colours = key(
        [
            ("--before", "before"),
            *([("--between", "on the way")] if between else []),
            *([("--after", "with all that was named")] if any_named else []),
            ("hollow", "hollow: the same, fitted to these data too"),
            ("--floor", "noise floor"),
        ]
    )
    words = (
        "Error on blocks of time that the model was not fitted to. Where a hollow bar is much shorter than its "
        "filled one, the model fits what it will not foretell."
    )
    return f'<h2>How the gap shrinks</h2><p>{words}</p>{colours}<div class="cards">{charts}</div>'


def _gap_words(segment: Segment, gap: Gap) -> str:
    steps_ = column_titles(segment)
    k, unit = for_people(gap.unit)
    path = " → ".join(f"{digits(k * v)} ({sentence(name)})" for v, name in zip(gap.held_out, steps_, strict=True))
    return (
        f"{escape(gap.output)} ({escape(segment.name)}): {path} {escape(unit)}; noise floor "
        f"{digits(k * gap.noise_floor)} {escape(unit)} ({escape(gap.given or gap.method)})."
    )


# ---- where they disagree -------------------------------------------------------------------------


def _disagreement(diagnosis: Diagnosis) -> str:
    count = sum(len(output_traces(s, g.output)) for s in diagnosis.segments for g in s.gaps)
    points = max(LEAST, min(MOST, ROOM // max(count, 1)))
    several = len(diagnosis.segments) > 1
    parts = [
        "<h2>Where model and data disagree</h2>",
        key(
            [
                ("--measured", "measured"),
                ("--before", "before"),
                *([("--after", "with what was named")] if diagnosis.effects else []),
                ("--noise", "noise, ± 2 rms"),
            ]
        ),
    ]
    for segment in segments_by_verdict(diagnosis):
        parts += [f"<h3>{escape(segment.name)}</h3>"] if several else []
        if segment.where:
            rows = "".join(f"<li>{percent(w.share)} of the excess: {escape(w.words)}.</li>" for w in segment.where)
            parts.append(f"<ul>{rows}</ul>")
        for gap in segment.gaps:
            parts.append(_output(diagnosis, segment, gap, points))
    return "".join(parts)


def _output(diagnosis: Diagnosis, segment: Segment, gap: Gap, points: int) -> str:
    """Profiles of one output, the experiment that is worst, and the others to be opened."""
    made = [profile(segment, gap.output, w.coordinate, diagnosis.base) for w in segment.where[:2]]
    charts = [figures.along(one, explained=bool(segment.effects)) for one in made if one is not None]
    words = "Mean error in bins, with standard errors from blocks of time" + (
        "; the dashed line is what the named effects add." if segment.effects else "."
    )
    parts = []
    if charts:
        inner = "".join(f"<figure>{c}</figure>" for c in charts)
        parts.append(f'<div class="cards">{inner}</div><p class="soft">{words}</p>')
    first, *others = by_excess(output_traces(segment, gap.output))
    parts.append(_experiment(diagnosis, gap, first, points))
    parts.append(
        '<p class="soft">The cells above the error are blocks of time: the stronger the colour, the further '
        f"above the noise (strongest from {figures.DARKEST:g} times its variance).</p>"
    )
    inner = "".join(_experiment(diagnosis, gap, one, points) for one in others)
    if inner:
        parts.append(
            f"<details><summary>{escape(gap.output)} in {len(others)} more experiment"
            f"{'s' if len(others) > 1 else ''}</summary>{inner}</details>"
        )
    return "".join(parts)


def _experiment(diagnosis: Diagnosis, gap: Gap, trace: Trace, points: int) -> str:
    k, unit = for_people(trace.unit)
    before, after = (digits(k * v) for v in fitted_rms(trace))
    charts = [figures.history(trace, points), figures.left_over(trace, gap.noise_floor, points)]
    if len(trace.drive):
        charts += [
            figures.loop(trace, diagnosis.base, points),
            figures.left_over_input(trace, diagnosis.base, gap.noise_floor, points),
        ]
    inner = "".join(f"<figure>{c}</figure>" for c in charts)
    change = f"rms {before} → {after} {unit}" if before != after else f"rms {before} {unit}"
    return (
        f'<h3>{escape(trace.experiment)}, {escape(trace.output)}: {escape(change)}</h3><div class="cards">{inner}</div>'
    )


# ---- candidates ----------------------------------------------------------------------------------


def _ranking(diagnosis: Diagnosis) -> str:
    parts = [
        "<h2>What was tried</h2><p>Each candidate was put into the diagram and fitted together with it. "
        "<i>Removes</i>: share of the error above the noise that goes with it, on blocks of time held out; <i>new "
        "experiments</i>: the same with whole experiments held out, of what the round's base leaves there; "
        "&lt;&nbsp;0&nbsp;%: the error grows. <i>t</i>: how many times its own scatter that is; <i>line</i>: what "
        "chance stays below.</p>"
    ]
    several = len(diagnosis.segments) > 1
    tables = 0
    for segment in diagnosis.segments:
        for number in sorted({r.round for r in segment.ranking}):
            rows = [r for r in segment.ranking if r.round == number]
            parts.append(f"<h3>{escape(segment.name) + ', ' if several else ''}round {number}</h3>")
            parts.append(_round(rows, len(diagnosis.experiments)))
            tables += 1
    return "".join(parts) if tables else ""


def _round(rows: Sequence[RankedCandidate], experiments: int) -> str:
    fitted, rest = [r for r in rows if r.fitted], [r for r in rows if not r.fitted]
    body = [_ranked(r, experiments) for r in fitted]
    names = ("l:effect", "l:family", "l:on the wire", "l:numbers", "removes", "new experiments", "t", "line", "l:")
    shown = table(names, body, ["named" if r.named else "" for r in fitted]) if fitted else ""
    if not rest:
        return shown
    more = [(escape(candidate_title(r)), escape(r.family), escape(r.wire.strip()), percent(r.share)) for r in rest]
    inner = table(("l:effect", "l:family", "l:on the wire", "promised"), more)
    return f"{shown}<details><summary>{len(rest)} more promised too little to be fitted</summary>{inner}</details>"


def _ranked(r: RankedCandidate, experiments: int) -> tuple[str, ...]:
    numbers = "<br>".join(
        f"{escape(name)} {escape(in_display_units(value, r.units.get(name, '')))}"
        + (" <small>at its bound</small>" if name in r.at_bound else "")
        for name, value in r.parameters.items()
    )
    said = "named" if r.named else "cannot be told from it" if r.in_set else ""
    return (
        escape(candidate_title(r)),
        escape(r.family),
        escape(r.wire.strip()),
        numbers,
        percent(r.share),
        percent(share_across_experiments(r, experiments)),
        f"{r.t:.1f}",
        f"{r.line:.1f}",
        said,
    )


# ---- diagrams ------------------------------------------------------------------------------------


def _diagrams(diagnosis: Diagnosis) -> str:
    if not diagnosis.effects:
        return f"<h2>The diagram</h2>{picture(to_svg(diagnosis.base))}"
    blocks = [e.block for e in diagnosis.effects]
    pictures = f"<h3>Before</h3>{picture(to_svg(diagnosis.base))}<h3>After</h3>{picture(_marked(diagnosis, blocks))}"
    lines = "\n".join(
        f'<span class="{_sign(sign)}">{sign} {escape(line)}</span>'
        for sign, line in difference(diagnosis.base, diagnosis.augmented).lines
    )
    listed_blocks = [
        (escape(e.block), escape(e.words), escape(e.wire.strip()), _numbers(diagnosis, e.block))
        for e in diagnosis.effects
    ]
    shown = table(("l:block", "l:what it is", "l:on the wire", "l:numbers"), listed_blocks)
    return f"<h2>The diagram, before and after</h2>{shown}{pictures}<h3>What changed</h3><pre>{lines}</pre>"


def _own_numbers(diagnosis: Diagnosis) -> str:
    """The diagram's own numbers with intervals, and what a fit would warn of."""
    parts = []
    for segment in diagnosis.segments:
        head, *rows = parameter_rows(segment) or [()]
        if rows:
            kept = [k for k in range(len(head)) if any(row[k] for row in rows)]
            names = [f"{'l:' if k in (0, 4, 6) else ''}{head[k]}" for k in kept]
            parts.append(table(names, [tuple(sentence(row[k]) for k in kept) for row in rows]))
        if segment.cautions:
            said = "".join(f"<li>{sentence(text)}</li>" for text in segment.cautions)
            parts.append(f"<p><b>Beware:</b></p><ul>{said}</ul>")
    return f"<h2>The diagram's own numbers, found with it</h2>{''.join(parts)}" if parts else ""


def _script(diagnosis: Diagnosis) -> str:
    lines = "\n".join(escape(line) for line in script_lines(diagnosis))
    words = initial_states_text(diagnosis)
    said = f"<p>{sentence(words)}</p>" if words else ""
    return f'<h2>In a script</h2>{said}<pre class="wrap">{lines}</pre>'


def _marked(diagnosis: Diagnosis, blocks: Sequence[str]) -> str:
    try:
        return to_svg(diagnosis.augmented, highlight=blocks)
    except TsmError:  # a block of one's own that an effect puts elsewhere
        return to_svg(diagnosis.augmented)


def _numbers(diagnosis: Diagnosis, block: str) -> str:
    effect = next(e for e in diagnosis.effects if e.block == block)
    shown = [f"{escape(name)} {escape(with_interval(q))}" for name, q in effect.parameters.items()]
    known = numbers(diagnosis.augmented)
    fixed = [
        name
        for name in diagnosis.augmented.parameters
        if name.startswith(f"{block}.")
        and name.removeprefix(f"{block}.") not in effect.parameters
        and not is_start(known[name])
    ]
    parameters = diagnosis.augmented.parameters
    shown += [
        f"<small>{escape(name.removeprefix(f'{block}.'))} "
        f"{escape(in_display_units(parameters[name], unit_of(diagnosis.augmented, name)))} (not fitted)</small>"
        for name in fixed
    ]
    return "<br>".join(shown)


def _sign(sign: str) -> str:
    return {"+": "add", "-": "gone"}.get(sign, "")


# ---- what else there is to know ------------------------------------------------------------------


def _confusion(diagnosis: Diagnosis) -> str:
    rows = [
        f"<li><b>{escape(e.name)}</b> cannot be told from {sentence(listed(e.also_possible, 9))} with these data. "
        f"To separate them: {escape(e.separating_experiment or 'another experiment')}.</li>"
        for e in diagnosis.effects
        if e.also_possible
    ]
    if not rows:
        return ""
    return f"<h2>What may be confused</h2><ul>{''.join(rows)}</ul>"


def _limits(diagnosis: Diagnosis) -> str:
    parts = [
        "<h2>What could have been seen</h2><p>The smallest size of each effect that these experiments would have "
        "shown. Grey: of any size unseen, not being excited or without a wire in the diagram.</p>"
    ]
    several = len(diagnosis.segments) > 1
    for segment in diagnosis.segments:
        parts += [f"<h3>{escape(segment.name)}</h3>"] if several else []
        ordered = sorted(segment.limits, key=lambda m: m.value is None)
        rows = [(escape(m.name), escape(limit_text(m)), escape(m.excites)) for m in ordered]
        kinds = ["blind" if m.value is None else "" for m in ordered]
        parts.append(table(("l:effect", "l:smallest size", "l:what shows it"), rows, kinds))
    return "".join(parts) if any(s.limits for s in diagnosis.segments) else ""


def _consequence(diagnosis: Diagnosis) -> str:
    found = diagnosis.consequence
    if found is None:
        said = diagnosis.no_consequence
        return f"<h2>What it means for control</h2><p>{escape(said)}</p>" if said else ""
    k, unit = for_people(found.unit)
    rows = [
        (words, digits(k * peak), digits(k * rms))
        for words, (peak, rms) in (
            ("no compensation", found.none),
            ("compensator on the base", found.base),
            ("compensator on the new model", found.augmented),
        )
    ]
    said = (
        f"The motion of <i>{escape(found.reference)}</i> tracked in simulation, the new model being the plant; "
        f"errors in {escape(unit)}."
    )
    more = f"<p>{sentence(found.words)}</p>" if found.words else ""
    return f"<h2>What it means for control</h2><p>{said}</p>{table(('l:', 'peak to peak', 'rms'), rows)}{more}"


def _provenance(diagnosis: Diagnosis) -> str:
    """What the page rests on: version, diagram, recordings, options."""
    rests = diagnosis.provenance
    if rests is None:
        return ""
    given = ", ".join(filter(None, [rests.source, diagnosis.first.title]))
    rows = [("tsmblocks", rests.version), ("diagram", given)]
    rows += [(one.experiment, one.words) for one in rests.recordings] + list(rests.options.items())
    shown = table(("l:", "l:"), [(escape(name), sentence(words)) for name, words in rows])
    return f"<h2>What this rests on</h2>{shown}"


def _notes(diagnosis: Diagnosis) -> str:
    notes = merged_notes(diagnosis.notes, diagnosis.experiments)
    rows = "".join(f"<li>{escape(text)}</li>" for text in notes)
    end = f"Seed {diagnosis.seed}; status: {escape(STATUS.get(diagnosis.status, diagnosis.status))}."
    return f"<h2>Notes</h2>{f'<ul>{rows}</ul>' if rows else ''}<p class=soft>{end}</p>"
