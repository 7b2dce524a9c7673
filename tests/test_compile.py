"""From a diagram to equations: order, feedthrough per port and through hierarchy, no false alarms."""

import casadi as ca
import numpy as np
import pytest

import tsmblocks.blocks  # noqa: F401 - fills the registry
from tsmblocks.blocks import (
    Abs,
    Constant,
    DeadTime,
    Delay,
    Derivative,
    DiscreteIntegrator,
    FirstOrderLag,
    Gain,
    Integrator,
    Product,
    Ramp,
    RateLimit,
    Relay,
    Sine,
    StateSpace,
    Sum,
    Tanh,
    TransferFunction,
    UnitDelay,
    ZeroOrderHold,
)
from tsmblocks.common.errors import AlgebraicLoop
from tsmblocks.compiler.compile import compile_diagram
from tsmblocks.compiler.dependencies import structure_of
from tsmblocks.files import load
from tsmblocks.model.block import REGISTRY, leaves, signals
from tsmblocks.model.diagram import Diagram
from tsmblocks.simulation.simulate import simulate

OURS = {name: cls for name, cls in REGISTRY.items() if cls.__module__.startswith("tsmblocks.")}


def two_ways():
    """A diagram with one output at the same instant and one through an integrator."""
    return Diagram(
        title="two ways",
        blocks=dict(direct=Gain(gain=3.0), slow=Integrator()),
        inputs={"u": ["direct.u", "slow.u"]},
        outputs={"now": "direct", "later": "slow"},
    )


def around(output, part, **more):
    """A loop closed around one output of a part."""
    return Diagram(
        title="around",
        blocks=dict(ref=Constant(value=1.0), error=Sum(), part=part, scale=Gain(), **more),
        wires=["ref -> error.plus", "error -> part.u", f"part.{output} -> scale -> error.minus"],
        outputs={"later": "part.later", "now": "part.now"},
    )


# ---- feedthrough


def test_a_loop_around_the_integrated_output_of_a_part_is_no_algebraic_loop():
    run = simulate(around("later", two_ways()), stop=2.0, step=1e-3)
    assert run["later"] == pytest.approx(1 - np.exp(-run.t), abs=1e-12)
    assert run["now"] == pytest.approx(3 * np.exp(-run.t), abs=1e-12)


@pytest.mark.parametrize("depth", [1, 2, 5])
def test_the_same_through_several_levels(depth):
    part = two_ways()
    for _ in range(depth):
        part = Diagram(
            blocks=dict(inner=part), inputs={"u": "inner.u"}, outputs={"now": "inner.now", "later": "inner.later"}
        )
    run = simulate(around("later", part), stop=0.5, step=1e-3)
    assert run["later"] == pytest.approx(1 - np.exp(-run.t), abs=1e-12)
    with pytest.raises(AlgebraicLoop) as caught:
        compile_diagram(around("now", part), refuse_loops=True)
    assert caught.value.path == ("error.y", f"part.{'inner.' * depth}direct.y", "scale.y", "error.y")


def test_feedthrough_is_per_port_of_a_block_too():
    """A state space with one direct and one integrated output, as one block."""
    part = StateSpace(A=((0.0,),), B=((1.0,),), C=((1.0,), (0.0,)), D=((0.0,), (3.0,)))
    assert structure_of(part).outputs == {"y1": {"u"}, "y2": {"u"}}  # a number given is a number that may change


EXPECTED = [
    (Gain(), {"y": {"u"}}),
    (Sum(signs="+-+"), {"y": {"plus1", "minus", "plus2"}}),
    (Integrator(), {"y": set()}),
    (Integrator(reset=True), {"y": set()}),
    (Derivative(), {"y": {"rate"}}),
    (FirstOrderLag(), {"y": set()}),
    (Delay(), {"y": {"past"}}),
    (TransferFunction(num=(1.0,), den=(1.0, 1.0)), {"y": set()}),
    (TransferFunction(num=(1.0, 0.0), den=(1.0, 1.0)), {"y": {"u"}}),
    (UnitDelay(), {"y": set()}),
    (ZeroOrderHold(), {"y": {"u"}}),
    (DiscreteIntegrator(method="forward"), {"y": set()}),
    (DiscreteIntegrator(method="trapezoidal"), {"y": {"u"}}),
    (Relay(), {"y": set()}),
]


