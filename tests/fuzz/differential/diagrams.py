"""Random diagrams over nearly all blocks: loops, events, delays, sampled parts, stiff parts; and their nested forms."""

from __future__ import annotations

import random
from collections.abc import Callable, Iterable
from typing import Any

import attrs
import numpy as np

import tsmblocks.blocks as B
from tests.fuzz.differential.evaluation import Flat, Signal
from tsmblocks.model.block import Block
from tsmblocks.model.diagram import Diagram

H = 0.01
"""Step [s] of all runs."""
STEPS = 50
"""Steps of a run. Chosen: enough for events, delays and samples of each kind."""

Make = Callable[[random.Random], Block]


def _either(rng: random.Random, low: float, high: float) -> float:
    """A number of either sign, with its size between limits."""
    return round(rng.choice((-1, 1)) * rng.uniform(low, high), 3)


def _some(rng: random.Random, low: float, high: float) -> float:
    return round(rng.uniform(low, high), 3)


SOURCES: list[Make] = [
    lambda r: B.Constant(value=_either(r, 0, 2)),
    lambda r: B.Sine(
        amplitude=_some(r, 0.2, 1.5), frequency=_some(r, 0.3, 6), phase=_some(r, 0, 6), offset=_either(r, 0, 1)
    ),
    lambda r: B.MultiSine(
        amplitudes=(_some(r, 0.1, 1), 0.4), frequencies=(_some(r, 0.2, 3), 5.0), phases=(0.3, _some(r, 0, 6))
    ),
    lambda r: B.Chirp(amplitude=_some(r, 0.3, 1), f0=_some(r, 0, 2), f1=_some(r, 1, 8), duration=_some(r, 0.1, 1)),
    lambda r: B.Ramp(start=r.choice((0.0, 0.1, 0.123)), slope=_either(r, 0.1, 4), initial=_either(r, 0, 1)),
    lambda r: B.Step(time=r.choice((0.0, 0.1, 0.205, 0.3)), before=_either(r, 0, 1), after=_either(r, 0, 2)),
    lambda r: B.Staircase(
        height=_some(r, 0.1, 0.7), dwell=r.choice((0.05, 0.083, 0.1)), up=r.randint(0, 4), down=r.randint(1, 3)
    ),
    lambda r: B.Triangle(amplitude=_some(r, 0.2, 1.5), frequency=_some(r, 0.5, 4)),
    lambda r: B.Recorded(
        times=(0.0, 0.1, 0.234, 0.4, 2.0),
        values=(0.0, 1.0, _either(r, 0, 1), 0.5, 0.0),
        hold=r.choice(("zero", "linear", "cubic")),
        gain=_either(r, 0.2, 1),
    ),
]
SMOOTH: list[Make] = [
    lambda r: B.FirstOrderLag(gain=_either(r, 0.3, 1.5), time_constant=_some(r, 0.03, 0.5), value=_either(r, 0, 1)),
    lambda r: B.SecondOrderLag(
        gain=_either(r, 0.3, 1.5), omega=_some(r, 3, 40), zeta=_some(r, 0, 1.5), value=_either(r, 0, 1)
    ),
    lambda r: B.Integrator(gain=_either(r, 0.3, 3), integral=_either(r, 0, 1)),
    lambda r: B.TransferFunction(num=(_either(r, 0.3, 2),), den=(_some(r, 0.01, 0.3), _some(r, 0.1, 1), 1.0)),
    lambda r: B.TransferFunction(num=(_some(r, 0.1, 1), 1.0), den=(0.02, _some(r, 0.1, 1), _some(r, 0.5, 2))),
    lambda r: B.ZeroPoleGain(
        zeros=(-_some(r, 1, 9),),
        poles=(-_some(r, 1, 9),),
        pole_pairs=((-_some(r, 1, 9), _some(r, 1, 9)),),
        gain=_some(r, 1, 20),
    ),
    lambda r: B.StateSpace(
        A=((-_some(r, 1, 9), 2.0), (_either(r, 0, 3), -4.0)),
        B=((1.0,), (_either(r, 0, 2),)),
        C=((1.0, 0.0), (0.5, -1.0)),
        x0=(0.2, -0.3),
    ),
]
"""Blocks whose outputs are states: a rate of what they give can be formed."""
BENDING: list[Make] = [
    lambda r: B.Tanh(),
    lambda r: B.Sin(),
    lambda r: B.Cos(),
    lambda r: B.Gain(gain=_either(r, 0.2, 2)),
    lambda r: B.Bias(bias=_either(r, 0, 1)),
    lambda r: B.Sum(signs=r.choice(("+", "+-", "++", "-+-", "+++"))),
    lambda r: B.Bow(size=_either(r, 0, 0.5), width=_some(r, 0.1, 1), centre=_either(r, 0, 0.5)),
    lambda r: B.Ripple(
        cosine=_either(r, 0, 0.2),
        sine=_either(r, 0, 0.2),
        cosine2=0.1,
        sine2=_either(r, 0, 0.1),
        cycles=_some(r, 0.5, 6),
    ),
    lambda r: B.SoftSaturation(low=-_some(r, 0.2, 2), high=_some(r, 0.2, 2), softness=_some(r, 0.05, 0.5)),
    lambda r: B.SoftDeadZone(half_width=_some(r, 0, 0.4), centre=_either(r, 0, 0.3), softness=_some(r, 0.02, 0.3)),
    lambda r: B.EndStops(
        low=-_some(r, 0.1, 1),
        high=_some(r, 0.1, 1),
        stiffness=_some(r, 0, 50),
        damping=_some(r, 0, 5),
        transition=_some(r, 0.02, 0.3),
    ),
    lambda r: B.Disturbance(
        cosine=_either(r, 0, 0.5), sine=_either(r, 0, 0.5), frequency=_some(r, 0.5, 8), since=_either(r, 0, 1)
    ),
    lambda r: B.Drift(rate=_either(r, 0, 2), curve=_either(r, 0, 2), since=_some(r, 0, 0.3)),
    lambda r: B.GainDrift(rate=_either(r, 0, 2), since=_some(r, 0, 0.3)),
    lambda r: B.GainChange(change=_either(r, 0, 1), time=_some(r, 0.1, 0.4), width=_some(r, 0.02, 0.2)),
    lambda r: B.SettlingOffset(size=_either(r, 0, 1), time_constant=_some(r, 0.1, 2), since=_some(r, 0, 0.3)),
    lambda r: B.SettlingGain(change=_either(r, 0, 1), time_constant=_some(r, 0.1, 2), since=_some(r, 0, 0.3)),
    lambda r: B.HeatedGain(
        change=_either(r, 0, 1), scale=_some(r, 0.5, 2), time_constant=_some(r, 0.1, 2), heat=_either(r, 0, 1)
    ),
    lambda r: B.TemporaryOffset(
        size=_either(r, 0, 1), time=_some(r, 0.1, 0.3), until=_some(r, 0.2, 0.5), width=_some(r, 0.02, 0.2)
    ),
    lambda r: B.TemporaryGain(
        change=_either(r, 0, 1), time=_some(r, 0.1, 0.3), until=_some(r, 0.2, 0.5), width=_some(r, 0.02, 0.2)
    ),
    lambda r: B.Jump(size=_either(r, 0, 1), time=_some(r, 0.1, 0.4), width=_some(r, 0.02, 0.2)),
]
"""Smooth blocks without memory."""
LOOPS: list[Make] = [
    lambda r: B.AsymmetricBoucWen(zeta=_either(r, 0, 0.1)),
    lambda r: B.BoucWen(n=r.choice((1.0, 1.0217, 2.0, 3.5)), zeta=_either(r, 0, 0.1)),
    lambda r: B.GeneralizedBoucWen(n=r.choice((1.0, 2.024, 3.0))),
    lambda r: B.DahlHysteresis(half_width=_some(r, 0.1, 0.5)),
    lambda r: B.ElasticBacklash(roundness=_some(r, 0.3, 1), half_width=_some(r, 0.15, 0.4)),
    lambda r: B.FeedforwardCompensator(),
    lambda r: B.LoopAsymmetry(slope_difference=_either(r, 0, 0.4), delta=_either(r, 0, 0.3), theta=_some(r, 0.5, 5)),
    lambda r: B.LoopChange(
        change=_either(r, 0, 0.3),
        gain=_either(r, 0, 0.3),
        distance=_some(r, 0.1, 1),
        time=_some(r, 0.1, 0.3),
        width=0.05,
    ),
    lambda r: B.PositionDependentLoop(gain=_either(r, 0, 0.4), distance=_some(r, 0.2, 1)),
    lambda r: B.RateDependence(coefficient=_either(r, 0, 0.05), exponent=r.choice((1.0, 0.7, 2.0)), smoothing=0.1),
    lambda r: B.Stretch(half_width=_either(r, 0, 0.3), distance=_some(r, 0.1, 0.6)),
    lambda r: B.StribeckStretch(
        half_width=_some(r, 0, 0.3), breakaway=_some(r, 0, 0.3), speed=_some(r, 0.3, 3), distance=0.4
    ),
    lambda r: B.Derivative(),
]
"""Blocks that read the rate of a smooth signal."""
LINEAR: list[Make] = [
    lambda r: B.TransferFunction(num=(_some(r, 0.1, 1), 1.0), den=(_some(r, 0.05, 0.5), 2.0)),
    lambda r: B.StateSpace(
        A=((-3.0,),), B=((1.0, _either(r, 0, 2)),), C=((1.0,), (2.0,)), D=((_either(r, 0, 1), 0.5), (0.0, 1.0))
    ),
    lambda r: B.FilteredDerivative(time_constant=_some(r, 0.02, 0.3), smooth=_either(r, 0, 1)),
    lambda r: B.LeadLag(gain=_either(r, 0.3, 1), lead=_some(r, 0, 0.3), lag=_some(r, 0.02, 0.3)),
    lambda r: B.Creep(share=_either(r, 0, 0.5), time_constant=_some(r, 0.05, 1)),
    lambda r: B.BroadCreep(share=_either(r, 0, 0.5), fastest=_some(r, 0.02, 0.1), slowest=_some(r, 0.2, 2)),
    lambda r: B.Resonance(share=_some(r, 0, 1), omega=_some(r, 5, 40), zeta=_some(r, 0, 0.6), feed=_some(r, 0, 1)),
    lambda r: B.ParallelResonance(
        gain=_either(r, 0, 0.5), rate_gain=_either(r, 0, 0.5), omega=_some(r, 5, 40), zeta=_some(r, 0, 0.4)
    ),
    lambda r: B.MotorTransferFunction(K=_some(r, 0.2, 2), tau=_some(r, 0.02, 0.2), angle=_either(r, 0, 1)),
    lambda r: B.DCMotor(L=0.05, J=1e-4, load=r.random() < 0.5),
    lambda r: B.PID(kp=_either(r, 0, 1.5), ki=_either(r, 0, 2), kd=_either(r, 0, 0.05), tau=_some(r, 0.02, 0.2)),
    lambda r: B.PIDController(
        kp=_some(r, 0.1, 2),
        ki=r.choice((0.0, 3.0)),
        kd=r.choice((0.0, 0.05)),
        tau=0.03,
        b=_some(r, 0, 1),
        c=_some(r, 0, 1),
        low=-0.6,
        high=_some(r, 0.1, 1),
    ),
    lambda r: B.HysteresisObserver(),
    lambda r: B.DahlFriction(sigma0=_some(r, 0.2, 2), coulomb=_some(r, 0.1, 0.5)),
    lambda r: B.LuGreFriction(sigma0=_some(r, 0.2, 2), coulomb=_some(r, 0.1, 0.5), static=_some(r, 0.1, 0.6)),
]
KINKED: list[Make] = [
    lambda r: B.Abs(),
    lambda r: B.Sign(),
    lambda r: B.Square(),
    lambda r: B.Power(exponent=r.choice((0.5, 1.0, 2.0, 1.7)), gain=_either(r, 0.3, 1), smoothing=0.05),
    lambda r: B.Product(n=r.randint(1, 3)),
    lambda r: B.Maximum(n=r.randint(1, 3)),
    lambda r: B.Minimum(n=r.randint(1, 3)),
    lambda r: B.Comparison(sign=r.choice((">", ">=", "<", "<=")), level=_either(r, 0, 0.7)),
    lambda r: B.Logic(operation=r.choice(("and", "or", "xor", "nand", "nor")), n=r.randint(2, 3)),
    lambda r: B.Logic(operation="not", n=1),
    lambda r: B.Switch(threshold=_either(r, 0, 0.6)),
    lambda r: B.Quantiser(interval=_some(r, 0.05, 0.5)),
    lambda r: B.Encoder(counts=_some(r, 8, 100), rounding=r.choice(("nearest", "down"))),
    lambda r: B.Convert(),
    lambda r: B.Saturation(low=-_some(r, 0.1, 1), high=_some(r, 0.1, 1)),
    lambda r: B.DeadZone(low=-_some(r, 0, 0.5), high=_some(r, 0, 0.5)),
    lambda r: B.Slack(share=_some(r, 0, 1), edge=_either(r, 0, 0.5), side=r.choice(("low", "high"))),
    lambda r: B.AsymmetricGain(difference=_either(r, -0.5, 0.5)),
    lambda r: B.Bend(
        quadratic=_either(r, 0, 0.3),
        cubic=_either(r, 0, 0.2),
        quartic=_either(r, 0, 0.05),
        quintic=0.02,
        centre=_either(r, 0, 0.3),
    ),
    lambda r: B.SmoothSlope(),
    lambda r: B.CoulombFriction(level=_some(r, 0.1, 0.5), smoothing=_some(r, 0.05, 0.5)),
    lambda r: B.AsymmetricFriction(
        level_positive=0.3, level_negative=_some(r, 0.1, 0.5), smoothing=_some(r, 0.05, 0.5)
    ),
    lambda r: B.StribeckFriction(
        coulomb=0.2, static=_some(r, 0.1, 0.5), smoothing=_some(r, 0.05, 0.5), viscous=_some(r, 0, 0.3)
    ),
    lambda r: B.ViscousFriction(coefficient=_some(r, 0, 1)),
    lambda r: B.QuadraticDrag(coefficient=_some(r, 0, 0.5)),
    lambda r: B.Overflow(rim=_either(r, 0, 0.5), rate=_some(r, 0.2, 5), caught=_some(r, 0, 1)),
    lambda r: B.LookupTable(
        values=(-0.8, _either(r, 0, 0.3), 0.1, 0.8),
        interpolation=r.choice(("linear", "cubic")),
        outside=r.choice(("hold", "extend")),
    ),
    lambda r: B.LookupTable2D(
        points1=(-1.0, -0.2, 0.4, 1.0),
        points2=(-1.5, 0.0, 0.7, 1.2),
        interpolation=r.choice(("linear", "cubic")),
        outside=r.choice(("hold", "extend")),
    ),
    lambda r: B.Integrator(gain=_either(r, 1, 5), low=-_some(r, 0.05, 0.4), high=_some(r, 0.05, 0.4)),
    lambda r: B.Integrator(
        gain=_either(r, 1, 5), integral=_either(r, 0, 0.3), reset=True, target=r.random() < 0.5, enable=r.random() < 0.5
    ),
]
REMEMBERING: list[Make] = [
    lambda r: B.Play(half_width=_some(r, 0, 0.5), gain=_either(r, 0.5, 1.5), m=_either(r, 0, 0.5)),
    lambda r: B.CapstanFriction(mu=_some(r, 0, 0.4), pretension=_either(r, 0.2, 2.0), m=_either(r, 0, 0.5)),
    lambda r: B.TaoBacklash(B1=_some(r, 0.05, 0.3), B2=_some(r, 0.05, 0.3), m=_either(r, 0, 0.2)),
    lambda r: B.PrandtlIshlinskii(
        radii=(_some(r, 0, 0.2), 0.3), weights=(0.5, _either(r, 0, 0.5)), x0=r.choice(((), (0.1, -0.2)))
    ),
    lambda r: B.NonlocalMemory(weights=(_either(r, 0, 0.4), 0.2), radii=(_some(r, 0, 0.2), 0.3)),
    lambda r: B.RateLimit(
        rising=_some(r, 0.5, 6), falling=-_some(r, 0.5, 6), start=r.choice(("input", "last")), last=_either(r, 0, 1)
    ),
    lambda r: B.SoftRateLimit(
        rising=_some(r, 0.5, 6), falling=-_some(r, 0.5, 6), softness=_some(r, 0.05, 0.5), lag=_some(r, 0.005, 0.1)
    ),
    lambda r: B.SlidingMass(
        mass=_some(r, 0.2, 2),
        coulomb=_some(r, 0, 0.5),
        breakaway=_some(r, 0, 0.3),
        stribeck=_some(r, 0.05, 0.5),
        viscous=_some(r, 0, 0.5),
        v=_either(r, 0, 0.5),
    ),
    lambda r: B.Lag(time_constant=r.choice((0.0, 0.003, 0.05, 0.4)), behind=_either(r, 0, 1)),
    lambda r: B.Relay(
        on=_some(r, 0, 0.5),
        off=-_some(r, 0.01, 0.5),
        high=_either(r, 0.3, 1),
        low=_either(r, 0, 1),
        active=float(r.random() < 0.5),
    ),
    lambda r: B.TriggeredHold(initial=_either(r, 0, 1)),
    lambda r: B.StateMachine(
        modes=("a", "b", "c"),
        signals=("u", "v"),
        transitions=(
            f"a -> b: u > {_some(r, 0, 0.5)}",
            f"b -> c: v < {_either(r, 0, 0.5)} and since > 0.035",
            "b -> a: u < 0",
            "c -> a: since > 0.055 or v > u",
        ),
    ),
    lambda r: B.Delay(time=r.choice((0.01, 0.02, 0.035, 0.1, _some(r, 0.01, 0.3))), initial=_either(r, 0, 1)),
    lambda r: B.DeadTime(
        time=r.choice((0.0, 0.002, 0.01, 0.035, _some(r, 0, 0.3))),
        initial=_either(r, 0, 1),
        start=r.choice(("first", "value")),
    ),
]


