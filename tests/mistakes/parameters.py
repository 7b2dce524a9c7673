"""Mistakes in the numbers of blocks: names, kinds and bounds."""

import numpy as np

from tests.mistakes.table import BLOCKS, mistake, position_loop
from tsmblocks.batch import sensitivities, simulate_batch
from tsmblocks.block import Block, Input, Output, block, option, parameter
from tsmblocks.blocks import (
    Bias, Constant, Convert, Delay, DiscretePID, FirstOrderLag, Gain, LookupTable, PID, Product, RateLimit, Relay, Saturation,
    Sine, Sum, TransferFunction, ZeroOrderHold,
)
from tsmblocks.diagram import Diagram
from tsmblocks.errors import BlockError, DiagramError, ParameterError
from tsmblocks.simulate import simulate

# ---- names


@mistake(ParameterError, "?")
def a_parameter_is_misspelt():
    PID(kpp=2.0)


@mistake(ParameterError, "?")
def a_parameter_of_another_tool():
    Saturation(upper=2.0)


@mistake(ParameterError, "?")
def a_parameter_by_position():
    Gain(2.0)


@mistake(ParameterError, "?")
def an_input_given_as_a_parameter():
    Gain(u=2.0)


@mistake(ParameterError, "?")
def a_parameter_of_a_block_without_any():
    from tsmblocks.blocks import Abs

    Abs(gain=2.0)


@mistake(ParameterError, "?")
def a_misspelt_parameter_in_with_parameters():
    position_loop().with_parameters({"pid.kpp": 2.0})


@mistake(ParameterError, "?")
def a_misspelt_block_in_with_parameters():
    position_loop().with_parameters({"pdi.kp": 2.0})


@mistake(ParameterError, "?")
def a_parameter_without_its_block():
    position_loop().with_parameters({"kp": 2.0})


@mistake(ParameterError, "?")
def a_block_without_its_parameter():
    position_loop().with_parameters({"pid": 2.0})


@mistake(ParameterError, "?")
def nothing_like_it():
    position_loop().with_parameters({"temperature": 2.0})


@mistake(ParameterError, "?")
def a_misspelt_parameter_of_an_inner_diagram():
    Diagram(title="outer", blocks=dict(loop=position_loop())).with_parameters({"loop.pid.kpp": 2.0})


@mistake(ParameterError, "?")
def an_element_beyond_the_last():
    position_loop().with_parameters({"motor.den[3]": 2.0})


@mistake(ParameterError, "?")
def an_element_of_a_number():
    position_loop().with_parameters({"pid.kp[0]": 2.0})


@mistake(ParameterError, "?")
def a_misspelt_parameter_in_simulate():
    simulate(position_loop(), stop=0.1, parameters={"pid.kpp": 2.0})


@mistake(ParameterError, "?")
def a_misspelt_parameter_in_a_batch():
    simulate_batch(position_loop(), {"pid.kpp": [1.0, 2.0]}, stop=0.1)


@mistake(ParameterError, "?")
def an_option_in_a_batch():
    d = Diagram(title="held", blocks=dict(ref=Sine(), hold=ZeroOrderHold()), wires=["ref -> hold"], outputs={"y": "hold"})
    simulate_batch(d, {"hold.period": [0.01, 0.02]}, stop=0.1)


@mistake(ParameterError, "?")
def a_misspelt_parameter_in_sensitivities():
    sensitivities(position_loop(), ["pid.kpp"], stop=0.1)


# ---- kinds


@mistake(ParameterError, "?")
def text_where_a_number_belongs():
    PID(kp="big")


@mistake(ParameterError, "?")
def a_number_written_as_text():
    position_loop().with_parameters({"pid.kp": "2.0"})


@mistake(ParameterError, "?")
def text_in_a_list_of_numbers():
    TransferFunction(den=(1.0, "one"))


@mistake(ParameterError, "?")
def nothing_where_a_number_belongs():
    Gain(gain=None)


@mistake(ParameterError, "?")
def not_a_number():
    Gain(gain=float("nan"))


@mistake(ParameterError, "?")
def an_infinite_gain():
    Gain(gain=float("inf"))


@mistake(ParameterError, "?")
def a_truth_value_where_a_number_belongs():
    Gain(gain=True)


