"""Mistakes in blocks and wires, found when the diagram is written or compiled."""

from tests.mistakes.table import BLOCKS, WIRES, mistake, position_loop
from tsmblocks.blocks import (
    Abs,
    Constant,
    Convert,
    Delay,
    Derivative,
    Divide,
    FirstOrderLag,
    Gain,
    Integrator,
    MotorTransferFunction,
    PID,
    Product,
    Saturation,
    Sine,
    Sum,
    ZeroOrderHold,
)
from tsmblocks.compile import compile_diagram
from tsmblocks.diagram import Diagram, Inlet
from tsmblocks.errors import AlgebraicLoop, DiagramError

# ---- names and places of wires


@mistake(DiagramError, "?")
def a_port_is_misspelt():
    position_loop(wires=["ref -> error.pluss", WIRES[1]])


@mistake(DiagramError, "?")
def an_output_port_is_misspelt():
    position_loop(blocks={**BLOCKS, "motor": MotorTransferFunction()}, wires=[WIRES[0], "error -> pid -> drive -> motor", "motor.w -> error.minus"], outputs={})


@mistake(DiagramError, "?")
def a_block_is_misspelt():
    position_loop(wires=["ref -> errer.plus", WIRES[1]])


@mistake(DiagramError, "?")
def a_block_was_never_added():
    position_loop(wires=["ref -> error.plus", "error -> pid -> drive -> motor -> gyro -> error.minus"])


@mistake(DiagramError, "?")
def a_port_number_instead_of_a_name():
    position_loop(wires=["ref -> error.0", WIRES[1]])


@mistake(DiagramError, "?")
def a_port_that_is_beyond_the_last():
    Diagram(title="gains", blocks=dict(a=Constant(), b=Product(n=2)), wires=["a -> b.u1, b.u2, b.u3"])


@mistake(DiagramError, "?")
def an_input_is_taken_for_an_output():
    position_loop(wires=["ref -> error.plus", "error.minus -> pid", "pid -> drive -> motor -> error.minus"])


@mistake(DiagramError, "?")
def an_output_is_taken_for_an_input():
    position_loop(wires=["ref -> error.y", WIRES[1]])


@mistake(DiagramError, "?")
def the_port_is_left_out_where_there_are_two():
    position_loop(wires=["ref -> error", WIRES[1]])


@mistake(DiagramError, "?")
def the_block_has_no_input():
    position_loop(wires=["ref -> error.plus", WIRES[1], "motor -> ref"])


@mistake(DiagramError, "?")
def the_arrow_is_missing():
    position_loop(wires=["ref error.plus", WIRES[1]])


@mistake(DiagramError, "?")
def the_arrow_ends_nowhere():
    position_loop(wires=["ref -> error.plus", WIRES[1], "motor -> "])


@mistake(DiagramError, "?")
def the_arrow_is_of_another_language():
    position_loop(wires=["ref => error.plus", WIRES[1]])


@mistake(DiagramError, "?")
def a_comma_before_the_last_arrow():
    position_loop(wires=["ref -> error.plus, pid -> drive", WIRES[1]])


@mistake(DiagramError, "?")
def a_wire_that_is_a_pair():
    position_loop(wires=[("ref", "error.plus"), WIRES[1]])


@mistake(DiagramError, "?")
def wires_are_one_text():
    position_loop(wires="ref -> error.plus")


@mistake(DiagramError, "?")
def a_class_instead_of_a_block():
    position_loop(blocks={**BLOCKS, "pid": PID})


@mistake(DiagramError, "?")
def a_number_instead_of_a_block():
    position_loop(blocks={**BLOCKS, "pid": 3})


@mistake(DiagramError, "?")
def a_name_with_a_dot():
    position_loop(blocks={**BLOCKS, "motor.two": Gain()})


@mistake(DiagramError, "?")
def an_input_named_like_a_block():
    position_loop(inputs={"ref": "error.plus"}, wires=WIRES[1:])