def _period(r: random.Random) -> float:
    return r.choice((0.01, 0.02, 0.03, 0.05, 0.1))


SAMPLED: list[Make] = [
    lambda r: B.ZeroOrderHold(period=_period(r)),
    lambda r: B.UnitDelay(period=_period(r), initial=_either(r, 0, 1)),
    lambda r: B.DiscreteIntegrator(
        period=_period(r),
        method=r.choice(("forward", "backward", "trapezoidal")),
        gain=_either(r, 0.5, 4),
        initial=_either(r, 0, 1),
    ),
    lambda r: B.DiscretePID(
        period=_period(r),
        kp=_either(r, 0, 1.5),
        ki=r.choice((0.0, 2.0)),
        kd=r.choice((0.0, 0.03)),
        tau=r.choice((0.0, 0.02)),
        low=-0.7,
        high=_some(r, 0.2, 1),
        last=_either(r, 0, 1),
    ),
    lambda r: B.MovingAverage(period=_period(r), length=r.randint(1, 5), initial=_either(r, 0, 1)),
    lambda r: B.DiscreteTransferFunction(
        period=_period(r),
        num=r.choice(((1.0,), (0.5, _either(r, 0, 1)), (0.2, 0.3, 0.4))),
        den=(_some(r, 1, 2), -0.4, _either(r, 0, 0.4)),
        x0=r.choice(((), (0.3, -0.2))),
    ),
    lambda r: B.DiscreteStateSpace(
        period=_period(r),
        A=((0.5, 0.1), (_either(r, 0, 0.5), 0.3)),
        B=((1.0,), (0.4,)),
        C=((1.0, -1.0),),
        D=r.choice(((), ((0.5,),))),
        x0=(0.1, 0.2),
    ),
]
STIFF: list[Make] = [
    lambda r: B.FirstOrderLag(time_constant=r.choice((1e-6, 1e-5, 1e-4))),
    lambda r: B.SecondOrderLag(omega=_some(r, 1e3, 1e5), zeta=_some(r, 0.5, 2)),
]
GROUPS = ((SMOOTH, 4), (BENDING, 5), (LOOPS, 3), (LINEAR, 3), (KINKED, 6), (REMEMBERING, 4), (SAMPLED, 2))
"""Groups of blocks, and how often each is drawn."""
SOFT = {type(make(random.Random(0))).__name__ for make in (*SOURCES[1:4], *BENDING)}
"""Blocks that pass smoothness on."""


