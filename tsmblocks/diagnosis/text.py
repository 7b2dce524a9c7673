"""A diagnosis in words: the verdict first, then how the gap shrank, where it was, what was tried, what was added."""

from __future__ import annotations

import functools
import re
import textwrap
from collections.abc import Iterator, Sequence

import numpy as np

from tsmblocks.common.tables import WIDTH, columns, listed
from tsmblocks.common.views import no_view
from tsmblocks.diagnosis.model_difference import difference
from tsmblocks.diagnosis.noise_floor import MAX_FLOOR_RATIO
from tsmblocks.diagnosis.presentation import (
    digits,
    fitted_rms,
    for_people,
    in_display_units,
    main_parameter,
    output_traces,
    with_interval,
)
from tsmblocks.diagnosis.result import DetectionLimit, Diagnosis, Gap, NamedEffect, RankedCandidate, Segment
from tsmblocks.diagnosis.script import script_lines
from tsmblocks.fitting.input_checks import runs_ahead
from tsmblocks.fitting.text import estimate_rows

WEAK_EXCESS = 0.05
"""Excess over the noise, as a share of it, that is told even where nothing can be named."""
REMAINING_ERROR_RATIO = 1.1
"""Error beside the noise from which something is left after all that was named."""
MAX_NAME_LENGTH, MAX_HEADING_LENGTH = 28, 14
"""Characters at which a name in a table is cut, and the heading of a column of numbers."""
NAME_AND_WIRE_WIDTH = 48
"""Characters that the name of a candidate and its wire have together, so that a row fits a terminal."""
MAX_ROWS = 8
"""Candidates of a round that are told; of one in which nothing was named, if others were, ``MAX_ROWS_UNNAMED``."""
MAX_ROWS_UNNAMED = 3
MAX_MEANINGFUL_SHARE = 10.0
"""Share of the excess above which there was no excess to speak of, so that the share says nothing."""
PLACEHOLDER = "\0"
_NUMBER = re.compile(r"(?:\d{4}-\d\d-\d\d )?\d\d:\d\d:\d\d(?:\.\d+)?|(?<![\w.])\d+(?:\.\d+)?(?![\w.]*\w)")
STATUS = {"done": "done", "interrupted": "interrupted; this is what was found until then"}


def diagnosis_text(diagnosis: Diagnosis) -> str:
    """The whole diagnosis as a terminal shows it."""
    n = len(diagnosis.experiments)
    head = f"{diagnosis.diagram or 'diagram'}: {n} experiment{'s' if n > 1 else ''}"
    parts = [textwrap.fill(head, WIDTH), _verdicts(diagnosis)]
    several = len(diagnosis.segments) > 1
    for segment in diagnosis.segments:
        title = f"== {segment.name} =="
        parts += [title] if several else []
        parts += [*map(gap_table, _gaps(segment)), *_where(segment), *_ranking(segment)]
    parts += _added(diagnosis)
    parts += [text for segment in diagnosis.segments for text in (*_numbers(segment), *_beware(segment))]
    parts += _script(diagnosis)
    parts += [text for segment in diagnosis.segments for text in _confusion(segment)]
    parts += [_limits(segment, several) for segment in diagnosis.segments if segment.limits]
    parts += _consequence(diagnosis)
    notes = merged_notes(diagnosis.notes, diagnosis.experiments)
    notes.append(f"Seed {diagnosis.seed}; {STATUS[diagnosis.status]}.")
    parts.append("\n".join(["notes:", *map(_bullet, notes)]))
    return "\n\n".join(parts)


# ---- the verdict ---------------------------------------------------------------------------------


