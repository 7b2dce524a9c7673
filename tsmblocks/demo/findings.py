"""What a story found, in words and numbers: the same on the terminal, on the page and in the README."""

from __future__ import annotations

from collections.abc import Iterator

import attrs
import numpy as np

from tsmblocks.common.displayed_units import display_unit
from tsmblocks.common.rounding import significant
from tsmblocks.common.tables import listed
from tsmblocks.demo.compensators import FEEDFORWARD, LOOP, Tracked
from tsmblocks.demo.mechanism import DEG, NUMBERS, SAMPLE, STOP
from tsmblocks.demo.story import FLOOR, IDENTIFIED, Story
from tsmblocks.diagnosis.presentation import MAX_SIZES, with_interval
from tsmblocks.diagnosis.segment import Quantity
from tsmblocks.effects import Scales, Span, catalogue
from tsmblocks.effects.effect import parameters_of, sizes_of

WORSE = 1.03
"""Ratio of two tracking errors from which one is worse. Chosen: what hunts does not repeat better."""
FOUND_NONE = "Found: no unmodelled effect is detectable with these data."
"""The headline where no effect is found."""


@attrs.frozen
class Revealed:
    """A quantity of the true mechanism: its true value, what was found, and the value without the effects found."""

    name: str
    true: str
    found: str
    without: str
    inside: bool
    off: float

    @property
    def cells(self) -> tuple[str, str, str, str]:
        """The row of a table."""
        return self.name, self.true, self.found, self.without


def revealed(story: Story) -> list[Revealed]:
    """The sizes of the hidden effect, then the parameters of the sheath; the first row is the main size."""
    rows = [_row(name, value, found, "-") for name, value, found in _sizes(story)]
    fit = story.diagnosis.worst.fit
    found = {} if fit is None else {e.name: Quantity(e.value, e.low, e.high, e.unit) for e in fit}
    before = story.fit.diagram.parameters if story.diagnosis.effects else {}
    for name, true in NUMBERS.items():
        own = f"tsm.{name}"
        rows.append(_row(name, true, found[own], f"{before[own]:.4g}" if before else ""))
    return rows


def heading(story: Story) -> tuple[str, ...]:
    """The heading of the rows of ``revealed``."""
    return ("", "true", "found (95 % interval)", "without it")[: 4 if story.diagnosis.effects else 3]


def _row(name: str, true: float, found: Quantity, without: str) -> Revealed:
    k, unit = display_unit(found.unit)
    inside, off = found.low <= true <= found.high, found.value / true - 1 if true else 0.0
    return Revealed(name, f"{k * true:.4g} {unit}".rstrip(), with_interval(found), without, inside, off)


def _sizes(story: Story) -> Iterator[tuple[str, float, Quantity]]:
    """Sizes of the hidden effect that the diagnosis reports too: name, true value, and what was found."""
    block = story.hidden.block
    for effect in story.diagnosis.effects:
        if block is None:
            return
        of = next((e for e in catalogue() if e.name == effect.name and type(e.block) is type(block)), None)
        if of is None or effect.name != story.name:
            continue
        true = sizes_of(of, parameters_of(block), _scales(story), ("rad", "rad"))
        yield from ((name, true[name][0], found) for name, found in effect.sizes.items() if name in true)


def _scales(story: Story) -> Scales:
    """Range and rate of the tip in the recordings."""
    x = [record["x_out"] for record in story.records.values()]
    every, rate = np.concatenate(x), np.concatenate([np.gradient(one, SAMPLE) for one in x])
    rms, speed = (float(np.sqrt(np.mean(one**2))) for one in (every, rate))
    span = Span(float(every.min()), float(every.max()), rms, speed, float(np.abs(rate).max()))
    return Scales(span, span, 0.0, STOP, SAMPLE, STOP)


# ---- sentences -----------------------------------------------------------------------------------


def headline(story: Story) -> tuple[str, str]:
    """What was hidden, and what was found: with the true value beside each size."""
    hidden = f"Hidden: {story.hidden.words}."
    if not story.diagnosis.effects:
        return hidden, FOUND_NONE if story.diagnosis.verdict == "none" else "Found: an error that no effect explains."
    sizes = [f"{name} {with_interval(found)}" for name, _, found in _sizes(story)]
    true = [row.true for row in revealed(story)]
    words = [f"{size} (true: {value})" for size, value in zip(sizes, true, strict=False)][:MAX_SIZES]
    return hidden, f"Found: {', '.join([listed([e.words for e in story.diagnosis.effects], 9), *words])}."


