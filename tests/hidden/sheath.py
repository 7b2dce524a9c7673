"""The sheath: symmetric hysteresis, advanced exactly over each straight piece of travel."""

from __future__ import annotations

from dataclasses import replace

import numpy as np

from .bench import Bench
from .effects import INSIDE, ORDER, OUTPUT

SHAPE = ("c", "kappa", "A", "beta", "gamma", "n", "offset")


def plant_of(spec) -> dict[str, float]:
    """True numbers of one case: loop of 8 to 12 deg half width, gain about 0.92."""
    rng = spec.rng("plant")
    near = lambda value: value * rng.uniform(0.85, 1.15)  # noqa: E731
    c, kappa, drive = 0.92 * rng.uniform(0.95, 1.05), near(0.66), -near(1.05)
    width, ratio = np.deg2rad(rng.uniform(8.0, 12.0)), rng.uniform(0.35, 0.6)
    n = rng.uniform(1.2, 1.6) if spec.group == "shape" else 1.0
    at_end = width / kappa
    beta = -drive / at_end**n / (1.0 + ratio)
    numbers = dict(c=c, kappa=kappa, A=drive, beta=beta, gamma=-ratio * beta, n=n, offset=rng.uniform(-2.0, 2.0))
    if spec.group == "base_line":
        numbers["kappa"] = 0.0
    return {k: float(v) for k, v in numbers.items()}


def starts_of(spec, plant, count) -> np.ndarray:
    """Internal state at the start of each record: anywhere within the loop."""
    end = (-plant["A"] / (plant["beta"] - plant["gamma"])) ** (1.0 / plant["n"])
    return spec.rng("starts").uniform(-0.9, 0.9, count) * end


def hysteresis(x, start, plant, drive=None, delta=0.0):
    """Internal state [rad] along angles `x` [deg] (rows, lanes), from `start` (lanes,).

    Over one step the path is straight, so dz = A dx + delta |dx| - (beta |dx| + gamma dx sgn z) z is linear as long as
    z keeps its sign, and is solved exactly. `drive` multiplies A, row by row.
    """
    dx = np.diff(np.deg2rad(x), axis=0)
    there = np.abs(dx)
    push = plant["A"] * dx * (1.0 if drive is None else 0.5 * (drive[1:] + drive[:-1])) + delta * there
    fade, lean = plant["beta"] * there, plant["gamma"] * dx
    if np.any(plant["n"] != 1.0):
        return _sharper(push, fade, lean, start, plant["n"])
    above, below = fade + lean, fade - lean
    keep_above, keep_below = np.exp(-above), np.exp(-below)
    add_above, add_below = push * _mean_decay(above), push * _mean_decay(below)
    z = np.empty_like(x)
    z[0] = now = start
    for k in range(len(dx)):
        positive = now > 0.0
        now = np.where(positive, keep_above[k], keep_below[k]) * now
        now += np.where(positive, add_above[k], add_below[k])
        z[k + 1] = now
    return z


def _mean_decay(k):
    """(1 - exp(-k)) / k, also at 0."""
    small = np.abs(k) < 1e-12
    return np.where(small, 1.0, -np.expm1(-k) / np.where(small, 1.0, k))


def _sharper(push, fade, lean, start, n):
    """The same for n > 1: the power is held at its value in the middle of the step, found by a half step before."""
    z = np.empty((len(push) + 1, push.shape[1]))
    z[0] = now = start
    power = n - 1.0

    def moved(part, k, at):
        decay = (fade[k] + lean[k] * np.sign(at)) * np.abs(at) ** power
        return now + part * (push[k] - decay * now) * (1.0 - 0.5 * part * decay)

    for k in range(len(push)):
        middle = moved(0.5, k, now)
        now = moved(1.0, k, middle)
        z[k + 1] = now
    return z


def spread(bench: Bench, per_case: list[dict[str, float]]) -> dict[str, np.ndarray]:
    """Numbers of the cases, repeated for their lanes."""
    return {k: np.array([p[k] for p in per_case])[bench.owner] for k in per_case[0]}


def clean_sheath(bench: Bench, plant, start):
    """(output [deg], hysteresis part [deg]) of the plant in which nothing is hidden."""
    z = plant["kappa"] * np.rad2deg(hysteresis(bench.x, start, plant))
    return plant["c"] * bench.x + z + plant["offset"], z


def hidden_sheath(bench: Bench, plant, start, hidden, plain):
    """Output [deg] with effects in it: `hidden` is name -> (amplitudes (lanes,), numbers of the effect).

    In the group "front" they stand between what was measured of the motor and the sheath.
    """
    if bench.specs[0].group == "front":
        moved = bench.x
        for name, (a, p) in hidden.items():
            moved = OUTPUT[name](bench, moved, a, p)
        return clean_sheath(replace(bench, x=moved), plant, start)[0]
    y, drive, delta = plain, None, 0.0
    inner = [name for name in hidden if name in INSIDE]
    for name in inner:
        factor, more = INSIDE[name](bench, *hidden[name])
        drive = factor if drive is None else drive * (1.0 if factor is None else factor)
        delta = delta + more
    if inner:
        z = hysteresis(bench.x, start, plant, drive, delta)
        y = plant["c"] * bench.x + plant["kappa"] * np.rad2deg(z) + plant["offset"]
    for name in sorted(set(hidden) & set(OUTPUT), key=ORDER.index):
        y = OUTPUT[name](bench, y, *hidden[name])
    return y
