"""Cases of the whole chain: reference, position loop, motor, sheath. Signals r, x_in, x_out in degrees, u in volts.

What is hidden is in the motor, in the sheath, or in the encoder between them, which the loop sees as well.
"""

from __future__ import annotations

import numpy as np

from .bench import COUNT, Bench, clean_records, floor_of, sensors_of, session_of
from .choose import MOTOR_SCALES, SCALES, SENSOR_SCALES, motor_numbers_of, numbers_of
from .excess import amplitudes_for, left_over, span
from .kinds import Case, families_of
from .motor import KD, KP, LIMIT, TF, run_motor
from .motor_cases import ANGLE_COUNT, NUDGE, VOLT_COUNT, motor_floor_of, motor_noise_of, motor_plant_of
from .numerics import at_positions, coloured, quantised
from .sheath import clean_sheath, hidden_sheath, plant_of, spread, starts_of
from .signals import chain

PERIOD, JITTER = 0.004, 1e-4
"""Sampling [s] and its jitter [s]."""


def chain_cases(specs, step) -> list[Case]:
    """A batch in which the same effect is hidden; `step` is the sheath's, the motor's is a fifth of it."""
    work = _Chains(specs, step)
    if not specs[0].effect:
        return [work.case(i, work.plain, None, {}) for i in range(len(specs))]
    a = amplitudes_for(lambda a: work.reached(a)[0], specs, work.scale)
    excess, each, hidden = work.reached(a)
    numbers = [dict(excess=float(e)) | {k: float(v[i]) for k, v in each.items()} for i, e in enumerate(excess)]
    return [work.case(i, hidden, float(a[i]), numbers[i]) for i in range(len(specs))]


