"""Blocks made of plain Python functions."""

from __future__ import annotations

import pickle

import casadi as ca
import pytest

from tests.blocks.helpers import Bench, value
from tsmblocks.blocks.function import function_block
from tsmblocks.common.errors import BlockError, EquationError
from tsmblocks.model.block import REGISTRY, Block, signals


def plain_cube(u, k=0.3):
    """Stiffening: the output grows with the cube of the input."""
    return k * u**3


cube = function_block(units={"u": "rad", "k": "1/s", "y": "rad"}, about={"u": "twist", "y": "answer"}, register=False)(
    plain_cube
)


def test_inputs_parameters_and_output_come_from_the_signature():
    block = cube(k=0.5)
    assert value(block, u=2.0) == {"y": 4.0}
    assert value(cube(), u=2.0)["y"] == pytest.approx(2.4)
    assert cube.__name__ == "plain_cube"
    assert cube.__bases__ == (Block,)
    assert cube.__doc__ == "Stiffening: the output grows with the cube of the input."
    assert cube.function(2.0, k=1.0) == 8
    assert (block.inports["u"].about, block.inports["u"].unit) == ("twist", "rad")
    assert (block.outports["y"].about, block.outports["y"].unit) == ("answer", "rad")
    assert (cube.fields()["k"].about, cube.fields()["k"].unit) == ("parameter k", "1/s")
    assert block.symbol == "plain_cube"
    assert "plain_cube" in block.source


def test_it_is_a_value_and_keeps_its_symbols():
    assert cube(k=0.5) == cube(k=0.5) != cube(k=0.6)
    bench = Bench(cube())
    assert ca.depends_on(bench.y_of, bench.u)
    assert bench.uses == {"k": True}


def test_registered_under_its_name_unless_told_not_to():
    @function_block
    def test_only_gain(u, k=2.0):
        return k * u

    try:
        assert REGISTRY["test_only_gain"] is test_only_gain
        assert value(test_only_gain(), u=3.0)["y"] == 6
        assert test_only_gain.__doc__ == "The Python function test_only_gain(u, k=2.0)."
    finally:
        del REGISTRY["test_only_gain"]
    assert "plain_cube" not in REGISTRY


@function_block(outputs=("total", "swing"), register=False)
def mixer(t, a, b, *, weights=(1.0, 2.0), omega=3):
    return weights[0] * a + weights[1] * b, ca.sin(omega * t)


def test_time_several_outputs_and_lists():
    block = mixer(weights=(1, 10))
    assert list(block.inports) == ["a", "b"]
    assert list(block.outports) == ["total", "swing"]
    y = block.outputs(2.0, signals((), ()), signals(("a", "b"), (3.0, 4.0)))
    assert y["total"] == 43
    assert float(y["swing"]) == pytest.approx(-0.27941549819892586)
    assert mixer().omega == 3.0
    assert pickle.loads(pickle.dumps(block)) == block


def test_no_arguments_at_all():
    @function_block(register=False)
    def clock(t):
        return 2 * t

    assert clock().outputs(3.0, signals((), ()), signals((), ())) == {"y": 6.0}


def refused(message, function, **options):
    with pytest.raises(BlockError) as caught:
        function_block(function, register=False, **options)
    assert str(caught.value) == message


def test_refuses_signatures_that_are_no_block():
    def stars(*inputs):
        return inputs[0]

    def double_stars(u, **values):
        return u

    def text(u, mode="fast"):
        return u

    def truth(u, flag=True):
        return u

    def bare(u, *, k):
        return u * k

    def hidden(u, k=1.0, /):
        return u * k

    def late(u, t):
        return u * t

    def clash(y):
        return y

    def reserved(u, source=1.0):
        return u * source

    refused("stars(*inputs) cannot be a block: name each input and each parameter.", stars)
    refused("double_stars(**values) cannot be a block: name each input and each parameter.", double_stars)
    wanted = "must be a number or a tuple of numbers, got"
    refused(f"text: the default of 'mode' {wanted} 'fast'. Without a default it would be an input.", text)
    refused(f"truth: the default of 'flag' {wanted} True. Without a default it would be an input.", truth)
    refused("bare: 'k' is keyword only ('*') and has no default. Give it a number as default.", bare)
    refused("hidden: parameter 'k' is positional only ('/'), but parameters are given by name.", hidden)
    refused("late: 't' is the time and must be the first argument.", late)
    refused("clash: 'y' is used twice. Choose another name, or name the outputs: outputs=('…',).", clash)
    refused("reserved: 'source' cannot name an input, a parameter or an output. Choose another name.", reserved)


def test_refuses_words_for_what_is_not_there():
    refused("plain_cube: units names 'kk', which it does not have. Did you mean 'k'?", plain_cube, units={"kk": "1"})
    refused(
        "plain_cube: about names 'out', which it does not have. Known here: k, u, y.", plain_cube, about={"out": "…"}
    )
    refused(
        "plain_cube: unit of 'u': 'radd' is not a unit known here. Did you mean 'rad'?", plain_cube, units={"u": "radd"}
    )
    with pytest.raises(BlockError, match=r"^function_block needs a function made by def, with a name, got <"):
        function_block(lambda u: u)


def test_says_when_the_function_returns_too_little():
    @function_block(register=False)
    def nothing(u):
        pass

    @function_block(outputs=("a", "b"), register=False)
    def single(u):
        return u

    none = signals((), ())
    for cls, message in (
        (nothing, "nothing must return y, got nothing."),
        (single, "single must return a, b, got 1 value."),
    ):
        with pytest.raises(EquationError) as caught:
            cls().outputs(0.0, none, signals(("u",), (1.0,)))
        assert str(caught.value) == message
