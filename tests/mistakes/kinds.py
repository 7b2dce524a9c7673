"""Things of another kind than is wanted: a list for a mapping, a text for a list, a name for a diagram."""
# ruff: noqa: E501 - the text of a message stands on one line, as the user reads it

import numpy as np
import pandas as pd

import tsmblocks as tsm
from tests.mistakes.table import mistake, position_loop
from tsmblocks import analysis
from tsmblocks.blocks import (
    PID,
    Constant,
    Delay,
    Divide,
    FirstOrderLag,
    Gain,
    Integrator,
    StateSpace,
    Sum,
    TransferFunction,
)
from tsmblocks.common import units
from tsmblocks.common.errors import (
    AlgebraicLoop,
    BlockError,
    DataError,
    DiagramError,
    EquationError,
    FileError,
    ParameterError,
    RunError,
    TsmError,
)
from tsmblocks.common.units import UnitError
from tsmblocks.compiler.compile import compile_diagram
from tsmblocks.compiler.dependencies import structure_of
from tsmblocks.model.block import Block, Input, Output, block
from tsmblocks.model.block_class import Unchanging
from tsmblocks.model.diagram import Diagram
from tsmblocks.simulation.simulate import simulate
from tsmblocks.simulation.stepper import Stepper


def lag():
    """A lag driven from outside."""
    return Diagram(title="lag", blocks=dict(g=FirstOrderLag()), inputs={"u": "g"}, outputs={"y": "g"})


def driven(**options):
    return simulate(lag(), **{"inputs": {"u": 1.0}, "stop": 0.1, "step": 0.01, **options})


# ---- diagrams and edits


@mistake(
    DiagramError,
    """
diagram 'position loop' (HERE) has 3 problems:
  1. blocks must map names to blocks, such as {'pid': PID()}, got [Gain(gain=1.0, unit='')].
  2. outputs must map names to signals, such as {'x': 'motor.y'}, got ['pid'].
  3. values must map names to numbers, such as {'theta': 5.0}, got None.
""",
)
def lists_in_the_place_of_mappings():
    position_loop(blocks=[Gain()], outputs=["pid"], values=None)


@mistake(
    DiagramError,
    """
diagram '5' (HERE) has 2 problems:
  1. title must be text, got 5.
  2. inputs must map names to the ports they drive, such as {'u': 'motor.u'}, got ['u'].
""",
)
def a_title_that_is_a_number():
    Diagram(title=5, blocks=dict(k=Gain()), inputs=["u"])


@mistake(
    DiagramError,
    """
diagram 'position loop' (HERE) has 1 problem:
  1. wires must be a list of chains such as ['error -> pid'], got None.
""",
)
def no_list_of_wires():
    position_loop(wires=None)


@mistake(
    DiagramError,
    """
diagram 'position loop' (HERE) has 1 problem:
  1. cut must be a list of chains such as ['error -> pid'], got one text, 'error -> pid'.
""",
)
def one_text_to_cut():
    position_loop().rewire(cut="error -> pid")


@mistake(
    DiagramError,
    """
diagram 'position loop' (HERE) has 1 problem:
  1. wires must be a list of chains such as ['error -> pid'], got one text, 'ref -> x.plus'.
""",
)
def one_text_of_wires_beside_a_block():
    position_loop().insert("x", Sum(), after="pid", wires="ref -> x.plus")


@mistake(
    Unchanging,
    "a block does not change. A PID with another kp is block.replace(kp=2); a diagram with it is "
    "diagram.with_parameters({'NAME.kp': 2}), NAME being the block's.",
)
def a_number_of_a_block_is_set():
    position_loop().blocks["pid"].kp = 2.0


@mistake(AttributeError, "tsmblocks.blocks has no 'Gian'. Did you mean 'Gain'?")
def a_block_the_package_does_not_have():
    _ = tsm.blocks.Gian


LOOP = """
diagram 'loop' (HERE) has 1 problem:
  1. error.y -> g.y -> error.y has no state in it, so its value at one instant depends on itself. Break it with a block that has a state (a lag, an integrator), with a Delay, or with a sampled block. Now g would have no direct feedthrough, since a coefficient is 0; a leading 0 of num, or a D of zeros, counts as a path until it is left out.
"""


def around(g):
    compile_diagram(
        Diagram(
            title="loop",
            blocks=dict(r=Constant(), error=Sum(), g=g),
            wires=["r -> error.plus", "error -> g -> error.minus"],
        ),
        refuse_loops=True,
    )


