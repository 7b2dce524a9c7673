"""One small diagram for each block: drawn on its page, run for its chart, and listed as file and script."""

from __future__ import annotations

import math
import re
from typing import Any

from tsmblocks.blocks import Chirp, Constant, MultiSine, Ramp, Sine, Staircase, Step, Triangle
from tsmblocks.model.block import Block
from tsmblocks.model.diagram import Diagram
from tsmblocks.simulation.run import Run
from tsmblocks.simulation.simulate import simulate

STOP, STEP = 10.0, 1e-3
SINE = {"": 1.0, "rad": 0.96, "rad/s": 2.0, "V": 6.0}
"""Amplitude of the sine that drives a port, by the port's unit, where ``DRIVE`` has no other source."""
TWO = MultiSine(amplitudes=(0.6, 0.36), frequencies=(0.2, 0.5))
"""Large and small reversals, for blocks that remember them."""
SLOW = MultiSine(amplitudes=(0.6, 0.36), frequencies=(0.2, 0.5), unit="rad")
SET: dict[str, dict[str, Any]] = {
    "Bend": dict(cubic=-0.2),
    "Bias": dict(bias=0.3),
    "GainError": dict(error=0.2),
    "Bow": dict(size=0.2),
    "BroadCreep": dict(share=0.3, fastest=0.2, slowest=20.0),
    "Creep": dict(share=0.3, time_constant=2.0),
    "DeadTime": dict(time=0.3),
    "Delay": dict(time=0.3),
    "DeadZone": dict(low=-0.3, high=0.3),
    "EndStops": dict(low=-0.6, high=0.6, stiffness=50.0, damping=2.0),
    "Disturbance": dict(sine=0.1, frequency=2.0),
    "Drift": dict(rate=0.05),
    "Gain": dict(gain=2.0),
    "GainChange": dict(change=0.3, time=5.0),
    "GainDrift": dict(rate=0.03),
    "HeatedGain": dict(change=0.3, time_constant=2.0),
    "SettlingGain": dict(change=0.3, time_constant=3.0),
    "SettlingOffset": dict(size=0.3, time_constant=3.0),
    "TemporaryGain": dict(change=0.3, time=4.0, until=7.0),
    "TemporaryOffset": dict(size=0.3, time=4.0, until=7.0),
    "Jump": dict(size=0.2, time=5.0),
    "Lag": dict(time_constant=0.5),
    "LoopAsymmetry": dict(slope_difference=0.2, delta=0.3),
    "LoopChange": dict(change=0.2, gain=0.2, time=5.0),
    "NonlocalMemory": dict(weights=(0.3, 0.3, 0.3)),
    "PositionDependentLoop": dict(gain=0.4),
    "Stretch": dict(half_width=0.2),
    "StribeckStretch": dict(half_width=0.1, breakaway=0.2),
    "RateDependence": dict(coefficient=0.2),
    "Resonance": dict(share=1.0, omega=12.0),
    "Ripple": dict(sine=0.05, cycles=12.0),
    "Slack": dict(share=0.5, edge=-0.3),
    "Overflow": dict(rim=0.5, rate=1.0, caught=1.0),
    "Saturation": dict(low=-0.6, high=0.6),
    "SoftSaturation": dict(low=-0.6, high=0.6, softness=0.1),
    "RateLimit": dict(rising=0.8, falling=-0.8),
    "SoftRateLimit": dict(rising=0.8, falling=-0.8, softness=0.05),
    "Relay": dict(on=0.4, off=-0.4, high=1.0, low=-1.0),
    "Quantiser": dict(interval=0.25),
    "Encoder": dict(counts=24.0),
    "SensorNoise": dict(std=0.05, interval=0.02),
    "LeadLag": dict(lead=0.5, lag=0.05),
    "Chirp": dict(duration=10.0),
    "FilteredDerivative": dict(time_constant=0.05),
    "FirstOrderLag": dict(time_constant=0.5),
    "SecondOrderLag": dict(omega=8.0, zeta=0.2),
    "TransferFunction": dict(num=(1.0,), den=(0.1, 0.2, 1.0)),
    "ZeroPoleGain": dict(zeros=(-10.0,), poles=(-20.0,), pole_pairs=((-3.0, 4.0),), gain=50.0),
    "StateSpace": dict(A=((0.0, 1.0), (-100.0, -2.0)), B=((0.0,), (100.0,)), C=((1.0, 0.0),)),
    "DiscreteIntegrator": dict(period=0.2),
    "DiscretePID": dict(period=0.2, kp=1.5, ki=2.0, kd=0.2),
    "DiscreteStateSpace": dict(period=0.2, A=((0.9,),), B=((0.1,),), C=((1.0,),)),
    "DiscreteTransferFunction": dict(period=0.2, num=(0.1,), den=(1.0, -0.9)),
    "MovingAverage": dict(period=0.2),
    "UnitDelay": dict(period=0.2),
    "ZeroOrderHold": dict(period=0.2),
    "PID": dict(kp=1.5, ki=2.0, kd=0.2, tau=0.05),
    "PIDController": dict(kp=1.5, ki=2.0, low=-24.0, high=24.0),
    "Random": dict(interval=0.05),
    "Recorded": dict(times=(0.0, 2.0, 5.0, 8.0, 10.0), values=(0.0, 1.0, -1.0, 0.5, 0.0)),
    "Ramp": dict(start=2.0, slope=0.5),
}
"""Parameters that make a block's effect visible where its defaults do not (an unreached limit, a zero size)."""