@mistake(ParameterError, "?")
def a_complex_number():
    Gain(gain=1j)


@mistake(ParameterError, "?")
def a_number_where_a_list_belongs():
    TransferFunction(den=3.0)


@mistake(ParameterError, "?")
def a_list_where_a_number_belongs():
    Gain(gain=[1.0, 2.0])


@mistake(ParameterError, "?")
def a_list_of_lists_where_a_list_belongs():
    TransferFunction(den=[[1.0, 2.0], [3.0, 4.0]])


@mistake(ParameterError, "?")
def a_matrix_of_uneven_rows():
    from tsmblocks.blocks import StateSpace

    StateSpace(A=[[0.0, 1.0], [2.0]], B=[[0.0], [1.0]], C=[[1.0, 0.0]])


@mistake(ParameterError, "?")
def a_matrix_of_another_size():
    from tsmblocks.blocks import StateSpace

    StateSpace(A=[[0.0, 1.0], [-2.0, -1.0]], B=[[0.0], [1.0], [2.0]], C=[[1.0, 0.0]])


@mistake(ParameterError, "?")
def a_tuple_where_a_number_belongs_in_an_array():
    Gain(gain=np.ones((2, 2)))


@mistake(ParameterError, "?")
def half_an_input():
    Product(n=2.5)


@mistake(ParameterError, "?")
def no_inputs():
    Product(n=0)


@mistake(ParameterError, "?")
def a_word_that_is_no_choice():
    RateLimit(start="inputs")


@mistake(ParameterError, "?")
def a_sign_that_is_none():
    Sum(signs="+x")


@mistake(ParameterError, "?")
def a_number_where_a_word_belongs():
    Sum(signs=2)


@mistake(ParameterError, "?")
def a_number_where_a_choice_belongs():
    RateLimit(start=0.0)


@mistake(ParameterError, "?")
def a_unit_that_is_none():
    Convert(source_unit="rad", target_unit="dge")


@mistake(ParameterError, "?")
def a_conversion_that_does_not_exist():
    Convert(source_unit="rad", target_unit="V")


@mistake(ParameterError, "?")
def a_source_in_an_unknown_unit():
    Sine(unit="radd")


# ---- bounds


@mistake(ParameterError, "?")
def a_negative_time_constant():
    FirstOrderLag(time_constant=-1.0)


@mistake(ParameterError, "?")
def a_time_constant_of_zero():
    FirstOrderLag(time_constant=0.0)


@mistake(ParameterError, "?")
def a_period_of_zero():
    ZeroOrderHold(period=0.0)


@mistake(ParameterError, "?")
def limits_are_swapped():
    Saturation(low=24.0, high=0.0)


@mistake(ParameterError, "?")
def limits_are_swapped_later():
    position_loop().with_parameters({"drive.low": 24.0, "drive.high": -24.0})


@mistake(ParameterError, "?")
def limits_are_swapped_in_a_batch():
    simulate_batch(position_loop(), {"drive.high": [24.0, -30.0]}, stop=0.1)


@mistake(ParameterError, "?")
def a_table_that_goes_back():
    LookupTable(points=(0.0, 2.0, 1.0), values=(0.0, 1.0, 2.0))


@mistake(ParameterError, "?")
def a_transfer_function_that_is_not_proper():
    TransferFunction(num=(1.0, 0.0, 0.0), den=(1.0, 1.0))


@mistake(ParameterError, "?")
def a_bound_is_passed_in_an_inner_diagram():
    Diagram(title="outer", blocks=dict(loop=position_loop())).with_parameters({"loop.pid.tau": -1.0})


@mistake(ParameterError, "?")
def a_bound_is_passed_in_simulate():
    simulate(position_loop(), stop=0.1, parameters={"pid.tau": 0.0})


@mistake(ParameterError, "?")
def a_bound_is_passed_in_a_batch():
    simulate_batch(position_loop(), {"pid.tau": [0.01, 0.0]}, stop=0.1)


@mistake(ParameterError, "?")
def a_batch_of_different_lengths():
    simulate_batch(position_loop(), {"pid.kp": [1.0, 2.0], "pid.ki": [1.0, 2.0, 3.0]}, stop=0.1)


@mistake(ParameterError, "?")
def an_empty_batch():
    simulate_batch(position_loop(), {}, stop=0.1)