@attrs.define(eq=False)
class Drawn:
    """A flat random diagram: blocks, what drives each input, inputs of the diagram, and how it is run."""

    seed: int
    blocks: dict[str, Block]
    driver: dict[Signal, Signal]
    inputs: dict[str, tuple[str, np.ndarray]]
    method: str
    smooth: bool

    def flat(self) -> Flat:
        """As the reference takes it."""
        return Flat(self.blocks, self.driver, tuple(self.inputs))

    def without(self, name: str) -> Drawn | None:
        """The same without one block: what it drove is driven by what drove its first input, or by a constant."""
        blocks = {k: b for k, b in self.blocks.items() if k != name}
        first = next((s for (block, _), s in self.driver.items() if block == name and s[0] != name), None)
        if first is None:
            if type(self.blocks[name]).__name__ == "Constant":
                return None
            blocks[name], first = B.Constant(value=0.37), (name, "y")
        driver = {k: first if s[0] == name else s for k, s in self.driver.items() if k[0] != name}
        return attrs.evolve(self, blocks=blocks, driver=driver) if len(blocks) else None


class _Drawing:
    """A diagram as it grows; signals that are smooth may drive ports whose rate is needed."""

    def __init__(self, seed: int, groups: Iterable[tuple[list[Make], int]]) -> None:
        self.rng = random.Random(seed)
        self.makes = [(make, group) for group, weight in groups for make in [None] * weight]
        self.blocks: dict[str, Block] = {}
        self.driver: dict[Signal, Signal] = {}
        self.signals: list[Signal] = []
        self.smooth: set[Signal] = set()

    def add(self, block: Block, smooth: bool) -> str:
        """Add a block; its outputs may drive what follows."""
        name = f"b{len(self.blocks)}"
        self.blocks[name] = block
        for port in block.outports:
            self.signals.append((name, port))
            if smooth:
                self.smooth.add((name, port))
        return name

    def scaled(self, signal: Signal) -> Signal:
        """A signal behind a gain, which takes any unit to any other."""
        name = self.add(B.Gain(gain=_either(self.rng, 0.3, 1.3)), signal in self.smooth)
        self.driver[name, "u"] = signal
        self.signals.pop()
        return name, "y"

    def drive(self, name: str) -> bool:
        """Drive all inputs of a block; whether all that drives it is smooth."""
        block, rng = self.blocks[name], self.rng
        rates = {port.rate_of for port in block.inports.values() if port.rate_of}
        all_smooth = True
        for port, declared in block.inports.items():
            if declared.rate_of:
                continue
            pool = [s for s in self.signals if s in self.smooth] if port in rates else self.signals
            signal = rng.choice([s for s in pool if s[0] != name])
            self.driver[name, port] = self.scaled(signal)
            all_smooth = all_smooth and signal in self.smooth
        return all_smooth


