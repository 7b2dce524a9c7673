"""Mistakes in blocks and wires, found when the diagram is written or compiled."""
# ruff: noqa: E501 - the text of a message stands on one line, as the user reads it

from tests.mistakes.table import BLOCKS, WIRES, mistake, position_loop
from tsmblocks.blocks import (
    PID,
    Abs,
    AsymmetricBoucWen,
    Constant,
    Convert,
    Delay,
    Derivative,
    Divide,
    FirstOrderLag,
    Gain,
    Integrator,
    MotorTransferFunction,
    Product,
    Ramp,
    Saturation,
    Sine,
    Sum,
    ZeroOrderHold,
)
from tsmblocks.common.errors import AlgebraicLoop, DiagramError, NotFinite, RunError
from tsmblocks.compiler.compile import compile_diagram
from tsmblocks.model.diagram import Diagram, Inlet
from tsmblocks.simulation.simulate import simulate

# ---- names and places of wires


@mistake(
    DiagramError,
    """
diagram 'position loop' (HERE) has 1 problem:
  1. wire 'ref -> error.pluss': error (Sum) has no input 'pluss'. Did you mean 'plus'?
""",
)
def a_port_is_misspelt():
    position_loop(wires=["ref -> error.pluss", WIRES[1]])


@mistake(
    DiagramError,
    """
diagram 'position loop' (HERE) has 1 problem:
  1. wire 'motor.w -> error.minus': motor (MotorTransferFunction) has no output 'w'. Known here: v, y.
""",
)
def an_output_port_is_misspelt():
    position_loop(
        blocks={**BLOCKS, "motor": MotorTransferFunction()},
        wires=[WIRES[0], "error -> pid -> drive -> motor", "motor.w -> error.minus"],
        outputs={},
    )


@mistake(
    DiagramError,
    """
diagram 'position loop' (HERE) has 1 problem:
  1. wire 'ref -> errer.plus' names block 'errer', which is not in blocks. Did you mean 'error'?
""",
)
def a_block_is_misspelt():
    position_loop(wires=["ref -> errer.plus", WIRES[1]])


@mistake(
    DiagramError,
    """
diagram 'position loop' (HERE) has 1 problem:
  1. wire 'error -> pid -> drive -> motor -> gyro -> error.minus' names block 'gyro', which is not in blocks. Known here: drive, error, motor, pid, ref.
""",
)
def a_block_was_never_added():
    position_loop(wires=["ref -> error.plus", "error -> pid -> drive -> motor -> gyro -> error.minus"])


@mistake(
    DiagramError,
    """
diagram 'position loop' (HERE) has 1 problem:
  1. wire 'ref -> error.0': the ports of error (Sum) are named, not numbered. Its inputs: plus, minus.
""",
)
def a_port_number_instead_of_a_name():
    position_loop(wires=["ref -> error.0", WIRES[1]])


@mistake(
    DiagramError,
    """
diagram 'gains' (HERE) has 1 problem:
  1. wire 'a -> b.u1, b.u2, b.u3': b (Product) has no input 'u3'. Known here: u1, u2.
""",
)
def a_port_that_is_beyond_the_last():
    Diagram(title="gains", blocks=dict(a=Constant(), b=Product(n=2)), wires=["a -> b.u1, b.u2, b.u3"])


@mistake(
    DiagramError,
    """
diagram 'position loop' (HERE) has 1 problem:
  1. wire 'error.minus -> pid': error.minus is an input of error (Sum), and an output is needed here. Its outputs: y.
""",
)
def an_input_is_taken_for_an_output():
    position_loop(wires=["ref -> error.plus", "error.minus -> pid", "pid -> drive -> motor -> error.minus"])


@mistake(
    DiagramError,
    """
diagram 'position loop' (HERE) has 1 problem:
  1. wire 'ref -> error.y': error.y is an output of error (Sum), and an input is needed here. Its inputs: plus, minus.
""",
)
def an_output_is_taken_for_an_input():
    position_loop(wires=["ref -> error.y", WIRES[1]])


@mistake(
    DiagramError,
    """
diagram 'position loop' (HERE) has 1 problem:
  1. wire 'ref -> error': error (Sum) has 2 inputs; name one of them. Known here: plus, minus.
""",
)
def the_port_is_left_out_where_there_are_two():
    position_loop(wires=["ref -> error", WIRES[1]])


