"""Random nonlinear diagrams with steps from fine to far too long, for the warnings of the step."""

from __future__ import annotations

import itertools
import math
from collections.abc import Callable
from dataclasses import dataclass
from typing import Any

import casadi as ca
import numpy as np
from tsmblocks.block import Block, Input, Output, block, parameter, state

import tsmblocks as tsm
from tsmblocks import blocks as b

METHODS = ("rk4",) * 12 + ("heun",) * 2 + ("euler",) * 2 + ("sdirk2", "sdirk3", "sdirk4", "sdirk4")
STEPS = (25.0, 20_000.0)
"""Steps of a run, fewest and most: drawn evenly in their logarithm."""


@block(register=False)
class Oscillator(Block):
    """x'' = u - d x' - k x - c x^3 - s sin(x) + mu (1 - x^2) x': Van der Pol, Duffing, pendulum and between."""

    d: float = parameter(default=0.0, about="damping")
    k: float = parameter(default=1.0, about="stiffness")
    c: float = parameter(default=0.0, about="cubic stiffness")
    s: float = parameter(default=0.0, about="gravity")
    mu: float = parameter(default=0.0, about="negative damping of Van der Pol")
    x: float = state(default=0.0, about="position")
    v: float = state(default=0.0, about="velocity")
    u = Input("force")
    y = Output("position")
    rate = Output("velocity")

    def outputs(self, t: Any, x: Any, u: Any) -> dict[str, Any]:
        return dict(y=x.x, rate=x.v)

    def derivatives(self, t: Any, x: Any, u: Any) -> dict[str, Any]:
        pull = self.d * x.v + self.k * x.x + self.c * x.x**3 + self.s * ca.sin(x.x)
        return dict(x=x.v, v=u.u - pull + self.mu * (1 - x.x**2) * x.v)


@block(register=False)
class Prey(Block):
    """Lotka and Volterra."""

    a: float = parameter(default=1.0, about="growth")
    c: float = parameter(default=1.0, about="decay")
    x: float = state(default=1.0, about="prey")
    v: float = state(default=1.0, about="hunters")
    y = Output("prey")

    def outputs(self, t: Any, x: Any, u: Any) -> dict[str, Any]:
        return dict(y=x.x)

    def derivatives(self, t: Any, x: Any, u: Any) -> dict[str, Any]:
        return dict(x=self.a * x.x * (1 - x.v), v=self.c * x.v * (x.x - 1))


@block(register=False)
class Wall(Block):
    """A mass under a force between stiff walls at 0 and 1, damped where it touches."""

    k: float = parameter(default=1e3, about="stiffness")
    d: float = parameter(default=0.1, about="damping while in contact, as a share of the critical")
    x: float = state(default=0.3, about="position")
    v: float = state(default=0.0, about="velocity")
    u = Input("force")
    y = Output("position")

    def outputs(self, t: Any, x: Any, u: Any) -> dict[str, Any]:
        return dict(y=x.x)

    def derivatives(self, t: Any, x: Any, u: Any) -> dict[str, Any]:
        depth = ca.fmax(-x.x, 0.0) - ca.fmax(x.x - 1.0, 0.0)
        return dict(x=x.v, v=u.u + self.k * depth * (1 - self.d * ca.sign(depth) * x.v))


@dataclass
class Case:
    """A diagram, and how it is run; ``kind`` names its family."""

    seed: int
    kind: str
    diagram: tsm.Diagram
    stop: float
    step: float
    method: str
    locate: bool

    @property
    def run(self) -> dict[str, Any]:
        return dict(stop=self.stop, step=self.step, method=self.method, locate=self.locate)


def _log(rng: Any, low: float, high: float) -> float:
    return float(np.exp(rng.uniform(math.log(low), math.log(high))))


def _signs(rng: Any, low: float, high: float) -> float:
    return _log(rng, low, high) * (1 if rng.random() < 0.5 else -1)


def source(rng: Any, size: float, period: float) -> Block:
    """A signal of about this size and period [s]: sine, step, sweep, triangle, staircase, held noise, two tones."""
    f = 1 / period
    kind = rng.integers(8)
    if kind <= 1:
        return b.Sine(amplitude=size, frequency=f, phase=rng.uniform(0, 6))
    if kind == 2:
        return b.Step(time=period * rng.uniform(0.1, 1.0), after=size)
    if kind == 3:
        return b.Chirp(amplitude=size, f0=0.3 * f, f1=3 * f, duration=5 * period)
    if kind == 4:
        return b.Triangle(amplitude=size, frequency=f)
    if kind == 5:
        return b.Staircase(height=size / 3, dwell=period / 6, up=3, down=3)
    if kind == 6:
        return b.Random(std=size, seed=int(rng.integers(1000)), interval=period / 10)
    return b.MultiSine(amplitudes=(size, size / 2), frequencies=(f, 2.7 * f), phases=(0.0, rng.uniform(0, 6)))


