"""Variants of effects in words, for those whose names do not say enough."""

from __future__ import annotations

from collections.abc import Iterable

from tsmblocks.diagnosis.segment import RankedCandidate

VARIANT_WORDS = {
    "separate sizes": "one size for each recording",
    "separate sizes and times": "one size, at one instant, for each recording",
    "input": "in front of the model",
    "branch": "in one of the branches that an input drives, or behind a sensor",
    "mode": "driven as the model is, and added to its output",
    "element": "of a gain or a viscous friction inside the model",
    "loop": "inside the control loop",
    "output": "at the output of the model",
    "by the input": "on the output, driven by the input",
    "drive": "on the signal that drives the plant",
    "speed": "where the measured motion is a speed",
    "force": "of the force, as the cogging of a motor",
    "spring": "as a spring that acts on the load",
    "inside": "inside the model, between two parts of the transmission",
    "deflection": "in the deflection of an elastic part",
    "transmission": "between input and output, as hysteresis whose width depends on the speed",
    "hysteresis": "of gain and loop width, which may be zero before",
    "gain": "of the gain, at one instant",
    "drift": "of the gain, at a constant rate",
    "steady": "at a constant rate",
    "heated": "by self-heating, with the square of its signal",
    "settling": "building up and settling, as of something that warms up",
    "temporary": "from one instant to another",
    "balance": "on the wire that fills or heats what is measured",
    "low end": "at the low end of the range only",
    "high end": "at the high end of the range only",
    "upper end": "at the upper end of the range only",
    "lower end": "at the lower end of the range only",
    "two in a row": "one behind the other",
    "middle and ends": "the slope differs between the middle of the range and its ends",
    "soft": "with a gradual transition",
    "soft drive": "with a gradual transition, on the signal that drives the plant",
    "free centre": "about a centre that is fitted; it may be outside of the range",
    "two levels": "a level for each direction",
    "two harmonics": "with a part of twice the frequency",
    "parallel": "driven by the input and added to the output of the model",
    "base-excited": "the damper moves with the base, so that fast motion passes",
    "broad": "over decades of time, by several time constants",
    "Dahl": "Dahl's law: friction is elastic before it slides",
    "LuGre": "the LuGre law: friction is elastic before it slides, and larger at low speed",
    "plays": "contacts that yield one after another (Prandtl-Ishlinskii)",
    "Stribeck": "friction is larger at low speed",
}
"""Part of the name of a variant -> words; variants of a user's own effects are explained by the words of the effect."""


def parts_of(variant: str) -> list[str]:
    """The parts of the name of a variant: ``hysteresis, separate sizes`` has two."""
    return [part for part in variant.split(", ") if part]


def explained(rows: Iterable[RankedCandidate], known: set[str]) -> str:
    """The variants of some candidates in words, without those in ``known``, to which they are added."""
    said = []
    for row in rows:
        for part in parts_of(row.variant):
            if part in known or (part not in VARIANT_WORDS and part in row.words):
                continue
            known.add(part)
            said.append(f"{part}: {VARIANT_WORDS.get(part, row.words)}")
    return f"Variants: {'; '.join(said)}." if said else ""
