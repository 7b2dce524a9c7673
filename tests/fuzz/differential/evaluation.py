"""The reference: a flat diagram evaluated by numbers, signal by signal, and stepped by its own methods.

A signal is computed when it is read. One that is read while it is being computed closes an algebraic loop, which is
solved by Newton's method with differences, from several starts: a loop with more than one solution is no test.
"""

from __future__ import annotations

import math
from collections.abc import Callable, Mapping
from typing import Any

import attrs
import numpy as np

from tests.fuzz.differential import dynamic, memory, static  # noqa: F401 - they enter their equations in the table
from tests.fuzz.differential.equations import LAWS
from tests.fuzz.differential.numbers import Dual, plain

Signal = tuple[str, str]
"""Block and port; an input of the diagram has an empty block."""
NOT_YET = 1e-6
"""Share of a step by which the last stage of a step is before its end, for what jumps with time."""
NEWTON = 60
"""Iterations of Newton's method at most. Chosen: with damping far more than it takes."""
STARTS = (0.0, 1.0, -3.0)
"""Where the search for a loop's solution begins at the first instant. Chosen."""
CONVERGED = 1e-13
"""Share by which a loop's equation may be missed."""
JUMPING = ("Step", "Staircase", "Recorded")
"""Sources that jump with time."""


class NoTest(Exception):
    """The diagram has no unique meaning here, or one that the reference does not form: nothing is compared."""


class Torn(Exception):
    """A signal that is read while it is being computed."""

    def __init__(self, node: Any) -> None:
        self.node = node


@attrs.frozen(eq=False)
class Flat:
    """Blocks on one level, and what drives each of their inputs."""

    blocks: Mapping[str, Any]
    driver: Mapping[Signal, Signal]
    inputs: tuple[str, ...] = ()


class Reading:
    """Names that are looked up by a function when they are read."""

    def __init__(self, look: Callable[[str], Any]) -> None:
        self.__dict__["_look"] = look

    def __getattr__(self, name: str) -> Any:
        return self._look(name)


class Reference:
    """One run of the reference: states ``x`` and memory ``d`` by (block, name), and the past of delayed signals."""

    def __init__(self, flat: Flat, h: float, inputs: Mapping[str, Any], noise: float = 0.0, seed: int = 0) -> None:
        self.flat, self.h, self.inputs = flat, h, inputs
        self.laws = {name: LAWS[type(b).__name__](b) for name, b in flat.blocks.items() if not _late(b)}
        self.x, self.d, self.held = {}, {}, dict[Signal, float]()
        for name, one in self.laws.items():
            for key, value in one.start(flat.blocks[name]).items():
                (self.x if key in one.rates else self.d)[name, key] = value
        self.tears: list[Any] = []
        self.solution: dict[Any, float] = {}
        self.past: dict[str, list[float]] = {name: [] for name, b in flat.blocks.items() if _late(b)}
        self.random = np.random.default_rng(seed)
        self.noise = noise
        self.still = {name: _stands_still(self, name) for name in self.past}

    def run(
        self, steps: int, rows: tuple[tuple[float, ...], ...], weights: tuple[float, ...]
    ) -> dict[Signal, np.ndarray]:
        """All outputs of blocks at the instants of a run by an explicit method."""
        logged: dict[Signal, list[float]] = {}
        for k in range(steps + 1):
            t = k * self.h
            self.sample(t, k)
            here = Instant(self, t, k, 0.0, self.x)
            for name, block in self.flat.blocks.items():
                for port in block.outports:
                    logged.setdefault((name, port), []).append(plain(here.signal((name, port))))
            if k < steps:
                self.advance(t, k, here, rows, weights)
        return {key: np.array(values) for key, values in logged.items()}

    def sample(self, t: float, k: int) -> None:
        """Change memory, held outputs and states that are reset, all from what was before."""
        here, d, x, held = Instant(self, t, k, 0.0, self.x, sampling=True), dict(self.d), dict(self.x), dict(self.held)
        for name, one in self.laws.items():
            block = self.flat.blocks[name]
            if block.sampled and not self.acts(block, k):
                continue
            for key, law in one.updates.items():
                (x if key in one.rates else d)[name, key] = plain(here.called(name, law))
            if block.sampled:
                held |= {(name, port): plain(here.signal((name, port))) for port in block.outports}
        self.x, self.d, self.held = x, d, held

    def acts(self, block: Any, k: int) -> bool:
        """Whether a sampled block is sampled at the beginning of a step."""
        return k % round(block.period / self.h) == 0

    def advance(self, t: float, k: int, here: Instant, rows: Any, weights: Any) -> None:
        """One step; what is delayed is kept before the stages read it."""
        for name, past in self.past.items():
            past.append(plain(here.signal(self.flat.driver[name, "u"])))
        slopes = [here.rates()]
        for row in rows[1:]:
            offset = sum(row)
            ahead = {
                key: v + self.h * sum(a * s[key] for a, s in zip(row, slopes, strict=False))
                for key, v in self.x.items()
            }
            slopes.append(Instant(self, t + offset * self.h, k, offset, ahead).rates())
        self.x = {
            key: v + self.h * sum(w * s[key] for w, s in zip(weights, slopes, strict=True)) for key, v in self.x.items()
        }


