"""Mistakes in running: times, inputs, methods, logs, and numbers that leave the finite."""
# ruff: noqa: E501 - the text of a message stands on one line, as the user reads it

import casadi as ca
import numpy as np

from tests.mistakes.table import mistake, position_loop
from tsmblocks.blocks import (
    Constant,
    Delay,
    Derivative,
    Divide,
    FirstOrderLag,
    Gain,
    Integrator,
    MotorTransferFunction,
    Recorded,
    Sine,
    Step,
    Sum,
    UnitDelay,
    ZeroOrderHold,
)
from tsmblocks.common.errors import DataError, NotFinite, ParameterError, RunError
from tsmblocks.model.block import Block, Input, Output, Samples, block, state
from tsmblocks.model.diagram import Diagram, Inlet
from tsmblocks.simulation.batch import simulate_batch
from tsmblocks.simulation.simulate import simulate
from tsmblocks.simulation.stepper import Stepper


def plant(**blocks):
    """A motor that wants its voltage."""
    return Diagram(
        title="plant",
        blocks={"motor": MotorTransferFunction(), **blocks},
        inputs={"u": Inlet("motor.u")},
        outputs={"x": "motor.y"},
    )


# ---- not finite


@mistake(NotFinite, "q.y = nan at t = 0 s, first in q (Divide). Its inputs: num (from a.y) = 0, den (from b.y) = 0.")
def zero_over_zero():
    d = Diagram(
        title="quotients", blocks=dict(a=Sine(), b=Sine(unit="1"), q=Divide()), wires=["a -> q.num", "b -> q.den"]
    )
    simulate(d, stop=1.0)


@mistake(
    NotFinite, "q.y = inf at t = 0.5 s, first in q (Divide). Its inputs: num (from one.y) = 1, den (from sum.y) = 0."
)
def a_denominator_that_passes_zero_later():
    d = Diagram(
        title="quotients",
        blocks=dict(
            one=Constant(value=1.0),
            half=Constant(value=-0.5),
            clock=Integrator(),
            sum=Sum(signs="++"),
            q=Divide(),
            out=FirstOrderLag(),
        ),
        wires=["one -> clock -> sum.plus1", "half -> sum.plus2", "sum -> q.den", "one -> q.num", "q -> out"],
    )
    simulate(d, stop=1.0, step=0.125)


@mistake(NotFinite, "log.y = nan at t = 2.94 s, first in log (Log). Its inputs: u (from ref.y) = -0.00413145.")
def the_logarithm_of_a_negative_number():
    @block(register=False)
    class Log(Block):
        """Logarithm."""

        u = Input("a positive signal")
        y = Output("its logarithm")

        def outputs(self, t, x, u):
            return dict(y=ca.log(u.u))

    d = Diagram(
        title="logarithms",
        blocks=dict(ref=Sine(unit="1", offset=0.5), log=Log(), lag=FirstOrderLag()),
        wires=["ref -> log -> lag"],
    )
    simulate(d, stop=3.0, step=0.01)


@mistake(NotFinite, "log.y = -inf at t = 0 s, first in log (Log). Its inputs: u (from lag.y) = 0.")
def the_logarithm_in_the_middle_of_a_loop():
    @block(register=False)
    class Log(Block):
        """Logarithm."""

        u = Input("a positive signal")
        y = Output("its logarithm")

        def outputs(self, t, x, u):
            return dict(y=ca.log(u.u))

    d = Diagram(
        title="logarithms",
        blocks=dict(ref=Constant(value=1.0), error=Sum(), lag=Integrator(gain=-1.0), log=Log()),
        wires=["ref -> error.plus", "error -> lag -> log -> error.minus"],
    )
    simulate(d, stop=3.0, step=0.01)


