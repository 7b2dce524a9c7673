"""Effects of delay: dead time, lag, resonance, transmission that depends on the speed."""

from __future__ import annotations

import math

import attrs

from tsmblocks.blocks import DeadTime, FirstOrderLag, Gain, Lag, ParallelResonance, RateDependence, Resonance, Sum
from tsmblocks.effects.effect import Effect
from tsmblocks.effects.sizes import MILLISECONDS, PERCENT, Size, in_proportion
from tsmblocks.effects.trials import Scales, Trials
from tsmblocks.effects.variants import across, in_front, on_loop
from tsmblocks.model.diagram import Diagram

TRIAL_TIMES = (0.002, 0.01, 0.05, 0.15)
"""Trial delays and time constants [s] for sampling steps up to ``COARSE_SAMPLING``; longer in proportion for longer
ones, and further ones up to what the recordings show. Chosen: the range of drives and sensors, a factor of three to
five apart."""
TRIAL_COEFFICIENT = 0.01
"""Trial coefficient of a term in the rate [s], less for signals that are faster. Chosen: the range of drives."""
MODE_REACH = 20.0
"""Largest initial amplitude of a mode [half the range of the input]. Chosen: one of light damping rings."""
MODE_SHARE = 0.02
"""Trial share of a mode in the output [range of the output over that of the input]. Chosen."""
MIN_SWINGS = 3.0
"""Periods of a mode in the shortest experiment, at least. Chosen: of fewer, the initial swing alone draws any slow
error."""
FASTEST_MODE = 1.2
"""Fastest trial natural frequency [rad per sampling step], and its bound 1.5 times that. Chosen: a third and more than
half of the Nyquist frequency; up to the bound RK4 at the sampling step is stable."""
FREQUENCY_RATIO = 1.4
"""Ratio of neighbouring trial natural frequencies, at most. Chosen: modes of a damping ratio of 0.3 overlap."""
NO_PEAK = 0.5**0.5
"""Damping ratio from which a mode has no peak and is no resonance. Source: |1 / (1 - r^2 + 2 i zeta r)| over r."""
LEAST_STEPS = 2.0
"""Shortest time constant of a lag in parallel [sampling steps]. Chosen: a faster one is a gain."""
TIME_RATIO = 4.0
"""Ratio of neighbouring trial time constants of it, about, and of those of any lag that are long. Chosen: fits find
their way over a factor of two."""
COARSE_SAMPLING = 0.05
"""Sampling step [s] from which the trial times grow. Chosen: a third of the longest of them."""

TWO_LAGS = Diagram(
    title="two lags",
    values={"time_constant": 0.0},
    blocks={name: Lag(time_constant="$time_constant") for name in ("first", "second")},  # type: ignore[arg-type]
    wires=["first -> second"],
    inputs={"u": "first"},
    outputs={"y": "second"},
)
"""Two equal lags: between a dead time and one lag, as higher-order lags are."""
LAG_BESIDE = Diagram(
    title="lag in parallel",
    blocks={"lag": FirstOrderLag(), "gain": Gain(gain=0.0), "both": Sum(signs="++")},
    wires=["lag -> gain -> both.plus2"],
    inputs={"u": "both.plus1", "x": "lag"},
    outputs={"y": "both"},
)
"""A lag of a second signal, added to the first; its state is in the unit of ``x``, so a gain of zero removes it."""


def _trial_times(name: str, scales: Scales, most: float) -> Trials:
    times = [time * max(1.0, scales.step / COARSE_SAMPLING) for time in TRIAL_TIMES]
    if most <= times[0]:  # a recording of some milliseconds
        times = [time * 0.5 * most / times[-1] for time in times]
    while TIME_RATIO * times[-1] < most:  # slow processes
        times.append(TIME_RATIO * times[-1])
    return Trials({}, tuple({name: time} for time in times if time < most), bounds={name: (0.0, most)})