@mistake(
    DiagramError,
    """
diagram 'position loop' (HERE) has 1 problem:
  1. wire 'motor -> ref': ref (Sine) has no input.
""",
)
def the_block_has_no_input():
    position_loop(wires=["ref -> error.plus", WIRES[1], "motor -> ref"])


@mistake(
    DiagramError,
    """
diagram 'position loop' (HERE) has 1 problem:
  1. wire 'ref error.plus' is not a chain. Write source -> target, for example error -> pid.e.
""",
)
def the_arrow_is_missing():
    position_loop(wires=["ref error.plus", WIRES[1]])


@mistake(
    DiagramError,
    """
diagram 'position loop' (HERE) has 1 problem:
  1. wire 'motor -> ' is not a chain. Write source -> target, for example error -> pid.e.
""",
)
def the_arrow_ends_nowhere():
    position_loop(wires=["ref -> error.plus", WIRES[1], "motor -> "])


@mistake(
    DiagramError,
    """
diagram 'position loop' (HERE) has 1 problem:
  1. wire 'ref => error.plus' is not a chain. Write source -> target, for example error -> pid.e.
""",
)
def the_arrow_is_of_another_language():
    position_loop(wires=["ref => error.plus", WIRES[1]])


@mistake(
    DiagramError,
    """
diagram 'position loop' (HERE) has 1 problem:
  1. wire 'ref -> error.plus, pid -> drive' has a comma before its last arrow; only the last place may list several.
""",
)
def a_comma_before_the_last_arrow():
    position_loop(wires=["ref -> error.plus, pid -> drive", WIRES[1]])


@mistake(
    DiagramError,
    """
diagram 'position loop' (HERE) has 1 problem:
  1. a wire must be text such as 'error -> pid', got ('ref', 'error.plus').
""",
)
def a_wire_that_is_a_pair():
    position_loop(wires=[("ref", "error.plus"), WIRES[1]])


@mistake(
    DiagramError,
    """
diagram 'position loop' (HERE) has 1 problem:
  1. wires must be a list of chains such as ['error -> pid'], got one text, 'ref -> error.plus'.
""",
)
def wires_are_one_text():
    position_loop(wires="ref -> error.plus")


@mistake(
    DiagramError,
    """
diagram 'position loop' (HERE) has 1 problem:
  1. pid must be a block or a diagram, got the class PID. Write PID().
""",
)
def a_class_instead_of_a_block():
    position_loop(blocks={**BLOCKS, "pid": PID})


@mistake(
    DiagramError,
    """
diagram 'position loop' (HERE) has 1 problem:
  1. pid must be a block or a diagram, got 3.
""",
)
def a_number_instead_of_a_block():
    position_loop(blocks={**BLOCKS, "pid": 3})


@mistake(
    DiagramError,
    """
diagram 'position loop' (HERE) has 1 problem:
  1. block name 'motor.two' must be letters, digits and underscores, not starting with a digit.
""",
)
def a_name_with_a_dot():
    position_loop(blocks={**BLOCKS, "motor.two": Gain()})


@mistake(
    DiagramError,
    """
diagram 'position loop' (HERE) has 1 problem:
  1. 'ref' is both an input of the diagram and a block; give one of them another name.
""",
)
def an_input_named_like_a_block():
    position_loop(inputs={"ref": "error.plus"}, wires=WIRES[1:])


@mistake(
    DiagramError,
    """
diagram 'position loop' (HERE) has 1 problem:
  1. wire 'x_r -> error.plus' names 'x_r', which is an input of the diagram: list the ports it drives under inputs.
""",
)
def an_input_used_in_a_wire():
    position_loop(
        blocks={k: v for k, v in BLOCKS.items() if k != "ref"},
        inputs={"x_r": "error.plus"},
        wires=["x_r -> error.plus", WIRES[1]],
    )


@mistake(
    DiagramError,
    """
diagram 'position loop' (HERE) has 1 problem:
  1. input 'load': motor (TransferFunction) has no input 'lod'. Known here: u.
""",
)
def an_input_that_drives_a_misspelt_port():
    position_loop(inputs={"load": "motor.lod"})


@mistake(
    DiagramError,
    """
diagram 'position loop' (HERE) has 2 problems:
  1. output 'angle': motor (TransferFunction) has no output 'angle'. Known here: y.
  2. output 'volts' names block 'drve', which is not in blocks. Did you mean 'drive'?
""",
)
def an_output_that_shows_nothing():
    position_loop(outputs={"angle": "motor.angle", "volts": "drve"})


