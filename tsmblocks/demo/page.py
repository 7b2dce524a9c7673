"""The demonstration as one page: the values of the template ``demo.html``, and its charts."""

from __future__ import annotations

from collections.abc import Sequence
from itertools import pairwise
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
from tsmblocks.diagnosis.verdict_text import verdict_sentence, worst_gap
from tsmblocks.draw import to_svg
from tsmblocks.files import load
from tsmblocks.html import charts, figures
from tsmblocks.html.charts import LEFT, RIGHT, Frame
from tsmblocks.html.pages import part, rendered
from tsmblocks.html.report import WORDS

POINTS = 600
"""Points of one line at most."""
KINDS = ("before", "between", "after")
"""Classes of lines that are compared, and so their colours; what they are compared with is ``measured``."""

Line = tuple[np.ndarray, np.ndarray, str]
"""Across, up, class."""


def page(cases: Sequence[Case], story: Story) -> str:
    """The whole page; the same numbers give the same text."""
    diagnosis = story.diagnosis
    ends = [story.tracked[0], *(best(story, model) for model in story.models)]
    values = dict(
        title="tsmblocks: from measurements to the missing effect, and to better control",
        diagnosis=diagnosis,
        in_one_line=_summary(diagnosis),
        errors=[digits(one.error.peak_to_peak) for one in ends],
        paper=_paper(cases),
        floor=digits(FLOOR / DEG),
        recordings=_recordings(story),
        model=to_svg(model()),
        estimates=[(e.name, f"{e.value:.4g}", f"{e.low:.4g} … {e.high:.4g}", e.unit) for e in story.fit.estimates],
        left={
            "rms": digits(story.fit.differences.rms / DEG),
            "times_noise": f"{story.fit.differences.rms / FLOOR:.1f}",
        },
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


def _summary(diagnosis: Diagnosis) -> str:
    words = " and ".join(f"{e.words} on {e.wire.strip()}" for e in diagnosis.effects)
    return f"{WORDS[diagnosis.verdict]}{': ' + words if words else ''}."


def _paper(cases: Sequence[Case]) -> dict[str, Any]:
    sine = cases[0]
    runs = list(zip(sine.runs.values(), KINDS, strict=True))
    errors = [_late(run.t, run["x_ref"] - run["x_out"], kind) for run, kind in runs]
    loops = [_loop(run["x_in"], run["x_out"], run.t, kind) for run, kind in runs]
    return {
        "names": ("l:signal", *(_hyphened(words) for words in DIAGRAMS.values()), "the paper measured"),
        "rows": paper.compared(cases),
        "why": paper.WHY.replace("'", "’"),
        "drawn": to_svg(load("fig16_feedforward_feedback")),
        "colours": list(zip(KINDS, DIAGRAMS.values(), strict=True)),
        "charts": (
            _chart(errors, "t [s]", "x_ref - x_out [deg]", f"error for {sine.words}"),
            _chart(loops, "x_in [deg]", "x_out [deg]", f"the loop for {sine.words}"),
        ),
    }


def _hyphened(words: str) -> str:
    """The heading of a column that is narrow on a phone: its long words may be parted."""
    return words.replace("compensation", "compen\u00adsation").replace("feedforward", "feed\u00adforward")


def _recordings(story: Story) -> list[Markup]:
    large = story.records[REFERENCE]
    loop = _loop(large["x_in"], large["x_out"], large.t, "measured thin")
    last = _chart([loop], "x_in [deg]", heading("x_out", "deg"), f"the loop of the recording {REFERENCE}")
    return [*(_recording(name, record) for name, record in story.records.items()), last]


def _diagnosed(diagnosis: Diagnosis) -> dict[str, Any]:
    segment = diagnosis.worst
    gap = worst_gap(segment)
    worst = by_excess(output_traces(segment, gap.output))[0]
    along = [one for w in segment.where[:1] if (one := profile(segment, gap.output, w.coordinate, diagnosis.base))]
    colours = [
        ("measured", "measured"),
        ("before", "before"),
        ("after", "with the reported effects"),
        ("hollow", "hollow: on the data it was fitted to"),
        ("noise", "noise, ± 2 rms"),
    ]
    return {
        "colours": [one for one in colours if diagnosis.effects or one[0] != "after"],
        "charts": [
            figures.gap_bars(segment, gap),
            *(figures.residual_over_coordinate(one, explained=bool(diagnosis.effects)) for one in along),
            figures.signals_chart(worst, POINTS),
            figures.residual_chart(worst, gap.noise_floor, POINTS),
        ],
    }


def _rebuilt(story: Story) -> dict[str, Any]:
    columns = story.models
    first = story.tracked[0]
    rows = [(first.words, *([_error(first)] * len(columns)))]
    rows += [(words, *(_error(story.on(c).get(words)) for c in columns)) for words in story.on(IDENTIFIED)]
    paper_s, ends = _steps(story), _ends(story)
    lines = [_late(one.run.t, one.run["x_ref"] - one.run["x_out"], kind) for one, kind in ends]
    loops = [_loop(one.run["x_ref"], one.run["x_out"], one.run.t, kind) for one, kind in paper_s]
    return {
        "names": ("l:", *(f"model {name}" for name in columns)),
        "rows": rows,
        "charts": (
            _keyed(ends, _chart(lines, "t [s]", "x_ref - x_out [deg]", "error behind the best compensators")),
            _keyed(paper_s, _chart(loops, "x_ref [deg]", "x_out [deg]", "what arrives over what is wanted")),
        ),
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


# ---- charts and comparisons ----------------------------------------------------------------------


def best(story: Story, on: str) -> Tracked:
    """The compensator on a model with the smallest error."""
    return min(story.on(on).values(), key=lambda one: one.error.peak_to_peak)


def _ends(story: Story) -> list[tuple[Tracked, str]]:
    """The best compensator on each model."""
    on = [best(story, model) for model in story.models]
    return list(zip(on, KINDS[::2], strict=False))


def _steps(story: Story) -> list[tuple[Tracked, str]]:
    """No compensation, the paper's compensator, and the best one."""
    on = [story.tracked[0], story.on(IDENTIFIED)["feedforward (11)"], best(story, story.models[-1])]
    return list(zip(on, KINDS, strict=True))


def _keyed(on: Sequence[tuple[Tracked, str]], drawn: Markup) -> Markup:
    """A chart of runs below the key of its colours."""
    return part("key", [(kind, ", ".join(filter(None, (one.words, one.model)))) for one, kind in on]) + drawn


def _error(one: Tracked | None) -> str:
    return "-" if one is None else f"{digits(one.error.peak_to_peak)} ({digits(one.error.rms)})"


def _late(t: np.ndarray, y: np.ndarray, kind: str) -> Line:
    """Two periods of a signal in deg, its last ones, thinned."""
    kept = t >= t[-1] - 2 * PERIOD
    return (*charts.thinned(t[kept], np.rad2deg(y[kept]), POINTS), kind)


def _loop(x: np.ndarray, y: np.ndarray, t: np.ndarray, kind: str) -> Line:
    """One period, the last, of one signal over another in deg."""
    kept = t >= t[-1] - PERIOD
    return (*charts.sampled(POINTS // 2, np.rad2deg(x[kept]), np.rad2deg(y[kept])), kind)  # type: ignore[return-value]


def _recording(name: str, record: Record) -> Markup:
    lines = [
        (*charts.thinned(record.t, np.rad2deg(record[k]), POINTS), kind)
        for k, kind in (("x_in", "between"), ("x_out", "measured thin"))
    ]
    return _chart(lines, "t [s]", heading(name, "deg"), f"the recording {name} over time")


def _chart(lines: Sequence[Line], x_label: str, y_label: str, words: str) -> Markup:
    frame = Frame(LEFT, 22, RIGHT, 170, _span(*(x for x, _, _ in lines)), charts.spread(*(y for _, y, _ in lines)))
    parts = [charts.axes(frame, x_label, y_label), *(charts.line(frame, *line) for line in lines)]
    return charts.chart(parts, 204, words)


def _span(*signals: np.ndarray) -> tuple[float, float]:
    every = np.concatenate(signals)
    rising = all(b >= a for a, b in pairwise(signals[0]))
    return (float(every.min()), float(every.max())) if rising else charts.spread(every)
