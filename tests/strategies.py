"""Random sound diagrams that run: real blocks, feedback through lags, diagrams inside, shared values."""

from __future__ import annotations

from hypothesis import strategies as st

from tsmblocks.blocks import (
    PID,
    Abs,
    Constant,
    DeadZone,
    Delay,
    FirstOrderLag,
    Gain,
    Integrator,
    Minimum,
    Product,
    Ramp,
    Saturation,
    SecondOrderLag,
    Sine,
    Sum,
    TransferFunction,
    UnitDelay,
    ZeroOrderHold,
)
from tsmblocks.model.block import is_reference, map_leaves
from tsmblocks.model.diagram import Diagram

SMALL = st.floats(-2.0, 2.0).map(lambda v: round(v, 3))
POSITIVE = st.floats(0.05, 2.0).map(lambda v: round(v, 3))

SOURCES = st.one_of(
    st.builds(Constant, value=SMALL), st.builds(Ramp, slope=SMALL), st.builds(Sine, amplitude=SMALL, frequency=POSITIVE)
)
LAGS = st.one_of(
    st.builds(FirstOrderLag, gain=SMALL, time_constant=POSITIVE, value=SMALL),
    st.builds(SecondOrderLag, gain=SMALL, omega=POSITIVE, zeta=POSITIVE),
    st.builds(Integrator, gain=SMALL, integral=SMALL),
    st.builds(TransferFunction, num=st.tuples(SMALL), den=st.tuples(POSITIVE, POSITIVE, POSITIVE)),
    st.builds(UnitDelay, period=st.sampled_from([0.01, 0.02]), initial=SMALL),
)
"""Blocks through which a loop may be closed: no output follows its input at once."""
OTHERS = st.one_of(
    LAGS,
    st.builds(Gain, gain=SMALL),
    st.builds(Gain, gain=st.just("$shared")),
    st.builds(Saturation, low=SMALL.map(lambda v: v - 4.1), high=SMALL),
    st.builds(DeadZone, low=POSITIVE.map(lambda v: -v), high=POSITIVE),
    st.builds(Sum, signs=st.text("+-", min_size=1, max_size=3)),
    st.builds(Product, n=st.just(2)),
    st.builds(Minimum, n=st.integers(1, 3)),
    st.builds(Abs),
    st.builds(Delay, time=st.sampled_from([0.005, 0.0123]), initial=SMALL),
    st.builds(ZeroOrderHold, period=st.just(0.01)),
    st.builds(PID, kp=SMALL, ki=SMALL, tau=POSITIVE),
)


@st.composite
def diagrams(draw, depth=2, inputs=0, title="random"):
    """A sound diagram with ``inputs`` inputs and at least one output."""
    blocks = {f"source{k}": b for k, b in enumerate(draw(st.lists(SOURCES, min_size=1, max_size=2)))}
    lags = {f"lag{k}": b for k, b in enumerate(draw(st.lists(LAGS, max_size=2)))}
    blocks |= lags
    driven = {f"in{k}": [] for k in range(inputs)}
    signals = [f"{n}.{p}" for n, b in blocks.items() for p in b.outports] + list(driven)
    wires = []

    def drive(name, block):
        for port in block.inports:
            signal = draw(st.sampled_from(signals))
            if signal in driven:
                driven[signal].append(f"{name}.{port}")
            else:
                wires.append(f"{signal} -> {name}.{port}")

    for k in range(draw(st.integers(0, 5))):
        inner = depth > 0 and draw(st.integers(0, 4)) == 0
        name = f"part{k}"
        block = draw(diagrams(depth - 1, draw(st.integers(0, 2)), title=name) if inner else OTHERS)
        drive(name, block)
        blocks[name] = block
        signals += [f"{name}.{p}" for p in block.outports]
    for name, block in lags.items():  # last, so that loops may close through them
        drive(name, block)
    shown = draw(st.lists(st.sampled_from(signals), min_size=1, max_size=3))
    outputs = {f"out{k}": s for k, s in enumerate(shown)}
    return Diagram(
        title=title, blocks=blocks, wires=wires, inputs=driven, outputs=outputs, values={"shared": draw(SMALL)}
    )


def flattened_by_hand(diagram, prefix="", drivers=None):
    """Blocks, (source, target) pairs and outputs of a diagram on one level, without the package's own help.

    ``drivers`` says which signals of the outermost level drive the inputs. Diagrams inside must stand
    in the order in which signals run through them, as ``diagrams`` makes them.
    """
    blocks, pairs, shown = {}, [], {}
    into = {name: {} for name in diagram.blocks}
    for link in diagram.links:
        into[link.target[0]][link.target[1]] = link.source
    for key, ends in diagram.inlets.items():
        for name, port in ends:
            into[name][port] = ("", key)

    def source(end):
        """The signal of the outermost level that a signal of this one is."""
        name, port = end
        if not name:
            return drivers[port]
        return shown[name][port] if name in shown else f"{prefix}{name}.{port}"

    for name, block in diagram.blocks.items():
        if isinstance(block, Diagram):
            driving = {port: source(end) for port, end in into[name].items()}
            more, wires, shown[name] = flattened_by_hand(block, f"{prefix}{name}__", driving)
            blocks |= more
            pairs += wires
    for name, block in diagram.blocks.items():
        if not isinstance(block, Diagram):
            blocks[prefix + name] = with_numbers(block, diagram.values)
            pairs += [(source(end), f"{prefix}{name}.{port}") for port, end in into[name].items()]
    return blocks, pairs, {key: source(end) for key, end in diagram.shown.items()}


def with_numbers(block, values):
    """A block with the numbers themselves where it refers to values."""
    given = {
        key: map_leaves(lambda _, v: values[v[1:]] if is_reference(v) else v, value)
        for key, value in block.parameters.items()
    }
    return block.replace(**given)
