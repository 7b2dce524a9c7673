"""Every mistake in tests/mistakes gets one clear answer, word for word."""

import inspect
import pickle
import re
import traceback
import warnings

import control  # noqa: F401 - loaded here, so that what it and Matplotlib warn of is no answer to a mistake
import pytest

from tests.mistakes.all import TABLE
from tests.mistakes.table import position_loop, said
from tsmblocks.blocks import Abs, Divide, FirstOrderLag, Gain, Sine, Sum
from tsmblocks.common import errors
from tsmblocks.common.errors import AlgebraicLoop, DiagramError, NotFinite, TsmError, in_words, near, several
from tsmblocks.compiler.compile import compile_diagram
from tsmblocks.model.diagram import Diagram
from tsmblocks.model.parameters import near_path
from tsmblocks.simulation.batch import simulate_batch
from tsmblocks.simulation.simulate import simulate
from tsmblocks.simulation.stability import StepWarning
from tsmblocks.simulation.stepper import Stepper

ROWS = {
    "misspelt port": "a_port_is_misspelt",
    "unknown block": "a_block_is_misspelt",
    "two wires into one input": "two_wires_into_one_input",
    "input left open": "an_input_left_open",
    "sizes differ (signals are scalars: units differ)": "degrees_into_radians",
    "algebraic loop": "an_algebraic_loop",
    "limits swapped": "limits_are_swapped",
    "duplicate name": "two_blocks_of_one_name",
    "block not added": "a_block_was_never_added",
    "reports all faults at once": "everything_at_once",
    "well-posed algebraic loop": "an_algebraic_loop",
    "input not connected": "several_inputs_left_open",
    "two drivers on one input": "a_wire_and_an_input_into_one_port",
    "NaN in a block": "zero_over_zero",
    "NaN in a user's block": "the_logarithm_of_a_negative_number",
    "wrong size": "a_matrix_of_another_size",
    "port index": "a_port_number_instead_of_a_name",
    "misspelt parameter": "a_parameter_is_misspelt",
    "text where a number belongs": "text_where_a_number_belongs",
}
"""The mistakes that other tools answer badly or not at all, and who makes them here."""


CLASSES = {c for c in vars(errors).values() if inspect.isclass(c) and issubclass(c, TsmError)} - {TsmError}


def caught(row):
    """The exception a mistake raises; warnings on the way count as noise."""
    with warnings.catch_warnings():
        warnings.simplefilter("error")
        try:
            row.make()
        except Exception as error:
            return error
    raise AssertionError(f"{row} raises nothing")


@pytest.mark.parametrize("row", TABLE, ids=str)
def test_mistake(row):
    error = caught(row)
    assert type(error) is row.error
    assert said(error) == row.text


@pytest.mark.parametrize("row", TABLE, ids=str)
def test_the_user_sees_one_error_and_no_other(row):
    error = caught(row)
    shown = "".join(traceback.format_exception(error))
    assert ("direct cause" in shown) == row.cause
    assert "During handling" not in shown


@pytest.mark.parametrize("row", [r for r in TABLE if issubclass(r.error, DiagramError)], ids=str)
def test_a_diagram_error_has_a_line_for_each_fault(row):
    error = caught(row)
    assert error.where.partition(":")[0] in str(error)
    assert str(error).count("\n") == len(error.problems)


def test_a_diagram_error_says_where_the_diagram_was_written():
    with pytest.raises(DiagramError) as caught:
        Diagram(title="here", blocks=dict(k=Gain()))
    here = inspect.currentframe().f_lineno - 1
    assert caught.value.where == f"{__file__}:{here}"
    assert caught.value.diagram == "here"
    sound = Diagram(title="there", blocks=dict(ref=Sine(), k=Gain()), wires=["ref -> k"])
    there = inspect.currentframe().f_lineno - 1
    with pytest.raises(DiagramError) as caught:
        sound.remove("k").remove("ref").insert("k", Gain(), after="ref")
    assert caught.value.where == f"{__file__}:{there}"


@pytest.mark.parametrize("row", [r for r in TABLE if issubclass(r.error, TsmError)], ids=str)
def test_errors_cross_to_other_processes(row):
    error = caught(row)
    there = pickle.loads(pickle.dumps(error))
    assert type(there) is type(error)
    assert str(there) == str(error)
    assert getattr(there, "path", ()) == getattr(error, "path", ())


def test_every_error_has_a_mistake_that_raises_it():
    assert {row.error for row in TABLE} >= CLASSES


def test_the_tree_in_the_module_names_every_error():
    assert set(re.findall(r"[├└]── (\w+)", errors.__doc__)) == {c.__name__ for c in CLASSES}


@pytest.mark.parametrize("mistake", ROWS)
def test_rows_that_other_tools_get_wrong(mistake):
    assert ROWS[mistake] in {row.make.__name__ for row in TABLE}


def test_no_two_mistakes_have_one_name():
    names = [str(row) for row in TABLE]
    assert len(names) == len(set(names)) > 200


# ---- fields


