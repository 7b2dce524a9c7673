"""How well ``tsm.noise`` finds noise that is known: families of noise on motions, each drawn anew for every seed.

    python tests/benchmarks/noise_floors.py [--draws 300] [--family NAME …] [--motion NAME …]

For each pair: the median of floor over truth, how often the truth lies in the 95 % interval and above its lower end,
the median of high over low, how often the floor was doubted or of fast noise only, and the time. The truth is the rms
of the noise about its mean over a recording, expected over all draws.
"""

import argparse
import time
from collections import Counter

import numpy as np
from scipy.signal import lfilter

import tsmblocks as tsm

STEP = 0.01


def first_order(rng, n, tau):
    a = np.exp(-STEP / tau)
    return lfilter([np.sqrt(1 - a * a)], [1, -a], rng.standard_normal(n), zi=[a * rng.standard_normal()])[0]


def slow(tau, share=1.0):
    return lambda rng, n: np.sqrt(share) * first_order(rng, n, tau) + np.sqrt(1 - share) * rng.standard_normal(n)


def bursts(rng, n):
    w = rng.standard_normal(n)
    for at in np.flatnonzero(rng.random(n) < STEP / 4):
        k = np.arange(min(n - at, int(rng.uniform(0.05, 0.3) / STEP)))
        w[at + k] += rng.uniform(3, 6) * np.sin(2 * np.pi * 17 * STEP * k)
    return w


def two_scales(rng, n):
    return 0.6 * first_order(rng, n, 0.05) + 0.6 * first_order(rng, n, 0.8) + 0.53 * rng.standard_normal(n)


def wandering(rng, n):
    return np.cumsum(rng.standard_normal(n)) * 0.03 + 0.5 * rng.standard_normal(n)


def hum(rng, n):
    return 0.8 * rng.standard_normal(n) + 0.85 * np.sin(2 * np.pi * (7.3 * STEP * np.arange(n) + rng.random()))


FAMILIES = {
    "white": lambda rng, n: rng.standard_normal(n),
    "slow 0.02 s": slow(0.02),
    "slow 0.1 s": slow(0.1),
    "slow 0.5 s": slow(0.5),
    "slow 2 s": slow(2.0),
    "white and 0.1 s": slow(0.1, 0.6),
    "white and 0.5 s": slow(0.5, 0.6),
    "white and 2 s": slow(2.0, 0.5),
    "two scales": two_scales,
    "heavy tails": lambda rng, n: rng.standard_t(4, n) / np.sqrt(2),
    "bursts": bursts,
    "quantised": lambda rng, n: rng.standard_normal(n),
    "jitter": lambda rng, n: rng.standard_normal(n),
    "wandering": wandering,
    "hum": hum,
}
QUANTUM = 2.0
"""Step of the quantised family, in rms values of the noise before."""


def tones(t, period, rng):
    phase = 2 * np.pi * rng.random(3)
    return sum(np.sin(2 * np.pi * k * t / period + p) / k for k, p in zip((1, 2, 3), phase, strict=True))


def many(rng):
    t = np.arange(3000) * STEP
    x = tones(t, rng.uniform(3, 6), rng)
    return t, x, x, ["r"]


def two(rng):
    t = np.arange(2000) * STEP
    x = tones(t, rng.uniform(9.0, 9.9), rng)
    return t, x, x, ["r"]


def transient(rng):
    t, u, x, names = two(rng)
    return t, u, x + rng.uniform(0.5, 2) * np.exp(-t / rng.uniform(0.3, 1.5)), names


def nearly(rng):
    """Two tones that come nearly back."""
    t, f = np.arange(4000) * STEP, rng.uniform(0.15, 0.25)
    x = np.sin(2 * np.pi * f * t) + 0.3 * np.sin(2 * np.pi * f * (2 + rng.uniform(0.005, 0.03)) * t + rng.random())
    return t, x, x, ["r"]


def rests(rng):
    t = np.arange(3000) * STEP
    x = np.interp(t, [0, 8, 10, 18, 20, 30], np.r_[0, 0, 1, 1, 0.3, 0.3])
    return t, x, x, ["r"]


