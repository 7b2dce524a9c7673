"""A diagnosis as text: verdict, errors before and after, residual location, candidates, changes to the diagram."""

from __future__ import annotations

import functools
import textwrap
from collections.abc import Sequence

from tsmblocks.common.tables import WIDTH, columns, line_width, listed, table_width
from tsmblocks.common.views import no_view
from tsmblocks.data.noise_floor import CONTENT
from tsmblocks.diagnosis.limits import CAUSES
from tsmblocks.diagnosis.merged_notes import merged_notes
from tsmblocks.diagnosis.model_difference import difference
from tsmblocks.diagnosis.plain_values import limit_quantity
from tsmblocks.diagnosis.presentation import (
    by_removed,
    digits,
    display_unit,
    fitted_rms,
    floor_methods,
    floor_rows,
    floor_sentence,
    in_display_units,
    output_traces,
    size_text,
    with_interval,
)
from tsmblocks.diagnosis.quantities import acceleration_note
from tsmblocks.diagnosis.rejection import LEFT_OUT
from tsmblocks.diagnosis.result import DetectionLimit, Diagnosis, Gap, NamedEffect, RankedCandidate, Segment
from tsmblocks.diagnosis.script import script_lines
from tsmblocks.diagnosis.variants import explained
from tsmblocks.diagnosis.verdict_text import (
    alternatives,
    candidate_title,
    in_table,
    next_steps,
    nothing_to_remove,
    percent,
    segments_by_verdict,
    verdict_sentence,
    verdict_word,
)
from tsmblocks.fitting.text import estimate_rows

MAX_NAME_LENGTH, MIN_HEADING_LENGTH = 28, 11
"""Characters at which a name in a table is cut, and at which a heading of a column is broken at least, in lines of 80.
Chosen."""
NUMBERS_WIDTH = 32
"""Characters of the columns of numbers in a table of candidates. Measured."""
MIN_TITLE_WIDTH, MIN_REASON_WIDTH = 14, 24
"""Characters that a table of candidates has at least for their names, and for reasons in a column. Chosen."""
MAX_ROWS = 8
"""Candidates of a round that are reported. Chosen."""
MAX_ROWS_UNNAMED = 3
"""The same for a round in which no effect was named, if others were. Chosen."""
STATUS = {
    "done": "the search was completed",
    "interrupted": "interrupted; these are the results until then",
    "limit": "ended at the time limit; these are the results until then",
}
EARLY = {"interrupted": "SEARCH INTERRUPTED. ", "limit": "SEARCH ENDED AT ITS TIME LIMIT. "}


def diagnosis_text(diagnosis: Diagnosis) -> str:
    """The whole diagnosis as a terminal shows it."""
    n = len(diagnosis.experiments)
    head = f"{diagnosis.diagram or 'diagram'}: {n} experiment{'s' if n > 1 else ''}"
    parts = []
    early = EARLY.get(diagnosis.status, "")
    for segment in segments_by_verdict(diagnosis):
        parts.append(_filled(f"{early}{verdict_word(segment).upper()}. {verdict_sentence(segment)}"))
        parts += _bullets("next", next_steps(segment))
    parts.append(textwrap.fill(head, line_width()))
    several = len(diagnosis.segments) > 1
    for segment in diagnosis.segments:
        parts += [f"== {segment.name} =="] if several else []
        parts += [_gap_table(segment, gap) for gap in segment.gaps]
        parts += [*_residual_location(segment), *_ranking(segment)]
    parts += _added(diagnosis)
    parts += [
        text
        for segment in diagnosis.segments
        for text in (*_parameters(segment, several), *_bullets(f"beware{_of(segment, several)}", segment.cautions))
    ]
    parts += _script(diagnosis)
    parts += [text for segment in diagnosis.segments for text in _indistinguishable(segment)]
    parts += [_limits(segment, several) for segment in diagnosis.segments if segment.limits]
    parts += _consequence(diagnosis)
    status = f"Random seed {diagnosis.seed}; {STATUS[diagnosis.status]}."
    parts += _bullets("notes", [*merged_notes(diagnosis.notes, diagnosis.experiments), status])
    return "\n\n".join(parts)


# ---- tables --------------------------------------------------------------------------------------


