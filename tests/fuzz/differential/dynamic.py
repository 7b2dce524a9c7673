"""Equations of blocks with continuous states."""

from __future__ import annotations

from typing import Any

import numpy as np
from scipy import signal

from tests.fuzz.differential import numbers as n
from tests.fuzz.differential.equations import Equations, law, shaped
from tests.fuzz.differential.static import risen, slope

# ---- lags, integrators, oscillators

law(
    "FirstOrderLag",
    lambda b, t, x, u: x.value,
    rates={"value": lambda b, t, x, u: (b.gain * u.u - x.value) / b.time_constant},
)
law(
    "HeatedGain",
    lambda b, t, x, u: u.u * (1 + b.change * x.heat),
    rates={"heat": lambda b, t, x, u: ((u.u / b.scale) ** 2 - x.heat) / b.time_constant},
)
law(
    "SecondOrderLag",
    lambda b, t, x, u: x.value,
    rates={
        "value": lambda b, t, x, u: x.rate,
        "rate": lambda b, t, x, u: b.omega**2 * (b.gain * u.u - x.value) - 2 * b.zeta * b.omega * x.rate,
    },
)
law(
    "FilteredDerivative",
    lambda b, t, x, u: (u.u - x.smooth) / b.time_constant,
    rates={"smooth": lambda b, t, x, u: (u.u - x.smooth) / b.time_constant},
)
law(
    "LeadLag",
    lambda b, t, x, u: b.gain * (x.smooth + b.lead * (u.u - x.smooth) / b.lag),
    rates={"smooth": lambda b, t, x, u: (u.u - x.smooth) / b.lag},
)
law(
    "Creep",
    lambda b, t, x, u: u.u + b.share * x.late,
    rates={"late": lambda b, t, x, u: (u.u - x.late) / b.time_constant},
)


def _creeping(k: int) -> Any:
    def rate(b: Any, t: Any, x: Any, u: Any) -> Any:
        time = b.fastest * (b.slowest / b.fastest) ** ((k - 1) / 3)
        return (u.u - getattr(x, f"late{k}")) / time

    return rate


law(
    "BroadCreep",
    lambda b, t, x, u: u.u + b.share / 4 * (x.late1 + x.late2 + x.late3 + x.late4),
    rates={f"late{k}": _creeping(k) for k in (1, 2, 3, 4)},
)


def _swinging(b: Any, t: Any, x: Any, u: Any) -> Any:
    """z' of ``Resonance``, whose state is z' less what the base damps."""
    return x.rate + 2 * b.zeta * b.omega * b.feed * (u.u - x.swing)


law(
    "Resonance",
    lambda b, t, x, u: u.u + b.share * (x.swing - u.u),
    rates={
        "swing": _swinging,
        "rate": lambda b, t, x, u: (
            b.omega**2 * (u.u - x.swing) - 2 * b.zeta * b.omega * (1 - b.feed) * _swinging(b, t, x, u)
        ),
    },
)
law(
    "ParallelResonance",
    lambda b, t, x, u: u.u + b.gain * x.swing + b.rate_gain * x.rate / b.omega,
    rates={
        "swing": lambda b, t, x, u: x.rate,
        "rate": lambda b, t, x, u: b.omega**2 * (u.x - x.swing) - 2 * b.zeta * b.omega * x.rate,
    },
)
law(
    "MotorTransferFunction",
    outputs={"y": lambda b, t, x, u: x.angle, "v": lambda b, t, x, u: x.speed},
    rates={"angle": lambda b, t, x, u: x.speed, "speed": lambda b, t, x, u: (b.K * u.u - x.speed) / b.tau},
)


@shaped("DCMotor")
def _dc_motor(block: Any) -> Equations:
    def current(b: Any, t: Any, x: Any, u: Any) -> Any:
        drop = b.voltage_drop * n.tanh(x.current / b.drop_current)
        return (u.u - b.R * x.current - b.kt * x.speed - drop) / b.L

    def speed(b: Any, t: Any, x: Any, u: Any) -> Any:
        load = getattr(u, next(k for k in b.inports if k != "u")) / b.gear if b.load else 0.0
        return (b.kt * x.current - b.b * x.speed - b.coulomb * n.tanh(x.speed / b.smoothing) - load) / b.J

    def output_speed(b: Any, t: Any, x: Any, u: Any) -> Any:
        return x.speed / b.gear

    outputs = {"y": lambda b, t, x, u: x.angle, "v": output_speed, "i": lambda b, t, x, u: x.current}
    return Equations(outputs, {"current": current, "speed": speed, "angle": output_speed})


