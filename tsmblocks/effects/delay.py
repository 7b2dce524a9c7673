"""Effects of delay: dead time, lag, resonance, transmission that depends on the speed."""

from __future__ import annotations

import math

from tsmblocks.blocks import DeadTime, Lag, RateDependence, Resonance
from tsmblocks.effects.effect import Effect, Scales, Trials, added_change
from tsmblocks.model.diagram import Diagram

TRIAL_TIMES = (0.002, 0.01, 0.05, 0.15)
"""Trial delays and time constants [s] for sampling steps up to ``COARSE_SAMPLING``; longer in proportion for longer
ones. Chosen: the range of drives and sensors, a factor of three to five apart."""
COARSE_SAMPLING = 0.05
"""Sampling step [s] from which the trial times grow. Chosen: a third of the longest one."""

TWO_LAGS = Diagram(
    title="two lags",
    values={"time_constant": 0.0},
    blocks={name: Lag(time_constant="$time_constant") for name in ("first", "second")},  # type: ignore[arg-type]
    wires=["first -> second"],
    inputs={"u": "first"},
    outputs={"y": "second"},
)
"""Two equal lags: between a dead time and one lag, as higher-order lags are."""


def _trial_times(name: str, scales: Scales, most: float) -> Trials:
    times = [time * max(1.0, scales.step / COARSE_SAMPLING) for time in TRIAL_TIMES]
    return Trials({}, tuple({name: time} for time in times if time < most), bounds={name: (0.0, most)})


def _dead_time_trials(scales: Scales) -> Trials:
    return _trial_times("time", scales, 0.05 * scales.shortest)


def _lag_trials(scales: Scales) -> Trials:
    return _trial_times("time_constant", scales, 0.1 * scales.shortest)


def _resonance_trials(scales: Scales) -> Trials:
    slowest, fastest = 2 * math.pi / scales.shortest, 0.35 / scales.step
    count = 9
    grid = [slowest * 4 * (fastest / (4 * slowest)) ** (k / (count - 1)) for k in range(count)]
    lines = [2 * math.pi * f for f in scales.lines if slowest < 2 * math.pi * f < fastest]
    shapes = tuple({"omega": omega, "zeta": zeta} for omega in (*lines[:4], *grid) for zeta in (0.05, 0.3))
    # An oscillator with a large initial state and a small share would be a source of its own: it starts at the signal.
    wire = scales.wire
    begins = {"swing": (wire.low - wire.reach, wire.high + wire.reach), "rate": (-wire.fastest, wire.fastest)}
    return Trials({"share": 1.0}, shapes, bounds={"omega": (slowest, 1.5 * fastest), "zeta": (0.01, 1.5), **begins})


def _rate_dependence_trials(scales: Scales) -> Trials | None:
    speed = scales.wire.speed
    if not speed > 0:  # a signal at rest
        return None
    return Trials(
        {"coefficient": 0.01},
        tuple({"exponent": n} for n in (1.0, 0.5)),
        {"smoothing": 0.02 * speed},
        {"exponent": (0.25, 3.0)},
    )


def _rate_dependence_trials_of_other(scales: Scales) -> Trials | None:
    trials = _rate_dependence_trials(scales.of_other)
    return None if trials is None else trials.under("rate")


EFFECTS = (
    Effect(
        "dead_time",
        "delay",
        "a dead time",
        "output",
        DeadTime(),
        {"time": 0.0},
        ("time",),
        _dead_time_trials,
        excites="fast motion, at more than one frequency",
        confused=("first_order_lag", "resonance", "rate_dependence"),
        separates="a chirp to the highest frequency the drive can follow",
    ),
    *(
        Effect(
            "first_order_lag",
            "delay",
            words,
            "output",
            block,
            {"time_constant": 0.0},
            ("time_constant",),
            _lag_trials,
            excites="fast motion, at more than one frequency",
            confused=("dead_time", "resonance", "rate_dependence"),
            separates="a chirp to the highest frequency the drive can follow",
            variant=variant,
        )
        for words, block, variant in (
            ("a first-order lag", Lag(), ""),
            ("two first-order lags in a row", TWO_LAGS, "twice"),
        )
    ),
    Effect(
        "resonance",
        "delay",
        "a resonance (elasticity behind the sensor)",
        "output",
        Resonance(),
        {"share": 0.0},
        ("share", "omega", "zeta"),
        _resonance_trials,
        excites="motion near its frequency, or steps",
        confused=("dead_time", "first_order_lag"),
        separates="a chirp through its frequency, or steps",
        settled=("swing",),
        within=("omega", "zeta"),
    ),
    *(
        Effect(
            "rate_dependence",
            "delay",
            "a transmission that depends on the speed",
            place,
            block,
            {f"{prefix}coefficient": 0.0},
            (f"{prefix}coefficient", f"{prefix}exponent"),
            trials,
            excites="several speeds",
            confused=("dead_time", "first_order_lag", "creep"),
            separates="one amplitude at 0.05, 0.2, 1 and 2 Hz",
            variant=place,
            within=(f"{prefix}exponent",),
        )
        for place, block, prefix, trials in (
            ("output", RateDependence(), "", _rate_dependence_trials),
            ("across", added_change("rate", RateDependence()), "rate.", _rate_dependence_trials_of_other),
        )
    ),
)