def friction(rng: Any, force: float, speed: float) -> Block:
    """Friction of about this force, for motion of about this speed."""
    level = force * _log(rng, 0.1, 0.6)
    kind = rng.integers(6)
    v = speed * _log(rng, 0.005, 0.2)
    if kind == 0:
        return b.CoulombFriction(level=level, smoothing=v)
    if kind == 1:
        return b.StribeckFriction(coulomb=level, static=1.5 * level, stribeck=3 * v, viscous=0.05, smoothing=v)
    if kind == 2:
        return b.AsymmetricFriction(level_positive=level, level_negative=1.3 * level, smoothing=v)
    stretch = speed * _log(rng, 0.002, 0.1)
    if kind == 3:
        return b.DahlFriction(sigma0=level / stretch, coulomb=level)
    return b.LuGreFriction(
        sigma0=level / stretch,
        sigma1=_log(rng, 0.01, 1.0) * math.sqrt(level / stretch),
        sigma2=0.05,
        coulomb=level,
        static=level * rng.uniform(1.0, 1.8),
        stribeck=v,
    )


def _rubbing(rng: Any) -> tuple[dict[str, Any], list[str], str, float]:
    """A mass with friction, driven by a force or pulled by a spring."""
    period = _log(rng, 0.5, 5.0)
    made = {"force": source(rng, 1.0, period), "sum": b.Sum(signs="+-"), "mass": b.Integrator(gain=_log(rng, 0.5, 5.0))}
    made |= {"friction": friction(rng, 1.0, 1.0), "place": b.Integrator()}
    wires = ["force -> sum -> mass -> friction -> sum.minus", "mass -> place"]
    if rng.random() < 0.5:
        made |= {"sum": b.Sum(signs="+--"), "spring": b.Gain(gain=_log(rng, 0.3, 30.0))}
        wires = ["force -> sum", "sum -> mass -> friction", "friction -> sum.minus1", "mass -> place -> spring"]
        wires = [*wires, "spring -> sum.minus2"]
    return made, wires, "place", period * rng.uniform(2, 6)


def _oscillator(rng: Any) -> tuple[dict[str, Any], list[str], str, float]:
    kind = rng.integers(4)
    if kind == 0:
        made = Oscillator(k=1.0, mu=_log(rng, 0.3, 30.0), x=2.0)
    elif kind == 1:
        made = Oscillator(k=-1.0, c=1.0, d=_log(rng, 0.05, 0.5), x=0.5)
    elif kind == 2:
        made = Oscillator(k=0.0, s=1.0, d=_log(rng, 0.01, 0.3), x=rng.uniform(0.2, 3.0))
    else:
        made = Oscillator(k=1.0, c=_log(rng, 0.1, 10.0), d=_log(rng, 0.01, 1.0), x=1.0)
    drive = b.Sine(amplitude=_log(rng, 0.05, 1.0), frequency=rng.uniform(0.05, 0.3))
    return {"drive": drive, "plant": made}, ["drive -> plant"], "plant.y", rng.uniform(10, 40)


def _few(rng: Any) -> tuple[dict[str, Any], list[str], str, float]:
    """Prey and hunters, or a mass between walls."""
    if rng.random() < 0.4:
        made: Block = Prey(a=_log(rng, 0.5, 3), c=_log(rng, 0.5, 3), x=rng.uniform(0.2, 3), v=rng.uniform(0.3, 2))
        return {"plant": made}, [], "plant", rng.uniform(8, 40)
    made = Wall(k=_log(rng, 1e2, 1e5), d=_log(rng, 0.01, 0.3))
    return {"force": source(rng, 1.0, 3.0), "plant": made}, ["force -> plant"], "plant", rng.uniform(3, 8)


def _hysteresis(rng: Any) -> tuple[dict[str, Any], list[str], str, float]:
    """A hysteresis of the transmission behind a lag, in front of another."""
    period = _log(rng, 0.5, 5.0)
    kinds: list[Callable[[], Block]] = [
        lambda: b.BoucWen(A=-_log(rng, 0.5, 3), beta=_log(rng, 1, 30), gamma=rng.uniform(-1, 1), n=rng.uniform(1, 3)),
        lambda: b.AsymmetricBoucWen(theta=_log(rng, 1, 100)),
        lambda: b.DahlHysteresis(half_width=_log(rng, 0.01, 0.3)),
        lambda: b.ElasticBacklash(half_width=_log(rng, 0.05, 0.3), roundness=rng.uniform(0.05, 1.0)),
        b.GeneralizedBoucWen,
    ]
    made = {
        "ref": source(rng, 1.0, period),
        "motor": b.SecondOrderLag(omega=_log(rng, 5, 100), zeta=rng.uniform(0.2, 1)),
    }
    made |= {"sheath": kinds[rng.integers(len(kinds))](), "load": b.FirstOrderLag(time_constant=_log(rng, 0.003, 0.3))}
    return made, ["ref -> motor", "motor -> sheath.x", "sheath -> load"], "load", period * rng.uniform(2, 5)