@mistake(
    NotFinite,
    "grow.value = nan at t = 2.08 s: a state of grow (FirstOrderLag) diverges. One step before: grow.value = 2.21816e+305. The loop may be unstable, or the step too long for it; try a smaller step.",
)
def an_unstable_loop():
    d = Diagram(
        title="runaway",
        blocks=dict(ref=Constant(value=1.0), error=Sum(signs="++"), grow=FirstOrderLag(gain=20.0)),
        wires=["ref -> error.plus1", "error -> grow -> error.plus2"],
    )
    simulate(d, stop=10.0, step=0.01)


@mistake(
    NotFinite,
    "grow.value = nan at t = 2.08 s: a state of grow (FirstOrderLag) diverges. One step before: grow.value = 2.21816e+305. The loop may be unstable, or the step too long for it; try a smaller step.",
)
def an_unstable_loop_logged_by_its_outputs_only():
    d = Diagram(
        title="runaway",
        blocks=dict(ref=Constant(value=1.0), error=Sum(signs="++"), grow=FirstOrderLag(gain=20.0)),
        wires=["ref -> error.plus1", "error -> grow -> error.plus2"],
        outputs={"r": "ref"},
    )
    simulate(d, stop=10.0, step=0.01, log="outputs")


@mistake(NotFinite, "k.y = inf at t = 0.3 s, first in k (Gain). Its inputs: u (from error.y) = 1e+300.")
def an_unstable_loop_of_samples():
    d = Diagram(
        title="runaway",
        blocks=dict(ref=Constant(value=1.0), error=Sum(signs="++"), k=Gain(gain=1e10), back=UnitDelay()),
        wires=["ref -> error.plus1", "error -> k -> back -> error.plus2"],
    )
    simulate(d, stop=10.0, step=0.01)


@mistake(
    NotFinite,
    "tank.z = nan at t = 0.07 s: a state of tank (Root) diverges. One step before: tank.z = 0.00014971. Within the step its equations are undefined (a root, a logarithm, a division).",
)
def a_state_that_is_born_not_finite():
    @block(register=False)
    class Root(Block):
        """Root of a state."""

        z: float = state(default=0.01, about="what is left")
        y = Output("what is left")

        def derivatives(self, t, x, u):
            return dict(z=-ca.sqrt(x.z) - 0.1)

        def outputs(self, t, x, u):
            return dict(y=x.z)

    simulate(Diagram(title="tank", blocks=dict(tank=Root())), stop=3.0, step=0.01)


@mistake(DataError, "input 'u': the function gives nan at t = 0.5 s.")
def an_input_function_that_gives_nothing_useful():
    simulate(plant(), stop=1.0, inputs={"u": lambda t: np.where(t < 0.5, 0.0, np.nan)})


# ---- times


@mistake(RunError, "step must be a positive number of seconds, got 0.")
def a_step_of_zero():
    simulate(position_loop(), step=0.0)


@mistake(RunError, "step must be a positive number of seconds, got '1 ms'.")
def a_step_of_text():
    simulate(position_loop(), step="1 ms")


@mistake(RunError, "the run must end after it starts, got start=0 s and stop=-1 s.")
def a_stop_before_the_start():
    simulate(position_loop(), stop=-1.0)


@mistake(RunError, "stop must be a finite number, got '20 s'.")
def a_stop_of_text():
    simulate(position_loop(), stop="20 s")


@mistake(RunError, "stop must be a finite number, got nan.")
def a_stop_that_is_not_a_number():
    simulate(position_loop(), stop=float("nan"))


@mistake(RunError, "stop must be a finite number, got inf.")
def an_endless_run():
    simulate(position_loop(), stop=float("inf"))


@mistake(RunError, "start must be a finite number, got 'now'.")
def a_start_of_text():
    simulate(position_loop(), start="now", stop=1.0)


@mistake(RunError, "the step of 0.01 s is longer than the run of 0.001 s.")
def a_step_longer_than_the_run():
    simulate(position_loop(), stop=0.001, step=0.01)


@mistake(
    RunError,
    "10000000001 instants of 9 signals would take 720 GB. Keep fewer signals or instants: log='outputs', or every=1000.",
)
def a_run_too_long_to_keep():
    simulate(position_loop(), stop=1e6, step=1e-4)


