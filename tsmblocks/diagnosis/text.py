"""A diagnosis as text: verdict, errors before and after, residual location, candidates, changes to the diagram."""

from __future__ import annotations

import functools
import textwrap
from collections.abc import Sequence

from tsmblocks.common.tables import WIDTH, columns, line_width, listed, table_width
from tsmblocks.common.views import no_view
from tsmblocks.diagnosis.merged_notes import merged_notes
from tsmblocks.diagnosis.model_difference import difference
from tsmblocks.diagnosis.presentation import (
    digits,
    display_unit,
    fitted_rms,
    in_display_units,
    output_traces,
    with_interval,
)
from tsmblocks.diagnosis.result import DetectionLimit, Diagnosis, Gap, RankedCandidate, Segment
from tsmblocks.diagnosis.script import script_lines
from tsmblocks.diagnosis.verdict_text import next_steps, percent, segments_by_verdict, verdict_sentence, verdict_word
from tsmblocks.fitting.text import estimate_rows

MAX_NAME_LENGTH, MAX_HEADING_LENGTH = 28, 14
"""Characters at which a name in a table is cut, and the heading of a column of numbers, in lines of 80. Chosen."""
NUMBERS_WIDTH = 32
"""Characters of the other columns of a table of candidates, whose names and wires have the rest of a line. Measured."""
MAX_ROWS = 8
"""Candidates of a round that are reported. Chosen."""
MAX_ROWS_UNNAMED = 3
"""The same for a round in which no effect was named, if others were. Chosen."""
STATUS = {"done": "done", "interrupted": "interrupted; these are the results until then"}


def diagnosis_text(diagnosis: Diagnosis) -> str:
    """The whole diagnosis as a terminal shows it."""
    n = len(diagnosis.experiments)
    head = f"{diagnosis.diagram or 'diagram'}: {n} experiment{'s' if n > 1 else ''}"
    parts = []
    for segment in segments_by_verdict(diagnosis):
        parts.append(_filled(f"{verdict_word(segment).upper()}. {verdict_sentence(segment)}"))
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
        for text in (*_parameters(segment), *_bullets("beware", segment.cautions))
    ]
    parts += _script(diagnosis)
    parts += [text for segment in diagnosis.segments for text in _indistinguishable(segment)]
    parts += [_limits(segment, several) for segment in diagnosis.segments if segment.limits]
    parts += _consequence(diagnosis)
    status = f"Seed {diagnosis.seed}; {STATUS[diagnosis.status]}."
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
    titles = [*(_cut(title, MAX_HEADING_LENGTH) for title in column_titles(segment)), *last]
    fitted = {t.experiment: fitted_rms(t) for t in output_traces(segment, gap.output)}
    rows: list[tuple[str, tuple[float, ...], tuple[float, ...]]] = [
        ("all", gap.held_out, (gap.train[0], gap.train[-1]))
    ]
    if len(gap.experiments) > 1:
        rows += [
            (_cut(name, _name_length()), held_out, fitted.get(name, ())) for name, held_out in gap.experiments.items()
        ]
    rows.append((f"noise floor ({gap.given or gap.method})", (gap.noise_floor,), ()))
    table = [[f"held-out rms of {gap.output} [{unit or 'its unit'}]", *titles]]
    for name, held_out, own in rows:
        cells = [name, *(digits(k * v) for v in (*held_out, *own[: len(last)]))]
        table.append(cells + [""] * (1 + len(titles) - len(cells)))
    return columns(table)


def _residual_location(segment: Segment) -> list[str]:
    return _bullets("residual by coordinate", [f"{percent(w.share)} of the excess: {w.words}." for w in segment.where])