def _late(block: Any) -> bool:
    return type(block).__name__ in ("Delay", "DeadTime")


def _stands_still(model: Reference, name: str) -> str:
    """Whether what drives a delay stands still within steps: "" where it does not, by "samples" or by an "input"."""
    flat, seen, left, why = model.flat, set[Signal](), [model.flat.driver[name, "u"]], "samples"
    while left:
        signal = left.pop()
        block = flat.blocks.get(signal[0])
        if signal in seen or (block is not None and block.sampled):
            continue
        seen.add(signal)
        if block is None and model.inputs[signal[1]].hold == "zero":
            why = "input"
            continue
        if block is None or type(block).__name__ == "Recorded":  # samples may lie within steps
            return ""
        if _late(block):
            left.append(flat.driver[signal[0], "u"])
            continue
        one, read = model.laws[signal[0]], set[str]()
        one.outputs[signal[1]](
            block, 0.5, Reading(lambda k, r=read: r.add("x." + k) or 0.3), Reading(lambda k, r=read: r.add(k) or 0.7)
        )
        if (
            not one.still
            or any(f"x.{key}" in read for key in one.rates)
            or any((signal[0], k) not in flat.driver for k in read if k[:2] != "x.")
        ):
            return ""
        left += [flat.driver[signal[0], k] for k in read if k[:2] != "x."]
    return why


