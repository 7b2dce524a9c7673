"""Effects of hysteresis: play and loops that a model lacks, or has in another shape."""

from __future__ import annotations

from tsmblocks.blocks import LoopAsymmetry, NonlocalMemory, Play, PositionDependentLoop, Stretch
from tsmblocks.effects.effect import Effect, Scales, Trials, added_change

PLAY_WIDTHS = (0.04, 0.15, 0.45)
"""Starting half widths of the plays of a nonlocal memory, as shares of half the range. Chosen: a factor of three
apart."""
_PLAYS = NonlocalMemory(weights=(0.0,) * len(PLAY_WIDTHS), radii=PLAY_WIDTHS)


def _parameter_names(name: str) -> tuple[str, ...]:
    """The parameter names of all plays."""
    return tuple(f"{name}[{k}]" for k in range(len(PLAY_WIDTHS)))


def _backlash_trials(scales: Scales) -> Trials:
    reach = scales.wire.reach
    return Trials(
        {},
        tuple({"half_width": share * reach} for share in (0.001, 0.003, 0.01, 0.03, 0.08, 0.2, 0.4)),
        bounds={"half_width": (0.0, 5 * reach)},
    )


def _hysteresis_trials(scales: Scales) -> Trials:
    reach = scales.wire.reach
    bounds = {"half_width": (0.0, reach), "distance": (3e-3 * reach, 2 * reach), "z": (-1.0, 1.0)}
    shapes = tuple({"distance": share * reach} for share in (0.03, 0.12, 0.4))
    return Trials({"half_width": 0.03 * reach}, shapes, bounds=bounds)


def _asymmetry_trials(scales: Scales) -> Trials:
    share = scales.wire.reach / max(scales.other.reach, 1e-12)
    return Trials(
        {"slope_difference": 0.03 * share, "delta": 0.05 * share},
        tuple({"theta": bends / scales.other.reach, "speed": 0.15 * scales.other.speed} for bends in (1.5, 4.0, 10.0)),
        bounds={
            "theta": (0.3 / scales.other.reach, 60 / scales.other.reach),
            "speed": (0.01 * scales.other.speed, 0.7 * scales.other.speed),
            "z": (-scales.wire.reach, scales.wire.reach),
        },
    )


def _memory_trials(scales: Scales) -> Trials:
    reach = scales.wire.reach
    wider, closer = (
        {f"radii[{k}]": factor * share * reach for k, share in enumerate(PLAY_WIDTHS)} for factor in (1.0, 0.5)
    )
    return Trials(
        {f"weights[{k}]": 0.05 for k in range(len(PLAY_WIDTHS))},
        (wider, closer),
        bounds=dict.fromkeys(wider, (0.003 * reach, 1.5 * reach)),
    )


def _position_dependence_trials(scales: Scales) -> Trials:
    share = scales.wire.reach / max(scales.other.reach, 1e-12)
    farthest = max(abs(scales.other.low), abs(scales.other.high))
    return Trials(
        {"gain": 0.03 * share},
        tuple({"distance": part * scales.other.reach} for part in (0.03, 0.12, 0.4)),
        bounds={"distance": (3e-3 * scales.other.reach, 2 * scales.other.reach), "z": (-farthest, farthest)},
    )


EFFECTS = (
    *(
        Effect(
            "backlash",
            "loop",
            words,
            place,
            Play(half_width=0.0),
            {"half_width": 0.0},
            ("half_width",),
            _backlash_trials,
            excites="reversals at two amplitudes or more",
            settled=("m",),
            confused=("nonlocal_memory", "hysteresis", "presliding_friction"),
            separates="two amplitudes, minor loops, or an odd multisine",
            variant=variant,
        )
        for place, words, variant in (
            ("output", "a backlash gap", ""),
            ("input", "a backlash gap in front of the model", "input"),
        )
    ),
    Effect(
        "hysteresis",
        "loop",
        "hysteresis",
        "output",
        Stretch(),
        {"half_width": 0.0},
        ("half_width", "distance"),
        _hysteresis_trials,
        excites="reversals",
        confused=("backlash", "nonlocal_memory"),
        separates="minor loops of several sizes: a gap has a plateau of one width, hysteresis bends",
        within=("distance",),
    ),
    Effect(
        "asymmetric_hysteresis",
        "loop",
        "hysteresis that differs between loading and unloading",
        "across",
        LoopAsymmetry(),
        {"slope_difference": 0.0, "delta": 0.0},
        ("slope_difference", "delta", "theta", "speed"),
        _asymmetry_trials,
        excites="full loops to both ends",
        confused=("even_nonlinearity", "position_dependent_friction"),
        separates="full loops to both ends and small loops at several positions",
        within=("speed",),
    ),
    *(
        Effect(
            "nonlocal_memory",
            "loop",
            "memory of earlier reversals (a loop of another shape)",
            place,
            block,
            dict.fromkeys(weights, 0.0),
            (*weights, *radii),
            trials,
            excites="small loops inside large ones",
            confused=("backlash", "creep", "asymmetric_hysteresis"),
            separates="a decaying triangle, or first-order reversal curves",
            variant=place,
            contains=("backlash",),
        )
        for place, block, weights, radii, trials in (
            ("output", _PLAYS, _parameter_names("weights"), _parameter_names("radii"), _memory_trials),
            (
                "across",
                added_change("memory", _PLAYS),
                _parameter_names("memory.weights"),
                _parameter_names("memory.radii"),
                lambda scales: _memory_trials(scales.of_other).under("memory"),
            ),
        )
    ),
    Effect(
        "position_dependent_friction",
        "loop",
        "a loop whose width grows with the position",
        "across",
        PositionDependentLoop(),
        {"gain": 0.0},
        ("gain", "distance"),
        _position_dependence_trials,
        excites="small reversals at several positions",
        confused=("asymmetric_hysteresis", "even_nonlinearity"),
        separates="a staircase with small reversals at several positions",
        within=("distance",),
    ),
)
