"""The output whose error a verdict is about, and what the effects remove of it."""

from __future__ import annotations

from tsmblocks.diagnosis.segment import Gap, Segment


def worst_gap(segment: Segment) -> Gap:
    """The errors of the output that is farthest above its noise floor."""
    return max(segment.gaps, key=lambda g: g.judged[0] / g.judged_floor if g.judged_floor > 0 else 0.0)


def most_reduced(segment: Segment) -> Gap:
    """The errors of the output whose mean square falls by most, in noise floors."""
    return max(segment.gaps, key=lambda g: (g.judged[0] ** 2 - g.judged[-1] ** 2) / max(g.judged_floor, 1e-300) ** 2)


def share_removed(gap: Gap) -> float:
    """The share of the variance of an output above its noise floor that the effects remove, on held-out data."""
    return min((gap.judged[0] ** 2 - gap.judged[-1] ** 2) / variance_above_floor(gap), 1.0)


def variance_above_floor(gap: Gap) -> float:
    """The variance of the base's error, on held-out data, above the noise floor."""
    return max(gap.judged[0] ** 2 - gap.judged_floor**2, 1e-300)
