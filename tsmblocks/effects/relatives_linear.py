"""Relatives of linear dynamics: an oscillator whose spring has a gap."""

from __future__ import annotations

from typing import Any

from tsmblocks.blocks import Gain, Integrator, SecondOrderLag, SoftDeadZone, Sum
from tsmblocks.effects.relative import Relative
from tsmblocks.effects.sizes import Size
from tsmblocks.effects.trials import Scales, Trials
from tsmblocks.model.diagram import Diagram

GAP_SHARES = (0.003, 0.01, 0.03, 0.1)
"""Half widths of a gap with which fits start, as shares of the input's range. Chosen: a decade below a tenth of it."""
GAP_SOFTNESS = 0.05
"""Rounding of its edges at the start, as a share of the half width. Chosen: small beside the gap."""


def _with_gap(old: SecondOrderLag, scales: Scales) -> Diagram:  # noqa: ARG001 - the arguments of a relative
    """The oscillator from its parts: within the gap the spring does not pull, and the damper does."""
    return Diagram(
        title="oscillator whose spring has a gap",
        blocks={
            "scaled": Gain(gain=old.gain),
            "deflection": Sum(signs="+-"),
            "gap": SoftDeadZone(half_width=0.0),
            "spring": Gain(gain=old.omega**2),
            "net": Sum(signs="+-"),
            "rate": Integrator(integral=old.rate),
            "place": Integrator(integral=old.value),
            "damper": Gain(gain=2 * old.zeta * old.omega),
        },
        wires=[
            "scaled -> deflection.plus",
            "deflection -> gap -> spring -> net.plus",
            "net -> rate -> place -> deflection.minus",
            "rate -> damper -> net.minus",
        ],
        inputs={"u": "scaled"},
        outputs={"y": "place"},
    )


def _gap_trials(old: SecondOrderLag, scales: Scales) -> Trials:
    reach, spring, damper = scales.other.reach, old.omega**2, 2 * old.zeta * old.omega
    start = {"spring.gain": spring, "damper.gain": damper}
    shapes = tuple(
        {"gap.half_width": share * reach, "gap.softness": GAP_SOFTNESS * share * reach, **start} for share in GAP_SHARES
    )
    bounds: Any = {
        "gap.half_width": (0.0, reach),
        "gap.softness": (1e-5 * reach, 0.1 * reach),
        "spring.gain": (0.01 * spring, 100 * spring),
        "damper.gain": (0.0, None),
    }
    return Trials({}, shapes, bounds=bounds)


RELATIVES_OF_OSCILLATORS: tuple[Relative, ...] = (
    Relative(
        of=SecondOrderLag,
        name="backlash",
        family="loop",
        words="a second-order lag replaced by one with a gap in its spring",
        block=_with_gap,
        trials=_gap_trials,
        free=("gap.half_width", "gap.softness", "spring.gain", "damper.gain"),
        excites="reversals of the force that the spring transmits",
        confused=("hysteresis", "rate_dependence", "odd_nonlinearity"),
        separates="amplitudes of about the gap, at which the spring hardly pulls",
        variant="gap in its spring",
        sizes=(Size("gap width", lambda p, _: 2 * p["gap.half_width"], "{x}"),),
        states={"place.integral": "value", "rate.integral": "rate"},
    ),
)
"""Relatives of second-order lags."""
