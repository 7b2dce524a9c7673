"""Effects inside a transmission: between two of its parts, or in the deflection of an elastic part."""

from __future__ import annotations

import functools
from collections.abc import Mapping

import attrs

from tsmblocks.effects.effect import Effect
from tsmblocks.effects.limits import SOFT_DEAD_ZONE
from tsmblocks.effects.loop import BACKLASH, HYSTERESIS
from tsmblocks.effects.maps import ODD
from tsmblocks.effects.sizes import PERCENT, Size, in_proportion
from tsmblocks.effects.trials import Scales, Trials


def _unloaded(scales: Scales) -> tuple[float, ...]:
    """Where an elastic part may carry nothing: at a deflection of zero, or in the middle of it behind a preload."""
    wire = scales.wire
    return (0.0, wire.middle) if wire.low < 0 < wire.high else (wire.middle,)


def _gap_trials(scales: Scales) -> Trials:
    """A gap takes up deflection that the force would make: the model without it deflects less."""
    reach, middle = scales.wire.reach, scales.wire.middle
    shapes = tuple(
        {"half_width": share * reach, "centre": centre, "softness": 0.05 * share * reach}
        for centre in _unloaded(scales)
        for share in (0.03, 0.1, 0.3, 1.0, 3.0)
    )
    around, softness = (middle - 10 * reach, middle + 10 * reach), (1e-4 * reach, 3 * reach)
    return Trials({}, shapes, bounds={"half_width": (0.0, 30 * reach), "centre": around, "softness": softness})


def _stiffening_trials(scales: Scales) -> Trials:
    """A spring that stiffens, by little or by many times over the range that the model without it deflects."""
    reach, middle = scales.wire.reach, scales.wire.middle
    shapes = tuple(
        {"cubic": share / reach**2, "quintic": 0.0, "centre": centre}
        for centre in _unloaded(scales)
        for share in (-0.1, 0.1, 1.0, 10.0)
    )
    return Trials({}, shapes, bounds={"centre": (middle - 10 * reach, middle + 10 * reach)})


def _stiffness_added(end: float, p: Mapping[str, float], scales: Scales) -> float:
    """By how much a spring is stiffer at an end of its deflection than where it is not deflected [%]."""
    away = scales.wire.middle + end * scales.wire.reach - p["centre"]
    return PERCENT * (3 * p["cubic"] * away**2 + 5 * p["quintic"] * away**4)


STIFFENING = attrs.evolve(
    ODD,
    trials=_stiffening_trials,
    sizes=tuple(
        Size(f"stiffness added at the {name} end", functools.partial(_stiffness_added, end), "%")
        for name, end in (("upper", 1.0), ("lower", -1.0))
    ),
)


def _inside(effect: Effect, words: str) -> Effect:
    """The variant of an effect that acts between two parts of the transmission."""
    return attrs.evolve(effect, words=words, place="transmission", variant="inside", other_words={})


def _of_deflection(effect: Effect, words: str) -> Effect:
    """The variant of an effect that acts on the deflection of an elastic part."""
    return attrs.evolve(effect, words=words, place="deflection", variant="deflection", other_words={})


GAP = attrs.evolve(
    SOFT_DEAD_ZONE,
    name=BACKLASH.name,
    family=BACKLASH.family,
    trials=_gap_trials,
    excites="reversals of the force that the elastic part transmits",
    confused=("hysteresis", "odd_nonlinearity"),
    separates="both of its ends measured: within the gap one moves and the other does not",
    sizes=(in_proportion("gap width", "half_width", factor=2.0),),
)
EFFECTS = (
    _inside(BACKLASH, "a backlash gap inside the transmission"),
    _inside(HYSTERESIS, "hysteresis inside the transmission"),
    _of_deflection(GAP, "a backlash gap in the elastic transmission"),
    _of_deflection(STIFFENING, "a stiffness that changes with the deflection"),
    _of_deflection(HYSTERESIS, "hysteresis of the elastic transmission"),
)
