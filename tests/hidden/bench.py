"""The lanes of a batch: every record of every case side by side, moved by a motor upstream, read by two encoders."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from .numerics import at_positions, coloured, filtered, quantised
from .signals import TURN, Experiment, experiments

PERIOD = 0.01
JITTER = 0.4e-3
COUNT = 0.05
"""Sampling period [s], rms of the instants' jitter [s], one count of both encoders [deg]."""


@dataclass(frozen=True)
class Bench:
    """Lanes: column j is record `names[...]` of case `owner[j]`.

    t         instants within a record [s], (rows,)
    start     instant of the session at which a lane's record starts [s], (lanes,)
    stop      its length [s], (lanes,)
    total     length of its session [s], (lanes,)
    period    from sample to sample [s]
    jitter    rms of the instants' jitter [s]
    x, v      true angle of the motor [deg] and its rate [deg/s], (rows, lanes)
    """

    specs: tuple
    lists: tuple[list[Experiment], ...]
    owner: np.ndarray
    t: np.ndarray
    start: np.ndarray
    stop: np.ndarray
    total: np.ndarray
    x: np.ndarray
    v: np.ndarray
    step: float
    period: float = PERIOD
    jitter: float = JITTER

    @property
    def session(self) -> np.ndarray:
        """Instants on the session's clock [s], (rows, lanes)."""
        return self.t[:, None] + self.start[None, :]

    @property
    def every(self) -> int:
        """Rows from sample to sample."""
        return round(self.period / self.step)

    def samples(self, lane: int) -> int:
        """How many samples a lane's record has."""
        return round(self.stop[lane] / self.period)

    def lanes(self, index: int) -> np.ndarray:
        """Lanes of one case."""
        return np.flatnonzero(self.owner == index)

    def stacked(self, y, index):
        """A case's samples at the nominal instants, its records one after another."""
        return np.concatenate([y[:: self.every][: self.samples(j), j] for j in self.lanes(index)])


def session_of(spec, planned=experiments) -> tuple[list[Experiment], np.ndarray]:
    """Records of a session, and when each starts, with a pause of 15 to 60 s between them [s]."""
    rng = spec.rng("session")
    listed = planned(spec.protocol, rng)
    stops = np.array([e.stop for e in listed])
    pauses = rng.uniform(15.0, 60.0, len(listed)).round(2)
    return listed, np.cumsum(stops + pauses) - stops - pauses[0]


def bench_of(specs, step=1e-3) -> Bench:
    """Lanes for the cases of a list, with the motor's angle: a position loop of about 15 Hz follows the reference."""
    sessions = [session_of(s) for s in specs]
    owner = np.concatenate([np.full(len(listed), i) for i, (listed, _) in enumerate(sessions)])
    start = np.concatenate([at for _, at in sessions])
    stop = np.array([e.stop for listed, _ in sessions for e in listed])
    ends = np.array([at[-1] + listed[-1].stop for listed, at in sessions])
    t = np.arange(round(stop.max() / step) + 21) * step
    reference = np.column_stack([e.signal(t) for listed, _ in sessions for e in listed])
    num, den = [], []
    for spec, (listed, _) in zip(specs, sessions, strict=True):
        rng = spec.rng("motor")
        omega, damping = TURN * 15.0 * rng.uniform(0.85, 1.15), 0.7 * rng.uniform(0.9, 1.1)
        num += [(omega**2,)] * len(listed)
        den += [(1.0, 2.0 * damping * omega, omega**2)] * len(listed)
    x = filtered(num, den, reference, step)
    return Bench(
        specs=tuple(specs),
        lists=tuple(listed for listed, _ in sessions),
        owner=owner,
        t=t,
        start=start,
        stop=stop,
        total=ends[owner],
        x=x,
        v=np.gradient(x, step, axis=0),
        step=step,
    )


def sensors_of(spec) -> dict[str, float]:
    """Noise of the two encoders before they count [deg]."""
    rng = spec.rng("sensors")
    return dict(out=0.06 * rng.uniform(0.85, 1.15), into=0.03 * rng.uniform(0.85, 1.15))


def floor_of(spec) -> float:
    """Rms of the noise of x_out with its counting [deg]."""
    return float(np.hypot(sensors_of(spec)["out"], COUNT / np.sqrt(12.0)))


def clean_records(bench: Bench, index: int, signals: dict) -> dict[str, dict[str, np.ndarray]]:
    """Signals of one case at the nominal instants, record by record."""
    records = {}
    for experiment, j in zip(bench.lists[index], bench.lanes(index), strict=True):
        n = bench.samples(j)
        record = dict(t=np.round(bench.start[j] + np.arange(n) * bench.period, 6))
        record |= {name: y[:: bench.every][:n, j].copy() for name, y in signals.items()}
        records[experiment.name] = record
    return records


def measured_records(bench: Bench, index: int, signals: dict) -> dict[str, dict[str, np.ndarray]]:
    """The same as two encoders read them: late or early by the jitter (both at once), with noise, in counts."""
    spec = bench.specs[index]
    rng, sizes = spec.rng("noise"), sensors_of(spec)
    records = {}
    for experiment, j in zip(bench.lists[index], bench.lanes(index), strict=True):
        n = bench.samples(j)
        at = np.arange(n) * bench.period + bench.jitter * np.clip(rng.standard_normal(n), -4.0, 4.0)
        record = dict(t=np.round(bench.start[j] + np.arange(n) * bench.period, 6))
        for name, y in signals.items():
            exact = at_positions(y[:, j : j + 1], at[:, None] / bench.step)[:, 0]
            noise = coloured(rng, n, sizes["out" if name == "x_out" else "into"], bench.period)
            record[name] = quantised(exact + noise, COUNT)
        records[experiment.name] = record
    return records
