"""Mistakes in the numbers of blocks: names, kinds and bounds."""
# ruff: noqa: E501 - the text of a message stands on one line, as the user reads it

import numpy as np

from tests.mistakes.table import BLOCKS, mistake, position_loop
from tsmblocks.blocks import (
    PID,
    Abs,
    Convert,
    FirstOrderLag,
    Gain,
    LookupTable,
    LookupTable2D,
    Product,
    RateLimit,
    Saturation,
    Sine,
    StateSpace,
    Sum,
    TransferFunction,
    ZeroOrderHold,
)
from tsmblocks.common.errors import BlockError, DiagramError, ParameterError
from tsmblocks.model.block import Block, Input, Output, block, parameter
from tsmblocks.model.diagram import Diagram
from tsmblocks.simulation.batch import simulate_batch
from tsmblocks.simulation.sensitivities import sensitivities
from tsmblocks.simulation.simulate import simulate

# ---- names


@mistake(ParameterError, "PID has no parameter 'kpp'. Did you mean 'kp'?")
def a_parameter_is_misspelt():
    PID(kpp=2.0)


@mistake(ParameterError, "Saturation has no parameter 'upper'. Its name here is 'high'.")
def a_parameter_of_another_tool():
    Saturation(upper=2.0)


@mistake(ParameterError, "Gain takes its parameters by name: gain=2.")
def a_parameter_by_position():
    Gain(2.0)


@mistake(ParameterError, "Gain has no parameter 'u'. Known here: gain, unit.")
def an_input_given_as_a_parameter():
    Gain(u=2.0)


@mistake(ParameterError, "Abs has no parameter 'gain'. There are none.")
def a_parameter_of_a_block_without_any():
    Abs(gain=2.0)


@mistake(ParameterError, "pid: PID has no parameter 'kpp'. Did you mean 'kp'?")
def a_misspelt_parameter_in_with_parameters():
    position_loop().with_parameters({"pid.kpp": 2.0})


@mistake(ParameterError, "diagram 'position loop' has no parameter 'pdi.kp'. Did you mean 'pid.kp'?")
def a_misspelt_block_in_with_parameters():
    position_loop().with_parameters({"pdi.kp": 2.0})


@mistake(ParameterError, "diagram 'position loop' has no parameter 'kp'. Did you mean 'pid.kp'?")
def a_parameter_without_its_block():
    position_loop().with_parameters({"kp": 2.0})


@mistake(ParameterError, "diagram 'position loop' has no parameter 'pid'. Did you mean 'pid.kp'?")
def a_block_without_its_parameter():
    position_loop().with_parameters({"pid": 2.0})


@mistake(
    ParameterError,
    "diagram 'position loop' has no parameter 'temperature'. Known here: drive.high, drive.low, error.signs, motor.den, motor.den[0], motor.den[1], motor.den[2], motor.num, … (23 in all).",
)
def nothing_like_it():
    position_loop().with_parameters({"temperature": 2.0})


@mistake(ParameterError, "loop.pid: PID has no parameter 'kpp'. Did you mean 'kp'?")
def a_misspelt_parameter_of_an_inner_diagram():
    Diagram(title="outer", blocks=dict(loop=position_loop())).with_parameters({"loop.pid.kpp": 2.0})


@mistake(ParameterError, "motor: TransferFunction has no element 'den[3]'. Did you mean 'den[2]'?")
def an_element_beyond_the_last():
    position_loop().with_parameters({"motor.den[3]": 2.0})


@mistake(ParameterError, "pid: PID.kp is one number, so there is no 'kp[0]'.")
def an_element_of_a_number():
    position_loop().with_parameters({"pid.kp[0]": 2.0})


@mistake(ParameterError, "pid: PID has no parameter 'kpp'. Did you mean 'kp'?")
def a_misspelt_parameter_in_simulate():
    simulate(position_loop(), stop=0.1, parameters={"pid.kpp": 2.0})


@mistake(
    ParameterError,
    "diagram 'position loop' has no parameter 'pid.kpp' that can vary between runs. Did you mean 'pid.kp'?",
)
def a_misspelt_parameter_in_a_batch():
    simulate_batch(position_loop(), {"pid.kpp": [1.0, 2.0]}, stop=0.1)