@shaped("Integrator")
def _integrator(block: Any) -> Equations:
    def rate(b: Any, t: Any, x: Any, u: Any) -> Any:
        wanted = b.gain * u.u
        if b.enable and n.plain(u.enable) <= 0.5:
            return 0.0
        past = (x.integral >= b.high and wanted > 0) or (x.integral <= b.low and wanted < 0)
        return 0.0 if past else wanted

    def after_reset(b: Any, t: Any, x: Any, u: Any) -> Any:
        if n.plain(u.reset) > 0.5:
            return u.to if b.target else b.integral
        return x.integral

    updates = {"integral": after_reset} if block.reset else {}
    return Equations({"y": lambda b, t, x, u: n.within(x.integral, b.low, b.high)}, {"integral": rate}, updates)


# ---- linear systems


def _linear(A: Any, B: Any, C: Any, D: Any, block: Any, x0: Any = ()) -> Equations:
    """x' = A x + B u, y = C x + D u, with ports in order."""
    A, B, C, D = (np.atleast_2d(np.asarray(m, dtype=float)) for m in (A, B, C, D))
    order, names = A.shape[0] if A.size else 0, list(block.inports)
    keys = [f"x{k}" for k in range(order)]

    def row(matrices: Any, k: int, direct: bool) -> Any:
        left, right = matrices[0][k] if order else (), matrices[1][k]
        read = [j for j in range(len(names)) if direct and right[j] != 0.0]

        def value(b: Any, t: Any, x: Any, u: Any) -> Any:
            own = sum(float(c) * getattr(x, key) for c, key in zip(left, keys, strict=True) if c)
            return own + sum(float(right[j]) * getattr(u, names[j]) for j in read)

        return value

    outputs = {port: row((C, D), k, True) for k, port in enumerate(block.outports)}
    start = dict(zip(keys, map(float, x0 if len(x0) else [0.0] * order), strict=True))
    rates = {key: row((A, B), k, True) for k, key in enumerate(keys)}
    return Equations(outputs, rates, start=lambda b: dict(start))


@shaped("TransferFunction")
def _transfer_function(block: Any) -> Equations:
    return _linear(*signal.tf2ss(block.num, block.den), block)


@shaped("ZeroPoleGain")
def _zero_pole_gain(block: Any) -> Equations:
    zeros, poles = (
        [*real, *(complex(re, s * im) for re, im in pairs for s in (1, -1))]
        for real, pairs in ((block.zeros, block.zero_pairs), (block.poles, block.pole_pairs))
    )
    num, den = block.gain * np.atleast_1d(np.poly(zeros)).real, np.atleast_1d(np.poly(poles)).real
    return _linear(*signal.tf2ss(num, den), block)


@shaped("StateSpace")
def _state_space(block: Any) -> Equations:
    direct = block.D if len(block.D) else np.zeros((len(block.C), len(block.B[0])))
    return _linear(block.A, block.B, block.C, direct, block, block.x0)


# ---- control


def _pid(b: Any, t: Any, x: Any, u: Any) -> Any:
    return b.kp * u.e + b.ki * x.integral + b.kd * (u.e - x.smooth) / b.tau


law("PID", _pid, rates={"integral": lambda b, t, x, u: u.e, "smooth": lambda b, t, x, u: (u.e - x.smooth) / b.tau})


def _wanted(b: Any, t: Any, x: Any, u: Any) -> Any:
    derivative = (b.c * u.r - u.ym - x.smooth) / b.tau
    return b.kp * (b.b * u.r - u.ym) + x.integral + b.kd * derivative


def _limited(b: Any, t: Any, x: Any, u: Any) -> Any:
    return n.within(_wanted(b, t, x, u), b.low, b.high)


def _integral(b: Any, t: Any, x: Any, u: Any) -> Any:
    if b.ki == 0:
        return 0.0
    return b.ki * (u.r - u.ym) + b.kaw * (_limited(b, t, x, u) - _wanted(b, t, x, u))


law(
    "PIDController",
    outputs={"u": _limited},
    rates={"integral": _integral, "smooth": lambda b, t, x, u: (b.c * u.r - u.ym - x.smooth) / b.tau},
)

# ---- hysteresis and friction with a state


def _zeta_of_the_paper(b: Any, t: Any, x: Any, u: Any) -> Any:
    return b.A * u.v - b.theta * abs(u.v) * x.zeta + b.delta * abs(u.v)


def _bouc_wen(b: Any, t: Any, x: Any, u: Any) -> Any:
    size = abs(x.zeta)
    shrinking = b.beta * abs(u.v) * size ** (b.n - 1) * x.zeta
    return b.A * u.v - shrinking - b.gamma * u.v * size**b.n