def _servo(rng: Any) -> tuple[dict[str, Any], list[str], str, float]:
    """A motor in its position loop, with limits; friction, backlash, dead time or a sampled controller besides."""
    period = _log(rng, 0.5, 5.0)
    made: dict[str, Any] = {"ref": source(rng, 1.0, period), "error": b.Sum(signs="+-")}
    kp, kd = _log(rng, 3, 60), _log(rng, 0.01, 1.0)
    sampled = rng.random() < 0.3
    if sampled:
        made["pid"] = b.DiscretePID(kp=kp, kd=kd, period=0.01, tau=0.02)
    else:
        made["pid"] = b.PID(kp=kp, ki=kp * rng.uniform(0, 2), kd=kd, tau=_log(rng, 0.001, 0.02))
    made |= {"limit": b.Saturation(low=-24.0, high=24.0)}
    motor = rng.integers(3)
    if motor == 0:
        made["motor"] = b.DCMotor(L=_log(rng, 2e-4, 5e-3), smoothing=_log(rng, 0.2, 5))
    else:
        made["motor"] = b.MotorTransferFunction(tau=_log(rng, 0.005, 0.1))
    chain, back = ["ref -> error -> pid -> limit -> motor"], "motor"
    kind = rng.integers(5)
    if kind == 0:
        made["play"] = b.Play(half_width=_log(rng, 0.01, 0.2))
    elif kind == 1:
        made["play"] = b.DeadTime(time=_log(rng, 0.005, 0.05)) if hasattr(b, "DeadTime") else b.Delay(time=0.02)
    elif kind == 2:
        made["play"] = b.ElasticBacklash(half_width=_log(rng, 0.02, 0.2))
    else:
        made["play"] = b.FirstOrderLag(time_constant=_log(rng, 0.002, 0.05))
    made["load"] = b.FirstOrderLag(time_constant=_log(rng, 0.005, 0.1))
    into = "play.x" if kind == 2 else "play"
    chain += [f"{back}.y -> {into}", "play -> load", f"{'load' if rng.random() < 0.5 else 'motor.y'} -> error.minus"]
    return made, chain, "load", period * rng.uniform(1, 4)


def _relay(rng: Any) -> tuple[dict[str, Any], list[str], str, float]:
    """Two-point control: a limit cycle."""
    width = _log(rng, 0.02, 0.3)
    made: dict[str, Any] = {"ref": source(rng, 0.4, 5.0), "error": b.Sum(signs="+-")}
    made["relay"] = b.Relay(on=width, off=-width, high=1.0, low=-1.0)
    plant = rng.integers(3)
    if plant == 0:
        made["plant"] = b.SecondOrderLag(omega=_log(rng, 2, 20), zeta=rng.uniform(0.3, 1.0), gain=1.5)
    elif plant == 1:
        made["plant"] = b.Integrator(gain=_log(rng, 0.5, 5))
    else:
        made["plant"] = b.TransferFunction(num=(2.0,), den=(0.01, 0.3, 1.0))
    return made, ["ref -> error -> relay -> plant -> error.minus"], "plant", rng.uniform(4, 12)


def _resonant(rng: Any) -> tuple[dict[str, Any], list[str], str, float]:
    """Lightly damped modes with products, squares and limits between, slow and stiff lags."""
    omega = _log(rng, 3, 60)
    made: dict[str, Any] = {"ref": source(rng, 1.0, _log(rng, 0.5, 4.0)), "sum": b.Sum(signs="+-")}
    made["mode"] = b.SecondOrderLag(omega=omega, zeta=_log(rng, 0.002, 0.2))
    bend = [
        b.Square(),
        b.Tanh(),
        b.Saturation(low=-0.7, high=0.7),
        b.DeadZone(low=-0.3, high=0.3),
        b.Abs(),
        b.Product(n=2),
    ]
    made["bend"] = bend[rng.integers(len(bend))]
    made["lag"] = b.FirstOrderLag(time_constant=_log(rng, 3e-4, 1.0))
    made["back"] = b.Gain(gain=rng.uniform(-0.5, 0.5))
    wires = ["ref -> sum -> mode -> lag -> back -> sum.minus"]
    if isinstance(made["bend"], b.Product):
        wires = ["ref -> sum -> mode -> lag -> back -> sum.minus", "mode -> bend.u1", "lag -> bend.u2"]
    else:
        wires = ["ref -> sum -> mode -> bend -> lag -> back -> sum.minus"]
    return made, wires, "lag", 6.28 / omega * _log(rng, 5, 100)