def creeping(rng):
    """A load turns the motor while the command rests."""
    t, u, x, names = rests(rng)
    rest = (t < 8) | ((t > 10) & (t < 18)) | (t > 20)
    return t, u, x + np.cumsum(np.where(rest, np.sin(t / rng.uniform(0.5, 3)), 0)) * STEP * rng.uniform(0.5, 2), names


def repeats(rng):
    t = np.arange(2000) * STEP
    return t, (x := np.sin(t**1.3)), x, ["r", "s", "u"]


def brief(rng):
    """One short rest before the motion begins."""
    t = np.arange(2000) * STEP
    return t, (x := np.sin(np.maximum(t - 1.5, 0) ** 1.3)), x, ["r"]


def never(rng):
    """Neither periods nor rests: nothing but fast noise can be seen."""
    t = np.arange(2000) * STEP
    return t, (x := np.sin(t**1.3)), x, ["r"]


MOTIONS = {m.__name__: m for m in (many, two, transient, nearly, rests, creeping, repeats, brief, never)}
SIGMA = 0.02


def draw(family, motion, seed):
    """Estimate of one draw (floor, low, high, method, doubt) in true rms values before quantisation, and its noise."""
    rng = np.random.default_rng((seed, sorted(FAMILIES).index(family), sorted(MOTIONS).index(motion)))
    t, u, x, names = MOTIONS[motion](rng)
    off, records = [], []
    for k, name in enumerate(names):
        y = x + SIGMA * FAMILIES[family](rng, len(t))
        if family == "quantised":
            y = np.round(y / (QUANTUM * SIGMA)) * QUANTUM * SIGMA
        off.append((y - x) / SIGMA)
        late = rng.uniform(-0.3, 0.3, len(t)) * STEP if family == "jitter" and k == 0 and len(names) == 1 else 0.0
        at = t + late
        signals = {"u": np.interp(at, t, u), "y": np.interp(at, t, x) + SIGMA * off[-1]}
        records.append(tsm.Record(name, at, signals, {}))
    got = tsm.noise(records if len(records) > 1 else records[0], "y", inputs="u")
    spread = 1.96 / np.sqrt(2 * max(got.freedom, 1))  # the range given before there were intervals
    low, high = getattr(got, "low", got.floor * (1 - spread)), getattr(got, "high", got.floor * (1 + spread))
    values = np.array([got.floor, low, high]) / SIGMA
    return values, got.method, getattr(got, "doubt", ""), float(np.mean([np.var(e) for e in off]))


def main():
    parser = argparse.ArgumentParser()
    parser.add_argument("--draws", type=int, default=300)
    parser.add_argument("--family", nargs="*", default=list(FAMILIES))
    parser.add_argument("--motion", nargs="*", default=list(MOTIONS))
    asked = parser.parse_args()
    heads = ("ratio", "5 %", "95 %", "in", "above", "width", "doubt")
    print(f"{'motion':10}{'family':17}" + "".join(f"{head:>6}" for head in heads) + "  method")
    for motion in asked.motion:
        for family in asked.family:
            begun = time.perf_counter()
            rows = [draw(family, motion, seed) for seed in range(asked.draws)]
            seconds = (time.perf_counter() - begun) / asked.draws
            truth = np.sqrt(np.mean([row[3] for row in rows]))
            floor, low, high = np.array([row[0] for row in rows]).T / truth
            inside, above = np.mean((low <= 1) & (high >= 1)), np.mean(low <= 1)
            width, doubt = np.median(high / low), np.mean([bool(row[2]) for row in rows])
            methods = ", ".join(f"{k} {n / asked.draws:.2f}" for k, n in Counter(r[1] for r in rows).most_common(3))
            quantiles = "".join(f"{q:6.2f}" for q in np.quantile(floor, [0.5, 0.05, 0.95]))
            print(
                f"{motion:10}{family:17}{quantiles}{inside:6.2f}{above:6.2f}{width:6.2f}{doubt:6.2f}  {methods}, "
                f"{1000 * seconds:.0f} ms",
                flush=True,
            )


if __name__ == "__main__":
    main()