class Instant:
    """All signals at one instant, computed when they are read; ``offset`` is where in its step ``k`` it lies."""

    def __init__(
        self, model: Reference, t: float, k: int, offset: float, x: Mapping[Signal, float], *, sampling: bool = False
    ) -> None:
        self.model, self.t, self.k, self.offset, self.x, self.sampling = model, t, k, offset, x, sampling
        self.known: dict[Any, Any] = {}
        self.active: set[Any] = set()
        self.solved = False

    # ---- reading

    def signal(self, signal: Signal) -> float:
        """A signal; loops are solved on the way."""
        return float(self._solved(("y", *signal)))

    def called(self, name: str, law: Any) -> Any:
        """A law of a block, with states and inputs that are read when it needs them."""
        block = self.model.flat.blocks[name]
        return self._retried(lambda: law(block, self._time(block), self._states(name), self._inputs(name)))

    def rates(self) -> dict[Signal, float]:
        """Rates of all continuous states."""
        return {key: float(self._solved(("dx", *key))) for key in self.model.x}

    def _solved(self, node: Any) -> Any:
        return self._retried(lambda: self._value(node))

    def _retried(self, read: Callable[[], Any]) -> Any:
        """What is read, after all loops that are met have been torn and solved."""
        while True:
            try:
                if self.model.tears and not self.solved:
                    self._solve()
                return read()
            except Torn as torn:
                self.model.tears.append(torn.node)
                self.model.solution.clear()
                self.active.clear()
                self.known.clear()
                self.solved = False

    def _time(self, block: Any) -> float:
        late = self.offset == 1.0 and type(block).__name__ in JUMPING and LAWS[type(block).__name__](block).still
        return self.t - NOT_YET * self.model.h if late else self.t

    # ---- values of nodes

    def _value(self, node: Any) -> Any:
        if node in self.known:
            return self.known[node]
        if node in self.active:
            raise Torn(node)
        self.active.add(node)
        self.known[node] = value = self._computed(node)
        self.active.discard(node)
        return value

    def _computed(self, node: Any) -> Any:
        kind, name, port = node
        model = self.model
        if kind == "rate":
            return self._dual((name, port)).rate
        if not name:
            return model.inputs[port].at(self.k, self.offset)
        block = model.flat.blocks[name]
        if name in model.past:
            return self._delayed(name, block)
        if kind == "y" and block.sampled and not (self.sampling and model.acts(block, self.k)):
            return model.held[name, port]
        one = model.laws[name]
        law = one.outputs[port] if kind == "y" else one.rates[port]
        value = law(block, self._time(block), self._states(name), self._inputs(name))
        return value * (1.0 + model.noise * model.random.uniform(-1, 1)) if model.noise else value

    def _states(self, name: str) -> Reading:
        return Reading(lambda key: self.x[name, key] if (name, key) in self.x else self.model.d[name, key])

    def _inputs(self, name: str) -> Reading:
        return Reading(lambda port: self._value(self._source(name, port)))

    def _source(self, name: str, port: str) -> Any:
        """What an input reads: its driver, or the rate of the port that it is the rate of."""
        driver = self.model.flat.driver
        if (name, port) in driver:
            return ("y", *driver[name, port])
        return ("rate", *driver[name, self.model.flat.blocks[name].inports[port].rate_of])

    # ---- rates, by the chain rule

    def _dual(self, signal: Signal) -> Dual:
        """A signal with its rate in time."""
        name, port = signal
        if ("y", *signal) in self.model.tears:
            raise NoTest("the rate of a signal in an algebraic loop")
        if not name:
            one = self.model.inputs[port]
            return Dual(one.at(self.k, self.offset), one.rate(self.k, self.offset))
        block = self.model.flat.blocks[name]
        if name in self.model.past or block.sampled or any(p.rate_of for p in block.inports.values()):
            raise NoTest("a rate that the reference does not form")

        def state(key: str) -> Any:
            if (name, key) in self.x:
                return Dual(self.x[name, key], float(plain(self._value(("dx", name, key)))))
            return self.model.d[name, key]

        inputs = Reading(lambda port: self._dual(self._source(name, port)[1:]))
        value = self.model.laws[name].outputs[port](block, Dual(self._time(block), 1.0), Reading(state), inputs)
        return value if isinstance(value, Dual) else Dual(value, 0.0)

    # ---- the past

    def _delayed(self, name: str, block: Any) -> float:
        """The driver of a delay, T ago, on the polynomial through the four instants about it."""
        past, h, T = self.model.past[name], self.model.h, block.time
        now = type(block).__name__ == "DeadTime"
        here = float(plain(self._value(("y", *self.model.flat.driver[name, "u"])))) if now else 0.0
        wanted = self.k + self.offset - T / h  # in steps
        nearest = round(wanted)
        wanted = float(nearest) if abs(wanted - nearest) < 1e-9 else wanted
        first = (past[0] if past else here) if now and block.start == "first" else block.initial
        if self.model.still[name] and (now or self.model.still[name] == "input"):
            return _mean_over_step([*past[: self.k], here if now else math.nan], first, self.k - T / h)
        if wanted < 0 or (self.offset == 1.0 and abs(wanted) < 1e-9):  # the end of a step is just before a jump
            return first
        if self.model.still[name]:
            return past[min(math.floor(wanted), len(past) - 1)] if past else first
        if now and wanted > len(past) - 1:
            points = [*range(max(len(past) - 3, 0), len(past))]
            return _through([*points, self.k + self.offset], [*(past[i] for i in points), here], wanted)
        newest = min(max(math.floor(wanted) + 2, 3), len(past) - 1)
        points = list(range(max(newest - 3, 0), newest + 1))
        return _through(points, [past[i] for i in points], wanted) if past else first

    # ---- algebraic loops

    def _solve(self) -> None:
        model, tears = self.model, list(self.model.tears)
        key = (self.sampling, *tears)

        def missed(z: np.ndarray) -> np.ndarray:
            self.known = dict(zip(tears, map(float, z), strict=True))
            out = []
            for node in tears:
                self.active = {node}
                out.append(float(plain(self._computed(node))))
            self.active = set()
            return np.array(out) - z

        quiet, model.noise = model.noise, 0.0
        if key in model.solution:
            z = _newton(missed, model.solution[key])
        else:
            found = [_newton(missed, np.full(len(tears), s)) for s in STARTS]
            if max(np.abs(one - found[0]).max() for one in found) > 1e-9 * (1 + np.abs(found[0]).max()):
                raise NoTest("an algebraic loop with several solutions")
            z = found[0]
        model.solution[key], model.noise = z, quiet
        missed(z)  # what is read from now on is what this solution gives
        self.solved = True


