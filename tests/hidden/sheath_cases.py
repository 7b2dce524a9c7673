"""Cases of the sheath: x_in to x_out."""

from __future__ import annotations

import numpy as np

from .bench import Bench, bench_of, clean_records, floor_of, measured_records
from .choose import SCALES, numbers_of
from .excess import amplitudes_for, left_over, span
from .kinds import Case, Spec, families_of
from .sheath import clean_sheath, hidden_sheath, hysteresis, plant_of, spread, starts_of

NUDGE = 1e-4


def sheath_cases(specs: list[Spec], step: float) -> list[Case]:
    """A batch in which the same effects are hidden, at sizes and seeds of their own."""
    work = _Work(specs, step)
    names = specs[0].effect.split("+") if specs[0].effect else []
    hidden = {name: (work.scaled(name), work.numbers(name)) for name in names}
    spread_out = {name: (a[work.bench.owner], p) for name, (a, p) in hidden.items()}
    y = hidden_sheath(work.bench, work.plant, work.start, spread_out, work.plain) if names else work.plain
    reached, refitted = (work.excess(y, work.bases), work.excess(y, work.refit_bases)) if names else (None, None)
    made = []
    for i, spec in enumerate(specs):
        numbers = dict(work.plants[i])
        for name, (a, _) in hidden.items():
            numbers[f"{name}.amplitude"] = float(a[i])
            own = work.own_numbers[name][i]
            numbers |= {f"{name}.{k}": v for k, v in own.items() if not callable(v)}
        if names:
            numbers |= dict(excess=float(reached[i]), excess_refit=float(refitted[i]))
        made.append(_case(work, spec, i, y, numbers))
    return made


def _case(work, spec, i, y, numbers) -> Case:
    truth = truth_of(spec)
    bench = work.bench
    return Case(
        group=spec.group,
        truth=truth,
        families=families_of(truth),
        segment="sheath" if truth else "",
        seed=spec.seed,
        size=spec.size,
        experiments=measured_records(bench, i, dict(x_in=bench.x, x_out=y)),
        clean=clean_records(bench, i, dict(x_in=bench.x, x_out=y)),
        without=clean_records(bench, i, dict(x_in=bench.x, x_out=work.plain)),
        floor=floor_of(spec),
        base="tendon_sheath_linear" if spec.group == "base_line" else "tendon_sheath_symmetric",
        numbers=numbers,
        effect=spec.effect,
        protocol=spec.protocol,
    )


def truth_of(spec) -> tuple[str, ...]:
    """What a diagnosis should say of a case."""
    if spec.group in ("null", "unexcited") or not spec.effect:
        return ()
    return ("unknown",) if spec.group == "outside" else tuple(spec.effect.split("+"))


