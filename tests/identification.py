"""Recordings of the paper's three signals, simulated by SciPy and spoilt as an instrument would, for tests of fits."""

import math

import numpy as np
from scipy import signal
from scipy.integrate import solve_ivp

import tsmblocks as tsm

DEGREE = math.pi / 180
TRUTH = {"tsm.alpha1": 0.8972, "tsm.alpha2": 0.9487, "tsm.A": -0.8745, "tsm.theta": 5.034, "tsm.delta": 0.14522}
ROUGH = {"tsm.alpha1": 1.0, "tsm.alpha2": 1.0, "tsm.A": -0.5, "tsm.theta": 2.0, "tsm.delta": 0.0}
BOX = {"tsm.alpha1": (0.1, 3), "tsm.alpha2": (0.1, 3), "tsm.A": (-5, 5), "tsm.theta": (0.01, 50), "tsm.delta": (-3, 3)}
SIGNALS = {  # amplitudes in degrees, frequencies in Hz
    "one tone": ((55, 0.2),),
    "two tones": ((28, 0.2), (28, 0.5)),
    "no period": ((28, 0.25), (28, 0.25 * math.sqrt(3))),
}
RATE, STOP = 100.0, 10.0
NOISE, ENCODER = 0.3 * DEGREE, 0.09 * DEGREE  # an encoder of 4000 counts a turn
CUTOFF = 5.0  # of the filter that smooths the encoder's steps out of the input, Hz
OPTIONS = {"free": ["tsm.*"], "step": 1 / RATE, "hold": "cubic"}
SMOOTH = signal.butter(2, 0.1)


def motion(tones, t):
    """Angle and velocity at the motor end."""
    x = sum(a * DEGREE * np.sin(2 * np.pi * f * t) for a, f in tones)
    v = sum(a * DEGREE * 2 * np.pi * f * np.cos(2 * np.pi * f * t) for a, f in tones)
    return x, v


def simulated(tones, t, numbers=TRUTH):
    """Angles at both ends by Eqs (8) and (9), at a tolerance far below the noise."""
    a1, a2, A, theta, delta = numbers.values()

    def rate(now, zeta):
        v = motion(tones, now)[1]
        return A * v - theta * abs(v) * zeta + delta * abs(v)

    found = solve_ivp(rate, (t[0], t[-1]), [0.0], "DOP853", t_eval=t, rtol=1e-10, atol=1e-12, max_step=0.02)
    x, v = motion(tones, t)
    return x, ((1 + np.tanh(v)) * a1 + (1 - np.tanh(v)) * a2) / 2 * x + found.y[0]


def white(n, rng):
    return rng.standard_normal(n)


def autoregressive(n, rng, phi=0.9):
    e = math.sqrt(1 - phi**2) * rng.standard_normal(n)
    e[0] = rng.standard_normal()
    return signal.lfilter([1], [1, -phi], e)


def filtered(n, rng):
    """What a zero-phase low-pass leaves of white noise, of variance 1."""
    impulse = signal.filtfilt(*SMOOTH, np.eye(1, 801, 400)[0])
    return signal.filtfilt(*SMOOTH, rng.standard_normal(n + 400))[200:-200] / math.sqrt(float(np.sum(impulse**2)))


NOISES = {"white": white, "AR(1) 0.9": autoregressive, "zero-phase filtered": filtered}


def steps(y, size):
    return np.round(y / size) * size


class Bench:
    """The clean signals, simulated once, and recordings of them."""

    def __init__(self, rate=RATE, stop=STOP):
        self.t = np.arange(round(rate * stop) + 1) / rate
        self.clean = {name: self._recorded(name, *simulated(tones, self.t)) for name, tones in SIGNALS.items()}

    def _recorded(self, name, x, y):
        """Encoders have steps; the input's are filtered out, as the paper does with its data."""
        made = tsm.Record(name, self.t, {"x_in": steps(x, ENCODER), "x_out": y}, {"x_in": "rad", "x_out": "rad"})
        return made.filtered("x_in", cutoff=CUTOFF)

    def record(self, name, noise, rng):
        y = self.clean[name]["x_out"] + NOISE * noise(len(self.t), rng)
        return self.clean[name].with_signal("x_out", steps(y, ENCODER), "rad")

    def records(self, noise, seed, names=tuple(SIGNALS)):
        rng = np.random.default_rng(seed)
        return [self.record(name, noise, rng) for name in names]


def random_starts(count, seed=7):
    """Starts spread over the box, theta in its logarithm."""
    rng = np.random.default_rng(seed)
    for _ in range(count):
        drawn = {name: rng.uniform(*ends) for name, ends in BOX.items()}
        low, high = np.log(BOX["tsm.theta"])
        yield {**drawn, "tsm.theta": float(np.exp(rng.uniform(low, high)))}


def hits(bench, noise, draws, names=tuple(SIGNALS), first=0):
    """For each draw of the noise, which intervals at 95 % hold the truth, shape (draws, parameters)."""
    diagram, truth, found = tsm.load("tendon_sheath_asymmetric"), np.array(list(TRUTH.values())), []
    for seed in range(first, first + draws):
        fit = tsm.fit(diagram, bench.records(noise, seed, names), start=ROUGH, starts=1, **OPTIONS)
        low, high = ([getattr(fit[name], side) for name in TRUTH] for side in ("low", "high"))
        found.append((low <= truth) & (truth <= high))
    return np.array(found)


def searches(bench, method, count, noise=white, seed=0):
    """Fits from random starts by a method, in the box that they are drawn from."""
    diagram, records = tsm.load("tendon_sheath_asymmetric"), bench.records(noise, seed)
    return [
        tsm.fit(diagram, records, start=start, bounds=BOX, starts=1, method=method, seed=k, **OPTIONS)
        for k, start in enumerate(random_starts(count))
    ]


def distance(fit):
    """How far the truth is from the estimate, squared, in its covariance: chi square of five degrees of freedom."""
    off = np.array([fit[name].value - value for name, value in TRUTH.items()])
    return float(off @ np.linalg.solve(fit.covariance, off))