@mistake(
    ParameterError, "diagram 'position loop' has no parameter 'kp' that can vary between runs. Did you mean 'pid.kp'?"
)
def the_end_of_a_name_in_a_batch():
    simulate_batch(position_loop(), {"kp": [1.0, 2.0]}, stop=0.1)


@mistake(
    ParameterError,
    "'hold.period' changes the equations of 'held' (it is an option, or a whole list), so it cannot vary between runs side by side. Simulate once for each value.",
)
def an_option_in_a_batch():
    d = Diagram(
        title="held", blocks=dict(ref=Sine(), hold=ZeroOrderHold()), wires=["ref -> hold"], outputs={"y": "hold"}
    )
    simulate_batch(d, {"hold.period": [0.01, 0.02]}, stop=0.1)


@mistake(
    ParameterError,
    "diagram 'position loop' has no parameter 'pid.kpp' that can vary between runs. Did you mean 'pid.kp'?",
)
def a_misspelt_parameter_in_sensitivities():
    sensitivities(position_loop(), ["pid.kpp"], stop=0.1)


# ---- kinds


@mistake(ParameterError, "PID.kp must be a number, got 'big'. It is: proportional gain.")
def text_where_a_number_belongs():
    PID(kp="big")


@mistake(ParameterError, "pid: PID.kp must be a number, got '2.0'. It is: proportional gain.")
def a_number_written_as_text():
    position_loop().with_parameters({"pid.kp": "2.0"})


@mistake(
    ParameterError,
    "TransferFunction.den[1] must be a number, got 'one'. It is: denominator; its length sets the order.",
)
def text_in_a_list_of_numbers():
    TransferFunction(den=(1.0, "one"))


@mistake(ParameterError, "Gain.gain must be a number, got None. It is: factor from input to output.")
def nothing_where_a_number_belongs():
    Gain(gain=None)


@mistake(ParameterError, "Gain.gain must be a number, got nan. It is: factor from input to output.")
def not_a_number():
    Gain(gain=float("nan"))


@mistake(ParameterError, "Gain.gain must be finite, got inf. It is: factor from input to output.")
def an_infinite_gain():
    Gain(gain=float("inf"))


@mistake(ParameterError, "Gain.gain must be a number, got True. It is: factor from input to output.")
def a_truth_value_where_a_number_belongs():
    Gain(gain=True)


@mistake(ParameterError, "Gain.gain must be a number, got 1j. It is: factor from input to output.")
def a_complex_number():
    Gain(gain=1j)


@mistake(
    ParameterError,
    "TransferFunction.den must be a list of numbers, got 3. It is: denominator; its length sets the order.",
)
def a_number_where_a_list_belongs():
    TransferFunction(den=3.0)


@mistake(ParameterError, "Gain.gain must be a number, got (1.0, 2.0). It is: factor from input to output.")
def a_list_where_a_number_belongs():
    Gain(gain=[1.0, 2.0])


@mistake(
    ParameterError,
    """
TransferFunction.den must be one list of numbers, such as [1, 0.5], got ((1.0, 2.0), (3.0, 4.0)). It is: denominator; \
its length sets the order.""",
)
def a_list_of_lists_where_a_list_belongs():
    TransferFunction(den=[[1.0, 2.0], [3.0, 4.0]])


@mistake(ParameterError, "StateSpace.A must be square, got 2 rows of length 2, 1.")
def a_matrix_of_uneven_rows():
    StateSpace(A=[[0.0, 1.0], [2.0]], B=[[0.0], [1.0]], C=[[1.0, 0.0]])


@mistake(ParameterError, "StateSpace.B must have 2 rows of 1, to match the other matrices, got rows of length 1, 1, 1.")
def a_matrix_of_another_size():
    StateSpace(A=[[0.0, 1.0], [-2.0, -1.0]], B=[[0.0], [1.0], [2.0]], C=[[1.0, 0.0]])


@mistake(
    ParameterError, "Gain.gain must be a number, got ((1.0, 1.0), (1.0, 1.0)). It is: factor from input to output."
)
def a_tuple_where_a_number_belongs_in_an_array():
    Gain(gain=np.ones((2, 2)))


