"""Mistakes in edits of a diagram."""
# ruff: noqa: E501 - the text of a message stands on one line, as the user reads it

from tests.mistakes.table import BLOCKS, mistake, position_loop
from tsmblocks.blocks import (
    Abs,
    CoulombFriction,
    Derivative,
    Gain,
    Integrator,
    MotorTransferFunction,
    Product,
    Sine,
    Sum,
)
from tsmblocks.common.errors import DiagramError
from tsmblocks.model.diagram import Diagram


def nested():
    """A position loop inside another diagram."""
    return Diagram(
        title="outer", blocks=dict(loop=position_loop(), out=Gain()), wires=["loop -> out"], outputs={"y": "out"}
    )


@mistake(
    DiagramError,
    """
diagram 'position loop' (HERE) has 1 problem:
  1. there is a block 'motor' already; choose another name.
""",
)
def two_blocks_of_one_name():
    position_loop().insert("motor", Gain(), after="drive")


@mistake(
    DiagramError,
    """
diagram 'position loop' (HERE) has 1 problem:
  1. insert 'slack' takes either after= or before=, got neither.
""",
)
def insert_nowhere():
    position_loop().insert("slack", Gain())


@mistake(
    DiagramError,
    """
diagram 'position loop' (HERE) has 1 problem:
  1. insert 'slack' takes either after= or before=, got both.
""",
)
def insert_in_two_places():
    position_loop().insert("slack", Gain(), after="motor", before="error.minus")


@mistake(
    DiagramError,
    """
diagram 'position loop' (HERE) has 1 problem:
  1. after='moter' names nothing in this diagram. Did you mean 'motor'?
""",
)
def insert_after_a_misspelt_block():
    position_loop().insert("slack", Gain(), after="moter")


@mistake(
    DiagramError,
    """
diagram 'position loop' (HERE) has 1 problem:
  1. after='motor.z': motor (TransferFunction) has no output 'z'. Known here: y.
""",
)
def insert_after_a_misspelt_port():
    position_loop().insert("slack", Gain(), after="motor.z")


@mistake(
    DiagramError,
    """
diagram 'position loop' (HERE) has 1 problem:
  1. before='error.pluss': error (Sum) has no input 'pluss'. Did you mean 'plus'?
""",
)
def insert_before_a_misspelt_port():
    position_loop().insert("slack", Gain(), before="error.pluss")


@mistake(
    DiagramError,
    """
diagram 'position loop' (HERE) has 1 problem:
  1. before='angel' names nothing in this diagram. Did you mean 'angle'?
""",
)
def insert_before_a_misspelt_output():
    position_loop().insert("slack", Gain(), before="angel")


@mistake(
    DiagramError,
    """
diagram 'position loop' (HERE) has 1 problem:
  1. insert 'slack': a block on a wire has one input and one output, and Product has 2 inputs (u1, u2). Use rewire, which takes blocks and wires.
""",
)
def insert_a_block_of_two_inputs():
    position_loop().insert("slack", Product(), after="motor")


@mistake(
    DiagramError,
    """
diagram 'position loop' (HERE) has 1 problem:
  1. insert 'slack': a block on a wire has one input and one output, and Sine has no input. Use rewire, which takes blocks and wires.
""",
)
def insert_a_source():
    position_loop().insert("slack", Sine(), after="motor")


@mistake(
    DiagramError,
    """
diagram 'position loop' (HERE) has 1 problem:
  1. slack must be a block or a diagram, got the class Gain. Write Gain().
""",
)
def insert_a_class():
    position_loop().insert("slack", Gain, after="motor")


@mistake(
    DiagramError,
    """
diagram 'position loop' (HERE) has 1 problem:
  1. insert 'slack': a block on a wire has one input and one output, and MotorTransferFunction has 2 outputs (y, v). Use rewire, which takes blocks and wires.
""",
)
def insert_a_block_of_two_outputs():
    position_loop().insert("slack", MotorTransferFunction(), after="error")