@mistake(
    DiagramError,
    """
diagram 'position loop' (HERE) has 1 problem:
  1. wire 'motor -> angle' names 'angle', which is an output of the diagram: give its signal under outputs.
""",
)
def a_wire_to_an_output_of_the_diagram():
    position_loop(wires=[*WIRES, "motor -> angle"])


@mistake(
    DiagramError,
    """
diagram 'position loop' (HERE) has 1 problem:
  1. input 'load': a port must be text such as 'motor.y', got 3.
""",
)
def an_input_that_drives_a_number():
    position_loop(inputs={"load": 3})


@mistake(
    DiagramError,
    """
diagram 'position loop' (HERE) has 1 problem:
  1. output 'angle': a port must be text such as 'motor.y', got 3.
""",
)
def an_output_that_shows_a_number():
    position_loop(outputs={"angle": 3})


@mistake(
    DiagramError,
    """
diagram 'names' (HERE) has 1 problem:
  1. 'x' is both an input and an output of the diagram; give one of them another name.
""",
)
def an_output_named_like_an_input():
    Diagram(title="names", blocks=dict(k=Gain()), inputs={"x": "k.u"}, outputs={"x": "k"})


@mistake(
    DiagramError,
    """
diagram 'position loop' (HERE) has 4 problems:
  1. wire 'ref -> error.pluss': error (Sum) has no input 'pluss'. Did you mean 'plus'?
  2. wire 'errer -> pid' names block 'errer', which is not in blocks. Did you mean 'error'?
  3. wire 'ref -> error': error (Sum) has 2 inputs; name one of them. Known here: plus, minus.
  4. output 'angle' names block 'moter', which is not in blocks. Did you mean 'motor'?
""",
)
def everything_at_once():
    position_loop(
        wires=["ref -> error.pluss", "errer -> pid", "pid -> drive -> motor -> error.minus", "ref -> error"],
        outputs={"angle": "moter"},
    )


# ---- drivers


@mistake(
    DiagramError,
    """
diagram 'position loop' (HERE) has 1 problem:
  1. error.minus is driven 2 times: motor.y -> error.minus; ref.y -> error.minus. Join them with a Sum block.
""",
)
def two_wires_into_one_input():
    position_loop(wires=[*WIRES, "ref -> error.minus"])


@mistake(
    DiagramError,
    """
diagram 'position loop' (HERE) has 1 problem:
  1. error.minus is driven 2 times: motor.y -> error.minus; motor.y -> error.minus. Leave out all but one.
""",
)
def one_wire_written_twice():
    position_loop(wires=[*WIRES, "motor -> error.minus"])


@mistake(
    DiagramError,
    """
diagram 'position loop' (HERE) has 1 problem:
  1. error.plus is driven 2 times: ref.y -> error.plus; input x_r -> error.plus. Join them with a Sum block.
""",
)
def a_wire_and_an_input_into_one_port():
    position_loop(inputs={"x_r": "error.plus"})


@mistake(
    DiagramError,
    """
diagram 'position loop' (HERE) has 1 problem:
  1. error.minus (Sum) is driven by nothing. It is: signal that is subtracted. Wire it, list it under inputs, or drive it with a Constant.
""",
)
def an_input_left_open():
    position_loop(wires=["ref -> error.plus", "error -> pid -> drive -> motor"])


@mistake(
    DiagramError,
    """
diagram 'position loop' (HERE) has 3 problems:
  1. error.plus (Sum) is driven by nothing. It is: signal that is added. Wire it, list it under inputs, or drive it with a Constant.
  2. error.minus (Sum) is driven by nothing. It is: signal that is subtracted. Wire it, list it under inputs, or drive it with a Constant.
  3. pid.e (PID) is driven by nothing. It is: reference minus measurement. Wire it, list it under inputs, or drive it with a Constant.
""",
)
def several_inputs_left_open():
    position_loop(wires=["pid -> drive -> motor"])


@mistake(
    DiagramError,
    """
diagram 'outer' (HERE) has 1 problem:
  1. inner.a (Diagram) is driven by nothing. It is: angle of the motor [rad]. Wire it, list it under inputs, or drive it with a Constant.
""",
)
def an_input_of_an_inner_diagram_left_open():
    inner = Diagram(
        title="inner",
        blocks=dict(gain=Gain()),
        inputs={"a": Inlet("gain.u", "rad", "angle of the motor")},
        outputs={"b": "gain"},
    )
    Diagram(title="outer", blocks=dict(inner=inner))