def verdict_sentence(segment: Segment) -> str:
    """What is said of a segment in a sentence or two, sizes with their intervals, angles in degrees."""
    between, ahead = f"Between {_ends(segment)}", _ahead(segment)
    if segment.verdict == "named":
        missing = [f"{e.words} ({_size(e, segment)})" for e in segment.effects]
        return (
            f"{between} the model misses {listed(missing, len(missing))}. {_shrinks(segment)} {_also(segment)}{ahead}"
        )
    if segment.verdict == "unknown":
        best = max((r.share for r in segment.ranking if r.fitted and r.round == 1), default=0.0)
        along = "; ".join(w.words for w in segment.where) or "it follows none of the coordinates looked at"
        return (
            f"{between} the model misses something that no block of the catalogue explains: the best removes "
            f"{percent(max(best, 0.0))} of the error. Where it is: {along}. {_left(segment)}{ahead}"
        )
    weak = " There is a weak excess, below what these data can name." if segment.excess > WEAK_EXCESS else ""
    return f"{between} nothing is missing that these data could show. {_left(segment)}{weak}{_doubt(segment)}"


def _doubt(segment: Segment) -> str:
    """A word about a noise floor above what the model leaves."""
    high = [g.output for g in segment.gaps if g.held_out[0] * MAX_FLOOR_RATIO < g.noise_floor]
    return (
        f" But the noise floor given for {listed(high, 3)} cannot be right: the model leaves less than that."
        if high
        else ""
    )


def _ahead(segment: Segment) -> str:
    """A word about an output that runs ahead of the input, in the first experiment where it does."""
    traces = (trace for output in segment.outputs for trace in output_traces(segment, output))
    said = (runs_ahead((t.drive_name, t.output), t.t, t.drive, t.measured, t.before) for t in traces if t.drive_name)
    words = next(filter(None, said), "")
    return f" But {words}" if words else ""


def _ends(segment: Segment) -> str:
    return f"{', '.join(segment.inputs) or 'the start'} and {', '.join(segment.outputs)}"


def _size(effect: NamedEffect, segment: Segment) -> str:
    main = main_parameter(effect, segment)
    size = f", {main.rpartition('.')[2]} {with_interval(effect.parameters[main])}" if main else ""
    block = "" if effect.block == effect.name else f" as block {effect.block}"
    return f"{effect.name}{block} on {effect.wire.strip()}{size}"


def worst_gap(segment: Segment) -> Gap:
    """The gap of the output that is furthest above its noise."""
    return max(segment.gaps, key=lambda g: g.held_out[0] / g.noise_floor if g.noise_floor > 0 else 0.0)


def _shrinks(segment: Segment) -> str:
    gap = worst_gap(segment)
    k, unit = for_people(gap.unit)
    share = percent(min(sum(e.share_removed for e in segment.effects), 1.0))
    them = "it" if len(segment.effects) == 1 else "them"
    return (
        f"With {them}, the error of {gap.output} on data held out falls from {digits(k * gap.held_out[0])} to "
        f"{_rms(k * gap.held_out[-1], unit)} (noise {digits(k * gap.noise_floor)}), which is {share} of "
        f"what can be explained. {_remains(segment, gap)}".rstrip()
    )


def _remains(segment: Segment, gap: Gap) -> str:
    """What is said where the last model still leaves more than noise."""
    ratio = gap.held_out[-1] / gap.noise_floor if gap.noise_floor > 0 else 1.0
    if ratio < REMAINING_ERROR_RATIO:
        return ""
    looked = any(r.round > len(segment.effects) for r in segment.ranking)
    why = "that no effect of the catalogue explains" if looked else "that was not looked into any further"
    return f"That is still {ratio:.1f} times the noise: something is left {why}."


def _rms(value: float, unit: str) -> str:
    return " ".join(filter(None, (digits(value), unit, "rms")))


def _also(segment: Segment) -> str:
    also = sorted({name for e in segment.effects for name in e.also_possible})
    return f"Also possible: {listed(also, 9) if also else 'nothing else of the catalogue'}."


def _left(segment: Segment) -> str:
    gap = worst_gap(segment)
    k, unit = for_people(gap.unit)
    return (
        f"The error of {gap.output} on data held out is {_rms(k * gap.held_out[0], unit)}, "
        f"its noise {digits(k * gap.noise_floor)}."
    )