@mistake(ParameterError, "Product.n must be a whole number in [1, 1000], got 2.5. It is: number of inputs.")
def half_an_input():
    Product(n=2.5)


@mistake(ParameterError, "Product.n must be a whole number in [1, 1000], got 0. It is: number of inputs.")
def no_inputs():
    Product(n=0)


@mistake(
    ParameterError,
    "RateLimit.start is 'inputs', which is not a choice. Did you mean 'input'? It is: whether the output starts at the input or at last.",
)
def a_word_that_is_no_choice():
    RateLimit(start="inputs")


@mistake(
    ParameterError,
    "Sum.signs must be one or more of + and -, got '+x'. For two inputs added and one subtracted it is '++-'.",
)
def a_sign_that_is_none():
    Sum(signs="+x")


@mistake(ParameterError, "Sum.signs must be text, got 2. It is: sign of each input, in order.")
def a_number_where_a_word_belongs():
    Sum(signs=2)


@mistake(
    ParameterError,
    "RateLimit.start is 0, which is not a choice. Known here: input, last. It is: whether the output starts at the input or at last.",
)
def a_number_where_a_choice_belongs():
    RateLimit(start=0.0)


@mistake(ParameterError, "Convert.target_unit: 'dge' is not a unit known here. Did you mean 'deg'?")
def a_unit_that_is_none():
    Convert(source_unit="rad", target_unit="dge")


@mistake(ParameterError, "Convert: 'rad' does not convert to 'V'.")
def a_conversion_that_does_not_exist():
    Convert(source_unit="rad", target_unit="V")


@mistake(ParameterError, "Sine.unit: 'radd' is not a unit known here. Did you mean 'rad'?")
def a_source_in_an_unknown_unit():
    Sine(unit="radd")


# ---- bounds


@mistake(ParameterError, "FirstOrderLag.time_constant must lie in (0, inf), got -1. It is: time to 63 % of a step [s].")
def a_negative_time_constant():
    FirstOrderLag(time_constant=-1.0)


@mistake(ParameterError, "FirstOrderLag.time_constant must lie in (0, inf), got 0. It is: time to 63 % of a step [s].")
def a_time_constant_of_zero():
    FirstOrderLag(time_constant=0.0)


@mistake(ParameterError, "ZeroOrderHold.period must lie in (0, inf), got 0. It is: time between samples [s].")
def a_period_of_zero():
    ZeroOrderHold(period=0.0)


@mistake(ParameterError, "Saturation needs low < high, got low=24, high=0.")
def limits_are_swapped():
    Saturation(low=24.0, high=0.0)


@mistake(ParameterError, "Saturation.low must be given where high refers to values ($limit). It is: least output.")
def one_limit_that_refers_to_values():
    Saturation(high="$limit")


@mistake(ParameterError, "drive: Saturation needs low < high, got low=24, high=-24.")
def limits_are_swapped_later():
    position_loop().with_parameters({"drive.low": 24.0, "drive.high": -24.0})


@mistake(ParameterError, "set 1 of the batch: drive: Saturation needs low < high, got low=-24, high=-30.")
def limits_are_swapped_in_a_batch():
    simulate_batch(position_loop(), {"drive.high": [24.0, -30.0]}, stop=0.1)


@mistake(ParameterError, "LookupTable.points must increase, but points[1]=2 and points[2]=1.")
def a_table_that_goes_back():
    LookupTable(points=(0.0, 2.0, 1.0), values=(0.0, 1.0, 2.0))


@mistake(
    ParameterError,
    "LookupTable2D.values must be 3 rows (one for each of points1) of 2 numbers (one for each of points2), got 2 rows of 3. Rows and columns seem to be exchanged: transpose the values.",
)
def a_table_on_its_side():
    LookupTable2D(points1=(0.0, 1.0, 2.0), points2=(0.0, 1.0), values=((0.0, 1.0, 2.0), (3.0, 4.0, 5.0)))


@mistake(ParameterError, "TransferFunction must be proper: 1 <= len(num) <= len(den), got 3 and 2.")
def a_transfer_function_that_is_not_proper():
    TransferFunction(num=(1.0, 0.0, 0.0), den=(1.0, 1.0))