def drawn(seed: int) -> Drawn:
    """The random diagram of a seed."""
    rng = random.Random(f"diagram {seed}")
    stiff = rng.random() < 0.05
    smooth_only = rng.random() < 0.12
    groups = [(SMOOTH, 3), (BENDING, 4)] if smooth_only else [*GROUPS, *([(STIFF, 3)] if stiff else [])]
    one = _Drawing(seed, groups)
    for _ in range(rng.randint(1, 2)):
        make = one.rng.choice(SOURCES[1:4] if smooth_only else SOURCES)
        block = make(one.rng)
        one.add(block, type(block).__name__ in SOFT)
    one.add(SOURCES[1](one.rng), True)
    inputs = {}
    for k in range(rng.randint(0, 2) if not smooth_only else 0):
        hold = rng.choice(("zero", "linear", "cubic"))
        wave = np.round(np.cumsum(np.random.default_rng(seed + k).normal(0, 0.15, STEPS + 1)), 3)
        inputs[f"in{k}"] = (hold, wave)
        one.signals.append(("", f"in{k}"))
        if hold != "zero":
            one.smooth.add(("", f"in{k}"))
    pools, weights = zip(*groups, strict=True)
    closing = _open_sums(one, rng)
    for _ in range(rng.randint(1, 8)):
        pool = rng.choices(pools, weights)[0]
        block = rng.choice(pool)(one.rng)
        name = one.add(block, False)
        made = [one.signals.pop() for _ in block.outports]
        all_smooth = one.drive(name)
        one.signals += made
        if pool is SMOOTH or (pool is BENDING and all_smooth and type(block).__name__ in SOFT):
            one.smooth |= set(made)
    _close(one, rng, closing)
    method = rng.choice(("sdirk2", "sdirk3", "sdirk4")) if stiff else rng.choice(("rk4", "rk4", "euler", "heun"))
    return Drawn(seed, one.blocks, one.driver, inputs, method, smooth_only)