def _verdicts(diagnosis: Diagnosis) -> str:
    return "\n\n".join(_filled(f"{s.verdict.upper()}. {verdict_sentence(s)}") for s in segments_by_verdict(diagnosis))


def segments_by_verdict(diagnosis: Diagnosis) -> list[Segment]:
    """The segments, those with something to say first."""
    order = {"named": 0, "unknown": 1, "none": 2}
    return sorted(diagnosis.segments, key=lambda s: order.get(s.verdict, 3))


# ---- tables --------------------------------------------------------------------------------------


def column_titles(segment: Segment) -> list[str]:
    """What the columns of a gap are called: the base, then each effect added."""
    return ["before", *(f"+ {e.block}" for e in segment.effects)]


def _gaps(segment: Segment) -> list[tuple[Segment, Gap]]:
    return [(segment, gap) for gap in segment.gaps]


def gap_table(one: tuple[Segment, Gap]) -> str:
    """How one output's error shrank, per experiment: held out, and in the last columns as fitted."""
    segment, gap = one
    k, unit = for_people(gap.unit)
    fitted = {t.experiment: fitted_rms(t) for t in output_traces(segment, gap.output)}
    last = ["fitted"] if len(gap.train) == 1 else ["fit before", "fit after"]
    rows = [
        [
            f"rms of {gap.output} held out [{unit or 'its unit'}]",
            *(_cut(s, MAX_HEADING_LENGTH) for s in column_titles(segment)),
            *last,
        ]
    ]
    ends = [gap.train[0], gap.train[-1]][: len(last)]
    rows.append(["all", *(digits(k * v) for v in gap.held_out), *(digits(k * v) for v in ends)])
    for name, values in gap.experiments.items() if len(gap.experiments) > 1 else ():
        own = fitted.get(name, ())[: len(last)]
        rows.append(
            [
                _cut(name),
                *(digits(k * v) for v in values),
                *(digits(k * v) for v in own),
                *[""] * (len(last) - len(own)),
            ]
        )
    floor = f"noise floor ({gap.given or gap.method})"
    rows.append([floor, digits(k * gap.noise_floor), *[""] * (len(gap.held_out) - 1 + len(last))])
    return columns(rows)


def _where(segment: Segment) -> list[str]:
    if not segment.where:
        return []
    lines = [_bullet(f"{percent(w.share)} of the excess: {w.words}.") for w in segment.where]
    return ["\n".join(["where they disagree:", *lines])]


def _ranking(segment: Segment) -> list[str]:
    """The candidates that were fitted, round by round; how many others promised too little."""
    made, several = list[str](), len(segment.gaps[0].experiments)
    for number in sorted({r.round for r in segment.ranking}):
        here = [r for r in segment.ranking if r.round == number]
        fitted = [r for r in here if r.fitted]
        if not fitted:
            continue
        shown = fitted[: MAX_ROWS_UNNAMED if segment.effects and not any(r.named for r in fitted) else MAX_ROWS]
        room = (
            NAME_AND_WIRE_WIDTH
            + (0 if several > 1 else len("  new exp."))
            - max(len(_cut(candidate_title(r))) for r in shown)
        )
        rows = [["  candidate", "on", "removes", *["new exp."][: several - 1], f"t ({fitted[0].line:.2g})"]]
        rows += [
            [
                f"{ranking_mark(r) or ' '} {_cut(candidate_title(r))}",
                _cut(r.wire.strip(), room),
                percent(r.share),
                *[percent(share_across_experiments(r, several))][: several - 1],
                f"{r.t:.1f}",
            ]
            for r in shown
        ]
        rest = len(here) - len(shown)
        more = f"\nOther candidates, which promised or removed less: {rest}." if rest else ""
        key = "* named, ~ cannot be told from it" if any(r.named for r in here) else "none named"
        made.append(f"candidates, round {number} ({key}):\n{columns(rows, left=(0, 1))}{more}")
    return [*made, _filled(columns_explained(several > 1))] if made else []