@mistake(
    DiagramError,
    """
diagram 'delays' (HERE) has 1 problem:
  1. delay.u (Delay) is driven by nothing. It is: any signal. Wire it, list it under inputs, or drive it with a Constant.
""",
)
def the_input_of_a_delay_left_open():
    Diagram(title="delays", blocks=dict(delay=Delay()))


@mistake(
    DiagramError,
    """
diagram 'rates' (HERE) has 1 problem:
  1. d.u (Derivative) is driven by nothing. It is: signal made of states, time and smooth inputs. Wire it, list it under inputs, or drive it with a Constant.
""",
)
def a_derivative_of_nothing():
    Diagram(title="rates", blocks=dict(ref=Sine(), d=Derivative()), wires=["ref -> d.rate"])


# ---- units


@mistake(
    DiagramError,
    """
diagram 'angles' (HERE) has 1 problem:
  1. ref.y -> tsm.x joins deg to rad. Put Convert(source_unit='deg', target_unit='rad') between them, or correct the unit of one port.
""",
)
def degrees_into_radians():
    Diagram(title="angles", blocks=dict(ref=Sine(unit="deg"), tsm=AsymmetricBoucWen()), wires=["ref -> tsm.x"])


@mistake(
    DiagramError,
    """
diagram 'position loop' (HERE) has 1 problem:
  1. drive.y -> motor.u joins rad to V. drive.y is in rad because ref.y is in rad. rad and V measure different things: correct the wire or a unit, or put a block between them that turns one into the other, such as Gain(unit='V').
""",
)
def an_angle_into_a_voltage():
    blocks = {**BLOCKS, "motor": MotorTransferFunction()}
    position_loop(
        blocks=blocks, wires=["ref -> error.plus", "error -> drive -> motor", "motor.y -> error.minus, pid"], outputs={}
    )


@mistake(
    DiagramError,
    """
diagram 'sums' (HERE) has 1 problem:
  1. volts.y -> sum.plus2 joins V to rad. sum.plus2 is in rad because angle.y is in rad. V and rad measure different things: correct the wire or a unit, or put a block between them that turns one into the other, such as Gain(unit='rad').
""",
)
def units_differ_across_a_sum():
    Diagram(
        title="sums",
        blocks=dict(angle=Sine(unit="rad"), volts=Sine(unit="V"), sum=Sum(signs="++"), out=FirstOrderLag()),
        wires=["angle -> sum.plus1", "volts -> sum.plus2", "sum -> out"],
    )


@mistake(
    DiagramError,
    """
diagram 'integrals' (HERE) has 1 problem:
  1. ref.y -> error.plus joins deg to rad. error.plus is in rad because speed.y is in rad/s. Put Convert(source_unit='deg', target_unit='rad') between them, or correct the unit of one port.
""",
)
def units_differ_across_two_integrators():
    Diagram(
        title="integrals",
        blocks=dict(speed=Sine(unit="rad/s"), angle=Integrator(), error=Sum(), ref=Sine(unit="deg"), out=Abs()),
        wires=["speed -> angle -> error.minus", "ref -> error.plus", "error -> out"],
    )


@mistake(
    DiagramError,
    """
diagram 'gains' (HERE) has 1 problem:
  1. limit.y -> motor.u joins rad to V. limit.y is in rad because ref.y is in rad. rad and V measure different things: correct the wire or a unit, or put a block between them that turns one into the other, such as Gain(unit='V').
""",
)
def units_differ_across_a_gain_that_keeps_them():
    Diagram(
        title="gains",
        blocks=dict(ref=Sine(unit="rad"), limit=Saturation(), motor=MotorTransferFunction()),
        wires=["ref -> limit -> motor"],
    )


@mistake(
    DiagramError,
    """
diagram 'outer' (HERE) has 1 problem:
  1. ref.y -> motor.u joins rad to V. rad and V measure different things: correct the wire or a unit, or put a block between them that turns one into the other, such as Gain(unit='V').
""",
)
def units_differ_through_an_inner_diagram():
    motor = Diagram(title="motor", blocks=dict(m=MotorTransferFunction()), inputs={"u": "m.u"}, outputs={"x": "m.y"})
    Diagram(title="outer", blocks=dict(ref=Sine(unit="rad"), motor=motor, gain=Gain()), wires=["ref -> motor -> gain"])