@mistake(ParameterError, "?")
def text_in_a_batch():
    simulate_batch(position_loop(), {"pid.kp": ["one", "two"]}, stop=0.1)


@mistake(ParameterError, "?")
def not_a_number_in_a_batch():
    simulate_batch(position_loop(), {"pid.kp": [1.0, float("nan")]}, stop=0.1)


@mistake(ParameterError, "?")
def a_table_in_a_batch():
    simulate_batch(position_loop(), {"pid.kp": [[1.0, 2.0], [3.0, 4.0]]}, stop=0.1)


# ---- the table of values


@mistake(DiagramError, "?")
def a_reference_to_no_value():
    position_loop(blocks={**BLOCKS, "pid": PID(kp="$kpp")}, values={"kp": 2.0})


@mistake(DiagramError, "?")
def a_reference_without_a_table():
    position_loop(blocks={**BLOCKS, "pid": PID(kp="$kp")})


@mistake(DiagramError, "?")
def a_value_out_of_bounds():
    position_loop(blocks={**BLOCKS, "pid": PID(tau="$tau")}, values={"tau": -1.0})


@mistake(DiagramError, "?")
def limits_swapped_by_a_value():
    position_loop(blocks={**BLOCKS, "drive": Saturation(high="$limit")}, values={"limit": -30.0})


@mistake(DiagramError, "?")
def a_value_that_is_text():
    position_loop(blocks={**BLOCKS, "pid": PID(kp="$kp")}, values={"kp": "two"})


@mistake(DiagramError, "?")
def a_value_that_is_not_a_number():
    position_loop(values={"kp": float("nan")})


@mistake(DiagramError, "?")
def a_value_out_of_bounds_later():
    position_loop(blocks={**BLOCKS, "pid": PID(tau="$tau")}, values={"tau": 0.1}).with_parameters({"tau": 0.0})


@mistake(ParameterError, "?")
def a_reference_where_a_word_belongs():
    Sum(signs="$signs")


@mistake(ParameterError, "?")
def a_reference_where_a_period_belongs():
    ZeroOrderHold(period="$T")


@mistake(ParameterError, "?")
def a_misspelt_value_later():
    position_loop(blocks={**BLOCKS, "pid": PID(tau="$tau")}, values={"tau": 0.1}).with_parameters({"tua": 0.2})


# ---- declarations


@mistake(BlockError, "?")
def a_block_that_inherits_from_a_block():
    @block(register=False)
    class MyGain(Gain):
        pass


@mistake(BlockError, "?")
def a_block_that_inherits_from_nothing():
    @block(register=False)
    class MyGain:
        pass


@mistake(BlockError, "?")
def a_name_that_is_taken():
    @block
    class Gain(Block):
        """Another gain."""


@mistake(BlockError, "?")
def a_block_with_a_default_of_text():
    @block(register=False)
    class Wrong(Block):
        k: float = parameter(default="one", about="gain")


@mistake(BlockError, "?")
def a_number_that_is_not_declared_as_a_parameter():
    @block(register=False)
    class Wrong(Block):
        k: float = 1.0
        u = Input("in")
        y = Output("out")


@mistake(BlockError, "?")
def a_port_with_an_annotation():
    @block(register=False)
    class Wrong(Block):
        u: Input = Input("in")
        y = Output("out")


@mistake(BlockError, "?")
def a_default_out_of_its_own_bounds():
    @block(register=False)
    class Wrong(Block):
        k: float = parameter(default=-1.0, about="gain", above=0.0)

    Wrong()


@mistake(BlockError, "?")
def a_port_named_like_a_method():
    @block(register=False)
    class Wrong(Block):
        outputs = Output("all")


@mistake(BlockError, "?")
def a_parameter_named_like_a_property():
    @block(register=False)
    class Wrong(Block):
        states: float = parameter(default=1.0, about="number of states")


@mistake(BlockError, "?")
def a_port_by_a_name_wires_cannot_say():
    @block(register=False)
    class Wrong(Block):
        _u = Input("hidden")


@mistake(ParameterError, "?")
def a_misspelt_keyword_of_replace():
    PID().replace(kpp=1.0)


del Bias, Constant, Delay, DiscretePID, Relay, option
