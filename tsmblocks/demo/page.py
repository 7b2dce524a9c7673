"""The story as one page of HTML: pictures drawn with it, no network, no scripts."""

from __future__ import annotations

from collections.abc import Sequence
from html import escape
from itertools import pairwise

import numpy as np

from tsmblocks.data import Record, heading
from tsmblocks.demo import paper
from tsmblocks.demo.compensators import PERIOD, REFERENCE, Tracked
from tsmblocks.demo.mechanism import DEG, model
from tsmblocks.demo.paper import DIAGRAMS, Case
from tsmblocks.demo.story import FLOOR, IDENTIFIED, Story
from tsmblocks.diagnosis.presentation import by_excess, digits, output_traces, profile, with_interval
from tsmblocks.diagnosis.result import Diagnosis
from tsmblocks.diagnosis.text import verdict_sentence, worst_gap
from tsmblocks.draw import to_svg
from tsmblocks.files import load
from tsmblocks.html import charts, figures
from tsmblocks.html.charts import WIDTH, Frame
from tsmblocks.html.document import document, key, picture, sentence, table
from tsmblocks.html.report import WORDS

POINTS = 600
"""Of one line at most."""
LEFT, RIGHT, TOP = 46, WIDTH - 10, 22
KINDS = ("before", "between", "after")
"""Classes of lines that are compared, and so their colours; what they are compared with is ``measured``."""

Line = tuple[np.ndarray, np.ndarray, str]
"""Across, up, class."""


def page(cases: Sequence[Case], story: Story) -> str:
    """The whole page; the same numbers give the same text."""
    parts = [
        _head(story),
        *_paper(cases),
        *_measured(story),
        *_identified(story),
        *_diagnosed(story),
        *_rebuilt(story),
        *_revealed(story),
        _on(story),
    ]
    return document("tsmblocks: from measurements to the missing effect, and to better control", parts)


# ---- chapters ------------------------------------------------------------------------------------


def _head(story: Story) -> str:
    first = story.tracked[0].error.peak_to_peak
    ends = [best(story, model) for model in story.models]
    path = " → ".join(f"{digits(x)}" for x in (first, *(one.error.peak_to_peak for one in ends)))
    box = f'<p><b class="word">In one line.</b> {sentence(_found(story.diagnosis))}</p>'
    steps = "no compensation, the best on the model identified"
    steps += ", the best on the model with what was found" if len(ends) > 1 else ""
    end = f"<p>Tracking error, peak to peak: {path} deg ({steps}).</p>"
    return (
        "<h1>From measurements to the missing effect, and to better control</h1>"
        f'<div class="verdict {escape(story.diagnosis.verdict)}">{box}{end}</div>'
    )


def _found(diagnosis: Diagnosis) -> str:
    words = " and ".join(f"{e.words} on {e.wire.strip()}" for e in diagnosis.effects)
    return f"{WORDS[diagnosis.verdict]}{': ' + words if words else ''}."


def _paper(cases: Sequence[Case]) -> list[str]:
    sine = cases[0]
    names = ("l:signal", *(_hyphened(words) for words in DIAGRAMS.values()), "the paper measured")
    rows = [tuple(map(escape, row)) for row in paper.compared(cases)]
    why = paper.WHY.replace("'", "’")
    runs = list(zip(sine.runs.values(), KINDS, strict=True))
    errors = [_late(run.t, run["x_ref"] - run["x_out"], kind) for run, kind in runs]
    loops = [_loop(run["x_in"], run["x_out"], run.t, kind) for run, kind in runs]
    return [
        "<h2>1. The paper’s diagrams</h2><p>A motor turns one end of a tendon in its sheath; friction and backlash "
        "make what arrives at the tip of the endoscope lag behind. The paper tracks three signals: as it is, with a "
        "feedforward compensator, and with feedback of the tip as well. Peak-to-peak error in deg, with the paper’s "
        "numbers:</p>",
        table(names, rows),
        f'<p class="soft">{why}</p>',
        picture(to_svg(load("fig16_feedforward_feedback"))),
        key([(f"--{kind}", words) for words, kind in zip(DIAGRAMS.values(), KINDS, strict=True)]),
        _cards(
            _chart(errors, "t [s]", "x_ref - x_out [deg]", f"error for {sine.words}"),
            _chart(loops, "x_in [deg]", "x_out [deg]", f"the loop for {sine.words}"),
        ),
    ]