@mistake(
    DiagramError,
    """
diagram 'position loop' (HERE) has 1 problem:
  1. rate.y -> error.minus joins rad/s to rad. rate.y is in rad/s because motor.y is in rad. error.minus is in rad because ref.y is in rad. rad/s and rad measure different things: correct the wire or a unit, or put a block between them that turns one into the other, such as Gain(unit='rad').
""",
)
def insert_a_block_that_changes_the_unit():
    wires = ["ref -> error.plus", "error -> pid -> drive -> motor", "motor.y -> error.minus"]
    d = position_loop(blocks={**BLOCKS, "motor": MotorTransferFunction()}, wires=wires, outputs={})
    d.insert("rate", Derivative(), before="error.minus")


@mistake(
    DiagramError,
    """
diagram 'outer' (HERE) has 1 problem:
  1. loop: there is a block 'motor' already; choose another name.
""",
)
def insert_two_names_for_one_block_of_a_nest():
    nested().insert("loop.motor", Gain(), after="drive")


@mistake(
    DiagramError,
    """
diagram 'position loop' (HERE) has 1 problem:
  1. block name 'my block' must be letters, digits and underscores, not starting with a digit.
""",
)
def insert_by_a_name_that_is_none():
    position_loop().insert("my block", Gain(), after="motor")


@mistake(
    DiagramError,
    """
diagram 'position loop' (HERE) has 1 problem:
  1. insert 'motor.slack': motor is a TransferFunction, not a diagram, so it contains no blocks.
""",
)
def insert_into_a_block():
    position_loop().insert("motor.slack", Gain(), after="drive")


@mistake(
    DiagramError,
    """
diagram 'outer' (HERE) has 1 problem:
  1. there is no block 'lop'. Did you mean 'loop'?
""",
)
def insert_into_a_misspelt_diagram():
    nested().insert("lop.slack", Gain(), after="motor")


@mistake(
    DiagramError,
    """
diagram 'outer' (HERE) has 1 problem:
  1. loop: after='moter' names nothing in this diagram. Did you mean 'motor'?
""",
)
def insert_into_a_diagram_after_what_is_not_there():
    nested().insert("loop.slack", Gain(), after="moter")


@mistake(
    DiagramError,
    """
diagram 'position loop' (HERE) has 1 problem:
  1. wire 'ref -> slack.v': slack (Gain) has no input 'v'. Known here: u.
""",
)
def insert_with_a_misspelt_wire():
    position_loop().insert("slack", Gain(), after="motor", wires=["ref -> slack.v"])


@mistake(
    DiagramError,
    """
diagram 'through' (HERE) has 1 problem:
  1. before='x_in': that output shows an input; use after='x'.
""",
)
def insert_before_an_input_shown_as_an_output():
    d = Diagram(title="through", blocks=dict(k=Gain()), inputs={"x": "k.u"}, outputs={"x_in": "x"})
    d.insert("slack", Gain(), before="x_in")


@mistake(
    DiagramError,
    """
diagram 'position loop' (HERE) has 1 problem:
  1. there is no block 'moter'. Did you mean 'motor'?
""",
)
def replace_what_is_not_there():
    position_loop().replace("moter", Gain())


@mistake(
    DiagramError,
    """
diagram 'position loop' (HERE) has 1 problem:
  1. error.y -> pid.e: the new pid is a Gain, which has no input 'e'. Known here: u. Say ports={'e': 'u'}.
""",
)
def replace_by_a_block_without_the_port():
    position_loop().replace("pid", Gain())


@mistake(
    DiagramError,
    """
diagram 'position loop' (HERE) has 2 problems:
  1. ref.y -> error.plus: the new error is a Product, which has no input 'plus'. Known here: u1, u2. Say ports={'plus': '…'}.
  2. motor.y -> error.minus: the new error is a Product, which has no input 'minus'. Known here: u1, u2. Say ports={'minus': '…'}.
""",
)
def replace_by_a_block_without_either_port():
    position_loop().replace("error", Product())