def test_a_loop_carries_its_path_in_the_direction_of_flow():
    inner = Diagram(blocks=dict(a=Gain(), b=Abs()), wires=["a -> b"], inputs={"i": "a.u"}, outputs={"o": "b"})
    outer = Diagram(blocks=dict(half=inner), inputs={"i": "half.i"}, outputs={"o": "half.o"})
    loop = Diagram(
        blocks=dict(ref=Sine(), error=Sum(), deep=outer), wires=["ref -> error.plus", "error -> deep -> error.minus"]
    )
    with pytest.raises(AlgebraicLoop) as caught:
        compile_diagram(loop, refuse_loops=True)
    path = caught.value.path
    assert path == ("error.y", "deep.half.a.y", "deep.half.b.y", "error.y")


def test_a_failed_run_carries_block_time_and_what_there_is():
    loop = Diagram(
        blocks=dict(ref=Sine(unit="1"), error=Sum(signs="++"), grow=FirstOrderLag(gain=20.0)),
        wires=["ref -> error.plus1", "error -> grow -> error.plus2"],
        outputs={"y": "grow"},
    )
    with pytest.raises(NotFinite) as caught:
        simulate(loop, stop=10.0, step=0.01)
    error = caught.value
    assert error.block == "grow"
    assert 1.0 < error.time < 5.0
    assert error.run.t[-1] == pytest.approx(error.time - 0.01)
    assert not error.run.complete


def test_a_stepper_stands_where_it_was_after_a_failed_step():
    blocks = dict(lag=FirstOrderLag(), q=Divide())
    wires = ["lag -> q.num"]
    stepper = Stepper(Diagram(blocks=blocks, wires=wires, inputs={"a": "lag.u", "b": "q.den"}, outputs={"y": "q"}))
    first = stepper.step({"a": 1.0, "b": 1.0})
    with pytest.raises(NotFinite) as caught:
        stepper.step({"a": 1.0, "b": 0.0})
    assert caught.value.block == "q"
    assert stepper.t == caught.value.time == pytest.approx(0.001)
    again = stepper.step({"a": 1.0, "b": 1.0})
    assert again["y"] == pytest.approx(2 * first["y"], rel=0.05)


def test_a_step_too_long_is_a_warning_where_the_run_was_asked_for():
    with pytest.warns(StepWarning) as warned:
        simulate(position_loop(), stop=0.09, step=0.03)
    (one,) = warned
    assert str(one.message).startswith(
        "diagram 'position loop': the step of 0.03 s is too long for the fastest pole (100 rad/s, at "
        "pid.smooth); rk4 needs a step of about 0.027 s there, an implicit method (sdirk2) does not. In this run "
        "pid.smooth is 0.08109 at t = 0.06 s, where shorter steps give "
    )
    assert one.filename == __file__


def test_a_batch_may_move_both_limits_at_once():
    limits = {"drive.low": [30.0, 40.0], "drive.high": [50.0, 60.0]}  # each alone would cross the other's default
    batch = simulate_batch(position_loop(), limits, stop=0.01)
    assert batch["angle"].shape == (2, 11)


# ---- words


def test_near_misses():
    known = ["kp", "ki", "kd", "tau"]
    assert near("Kp", known) == " Did you mean 'kp'?"
    assert near("tua", known) == " Did you mean 'tau'?"
    assert near("gain", known) == " Known here: kd, ki, kp, tau."
    assert near("gain", []) == " There are none."
    assert near("x", [f"block{k}" for k in range(20)]).endswith(", block14, block15, … (20 in all).")


def test_a_word_of_a_name_is_nearer_than_a_name_spelt_much_alike():
    sheaths = ["tendon_sheath_asymmetric", "tendon_sheath_play", "tendon_sheath_symmetric"]
    assert near("asymmetric", sheaths) == " Did you mean 'tendon_sheath_asymmetric'?"
    assert near("PLAY", sheaths) == " Did you mean 'tendon_sheath_play'?"
    assert near("bias", ["offset.bias", "offset.gain", "basis"]) == " Did you mean 'offset.bias'?"
    assert near("gain", ["gains", "loop_gain"]) == " Did you mean 'gains'?"  # a letter off is nearer still
    assert near("sheath", sheaths).startswith(" Known here: ")  # a word of several says nothing
    assert near("x", ["plant.x", "u"]) == " Known here: u, plant.x."  # and one letter is no word


def test_values_in_words_are_short_and_on_one_line():
    np = pytest.importorskip("numpy")
    assert in_words(0.1) == "0.1"
    assert in_words("two\nlines") == "'two\\nlines'"
    assert in_words(np.zeros((1000, 2))) == "an array of shape (1000, 2)"
    assert in_words(np.arange(3.0)) == "array([0., 1., 2.])"
    assert in_words(Gain) == "the class Gain"
    assert len(in_words("x" * 1000)) == 60


def test_several():
    assert several([], "input") == "no input"
    assert several(["u"], "input") == "1 input (u)"
    assert several(["u1", "u2"], "input") == "2 inputs (u1, u2)"


def test_a_thousand_faults_are_not_all_printed():
    with pytest.raises(DiagramError) as caught:
        position_loop(wires=[f"ref{k} -> error.plus" for k in range(1000)])
    assert len(str(caught.value).splitlines()) <= 22


def test_a_name_that_is_there_twice_is_offered_once():
    known = ["controller.kp", "plant.k", "controller.kp"]
    assert near_path("kp", known) == " Did you mean 'controller.kp'?"
    assert near_path("regulator.kp", known) == " Did you mean 'controller.kp'?"