def _ranking(segment: Segment) -> list[str]:
    """The candidates that were fitted, by round, and how many were screened out."""
    parts, several = list[str](), len(segment.gaps[0].experiments)
    for number in sorted({r.round for r in segment.ranking}):
        here = [r for r in segment.ranking if r.round == number]
        fitted = [r for r in here if r.fitted]
        if not fitted:
            continue
        shown = fitted[: MAX_ROWS_UNNAMED if segment.effects and not any(r.named for r in fitted) else MAX_ROWS]
        titles = [_cut(candidate_title(r), _name_length()) for r in shown]
        numbers = NUMBERS_WIDTH - (0 if several > 1 else len("  new exp."))
        room = max(table_width() - numbers - max(map(len, titles)), MAX_HEADING_LENGTH)
        rows = [["  candidate", "on", "removes", *["new exp."][: several - 1], f"t ({fitted[0].line:.2g})"]]
        rows += [
            [
                f"{'*' if r.named else '~' if r.in_set else ' '} {title}",
                _cut(r.wire.strip(), room),
                percent(r.share),
                *[percent(share_across_experiments(r, several))][: several - 1],
                f"{r.t:.1f}",
            ]
            for r, title in zip(shown, titles, strict=True)
        ]
        rest = len(here) - len(shown)
        more = f"\nOther candidates, screened out or with a smaller reduction: {rest}." if rest else ""
        key = "* named, ~ indistinguishable from it" if any(r.named for r in here) else "none named"
        parts.append(f"candidates, round {number} ({key}):\n{columns(rows, left=(0, 1))}{more}")
    new = "new exp.: the same with whole experiments held out; " if several > 1 else ""
    explained = (
        "removes: reduction of the error above the noise floor, on held-out time blocks; "
        f"{new}< 0 %: the error grows. t: t-statistic of the reduction; (in brackets) its critical value (95 %)."
    )
    return [*parts, _filled(explained)] if parts else []


def candidate_title(one: RankedCandidate) -> str:
    """Name and variant of a candidate."""
    return f"{one.name} ({one.variant})" if one.variant else one.name


def share_across_experiments(one: RankedCandidate, experiments: int) -> float:
    """The share that a candidate removes with whole experiments held out; NaN where there is only one."""
    return one.new if experiments > 1 else float("nan")


def _added(diagnosis: Diagnosis) -> list[str]:
    parts = []
    for effect in diagnosis.effects:
        sizes = [[name, with_interval(q)] for name, q in effect.sizes.items()]
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


def _parameters(segment: Segment) -> list[str]:
    rows = parameter_rows(segment)
    return [f"parameters of the diagram, fitted with it:\n{columns(rows, left=(0, 4, 6))}"] if rows else []


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


def _indistinguishable(segment: Segment) -> list[str]:
    texts = [
        f"{e.name} is indistinguishable from {listed(e.also_possible, 9)} with these data. To separate them: "
        f"{e.separating_experiment or 'another experiment'}."
        for e in segment.effects
        if e.also_possible
    ]
    return _bullets("indistinguishable effects", texts)


def limit_text(one: DetectionLimit) -> str:
    """The smallest detectable size, with its name; empty where the effect is not excited."""
    if one.value is None:
        return ""
    if one.size_name:
        return f"{one.size_name} {in_display_units(one.size, one.size_unit)}"
    return f"{one.parameter.rpartition('.')[2]} {in_display_units(abs(one.value), one.unit)}"


def _limits(segment: Segment, several: bool) -> str:
    detectable = [m for m in segment.limits if m.value is not None]
    named = {one.name for one in segment.effects}
    undetectable = [m for m in segment.limits if m.value is None and m.name not in named]
    where = f" in {segment.name}" if several else ""
    parts = []
    if detectable:
        rows = [[m.name, limit_text(m)] for m in detectable]
        parts.append(f"smallest detectable sizes{where}:\n{columns(rows, '  ', left=(0, 1))}")
    if undetectable:
        text = (
            f"not detectable at any size{where} (not excited by these experiments, without an insertion point, or "
            f"absorbed by parameters of the model): {', '.join(m.name for m in undetectable)}."
        )
        parts.append(_filled(text))
    return "\n\n".join(parts)


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