@pytest.mark.parametrize(("block", "expected"), EXPECTED, ids=lambda v: type(v).__name__)
def test_feedthrough_of_known_blocks(block, expected):
    assert structure_of(block).outputs == expected


@pytest.mark.parametrize("name", sorted(OURS))
def test_feedthrough_covers_what_numbers_show(name):
    """Whatever moves an output when it is moved is listed, for ordinary numbers of states and inputs."""
    block = OURS[name]()
    shape, names = structure_of(block), block.read_names
    rng = np.random.default_rng(3)
    for _ in range(20):
        x = signals(list(block.states), list(rng.normal(size=len(block.states))))
        u = rng.normal(size=len(names))
        before = block.outputs(0.3, x, signals(names, list(u)))
        for k, port in enumerate(names):
            moved = u.copy()
            moved[k] += rng.choice([-3.0, 0.1, 3.0])
            after = block.outputs(0.3, x, signals(names, list(moved)))
            seen = {y for y in after if float(after[y]) != float(before[y])}
            assert seen <= {y for y, needs in shape.outputs.items() if port in needs}


@pytest.mark.parametrize("name", sorted(OURS))
def test_feedthrough_is_what_the_expressions_depend_on(name):
    block = OURS[name]()
    twin = block.with_symbols(lambda leaf, value: ca.SX.sym(leaf))
    x = signals(list(block.states), [ca.SX.sym(k) for k in block.states])
    u = signals(block.read_names, [ca.SX.sym(k) for k in block.read_names])
    y = twin.outputs(ca.SX.sym("t"), x, u)
    dx = twin.derivatives(ca.SX.sym("t"), x, u)
    for found, given in ((structure_of(block).outputs, y), (structure_of(block).rates, dx)):
        assert found == {k: {p for p in u._fields if ca.depends_on(ca.SX(v), getattr(u, p))} for k, v in given.items()}


@pytest.mark.parametrize("name", sorted(OURS))
def test_every_block_alone_compiles_to_its_own_equations(name):
    """The equations of a diagram of one block are the block's, with every number still a symbol."""
    block = OURS[name]()
    inputs = {f"in_{k}": f"it.{k}" for k in block.inports}
    eq = compile_diagram(Diagram(title=name, blocks=dict(it=block), inputs=inputs))
    assert set(eq.p) == {f"it.{leaf}" for k, v in block.parameters.items() for leaf, _ in leaves(v, k)}
    assert set(eq.x) == {f"it.{k}" for k in structure_of(block).continuous}
    assert {k for k in eq.y if k.startswith("it.")} >= {f"it.{k}" for k in block.outports}


# ---- hierarchy


def servo(k):
    """A lag with feedback; an input and an output."""
    return Diagram(
        title="servo",
        blocks=dict(error=Sum(), lag=FirstOrderLag(gain=k), turn=Gain(gain=0.5)),
        wires=["error -> lag -> turn -> error.minus"],
        inputs={"r": "error.plus"},
        outputs={"y": "lag"},
    )


def test_nesting_equals_flat():
    nested = Diagram(
        blocks=dict(ref=Sine(), first=servo(2.0), second=servo(3.0)),
        wires=["ref -> first -> second"],
        outputs={"y": "second"},
    )
    flat = Diagram(
        blocks=dict(
            ref=Sine(),
            e1=Sum(),
            l1=FirstOrderLag(gain=2.0),
            t1=Gain(gain=0.5),
            e2=Sum(),
            l2=FirstOrderLag(gain=3.0),
            t2=Gain(gain=0.5),
        ),
        wires=["ref -> e1.plus", "e1 -> l1 -> t1 -> e1.minus", "l1 -> e2.plus", "e2 -> l2 -> t2 -> e2.minus"],
        outputs={"y": "l2"},
    )
    a, b = simulate(nested, stop=2.0), simulate(flat, stop=2.0)
    assert a["y"] == pytest.approx(b["y"], rel=0, abs=1e-13)
    assert a["first.lag.value"] == pytest.approx(b["l1.value"], rel=0, abs=1e-13)