@mistake(
    DiagramError,
    """
diagram 'position loop' (HERE) has 1 problem:
  1. replace 'pid': PID has no port 'u'. Known here: e, y.
""",
)
def replace_with_a_port_the_old_block_has_not():
    position_loop().replace("pid", Gain(), ports={"u": "u"})


@mistake(
    DiagramError,
    """
diagram 'position loop' (HERE) has 1 problem:
  1. error.y -> pid.e: the new pid is a Gain, which has no input 'e1'. Known here: u.
""",
)
def replace_with_a_port_the_new_block_has_not():
    position_loop().replace("pid", Gain(), ports={"e": "e1"})


@mistake(
    DiagramError,
    """
diagram 'position loop' (HERE) has 1 problem:
  1. motor.u2 (Product) is driven by nothing. It is: factor 2. Wire it, list it under inputs, or drive it with a Constant.
""",
)
def replace_leaves_an_input_open():
    position_loop().replace("motor", Product(), ports={"u": "u1"})


@mistake(
    DiagramError,
    """
diagram 'position loop' (HERE) has 1 problem:
  1. motor must be a block or a diagram, got the class Gain. Write Gain().
""",
)
def replace_by_a_class():
    position_loop().replace("motor", Gain)


@mistake(
    DiagramError,
    """
diagram 'outer' (HERE) has 1 problem:
  1. loop: error.y -> pid.e: the new pid is a Gain, which has no input 'e'. Known here: u. Say ports={'e': 'u'}.
""",
)
def replace_inside_by_a_block_without_the_port():
    nested().replace("loop.pid", Gain())


@mistake(
    DiagramError,
    """
diagram 'outer' (HERE) has 1 problem:
  1. loop.angle -> out.u: the new loop is a Diagram, which has no output 'angle'. Did you mean 'angel'? Say ports={'angle': 'angel'}.
""",
)
def replace_an_inner_diagram_by_one_without_the_port():
    nested().replace("loop", Diagram(title="other", blocks=dict(s=Sine()), outputs={"angel": "s"}))


@mistake(
    DiagramError,
    """
diagram 'position loop' (HERE) has 1 problem:
  1. there is no block 'moter'. Did you mean 'motor'?
""",
)
def remove_what_is_not_there():
    position_loop().remove("moter")


@mistake(
    DiagramError,
    """
diagram 'position loop' (HERE) has 1 problem:
  1. remove 'error': it has 2 inputs (plus, minus) and 1 output (y) in use, so it is not known which signal should replace it. Use rewire or replace.
""",
)
def remove_a_sum():
    position_loop().remove("error")


@mistake(
    DiagramError,
    """
diagram 'position loop' (HERE) has 1 problem:
  1. remove 'ref': it has no input and 1 output (y) in use, so it is not known which signal should replace it. Use rewire or replace.
""",
)
def remove_a_source():
    position_loop().remove("ref")


@mistake(
    DiagramError,
    """
diagram 'motor' (HERE) has 1 problem:
  1. remove 'motor': it has 1 input (u) and 2 outputs (v, y) in use, so it is not known which signal should replace it. Use rewire or replace.
""",
)
def remove_a_block_with_two_outputs():
    d = Diagram(
        title="motor",
        blocks=dict(ref=Sine(unit="V"), motor=MotorTransferFunction()),
        wires=["ref -> motor"],
        outputs={"x": "motor.y", "v": "motor.v"},
    )
    d.remove("motor")


