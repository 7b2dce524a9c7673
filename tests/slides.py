"""A mass on a spring with viscous friction, driven by a measured force: its recordings, and its diagram."""

from __future__ import annotations

import numpy as np
from scipy.signal import lfilter, lsim

import tsmblocks as tsm

STEP, MASS, DAMPING, STIFFNESS, SENSOR = 0.004, 2.5, 18.0, 400.0, 1e-4
T = np.arange(0.0, 8.0, STEP)
FINE = 10
"""Steps of the simulation in one of the recording."""


def slow_noise(rms, corner, seed=0):
    """Noise that falls above a corner frequency [Hz]."""
    a, white = np.exp(-2 * np.pi * corner * STEP), np.random.default_rng(seed).standard_normal(len(T) + 2000)
    return rms * lfilter([np.sqrt(1 - a * a)], [1, -a], white)[2000:]


def force(seed=0):
    random = np.random.default_rng(seed)
    waves = zip(np.geomspace(0.2, 4, 7), random.uniform(0, 2 * np.pi, 7), strict=True)
    return 8 * sum(np.sin(2 * np.pi * f * T + phase) for f, phase in waves)


def linear(F):
    """The motion without any other force."""
    system = [[0, 1], [-STIFFNESS / MASS, -DAMPING / MASS]], [[0], [1 / MASS]], [[1, 0]], [[0]]
    return lsim(system, F, T)[1]


def resisted(F, resistance):
    """The motion with a further ``resistance(t, v)`` [N], by the method of Euler with fine steps."""
    now, h = np.arange(len(T) * FINE) / FINE, STEP / FINE
    x, v, places = 0.0, 0.0, np.empty(len(now))
    for k, drive in enumerate(np.interp(now, np.arange(len(T)), F)):
        places[k] = x
        v += h * (drive - DAMPING * v - STIFFNESS * x - resistance(now[k] * STEP, v)) / MASS
        x += h * v
    return places[::FINE]


def recorded(noise=0.0, seed=0, resistance=None):
    """A recording, with ``noise`` in the reading of the force and white noise in that of the position."""
    F = force(seed)
    place = linear(F) if resistance is None else resisted(F, resistance)
    place = place + SENSOR * np.random.default_rng(seed + 1).standard_normal(len(T))
    return tsm.Record("run", T, {"F": F + noise, "x": place}, {"F": "N", "x": "m"})


def slide():
    """The diagram, with guesses of its parameters."""
    blocks = {
        "net": tsm.blocks.Sum(signs="+--"),
        "acceleration": tsm.blocks.Gain(gain=0.33, unit="m/s^2"),
        "speed": tsm.blocks.Integrator(),
        "place": tsm.blocks.Integrator(),
        "friction": tsm.blocks.ViscousFriction(coefficient=20.0),
        "spring": tsm.blocks.Gain(gain=350.0, unit="N"),
    }
    wires = ["net -> acceleration -> speed -> place -> spring -> net.minus2", "speed -> friction -> net.minus1"]
    return tsm.Diagram(
        blocks=blocks, wires=wires, inputs={"F": tsm.Inlet(["net.plus"], unit="N")}, outputs={"x": "place"}
    )