@mistake(RunError, "every must be a whole number of at least 1, got 0.")
def every_nothing():
    simulate(position_loop(), stop=1.0, every=0)


@mistake(
    RunError, "the sample period 0.0025 s of hold is not a multiple of the step 0.001 s. A step of 0.000625 s would do."
)
def a_period_that_is_no_multiple_of_the_step():
    d = Diagram(title="held", blocks=dict(ref=Sine(), hold=ZeroOrderHold(period=0.0025)), wires=["ref -> hold"])
    simulate(d, stop=1.0, step=1e-3)


@mistake(
    RunError, "the sample period 0.0005 s of hold is not a multiple of the step 0.001 s. A step of 0.0005 s would do."
)
def a_period_shorter_than_the_step():
    d = Diagram(title="held", blocks=dict(ref=Sine(), hold=ZeroOrderHold(period=0.0005)), wires=["ref -> hold"])
    simulate(d, stop=1.0, step=1e-3)


@mistake(
    RunError,
    "the delay of delay.past is 0.0005 s, shorter than the step of 0.001 s. Use a smaller step, or a DeadTime instead.",
)
def a_delay_shorter_than_the_step():
    d = Diagram(title="delays", blocks=dict(ref=Sine(), delay=Delay(time=0.0005)), wires=["ref -> delay"])
    simulate(d, stop=1.0, step=1e-3)


# ---- methods, logs and results


@mistake(RunError, "there is no method 'rk5'. Did you mean 'rk4'?")
def an_unknown_method():
    simulate(position_loop(), stop=1.0, method="rk5")


@mistake(RunError, "there is no back end 'lvm'. Known here: casadi, llvm.")
def an_unknown_backend():
    simulate(position_loop(), stop=1.0, backend="lvm")


@mistake(RunError, "log 'pdi.*' matches no signal. Did you mean 'pid.y'?")
def a_log_that_matches_nothing():
    simulate(position_loop(), stop=1.0, log=["pdi.*"])


@mistake(RunError, "log takes names and patterns such as 'tsm.*', got 1.")
def a_log_of_numbers():
    simulate(position_loop(), stop=1.0, log=[1])


@mistake(RunError, "diagram 'position loop' has no state 'motor.speed'. Did you mean 'motor.x2'?")
def an_unknown_start_value():
    simulate(position_loop(), stop=1.0, initial={"motor.speed": 1.0})


@mistake(RunError, "the initial state 'motor.x1' must be a finite number, got 'one'.")
def a_start_value_of_text():
    simulate(position_loop(), stop=1.0, initial={"motor.x1": "one"})


@mistake(RunError, "the initial state 'motor.x1' must be a finite number, got nan.")
def a_start_value_that_is_not_a_number():
    simulate(position_loop(), stop=1.0, initial={"motor.x1": float("nan")})


@mistake(RunError, "the run of 'position loop' has no signal 'motr.y'. Did you mean 'motor.y'?")
def an_unknown_signal_of_a_run():
    simulate(position_loop(), stop=0.01)["motr.y"]


@mistake(RunError, "the run of 'position loop' has no signal 'pid.y'. Known here: angle, motor.y.")
def a_signal_that_was_not_logged():
    simulate(position_loop(), stop=0.01, log="outputs")["pid.y"]


@mistake(DataError, "'run.xlsx' ends in '.xlsx'; results are written to .csv, .npz or .mat.")
def a_run_saved_to_an_unknown_format():
    simulate(position_loop(), stop=0.01).save("run.xlsx")


@mistake(RunError, "diagram 'position loop' has no signal 'motr'. Did you mean 'motor.y'?")
def a_batch_of_an_unknown_signal():
    simulate_batch(position_loop(), {"pid.kp": [1.0, 2.0]}, outputs=["motr"], stop=0.1)


@mistake(RunError, "diagram 'position loop' has no outputs, so name the signals to keep: outputs=['block.port'].")
def a_batch_without_outputs():
    simulate_batch(position_loop(outputs={}), {"pid.kp": [1.0, 2.0]}, stop=0.1)