class _Work:
    """One batch: its lanes, its plants, and what their bases can absorb."""

    def __init__(self, specs: list[Spec], step: float):
        self.specs = specs
        self.bench: Bench = bench_of(specs, step)
        self.plants = [plant_of(s) for s in specs]
        self.plant = spread(self.bench, self.plants)
        counts = [len(listed) for listed in self.bench.lists]
        parts = [starts_of(s, p, n) for s, p, n in zip(specs, self.plants, counts, strict=True)]
        self.start = np.concatenate(parts)
        self.plain, self.loop = clean_sheath(self.bench, self.plant, self.start)
        self.floors = np.array([floor_of(s) for s in specs])
        self.own_numbers: dict[str, list[dict]] = {}
        self._bases = self._refit = None

    # ---- effects

    def numbers(self, name) -> dict[str, np.ndarray]:
        """Numbers of an effect for each lane."""
        own = self.own_numbers.get(name)
        if own is None:
            own = self.own_numbers[name] = [self._numbers(name, i) for i in range(len(self.specs))]
        return {
            k: [p[k] for p in own] if callable(own[0][k]) else np.array([p[k] for p in own])[self.bench.owner]
            for k in own[0]
        } | self._courses(own)

    def _courses(self, own):
        return dict(course=[own[i]["course"] for i in self.bench.owner]) if "course" in own[0] else {}

    def _numbers(self, name, i):
        spec, bench = self.specs[i], self.bench
        numbers = numbers_of(name, spec, bench.lists[i], bench.start[bench.lanes(i)])
        if spec.group == "unexcited" and name == "dead_zone":
            numbers |= dict(edge=float(1.3 * np.abs(self.plain[:, bench.lanes(i)]).max()), width=1.0)
        if spec.group == "unexcited" and name == "position_ripple":
            numbers |= dict(cycles=1.0 + numbers["cycles"] / 11.0)
        return numbers

    def scaled(self, name) -> np.ndarray:
        """Amplitude of an effect in each case."""
        numbers, owner = self.numbers(name), self.bench.owner
        if self.specs[0].group == "unexcited":
            return self._harmless(name)

        def reached(amplitudes):
            hidden = {name: (amplitudes[owner], numbers)}
            y = hidden_sheath(self.bench, self.plant, self.start, hidden, self.plain)
            return self.excess(y, self.refit_bases if self.specs[0].measure == "refit" else self.bases)

        return amplitudes_for(reached, self.specs, SCALES[name])

    def _harmless(self, name) -> np.ndarray:
        """Strong effects that these motions do not reach."""
        largest, fastest = np.empty(len(self.specs)), np.empty(len(self.specs))
        for i in range(len(self.specs)):
            y = self.plain[:, self.bench.lanes(i)]
            largest[i], fastest[i] = np.abs(y).max(), np.abs(np.diff(y, axis=0)).max() / self.bench.step
        chosen = dict(dead_zone=0.8, saturation=1.0 / (1.8 * largest), rate_limit=1.0 / (2.5 * fastest))
        return chosen.get(name, 1.0) * np.ones(len(self.specs))

    # ---- what the base absorbs

    def excess(self, y, bases) -> np.ndarray:
        """Variance that the base cannot absorb, over the noise's, of each case."""
        d = y - self.plain
        stacked = (self.bench.stacked(d, i) for i in range(len(self.specs)))
        return np.array([left_over(s, b) / f**2 for s, b, f in zip(stacked, bases, self.floors, strict=True)])

    @property
    def bases(self) -> list[np.ndarray]:
        """Spans of (1, x_in, output without effect, its hysteresis part)."""
        if self._bases is None:
            self._bases = [span(self._plain_columns(i)) for i in range(len(self.specs))]
        return self._bases

    def _plain_columns(self, i):
        signals = [self.bench.x] if self.specs[0].group == "base_line" else [self.bench.x, self.plain, self.loop]
        columns = [self.bench.stacked(s, i) for s in signals]
        return np.column_stack([np.ones(len(columns[0])), *columns])

    @property
    def refit_bases(self) -> list[np.ndarray]:
        """The same with the change that each nonlinear number of the base and each start value makes."""
        if self._refit is None and self.specs[0].group == "base_line":
            self._refit = self.bases
        if self._refit is None:
            nudged = [self._nudged(k) for k in ("A", "beta", "gamma", "n")]
            at_start = self._nudged("start")
            self._refit = []
            for i in range(len(self.specs)):
                columns = [self.bench.stacked(s, i) for s in nudged]
                alone = [self._one_lane(at_start, j, i) for j in self.bench.lanes(i)]
                self._refit.append(span(np.column_stack([self._plain_columns(i), *columns, *alone])))
        return self._refit

    def _nudged(self, name):
        plant, start = dict(self.plant), self.start
        if name == "start":
            start = start + NUDGE
        else:
            plant[name] = plant[name] + NUDGE
        z = plant["kappa"] * np.rad2deg(hysteresis(self.bench.x, start, plant))
        return (z - self.loop) / NUDGE

    def _one_lane(self, y, lane, i):
        parts = [y[:: self.bench.every][: self.bench.samples(j), j] * (j == lane) for j in self.bench.lanes(i)]
        return np.concatenate(parts)
