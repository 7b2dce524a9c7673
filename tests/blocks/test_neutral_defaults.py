"""Controllers and general linear blocks pass a signal unchanged by default: no default acts beside what is given."""

import control
import numpy as np
import pytest

import tsmblocks as tsm
from tsmblocks import blocks as b
from tsmblocks.common.errors import ParameterError

T = np.linspace(0.0, 1.0, 101)
SIGNAL = 100.0 * np.sin(7.0 * T) + 30.0


def response(block, port="u"):
    ports = {name: f"b.{name}" for name in block.inports if name == port}
    diagram = tsm.Diagram(blocks={"b": block}, wires=[], inputs=ports, outputs={"y": f"b.{next(iter(block.outports))}"})
    return tsm.simulate(diagram, inputs={port: (T, SIGNAL)}, step=0.01, hold="zero")["y"]


@pytest.mark.parametrize(
    ("cls", "port"),
    [
        (b.PID, "e"),
        (b.DiscretePID, "e"),
        (b.PIDController, "r"),
        (b.LeadLag, "u"),
        (b.TransferFunction, "u"),
        (b.ZeroPoleGain, "u"),
        (b.StateSpace, "u"),
        (b.DiscreteTransferFunction, "u"),
        (b.DiscreteStateSpace, "u"),
    ],
)
def test_the_default_passes_the_signal(cls, port):
    block = cls(period=0.01) if cls.sampled else cls()
    if cls is b.PIDController:
        diagram = tsm.Diagram(
            blocks={"b": block, "zero": b.Constant(value=0.0)},
            wires=["zero -> b.ym"],
            inputs={"r": "b.r"},
            outputs={"y": "b.u"},
        )
        y = tsm.simulate(diagram, inputs={"r": (T, SIGNAL)}, step=0.01, hold="zero")["y"]
    else:
        y = response(block, port)
    assert np.abs(y - SIGNAL).max() < 1e-12


def test_zeros_poles_and_a_gain_are_all_there_is():
    block = b.ZeroPoleGain(zeros=[-1.0], poles=[-2.0], gain=4.0)
    theirs = control.forced_response(control.zpk([-1.0], [-2.0], 4.0), T, SIGNAL).outputs
    diagram = tsm.Diagram(blocks={"b": block}, wires=[], inputs={"u": "b.u"}, outputs={"y": "b.y"})
    ours = tsm.simulate(diagram, inputs={"u": (T, SIGNAL)}, step=1e-3, hold="linear")["y"]
    assert np.abs(ours[::10] - theirs).max() < 1e-6
    assert list(block.states) == ["x1"]


def test_a_state_matrix_alone_is_not_filled_up():
    with pytest.raises(ParameterError, match="needs at least one input"):
        b.StateSpace(A=[[-1.0]])
    assert response(b.StateSpace(D=[[2.0]])) == pytest.approx(2.0 * SIGNAL)


def test_a_proportional_controller_has_no_integral_action_at_its_limit():
    """Without integral action there is nothing that could wind up, nor anything that anti-windup may move."""
    for block, port in ((b.PIDController, "r"), (b.DiscretePID, "e")):
        p = block(kp=10.0, low=-1.0, high=1.0)
        signal = b.Step(time=0.5, before=2.0, after=0.05)
        y = {"r": "u", "e": "y"}[port]
        wires = [f"s -> p.{port}"] + (["zero -> p.ym"] if port == "r" else [])
        blocks = {"s": signal, "p": p} | ({"zero": b.Constant(value=0.0)} if port == "r" else {})
        run = tsm.simulate(tsm.Diagram(blocks=blocks, wires=wires, outputs={"y": f"p.{y}"}), stop=1.0, step=0.01)
        assert run["y"][10] == 1.0
        assert run["y"][-1] == pytest.approx(0.5, abs=1e-12)


@pytest.mark.parametrize("field", ["zeros", "poles"])
def test_rows_in_the_place_of_numbers_are_named(field):
    with pytest.raises(
        ParameterError, match=rf"ZeroPoleGain\.{field} must be one list of numbers, .*{field[:-1]}_pairs"
    ):
        b.ZeroPoleGain(**{field: [[-2.0, 3.0]]})


@pytest.mark.parametrize("field", ["amplitudes", "frequencies", "phases"])
def test_rows_of_tones_are_named(field):
    with pytest.raises(ParameterError, match=f"MultiSine.{field} must be one list of numbers"):
        b.MultiSine(**{field: [[1.0], 2.0]})