@mistake(AlgebraicLoop, LOOP)
def a_direct_matrix_of_zeros_in_a_loop():
    around(StateSpace(A=[[-1.0]], B=[[1.0]], C=[[1.0]], D=[[0.0]]))


@mistake(AlgebraicLoop, LOOP)
def a_leading_zero_in_a_loop():
    around(TransferFunction(num=[0.0, 1.0], den=[1.0, 1.0]))


@mistake(EquationError, "Wrong.outputs must take (self, t, x, u).")
def an_equation_of_inputs_alone():
    @block(register=False)
    class Wrong(Block):
        u = Input("input")
        y = Output("output")

        def outputs(self, u):
            return dict(y=u)

    structure_of(Wrong())


@mistake(
    EquationError,
    "Wrong.outputs sets self.count, and a block does not change: declare a state for a value that it remembers. See HERE.",
)
def an_equation_that_counts():
    @block(register=False)
    class Wrong(Block):
        y = Output("output")
        count = 0

        def outputs(self, t, x, u):
            self.count = self.count + 1
            return dict(y=t)

    structure_of(Wrong())


@mistake(
    BlockError,
    "Wrong must not have __init__: it is made from what is declared. Check parameters against each other in check().",
)
def a_constructor_of_ones_own():
    @block(register=False)
    class Wrong(Block):
        y = Output("output")

        def __init__(self, gain):
            self.gain = gain


@mistake(
    FileError,
    """
fig16 has 1 problem:
  1. there is no file 'fig16', and no ready-made diagram of that name. Did you mean 'fig16_feedforward_feedback'?
""",
)
def the_beginning_of_a_name():
    tsm.load("fig16")


# ---- runs


@mistake(
    DataError,
    "inputs must map names to signals, such as {'u': 1.0}, got Record('lag', 0 to 0.1 s, 11 samples, u). For a recording write {'u': recording}.",
)
def a_recording_as_all_inputs():
    driven(inputs=driven().record("u"))


@mistake(DataError, "input 'u': the index of its samples must be time in s, got datetime64[us].")
def a_column_that_counts_in_days():
    driven(inputs={"u": pd.Series(np.ones(11), index=pd.date_range("2026-01-01", periods=11).as_unit("us"))})


@mistake(DataError, "input 'u' must be one column, got an array of shape (11, 2).")
def a_frame_for_one_input():
    driven(inputs={"u": pd.DataFrame(np.ones((11, 2)))})


@mistake(DataError, "input 'u' must be a number, samples or a function of time, got '1'.")
def a_text_for_an_input():
    driven(inputs={"u": "1"})


@mistake(
    DataError, "input 'u' must be a number, samples or a function of time, got an array of shape (11,) of complex128."
)
def complex_samples():
    driven(inputs={"u": np.ones(11) * 1j})


@mistake(DataError, "input 'u': sample 3 is not finite (t = 0.03 s, value = nan).")
def a_sample_that_is_masked():
    driven(inputs={"u": np.ma.array(np.ones(11), mask=np.arange(11) == 3)})


@mistake(RunError, "initial must map states to their initial values, or be the state of a run, got [1.0].")
def a_list_of_start_values():
    driven(initial=[1.0])


@mistake(RunError, "the initial state 'g.value' must be a finite number, got 1j.")
def a_complex_start_value():
    driven(initial={"g.value": np.complex128(1j)})


@mistake(RunError, "log takes names and patterns such as 'tsm.*', got None.")
def nothing_to_log():
    driven(log=None)


@mistake(RunError, "progress must be a function of the fraction done, got True.")
def progress_that_is_no_function():
    driven(progress=True)


@mistake(RunError, "the run of 1e+300 s would take 1e+303 steps of 0.001 s.")
def a_run_without_end():
    driven(stop=1e300, step=1e-3)


@mistake(
    RunError, "the delay of d.past is 1e+09 s, which is 1e+10 steps; at most 1e+08 are possible. Use a longer step."
)
def a_delay_of_thirty_years():
    d = Diagram(title="late", blocks=dict(d=Delay(time=1e9)), inputs={"u": "d"}, outputs={"y": "d"})
    simulate(d, inputs={"u": 1.0}, stop=1.0, step=0.1)


@mistake(ParameterError, "Integrator.integral must start within its limits, -1 to 1, got 5.")
def an_integral_that_starts_outside_its_limits():
    Integrator(low=-1.0, high=1.0, integral=5.0)