def _generalized(b: Any, t: Any, x: Any, u: Any) -> Any:
    v, z, place = n.sgn(u.v), n.sgn(x.zeta), n.sgn(u.x)
    shape = b.beta1 * v * z + b.beta2 * v * place + b.beta3 * place * z + b.beta4 * v + b.beta5 * z + b.beta6 * place
    return u.v * (b.A - abs(x.zeta) ** b.n * shape)


def _elastic(b: Any, t: Any, x: Any, u: Any) -> Any:
    y = b.alpha_x * (u.x - x.zeta)
    grown = 1 + b.growth_up * max(y, 0.0) + b.growth_down * max(-y, 0.0)
    sigma = n.sgn(u.v) * x.zeta / (b.half_width * max(grown, 0.1))
    power = 1 / b.roundness
    share = (1 + sigma) / 2
    followed = 1 + power * (share - 1) if share > 1 else max(share, 0.0) ** power
    return b.rho * u.v * (1 - followed)


law("AsymmetricBoucWen", lambda b, t, x, u: slope(b, u.v) * u.x + x.zeta, rates={"zeta": _zeta_of_the_paper})
law("HysteresisObserver", lambda b, t, x, u: x.zeta, rates={"zeta": _zeta_of_the_paper})
law("FeedforwardCompensator", lambda b, t, x, u: (u.x - x.zeta) / slope(b, u.v), rates={"zeta": _zeta_of_the_paper})
law("BoucWen", lambda b, t, x, u: b.alpha_x * u.x + b.alpha_zeta * x.zeta, rates={"zeta": _bouc_wen})
law("GeneralizedBoucWen", lambda b, t, x, u: b.alpha_x * u.x + b.alpha_zeta * x.zeta, rates={"zeta": _generalized})
law(
    "DahlHysteresis",
    lambda b, t, x, u: b.alpha_x * u.x - x.zeta,
    rates={"zeta": lambda b, t, x, u: b.rho * (u.v - abs(u.v) * x.zeta / b.half_width)},
)
law("ElasticBacklash", lambda b, t, x, u: b.alpha_x * (u.x - x.zeta), rates={"zeta": _elastic})
law(
    "DahlFriction",
    lambda b, t, x, u: b.sigma0 * x.z,
    rates={"z": lambda b, t, x, u: u.v - b.sigma0 * abs(u.v) / b.coulomb * x.z},
)


def _bristles(b: Any, t: Any, x: Any, u: Any) -> Any:
    g = b.coulomb + (b.static - b.coulomb) * n.exp(-((u.v / b.stribeck) ** 2))
    return u.v - b.sigma0 * abs(u.v) / g * x.z


law(
    "LuGreFriction",
    lambda b, t, x, u: b.sigma0 * x.z + b.sigma1 * _bristles(b, t, x, u) + b.sigma2 * u.v,
    rates={"z": _bristles},
)


def _turning(b: Any, t: Any, x: Any, u: Any) -> Any:
    """z' of the loops by Dahl's law, whose state runs from -1 to 1."""
    return (u.v - abs(u.v) * x.z) / b.distance


def _stribeck_stretch(b: Any, t: Any, x: Any, u: Any) -> Any:
    return u.u - (b.half_width + b.breakaway * n.exp(-((u.v / b.speed) ** 2))) * x.z


def _asymmetry(b: Any, t: Any, x: Any, u: Any) -> Any:
    return u.u + b.slope_difference / 2 * n.tanh(u.v / b.speed) * u.x + x.z


law("Stretch", lambda b, t, x, u: u.u - b.half_width * x.z, rates={"z": _turning})
law("StribeckStretch", _stribeck_stretch, rates={"z": _turning})
law("LoopChange", lambda b, t, x, u: u.u + risen(b, t) * (b.gain * u.u + b.change * x.z), rates={"z": _turning})
law("LoopAsymmetry", _asymmetry, rates={"z": lambda b, t, x, u: abs(u.v) * (b.delta - b.theta * x.z)})
law(
    "PositionDependentLoop",
    lambda b, t, x, u: u.u + b.gain * x.z,
    rates={"z": lambda b, t, x, u: (u.x * u.v - abs(u.v) * x.z) / b.distance},
)


def _spilt(b: Any, u: Any) -> Any:
    return b.rate * n.larger(u.x - b.rim, 0.0)


law(
    "Overflow",
    outputs={"y": lambda b, t, x, u: u.u - _spilt(b, u), "spilt": lambda b, t, x, u: b.caught * _spilt(b, u)},
)