@mistake(
    ParameterError, "loop.pid: PID.tau must lie in (0, inf), got -1. It is: time constant of the derivative filter [s]."
)
def a_bound_is_passed_in_an_inner_diagram():
    Diagram(title="outer", blocks=dict(loop=position_loop())).with_parameters({"loop.pid.tau": -1.0})


@mistake(ParameterError, "set 1 of the batch: drive: Saturation needs low < high, got low=1, high=0.5.")
def limits_cross_in_one_set_of_a_batch():
    simulate_batch(position_loop(), {"drive.low": [-9.0, 1.0, 5.0], "drive.high": [-8.0, 0.5, 6.0]}, stop=0.1)


@mistake(ParameterError, "parameters must map names to numbers, got ['pid.kp'].")
def parameters_as_a_list():
    simulate(position_loop(), stop=0.1, parameters=["pid.kp"])


@mistake(ParameterError, "pid: PID.tau must lie in (0, inf), got 0. It is: time constant of the derivative filter [s].")
def a_bound_is_passed_in_simulate():
    simulate(position_loop(), stop=0.1, parameters={"pid.tau": 0.0})


@mistake(
    ParameterError,
    "set 1 of the batch: pid: PID.tau must lie in (0, inf), got 0. It is: time constant of the derivative filter [s].",
)
def a_bound_is_passed_in_a_batch():
    simulate_batch(position_loop(), {"pid.tau": [0.01, 0.0]}, stop=0.1)


@mistake(ParameterError, "the parameters of a batch need one value per set each; pid.kp has 2, pid.ki has 3.")
def a_batch_of_different_lengths():
    simulate_batch(position_loop(), {"pid.kp": [1.0, 2.0], "pid.ki": [1.0, 2.0, 3.0]}, stop=0.1)


@mistake(ParameterError, "a batch of 'position loop' needs at least one parameter with at least one value.")
def an_empty_batch():
    simulate_batch(position_loop(), {}, stop=0.1)


@mistake(ParameterError, "'pid.kp' must have one number per set of the batch, got ['one', 'two'].")
def text_in_a_batch():
    simulate_batch(position_loop(), {"pid.kp": ["one", "two"]}, stop=0.1)


@mistake(ParameterError, "set 1 of the batch: pid: PID.kp must be a number, got nan. It is: proportional gain.")
def not_a_number_in_a_batch():
    simulate_batch(position_loop(), {"pid.kp": [1.0, float("nan")]}, stop=0.1)


@mistake(ParameterError, "'pid.kp' must have one number per set of the batch, got an array of shape (2, 2).")
def a_table_in_a_batch():
    simulate_batch(position_loop(), {"pid.kp": [[1.0, 2.0], [3.0, 4.0]]}, stop=0.1)


# ---- the table of values


@mistake(
    DiagramError,
    """
diagram 'position loop' (HERE) has 1 problem:
  1. pid: '$kpp' refers to a number that is not in values. Did you mean 'kp'?
""",
)
def a_reference_to_no_value():
    position_loop(blocks={**BLOCKS, "pid": PID(kp="$kpp")}, values={"kp": 2.0})


@mistake(
    DiagramError,
    """
diagram 'position loop' (HERE) has 1 problem:
  1. pid: '$kp' refers to a number that is not in values. There are none.
""",
)
def a_reference_without_a_table():
    position_loop(blocks={**BLOCKS, "pid": PID(kp="$kp")})


@mistake(
    DiagramError,
    """
diagram 'position loop' (HERE) has 1 problem:
  1. pid: PID.tau must lie in (0, inf), got -1. It is: time constant of the derivative filter [s]. From values: tau = -1.
""",
)
def a_value_out_of_bounds():
    position_loop(blocks={**BLOCKS, "pid": PID(tau="$tau")}, values={"tau": -1.0})


@mistake(
    DiagramError,
    """
diagram 'position loop' (HERE) has 1 problem:
  1. drive: Saturation needs low < high, got low=-24, high=-30. From values: limit = -30.
""",
)
def limits_swapped_by_a_value():
    position_loop(blocks={**BLOCKS, "drive": Saturation(low=-24.0, high="$limit")}, values={"limit": -30.0})


@mistake(
    DiagramError,
    """
diagram 'position loop' (HERE) has 1 problem:
  1. value 'kp' must be a number, got 'two'.
""",
)
def a_value_that_is_text():
    position_loop(blocks={**BLOCKS, "pid": PID(kp="$kp")}, values={"kp": "two"})