def _hyphened(words: str) -> str:
    """The heading of a column that is narrow on a phone: its long words may be parted."""
    return words.replace("compensation", "compen\u00adsation").replace("feedforward", "feed\u00adforward")


def _measured(story: Story) -> list[str]:
    drawn = [_recording(name, record) for name, record in story.records.items()]
    large = story.records[REFERENCE]
    loop = _loop(large["x_in"], large["x_out"], large.t, "measured thin")
    drawn.append(_chart([loop], "x_in [deg]", heading("x_out", "deg"), f"the loop of the recording {REFERENCE}"))
    return [
        "<h2>2. A mechanism is measured</h2><p>Another sheath, behind the same motor. Its encoder counts, the sensor "
        f"at the tip has noise and an interval of its own: {digits(FLOOR / DEG)} deg rms. There may be something in "
        "it that the model does not have.</p>",
        key([("--between", "x_in, motor"), ("--measured", "x_out, tip")]),
        _cards(*drawn),
    ]


def _identified(story: Story) -> list[str]:
    estimates = [
        (escape(e.name), f"{e.value:.4g}", f"{e.low:.4g} … {e.high:.4g}", escape(e.unit)) for e in story.fit.estimates
    ]
    left = story.fit.differences
    said = (
        "A better search will not help: the model has no place for it."
        if story.diagnosis.verdict != "none"
        else "No model can do better."
    )
    return [
        "<h2>3. The model is identified</h2><p>The paper’s proposed model, Eqs (8) and (9), all numbers free, to "
        "all experiments at once:</p>",
        picture(to_svg(model())),
        table(("l:parameter", "value", "95 % interval", "l:unit"), estimates),
        f"<p>What is left is {digits(left.rms / DEG)} deg rms, {left.rms / FLOOR:.1f} times the sensor’s "
        f"noise. {said}</p>",
    ]


def _diagnosed(story: Story) -> list[str]:
    found = story.diagnosis
    segment = found.worst
    gap = worst_gap(segment)
    worst = by_excess(output_traces(segment, gap.output))[0]
    along = [one for w in segment.where[:1] if (one := profile(segment, gap.output, w.coordinate, found.base))]
    shown = [
        figures.gap_bars(segment, gap),
        *(figures.along(one, explained=bool(found.effects)) for one in along),
        figures.history(worst, POINTS),
        figures.left_over(worst, gap.noise_floor, POINTS),
    ]
    after = picture(to_svg(found.augmented, highlight=[e.block for e in found.effects])) if found.effects else ""
    return [
        "<h2>4. What is missing is found</h2><p>Every effect of the catalogue is put on every wire where it can stand, "
        "fitted together with the model, and judged on stretches of time held out.</p>",
        f'<div class="verdict {escape(found.verdict)}"><p>{sentence(verdict_sentence(segment))}</p></div>',
        after,
        key(
            [
                ("--measured", "measured"),
                ("--before", "before"),
                *([("--after", "with what was found")] if found.effects else []),
                ("hollow", "hollow: fitted to these data too"),
                ("--noise", "noise, ± 2 rms"),
            ]
        ),
        _cards(*shown),
        '<p>The whole of it, with all that was tried: <a href="found/report.html">report</a>.</p>',
    ]


def _rebuilt(story: Story) -> list[str]:
    columns = story.models
    first = story.tracked[0]
    rows = [(first.words, *([_error(first)] * len(columns)))]
    rows += [(words, *(_error(story.on(c).get(words)) for c in columns)) for words in story.on(IDENTIFIED)]
    paper_s, ends = _steps(story), _ends(story)
    lines = [_late(one.run.t, one.run["x_ref"] - one.run["x_out"], kind) for one, kind in ends]
    loops = [_loop(one.run["x_ref"], one.run["x_out"], one.run.t, kind) for one, kind in paper_s]
    names = ("l:", *(f"model {name}" for name in columns))
    second = ", and on the model with what was found in place" if len(columns) > 1 else ""
    return [
        "<h2>5. The compensators are rebuilt</h2><p>The mechanism itself, motor and its 24 V included, follows the "
        f"reference of “{REFERENCE}” behind compensators built on the model as first identified{second}. "
        "Peak-to-peak error in deg, rms in brackets. The loop knows the present only; what is planned knows the whole "
        "reference, and is the best command there is for its model.</p>",
        table(names, rows),
        _cards(
            _keyed(ends, _chart(lines, "t [s]", "x_ref - x_out [deg]", "error behind the best compensators")),
            _keyed(paper_s, _chart(loops, "x_ref [deg]", "x_out [deg]", "what arrives over what is wanted")),
        ),
    ]