@mistake(RunError, "the batch has no result 'angel'. Did you mean 'angle'?")
def a_batch_result_by_another_name():
    simulate_batch(position_loop(), {"pid.kp": [1.0, 2.0]}, stop=0.1)["angel"]


@mistake(RunError, "step must be a positive number of seconds, got 0.")
def a_batch_with_a_step_of_zero():
    simulate_batch(position_loop(), {"pid.kp": [1.0, 2.0]}, stop=0.1, step=0.0)


@mistake(RunError, "every must be a whole number of at least 1, got 0.")
def a_batch_with_every_nothing():
    simulate_batch(position_loop(), {"pid.kp": [1.0, 2.0]}, stop=0.1, every=0)


@mistake(RunError, "only a diagram can be run, got 'fig16'. Load it first: tsmblocks.load('fig16').")
def a_run_of_something_else():
    simulate("fig16", stop=1.0)


# ---- inputs


@mistake(DataError, "diagram 'plant' needs its input u [V]: give inputs={'u': samples}.")
def an_input_is_missing():
    simulate(plant(), stop=1.0)


@mistake(DataError, "diagram 'plant' has no input 'load'. Known here: u.")
def an_input_is_unknown():
    simulate(plant(), stop=1.0, inputs={"u": 1.0, "load": 2.0})


@mistake(DataError, "diagram 'plant' has no input 'volt'. Did you mean 'volts'?")
def an_input_is_misspelt():
    simulate(
        Diagram(title="plant", blocks=dict(motor=MotorTransferFunction()), inputs={"volts": "motor.u"}),
        stop=1.0,
        inputs={"volt": 1.0},
    )


@mistake(DataError, "diagram 'position loop' has no input 'u'. There are none.")
def inputs_of_a_diagram_without_any():
    simulate(position_loop(), stop=1.0, inputs={"u": 1.0})


@mistake(
    DataError,
    "input 'u' has 500 values, but the run has 1001 instants. Give (times, values) when they are not on the steps.",
)
def an_input_with_too_few_values():
    simulate(plant(), stop=1.0, inputs={"u": np.zeros(500)})


@mistake(
    DataError,
    "input 'u' is known from 0 to 0.5 s, but the run goes from 0 to 1 s. Shorten the run, or give more samples.",
)
def an_input_that_ends_too_soon():
    simulate(plant(), stop=1.0, inputs={"u": (np.linspace(0.0, 0.5, 51), np.zeros(51))})


@mistake(
    DataError,
    "input 'u' is known from 0.5 to 1.5 s, but the run goes from 0 to 1 s. Begin the run there (start=0.5), or give more samples.",
)
def an_input_that_begins_too_late():
    simulate(plant(), stop=1.0, inputs={"u": (np.linspace(0.5, 1.5, 51), np.zeros(51))})


@mistake(DataError, "input 'u': sample 7 is not finite (t = 0.007 s, value = nan).")
def an_input_with_a_gap():
    y = np.zeros(1001)
    y[7] = np.nan
    simulate(plant(), stop=1.0, inputs={"u": y})


@mistake(DataError, "input 'u': time does not increase at sample 2 (0.5 s, then 0.4 s).")
def an_input_whose_time_goes_back():
    simulate(plant(), stop=1.0, inputs={"u": ([0.0, 0.5, 0.4, 1.0], [0.0, 1.0, 2.0, 3.0])})


@mistake(DataError, "input 'u': times and values must be two lists of one length, got shapes (3,) and (2,).")
def an_input_with_more_times_than_values():
    simulate(plant(), stop=1.0, inputs={"u": ([0.0, 0.5, 1.0], [0.0, 1.0])})


@mistake(DataError, "input 'u' must be a number, samples or a function of time, got '24 V'.")
def an_input_of_text():
    simulate(plant(), stop=1.0, inputs={"u": "24 V"})


@mistake(DataError, "input 'u' must be a number, samples or a function of time, got ['a', 'b'].")
def an_input_of_texts():
    simulate(plant(), stop=1.0, inputs={"u": ["a", "b"]})