@mistake(
    DiagramError,
    """
diagram 'position loop' (HERE) has 1 problem:
  1. value 'kp' must be a number, got nan.
""",
)
def a_value_that_is_not_a_number():
    position_loop(values={"kp": float("nan")})


@mistake(
    DiagramError,
    """
diagram 'position loop' (HERE) has 1 problem:
  1. pid: PID.tau must lie in (0, inf), got 0. It is: time constant of the derivative filter [s]. From values: tau = 0.
""",
)
def a_value_out_of_bounds_later():
    position_loop(blocks={**BLOCKS, "pid": PID(tau="$tau")}, values={"tau": 0.1}).with_parameters({"tau": 0.0})


@mistake(
    ParameterError,
    "Sum.signs is an option, and only a parameter can refer to values, got '$signs'. It is: sign of each input, in order.",
)
def a_reference_where_a_word_belongs():
    Sum(signs="$signs")


@mistake(
    ParameterError,
    "ZeroOrderHold.period is an option, and only a parameter can refer to values, got '$T'. It is: time between samples [s].",
)
def a_reference_where_a_period_belongs():
    ZeroOrderHold(period="$T")


@mistake(ParameterError, "diagram 'position loop' has no parameter 'tua'. Did you mean 'tau'?")
def a_misspelt_value_later():
    position_loop(blocks={**BLOCKS, "pid": PID(tau="$tau")}, values={"tau": 0.1}).with_parameters({"tua": 0.2})


# ---- declarations


@mistake(BlockError, "MyGain must derive from Block itself, not from Gain. Write class MyGain(Block).")
def a_block_that_inherits_from_a_block():
    @block(register=False)
    class MyGain(Gain):
        pass


@mistake(BlockError, "MyGain must derive from Block itself, not from object. Write class MyGain(Block).")
def a_block_that_inherits_from_nothing():
    @block(register=False)
    class MyGain:
        pass


@mistake(
    BlockError,
    "A block named Gain exists already, in tsmblocks.blocks.arithmetic. Choose another name, or use @block(register=False).",
)
def a_name_that_is_taken():
    @block
    class Gain(Block):
        """Another gain."""


@mistake(ParameterError, "the default of Wrong.k must be a number, got 'one'. It is: gain.")
def a_block_with_a_default_of_text():
    @block(register=False)
    class Wrong(Block):
        k: float = parameter(default="one", about="gain")


@mistake(BlockError, "Wrong.k must be made by parameter, option or state (or be a ClassVar).")
def a_number_that_is_not_declared_as_a_parameter():
    @block(register=False)
    class Wrong(Block):
        k: float = 1.0
        u = Input("in")
        y = Output("out")


@mistake(BlockError, "Wrong.u is a port and takes no annotation: u = Input(…) or Output(…).")
def a_port_with_an_annotation():
    @block(register=False)
    class Wrong(Block):
        u: Input = Input("in")
        y = Output("out")


@mistake(ParameterError, "the default of Wrong.k must lie in (0, inf), got -1. It is: gain.")
def a_default_out_of_its_own_bounds():
    @block(register=False)
    class Wrong(Block):
        k: float = parameter(default=-1.0, about="gain", above=0.0)

    Wrong()


@mistake(BlockError, "Wrong: 'outputs' cannot name a port or a parameter. Choose another name.")
def a_port_named_like_a_method():
    @block(register=False)
    class Wrong(Block):
        outputs = Output("all")


@mistake(BlockError, "Wrong: 'states' cannot name a port or a parameter. Choose another name.")
def a_parameter_named_like_a_property():
    @block(register=False)
    class Wrong(Block):
        states: float = parameter(default=1.0, about="number of states")


@mistake(BlockError, "Wrong: '_u' cannot name a port or a parameter. Choose another name.")
def a_port_by_a_name_wires_cannot_say():
    @block(register=False)
    class Wrong(Block):
        _u = Input("hidden")


@mistake(ParameterError, "PID has no parameter 'kpp'. Did you mean 'kp'?")
def a_misspelt_keyword_of_replace():
    PID().replace(kpp=1.0)
