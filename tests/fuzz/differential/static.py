"""Equations of sources and of blocks without memory."""

from __future__ import annotations

import math
from functools import lru_cache
from typing import Any

import numpy as np
from scipy.interpolate import CubicSpline

from tests.fuzz.differential import numbers as n
from tests.fuzz.differential.equations import Equations, law, shaped

TURN = 2 * math.pi

# ---- sources


def _chirp(b: Any, t: Any, x: Any, u: Any) -> Any:
    s = n.smaller(t, b.duration)
    cycles = b.f0 * s + (b.f1 - b.f0) / (2 * b.duration) * s * s + b.f1 * (t - s)
    return b.amplitude * n.sin(TURN * cycles)


def _staircase(b: Any, t: Any, x: Any, u: Any) -> Any:
    k, whole = n.floor(n.plain(t) / b.dwell + 1e-9), b.up + b.down  # t / dwell may be rounded down
    return b.height * (abs((k - b.up) % (2 * whole) - whole) - b.down)


def _triangle(b: Any, t: Any, x: Any, u: Any) -> Any:
    p = b.frequency * t + 0.25
    return b.amplitude * (1 - 4 * n.magnitude(p - n.floor(p) - 0.5))


def _multisine(b: Any, t: Any, x: Any, u: Any) -> Any:
    parts = zip(b.amplitudes, b.frequencies, b.phases, strict=True)
    return sum(a * n.sin(TURN * f * t + phase) for a, f, phase in parts)


law("Constant", lambda b, t, x, u: b.value)
law("Sine", lambda b, t, x, u: b.offset + b.amplitude * n.sin(TURN * b.frequency * t + b.phase), still=False)
law("Ramp", lambda b, t, x, u: b.initial + b.slope * n.larger(t - b.start, 0.0), still=False)
law("Step", lambda b, t, x, u: b.before if n.plain(t) < b.time else b.after)
law("Chirp", _chirp, still=False)
law("Staircase", _staircase)
law("Triangle", _triangle, still=False)
law("MultiSine", _multisine, still=False)


@shaped("Recorded")
def _recorded(block: Any) -> Equations:
    times, values = np.array(block.times), np.array(block.values)

    def signal(t: float) -> float:
        if block.hold == "zero":
            return float(values[np.searchsorted(times, t, side="right") - 1])
        return float(CubicSpline(times, values)(t) if block.hold == "cubic" else np.interp(t, times, values))

    return Equations({"y": lambda b, t, x, u: b.offset + b.gain * signal(n.plain(t))}, still=block.hold == "zero")


# ---- arithmetic


def _sum(block: Any) -> Equations:
    names = dict(zip(block.inports, block.signs, strict=True))
    return Equations(
        {"y": lambda b, t, x, u: sum(getattr(u, k) * (1.0 if s == "+" else -1.0) for k, s in names.items())}
    )


def _all_inputs(b: Any, u: Any) -> list[Any]:
    return [getattr(u, name) for name in b.inports]


def _product(b: Any, t: Any, x: Any, u: Any) -> Any:
    return math.prod(_all_inputs(b, u))


def _largest(b: Any, t: Any, x: Any, u: Any) -> Any:
    first, *others = _all_inputs(b, u)
    for one in others:
        first = n.larger(first, one)
    return first


def _smallest(b: Any, t: Any, x: Any, u: Any) -> Any:
    first, *others = _all_inputs(b, u)
    for one in others:
        first = n.smaller(first, one)
    return first


def _compared(b: Any, t: Any, x: Any, u: Any) -> float:
    v, c = n.plain(u.u), b.level
    return float({">": v > c, ">=": v >= c, "<": v < c, "<=": v <= c}[b.sign])


def _logic(b: Any, t: Any, x: Any, u: Any) -> float:
    true = [n.plain(v) > 0.5 for v in _all_inputs(b, u)]
    plain = {"and": all(true), "or": any(true), "xor": sum(true) % 2 == 1}
    turned = {"nand": not plain["and"], "nor": not plain["or"], "not": not true[0]}
    return float({**plain, **turned}[b.operation])


def _switch(b: Any, t: Any, x: Any, u: Any) -> Any:
    both = u.u1, u.u2  # both are read, whichever passes
    return both[0] if n.plain(u.control) >= b.threshold else both[1]