class _Chains:
    """One batch of chains. Signals are dicts of (rows, lanes): r, u, x_in as read, x as it is, x_out, and its loop."""

    def __init__(self, specs, step):
        self.specs, self.step = specs, step
        self.segment, _, self.name = specs[0].effect.partition(":")
        sessions = [session_of(s, chain) for s in specs]
        self.lists = [listed for listed, _ in sessions]
        self.owner = np.concatenate([np.full(len(listed), i) for i, listed in enumerate(self.lists)])
        self.start = np.concatenate([at for _, at in sessions])
        self.stop = np.array([e.stop for listed in self.lists for e in listed])
        ends = np.array([at[-1] + listed[-1].stop for listed, at in sessions])
        self.total = ends[self.owner]
        half = np.arange(10 * round((self.stop.max() + 0.02) / step) + 1) * (step / 10.0)
        self.given = np.deg2rad(np.column_stack([e.signal(half) for listed in self.lists for e in listed]))
        self.motors = [motor_plant_of(s) for s in specs]
        self.motor = spread(self, self.motors)
        self.plants = [plant_of(s) for s in specs]
        self.plant = spread(self, self.plants)
        counts = [len(listed) for listed in self.lists]
        self.at_start = np.concatenate([starts_of(s, p, n) for s, p, n in zip(specs, self.plants, counts, strict=True)])
        self.floors = [chain_floor_of(s) for s in specs]
        self.plain = self.sheathed(self.moved())
        if self.name:
            self.own = [self._numbers(i) for i in range(len(specs))]
            self.bases = self._motor_bases()

    @property
    def scale(self):
        """First amplitude, largest, and power of the batch's effect."""
        return dict(motor=MOTOR_SCALES, sheath=SCALES, sensor=SENSOR_SCALES)[self.segment][self.name]

    def _numbers(self, i):
        spec, starts = self.specs[i], self.start[self.owner == i]
        if self.segment == "sheath":
            return numbers_of(self.name, spec, self.lists[i], starts)
        return motor_numbers_of(self._key, spec, self.lists[i], starts)

    @property
    def _key(self):
        return f"sensor:{self.name}" if self.segment == "sensor" else self.name

    def _effects(self, a):
        numbers = {k: np.array([p[k] for p in self.own])[self.owner] for k in self.own[0]}
        return {self._key: (a[self.owner], numbers)}

    # ---- simulation

    def moved(self, effects=None, motor=None):
        """Signals of the motor's side."""
        u, seen, true = run_motor(self.given, self.start, motor or self.motor, self.step / 5.0, 5, effects)
        return dict(r=np.rad2deg(self.given[::10]), u=u, x_in=np.rad2deg(seen), x=np.rad2deg(true))

    def bench(self, x) -> Bench:
        """The lanes as the sheath sees them when `x` [deg] moves it."""
        return Bench(
            specs=tuple(self.specs),
            lists=tuple(self.lists),
            owner=self.owner,
            t=np.arange(len(x)) * self.step,
            start=self.start,
            stop=self.stop,
            total=self.total,
            x=x,
            v=np.gradient(x, self.step, axis=0),
            step=self.step,
            period=PERIOD,
            jitter=JITTER,
        )

    def sheathed(self, signals, by="x"):
        """The same with the plain sheath's output."""
        y, loop = clean_sheath(self.bench(signals[by]), self.plant, self.at_start)
        return signals | dict(x_out=y, loop=loop)

    # ---- excess

    def reached(self, a):
        """(excess of each case, its parts, signals): that of the segment; for the encoder the smaller of both."""
        if self.segment == "sheath":
            bench = self.bench(self.plain["x"])
            y = hidden_sheath(bench, self.plant, self.at_start, self._effects(a), self.plain["x_out"])
            hidden = self.plain | dict(x_out=y)
            e = self._sheath_excess(y - self.plain["x_out"], self.plain)
            return e, dict(excess_sheath=e), hidden
        hidden = self.sheathed(self.moved(self._effects(a)))
        motor = self._motor_excess(hidden)
        if self.segment == "motor":
            return motor, dict(excess_motor=motor), hidden
        believed = self.sheathed(dict(x_in=hidden["x_in"]), by="x_in")
        sheath = self._sheath_excess(hidden["x_out"] - believed["x_out"], believed)
        return np.minimum(motor, sheath), dict(excess_motor=motor, excess_sheath=sheath), hidden

    def _sampled(self, y, i):
        n, every = round(self.stop[0] / PERIOD), round(PERIOD / self.step)
        return y[::every][:n, self.owner == i].T.ravel()

    def _sheath_excess(self, change, base):
        excess = []
        for i, floor in enumerate(self.floors):
            columns = [self._sampled(base[k], i) for k in ("x_in", "x_out", "loop")]
            basis = span(np.column_stack([np.ones(len(columns[0])), *columns]))
            excess.append(left_over(self._sampled(change, i), basis) / floor["x_out"] ** 2)
        return np.array(excess)

    def _motor_bases(self):
        names = ["K", "tau", "coulomb"] if np.any(self.motor["coulomb"]) else ["K", "tau"]
        near = [self.moved(motor=dict(self.motor) | {k: self.motor[k] * (1.0 + NUDGE)}) for k in names]
        return [span(np.column_stack([self._weighted(n, i) for n in near])) for i in range(len(self.specs))]

    def _weighted(self, signals, i):
        parts = [self._sampled(signals[k] - self.plain[k], i) / self.floors[i][k] for k in ("u", "x_in")]
        return np.concatenate(parts)

    def _motor_excess(self, hidden):
        excess = []
        for i, basis in enumerate(self.bases):
            change = self._weighted(hidden, i)
            left = change - basis @ (basis.T @ change)
            excess.append(max(np.mean(part**2) for part in np.split(left, 2)))
        return np.array(excess)

    # ---- the value

    def case(self, i, hidden, amplitude, reached) -> Case:
        """One case of the batch."""
        spec = self.specs[i]
        truth = (self.name,) if self.name else ()
        numbers = self.plants[i] | self.motors[i] | dict(kp=KP, kd=KD, tf=TF, limit=LIMIT) | reached
        if truth:
            numbers[f"{self.name}.amplitude"] = amplitude
            numbers |= {f"{self.name}.{k}": v for k, v in self.own[i].items()}
        bench, names = self.bench(hidden["x"]), ("r", "u", "x_in", "x_out")
        return Case(
            group=spec.group,
            truth=truth,
            families=families_of(truth),
            segment=self.segment,
            seed=spec.seed,
            size=spec.size,
            experiments=self._measured(i, hidden),
            clean=clean_records(bench, i, {k: hidden[k] for k in names}),
            without=clean_records(bench, i, {k: self.plain[k] for k in names}),
            floor=self.floors[i],
            base="chain_coulomb" if self.motors[i]["coulomb"] else "chain",
            numbers=numbers,
            effect=spec.effect,
            protocol=spec.protocol,
            units=dict(t="s", r="deg", u="V", x_in="deg", x_out="deg"),
        )

    def _measured(self, i, signals):
        rng, noise = self.specs[i].rng("noise"), chain_noise_of(self.specs[i])
        counts = dict(u=VOLT_COUNT, x_in=np.rad2deg(ANGLE_COUNT), x_out=COUNT)
        records = {}
        for experiment, j in zip(self.lists[i], np.flatnonzero(self.owner == i), strict=True):
            n = round(self.stop[j] / PERIOD)
            nominal = np.arange(n) * PERIOD
            at = nominal + JITTER * np.clip(rng.standard_normal(n), -4.0, 4.0)
            record = dict(t=np.round(self.start[j] + nominal, 6))
            record["r"] = signals["r"][:: round(PERIOD / self.step)][:n, j].copy()
            for k, count in counts.items():
                exact = at_positions(signals[k][:, j : j + 1], at[:, None] / self.step)[:, 0]
                record[k] = quantised(exact + coloured(rng, n, noise[k], PERIOD), count)
            records[experiment.name] = record
        return records


def chain_noise_of(spec):
    """Noise before counting: u [V], x_in and x_out [deg]."""
    motor = motor_noise_of(spec)
    return dict(u=motor["u"], x_in=np.rad2deg(motor["x_in"]), x_out=sensors_of(spec)["out"])


def chain_floor_of(spec):
    """Rms of the noise with its counting: u [V], x_in and x_out [deg]."""
    motor = motor_floor_of(spec)
    return dict(u=motor["u"], x_in=float(np.rad2deg(motor["x_in"])), x_out=floor_of(spec))
