"""End stops: a spring and a damper at one end of the motion, or at both."""

from __future__ import annotations

import math
from collections.abc import Mapping

from tsmblocks.blocks import EndStops
from tsmblocks.effects.effect import Effect
from tsmblocks.effects.loads import PULL_SHARE
from tsmblocks.effects.sizes import MILLISECONDS, Size, in_proportion
from tsmblocks.effects.trials import Scales, Trials
from tsmblocks.effects.variants import resisting

STOP_SHARES = (0.95, 0.8, 0.6, 0.35)
"""Trial distances of an end stop from the middle of the motion [half its range]. Chosen."""
BEYOND = 0.04
"""How far beyond the motion a stop is fitted at most [half its range]. Chosen."""
TRANSITION, TRANSITION_LIMITS = 0.01, (1e-4, 0.2)
"""Trial compression over which damping sets in, and its limits [half the range of the motion]. Chosen."""
ENDS = {"low": (-1.0, "lower stop"), "high": (1.0, "upper stop")}
"""Parameter of the block -> the side of the middle of the motion on which its stop is, and the stop in words."""


def _place(end: str, share: float, scales: Scales) -> float:
    """The position of a stop, so far from the middle of the motion [half its range]."""
    return scales.other.middle + ENDS[end][0] * share * scales.other.reach


def _end_stops(variant: str, words: str, *ends: str) -> Effect:
    """The effect with stops at these ends; the limit at another is infinite."""

    def trials(scales: Scales) -> Trials:
        reach = scales.other.reach
        damper = {"stop.damping": 0.0, "stop.transition": TRANSITION * reach}
        shapes = tuple(
            {**damper, **{f"stop.{end}": _place(end, share, scales) for end in ends}} for share in STOP_SHARES
        )
        bounds: dict[str, tuple[float | None, float | None]] = {
            "stop.stiffness": (0.0, None),
            "stop.transition": (TRANSITION_LIMITS[0] * reach, TRANSITION_LIMITS[1] * reach),
        }
        for end in ends:
            low, high = sorted(_place(end, share, scales) for share in (0.0, 1 + BEYOND))
            bounds[f"stop.{end}"] = low, high
        return Trials({"stop.stiffness": PULL_SHARE * scales.wire.rms / max(reach, 1e-300)}, shapes, bounds=bounds)

    none = {"low": -math.inf, "high": math.inf, **dict.fromkeys(ends, 0.0)}
    return Effect(
        "end_stop",
        "load",
        words,
        "load",
        resisting("end stops", {"stop": EndStops(stiffness=0.0, **none)}),
        {"stop.stiffness": 0.0},
        ("stop.stiffness", *(f"stop.{end}" for end in ends), "stop.damping", "stop.transition"),
        trials,
        excites="motion into the stops",
        confused=("odd_nonlinearity", "even_nonlinearity", "saturation"),
        separates="slow motion into both stops",
        variant=variant,
        rounds=("stop.transition",),
        sizes=(
            *(in_proportion(ENDS[end][1], f"stop.{end}", "{x}") for end in ends),
            in_proportion("stiffness", "stop.stiffness", "{u}/{x}"),
            Size("damping over stiffness", lambda p, _: _retardation(p), "ms"),
        ),
    )


def _retardation(p: Mapping[str, float]) -> float:
    """Damping over stiffness [ms]: the time in which a Kelvin-Voigt contact relaxes."""
    return MILLISECONDS * p["stop.damping"] / p["stop.stiffness"] if p["stop.stiffness"] else 0.0


EFFECTS = (
    _end_stops("", "end stops (a spring and a damper at each end of the motion)", "low", "high"),
    _end_stops("lower", "an end stop (a spring and a damper at the lower end of the motion)", "low"),
    _end_stops("upper", "an end stop (a spring and a damper at the upper end of the motion)", "high"),
)
