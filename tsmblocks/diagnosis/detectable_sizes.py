"""The smallest detectable sizes of effects, as text."""

from __future__ import annotations

from tsmblocks.common.tables import columns, listed
from tsmblocks.diagnosis.fitted_candidate import MAX_FINITE_NULL
from tsmblocks.diagnosis.limits import CAUSES
from tsmblocks.diagnosis.lines import bullets, filled, of_segment
from tsmblocks.diagnosis.plain_values import limit_quantity
from tsmblocks.diagnosis.presentation import in_display_units
from tsmblocks.diagnosis.quantities import acceleration_note
from tsmblocks.diagnosis.segment import DetectionLimit, Segment
from tsmblocks.effects import catalogue


def limit_text(one: DetectionLimit) -> str:
    """The smallest detectable size, with its name, or why there is none."""
    if one.value is None:
        by = absorbed_text(one)
        return f"absorbed by {by}" if by else CAUSES.get(one.cause, "")
    name, size, unit = limit_quantity(one)
    return f"{name} {_side(one)}{in_display_units(size, unit)}"


def _side(one: DetectionLimit) -> str:
    """On which side of its limit a size is detectable, where it is endless without the effect, as that of a rate is."""
    parameter = one.parameter.rpartition(".")[2]
    null = next((e.null[parameter] for e in catalogue() if e.name == one.name and parameter in e.null), 0.0)
    return "" if abs(null) < MAX_FINITE_NULL else "below " if null > 0 else "above "


def absorbed_text(one: DetectionLimit) -> str:
    """The parameters that absorb an effect, and by how much: ``preload.value, 40 N per mm``; empty without any."""
    return listed([f"{k}, {rate}" if rate else k for k, rate in one.absorbed_by.items()]) if one.absorbed_by else ""


def limits_texts(segment: Segment, several: bool) -> list[str]:
    """The smallest sizes that these experiments could show, and the effects that they could not; empty without any."""
    detectable = [m for m in segment.limits if m.value is not None]
    named = {one.name for one in segment.effects}
    undetectable = [m for m in segment.limits if m.value is None and m.name not in named]
    where = of_segment(segment, several)
    parts = list[str]()
    if detectable:
        rows = [[m.name, limit_text(m)] for m in detectable]
        beside = " of further effects" if named else ""
        parts.append(f"detection limits{beside}{where}:\n{columns(rows, '  ', left=(0, 1))}")
        parts += filter(None, [filled(acceleration_note(detectable))])
    if undetectable:
        own = {cause: [m for m in undetectable if m.cause == cause] for cause in CAUSES}
        lines = [f"{CAUSES[cause]}: {', '.join(map(_without_limit, some))}" for cause, some in own.items() if some]
        parts += bullets(f"not testable with these data{where}", lines)
    return parts


def _without_limit(one: DetectionLimit) -> str:
    by = absorbed_text(one)
    return f"{one.name} (acts as {by})" if by else one.name