def _revealed(story: Story) -> list[str]:
    rows = [(escape(name), *(f"{v:.3g}" for v in values)) for name, *values in story.revealed]
    words = story.hidden.words
    sizes = "; ".join(
        f"{escape(k)} {escape(with_interval(q))}" for e in story.diagnosis.effects for k, q in e.parameters.items()
    )
    found = f" Found: {sizes}. With it in place the model’s other numbers come right too:" if sizes else ""
    return [
        f"<h2>6. What had been hidden</h2><p>{escape(words[0].upper() + words[1:])}.{found}</p>",
        table(("l:", "in truth", *story.models), rows),
        picture(to_svg(story.mechanism)),
    ]


def _on(story: Story) -> str:
    files = " ".join(f"recordings/{name}.csv" for name in story.records)
    lines = (
        f"tsmblocks diagnose model.toml --data {files} --noise-floor {FLOOR / DEG:.3f}deg",
        "tsmblocks run found/augmented.toml --data recordings/small.csv --out again.csv",
        "tsmblocks demo --hide backlash",
        "tsmblocks demo --hide none",
    )
    shown = "\n".join(escape(line) for line in lines)
    return (
        "<h2>To go on</h2><p>The recordings and the models are beside this page; with another effect hidden, or "
        f"none, the story ends otherwise:</p><pre>{shown}</pre>"
    )


# ---- what the chapters are made of ---------------------------------------------------------------


def best(story: Story, on: str) -> Tracked:
    """The compensator on a model with which least is left."""
    return min(story.on(on).values(), key=lambda one: one.error.peak_to_peak)


def _ends(story: Story) -> list[tuple[Tracked, str]]:
    """The best compensator on each model."""
    on = [best(story, model) for model in story.models]
    return list(zip(on, KINDS[::2], strict=False))


def _steps(story: Story) -> list[tuple[Tracked, str]]:
    """No compensation, the paper's, and the best there is."""
    on = [story.tracked[0], story.on(IDENTIFIED)["feedforward (11)"], best(story, story.models[-1])]
    return list(zip(on, KINDS, strict=True))


def _keyed(on: Sequence[tuple[Tracked, str]], drawn: str) -> str:
    """A chart of runs under what its colours mean."""
    return key([(f"--{kind}", ", ".join(filter(None, (one.words, one.model)))) for one, kind in on]) + drawn


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


def _recording(name: str, record: Record) -> str:
    lines = [
        (*charts.thinned(record.t, np.rad2deg(record[k]), POINTS), kind)
        for k, kind in (("x_in", "between"), ("x_out", "measured thin"))
    ]
    return _chart(lines, "t [s]", heading(name, "deg"), f"the recording {name} over time")


def _chart(lines: Sequence[Line], x_label: str, y_label: str, words: str) -> str:
    frame = Frame(LEFT, TOP, RIGHT, 170, _span(*(x for x, _, _ in lines)), charts.spread(*(y for _, y, _ in lines)))
    parts = [charts.axes(frame, x_label, y_label), *(charts.line(frame, *line) for line in lines)]
    return charts.chart(parts, 204, words)


def _span(*signals: np.ndarray) -> tuple[float, float]:
    every = np.concatenate(signals)
    rising = all(b >= a for a, b in pairwise(signals[0]))
    return (float(every.min()), float(every.max())) if rising else charts.spread(every)


def _cards(*shown: str) -> str:
    return f'<div class="cards">{"".join(f"<figure>{one}</figure>" for one in shown)}</div>'
