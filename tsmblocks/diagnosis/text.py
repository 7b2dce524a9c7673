"""A diagnosis in short, as text: verdict, sizes, errors before and after, residual location, changes, cautions."""

from __future__ import annotations

import functools
import textwrap
from collections.abc import Sequence

from tsmblocks.common.tables import WIDTH, columns, listed, table_width
from tsmblocks.common.views import no_view
from tsmblocks.diagnosis.detectable_sizes import limits_texts
from tsmblocks.diagnosis.lines import bullets, cut, filled, of_segment
from tsmblocks.diagnosis.merged_notes import merged_notes
from tsmblocks.diagnosis.model_difference import changes
from tsmblocks.diagnosis.next_steps import next_steps
from tsmblocks.diagnosis.presentation import (
    absence_text,
    block_title,
    digits,
    display_unit,
    fitted_rms,
    output_traces,
    size_rows,
    with_interval,
)
from tsmblocks.diagnosis.result import Diagnosis
from tsmblocks.diagnosis.segment import Gap, NamedEffect, Segment
from tsmblocks.diagnosis.verdict_text import alternatives, percent, segments_by_verdict, verdict_sentence, verdict_word

MAX_NAME_LENGTH, MIN_HEADING_LENGTH = 28, 11
"""Characters at which a name in a table is cut, and at which a heading of a column is broken at least, in lines of 80.
Chosen."""
MAX_EXPERIMENTS = 10
"""Rows of a table of errors in a summary: of more experiments those with the largest errors are shown. Chosen."""
STATUS = {
    "done": "the search was completed",
    "interrupted": "interrupted; these are the results until then",
    "limit": "ended at the time limit; these are the results until then",
}
MORE = (
    "Details, with --details or found.details(): noise floors, candidates, parameters with intervals, detection "
    "limits, a script."
)
EARLY = {"interrupted": "SEARCH INTERRUPTED. ", "limit": "SEARCH ENDED AT ITS TIME LIMIT. "}


def summary_text(diagnosis: Diagnosis) -> str:
    """What a terminal shows of a diagnosis: verdict, sizes, errors, changes, cautions and notes; no candidates."""
    n = len(diagnosis.experiments)
    several = len(diagnosis.segments) > 1
    early = EARLY.get(diagnosis.status, "")
    parts = []
    for segment in segments_by_verdict(diagnosis):
        parts.append(filled(f"{early}{verdict_word(segment).upper()}. {verdict_sentence(segment)}"))
        parts += bullets("next", next_steps(segment))
    parts += map(_sizes, diagnosis.effects)
    parts.append(filled(f"{diagnosis.diagram or 'diagram'}: {n} experiment{'s' if n > 1 else ''}"))
    for segment in diagnosis.segments:
        parts += [f"== {segment.name} =="] if several else []
        parts += [errors_table(segment, gap, MAX_EXPERIMENTS) for gap in segment.gaps]
        parts += _residual_location(segment)
    parts += _changes(diagnosis)
    for segment in diagnosis.segments:
        parts += bullets(f"beware{of_segment(segment, several)}", segment.cautions)
        parts += _indistinguishable(segment)
        parts += limits_texts(segment, several) if segment.verdict == "none" else []
    parts += _consequence(diagnosis)
    status = f"Random seed {diagnosis.seed}; {STATUS[diagnosis.status]}."
    parts += bullets("notes", [*merged_notes(diagnosis.notes, diagnosis.experiments), status])
    return "\n\n".join([*parts, filled(MORE)])


# ---- tables --------------------------------------------------------------------------------------


def column_titles(segment: Segment) -> list[str]:
    """Titles of the columns of errors: the base, then each effect added."""
    return ["before", *(f"+ {e.block}" for e in segment.effects)]