@mistake(RunError, "signals of a run are chosen by name, one at a time, got ['y', 'u'].")
def several_signals_at_once():
    _ = driven()[["y", "u"]]


@mistake(RunError, "restore takes what save returned, or the state of a run, got None.")
def nothing_to_restore():
    Stepper(lag()).restore(None)


@mistake(RunError, "the saved state belongs to a diagram other than 'lag'.")
def a_state_of_a_diagram_of_the_same_size():
    other = Diagram(title="other", blocks=dict(h=FirstOrderLag()), inputs={"u": "h"}, outputs={"y": "h"})
    Stepper(lag()).restore(Stepper(other).save())


@mistake(RunError, "only a diagram can be run, got 'fig16'. Load it first: tsmblocks.load('fig16').")
def the_equations_of_a_name():
    tsm.equations("fig16")


@mistake(ParameterError, "parameters must map names to one number per set each, got [{'g.gain': 1.0}].")
def a_batch_of_a_list():
    tsm.simulate_batch(lag(), [{"g.gain": 1.0}], inputs={"u": 1.0})


@mistake(ParameterError, "sensitivities of 'lag' need the name of a parameter at least.")
def sensitivities_by_nothing():
    tsm.sensitivities(lag(), [], inputs={"u": 1.0}, stop=0.1)


@mistake(RunError, "only a run can be measured, got PID(kp=1.0, ki=0.0, kd=0.0, tau=0.01, integral=0.0, smooth=….")
def a_block_is_measured():
    tsm.measure(PID(), "rms(y)")


@mistake(DataError, "x must be a list of numbers, got 'abc'.")
def the_size_of_a_text():
    tsm.rms("abc")


# ---- analysis, pictures, files


@mistake(RunError, "t must be a finite number, got '0'.")
def linear_at_a_text():
    tsm.linearize(lag(), t="0")


@mistake(RunError, "the derivatives of 'quotient' are not finite here: y.")
def linear_where_it_divides_by_zero():
    quotient = Diagram(
        title="quotient", blocks=dict(q=Divide()), inputs={"a": "q.num", "b": "q.den"}, outputs={"y": "q"}
    )
    tsm.linearize(quotient)


@mistake(
    RunError,
    "diagram 'position loop' has no input for a linear model: add one, or open a loop (analysis.opened, analysis.loop_gain).",
)
def linear_without_an_input():
    tsm.linearize(position_loop())


@mistake(RunError, "no signal of diagram 'gain' is chosen: give outputs=[…]. Known here: u, k.y.")
def linear_without_an_output():
    tsm.linearize(Diagram(title="gain", blocks=dict(k=Gain()), inputs={"u": "k"}))


@mistake(RunError, "at='ref -> error.plus': this wire is not part of a loop.")
def a_loop_opened_where_there_is_none():
    analysis.loop_gain(position_loop(), "ref -> error.plus")


@mistake(RunError, "outputs must map names to numbers, got ['y'].")
def trim_to_a_list():
    tsm.trim(lag(), outputs=["y"])


@mistake(RunError, "frequencies must be positive numbers, got '1'.")
def a_frequency_as_text():
    analysis.frequency_response(lag(), "1")


@mistake(TsmError, "only a diagram can be drawn, got PID(kp=1.0, ki=0.0, kd=0.0, tau=0.01, integral=0.0, smooth=….")
def a_block_is_drawn():
    tsm.to_svg(PID())


@mistake(
    FileError,
    """
save has 1 problem:
  1. a file is named by text or a path, got None.
""",
)
def saved_nowhere():
    tsm.save(lag(), None)


@mistake(FileError, "save has 1 problem:\n  1. 'servo.json' must end in .toml, since a diagram is written as TOML.")
def a_diagram_written_under_another_ending():
    tsm.save(lag(), "servo.json")


@mistake(
    FileError,
    """
<text> has 1 problem:
  1. <text>:1: the format is 1.0; this version reads format = 1, at the top of the file.
""",
)
def a_format_with_a_point():
    tsm.loads("format = 1.0\n[blocks]\n")


@mistake(UnitError, "'N/m*s' can be read in two ways. Write N/(m*s) or N*s/m.")
def a_unit_that_reads_two_ways():
    units.parse("N/m*s")


@mistake(UnitError, "'m/((s/kg))' is not a unit known here. Did you mean 's'?")
def a_fraction_in_two_parentheses():
    units.parse("m/((s/kg))")
