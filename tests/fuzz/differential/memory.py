"""Equations of blocks whose memory changes as a step begins, and of sampled blocks."""

from __future__ import annotations

import math
from itertools import pairwise
from typing import Any

import numpy as np

from tests.fuzz.differential import numbers as n
from tests.fuzz.differential.equations import Equations, Law, law, shaped

# ---- play and its relatives


def _play(u: Any, half_width: float, m: float) -> Any:
    return n.larger(u - half_width, n.smaller(u + half_width, m))


def _tao(b: Any, t: Any, x: Any, u: Any) -> Any:
    return n.larger(b.c1 * (u.u - b.B1), n.smaller(b.c2 * (u.u + b.B2), x.m))


def _capstan(b: Any, t: Any, x: Any, u: Any) -> Any:
    tension, ratio = u.u + b.pretension, n.exp(b.mu * b.angle)
    edges = tension / ratio, tension * ratio
    return n.larger(n.smaller(*edges), n.smaller(n.larger(*edges), x.m + b.pretension)) - b.pretension


def _plays(b: Any, x: Any, u: Any) -> list[Any]:
    return [_play(u.u, r, getattr(x, f"m{k}")) for k, r in enumerate(b.radii, 1)]


def _play_after(k: int) -> Law:
    return lambda b, t, x, u: _plays(b, x, u)[k - 1]


def _play_memory(block: Any) -> dict[str, Law]:
    return {f"m{k}": _play_after(k) for k in range(1, len(block.radii) + 1)}


law(
    "Play",
    lambda b, t, x, u: b.gain * _play(u.u, b.half_width, x.m),
    updates={"m": lambda b, t, x, u: _play(u.u, b.half_width, x.m)},
)
law("CapstanFriction", _capstan, updates={"m": _capstan})
law("TaoBacklash", _tao, updates={"m": _tao})


@shaped("PrandtlIshlinskii")
def _prandtl_ishlinskii(block: Any) -> Equations:
    def y(b: Any, t: Any, x: Any, u: Any) -> Any:
        return b.weight0 * u.u + sum(w * p for w, p in zip(b.weights, _plays(b, x, u), strict=True))

    return Equations({"y": y}, updates=_play_memory(block))


@shaped("NonlocalMemory")
def _nonlocal(block: Any) -> Equations:
    def y(b: Any, t: Any, x: Any, u: Any) -> Any:
        return u.u + sum(w * (p - u.u) for w, p in zip(b.weights, _plays(b, x, u), strict=True))

    return Equations({"y": y}, updates=_play_memory(block))


# ---- rate limits and lags that are solved over a step. "time" is nan before the first step.


def _rate_limit(b: Any, t: Any, x: Any, u: Any) -> Any:
    if math.isnan(x.time):
        return u.u if b.start == "input" else x.last
    since = t - x.time
    return n.smaller(n.larger(u.u, x.last + b.falling * since), x.last + b.rising * since)


def _soft_rate_limit(b: Any, t: Any, x: Any, u: Any) -> Any:
    if math.isnan(x.time):
        return u.u
    y, since, s = x.last - x.behind, t - x.time, b.softness
    if since <= 0:
        return y
    w = (u.u - y - (x.last - y) * math.exp(-since / b.lag)) / since
    return y + since * (w - s * n.softplus((w - b.rising) / s) + s * n.softplus((b.falling - w) / s))


def _lag_behind(b: Any, t: Any, x: Any, u: Any) -> Any:
    """w of ``Lag``: the output less the input."""
    if math.isnan(x.time):
        return x.behind
    if b.time_constant == 0.0:
        return x.behind if t == x.time else 0.0
    s, T, moved = t - x.time, b.time_constant, u.u - x.last
    if s <= 0:  # a is 1 there: the output does not follow a jump at once
        return x.behind - moved
    a = T / s * -math.expm1(-s / T)
    c = (moved - x.slope * s) / (s + x.length) if x.length > 0 else 0.0
    return x.behind * math.exp(-s / T) - moved * a + c * (s * a - 2 * T * (1 - a))


def _mean_rate(b: Any, t: Any, x: Any, u: Any) -> float:
    return 0.0 if math.isnan(x.time) else (u.u - x.last) / (t - x.time)