def test_a_part_that_is_pure_algebra_adds_no_delay():
    square = Diagram(blocks=dict(p=Product()), inputs={"a": ["p.u1", "p.u2"]}, outputs={"b": "p"})
    twice = Diagram(blocks=dict(p=square, k=Gain(gain=2.0)), wires=["p -> k"], inputs={"a": "p.a"}, outputs={"b": "k"})
    run = simulate(
        Diagram(blocks=dict(ramp=Ramp(), part=twice, q=Abs()), wires=["ramp -> part -> q"], outputs={"y": "q"}),
        stop=1.0,
    )
    assert run["y"] == pytest.approx(2 * run["ramp.y"] ** 2, rel=0, abs=0)
    assert run["y"][-1] > 0


def test_a_signal_may_pass_straight_through_a_diagram():
    through = Diagram(blocks={}, inputs={"i": ()}, outputs={"o": "i"})
    deep = Diagram(blocks=dict(a=through, b=through), wires=["a -> b"], inputs={"i": "a.i"}, outputs={"o": "b.o"})
    run = simulate(Diagram(blocks=dict(ref=Sine(), t=deep, k=Gain()), wires=["ref -> t -> k"]), stop=0.1)
    assert (run["k.y"] == run["ref.y"]).all()


@pytest.mark.parametrize("read", [True, False])
def test_a_ring_of_diagrams_that_hold_no_block_is_found_whether_or_not_it_is_read(read):
    through = Diagram(blocks={}, inputs={"i": ()}, outputs={"o": "i"})
    ring = Diagram(
        title="ring",
        blocks=dict(a=through, b=through, **({"k": Gain()} if read else {})),
        wires=["a -> b -> a", *(["b -> k"] if read else [])],
    )
    with pytest.raises(AlgebraicLoop) as caught:
        compile_diagram(ring)
    path = caught.value.path
    assert path[0] == path[-1]
    flow = ["a.i", "a.o", "b.i", "b.o"]
    start = flow.index(path[0])
    assert list(path[:-1]) == flow[start:] + flow[:start]


# ---- size and order


def test_a_chain_of_thousands_needs_no_recursion():
    n = 3000
    blocks = dict(ref=Sine(), **{f"k{i}": Gain() for i in range(n)})
    eq = compile_diagram(Diagram(blocks=blocks, wires=["ref -> " + " -> ".join(f"k{i}" for i in range(n))]))
    assert len(eq.y) == n + 1


def test_blocks_and_wires_may_be_given_in_any_order():
    blocks = dict(ref=Sine(), e=Sum(), lag=FirstOrderLag(), k=Gain(gain=2.0), d=Derivative())
    wires = ["ref -> e.plus", "e -> lag", "lag -> k", "k -> e.minus", "lag -> d"]
    one = simulate(Diagram(blocks=blocks, wires=wires), stop=1.0)
    other = simulate(Diagram(blocks=dict(reversed(blocks.items())), wires=wires[::-1]), stop=1.0)
    for name in one:
        assert one[name] == pytest.approx(other[name], rel=0, abs=1e-13)


# ---- what the equations say of the diagram


def looped(block, **more):
    """A sum with a loop through a block, without a state, and a sampled branch beside it."""
    return Diagram(
        title="around",
        blocks={"s": Sum(), "g": block, "z": ZeroOrderHold(period=0.1), "i": Integrator(), **more},
        inputs={"u": "s.plus"},
        wires=["s -> g -> s.minus", "s -> z -> i"],
        outputs={"y": "i"},
    )