def _encoder(b: Any, t: Any, x: Any, u: Any) -> float:
    q = TURN / b.counts
    return q * n.floor(u.u / q + (0.5 if b.rounding == "nearest" else 0.0))


shaped("Sum")(_sum)
law("Abs", lambda b, t, x, u: n.magnitude(u.u))
law("Bias", lambda b, t, x, u: u.u + b.bias)
law("GainError", lambda b, t, x, u: u.u * (1 + b.error))
law("Gain", lambda b, t, x, u: b.gain * u.u)
law("Product", _product)
law("Divide", lambda b, t, x, u: u.num / u.den)
law("Square", lambda b, t, x, u: u.u * u.u)
law("Power", lambda b, t, x, u: b.gain * u.u * (u.u * u.u + b.smoothing**2) ** ((b.exponent - 1) / 2))
law("Sign", lambda b, t, x, u: n.sgn(u.u))
law("Tanh", lambda b, t, x, u: n.tanh(u.u))
law("Sin", lambda b, t, x, u: n.sin(u.u))
law("Cos", lambda b, t, x, u: n.cos(u.u))
law("Maximum", _largest)
law("Minimum", _smallest)
law("Comparison", _compared)
law("Logic", _logic)
law("Switch", _switch)
law("Convert", lambda b, t, x, u: 180 / math.pi * u.u)  # from rad to deg, its default
law("Encoder", _encoder)
law("Quantiser", lambda b, t, x, u: b.interval * n.floor(u.u / b.interval + 0.5))

# ---- limits and maps


def _soft_dead_zone(b: Any, t: Any, x: Any, u: Any) -> Any:
    s, w, c = b.softness, b.half_width, b.centre
    return c + s * n.softplus((u.u - c - w) / s) - s * n.softplus((c - u.u - w) / s)


def _soft_saturation(b: Any, t: Any, x: Any, u: Any) -> Any:
    s = b.softness
    return u.u - s * n.softplus((u.u - b.high) / s) + s * n.softplus((b.low - u.u) / s)


def _slack(b: Any, t: Any, x: Any, u: Any) -> Any:
    beyond = n.smaller(u.u - b.edge, 0.0) if b.side == "low" else n.larger(u.u - b.edge, 0.0)
    return u.u - b.share * beyond


def _bend(b: Any, t: Any, x: Any, u: Any) -> Any:
    e = u.u - b.centre
    return u.u + b.quadratic * e**2 + b.cubic * e**3 + b.quartic * e**4 + b.quintic * e**5


def _ripple(b: Any, t: Any, x: Any, u: Any) -> Any:
    a = b.cycles * u.u
    return u.u + b.cosine * n.cos(a) + b.sine * n.sin(a) + b.cosine2 * n.cos(2 * a) + b.sine2 * n.sin(2 * a)


def _stop(b: Any, p: Any, rate: Any) -> Any:
    compressed = n.larger(p, 0.0)
    return n.larger(b.stiffness * compressed + b.damping * compressed / (compressed + b.transition) * rate, 0.0)


law("EndStops", lambda b, t, x, u: _stop(b, u.x - b.high, u.v) - _stop(b, b.low - u.x, -u.v))
law("Saturation", lambda b, t, x, u: n.within(u.u, b.low, b.high))
law("DeadZone", lambda b, t, x, u: n.larger(u.u - b.high, 0.0) + n.smaller(u.u - b.low, 0.0))
law("SoftSaturation", _soft_saturation)
law("SoftDeadZone", _soft_dead_zone)
law("Slack", _slack)
law("AsymmetricGain", lambda b, t, x, u: u.u + b.difference / 2 * n.magnitude(u.u))
law("Bend", _bend)
law("Bow", lambda b, t, x, u: u.u + b.size * n.tanh((u.u - b.centre) / b.width))
law("Ripple", _ripple)


@lru_cache(maxsize=256)
def _spline(points: tuple[float, ...], values: tuple[float, ...]) -> Any:
    return CubicSpline(points, values, bc_type="not-a-knot")


def _between(points: tuple[float, ...], values: tuple[float, ...], at: float, block: Any) -> float:
    """Interpolation along one axis: lines or the spline; beyond the points the end value, or its tangent."""
    inside = min(max(at, points[0]), points[-1])
    beyond = at - inside if block.outside == "extend" else 0.0
    if block.interpolation == "cubic":
        curve = _spline(points, values)
        return float(curve(inside) + curve(inside, 1) * beyond)
    k = min(max(int(np.searchsorted(points, inside, side="right")) - 1, 0), len(points) - 2)
    slope = (values[k + 1] - values[k]) / (points[k + 1] - points[k])
    return values[k] + slope * (inside - points[k] + beyond)