def _mean_over_step(levels: list[float], before: float, begin: float) -> float:
    """The mean of a staircase over a step that begins at ``begin`` [steps]; it is ``before`` up to 0."""
    steps = [math.floor(begin + 1e-9), math.floor(begin + 1e-9) + 1]
    share = max(begin - steps[0], 0.0)  # of the step, what lies on the second level
    first, second = (levels[k] if k >= 0 else before for k in (steps[0], min(steps[1], len(levels) - 1)))
    return first if share < 1e-9 else (1 - share) * first + share * second


def _newton(missed: Callable[[np.ndarray], np.ndarray], z: np.ndarray) -> np.ndarray:
    """The root of a function, by Newton's method with differences and halved steps."""
    r = missed(z)
    for _ in range(NEWTON):
        if not np.isfinite(r).all():
            raise NoTest("an algebraic loop that is not finite")
        if np.abs(r).max() <= CONVERGED * (1 + np.abs(z).max()):
            return z
        size = 1e-6 * (1 + np.abs(z))
        columns = [(missed(z + e * s) - missed(z - e * s)) / (2 * s) for e, s in zip(np.eye(len(z)), size, strict=True)]
        try:
            change = np.linalg.solve(np.column_stack(columns), -r)
        except np.linalg.LinAlgError:
            raise NoTest("a singular algebraic loop") from None
        share = 1.0
        while share > 1e-6:
            ahead = missed(z + share * change)
            if np.abs(ahead).max() < np.abs(r).max():
                break
            share /= 2
        else:
            if np.abs(r).max() <= 1e-10 * (1 + np.abs(z).max()):
                return z
            raise NoTest("an algebraic loop that Newton's method does not solve")
        z, r = z + share * change, ahead
    raise NoTest("an algebraic loop that takes too many iterations")


def _through(points: list[float], values: list[float], at: float) -> float:
    """The polynomial through points, by Lagrange's formula."""
    if len(points) > 1 and points[-1] - points[-2] < 1e-9:  # now is the newest stored instant
        points, values = points[:-1], values[:-1]
    total = 0.0
    for i, value in enumerate(values):
        total += value * math.prod((at - q) / (points[i] - q) for j, q in enumerate(points) if j != i)
    return total


@attrs.frozen(eq=False)
class SampledSignal:
    """An input given by its values on the steps, with the interpolation between them."""

    values: np.ndarray
    hold: str
    h: float
    curve: Any = None

    @classmethod
    def of(cls, values: np.ndarray, hold: str, h: float) -> SampledSignal:
        """An input; a cubic is SciPy's."""
        from scipy.interpolate import CubicSpline

        return cls(values, hold, h, CubicSpline(h * np.arange(len(values)), values) if hold == "cubic" else None)

    def at(self, k: int, offset: float) -> float:
        """The value within step k."""
        v = self.values
        if self.hold == "cubic":
            return float(self.curve((k + offset) * self.h))
        return float(v[k] if self.hold == "zero" or offset == 0 else v[k] + offset * (v[k + 1] - v[k]))

    def rate(self, k: int, offset: float) -> float:
        """The rate within step k."""
        if self.hold == "cubic":
            return float(self.curve((k + offset) * self.h, 1))
        if self.hold == "zero":
            raise NoTest("the rate of a signal that is held")
        k = min(k, len(self.values) - 2)
        return float((self.values[k + 1] - self.values[k]) / self.h)