def _chain(rng: Any) -> tuple[dict[str, Any], list[str], str, float]:
    """Some blocks in a row, each followed by a lag, and a loop around all of them."""
    made: dict[str, Any] = {"ref": source(rng, 1.0, _log(rng, 0.5, 4.0)), "sum": b.Sum(signs="+-")}
    names = ["sum"]
    for k in range(int(rng.integers(2, 5))):
        pick: list[Callable[[], Block]] = [
            lambda: b.Saturation(low=-rng.uniform(0.2, 1), high=rng.uniform(0.2, 1)),
            lambda: b.DeadZone(low=-rng.uniform(0.02, 0.3), high=rng.uniform(0.02, 0.3)),
            b.Tanh,
            lambda: b.SoftSaturation(low=-1.0, high=1.0, softness=0.2),
            lambda: b.Play(half_width=rng.uniform(0.02, 0.2)),
            lambda: b.RateLimit(rising=rng.uniform(0.5, 5), falling=-rng.uniform(0.5, 5)),
            lambda: b.Relay(on=0.1, off=-0.1, high=1.0, low=-1.0),
            lambda: b.ZeroOrderHold(period=0.02),
            lambda: b.Delay(time=_log(rng, 0.02, 0.2)),
            lambda: b.DeadTime(time=_log(rng, 0.02, 0.2)),
            b.Quantiser,
        ]
        made[f"n{k}"] = pick[rng.integers(len(pick))]()
        lag = b.FirstOrderLag(time_constant=_log(rng, 0.003, 0.5))
        made[f"l{k}"] = (
            lag if rng.random() < 0.6 else b.SecondOrderLag(omega=_log(rng, 3, 100), zeta=_log(rng, 0.05, 1))
        )
        names += [f"n{k}", f"l{k}"]
    made["back"] = b.Gain(gain=_signs(rng, 0.2, 3.0))
    wires = [f"ref -> {' -> '.join(names)} -> back -> sum.minus"]
    return made, wires, names[-1], rng.uniform(3, 15)


def _reset(rng: Any) -> tuple[dict[str, Any], list[str], str, float]:
    """An integrator that is set back when it reaches a level, in front of a lag."""
    made: dict[str, Any] = {"rate": source(rng, 0.5, 3.0), "base": b.Constant(value=1.0), "sum": b.Sum(signs="++")}
    made |= {"fill": b.Integrator(reset=True), "full": b.Comparison(level=rng.uniform(0.5, 2.0))}
    made["lag"] = b.FirstOrderLag(time_constant=_log(rng, 0.02, 1.0))
    wires = ["rate -> sum.plus1", "base -> sum.plus2", "sum -> fill.u", "fill -> full"]
    return made, [*wires, "full -> fill.reset", "fill -> lag"], "lag", rng.uniform(5, 15)


KINDS = {
    "friction": _rubbing,
    "oscillator": _oscillator,
    "few": _few,
    "hysteresis": _hysteresis,
    "servo": _servo,
    "relay": _relay,
    "resonant": _resonant,
    "chain": _chain,
    "reset": _reset,
}
WEIGHTS = (0.2, 0.13, 0.07, 0.13, 0.17, 0.06, 0.1, 0.1, 0.04)


def _pairs(made: dict[str, Any], wires: list[str]) -> list[str]:
    """Each wire by itself; what a sum is named for goes to its port plus."""
    pairs = []
    for wire in wires:
        ends = wire.split(" -> ")
        for start, end in itertools.pairwise(ends):
            port = ".plus" if isinstance(made.get(end), b.Sum) else ""
            pairs.append(f"{start} -> {end}{port}")
    return pairs


def build(seed: int) -> Case | None:
    """The case of a seed; None where its diagram cannot be made."""
    rng = np.random.default_rng([20, seed])
    kind = str(rng.choice(list(KINDS), p=WEIGHTS))
    made, wires, out, stop = KINDS[kind](rng)
    method = str(rng.choice(METHODS))
    step = stop / _log(rng, *STEPS)
    diagram = tsm.Diagram(title=f"case {seed}", blocks=made, wires=_pairs(made, wires), outputs={"y": out})
    periods = {one.period for one in made.values() if hasattr(one, "period")}
    if periods:
        (period,) = periods
        step = period / max(1, round(period / step))
    least = min([one.time for one in made.values() if isinstance(one, b.Delay)], default=math.inf)
    step = min(step, least)
    late = any(isinstance(one, (b.Delay, b.DeadTime)) for one in made.values())
    locate = bool(rng.random() < 0.15) and not late
    return Case(seed, kind, diagram, max(stop, 12 * step), step, method, locate)