def test_a_loop_is_refused_only_where_that_is_asked_for():
    assert compile_diagram(looped(Gain(gain=0.5))).loops
    with pytest.raises(AlgebraicLoop):
        compile_diagram(looped(Gain(gain=0.5)), refuse_loops=True)


def test_signals_are_inputs_outputs_and_states_and_no_held_sample():
    diagram = looped(Gain(gain=0.5))
    eq = compile_diagram(diagram)
    ends = {f"{name}.{end}" for name, b in diagram.blocks.items() for end in (*b.outports, *b.states)}
    assert set(eq.y) == {"u"} | ends
    assert len(eq.y) == len(set(eq.y))
    assert eq.d == ("z.y (held)",)


def test_units_are_those_of_signals_and_those_declared_of_states():
    diagram = Diagram(
        title="units",
        blocks={"drive": Ramp(unit="V"), "lag": FirstOrderLag(), "late": RateLimit(), "free": Integrator()},
        inputs={"u": "free"},
        wires=["drive -> lag", "lag -> late"],
        outputs={"y": "lag"},
    )
    units = compile_diagram(diagram).units
    assert units["late.time"] == "s"  # declared
    assert units["drive.y"] == "V"
    assert "free.integral" not in units  # of an input without a unit
    assert all(unit and "?" not in unit for unit in units.values())


def test_tapes_are_those_of_blocks_that_read_one():
    diagram = load("fig16_feedforward_feedback")
    blocks = compile_diagram(diagram).reads
    read = {name for name, b in diagram.blocks.items() if getattr(b, "tape_ports", ())}
    assert set(compile_diagram(diagram).tapes) == read < set(blocks)


def test_a_delay_may_be_one_step_where_its_output_needs_it_and_none_where_it_does_not():
    one = Diagram(title="d", blocks={"d": DeadTime(time=0.01)}, inputs={"u": "d"}, outputs={"y": "d"})
    assert compile_diagram(one).min_delay_steps == (0,)
    loop = Diagram(
        title="loop",
        blocks={"d": Delay(time=0.01), "s": Sum()},
        inputs={"u": "s.plus"},
        wires=["s -> d -> s.minus"],
        outputs={"y": "s"},
    )
    assert compile_diagram(loop).min_delay_steps == (1,)
    y = simulate(loop, inputs={"u": lambda t: 1.0 + 0 * t}, stop=0.05, step=0.01)["y"]
    assert y == pytest.approx([1.0, 0.0, 1.0, 0.0, 1.0, 0.0])


def test_a_loop_is_watched_where_its_gain_changes():
    """The determinant of a loop of constant gain depends on parameters only."""
    assert compile_diagram(looped(Gain(gain=0.5))).watched is None
    changing = looped(Gain()).rewire(
        cut=["g.y -> s.minus", "s.y -> g.u"],
        add=["s -> g", "g -> p.u1", "r -> p.u2", "p -> s.minus"],
        blocks={**looped(Gain()).blocks, "p": Product(), "r": Ramp()},
    )
    assert compile_diagram(changing).watched.paths == (("s.y", "g.y", "p.y", "s.y"),)


def test_a_loop_at_samples_only_is_solved_in_the_update():
    diagram = Diagram(
        title="sampled loop",
        blocks={"s": Sum(), "z": ZeroOrderHold(period=0.1), "k": Tanh()},
        inputs={"u": "s.plus"},
        wires=["s -> z -> k -> s.minus"],
        outputs={"y": "z"},
    )
    eq = compile_diagram(diagram)
    assert [loop.function for loop in eq.loops] == ["update"]
    assert eq.forms is not None
    y = simulate(diagram, inputs={"u": lambda t: 1.0 + 0 * t}, stop=0.3, step=0.1)["y"]
    assert y + np.tanh(y) == pytest.approx([1.0] * 4)
