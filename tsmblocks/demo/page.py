"""The demonstration as one page: the values of the template ``demo.html``, and its charts."""

from __future__ import annotations

from collections.abc import Sequence
from typing import Any

import numpy as np
from markupsafe import Markup

from tsmblocks.data import Record, heading
from tsmblocks.demo import paper
from tsmblocks.demo.compensators import PERIOD, REFERENCE, Tracked
from tsmblocks.demo.mechanism import DEG, model
from tsmblocks.demo.paper import DIAGRAMS, Case
from tsmblocks.demo.story import FLOOR, IDENTIFIED, Story
from tsmblocks.diagnosis.presentation import by_excess, digits, output_traces, profile, with_interval
from tsmblocks.diagnosis.result import Diagnosis
from tsmblocks.diagnosis.verdict_text import verdict_sentence, verdict_word, worst_gap
from tsmblocks.draw import to_svg
from tsmblocks.files import load
from tsmblocks.html import charts, figures
from tsmblocks.html.charts import LEFT, RIGHT, Frame
from tsmblocks.html.pages import part, rendered
from tsmblocks.simulation.run import Run

POINTS = 600
"""Points of one line at most."""
KINDS = ("before", "between", "after")
"""Classes of lines that are compared, and so their colours; what they are compared with is ``measured``."""

Line = tuple[np.ndarray, np.ndarray, str]
"""Values along x and y, and the class of the line."""


def page(cases: Sequence[Case], story: Story) -> str:
    """The whole page; the same numbers give the same text."""
    diagnosis, residual = story.diagnosis, story.fit.differences.rms
    effects = " and ".join(f"{e.words} on {e.wire.strip()}" for e in diagnosis.effects)
    ends = [story.tracked[0], *(best(story, model) for model in story.models)]
    values = dict(
        title="tsmblocks: from measurements to the missing effect, and to better control",
        diagnosis=diagnosis,
        in_one_line=f"{verdict_word(diagnosis.worst)}{': ' + effects if effects else ''}.",
        errors=[digits(one.error.peak_to_peak) for one in ends],
        paper=_paper(cases),
        floor=digits(FLOOR / DEG),
        recordings=_recordings(story),
        model=to_svg(model()),
        estimates=[(e.name, f"{e.value:.4g}", f"{e.low:.4g} … {e.high:.4g}", e.unit) for e in story.fit.estimates],
        residual={"rms": digits(residual / DEG), "times_noise": f"{residual / FLOOR:.1f}"},
        verdict=verdict_sentence(diagnosis.worst),
        augmented=to_svg(diagnosis.augmented, highlight=[e.block for e in diagnosis.effects]),
        diagnosed=_diagnosed(diagnosis),
        reference=REFERENCE,
        rebuilt=_rebuilt(story),
        hidden=_revealed(story),
        files=[f"recordings/{name}.csv" for name in story.records],
        noise_floor=f"{FLOOR / DEG:.3f}",
    )
    return rendered("demo.html", values)


# ---- chapters ------------------------------------------------------------------------------------


def _paper(cases: Sequence[Case]) -> dict[str, Any]:
    sine = cases[0]
    runs = list(zip(sine.runs.values(), KINDS, strict=True))
    # Columns are narrow on a phone: long words may be parted.
    names = [words.replace("sation", "\u00adsation").replace("feedf", "feed\u00adf") for words in DIAGRAMS.values()]
    return {
        "names": ("l:signal", *names, "the paper measured"),
        "rows": paper.compared(cases),
        "why": paper.WHY.replace("'", "’"),
        "drawn": to_svg(load("fig16_feedforward_feedback")),
        "colours": list(zip(KINDS, DIAGRAMS.values(), strict=True)),
        "charts": (
            _error_chart(runs, f"error for {sine.words}"),
            _loop_chart(runs, "x_in", f"the loop for {sine.words}"),
        ),
    }


def _recordings(story: Story) -> list[Markup]:
    charts = []
    for name, record in story.records.items():
        lines = [
            (record.t, np.rad2deg(record[k]), kind) for k, kind in (("x_in", "between"), ("x_out", "measured thin"))
        ]
        charts.append(_over_time(lines, heading(name, "deg"), f"the recording {name} over time"))
    large = [(story.records[REFERENCE], "measured thin")]
    return [*charts, _loop_chart(large, "x_in", f"the loop of the recording {REFERENCE}")]


