"""References of the experiments, as functions of time within the record."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass

import numpy as np

Signal = Callable[[np.ndarray], np.ndarray]
TURN = 2.0 * np.pi


@dataclass(frozen=True)
class Experiment:
    """One record: its name, how long it is [s], and its reference."""

    name: str
    stop: float
    signal: Signal


def sines(amplitudes, frequencies, phases=(0.0, 0.0)) -> Signal:
    """Sum of sines."""

    def signal(t):
        return sum(a * np.sin(TURN * f * t + p) for a, f, p in zip(amplitudes, frequencies, phases, strict=False))

    return signal


def multisine(rng, base, lines, peak, *, offset=0.0, power=1.0) -> Signal:
    """Random-phase multisine with amplitudes falling as 1/line**power, scaled to a peak."""
    lines = np.asarray(lines)
    phases = rng.uniform(0.0, TURN, len(lines))
    weights = lines ** (-float(power))
    fine = np.arange(4096) / 4096 / base
    whole = np.cos(TURN * base * np.outer(fine, lines) + phases) @ weights
    weights = weights * peak / np.abs(whole).max()

    def signal(t):
        y = np.full(np.shape(t), float(offset))
        for k, a, p in zip(lines, weights, phases, strict=True):
            y += a * np.cos(TURN * base * k * t + p)
        return y

    return signal


def chirp(amplitude, low, high, stop, offset=0.0) -> Signal:
    """Sine whose frequency grows by the same factor in equal times."""
    rate = np.log(high / low) / stop

    def signal(t):
        return offset + amplitude * np.sin(TURN * low / rate * np.expm1(rate * t))

    return signal


def through(points, speed, hold, round_off=0.0) -> Signal:
    """From level to level at one speed, with a rest at each; corners on whole hundredths of a second.

    With `round_off`, in whole hundredths too, the corners are spread over that time [s], so that an encoder that is
    read a hundred times a second sees the turning points.
    """
    times, levels = [0.0], [0.0]
    for level in points:
        travel = max(np.round(abs(level - levels[-1]) / speed, 2), 0.05)
        times += [times[-1] + travel, times[-1] + travel + hold]
        levels += [level, level]
    times, levels = np.array(times), np.array(levels)
    late = np.arange(round(round_off / 0.01) + 1) * 0.01

    def signal(t):
        return sum(np.interp(t - s, times, levels) for s in late) / len(late)

    return signal


def staircase_and_triangle(rng, scale=1.0) -> Signal:
    """A staircase up and down with small steps back, then a triangle that decays."""
    up, back = 17.0 * rng.uniform(0.9, 1.1), 6.0 * rng.uniform(0.8, 1.2)
    stairs, level = [], -40.0
    for sign in (1.0, -1.0):
        for _ in range(5):
            stairs += [level, level - sign * back]
            level += sign * up
        stairs.append(level)
    stairs.append(0.0)
    first = through(scale * np.array(stairs), 75.0 * scale, 0.15, 0.1)
    second = through(scale * np.array([52, -44, 37, -31, 26, -21, 17, -13, 10, -7, 4, 0.0]), 75.0 * scale, 0.0, 0.1)
    turn = 18.0

    def signal(t):
        return np.where(t < turn, first(np.minimum(t, turn)), first(turn) + second(np.maximum(t - turn, 0.0)))

    return signal


def rich(rng, scale=1.0) -> list[Experiment]:
    """Eight experiments of about 26 s; the eighth repeats the first."""
    one = sines([55.0 * scale], [0.2])
    two = sines([28.0 * scale, 28.0 * scale], [0.2, 0.5])
    odd = sines([28.0 * scale, 28.0 * scale], [0.25, 0.25 * np.sqrt(3.0)])
    shift = scale * rng.choice([-1.0, 1.0]) * rng.uniform(14.0, 20.0)
    return [
        Experiment("sine", 25.0, one),
        Experiment("two_sines", 26.0, two),
        Experiment("two_sines_apart", 26.0, odd),
        Experiment("odd_multisine", 26.0, multisine(rng, 0.1, np.arange(1, 21, 2), 45.0 * scale)),
        Experiment("chirp", 26.0, chirp(6.0 * scale, 0.1, 6.0, 26.0)),
        Experiment("staircase", 26.0, staircase_and_triangle(rng, scale)),
        Experiment("offset_multisine", 26.0, multisine(rng, 1 / 13, np.arange(1, 21), 24.0 * scale, offset=shift)),
        Experiment("sine_again", 25.0, one),
    ]


def experiments(protocol: str, rng) -> list[Experiment]:
    """The records of a protocol, in the order of the session."""
    if protocol == "rich":
        return rich(rng)
    if protocol == "small":
        return rich(rng, 0.06)
    if protocol == "paper":
        return rich(rng)[:3]
    if protocol == "sine":
        return [Experiment("sine", 24.0, sines([55.0], [0.2]))]
    raise ValueError(f"protocol {protocol!r}: expected one of rich, paper, sine, small")


# ---- motor


def square(level, period, ramp) -> Signal:
    """Up and down with steep ramps, on whole hundredths of a second."""

    def signal(t):
        s = np.mod(t / period, 1.0)
        r = ramp / period
        knots = [0.0, r, 0.5 - r, 0.5 + r, 1.0 - r, 1.0]
        return level * np.interp(s, knots, [0.0, 1.0, 1.0, -1.0, -1.0, 0.0])

    return signal


def motor_open(protocol: str, rng) -> list[Experiment]:
    """Voltages [V], eight records of 5.2 s; the eighth repeats the first."""
    stop = 5.2
    one = sines([1.5], [0.4])
    side = rng.choice([-1.0, 1.0])
    listed = [
        ("sine", one),
        ("odd_multisine", multisine(rng, 0.4, np.arange(1, 14, 2), 3.0, power=0.5)),
        ("chirp", chirp(2.5, 0.5, 8.0, stop)),
        ("ramps", sines([1.2, 0.4], [0.25, 0.75], [np.pi / 2, np.pi / 2])),
        ("square", square(5.0, 0.8, 0.02)),
        ("small_multisine", multisine(rng, 0.4, np.arange(1, 12), 0.5, power=0.0)),
        ("offset_multisine", multisine(rng, 0.2, np.arange(2, 24), 3.0, offset=0.25 * side, power=0.5)),
        ("sine_again", one),
    ]
    return [Experiment(name, stop, signal) for name, signal in listed]


def motor_closed(protocol: str, rng) -> list[Experiment]:
    """References [rad], eight records of 5.2 s; the eighth repeats the first."""
    stop = 5.2
    one = sines([np.deg2rad(55.0)], [0.4])
    side = rng.choice([-1.0, 1.0])
    stairs = through(np.array([0.3, 0.2, 0.6, 0.5, 0.9, 0.8, 0.4, -0.3, -0.2, -0.7, -0.6, 0.0]), 1.2, 0.06)
    listed = [
        ("sine", one),
        ("odd_multisine", multisine(rng, 0.4, np.arange(1, 20, 2), 0.5)),
        ("chirp", chirp(0.1, 0.5, 10.0, stop)),
        ("staircase", stairs),
        ("square", square(0.35, 1.3, 0.06)),
        ("small_multisine", multisine(rng, 0.4, np.arange(1, 10), 0.04)),
        ("offset_multisine", multisine(rng, 0.2, np.arange(1, 20), 0.45, offset=0.4 * side)),
        ("sine_again", one),
    ]
    return [Experiment(name, stop, signal) for name, signal in listed]


def chain(protocol: str, rng) -> list[Experiment]:
    """References of the whole chain [deg], six records of 10.4 s; the sixth repeats the first."""
    stop = 10.4
    one = sines([55.0], [0.2])
    stairs = through(np.array([-38, -30, -12, -18, 4, -2, 22, 16, 44, 38, -40, 30, -22, 14, -8, 0.0]), 90.0, 0.1, 0.04)
    side = rng.choice([-1.0, 1.0])
    listed = [
        ("sine", one),
        ("two_sines", sines([28.0, 28.0], [0.2, 0.5])),
        ("odd_multisine", multisine(rng, 0.2, np.arange(1, 14, 2), 45.0)),
        ("chirp", chirp(6.0, 0.2, 6.0, stop, offset=12.0 * side)),
        ("staircase", stairs),
        ("sine_again", one),
    ]
    return [Experiment(name, stop, signal) for name, signal in listed]
