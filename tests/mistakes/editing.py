"""Mistakes in edits of a diagram."""

from tests.mistakes.table import mistake, position_loop
from tsmblocks.blocks import PID, Abs, Gain, MotorTransferFunction, Product, Sine, Sum
from tsmblocks.diagram import Diagram
from tsmblocks.errors import DiagramError, ParameterError


def nested():
    """A position loop inside another diagram."""
    return Diagram(title="outer", blocks=dict(loop=position_loop(), out=Gain()), wires=["loop -> out"], outputs={"y": "out"})


@mistake(DiagramError, "?")
def two_blocks_of_one_name():
    position_loop().insert("motor", Gain(), after="drive")


@mistake(DiagramError, "?")
def insert_nowhere():
    position_loop().insert("slack", Gain())


@mistake(DiagramError, "?")
def insert_in_two_places():
    position_loop().insert("slack", Gain(), after="motor", before="error.minus")


@mistake(DiagramError, "?")
def insert_after_a_misspelt_block():
    position_loop().insert("slack", Gain(), after="moter")


@mistake(DiagramError, "?")
def insert_after_a_misspelt_port():
    position_loop().insert("slack", Gain(), after="motor.z")


@mistake(DiagramError, "?")
def insert_before_a_misspelt_port():
    position_loop().insert("slack", Gain(), before="error.pluss")


@mistake(DiagramError, "?")
def insert_before_a_misspelt_output():
    position_loop().insert("slack", Gain(), before="angel")


@mistake(DiagramError, "?")
def insert_a_block_of_two_inputs():
    position_loop().insert("slack", Product(), after="motor")


@mistake(DiagramError, "?")
def insert_a_source():
    position_loop().insert("slack", Sine(), after="motor")


@mistake(DiagramError, "?")
def insert_a_class():
    position_loop().insert("slack", Gain, after="motor")


@mistake(DiagramError, "?")
def insert_a_block_that_changes_the_unit():
    d = position_loop(blocks={**position_loop().blocks, "motor": MotorTransferFunction()}, wires=["ref -> error.plus", "error -> pid -> drive -> motor", "motor.y -> error.minus"], outputs={})
    d.insert("slack", MotorTransferFunction(), after="error")


@mistake(DiagramError, "?")
def insert_by_a_name_that_is_none():
    position_loop().insert("my block", Gain(), after="motor")


@mistake(DiagramError, "?")
def insert_into_a_block():
    position_loop().insert("motor.slack", Gain(), after="drive")


@mistake(DiagramError, "?")
def insert_into_a_misspelt_diagram():
    nested().insert("lop.slack", Gain(), after="motor")


@mistake(DiagramError, "?")
def insert_into_a_diagram_after_what_is_not_there():
    nested().insert("loop.slack", Gain(), after="moter")


@mistake(DiagramError, "?")
def insert_with_a_misspelt_wire():
    position_loop().insert("slack", Gain(), after="motor", wires=["ref -> slack.v"])


@mistake(DiagramError, "?")
def insert_before_an_input_shown_as_an_output():
    d = Diagram(title="through", blocks=dict(k=Gain()), inputs={"x": "k.u"}, outputs={"x_in": "x"})
    d.insert("slack", Gain(), before="x_in")


@mistake(DiagramError, "?")
def replace_what_is_not_there():
    position_loop().replace("moter", Gain())


@mistake(DiagramError, "?")
def replace_by_a_block_without_the_port():
    position_loop().replace("pid", Gain())


@mistake(DiagramError, "?")
def replace_by_a_block_without_either_port():
    position_loop().replace("error", Product())


@mistake(DiagramError, "?")
def replace_with_a_port_the_old_block_has_not():
    position_loop().replace("pid", Gain(), ports={"u": "u"})


@mistake(DiagramError, "?")
def replace_with_a_port_the_new_block_has_not():
    position_loop().replace("pid", Gain(), ports={"e": "e1"})


@mistake(DiagramError, "?")
def replace_leaves_an_input_open():
    position_loop().replace("motor", Product(), ports={"u": "u1"})


@mistake(DiagramError, "?")
def replace_by_a_class():
    position_loop().replace("motor", Gain)


@mistake(DiagramError, "?")
def replace_inside_by_a_block_without_the_port():
    nested().replace("loop.pid", Gain())


@mistake(DiagramError, "?")
def replace_an_inner_diagram_by_one_without_the_port():
    nested().replace("loop", Diagram(title="other", blocks=dict(s=Sine()), outputs={"angel": "s"}))


@mistake(DiagramError, "?")
def remove_what_is_not_there():
    position_loop().remove("moter")


@mistake(DiagramError, "?")
def remove_a_sum():
    position_loop().remove("error")


@mistake(DiagramError, "?")
def remove_a_source():
    position_loop().remove("ref")


@mistake(DiagramError, "?")
def remove_a_block_with_two_outputs():
    d = Diagram(title="motor", blocks=dict(ref=Sine(unit="V"), motor=MotorTransferFunction()), wires=["ref -> motor"], outputs={"x": "motor.y", "v": "motor.v"})
    d.remove("motor")


@mistake(DiagramError, "?")
def remove_what_a_number_of_units_hangs_on():
    d = Diagram(title="motor", blocks=dict(ref=Sine(unit="V"), motor=MotorTransferFunction(), other=MotorTransferFunction(), k=Gain()), wires=["ref -> motor", "motor.y -> k -> other"], outputs={"x": "motor.y"})
    d.remove("k")


@mistake(DiagramError, "?")
def cut_a_wire_that_is_not_there():
    position_loop().rewire(cut=["ref -> error.minus"])


@mistake(DiagramError, "?")
def cut_a_misspelt_wire():
    position_loop().rewire(cut=["ref -> eror.plus"])


@mistake(DiagramError, "?")
def cut_and_leave_open():
    position_loop().rewire(cut=["ref -> error.plus"])


@mistake(DiagramError, "?")
def add_a_second_driver():
    position_loop().rewire(add=["pid -> error.plus"])


@mistake(DiagramError, "?")
def add_a_misspelt_wire():
    position_loop().rewire(cut=["ref -> error.plus"], add=["ref -> error.pluss"])


@mistake(TypeError, "?")
def rewire_with_an_unknown_field():
    position_loop().rewire(output={"x": "motor"})


@mistake(DiagramError, "?")
def an_edit_of_a_diagram_read_from_a_file():
    d = Diagram(title="from a file", blocks=dict(a=Sine(), b=Abs()), wires=["a -> b"], where="loops/position.toml")
    d.insert("c", Sum(), after="a")


del PID, ParameterError