@mistake(DataError, "input 'u' must be a number, samples or a function of time, got an array of shape (1001, 2).")
def an_input_of_two_columns():
    simulate(plant(), stop=1.0, inputs={"u": np.zeros((1001, 2))})


@mistake(DataError, "input 'u' must be a finite number, got inf.")
def an_input_that_is_not_finite():
    simulate(plant(), stop=1.0, inputs={"u": float("inf")})


@mistake(
    DataError,
    "input 'u' has 0 values, but the run has 1001 instants. Give (times, values) when they are not on the steps.",
)
def an_input_of_nothing():
    simulate(plant(), stop=1.0, inputs={"u": []})


@mistake(
    DataError, "input 'u': the function must give one value for each time, got shape (3,) for times of shape (1,)."
)
def an_input_function_of_one_number():
    simulate(plant(), stop=1.0, inputs={"u": lambda t: np.zeros(3)})


@mistake(
    DataError,
    "input 'u': the function fails on an array of times, which it must take (use np.where instead of if). ValueError: The truth value of an array with more than one element is ambiguous. Use a.any() or a.all()",
    cause=True,
)
def an_input_function_that_fails():
    simulate(plant(), stop=1.0, inputs={"u": lambda t: 1.0 if t > 0.5 else 0.0})


@mistake(DataError, "input 'u': there is no hold 'square'. Known here: auto, cubic, linear, zero.")
def a_hold_that_is_none():
    simulate(plant(), stop=1.0, inputs={"u": np.zeros(1001)}, hold="square")


@mistake(DataError, "input 'u': hold='cubic' needs at least 4 samples, got 2.")
def a_cubic_through_two_points():
    simulate(plant(), stop=1.0, inputs={"u": ([0.0, 1.0], [0.0, 1.0])}, hold="cubic")


@mistake(
    DataError,
    "input 'x' is held constant between samples, but its derivative is needed. Give it hold='linear' or hold='cubic'.",
)
def the_derivative_of_a_held_input():
    d = Diagram(title="rates", blocks=dict(d=Derivative()), inputs={"x": "d.u"}, outputs={"v": "d"})
    simulate(d, stop=1.0, inputs={"x": Samples(np.linspace(0, 1, 11), np.arange(11.0), "zero")})


@mistake(
    DataError,
    "input 'x' is a Python function, but its derivative is needed. Give samples with hold='cubic', or make it a source block.",
)
def the_derivative_of_an_input_function():
    d = Diagram(title="rates", blocks=dict(d=Derivative()), inputs={"x": "d.u"}, outputs={"v": "d"})
    simulate(d, stop=1.0, inputs={"x": np.sin})


@mistake(
    DataError, "input 'x' is linear between samples, but its derivative of order 2 is needed. Give it hold='cubic'."
)
def the_second_derivative_of_a_linear_input():
    d = Diagram(
        title="rates",
        blocks=dict(d1=Derivative(), d2=Derivative()),
        wires=["d1 -> d2"],
        inputs={"x": "d1.u"},
        outputs={"a": "d2"},
    )
    simulate(d, stop=1.0, inputs={"x": np.zeros(1001)}, hold="linear")


@mistake(DataError, "inputs must map names to signals, such as {'u': 1.0}, got [1.0].")
def inputs_as_a_list():
    simulate(plant(), stop=1.0, inputs=[1.0])


# ---- sample by sample


@mistake(DataError, "diagram 'plant' needs a value of its input 'u' at each step.")
def a_step_without_its_input():
    Stepper(plant()).step()


@mistake(DataError, "diagram 'plant' has no input 'U'. Did you mean 'u'?")
def a_step_with_a_misspelt_input():
    Stepper(plant()).step({"U": 1.0})


@mistake(DataError, "diagram 'plant' has no input 'load'. Known here: u.")
def a_step_with_an_input_too_many():
    Stepper(plant()).step({"u": 1.0, "load": 2.0})


