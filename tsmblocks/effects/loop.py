"""Effects of loops: play and hysteresis that a model lacks, or has in another shape."""

from __future__ import annotations

from tsmblocks.blocks import DahlHysteresis, LoopAsymmetry, NonlocalMemory, Play, PositionDependentLoop
from tsmblocks.diagram import Diagram
from tsmblocks.effects.effect import Effect, Scales, Trials, beside

SHARES = (0.03, 0.1, 0.25, 0.55)
"""Half widths of the plays that make up a memory, as shares of half the range."""
_PLAYS = NonlocalMemory(weights=(0.0,) * len(SHARES), radii=SHARES)


def _gap(scales: Scales) -> Trials:
    reach = scales.wire.reach
    return Trials({}, tuple({"half_width": share * reach} for share in (0.01, 0.03, 0.08, 0.2, 0.4)),
                  bounds={"half_width": (0.0, 5 * reach)})  # fmt: skip


def _loop(scales: Scales) -> Trials:
    reach = scales.wire.reach
    return Trials({"loop.rho": 0.3}, tuple({"loop.half_width": share * reach} for share in (0.03, 0.1, 0.3)),
                  bounds={"loop.half_width": (1e-3 * reach, reach), "loop.rho": (0.0, 3.0),
                          "loop.zeta": (-reach, reach)})  # fmt: skip


def _asymmetry(scales: Scales) -> Trials:
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


def _memory(scales: Scales) -> Trials:
    return Trials({f"weights[{k}]": 0.05 for k in range(len(SHARES))},
                  fixed={f"radii[{k}]": share * scales.wire.reach for k, share in enumerate(SHARES)})  # fmt: skip


def _curvature(scales: Scales) -> Trials:
    share = scales.wire.reach / max(scales.other.reach, 1e-12)
    return Trials(
        {"gain": 0.03 * share}, tuple({"distance": part * scales.other.reach} for part in (0.03, 0.12, 0.4)),
        bounds={"distance": (3e-3 * scales.other.reach, 2 * scales.other.reach), "z": (-1.0, 1.0)},
    )  # fmt: skip


EFFECTS = (
    Effect(
        "backlash", "loop", "a backlash gap", "output", Play(half_width=0.0), {"half_width": 0.0}, ("half_width",),
        _gap, excites="reversals at two amplitudes or more", settled=("m",),
        confused=("nonlocal_memory", "hysteresis", "presliding_friction"),
        separates="two amplitudes, minor loops, or an odd multisine",
    ),
    Effect(
        "hysteresis", "loop", "hysteresis", "output",
        Diagram(title="hysteresis", blocks={"loop": DahlHysteresis(alpha_x=1.0, rho=0.0)}, inputs={"u": "loop.x"},
                outputs={"y": "loop"}),
        {"loop.rho": 0.0}, ("loop.rho", "loop.half_width"), _loop,
        excites="reversals", confused=("backlash", "nonlocal_memory"),
        separates="minor loops of several sizes: a gap has a plateau of one width, hysteresis bends",
        within=("loop.half_width",),
    ),
    Effect(
        "asymmetric_hysteresis", "loop", "hysteresis that differs between loading and unloading", "across",
        LoopAsymmetry(), {"slope_difference": 0.0, "delta": 0.0}, ("slope_difference", "delta", "theta", "speed"),
        _asymmetry,
        excites="full loops to both ends", confused=("even_nonlinearity", "position_dependent_friction"),
        separates="full loops to both ends and small loops at several positions", within=("speed",),
    ),
    *(
        Effect(
            "nonlocal_memory", "loop", "memory of earlier reversals (a loop of another shape)", place, block,
            dict.fromkeys(weights, 0.0), weights, trials, excites="small loops inside large ones",
            confused=("backlash", "creep", "asymmetric_hysteresis"),
            separates="a decaying triangle, or first-order reversal curves", variant=place,
        )
        for place, block, weights, trials in (
            ("output", _PLAYS, tuple(f"weights[{k}]" for k in range(len(SHARES))), _memory),
            ("across", beside("memory", _PLAYS), tuple(f"memory.weights[{k}]" for k in range(len(SHARES))),
             lambda scales: _memory(scales.of_other).under("memory")),
        )
    ),
    Effect(
        "position_dependent_friction", "loop", "a loop whose width grows with the position", "across",
        PositionDependentLoop(), {"gain": 0.0}, ("gain", "distance"), _curvature,
        excites="small reversals at several positions", confused=("asymmetric_hysteresis", "even_nonlinearity"),
        separates="a staircase with small reversals at several positions", within=("distance",),
    ),
)  # fmt: skip