@mistake(
    DiagramError,
    """
diagram 'outer' (HERE) has 1 problem:
  1. part.b -> motor.u joins rad to V. part.b is in rad because ref.y is in rad. rad and V measure different things: correct the wire or a unit, or put a block between them that turns one into the other, such as Gain(unit='V').
""",
)
def units_differ_through_a_diagram_that_takes_anything():
    inner = Diagram(title="inner", blocks=dict(limit=Saturation()), inputs={"a": "limit.u"}, outputs={"b": "limit"})
    blocks = dict(ref=Sine(unit="rad"), part=inner, motor=MotorTransferFunction())
    Diagram(title="outer", blocks=blocks, wires=["ref -> part -> motor"])


@mistake(
    DiagramError,
    """
diagram 'angles' (HERE) has 1 problem:
  1. input x -> motor.u joins rad to V. rad and V measure different things: correct the wire or a unit, or put a block between them that turns one into the other, such as Gain(unit='V').
""",
)
def an_input_with_another_unit():
    Diagram(title="angles", blocks=dict(motor=MotorTransferFunction()), inputs={"x": Inlet("motor.u", unit="rad")})


@mistake(
    DiagramError,
    """
diagram 'angles' (HERE) has 1 problem:
  1. input 'x': 'cubit' is not a unit known here. Known here: %, 1, A, GPa, H, Hz, J, K, … (68 in all).
""",
)
def an_input_with_an_unknown_unit():
    Diagram(title="angles", blocks=dict(motor=MotorTransferFunction()), inputs={"x": Inlet("motor.u", unit="cubit")})


@mistake(
    DiagramError,
    """
diagram 'angles' (HERE) has 1 problem:
  1. ref.y -> motor.u joins rad to V. ref.y is in rad because to_deg.u is in rad. rad and V measure different things: correct the wire or a unit, or put a block between them that turns one into the other, such as Gain(unit='V').
""",
)
def one_signal_in_two_units():
    Diagram(
        title="angles",
        blocks=dict(ref=Sine(), to_deg=Convert(source_unit="rad", target_unit="deg"), motor=MotorTransferFunction()),
        wires=["ref -> to_deg, motor"],
    )


# ---- algebraic loops


@mistake(
    AlgebraicLoop,
    """
diagram 'loop' (HERE) has 1 problem:
  1. error.y -> k.y -> error.y has no state in it, so its value at one instant depends on itself. Break it with a block that has a state (a lag, an integrator), with a Delay, or with a sampled block.
""",
)
def an_algebraic_loop():
    d = Diagram(
        title="loop",
        blocks=dict(ref=Sine(), error=Sum(), k=Gain(gain=0.5)),
        wires=["ref -> error.plus", "error -> k -> error.minus"],
    )
    compile_diagram(d, refuse_loops=True)


@mistake(
    AlgebraicLoop,
    """
diagram 'loop' (HERE) has 1 problem:
  1. k.y -> k.y has no state in it, so its value at one instant depends on itself. Break it with a block that has a state (a lag, an integrator), with a Delay, or with a sampled block.
""",
)
def a_block_that_drives_itself():
    compile_diagram(Diagram(title="loop", blocks=dict(k=Gain(gain=0.5)), wires=["k -> k"]), refuse_loops=True)


@mistake(
    AlgebraicLoop,
    """
diagram 'loop' (HERE) has 1 problem:
  1. error.y -> deep.half.a.y -> deep.half.b.y -> back.y -> error.y has no state in it, so its value at one instant depends on itself. Break it with a block that has a state (a lag, an integrator), with a Delay, or with a sampled block.
""",
)
def an_algebraic_loop_of_three_through_two_diagrams():
    half = Diagram(
        title="half", blocks=dict(a=Gain(), b=Abs()), wires=["a -> b"], inputs={"i": "a.u"}, outputs={"o": "b"}
    )
    deep = Diagram(title="deep", blocks=dict(half=half), inputs={"i": "half.i"}, outputs={"o": "half.o"})
    d = Diagram(
        title="loop",
        blocks=dict(ref=Sine(), error=Sum(), deep=deep, back=Gain()),
        wires=["ref -> error.plus", "error -> deep -> back -> error.minus"],
    )
    compile_diagram(d, refuse_loops=True)


@mistake(
    AlgebraicLoop,
    """
diagram 'sampled loop' (HERE) has 1 problem:
  1. hold.y -> k.y -> error.y -> hold.y has no state in it, so its value at a sample depends on itself. Break it with a UnitDelay, or with a block that has a state (a lag, an integrator).
""",
)
def an_algebraic_loop_at_the_samples():
    d = Diagram(
        title="sampled loop",
        blocks=dict(ref=Sine(), error=Sum(), hold=ZeroOrderHold(), k=Gain()),
        wires=["ref -> error.plus", "error -> hold -> k -> error.minus"],
    )
    compile_diagram(d, refuse_loops=True)