def _frequencies(scales: Scales) -> tuple[list[float], list[float], float, float]:
    """Trial natural frequencies [rad/s]: lines of the residual, and a grid; the slowest and the fastest considered."""
    slowest, fastest = 2 * math.pi * MIN_SWINGS / scales.shortest, FASTEST_MODE / scales.step
    first = slowest * 4 / MIN_SWINGS
    count = max(1, math.ceil(abs(math.log(fastest / first)) / math.log(FREQUENCY_RATIO)))
    grid = [first * (fastest / first) ** (k / count) for k in range(count + 1)]
    lines = [2 * math.pi * f for f in scales.lines if slowest < 2 * math.pi * f < fastest]
    return lines[:4], grid, slowest, fastest


def _resonance_trials(scales: Scales) -> Trials:
    lines, grid, slowest, fastest = _frequencies(scales)
    shapes = tuple({"omega": omega, "zeta": zeta} for omega in (*lines, *grid) for zeta in (0.05, 0.3))
    # An oscillator with a large initial state and a small share would act as an independent source: it starts at the
    # signal.
    wire = scales.wire
    begins = {"swing": (wire.low - wire.reach, wire.high + wire.reach), "rate": (-wire.fastest, wire.fastest)}
    return Trials({"share": 1.0}, shapes, bounds={"omega": (slowest, 1.5 * fastest), "zeta": (0.01, NO_PEAK), **begins})


def _base_excited_trials(scales: Scales) -> Trials:
    own = _resonance_trials(scales)
    return attrs.evolve(own, shapes=tuple({**shape, "feed": 0.5} for shape in own.shapes))


def _mode_trials(scales: Scales) -> Trials:
    lines, grid, slowest, fastest = _frequencies(scales)
    light = [{"omega": omega, "zeta": zeta} for omega in lines for zeta in (0.003, 0.02)]
    wide = [{"omega": omega, "zeta": zeta} for omega in (*lines, *grid) for zeta in (0.1, 0.5)]
    most = MODE_REACH * scales.other.reach
    begins = {"swing": (-most, most), "rate": (-1.5 * fastest * most, 1.5 * fastest * most)}
    bounds = {"omega": (slowest, 1.5 * fastest), "zeta": (1e-4, 1.5), **begins}
    size = MODE_SHARE * scales.wire.reach / max(scales.other.reach, 1e-300)
    return Trials({"gain": size, "rate_gain": size}, (*light, *wide), bounds=bounds)


def _parallel_lag_trials(scales: Scales) -> Trials:
    shortest, longest = LEAST_STEPS * scales.step, scales.shortest
    count = max(1, round(math.log(longest / shortest) / math.log(TIME_RATIO)) - 1)
    ratio = (longest / shortest) ** (1 / (count + 1))
    shapes = tuple({"lag.time_constant": shortest * ratio ** (k + 0.5)} for k in range(count))
    wire, other = scales.wire, scales.other
    begins = {"lag.value": (other.low - other.reach, other.high + other.reach)}
    size = MODE_SHARE * wire.reach / max(other.reach, 1e-300)
    return Trials({"gain.gain": size}, shapes, bounds={"lag.time_constant": (shortest, longest), **begins})


def _rate_dependence_trials(scales: Scales) -> Trials | None:
    if not scales.wire.speed > 0:  # a signal at rest
        return None
    exponents, fixed = ({"exponent": 1.0}, {"exponent": 0.5}), {"smoothing": 0.02 * scales.wire.speed}
    size = min(TRIAL_COEFFICIENT, scales.wire.reach / scales.wire.speed)
    return Trials({"coefficient": size}, exponents, fixed, {"exponent": (0.25, 3.0)})