def _open_sums(one: _Drawing, rng: random.Random) -> list[str]:
    """Sums whose second input closes a loop, once there are signals that can."""
    names = []
    for _ in range(rng.choice((0, 0, 1, 1, 2))):
        name = one.add(B.Sum(signs="+-"), False)
        made = one.signals.pop()
        one.driver[name, "plus"] = one.scaled(one.rng.choice(one.signals))
        one.signals.append(made)
        names.append(name)
    return names


def _close(one: _Drawing, rng: random.Random, names: list[str]) -> None:
    """Close loops through gains, some of them through a bounded block."""
    for name in names:
        signal = rng.choice(one.signals)
        for make in rng.choice(([], [B.Tanh], [B.Saturation])):
            limit = one.add(make() if make is B.Tanh else B.Saturation(low=-1.0, high=1.5), False)
            one.driver[limit, "u"] = one.scaled(signal)
            signal = (limit, "y")
        gain = one.add(B.Gain(gain=_either(rng, 0.1, 0.9)), False)
        one.driver[gain, "u"] = signal
        one.driver[name, "minus"] = (gain, "y")


def as_diagram(made: Drawn) -> Diagram:
    """The diagram on one level; every signal that nothing reads is an output."""
    return _diagram(made.blocks, made.driver, list(made.inputs), _ends(made.blocks, made.driver), "flat")


