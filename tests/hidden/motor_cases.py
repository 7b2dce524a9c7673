"""Cases of the motor alone: voltage to angle, and the position loop with its voltage."""

from __future__ import annotations

import numpy as np

from .bench import session_of
from .choose import MOTOR_SCALES, motor_numbers_of
from .excess import amplitudes_for, left_over, span
from .kinds import Case, families_of
from .motor import KD, KP, LIMIT, TF, run_motor
from .numerics import coloured, quantised
from .signals import motor_closed, motor_open

PERIOD = 0.002
ANGLE_COUNT, VOLT_COUNT = np.deg2rad(0.02), 0.005
NUDGE = 1e-4
WINDOW = 1.0
"""Sampling [s], one count of the encoder [rad] and of the voltmeter [V], nudge of a number, restart interval [s]."""


def motor_plant_of(spec) -> dict[str, float]:
    """True numbers of one motor. Where Stribeck's extra is hidden, the base knows of Coulomb friction already."""
    rng = spec.rng("motor plant")
    numbers = dict(K=2.0 * rng.uniform(0.85, 1.15), tau=0.02 * rng.uniform(0.85, 1.15), coulomb=0.0)
    if spec.effect.endswith("stribeck_friction"):
        numbers["coulomb"] = 0.5 * rng.uniform(0.8, 1.2)
    return numbers


def motor_noise_of(spec) -> dict[str, float]:
    """Noise before counting: voltage [V] and angle [rad]."""
    rng = spec.rng("motor sensors")
    return dict(u=0.02 * rng.uniform(0.85, 1.15), x_in=np.deg2rad(0.012) * rng.uniform(0.85, 1.15))


def motor_floor_of(spec) -> dict[str, float]:
    """Rms of the noise with its counting."""
    noise = motor_noise_of(spec)
    counts = dict(u=VOLT_COUNT, x_in=ANGLE_COUNT)
    return {k: float(np.hypot(noise[k], counts[k] / np.sqrt(12.0))) for k in noise}


def motor_cases(specs, step) -> list[Case]:
    """A batch in which the same effect is hidden; the motor's step is a fifth of `step`."""
    work = _Motors(specs, step / 5.0)
    name = specs[0].effect
    if not name:
        hidden, a = work.plain, None
    else:
        a = amplitudes_for(work.reached, specs, MOTOR_SCALES[name])
        hidden = work.run(effects=work.effects(a))
    return [work.case(i, hidden, None if a is None else float(a[i])) for i in range(len(specs))]