def _diagnosed(diagnosis: Diagnosis) -> list[Markup]:
    segment, quiet = diagnosis.worst, diagnosis.verdict == "none"
    gap = worst_gap(segment)
    worst = by_excess(output_traces(segment, gap.output))[0]
    along = [one for w in segment.where[:1] if (one := profile(segment, gap.output, w.coordinate, diagnosis.base))]
    return [
        figures.gap_bars(segment, gap),
        *(figures.residual_over_coordinate(one, explained=bool(diagnosis.effects), quiet=quiet) for one in along),
        figures.signals_chart(worst, POINTS, quiet=quiet),
        figures.residual_chart(worst, gap.noise_floor, POINTS, quiet=quiet),
    ]


def _rebuilt(story: Story) -> dict[str, Any]:
    columns, first, identified = story.models, story.tracked[0], story.on(IDENTIFIED)
    rows = [(first.words, *([_error(first)] * len(columns)))]
    rows += [(words, *(_error(story.on(c).get(words)) for c in columns)) for words in identified]
    steps = [first, identified["feedforward (11)"], best(story, columns[-1])]
    ends = list(zip((best(story, c) for c in columns), KINDS[::2], strict=False))
    by_step = list(zip(steps, KINDS, strict=True))
    errors = _error_chart([(one.run, kind) for one, kind in ends], "error behind the best compensators")
    loops = _loop_chart([(one.run, kind) for one, kind in by_step], "x_ref", "what arrives over what is wanted")
    return {
        "names": ("l:", *(f"model {name}" for name in columns)),
        "rows": rows,
        "charts": (_key(ends) + errors, _key(by_step) + loops),
    }


def _revealed(story: Story) -> dict[str, Any]:
    words = story.hidden.words
    return {
        "words": words[0].upper() + words[1:],
        "sizes": [f"{k} {with_interval(q)}" for e in story.diagnosis.effects for k, q in e.parameters.items()],
        "names": ("l:", "in truth", *story.models),
        "rows": [(name, *(f"{v:.3g}" for v in values)) for name, *values in story.revealed],
        "drawn": to_svg(story.mechanism),
    }


def best(story: Story, on: str) -> Tracked:
    """The compensator on a model with the smallest error."""
    return min(story.on(on).values(), key=lambda one: one.error.peak_to_peak)


def _key(on: Sequence[tuple[Tracked, str]]) -> Markup:
    return part("key", [(kind, ", ".join(filter(None, (one.words, one.model)))) for one, kind in on])


def _error(one: Tracked | None) -> str:
    return "-" if one is None else f"{digits(one.error.peak_to_peak)} ({digits(one.error.rms)})"


# ---- charts --------------------------------------------------------------------------------------


def _error_chart(runs: Sequence[tuple[Run, str]], words: str) -> Markup:
    """Tracking errors of runs in deg, over their last two periods; a class for each."""
    lines = []
    for run, kind in runs:
        late = run.t >= run.t[-1] - 2 * PERIOD
        lines.append((run.t[late], np.rad2deg((run["x_ref"] - run["x_out"])[late]), kind))
    return _over_time(lines, "x_ref - x_out [deg]", words)


def _over_time(lines: Sequence[Line], label: str, words: str) -> Markup:
    drawn = [(*charts.thinned(t, y, POINTS), kind) for t, y, kind in lines]
    limits = (float(min(t[0] for t, _, _ in drawn)), float(max(t[-1] for t, _, _ in drawn)))
    return _chart(drawn, limits, "t [s]", label, words)


def _loop_chart(runs: Sequence[tuple[Run | Record, str]], x: str, words: str) -> Markup:
    """``x_out`` over a signal in deg, in the last period of each run."""
    lines: list[Line] = []
    for run, kind in runs:
        late = run.t >= run.t[-1] - PERIOD
        across, up = charts.sampled(POINTS // 2, np.rad2deg(run[x][late]), np.rad2deg(run["x_out"][late]))
        lines.append((across, up, kind))
    return _chart(lines, charts.spread(*(x for x, _, _ in lines)), f"{x} [deg]", "x_out [deg]", words)


def _chart(lines: Sequence[Line], limits: tuple[float, float], x_label: str, y_label: str, words: str) -> Markup:
    frame = Frame(LEFT, 22, RIGHT, 170, limits, charts.spread(*(y for _, y, _ in lines)))
    parts = [charts.axes(frame, x_label, y_label), *(charts.line(frame, *line) for line in lines)]
    return charts.chart(parts, 204, words)
