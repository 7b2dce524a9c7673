"""The demonstration on a terminal: what was found first, then how, then the source paper's experiments."""

from __future__ import annotations

import textwrap
from collections.abc import Sequence

from tsmblocks.common.tables import columns, line_width
from tsmblocks.demo import findings, paper
from tsmblocks.demo.paper import Case
from tsmblocks.demo.story import Story
from tsmblocks.diagnosis.verdict_text import verdict_sentence
from tsmblocks.fitting.text import estimate_rows

TITLES = {
    "measured": "A mechanism is measured",
    "identified": "A model of it is identified",
    "found": "The model is diagnosed",
    "revealed": "What was hidden, beside what was found",
    "tracking": "What it means for control",
    "paper": "The source paper's experiments, repeated in simulation",
}
"""Chapters in their order, on the terminal and on the page."""


def story_text(story: Story) -> str:
    """The result, and the chapters up to control."""
    hidden, found = findings.headline(story)
    chapters = (_measured(story), _identified(story), _found(story), _revealed(story), _tracking(story))
    return "\n\n".join([f"{_wrapped(hidden)}\n{_wrapped(found)}", *chapters])


def paper_text(cases: Sequence[Case]) -> str:
    """The chapter on the source paper."""
    head = ("", "uncompensated", "feedforward", "with PID", "paper")
    about = (
        "Peak-to-peak tracking error in deg, over the second half of each run: without compensation, with the "
        "feedforward of Eq. 11, and with PID feedback of the tip as well."
    )
    return _chapter("paper", _wrapped(about), columns([head, *paper.compared(cases)]), _wrapped(paper.WHY))


def _measured(story: Story) -> str:
    return _chapter("measured", _wrapped(findings.measurement(story)))


def _identified(story: Story) -> str:
    own = [e for e in story.fit if not e.is_start]
    table = columns(estimate_rows(story.fit, own), left=(0, 4, 6))
    about = "The paper's proposed model, from all experiments at once:"
    return _chapter("identified", about, table, _wrapped(findings.gap(story)))


def _found(story: Story) -> str:
    segment = story.diagnosis.worst
    verdict = _wrapped(f"{segment.verdict.upper()}. {verdict_sentence(segment)}")
    return _chapter("found", _wrapped(findings.search(story)), verdict)


def _revealed(story: Story) -> str:
    head = findings.heading(story)
    table = columns([head, *(row.cells[: len(head)] for row in findings.revealed(story))])
    return _chapter("revealed", table, _wrapped(findings.intervals(story)))


def _tracking(story: Story) -> str:
    about = (
        f"The mechanism tracks 55 deg at 0.2 Hz behind compensators built on {findings.which(story)}: "
        "peak-to-peak error in deg, rms in brackets. The loop around the model is a fast feedback loop that inverts "
        "it, and the planned command its optimum, for which the reference is known in advance."
    )
    reasons = [_wrapped(words) for words in findings.worse(story)]
    return _chapter("tracking", _wrapped(about), columns(findings.tracking(story)), *reasons)


def _chapter(name: str, *parts: str) -> str:
    number = list(TITLES).index(name) + 1
    return "\n\n".join([f"{number}. {TITLES[name]}", *parts])


def _wrapped(text: str) -> str:
    return textwrap.fill(text, line_width(), break_on_hyphens=False)