@mistake(DiagramError, "?")
def an_input_used_in_a_wire():
    position_loop(blocks={k: v for k, v in BLOCKS.items() if k != "ref"}, inputs={"x_r": "error.plus"}, wires=["x_r -> error.plus", WIRES[1]])


@mistake(DiagramError, "?")
def an_input_that_drives_a_misspelt_port():
    position_loop(inputs={"load": "motor.lod"})


@mistake(DiagramError, "?")
def an_output_that_shows_nothing():
    position_loop(outputs={"angle": "motor.angle", "volts": "drve"})


@mistake(DiagramError, "?")
def everything_at_once():
    position_loop(
        wires=["ref -> error.pluss", "errer -> pid", "pid -> drive -> motor -> error.minus", "ref -> error"],
        outputs={"angle": "moter"},
    )


# ---- drivers


@mistake(DiagramError, "?")
def two_wires_into_one_input():
    position_loop(wires=[*WIRES, "ref -> error.minus"])


@mistake(DiagramError, "?")
def a_wire_and_an_input_into_one_port():
    position_loop(inputs={"x_r": "error.plus"})


@mistake(DiagramError, "?")
def an_input_left_open():
    position_loop(wires=["ref -> error.plus", "error -> pid -> drive -> motor"])


@mistake(DiagramError, "?")
def several_inputs_left_open():
    position_loop(wires=["pid -> drive -> motor"])


@mistake(DiagramError, "?")
def an_input_of_an_inner_diagram_left_open():
    inner = Diagram(title="inner", blocks=dict(gain=Gain()), inputs={"a": Inlet("gain.u", "rad", "angle of the motor")}, outputs={"b": "gain"})
    Diagram(title="outer", blocks=dict(inner=inner))


@mistake(DiagramError, "?")
def the_input_of_a_delay_left_open():
    Diagram(title="delays", blocks=dict(delay=Delay()))


@mistake(DiagramError, "?")
def a_derivative_of_nothing():
    Diagram(title="rates", blocks=dict(ref=Sine(), d=Derivative()), wires=["ref -> d.rate"])


# ---- units


@mistake(DiagramError, "?")
def degrees_into_radians():
    Diagram(
        title="angles", blocks=dict(ref=Sine(unit="deg"), motor=MotorTransferFunction(), drive=Saturation()),
        wires=["ref -> motor"],
    )


@mistake(DiagramError, "?")
def an_angle_into_a_voltage():
    blocks = {**BLOCKS, "motor": MotorTransferFunction()}
    position_loop(blocks=blocks, wires=["ref -> error.plus", "error -> drive -> motor", "motor.y -> error.minus, pid"], outputs={})


@mistake(DiagramError, "?")
def units_differ_across_a_sum():
    Diagram(
        title="sums",
        blocks=dict(angle=Sine(unit="rad"), volts=Sine(unit="V"), sum=Sum(signs="++"), out=FirstOrderLag()),
        wires=["angle -> sum.plus1", "volts -> sum.plus2", "sum -> out"],
    )


@mistake(DiagramError, "?")
def units_differ_across_two_integrators():
    Diagram(
        title="integrals",
        blocks=dict(speed=Sine(unit="rad/s"), angle=Integrator(), error=Sum(), ref=Sine(unit="deg"), out=Abs()),
        wires=["speed -> angle -> error.minus", "ref -> error.plus", "error -> out"],
    )


@mistake(DiagramError, "?")
def units_differ_across_a_gain_that_keeps_them():
    Diagram(
        title="gains",
        blocks=dict(ref=Sine(unit="rad"), limit=Saturation(), motor=MotorTransferFunction()),
        wires=["ref -> limit -> motor"],
    )


@mistake(DiagramError, "?")
def units_differ_through_an_inner_diagram():
    inner = Diagram(title="inner", blocks=dict(limit=Saturation()), inputs={"a": "limit.u"}, outputs={"b": "limit"})
    motor = Diagram(title="motor", blocks=dict(m=MotorTransferFunction()), inputs={"u": "m.u"}, outputs={"x": "m.y"})
    Diagram(title="outer", blocks=dict(ref=Sine(unit="rad"), motor=motor, gain=Gain()), wires=["ref -> motor -> gain"])
    del inner


