"""The promise on algebraic loops: closed from an output back to an input, a block is solved as its equations say."""

from __future__ import annotations

from collections.abc import Callable, Iterator

import attrs
import casadi as ca

from tsmblocks.blocks import Gain, Sum
from tsmblocks.compiler.dependencies import structure_of
from tsmblocks.engine.equations import function_values
from tsmblocks.model.block import Block
from tsmblocks.model.diagram import Diagram, Inlet
from tsmblocks.simulation.compiled import equations, parameter_vector
from tsmblocks.testing.promises import equations_as_numbers, is_singular, need, parameter_values, promise

TIME, POINT, APART = 0.1, 0.3142, 0.1271
"""Where loops are closed: time [s], first input, distance of the others. Chosen: away from corners,
which are at round numbers."""
GAIN = -0.5
"""Gain around a loop. Chosen: below 1 in size, so that there is one solution nearby."""
NUDGE = 1e-6
"""Half of the difference that derivatives are compared with. Chosen."""
CLOSE = 1e-9
"""Share by which a solution may be off. Chosen: far above rounding."""
SLOPE_CLOSE = 1e-5
"""Share by which a derivative may differ from a difference. Chosen: above what NUDGE leaves."""


@promise
def closes_an_algebraic_loop(block: Block) -> None:
    """A loop from an output back to an input that reaches it at once has the solution and the derivative it should."""
    if is_singular(block) or block.sampled or block.past_ports:
        return  # infinite somewhere; a loop at samples, or through the past
    for inlet, outlet in _paths(block):
        _check(block, inlet, outlet)


def _paths(block: Block) -> Iterator[tuple[str, str]]:
    """Inputs, and outputs that depend on them at the same instant."""
    for outlet, needs in structure_of(block).outputs.items():
        yield from ((inlet, outlet) for inlet in block.inports if inlet in needs)


@attrs.frozen(eq=False)
class _Path:
    """A path from an input to an output: ``output(u)`` with all else at one value, and where that is."""

    output: Callable[[float], float]
    point: float

    def slope(self, at: float) -> tuple[float, bool]:
        """The derivative there, and whether it is the same on both sides."""
        low, middle, high = (self.output(at + d) for d in (-NUDGE, 0.0, NUDGE))
        left, right = (middle - low) / NUDGE, (high - middle) / NUDGE
        return (high - low) / (2 * NUDGE), abs(right - left) <= 1e-3 * (abs(left) + abs(right))


def _path(block: Block, inlet: str, outlet: str) -> _Path:
    names, tapes = list(block.read_names), block.tape_ports
    given = [0.0 if name in tapes else POINT + APART * k for k, name in enumerate(names)]
    evaluate, results = equations_as_numbers(block)
    numbers = parameter_values(block)
    states = [float(state.start) for state in block.states.values()]
    place, row = names.index(inlet), results.index(f"y.{outlet}")

    def output(u: float) -> float:
        return float(evaluate(TIME, states, [u if k == place else v for k, v in enumerate(given)], numbers)[row])

    return _Path(output, given[place])


def _check(block: Block, inlet: str, outlet: str) -> None:
    """Close the loop and compare it with its equation u = r + gain * output(u), and with the root that SciPy finds."""
    from scipy.optimize import brentq

    path, where = _path(block, inlet, outlet), f"a loop from {type(block).__name__}.{outlet} to {inlet}"
    slope = path.slope(path.point)[0]
    gain = GAIN / max(abs(slope), abs(path.output(path.point)), 1.0) * (1.0 if slope >= 0 else -1.0)
    r = path.point - gain * path.output(path.point)
    found, derivative = _solved(block, inlet, outlet, gain, r)

    def missing(u: float) -> float:
        return u - r - gain * path.output(u)

    size = 1.0 + abs(found) + abs(r)
    need(abs(missing(found)) < CLOSE * size, f"{where} is off by {missing(found):.3g} at {inlet}={found:g}.")
    ends = found - 1e-3 * size, found + 1e-3 * size
    if missing(ends[0]) * missing(ends[1]) < 0:
        root = brentq(missing, *ends, xtol=1e-14, rtol=1e-14)
        need(abs(found - root) < CLOSE * size, f"{where} gives {inlet}={found:.12g}, the root is {root:.12g}.")
    steep, smooth = path.slope(found)
    if smooth:
        expected = 1.0 / (1.0 - gain * steep)
        same = abs(derivative - expected) < SLOPE_CLOSE * (1.0 + abs(expected))
        need(same, f"{where}: the derivative of {inlet} is {derivative:.9g}, by differences {expected:.9g}.")


def _solved(block: Block, inlet: str, outlet: str, gain: float, r: float) -> tuple[float, float]:
    """The input in a closed loop, and its derivative with respect to what is added there."""
    others = {f"in_{k}": Inlet(f"b.{k}") for k in block.inports if k != inlet}
    closed = Diagram(
        title=f"a loop around {type(block).__name__}",
        blocks={"b": block, "g": Gain(gain=gain), "s": Sum(signs="++")},
        wires=[f"b.{outlet} -> g -> s.plus2", f"s -> b.{inlet}"],
        inputs={"r": Inlet("s.plus1"), **others},
    )
    eq = equations(closed)
    values = {f"in_{name}": POINT + APART * k for k, name in enumerate(block.read_names)} | {"r": r}
    u = [0.0 if feed.block or feed.order else values[feed.name] for feed in eq.u]
    place = [feed.name for feed in eq.u].index("r")
    p = parameter_vector(eq, closed)
    x, d = function_values(eq.start, p)[:2]
    symbols = ca.MX.sym("u", len(u))
    signals = eq.rhs(TIME, x, d, symbols, ca.DM(0, 1), p)[1]
    row = eq.y.index("s.y")
    f = ca.Function("f", [symbols], [signals[row], ca.jacobian(signals[row], symbols)[place]])
    made, derivative = f(u)
    return float(made), float(derivative)