def measurement(story: Story) -> str:
    """What was measured."""
    return (
        f"A tendon sheath behind a motor, in {len(story.records)} experiments ({', '.join(story.records)}), with an "
        f"encoder at the motor and a sensor of {FLOOR / DEG:.3f} deg rms at the tip. It may have an effect that its "
        "model lacks."
    )


def gap(story: Story) -> str:
    """The residual of the model as identified, beside the noise."""
    residual = story.fit.differences.rms
    end = (
        "nothing is left to explain"
        if story.diagnosis.verdict == "none"
        else "an error of the model's structure, which more fitting cannot remove"
    )
    return (
        f"On the data it was fitted to, the residual is {residual / DEG:.3f} deg rms, {residual / FLOOR:.1f} times the "
        f"sensor's noise: {end}."
    )


def search(story: Story) -> str:
    """How it was searched for, with the number of effects tried."""
    segment = story.diagnosis.worst
    effects, fits = len(segment.effects_tried), sum(r.fitted for r in segment.ranking)
    if not effects:
        return "The residual is not above the sensor's noise: no effect had to be tried."
    return (
        f"{effects} effects of the catalogue were tried at every admissible signal; {fits} candidates were fitted "
        "together with the model, and judged on held-out data: blocks of time held out of the fit."
    )


def intervals(story: Story) -> str:
    """Which true values lie outside their intervals, and why; empty where none does."""
    outside = [f"{row.name} (off by {abs(100 * row.off):.2g} %)" for row in revealed(story) if not row.inside]
    if not outside:
        return "Every true value lies within its interval."
    return (
        f"Outside the interval: {listed(outside, 9)}. One in twenty is so by chance, and intervals cover the noise of "
        "the sensor, not the error of simulating in steps between its samples."
    )


# ---- tracking ------------------------------------------------------------------------------------


def tracking(story: Story) -> list[tuple[str, ...]]:
    """Rows of tracking errors: peak to peak, rms in brackets [deg], for each model; the heading first."""
    models, first = story.models, story.tracked[0]
    rows: list[tuple[str, ...]] = [
        ("compensator on the model", *models),
        (first.words, *([_error(first)] * len(models))),
    ]
    return rows + [(name, *(_error(story.on(m).get(name)) for m in models)) for name in story.on(IDENTIFIED)]


def _error(one: Tracked | None) -> str:
    return "-" if one is None else f"{rounded(one.error.peak_to_peak)} ({rounded(one.error.rms)})"


def rounded(error: float) -> str:
    """A tracking error in two digits: a third would differ where a loop hunts."""
    return significant(error, 2)


def which(story: Story) -> str:
    """The models that compensators are built on, in words."""
    return "both models" if len(story.models) > 1 else "the model"


def worse(story: Story) -> list[str]:
    """Why a compensator gets worse with the better model, a sentence for each that does."""
    last = story.on(story.models[-1])
    pairs = [(name, one, last[name]) for name, one in story.on(IDENTIFIED).items() if name in last]
    return [
        _why(story, name, before, after)
        for name, before, after in pairs
        if max(after.error.peak_to_peak / before.error.peak_to_peak, after.error.rms / before.error.rms) > WORSE
    ]


def _why(story: Story, name: str, before: Tracked, after: Tracked) -> str:
    peaks = f"from {rounded(before.error.peak_to_peak)} to {rounded(after.error.peak_to_peak)} deg peak to peak"
    rms = f"from {rounded(before.error.rms)} to {rounded(after.error.rms)} deg"
    if name == FEEDFORWARD:
        value = story.fit.diagram.parameters["tsm.alpha1"]
        return (
            f"The {name}, gets worse with the better model, {peaks}: it takes the parameters of the Bouc-Wen block "
            "only, and those identified had absorbed part of what was hidden "
            f"(alpha1 {value:#.3g}, true {NUMBERS['alpha1']})."
        )
    if name == LOOP and after.error.rms < before.error.rms:
        return (
            f"The {name} gets worse {peaks}, though its rms falls {rms}: it hunts about the upper reversal with either "
            "model, and peak to peak is the largest swing of that limit cycle."
        )
    return f"The compensator '{name}' gets worse, {peaks}: the best for a model need not be the best for the mechanism."