def errors_table(segment: Segment, gap: Gap, most: int | None = None) -> str:
    """The errors of one output by experiment, of the ``most`` largest: held out, and in the last columns as fitted."""
    k, unit = display_unit(gap.unit)
    last = ["in-sample"] if len(gap.train) == 1 else ["in-sample before", "in-sample after"]
    first, floor = f"rms of {gap.output} [{unit or 'its unit'}]", "floor"
    whole, above = f"noise floor ({gap.given or gap.method})", list[str]()
    before, *added = column_titles(segment)
    made = [f"held-out {before}" if added else "held-out", *added]
    titles, fits = _headings([*made, *last], table_width() - max(len(first), len(whole)))
    if not fits:  # too wide for these in its first column
        first, floor, above = "", "floor", [f"{first}, {whole}:"]
    else:
        floor = whole
    fitted = {t.experiment: fitted_rms(t) for t in output_traces(segment, gap.output)}
    rows: list[tuple[str, tuple[float, ...], tuple[float, ...]]] = [
        ("all", gap.held_out, (gap.train[0], gap.train[-1]))
    ]
    shown = _largest(gap, most)
    rows += [(cut(name, _name_length()), gap.experiments[name], fitted.get(name, ())) for name in shown]
    if gap.whitened:
        rows += [("with noise of the inputs", (gap.noise_floor,), ()), ("all, beside that noise", gap.whitened, ())]
    rows.append((floor, (gap.judged_floor,), ()))
    table = [["", *line] for line in titles[:-1]] + [[first, *titles[-1]]]
    for name, held_out, own in rows:
        cells = [name, *(digits(k * v) for v in (*held_out, *own[: len(last)]))]
        table.append(cells + [""] * (1 + len(titles[0]) - len(cells)))
    left = len(gap.experiments) - len(shown) if shown else 0
    return "\n".join([*above, columns(table), *([f"{left} more experiments have smaller errors."] if left else [])])


def _largest(gap: Gap, most: int | None) -> list[str]:
    """The experiments of the largest errors of the last model, at most so many, in their own order."""
    if len(gap.experiments) == 1:
        return []
    ordered = sorted(gap.experiments, key=lambda name: -gap.experiments[name][-1])
    return [name for name in gap.experiments if name in ordered[:most]]


def _headings(titles: Sequence[str], room: int) -> tuple[list[list[str]], bool]:
    """Lines of headings of columns, broken as little as the room for them asks for; and whether they fit into it."""
    added = [len(title) for title in titles if title.startswith("+ ")]  # names, which are broken last
    for width in (max(map(len, titles)), max([MIN_HEADING_LENGTH, *added]), MIN_HEADING_LENGTH):
        lines = _broken(titles, width)
        if sum(max(map(len, column)) + 2 for column in zip(*lines, strict=True)) <= room:
            return lines, True
    return lines, False


def _broken(titles: Sequence[str], width: int) -> list[list[str]]:
    """Lines of headings of columns of a width, in which long names are broken after an underscore."""
    wrapped = [
        [title] if len(title) <= width else textwrap.wrap(title.replace("_", "_ "), width, break_long_words=False)
        for title in titles
    ]
    lines = [[line.replace("_ ", "_") for line in parts] for parts in wrapped]
    count = max(map(len, lines))
    return [list(row) for row in zip(*([""] * (count - len(parts)) + parts for parts in lines), strict=True)]


def _residual_location(segment: Segment) -> list[str]:
    above, overlap = "of the variance above the noise floor", " (shares overlap)" if len(segment.where) > 1 else ""
    title = f"what predicts the residual{' of the base model' if segment.effects else ''}{overlap}"
    return bullets(title, [f"{percent(w.share)} {above}: {w.words}." for w in segment.where])


def _sizes(effect: NamedEffect) -> str:
    """The sizes of an effect, or the parameters of its block where it has none."""
    rows = size_rows(effect) or [(name, with_interval(q)) for name, q in effect.parameters.items()]
    absent = [filled(text, "  ")] if (text := absence_text(effect)) else []
    return "\n".join([f"{block_title(effect)}:", columns(rows, "  ", left=(0, 1)), *absent])


def _changes(diagnosis: Diagnosis) -> list[str]:
    """What was changed in the diagram."""
    if not diagnosis.effects:
        return []
    lines = [f"{sign} {text}" for sign, text in changes(diagnosis.base, diagnosis.augmented, diagnosis.effects)]
    return ["\n".join(["changes from the fitted base model:", *lines])]


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
    return bullets("indistinguishable effects", [*filter(None, map(indistinguishable_text, segment.effects))])


def _consequence(diagnosis: Diagnosis) -> list[str]:
    found = diagnosis.consequence
    if found is None:
        return []
    k, unit = display_unit(found.unit)
    rows = [
        [f"error [{unit}]", "peak to peak", "rms"],
        ["without compensation", *(digits(k * v) for v in found.none)],
        ["compensator from the base model", *(digits(k * v) for v in found.base)],
        ["compensator from the augmented model", *(digits(k * v) for v in found.augmented)],
    ]
    title = f"simulated tracking of {cut(found.reference, _name_length())}, with the augmented model as the plant:"
    return [f"{filled(title)}\n{columns(rows)}", *([filled(found.words)] if found.words else [])]


# ---- small things --------------------------------------------------------------------------------


def _name_length() -> int:
    """Characters at which a name in a table is cut: more of them where the terminal is wider."""
    return MAX_NAME_LENGTH + max(table_width() - WIDTH, 0) // 2


view = functools.singledispatch(no_view)
view.register(Diagnosis, summary_text)