def _now(b: Any, t: Any, x: Any, u: Any) -> float:
    return t


def _input(b: Any, t: Any, x: Any, u: Any) -> Any:
    return u.u


law(
    "RateLimit",
    _rate_limit,
    updates={"last": _rate_limit, "time": _now},
    start=lambda b: {"last": b.last, "time": math.nan},
    still=False,
)
law(
    "SoftRateLimit",
    _soft_rate_limit,
    updates={"last": _input, "behind": lambda b, t, x, u: u.u - _soft_rate_limit(b, t, x, u), "time": _now},
    start=lambda b: {"last": b.last, "behind": b.behind, "time": math.nan},
    still=False,
)
law(
    "Lag",
    lambda b, t, x, u: u.u + _lag_behind(b, t, x, u),
    updates={
        "time": _now,
        "last": _input,
        "behind": _lag_behind,
        "slope": _mean_rate,
        "length": lambda b, t, x, u: -1.0 if math.isnan(x.time) else t - x.time,
    },
    start=lambda b: {"time": math.nan, "last": 0.0, "behind": b.behind, "slope": 0.0, "length": -1.0},
    still=False,
)

# ---- a mass that sticks


def _slid(v: Any, gain: Any, lost: Any) -> Any:
    """Speed after an even acceleration and dry friction, by where the mass stops."""

    def begun(share: Any) -> Any:
        if abs(n.plain(gain)) <= n.plain(lost):
            return 0.0 * gain
        return share * (gain - n.sign_of(n.plain(gain)) * lost)

    way = n.sign_of(n.plain(v))
    if way == 0.0:
        return begun(1.0)
    end = v + gain - way * lost
    return end if way * n.plain(end) > 0 else begun(1.0 - way * v / (lost - way * gain))


def _sliding_mass(b: Any, t: Any, x: Any, u: Any) -> Any:
    if math.isnan(x.time):
        return x.v

    def lost(v: Any) -> Any:
        return (b.coulomb + b.breakaway * n.exp(-((v / b.stribeck) ** 2))) * (t - x.time) / b.mass

    first = _slid(x.v, x.gained - x.before, lost(x.v))
    return _slid(x.v, x.gained - x.before, lost(0.5 * (n.magnitude(x.v) + n.magnitude(first))))


law(
    "SlidingMass",
    _sliding_mass,
    rates={"gained": lambda b, t, x, u: (u.u - b.viscous * _sliding_mass(b, t, x, u)) / b.mass},
    updates={"v": _sliding_mass, "before": lambda b, t, x, u: x.gained, "time": _now},
    start=lambda b: {"v": b.v, "gained": 0.0, "before": 0.0, "time": math.nan},
    still=False,
)

# ---- switches with memory


def _relay(b: Any, t: Any, x: Any, u: Any) -> float:
    return 1.0 if u.u >= b.on else 0.0 if u.u <= b.off else x.active


def _armed(b: Any, t: Any, x: Any, u: Any) -> float:
    return float(u.trigger > 0.5)


law("Relay", lambda b, t, x, u: b.high if x.active > 0.5 else b.low, updates={"active": _relay})
law(
    "TriggeredHold",
    lambda b, t, x, u: x.held,
    updates={"held": lambda b, t, x, u: u.u if u.trigger > 0.5 and x.armed < 0.5 else x.held, "armed": _armed},
    start=lambda b: {"held": b.initial, "armed": 0.0},
)


@shaped("StateMachine")
def _state_machine(block: Any) -> Equations:
    def taken(b: Any, t: Any, x: Any, u: Any) -> int | None:
        """The number of the mode that follows at this instant, or None."""
        names = {name: getattr(u, name) for name in b.signals} | {"since": t - x.entered}
        for one in b.transitions:
            way, condition = one.split(":")
            source, target = (part.strip() for part in way.split("->"))
            if b.modes.index(source) == int(x.active) and eval(condition, {"abs": abs}, names):
                return int(b.modes.index(target))
        return None

    def mode(b: Any, t: Any, x: Any, u: Any) -> float:
        found = taken(b, t, x, u)
        return x.active if found is None else float(found)

    def entered(b: Any, t: Any, x: Any, u: Any) -> float:
        return x.entered if taken(b, t, x, u) is None else t

    flags = {name: (lambda b, t, x, u, k=k: float(x.active == k)) for k, name in enumerate(block.modes)}
    outputs = {"mode": lambda b, t, x, u: x.active, "since": lambda b, t, x, u: t - x.entered, **flags}
    return Equations(outputs, updates={"active": mode, "entered": entered})