def columns_explained(several: bool) -> str:
    """What the columns of the tables of candidates say."""
    new = "new exp.: the same with whole experiments held out; " if several else ""
    return (
        "removes: share of the error above the noise that goes with it, on blocks of time held out; "
        f"{new}< 0 %: the error grows. t: how many times its own scatter that is; (in brackets) what chance stays "
        "below."
    )


def ranking_mark(one: RankedCandidate) -> str:
    """A star for what was named, a tilde for what cannot be told from it."""
    return "*" if one.named else "~" if one.in_set else ""


def candidate_title(one: RankedCandidate) -> str:
    """Name and variant of a candidate."""
    return f"{one.name} ({one.variant})" if one.variant else one.name


def share_across_experiments(one: RankedCandidate, experiments: int) -> float:
    """The share that a candidate removes with whole experiments held out; NaN where there is one or none."""
    return one.new if experiments > 1 else float("nan")


def _added(diagnosis: Diagnosis) -> list[str]:
    if not diagnosis.effects:
        return []
    parts = []
    for effect in diagnosis.effects:
        rows = [[name, with_interval(q)] for name, q in effect.parameters.items()]
        parts.append(f"{effect.block} ({effect.name}):\n{columns(rows, '  ', left=(0, 1))}")
    lines = [f"{sign} {text}" for sign, text in difference(diagnosis.base, diagnosis.augmented).lines]
    parts.append("\n".join(["what was added to the diagram:", *lines]))
    return parts


def parameter_rows(segment: Segment) -> list[tuple[str, ...]]:
    """The diagram's own numbers as the last model has them, with intervals: the heading first; start values aside."""
    if segment.fit is None:
        return []
    added = tuple(f"{e.block}." for e in segment.effects)
    own = [e for e in segment.fit if not e.is_start and not e.name.startswith(added or "\0")]
    return estimate_rows(segment.fit, own) if own else []


def _numbers(segment: Segment) -> list[str]:
    rows = parameter_rows(segment)
    return [f"the diagram's own numbers, found with it:\n{columns(rows, left=(0, 4, 6))}"] if rows else []


def _beware(segment: Segment) -> list[str]:
    return ["\n".join(["beware:", *map(_bullet, segment.cautions)])] if segment.cautions else []


def initial_states_text(diagnosis: Diagnosis) -> str:
    """How the start states that were found are used; empty where there are none."""
    if not any(diagnosis.start_states.values()):
        return ""
    return (
        "The errors told are those of simulations that begin at start states found for each experiment: "
        "found.start_states, and start_states in diagnosis.json; found.diagrams has a diagram for each."
    )


def _script(diagnosis: Diagnosis) -> list[str]:
    if not diagnosis.effects:
        return []
    words = initial_states_text(diagnosis)
    lines = ["in a script:", *(f"  {line}".rstrip() for line in script_lines(diagnosis))]
    return [*([_filled(words)] if words else []), "\n".join(lines)]


def _confusion(segment: Segment) -> list[str]:
    said = [
        _bullet(
            f"{e.name} cannot be told from {listed(e.also_possible, 9)} with these data. To separate them: "
            f"{e.separating_experiment or 'another experiment'}."
        )
        for e in segment.effects
        if e.also_possible
    ]
    return ["\n".join(["what may be confused:", *said])] if said else []


def limit_text(one: DetectionLimit) -> str:
    """The smallest size that would have been seen: its parameter and number; empty where it is not excited."""
    if one.value is None:
        return ""
    return f"{one.parameter.rpartition('.')[2]} {in_display_units(abs(one.value), one.unit)}"