def _ends(blocks: dict[str, Any], driver: dict[Signal, Signal]) -> dict[str, Signal]:
    read = set(driver.values())
    ends = [(n, p) for n, b in blocks.items() for p in b.outports if (n, p) not in read]
    return {f"{n}_{p}": (n, p) for n, p in ends or [(n, p) for n, b in blocks.items() for p in b.outports][-1:]}


def _diagram(
    blocks: dict[str, Any], driver: dict[Signal, Signal], inputs: list[str], shown: dict[str, Signal], title: str
) -> Diagram:
    ends: dict[str, list[str]] = {name: [] for name in inputs}
    wires = []
    for (block, port), (source, name) in driver.items():
        if source:
            wires.append(f"{source}.{name} -> {block}.{port}")
        else:
            ends[name].append(f"{block}.{port}")
    outputs = {name: f"{block}.{port}" for name, (block, port) in shown.items()}
    return Diagram(title=title, blocks=blocks, wires=wires, inputs=ends, outputs=outputs)


def nested(made: Drawn) -> Diagram:
    """The same with some of its blocks in a diagram inside, and some of these in another one inside that."""
    rng = random.Random(f"nested {made.seed}")
    blocks, driver = dict[str, Any](made.blocks), dict(made.driver)
    for depth in ("inner", "outer"):
        chosen = [n for n in blocks if rng.random() < 0.5]
        if not chosen or len(chosen) == len(blocks):
            continue
        blocks, driver = _grouped(blocks, driver, chosen, depth)
    shown = {f"{n}_{p}": (n, p) for n, p in [(n, p) for n, b in blocks.items() for p in _outports(b)]}
    return _diagram(blocks, driver, list(made.inputs), shown, "nested")


def _outports(block: Any) -> list[str]:
    return list(block.outputs) if isinstance(block, Diagram) else list(block.outports)


def _grouped(blocks: dict[str, Any], driver: dict[Signal, Signal], chosen: list[str], name: str) -> tuple[Any, Any]:
    """Blocks and drivers with the chosen blocks in a diagram of that name."""
    into: dict[Signal, str] = {}
    inner, outer, inputs = {}, {}, dict[str, Signal]()
    shown = {f"{n}_{p}": (n, p) for n in chosen for p in _outports(blocks[n])}
    for (block, port), source in driver.items():
        inside = source[0] in chosen
        moved = (name, f"{source[0]}_{source[1]}") if inside else source
        if block not in chosen:
            outer[block, port] = moved
        elif inside:
            inner[block, port] = source
        else:
            key = into.setdefault(source, f"u{len(into)}")
            inputs[key] = source
            inner[block, port] = ("", key)
    group = _diagram({n: blocks[n] for n in chosen}, inner, list(inputs), shown, name)
    outer |= {(name, key): source for key, source in inputs.items()}
    return {**{n: b for n, b in blocks.items() if n not in chosen}, name: group}, outer