OTHER_PORTS: dict[str, dict[str, Any]] = {
    **{name: dict(n=3) for name in ("Product", "Minimum", "Maximum", "Logic")},
    "DCMotor": dict(load=True),
    "DiscreteStateSpace": dict(A=((0.5,),), B=((1.0, 2.0),), C=((1.0,), (2.0,))),
    "Enable": dict(restart="reset"),
    "Integrator": dict(reset=True, target=True, enable=True),
    "StateMachine": dict(
        modes=("off", "slow", "fast"), signals=("u", "v"), transitions=("off -> slow: u > 1", "slow -> fast: v > 1")
    ),
    "StateSpace": dict(A=((-1.0,),), B=((1.0, 2.0),), C=((1.0,), (2.0,))),
    "Sum": dict(signs="++-"),
}
"""Options and lists with which a block has other ports than by default, for each block that has such."""


def _all(port: str, source: Block, names: str) -> dict[str, dict[str, Block]]:
    """The same source at the port of several blocks."""
    return {name: {port: source} for name in names.split()}


DRIVE: dict[str, dict[str, Block]] = {
    **_all("u", TWO, "CapstanFriction Play TaoBacklash PrandtlIshlinskii NonlocalMemory Stretch StribeckStretch"),
    **_all(
        "x", SLOW, "AsymmetricBoucWen BoucWen DahlHysteresis ElasticBacklash GeneralizedBoucWen FeedforwardCompensator"
    ),
    **_all(
        "u",
        Step(),
        "FirstOrderLag SecondOrderLag TransferFunction StateSpace ZeroPoleGain LeadLag Resonance "
        "FilteredDerivative DiscreteStateSpace DiscreteTransferFunction",
    ),
    **_all("e", Triangle(amplitude=1.0), "PID DiscretePID"),
    "Maximum": {"u1": Sine(amplitude=1.0), "u2": Sine(amplitude=0.6, frequency=0.5)},
    "Minimum": {"u1": Sine(amplitude=1.0), "u2": Sine(amplitude=0.6, frequency=0.5)},
    "BroadCreep": {"u": Staircase(height=0.5, dwell=2.0, up=1, down=1)},
    "Creep": {"u": Staircase(height=0.5, dwell=2.0, up=1, down=1)},
    **_all("u", Step(time=0.05, after=6.0, unit="V"), "DCMotor MotorTransferFunction"),
    "Divide": {"num": Sine(amplitude=1.0), "den": Ramp(start=2.0, slope=0.5, initial=1.0)},
    "LoopAsymmetry": {"u": Sine(amplitude=1.0), "x": Sine(amplitude=1.0)},
    "PositionDependentLoop": {"u": Sine(amplitude=1.0), "x": Sine(amplitude=1.0)},
    "Overflow": {"u": Constant(value=1.0), "x": Triangle(amplitude=1.0)},
    "PIDController": {"r": Step(after=1.0), "ym": Ramp(start=1.0, slope=0.2)},
    "Product": {"u1": Sine(amplitude=1.0), "u2": Ramp(slope=0.1)},
    "RateDependence": {"u": Chirp(amplitude=1.0, f1=1.0, duration=10.0)},
    "Sum": {"plus": Sine(amplitude=1.0), "minus": Step(time=5.0, after=0.5)},
    "LookupTable2D": {"u1": Sine(amplitude=1.8, offset=1.5), "u2": Ramp(slope=0.5)},
    "Logic": {"u1": Sine(amplitude=1.0), "u2": Sine(amplitude=1.0, frequency=0.5)},
    "TriggeredHold": {"u": Sine(amplitude=1.0), "trigger": Sine(amplitude=1.0, frequency=0.7)},
    "Switch": {"u1": Sine(amplitude=1.0), "u2": Constant(value=0.5), "control": Step(time=5.0)},
}
STOPS = dict(DCMotor=0.3, MotorTransferFunction=0.3, StateSpace=5.0, ZeroPoleGain=3.0, SecondOrderLag=4.0, Step=3.0)
"""Duration of the runs [s] that are not ``STOP`` long."""