@mistake(
    AlgebraicLoop,
    """
diagram 'loop' (HERE) has 1 problem:
  1. error.y -> d/dt lag.y -> d.y -> error.y needs its own value at the same instant: a derivative removes the state that it differentiates. Replace it by a FilteredDerivative.
""",
)
def an_algebraic_loop_through_a_derivative():
    d = Diagram(
        title="loop",
        blocks=dict(ref=Sine(), error=Sum(), d=Derivative(), lag=FirstOrderLag()),
        wires=["ref -> error.plus", "error -> lag -> d -> error.minus"],
    )
    compile_diagram(d, refuse_loops=True)


@mistake(
    AlgebraicLoop,
    """
diagram 'loop' (HERE) has 1 problem:
  1. a.y -> b.y -> a.y passes its own value on unchanged (its loop gain is 1), so it has no solution, or infinitely many. Check the signs of its sums, or break it with a block that has a state.
""",
)
def a_loop_of_sums_alone():
    blocks = dict(ref=Sine(), a=Sum(signs="++"), b=Sum(signs="++"))
    compile_diagram(
        Diagram(title="loop", blocks=blocks, wires=["ref -> a.plus1", "ref -> b.plus1", "a -> b.plus2", "b -> a.plus2"])
    )


@mistake(
    NotFinite,
    "the algebraic loop error.y -> k.y -> error.y is singular at t = 0 s: its loop gain is 1, so it has no solution, or infinitely many. Change a gain, or break it with a block that has a state (a lag, an integrator).",
)
def a_loop_with_a_gain_of_one():
    blocks = dict(ref=Sine(), error=Sum(signs="++"), k=Gain(gain=1.0))
    simulate(Diagram(title="loop", blocks=blocks, wires=["ref -> error.plus1", "error -> k -> error.plus2"]))


@mistake(
    NotFinite,
    "the algebraic loop error.y -> m.y -> error.y has no solution at t = 0.26 s that Newton's method finds, from the last one and from 30 other starts. One step before: error.y = 0.5, m.y = 0.25. A discontinuity (a sign, a comparison) may leave a loop without a solution; break it with a block that has a state (a lag, an integrator).",
)
def a_loop_that_loses_its_solution():
    blocks = dict(ref=Ramp(), error=Sum(signs="++"), m=Product())
    wires = ["ref -> error.plus1", "error -> m.u1", "error -> m.u2", "m -> error.plus2"]
    simulate(Diagram(title="loop", blocks=blocks, wires=wires), stop=1.0, step=0.01)


@mistake(RunError, "loops must be 'solve' or 'refuse', got 'refused'. Did you mean 'refuse'?")
def loops_that_are_neither_solved_nor_refused():
    simulate(Diagram(title="loop", blocks=dict(ref=Sine())), stop=1.0, loops="refused")


@mistake(
    AlgebraicLoop,
    """
diagram 'ring' (HERE) has 1 problem:
  1. a.o -> b.i -> b.o -> a.i -> a.o connects diagrams in a ring without any block, so the signal has no value.
""",
)
def a_ring_of_diagrams_without_a_block():
    through = Diagram(title="through", inputs={"i": ()}, outputs={"o": "i"}, blocks={})
    d = Diagram(title="ring", blocks=dict(a=through, b=through), wires=["a -> b -> a"])
    compile_diagram(d)


# ---- derivatives


@mistake(
    DiagramError,
    """
diagram 'sampled' (HERE) has 1 problem:
  1. d.rate is the derivative of k.y, which depends on hold.y, a sampled output held constant between samples. Use a FilteredDerivative, or differentiate before sampling.
""",
)
def the_derivative_of_a_sampled_output():
    d = Diagram(
        title="sampled",
        blocks=dict(ref=Sine(), hold=ZeroOrderHold(), k=Gain(), d=Derivative()),
        wires=["ref -> hold -> k -> d"],
    )
    compile_diagram(d)


@mistake(
    DiagramError,
    """
diagram 'quotients' (HERE) has 1 problem:
  1. q.den (Divide) is driven by nothing. It is: denominator, which must not pass zero. Wire it, list it under inputs, or drive it with a Constant.
""",
)
def a_division_by_an_open_port():
    Diagram(title="quotients", blocks=dict(a=Constant(), q=Divide()), wires=["a -> q.num"])