def _table2(b: Any, t: Any, x: Any, u: Any) -> float:
    column = tuple(_between(b.points2, row, n.plain(u.u2), b) for row in b.values)
    return _between(b.points1, column, n.plain(u.u1), b)


law("LookupTable", lambda b, t, x, u: _between(b.points, b.values, n.plain(u.u), b))
law("LookupTable2D", _table2)

# ---- friction without memory


def _asymmetric_friction(b: Any, t: Any, x: Any, u: Any) -> Any:
    s = n.tanh(u.v / b.smoothing)
    forwards = (1 + s) / 2 * (b.level_positive * s + b.viscous_positive * u.v)
    return forwards + (1 - s) / 2 * (b.level_negative * s + b.viscous_negative * u.v)


def _stribeck(b: Any, t: Any, x: Any, u: Any) -> Any:
    dry = b.coulomb + (b.static - b.coulomb) * n.exp(-((u.v / b.stribeck) ** 2))
    return dry * n.tanh(u.v / b.smoothing) + b.viscous * u.v


law("CoulombFriction", lambda b, t, x, u: b.level * n.tanh(u.v / b.smoothing))
law("AsymmetricFriction", _asymmetric_friction)
law("StribeckFriction", _stribeck)
law("ViscousFriction", lambda b, t, x, u: b.coefficient * u.v)
law("QuadraticDrag", lambda b, t, x, u: b.coefficient * n.magnitude(u.v) * u.v)

# ---- effects of time


def risen(b: Any, t: Any) -> Any:
    """The rounded step H(t) of the effects that come at one instant."""
    return 0.5 * (1 + n.tanh((t - b.time) / b.width))


def _ended(b: Any, t: Any) -> Any:
    """The same of the instant at which an effect ends."""
    return 0.5 * (1 + n.tanh((t - b.until) / b.width))


def _settled(b: Any, t: Any) -> Any:
    return 1 - n.exp(-n.larger(t - b.since, 0.0) / b.time_constant)


def _disturbance(b: Any, t: Any, x: Any, u: Any) -> Any:
    phase = TURN * b.frequency * (t - b.since)
    return u.u + b.cosine * n.cos(phase) + b.sine * n.sin(phase)


law("Disturbance", _disturbance, still=False)
law("Drift", lambda b, t, x, u: u.u + b.rate * (t - b.since) + b.curve * (t - b.since) ** 2, still=False)
law("GainDrift", lambda b, t, x, u: u.u * (1 + b.rate * (t - b.since)), still=False)
law("GainChange", lambda b, t, x, u: u.u * (1 + b.change * risen(b, t)), still=False)
law("Jump", lambda b, t, x, u: u.u + b.size * risen(b, t), still=False)
law("SettlingOffset", lambda b, t, x, u: u.u + b.size * _settled(b, t), still=False)
law("SettlingGain", lambda b, t, x, u: u.u * (1 + b.change * _settled(b, t)), still=False)
law("TemporaryOffset", lambda b, t, x, u: u.u + b.size * (risen(b, t) - _ended(b, t)), still=False)
law("TemporaryGain", lambda b, t, x, u: u.u * (1 + b.change * (risen(b, t) - _ended(b, t))), still=False)
law("Derivative", lambda b, t, x, u: u.rate)
law("SmoothSlope", lambda b, t, x, u: slope(b, u.v))


def slope(b: Any, v: Any) -> Any:
    """alpha_x(v) of the paper, (a1 e^2v + a2) / (e^2v + 1), in a form that cannot overflow."""
    above = n.plain(v) > 0
    e = n.exp(-2 * v if above else 2 * v)
    return (b.alpha1 + b.alpha2 * e) / (1 + e) if above else (b.alpha1 * e + b.alpha2) / (e + 1)


def _rate_dependence(b: Any, t: Any, x: Any, u: Any) -> Any:
    return u.u + b.coefficient * u.v * (u.v**2 + b.smoothing**2) ** ((b.exponent - 1) / 2)


law("RateDependence", _rate_dependence)