def column_titles(segment: Segment) -> list[str]:
    """Titles of the columns of errors: the base, then each effect added."""
    return ["before", *(f"+ {e.block}" for e in segment.effects)]


def _gap_table(segment: Segment, gap: Gap) -> str:
    """The errors of one output by experiment: held out, and in the last columns as fitted."""
    k, unit = display_unit(gap.unit)
    last = ["fitted"] if len(gap.train) == 1 else ["fit before", "fit after"]
    first = f"held-out rms of {gap.output} [{unit or 'its unit'}]"
    estimated = not gap.given and gap.method in CONTENT
    floor = "noise floor" if estimated else f"noise floor ({gap.given or gap.method})"
    made = column_titles(segment)
    room = table_width() - max(len(first), len(floor)) - sum(len(title) + 2 for title in (made[0], *last))
    width = max(MIN_HEADING_LENGTH, room // max(len(made) - 1, 1) - 2)
    titles = _headings([*made, *last], width)
    fitted = {t.experiment: fitted_rms(t) for t in output_traces(segment, gap.output)}
    rows: list[tuple[str, tuple[float, ...], tuple[float, ...]]] = [
        ("all", gap.held_out, (gap.train[0], gap.train[-1]))
    ]
    if len(gap.experiments) > 1:
        rows += [
            (_cut(name, _name_length()), held_out, fitted.get(name, ())) for name, held_out in gap.experiments.items()
        ]
    rows.append((floor, (gap.noise_floor,), ()))
    table = [["", *line] for line in titles[:-1]] + [[first, *titles[-1]]]
    for name, held_out, own in rows:
        cells = [name, *(digits(k * v) for v in (*held_out, *own[: len(last)]))]
        table.append(cells + [""] * (1 + len(titles[0]) - len(cells)))
    return "\n".join([columns(table), *(_floor(gap) if estimated else [])])


def _headings(titles: Sequence[str], width: int) -> list[list[str]]:
    """Lines of headings of columns, in which long names are broken after an underscore."""
    wrapped = [textwrap.wrap(title.replace("_", "_ "), width, break_long_words=False) for title in titles]
    lines = [[line.replace("_ ", "_") for line in parts] for parts in wrapped]
    count = max(map(len, lines))
    return [list(row) for row in zip(*([""] * (count - len(parts)) + parts for parts in lines), strict=True)]


def _floor(gap: Gap) -> list[str]:
    """Where a noise floor comes from, and what each recording alone shows."""
    rows, methods = floor_rows(gap), "; ".join(floor_methods(gap))
    table = [columns(rows, left=(0, 4))] if rows else []
    return [_filled(floor_sentence(gap)), *table, *([_filled(f"{methods}.")] if methods else [])]


def _residual_location(segment: Segment) -> list[str]:
    above = "of the error above the noise floor"
    return _bullets("residual by coordinate", [f"{percent(w.share)} {above}: {w.words}." for w in segment.where])


def _ranking(segment: Segment) -> list[str]:
    """The candidates that were fitted, by round, and how many were screened out."""
    parts, variants = list[str](), set[str]()
    for number in sorted({r.round for r in segment.ranking}):
        here = [r for r in segment.ranking if r.round == number]
        fitted = by_removed(r for r in here if r.fitted)
        if not fitted:
            continue
        most = MAX_ROWS_UNNAMED if segment.effects and not any(r.named for r in fitted) else MAX_ROWS
        shown = [r for k, r in enumerate(fitted) if k < most or r.named or r.in_set or r.why_not in LEFT_OUT]
        rest = len(here) - len(shown)
        more = f"\nOther candidates, screened out or with a smaller reduction: {rest}." if rest else ""
        key = "* named, ~ indistinguishable from it" if any(r.named for r in here) else "none named"
        remarks = filter(None, [nothing_to_remove(fitted), explained(shown, variants)])
        legend = "".join(f"\n{_filled(text)}" for text in remarks)
        parts.append(f"candidates, round {number} ({key}):\n{_candidate_table(segment, shown)}{legend}{more}")
    if not parts:
        return []
    new = "new exp.: the same with whole experiments held out; " if len(segment.gaps[0].experiments) > 1 else ""
    key_words = (
        "removes: reduction of the error above the noise floor, on held-out time blocks; "
        f"{new}< 0 %: the error grows. t: t-statistic of the reduction; (in brackets) its critical value (95 %)."
    )
    return [*parts, _filled(key_words)]


def _candidate_table(segment: Segment, shown: Sequence[RankedCandidate]) -> str:
    """Candidates of a round, and why each was not named: beside it, or on narrow terminals below the table."""
    several = len(segment.gaps[0].experiments)
    numbers = NUMBERS_WIDTH - (0 if several > 1 else len("  new exp."))
    wires = [_cut(r.wire.strip(), table_width() - numbers - MIN_TITLE_WIDTH) for r in shown]
    beside = table_width() - numbers - max(map(len, wires)) - max(len(candidate_title(r)) for r in shown)
    wide = beside >= MIN_REASON_WIDTH + 2
    head = [
        "  candidate",
        "on",
        "removes",
        *["new exp."][: several - 1],
        f"t ({shown[0].line:.2g})",
        *["why not"] * wide,
    ]
    rows = [
        [
            f"{'*' if r.named else '~' if r.in_set else ' '} {candidate_title(r)}",
            wire,
            in_table(r.share),
            *[in_table(share_across_experiments(r, several))][: several - 1],
            f"{r.t:.1f}",
            *[r.why_not] * wide,
        ]
        for r, wire in zip(shown, wires, strict=True)
    ]
    table = columns([head, *rows], left=(0, 1, len(head) - 1) if wide else (0, 1))
    return table if wide else "\n".join([table, *_reasons(shown)])


def _reasons(shown: Sequence[RankedCandidate]) -> list[str]:
    """Why candidates were not named, those of one reason together."""
    found: dict[str, list[str]] = {}
    for one in shown:
        if one.why_not and not one.in_set:
            found.setdefault(one.why_not, []).append(candidate_title(one))
    texts = [f"{reason}: {', '.join(dict.fromkeys(names))}" for reason, names in found.items()]
    return ["why not named:", *(_filled(text, "- ", "  ") for text in texts)] if texts else []


def share_across_experiments(one: RankedCandidate, experiments: int) -> float:
    """The share that a candidate removes with whole experiments held out; NaN where there is only one."""
    return one.new if experiments > 1 else float("nan")


def _added(diagnosis: Diagnosis) -> list[str]:
    parts = []
    for effect in diagnosis.effects:
        sizes = [[name, size_text(effect, name)] for name in effect.sizes]
        rows = [[name, with_interval(q)] for name, q in effect.parameters.items()]
        titled = [("", sizes), (", parameters of its block", rows)] if sizes else [("", rows)]
        parts += [
            f"{effect.block} ({effect.name}){title}:\n{columns(some, '  ', left=(0, 1))}" for title, some in titled
        ]
    if parts:
        lines = [f"{sign} {text}" for sign, text in difference(diagnosis.base, diagnosis.augmented).lines]
        parts.append("\n".join(["changes to the diagram:", *lines]))
    return parts


def parameter_rows(segment: Segment) -> list[tuple[str, ...]]:
    """The diagram's own parameters in the last model, with intervals, the heading first; without initial states."""
    if segment.fit is None:
        return []
    added = tuple(f"{e.block}." for e in segment.effects)
    own = [e for e in segment.fit if not e.is_start and not e.name.startswith(added or "\0")]
    return estimate_rows(segment.fit, own) if own else []


def _parameters(segment: Segment, several: bool) -> list[str]:
    rows, title = parameter_rows(segment), f"parameters of the diagram{_of(segment, several)}, fitted with it"
    return [f"{title}:\n{columns(rows, left=(0, 4, 6))}"] if rows else []


def _of(segment: Segment, several: bool) -> str:
    """The part that a title is about, where there are several."""
    return f" in {segment.name}" if several else ""


def initial_states_text(diagnosis: Diagnosis) -> str:
    """How the estimated initial states are used; empty where there are none."""
    if not any(diagnosis.start_states.values()):
        return ""
    return (
        "The errors reported are those of simulations from initial states estimated for each experiment: "
        "found.start_states, and start_states in diagnosis.json; found.diagrams has a diagram for each."
    )


def _script(diagnosis: Diagnosis) -> list[str]:
    if not diagnosis.effects:
        return []
    lines = ["in a script:", *(f"  {line}".rstrip() for line in script_lines(diagnosis))]
    return [*filter(None, [_filled(initial_states_text(diagnosis))]), "\n".join(lines)]


def indistinguishable_text(effect: NamedEffect) -> str:
    """The effects that are indistinguishable from one, why it is named, and what separates them; empty without any."""
    others = alternatives(effect)
    if not others:
        return ""
    parts = [f"{effect.name} is indistinguishable from {listed(others, 9)} with these data.", effect.why_named]
    if effect.also_possible:
        parts.append(f"To separate them: {effect.separating_experiment or 'another experiment'}.")
    return " ".join(filter(None, parts))


def _indistinguishable(segment: Segment) -> list[str]:
    return _bullets("indistinguishable effects", [*filter(None, map(indistinguishable_text, segment.effects))])


def limit_text(one: DetectionLimit) -> str:
    """The smallest detectable size, with its name, or why there is none."""
    if one.value is None:
        by = absorbed_text(one)
        return f"absorbed by {by}" if by else CAUSES.get(one.cause, "")
    name, size, unit = limit_quantity(one)
    return f"{name} {in_display_units(size, unit)}"


def absorbed_text(one: DetectionLimit) -> str:
    """The parameters that absorb an effect, and by how much: ``preload.value, 40 N per mm``; empty without any."""
    return listed([f"{k}, {rate}" if rate else k for k, rate in one.absorbed_by.items()]) if one.absorbed_by else ""


def _limits(segment: Segment, several: bool) -> str:
    detectable = [m for m in segment.limits if m.value is not None]
    named = {one.name for one in segment.effects}
    undetectable = [m for m in segment.limits if m.value is None and m.name not in named]
    where = _of(segment, several)
    parts = []
    if detectable:
        rows = [[m.name, limit_text(m)] for m in detectable]
        beside = ", beside the effects named" if named else ""
        parts.append(f"smallest detectable sizes{where}{beside}:\n{columns(rows, '  ', left=(0, 1))}")
        parts += filter(None, [_filled(acceleration_note(detectable))])
    if undetectable:
        own = {cause: [m for m in undetectable if m.cause == cause] for cause in CAUSES}
        lines = [f"{CAUSES[cause]}: {', '.join(map(_without_limit, some))}" for cause, some in own.items() if some]
        parts += _bullets(f"not detectable at any size{where}", lines)
    return "\n\n".join(parts)


def _without_limit(one: DetectionLimit) -> str:
    by = absorbed_text(one)
    return f"{one.name} (acts as {by})" if by else one.name


def _consequence(diagnosis: Diagnosis) -> list[str]:
    found = diagnosis.consequence
    if found is None:
        return [_filled(f"Consequence for control: {diagnosis.no_consequence}")] if diagnosis.no_consequence else []
    k, unit = display_unit(found.unit)
    rows = [
        [f"tracking {_cut(found.reference, _name_length())} [{unit}]", "peak to peak", "rms"],
        ["without compensation", *(digits(k * v) for v in found.none)],
        ["compensated with the base", *(digits(k * v) for v in found.base)],
        ["compensated with the new model", *(digits(k * v) for v in found.augmented)],
    ]
    return [columns(rows), *([_filled(found.words)] if found.words else [])]


# ---- small things --------------------------------------------------------------------------------


def _name_length() -> int:
    """Characters at which a name in a table is cut: more of them where the terminal is wider."""
    return MAX_NAME_LENGTH + max(table_width() - WIDTH, 0) // 2


def _cut(text: str, most: int) -> str:
    return text if len(text) <= most else text[: most - 1] + "…"


def _bullets(title: str, texts: Sequence[str]) -> list[str]:
    """A title with a list below it; nothing where there is nothing to list."""
    return ["\n".join([f"{title}:", *(_filled(text, "- ", "  ") for text in texts)])] if texts else []


def _filled(text: str, first: str = "", others: str = "") -> str:
    """A text in lines that fit a terminal; a percent sign stays with its number."""
    lines = textwrap.fill(
        text.replace(" %", "\xa0%"),
        line_width(),
        initial_indent=first,
        subsequent_indent=others,
        break_long_words=False,
        break_on_hyphens=False,
    )
    return lines.replace("\xa0", " ")


view = functools.singledispatch(no_view)
view.register(Diagnosis, diagnosis_text)
