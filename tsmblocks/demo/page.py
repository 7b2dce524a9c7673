"""The demonstration as one page: the values of the template ``demo.html``, and its charts."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from typing import Any

import numpy as np
from markupsafe import Markup

from tsmblocks.data import Record, heading
from tsmblocks.demo import findings, paper
from tsmblocks.demo.compensators import FEEDFORWARD, PERIOD, REFERENCE, Tracked
from tsmblocks.demo.mechanism import DEG
from tsmblocks.demo.paper import DIAGRAMS, Case
from tsmblocks.demo.story import FLOOR, IDENTIFIED, Story
from tsmblocks.demo.text import TITLES
from tsmblocks.diagnosis.presentation import by_excess, output_traces, profile
from tsmblocks.diagnosis.reported_gap import worst_gap
from tsmblocks.diagnosis.result import Diagnosis
from tsmblocks.diagnosis.verdict_text import verdict_sentence, verdict_word
from tsmblocks.draw import to_svg
from tsmblocks.files import load
from tsmblocks.fitting.text import estimate_rows
from tsmblocks.html import charts, figures
from tsmblocks.html.charts import LEFT, RIGHT, Frame
from tsmblocks.html.pages import FLUSH_LEFT, part, rendered
from tsmblocks.html.report import line_colours, model_colours, profile_figure
from tsmblocks.simulation.run import Run

POINTS = 600
"""Points of one line at most."""
OPEN, FORWARD, FEEDBACK = "open", "forward", "feedback"
"""Classes of lines, and so their colours: without compensation, with feedforward, with feedback as well."""
MODELS = ("before", "after")
"""The same of the models: as identified, and with what was found."""
SHAPES = {OPEN: "dash", FEEDBACK: "dash", "input": "dash"}
"""Lines that are dashed."""

Line = tuple[np.ndarray, np.ndarray, str]
"""Values along x and y, and the class of the line."""


def page(cases: Sequence[Case], story: Story, files: Mapping[str, Sequence[str]]) -> str:
    """The whole page; the same numbers give the same text. ``files`` are those beside it, by what they are."""
    diagnosis = story.diagnosis
    ends = [story.tracked[0], *(best(story, model) for model in story.models)]
    hidden, found = findings.headline(story)
    names, *rows = findings.tracking(story)
    values = dict(
        title=f"tsmblocks demonstration. {found}",
        back=None,
        seed=diagnosis.seed,
        name=story.name,
        titles=TITLES,
        hidden=hidden,
        found=found,
        tried=findings.search(story),
        diagnosis=diagnosis,
        errors=[findings.rounded(one.error.peak_to_peak) for one in ends],
        revealed=_revealed(story),
        measurement=findings.measurement(story),
        recordings=_recordings(story),
        model=to_svg(story.fit.diagram),
        estimates=_estimates(story),
        gap=findings.gap(story),
        search=findings.search(story),
        word=verdict_word(diagnosis.worst),
        verdict=verdict_sentence(diagnosis.worst),
        augmented=to_svg(diagnosis.augmented, highlight=[e.block for e in diagnosis.effects]),
        diagnosed=_diagnosed(diagnosis),
        mechanism=to_svg(story.mechanism),
        reference=REFERENCE,
        which=findings.which(story),
        tracking={"names": (f"{FLUSH_LEFT}{names[0]}", *names[1:]), "rows": rows},
        worse=findings.worse(story),
        charts=_tracked(story),
        paper=_paper(cases),
        files=list(files.items()),
        recorded=[f"recordings/{name}.csv" for name in story.records],
        noise_floor=f"{FLOOR / DEG:.3f}",
    )
    return rendered("demo.html", values)


# ---- chapters ------------------------------------------------------------------------------------


def _revealed(story: Story) -> dict[str, Any]:
    _, *names = findings.heading(story)
    return {
        "names": (f"{FLUSH_LEFT}quantity", *names),
        "rows": [row.cells[: len(names) + 1] for row in findings.revealed(story)],
        "intervals": findings.intervals(story),
    }


def _recordings(story: Story) -> list[Markup]:
    """The loop of the largest motion, then each recording over time."""
    made = [
        _loop_chart([(story.records[REFERENCE], "measured thin")], "x_in", f"the loop of the recording {REFERENCE}")
    ]
    made = [
        part("figure", made[0], f"{REFERENCE}: the tip over the motor, one period", [("measured", "measured", "line")])
    ]
    for name, record in story.records.items():
        lines = [(record.t, np.rad2deg(record[k]), kind) for k, kind in (("x_out", "measured thin"), ("x_in", "input"))]
        chart = _over_time(lines, heading(name, "deg"), f"the recording {name} over time")
        colours = [("input", "x_in, motor", "dash"), ("measured", "x_out, tip", "line")]
        made.append(part("figure", chart, f"{name}: both ends over time", colours))
    return made


def _estimates(story: Story) -> list[tuple[str, ...]]:
    """Heading and rows of the parameters that were identified, without columns that are empty."""
    head, *rows = estimate_rows(story.fit, [e for e in story.fit if not e.is_start])
    kept = [k for k in range(len(head)) if any(row[k] for row in rows)]
    left = {"parameter", "unit", ""}
    names = tuple(f"{FLUSH_LEFT if head[k] in left else ''}{head[k] or 'remark'}" for k in kept)
    return [names, *(tuple(row[k] for k in kept) for row in rows)]


def _diagnosed(diagnosis: Diagnosis) -> list[Markup]:
    segment, quiet = diagnosis.worst, diagnosis.verdict == "none"
    gap, colours = worst_gap(segment), model_colours(diagnosis.segments)
    worst = by_excess(output_traces(segment, gap.output))[0]
    along = [one for w in segment.where[:1] if (one := profile(segment, gap.output, w.coordinate))]
    lines, name = line_colours(colours), worst.experiment
    return [
        *(profile_figure(one, explained=bool(diagnosis.effects), quiet=quiet) for one in along),
        part("figure", figures.gap_bars(segment, gap), "Error on held-out data", [*colours, *figures.OF_BARS]),
        part(
            "figure", figures.signals_chart(worst, POINTS, quiet=quiet), f"{name}: measured and simulated", lines[:-1]
        ),
        part(
            "figure",
            figures.residual_chart(worst, gap.noise_floor, POINTS, quiet=quiet),
            f"{name}: the residual; cells above it are blocks of time, the stronger the further above the noise",
            lines[1:],
        ),
    ]


def _tracked(story: Story) -> list[Markup]:
    first, identified = story.tracked[0], story.on(IDENTIFIED)
    kinds = MODELS if story.diagnosis.effects else MODELS[1:]
    ends = [(best(story, name), kind) for name, kind in zip(story.models, kinds, strict=True)]
    steps = [(first, OPEN), (identified[FEEDFORWARD], FORWARD), ends[-1]]
    errors = _error_chart([(one.run, kind) for one, kind in ends], "error behind the best compensators")
    loops = _loop_chart([(one.run, kind) for one, kind in steps], "x_ref", "output against reference")
    return [
        part("figure", errors, "Tracking error behind the best compensator on each model", _key(ends)),
        part("figure", loops, "Output against reference: a straight line is perfect tracking", _key(steps)),
    ]


def _paper(cases: Sequence[Case]) -> dict[str, Any]:
    sine, kinds = cases[0], (OPEN, FORWARD, FEEDBACK)
    runs = list(zip(sine.runs.values(), kinds, strict=True))
    colours = [(kind, words, SHAPES.get(kind, "line")) for kind, words in zip(kinds, DIAGRAMS.values(), strict=True)]
    errors, loops = (
        _error_chart(runs, f"error for {sine.words}"),
        _loop_chart(runs, "x_in", f"the loop for {sine.words}"),
    )
    return {
        "names": (f"{FLUSH_LEFT}signal", *map(_parted, DIAGRAMS.values()), "the paper measured"),
        "rows": paper.compared(cases),
        "why": paper.WHY,
        "drawn": to_svg(load("fig16_feedforward_feedback")),
        "charts": (
            part("figure", errors, f"Tracking error for {sine.words}", colours),
            part("figure", loops, f"The tip over the motor for {sine.words}", colours),
        ),
    }


def _parted(words: str) -> str:
    """A name whose long words may be parted where a column is narrow, as on a phone."""
    return words.replace("sation", "\u00adsation").replace("feedf", "feed\u00adf")


def best(story: Story, on: str) -> Tracked:
    """The compensator on a model with the smallest error."""
    return min(story.on(on).values(), key=lambda one: one.error.peak_to_peak)


def _key(on: Sequence[tuple[Tracked, str]]) -> list[tuple[str, str, str]]:
    """What the colours of some runs mean."""
    words = [f"{one.words}, model {one.model}" if one.model else one.words for one, _ in on]
    return [(kind, name, SHAPES.get(kind, "line")) for (_, kind), name in zip(on, words, strict=True)]


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