@mistake(DataError, "input 'u' must be a finite number, got 'one'.")
def a_step_with_text():
    Stepper(plant()).step({"u": "one"})


@mistake(
    RunError,
    "diagram 'recorded' cannot be run sample by sample: data generates its signal for a whole run at once. Give this signal as an input instead.",
)
def a_stepper_of_a_recording():
    d = Diagram(title="recorded", blocks=dict(data=Recorded()), outputs={"y": "data"})
    Stepper(d)


@mistake(
    RunError,
    "diagram 'rates' cannot be run sample by sample: it needs the derivative of its input 'x', which cannot be formed from single values. Use a FilteredDerivative, or an input for the rate.",
)
def a_stepper_that_needs_a_derivative():
    d = Diagram(title="rates", blocks=dict(d=Derivative()), inputs={"x": "d.u"}, outputs={"v": "d"})
    Stepper(d)


@mistake(RunError, "the saved state belongs to a diagram other than 'position loop'.")
def a_state_of_another_diagram():
    saved = Stepper(plant()).save()
    Stepper(position_loop()).restore(saved)


@mistake(RunError, "a run that continues from a saved state starts at its time, 0.5 s. Leave out start.")
def a_start_beside_a_state_to_go_on_from():
    saved = simulate(plant(), inputs={"u": 1.0}, stop=0.5).state
    simulate(plant(), inputs={"u": 1.0}, start=1.0, stop=2.0, initial=saved)


@mistake(
    RunError,
    "the saved state keeps the past of 'late' for delays of another length. Take one from a run with these delays.",
)
def a_state_with_too_short_a_past():
    late = Diagram(title="late", blocks=dict(b=Delay(time=0.01)), inputs={"u": "b"}, outputs={"y": "b"})
    saved = simulate(late, inputs={"u": 1.0}, stop=0.5).state
    simulate(late, inputs={"u": 1.0}, stop=2.0, initial=saved, parameters={"b.time": 1.0})


@mistake(
    RunError,
    "the run of 'quotient' diverged at t = 0.5 s, so there is no state to continue from. Take one from a run that ended before.",
)
def a_state_of_a_run_that_stopped_being_finite():
    """The states are finite here: it is an output that was not, for an instant."""
    blocks = dict(one=Constant(value=1.0), back=Step(time=0.5, before=1.0, after=0.0), q=Divide(), i=Integrator())
    d = Diagram(title="quotient", blocks=blocks, wires=["one -> q.num", "back -> q.den", "one -> i"])
    try:
        state = simulate(d, stop=1.0, step=0.1).state
    except NotFinite as error:
        state = error.run.state
    simulate(d, stop=2.0, step=0.1, initial=state)


@mistake(RunError, "the saved state belongs to a step of 0.001 s, and this one is 0.0001 s.")
def a_state_of_another_step():
    saved = Stepper(plant()).save()
    Stepper(plant(), step=1e-4).restore(saved)


@mistake(NotFinite, "q.y = inf at t = 0 s, first in q (Divide). Its inputs: num (from a) = 1, den (from b) = 0.")
def a_stepper_that_leaves_the_finite():
    d = Diagram(title="quotients", blocks=dict(q=Divide()), inputs={"a": "q.num", "b": "q.den"}, outputs={"c": "q"})
    Stepper(d).step({"a": 1.0, "b": 0.0})


@mistake(DataError, "input 'u' must be a finite number, got nan.")
def a_stepper_given_what_is_not_a_number():
    Stepper(plant()).step({"u": float("nan")})


@mistake(RunError, "'plant': stop_when 'x > -1' holds at the start.")
def a_run_that_would_end_where_it_begins():
    simulate(plant(), inputs={"u": 1.0}, stop_when="x > -1")


@mistake(
    ParameterError,
    """
stop_when: a comparison is expected here, such as x > 1.
    x - 1
    ^^^^^""",
)
def a_condition_that_compares_nothing():
    simulate(plant(), inputs={"u": 1.0}, stop_when="x - 1")