@mistake(DiagramError, "?")
def an_input_with_another_unit():
    Diagram(title="angles", blocks=dict(motor=MotorTransferFunction()), inputs={"x": Inlet("motor.u", unit="rad")})


@mistake(DiagramError, "?")
def an_input_with_an_unknown_unit():
    Diagram(title="angles", blocks=dict(motor=MotorTransferFunction()), inputs={"x": Inlet("motor.u", unit="volt")})


@mistake(DiagramError, "?")
def one_signal_in_two_units():
    Diagram(
        title="angles",
        blocks=dict(ref=Sine(), to_deg=Convert(source_unit="rad", target_unit="deg"), motor=MotorTransferFunction()),
        wires=["ref -> to_deg, motor"],
    )


# ---- algebraic loops


@mistake(AlgebraicLoop, "?")
def an_algebraic_loop():
    d = Diagram(title="loop", blocks=dict(ref=Sine(), error=Sum(), k=Gain(gain=0.5)), wires=["ref -> error.plus", "error -> k -> error.minus"])
    compile_diagram(d)


@mistake(AlgebraicLoop, "?")
def a_block_that_drives_itself():
    compile_diagram(Diagram(title="loop", blocks=dict(k=Gain(gain=0.5)), wires=["k -> k"]))


@mistake(AlgebraicLoop, "?")
def an_algebraic_loop_of_three_through_two_diagrams():
    half = Diagram(title="half", blocks=dict(a=Gain(), b=Abs()), wires=["a -> b"], inputs={"i": "a.u"}, outputs={"o": "b"})
    deep = Diagram(title="deep", blocks=dict(half=half), inputs={"i": "half.i"}, outputs={"o": "half.o"})
    d = Diagram(title="loop", blocks=dict(ref=Sine(), error=Sum(), deep=deep, back=Gain()), wires=["ref -> error.plus", "error -> deep -> back -> error.minus"])
    compile_diagram(d)


@mistake(AlgebraicLoop, "?")
def an_algebraic_loop_at_the_samples():
    d = Diagram(title="sampled loop", blocks=dict(ref=Sine(), error=Sum(), hold=ZeroOrderHold(), k=Gain()), wires=["ref -> error.plus", "error -> hold -> k -> error.minus"])
    compile_diagram(d)


@mistake(AlgebraicLoop, "?")
def an_algebraic_loop_through_a_derivative():
    d = Diagram(title="loop", blocks=dict(ref=Sine(), error=Sum(), d=Derivative(), lag=FirstOrderLag()), wires=["ref -> error.plus", "error -> lag -> d -> error.minus"])
    compile_diagram(d)


@mistake(AlgebraicLoop, "?")
def a_ring_of_diagrams_without_a_block():
    through = Diagram(title="through", inputs={"i": ()}, outputs={"o": "i"}, blocks={})
    d = Diagram(title="ring", blocks=dict(a=through, b=through), wires=["a -> b -> a"])
    compile_diagram(d)


# ---- derivatives


@mistake(DiagramError, "?")
def the_derivative_of_a_sampled_output():
    d = Diagram(title="sampled", blocks=dict(ref=Sine(), hold=ZeroOrderHold(), k=Gain(), d=Derivative()), wires=["ref -> hold -> k -> d"])
    compile_diagram(d)


@mistake(DiagramError, "?")
def the_second_derivative_of_a_delayed_signal():
    d = Diagram(title="delays", blocks=dict(ref=Sine(), delay=Delay(), d1=Derivative(), d2=Derivative()), wires=["ref -> delay -> d1 -> d2"])
    compile_diagram(d)


@mistake(DiagramError, "?")
def a_division_by_an_open_port():
    Diagram(title="quotients", blocks=dict(a=Constant(), q=Divide()), wires=["a -> q.num"])