FREQUENCY = Size("natural frequency", lambda p, _: p["omega"] / (2 * math.pi), "Hz")
DAMPING = in_proportion("damping ratio", "zeta", "")
MODAL_GAIN = Size("modal gain", lambda p, _: math.hypot(p["gain"], p["rate_gain"]), "{u}/{x}")
TIME_CONSTANT = in_proportion("time constant", "time_constant", "ms", MILLISECONDS)
TIME_CONSTANT_OF_EACH = attrs.evolve(TIME_CONSTANT, name="time constant of each")
DEAD_TIME = Effect(
    "dead_time",
    "delay",
    "a dead time",
    "output",
    DeadTime(),
    {"time": 0.0},
    ("time",),
    lambda scales: _trial_times("time", scales, 0.05 * scales.shortest),
    excites="fast motion, at more than one frequency",
    confused=("first_order_lag", "resonance", "rate_dependence"),
    separates="a chirp to the highest frequency that the drive can follow",
    sizes=(in_proportion("delay", "time", "ms", MILLISECONDS),),
)
LAG = Effect(
    "first_order_lag",
    "delay",
    "a first-order lag",
    "output",
    Lag(),
    {"time_constant": 0.0},
    ("time_constant",),
    lambda scales: _trial_times("time_constant", scales, 0.1 * scales.shortest),
    excites="fast motion, at more than one frequency",
    confused=("dead_time", "resonance", "rate_dependence"),
    separates="a chirp to the highest frequency that the drive can follow",
    sizes=(TIME_CONSTANT,),
)
RESONANCE = Effect(
    "resonance",
    "delay",
    "a resonance (of an elastic part)",
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
    sizes=(FREQUENCY, DAMPING, in_proportion("share of the signal", "share", "%", PERCENT)),
)
RATE_DEPENDENCE = Effect(
    "rate_dependence",
    "delay",
    "a transmission that depends on the speed",
    "output",
    RateDependence(),
    {"coefficient": 0.0},
    ("coefficient", "exponent"),
    _rate_dependence_trials,
    excites="several speeds",
    confused=("dead_time", "first_order_lag", "creep"),
    separates="one amplitude at 0.05, 0.2, 1 and 2 Hz",
    variant="output",
    within=("exponent",),
    sizes=(
        Size("change at the rms speed", lambda p, scales: p["coefficient"] * scales.wire.speed ** p["exponent"]),
        in_proportion("exponent of the speed", "exponent", ""),
    ),
)
BASE_EXCITED = attrs.evolve(
    RESONANCE,
    words="a resonance whose damper moves with its base",
    free=("share", "omega", "zeta", "feed"),
    trials=_base_excited_trials,
    variant="base-excited",
)
FURTHER_MODE = attrs.evolve(
    RESONANCE,
    words="a further mode in parallel with the model (a linear model of higher order)",
    place="across",
    block=ParallelResonance(),
    null={"gain": 0.0, "rate_gain": 0.0},
    free=("gain", "rate_gain", "omega", "zeta"),
    trials=_mode_trials,
    settled=(),
    variant="parallel",
    sizes=(FREQUENCY, DAMPING, MODAL_GAIN),
)
EFFECTS = (
    DEAD_TIME,
    # Behind a linear model the same but for the start: there it repeats its first value, here the first command.
    in_front(DEAD_TIME, "a dead time in front of the model"),
    on_loop(DEAD_TIME),
    LAG,
    in_front(LAG, "a first-order lag in front of the model"),
    on_loop(LAG),
    attrs.evolve(
        LAG,
        words="two first-order lags in a row",
        block=TWO_LAGS,
        variant="two in a row",
        sizes=(TIME_CONSTANT_OF_EACH,),
    ),
    RESONANCE,
    BASE_EXCITED,
    in_front(BASE_EXCITED, "a resonance in front of the model"),
    FURTHER_MODE,
    attrs.evolve(FURTHER_MODE, place="mode", variant="mode"),
    attrs.evolve(
        LAG,
        words="a further first-order lag in parallel with the model",
        place="parallel",
        block=LAG_BESIDE,
        null={"gain.gain": 0.0},
        free=("gain.gain", "lag.time_constant"),
        trials=_parallel_lag_trials,
        excites="motion faster and slower than its time constant, and pauses",
        separates="steps with pauses of several time constants",
        within=("lag.time_constant",),
        variant="parallel",
        sizes=(in_proportion("gain", "gain.gain", "{u}/{x}"), in_proportion("time constant", "lag.time_constant", "s")),
    ),
    RATE_DEPENDENCE,
    across(RATE_DEPENDENCE, "rate", "by the input"),
)