def _limits(segment: Segment, several: bool) -> str:
    seen = [m for m in segment.limits if m.value is not None]
    blind = [m for m in segment.limits if m.value is None]
    where = f" in {segment.name}" if several else ""
    parts = []
    if seen:
        parts.append(
            f"the smallest sizes that would have been seen{where}:\n"
            + columns([[m.name, limit_text(m)] for m in seen], "  ", left=(0, 1))
        )
    if blind:
        names = ", ".join(m.name for m in blind)
        parts.append(
            textwrap.fill(
                f"of any size unseen{where}, since these experiments do not excite them or the "
                f"diagram has no wire for them: {names}.",
                WIDTH,
                break_on_hyphens=False,
            )
        )
    return "\n\n".join(parts)


def _consequence(diagnosis: Diagnosis) -> list[str]:
    found = diagnosis.consequence
    if found is None:
        return [_filled(f"What it means for control: {diagnosis.no_consequence}")] if diagnosis.no_consequence else []
    k, unit = for_people(found.unit)
    rows = [[f"tracking {_cut(found.reference)} [{unit}]", "peak to peak", "rms"]]
    for words, (peak, rms) in (
        ("without compensation", found.none),
        ("compensated with the base", found.base),
        ("compensated with the new model", found.augmented),
    ):
        rows.append([words, digits(k * peak), digits(k * rms)])
    return [columns(rows), *([_filled(found.words)] if found.words else [])]


def merged_notes(notes: Sequence[str], experiments: Sequence[str]) -> list[str]:
    """Notes that say the same of several experiments as one, their numbers as a range."""
    groups: dict[str, list[tuple[str, list[str]]]] = {}
    for note in notes:
        name, colon, text = note.partition(": ")
        own = bool(colon) and name in experiments
        key = _NUMBER.sub(PLACEHOLDER, text) if own else note
        groups.setdefault(key, []).append((name if own else "", _NUMBER.findall(text) if own else []))
    made = []
    for key, found in groups.items():
        names = [name for name, _ in found if name]
        if not names:
            made.append(key)
            continue
        parts = iter([_range(column) for column in zip(*(numbers for _, numbers in found), strict=True)])
        made.append(f"{_of(names, experiments)}: {''.join(_filled_in(key, parts))}")
    return made


def _filled_in(key: str, numbers: Iterator[str]) -> Iterator[str]:
    head, *others = key.split(PLACEHOLDER)
    yield head
    for text in others:
        yield next(numbers) + text


def _of(names: Sequence[str], experiments: Sequence[str]) -> str:
    return "all experiments" if len(names) == len(experiments) > 1 else listed(names, 5)


def _range(texts: Sequence[str]) -> str:
    clock = any(":" in text for text in texts)
    low, high = (end(texts) if clock else end(texts, key=float) for end in (min, max))
    return low if low == high else f"{low} to {high}" if clock else f"{low}–{high}"


# ---- small things --------------------------------------------------------------------------------


def percent(share: float) -> str:
    """A share in percent; nothing where it means nothing, and no more than its sign where the error grew.

    More than all cannot go: what seems to is a noise floor that was put too high.
    """
    if not np.isfinite(share) or share > MAX_MEANINGFUL_SHARE:
        return ""
    return "< 0 %" if share < -0.005 else f"{100 * min(max(share, 0.0), 1.0):z.0f} %"


def _cut(text: str, most: int = MAX_NAME_LENGTH) -> str:
    return text if len(text) <= most else text[: most - 1] + "…"


def _bullet(text: str) -> str:
    return _filled(text, "- ", "  ")


def _filled(text: str, first: str = "", others: str = "") -> str:
    """A text in lines that fit a terminal; no percent sign stands alone."""
    lines = textwrap.fill(
        text.replace(" %", "\xa0%"),
        WIDTH,
        initial_indent=first,
        subsequent_indent=others,
        break_long_words=False,
        break_on_hyphens=False,
    )
    return lines.replace("\xa0", " ")


view = functools.singledispatch(no_view)
view.register(Diagnosis, diagnosis_text)