# ---- sampled blocks


def _backward(b: Any, x: Any, u: Any) -> tuple[Any, Any, Any]:
    integral = x.integral + b.ki * b.period * u.e
    derivative = (b.tau * x.derivative + b.kd * (u.e - x.last)) / (b.tau + b.period)
    return integral, derivative, b.kp * u.e + integral + derivative


def _discrete_pid(b: Any, t: Any, x: Any, u: Any) -> Any:
    return n.within(_backward(b, x, u)[2], b.low, b.high)


def _discrete_integral(b: Any, t: Any, x: Any, u: Any) -> Any:
    integral, _, wanted = _backward(b, x, u)
    back = b.kaw * b.period * (n.within(wanted, b.low, b.high) - wanted) if b.ki != 0 else 0.0
    return integral + back


law("ZeroOrderHold", _input)
law("UnitDelay", lambda b, t, x, u: x.last, updates={"last": _input}, start=lambda b: {"last": b.initial})
law(
    "DiscretePID",
    _discrete_pid,
    updates={
        "integral": _discrete_integral,
        "derivative": lambda b, t, x, u: _backward(b, x, u)[1],
        "last": lambda b, t, x, u: u.e,
    },
)


@shaped("DiscreteIntegrator")
def _discrete_integrator(block: Any) -> Equations:
    share = {"forward": 0.0, "backward": 1.0, "trapezoidal": 0.5}[block.method]

    def y(b: Any, t: Any, x: Any, u: Any) -> Any:
        return x.total + share * b.gain * b.period * u.u if share else x.total

    after = {"total": lambda b, t, x, u: x.total + b.gain * b.period * u.u}
    return Equations({"y": y}, updates=after, start=lambda b: {"total": b.initial})


@shaped("MovingAverage")
def _moving_average(block: Any) -> Equations:
    keys = [f"u{k}" for k in range(1, block.length)]

    def y(b: Any, t: Any, x: Any, u: Any) -> Any:
        return (u.u + sum(getattr(x, key) for key in keys)) / b.length

    older = {key: (lambda b, t, x, u, one=one: getattr(x, one)) for one, key in pairwise(keys)}
    first = {keys[0]: _input} if keys else {}
    return Equations({"y": y}, updates={**first, **older}, start=lambda b: dict.fromkeys(keys, b.initial))


@shaped("DiscreteTransferFunction")
def _discrete_transfer_function(block: Any) -> Equations:
    order = len(block.den) - 1
    b_ = [0.0] * (order + 1 - len(block.num)) + list(block.num)
    keys = [f"w{k}" for k in range(1, order + 1)]

    def newest(b: Any, x: Any, u: Any) -> Any:
        past = sum(a * getattr(x, key) for a, key in zip(b.den[1:], keys, strict=True))
        return (u.u - past) / b.den[0]

    def y(b: Any, t: Any, x: Any, u: Any) -> Any:
        late = sum(c * getattr(x, key) for c, key in zip(b_[1:], keys, strict=True))
        return late + b_[0] * newest(b, x, u) if b_[0] else late

    older = {key: (lambda b, t, x, u, one=one: getattr(x, one)) for one, key in pairwise(keys)}
    first = {keys[0]: lambda b, t, x, u: newest(b, x, u)} if keys else {}
    start = dict(zip(keys, block.x0 or [0.0] * order, strict=True))
    return Equations({"y": y}, updates={**first, **older}, start=lambda b: dict(start))


@shaped("DiscreteStateSpace")
def _discrete_state_space(block: Any) -> Equations:
    from tests.fuzz.differential.dynamic import _linear

    direct = block.D if len(block.D) else np.zeros((len(block.C), len(block.B[0])))
    made = _linear(block.A, block.B, block.C, direct, block, block.x0)
    return Equations(made.outputs, updates=made.rates, start=made.start)