class _Motors:
    """One batch of motors."""

    def __init__(self, specs, step):
        self.specs, self.step = specs, step
        self.closed = specs[0].group == "motor_closed"
        planned = motor_closed if self.closed else motor_open
        sessions = [session_of(s, planned) for s in specs]
        self.lists = [listed for listed, _ in sessions]
        self.starts = [at for _, at in sessions]
        self.owner = np.concatenate([np.full(len(listed), i) for i, listed in enumerate(self.lists)])
        self.start = np.concatenate(self.starts)
        stop = self.lists[0][0].stop
        half = np.arange(2 * round(stop / step) + 1) * (step / 2.0)
        self.given = np.column_stack([e.signal(half) for listed in self.lists for e in listed])
        self.keep = round(PERIOD / step)
        self.plants = [motor_plant_of(s) for s in specs]
        self.motor = {k: np.array([p[k] for p in self.plants])[self.owner] for k in self.plants[0]}
        self.floors = [motor_floor_of(s) for s in specs]
        self.outputs = ("u", "x_in") if self.closed else ("x_in",)
        self.plain = self.run()
        name = specs[0].effect
        self.own = [motor_numbers_of(name, s, li, at) for s, li, at in zip(specs, self.lists, self.starts, strict=True)]
        self.bases = [self._base(i, nudged) for nudged in [self._nudged()] for i in range(len(specs))] if name else []

    def run(self, motor=None, effects=None):
        """Signals at the nominal instants: name -> (samples, lanes)."""
        u, seen, _ = run_motor(
            self.given, self.start, motor or self.motor, self.step, self.keep, effects, closed=self.closed
        )
        return dict(u=u[:-1], x_in=seen[:-1], r=self.given[:: 2 * self.keep][:-1])

    def effects(self, amplitudes):
        """The batch's effect at these amplitudes, spread over the lanes."""
        numbers = {k: np.array([p[k] for p in self.own])[self.owner] for k in self.own[0]}
        return {self.specs[0].effect: (amplitudes[self.owner], numbers)}

    # ---- excess

    def reached(self, amplitudes):
        """Excess of each case: the larger of its outputs'."""
        return np.array([max(row.values()) for row in self.excesses(self.run(effects=self.effects(amplitudes)))])

    def excesses(self, hidden) -> list[dict[str, float]]:
        """Excess at each output of each case, after a joint regression on what the base's numbers can change."""
        change = {k: hidden[k] - self.plain[k] for k in self.outputs}
        rows = []
        for i in range(len(self.specs)):
            parts = {k: self._stacked(change[k], i) / self.floors[i][k] for k in self.outputs}
            whole = np.concatenate(list(parts.values()))
            left = whole - self.bases[i] @ (self.bases[i].T @ whole)
            cut = np.split(left, np.cumsum([len(p) for p in parts.values()])[:-1])
            rows.append({k: left_over(c, np.zeros((len(c), 0))) for k, c in zip(parts, cut, strict=True)})
        return rows

    def _stacked(self, y, i):
        """A case's records one after another; in open loop less what the restarts' start values explain."""
        y = y[:, self.owner == i]
        if not self.closed:
            n = round(WINDOW / PERIOD)
            tau = self.plants[i]["tau"]
            start = span(np.column_stack([np.ones(n), np.exp(-np.arange(n) * PERIOD / tau)]))
            y = y[: len(y) // n * n].T.reshape(-1, n).T
            y = y - start @ (start.T @ y)
        return y.T.ravel()

    def _nudged(self):
        """Change of the outputs per relative change of each number."""
        changes = []
        for k in ("K", "tau", "coulomb") if np.any(self.motor["coulomb"]) else ("K", "tau"):
            near = self.run(dict(self.motor) | {k: self.motor[k] * (1.0 + NUDGE)})
            changes.append({name: (near[name] - self.plain[name]) / NUDGE for name in self.outputs})
        return changes

    def _base(self, i, nudged):
        def weighted(change):
            return np.concatenate([self._stacked(change[k], i) / self.floors[i][k] for k in self.outputs])

        return span(np.column_stack([weighted(change) for change in nudged]))

    # ---- the value

    def case(self, i, hidden, amplitude) -> Case:
        """One case of the batch."""
        spec = self.specs[i]
        truth = (spec.effect,) if spec.effect else ()
        numbers = dict(self.plants[i])
        if self.closed:
            numbers |= dict(kp=KP, kd=KD, tf=TF, limit=LIMIT)
        if spec.effect:
            numbers |= {f"{spec.effect}.amplitude": amplitude}
            numbers |= {f"{spec.effect}.{k}": v for k, v in self.own[i].items()}
            each = self.excesses(hidden)[i]
            numbers |= dict(excess=max(each.values())) | {f"excess_{k}": v for k, v in each.items()}
        return Case(
            group=spec.group,
            truth=truth,
            families=families_of(truth),
            segment="motor" if truth else "",
            seed=spec.seed,
            size=spec.size,
            experiments=self._measured(i, hidden),
            clean=self._records(i, hidden),
            without=self._records(i, self.plain),
            floor={k: self.floors[i][k] for k in self.outputs},
            base=self._diagram(i),
            numbers=numbers,
            effect=spec.effect,
            protocol=spec.protocol,
            units=dict(t="s", u="V", x_in="rad") | (dict(r="rad") if self.closed else {}),
        )

    def _diagram(self, i):
        name = "motor_closed" if self.closed else "motor_linear"
        return f"{name}_coulomb" if self.plants[i]["coulomb"] else name

    def _records(self, i, signals):
        records = {}
        names = ("r", "u", "x_in") if self.closed else ("u", "x_in")
        for experiment, j in zip(self.lists[i], np.flatnonzero(self.owner == i), strict=True):
            t = np.round(self.start[j] + np.arange(len(signals["u"])) * PERIOD, 6)
            records[experiment.name] = dict(t=t) | {k: signals[k][:, j].copy() for k in names}
        return records

    def _measured(self, i, signals):
        """References, and voltages given in open loop, are known exactly."""
        rng, noise = self.specs[i].rng("motor noise"), motor_noise_of(self.specs[i])
        counts = dict(u=VOLT_COUNT, x_in=ANGLE_COUNT)
        records = self._records(i, signals)
        for record in records.values():
            for k in self.outputs:
                record[k] = quantised(record[k] + coloured(rng, len(record[k]), noise[k], PERIOD), counts[k])
        return records