@mistake(
    DiagramError,
    """
diagram 'axis' (HERE) has 1 problem:
  1. remove 'rubs': its input v is a rate, which cannot replace its output. To remove its effect: replace('rubs', Gain(gain=0.0), ports={'v': 'u'}), or rewire.
""",
)
def remove_friction():
    d = Diagram(
        title="axis",
        blocks=dict(net=Sum(), speed=Integrator(), rubs=CoulombFriction()),
        wires=["net -> speed -> rubs -> net.minus"],
        inputs={"force": "net.plus"},
    )
    d.replace("rubs", Gain(gain=0.0), ports={"v": "u"})  # the way out that is named
    d.remove("rubs")


@mistake(
    DiagramError,
    """
diagram 'motor' (HERE) has 1 problem:
  1. motor.y -> other.u joins rad to V. rad and V measure different things: correct the wire or a unit, or put a block between them that turns one into the other, such as Gain(unit='V').
""",
)
def remove_what_turns_one_unit_into_another():
    d = Diagram(
        title="motor",
        blocks=dict(ref=Sine(unit="V"), motor=MotorTransferFunction(), other=MotorTransferFunction(), k=Gain()),
        wires=["ref -> motor", "motor.y -> k -> other"],
        outputs={"x": "motor.y"},
    )
    d.remove("k")


@mistake(
    DiagramError,
    """
diagram 'position loop' (HERE) has 1 problem:
  1. cut 'ref.y -> error.minus': there is no such wire. Did you mean 'ref.y -> error.plus'?
""",
)
def cut_a_wire_that_is_not_there():
    position_loop().rewire(cut=["ref -> error.minus"])


@mistake(
    DiagramError,
    """
diagram 'position loop' (HERE) has 1 problem:
  1. wire 'ref -> eror.plus' names block 'eror', which is not in blocks. Did you mean 'error'?
""",
)
def cut_a_misspelt_wire():
    position_loop().rewire(cut=["ref -> eror.plus"])


@mistake(
    DiagramError,
    """
diagram 'position loop' (HERE) has 1 problem:
  1. error.plus (Sum) is driven by nothing. It is: signal that is added. Wire it, list it under inputs, or drive it with a Constant.
""",
)
def cut_and_leave_open():
    position_loop().rewire(cut=["ref -> error.plus"])


@mistake(
    DiagramError,
    """
diagram 'position loop' (HERE) has 2 problems:
  1. wire 'error.y -> pid.e' names block 'pid', which is not in blocks. Known here: drive, error, motor, ref.
  2. wire 'pid.y -> drive.u' names block 'pid', which is not in blocks. Known here: drive, error, motor, ref.
""",
)
def blocks_without_one_that_is_wired():
    position_loop().rewire(blocks={k: b for k, b in BLOCKS.items() if k != "pid"})


@mistake(
    DiagramError,
    """
diagram 'position loop' (HERE) has 1 problem:
  1. error.plus is driven 2 times: ref.y -> error.plus; pid.y -> error.plus. Join them with a Sum block.
""",
)
def add_a_second_driver():
    position_loop().rewire(add=["pid -> error.plus"])


@mistake(
    DiagramError,
    """
diagram 'position loop' (HERE) has 1 problem:
  1. wire 'ref -> error.pluss': error (Sum) has no input 'pluss'. Did you mean 'plus'?
""",
)
def add_a_misspelt_wire():
    position_loop().rewire(cut=["ref -> error.plus"], add=["ref -> error.pluss"])


@mistake(TypeError, "Diagram.rewire() got an unexpected keyword argument 'colour'")
def rewire_with_an_unknown_field():
    position_loop().rewire(colour="red")  # no name that newer Pythons find close to another


@mistake(
    DiagramError,
    """
diagram 'from a file' (loops/position.toml) has 1 problem:
  1. insert 'c': a block on a wire has one input and one output, and Sum has 2 inputs (plus, minus). Use rewire, which takes blocks and wires.
""",
)
def an_edit_of_a_diagram_read_from_a_file():
    d = Diagram(title="from a file", blocks=dict(a=Sine(), b=Abs()), wires=["a -> b"], where="loops/position.toml")
    d.insert("c", Sum(), after="a")