STEPS = {"DCMotor": 2e-5}
"""Steps of the runs for which ``STEP`` is too long [s]."""


def snake(name: str) -> str:
    """``PIDController`` as ``pid_controller``, the name its block has in an example."""
    return re.sub(r"(?<=[a-z])(?=[A-Z])|(?<=[A-Z])(?=[A-Z][a-z])", "_", name).lower()


def example(cls: type[Block]) -> Diagram:
    """A block of a class with a source at each input, its inputs and outputs named as its ports are."""
    name = cls.__name__
    block, label = cls(**SET.get(name, {})), snake(name)
    given = DRIVE.get(name, {})
    ports = {k: port for k, port in block.inports.items() if k in given or not port.rate_of}
    sources = {k: given.get(k) or _sine(port.unit) for k, port in ports.items()}
    named = {k: f"{k}_source" if len(sources) > 1 else snake(type(source).__name__) for k, source in sources.items()}
    return Diagram(
        title=f"An example of {name}",
        blocks={**{named[k]: source for k, source in sources.items()}, label: block},
        wires=[f"{named[k]} -> {label}.{k}" for k in sources],
        outputs={**named, **{k: f"{label}.{k}" for k in block.outports}},
    )


def _sine(unit: str) -> Sine:
    unit = "" if "?" in unit else unit
    return Sine(amplitude=SINE.get(unit, 1.0), unit=unit)


def stop_of(cls: type[Block]) -> float:
    """Duration of the example's run [s]."""
    return STOPS.get(cls.__name__, STOP)


def run(cls: type[Block]) -> Run:
    """The example, run."""
    return simulate(example(cls), stop=stop_of(cls), step=STEPS.get(cls.__name__, STEP))


def script(diagram: Diagram, stop: float = STOP) -> str:
    """A diagram of one level as a Python script that assembles and runs it."""
    used = sorted({type(b).__name__ for b in diagram.blocks.values()}, key=str.lower)
    blocks = [f"        {name}={made(block)}," for name, block in diagram.blocks.items() if isinstance(block, Block)]
    wires = [f'        "{wire}",' for wire in diagram.wires]
    shown = [f'        "{name}": "{".".join(filter(None, end))}",' for name, end in diagram.shown.items()]
    step = next((STEPS[name] for name in used if name in STEPS), STEP)
    lines = [
        "import tsmblocks as tsm",
        f"from tsmblocks.blocks import {', '.join(used)}",
        "",
        "diagram = tsm.Diagram(",
        f'    title="{diagram.title}",',
        *("    blocks=dict(", *blocks, "    ),"),
        *(("    wires=[", *wires, "    ],") if wires else ()),
        *("    outputs={", *shown, "    },"),
        ")",
        f"run = tsm.simulate(diagram, stop={stop:g}, step={step:g})",
    ]
    return "\n".join(lines) + "\n"


def made(block: Block) -> str:
    """A block as code: its class and the arguments that differ from their defaults."""
    given = {k: getattr(block, k) for k, f in block.fields().items() if getattr(block, k) != f.default}
    return f"{type(block).__name__}({', '.join(f'{k}={_value(v)}' for k, v in given.items())})"


def _value(value: Any) -> str:
    if isinstance(value, tuple):
        return f"({', '.join(map(_value, value))}{',' if len(value) == 1 else ''})"
    if isinstance(value, float):
        return f'float("{value}")' if math.isinf(value) else repr(value)
    return f'"{value}"' if isinstance(value, str) else repr(value)
