"""Mistakes in running: times, inputs, methods, logs, and numbers that leave the finite."""

import casadi as ca
import numpy as np

from tests.mistakes.table import mistake, position_loop
from tsmblocks.batch import simulate_batch
from tsmblocks.block import Block, Input, Output, Samples, block, state
from tsmblocks.blocks import (
    Constant, Delay, Derivative, Divide, FirstOrderLag, Recorded, Gain, Integrator, MotorTransferFunction, PID, Sine, Sum,
    UnitDelay, ZeroOrderHold,
)
from tsmblocks.diagram import Diagram, Inlet
from tsmblocks.errors import DataError, NotFinite, RunError
from tsmblocks.simulate import Stepper, simulate


def plant(**blocks):
    """A motor that wants its voltage."""
    return Diagram(
        title="plant", blocks={"motor": MotorTransferFunction(), **blocks}, inputs={"u": Inlet("motor.u")},
        outputs={"x": "motor.y"},
    )


# ---- not finite


@mistake(NotFinite, "?")
def zero_over_zero():
    d = Diagram(title="quotients", blocks=dict(a=Sine(), b=Sine(unit="1"), q=Divide()), wires=["a -> q.num", "b -> q.den"])
    simulate(d, stop=1.0)


@mistake(NotFinite, "?")
def a_denominator_that_passes_zero_later():
    d = Diagram(title="quotients", blocks=dict(one=Constant(value=1.0), half=Constant(value=-0.5), clock=Integrator(), sum=Sum(signs="++"), q=Divide(), out=FirstOrderLag()),
                wires=["one -> clock -> sum.plus1", "half -> sum.plus2", "sum -> q.den", "one -> q.num", "q -> out"])
    simulate(d, stop=1.0, step=0.125)


@mistake(NotFinite, "?")
def the_logarithm_of_a_negative_number():
    @block(register=False)
    class Log(Block):
        """Logarithm."""

        u = Input("a positive signal")
        y = Output("its logarithm")

        def outputs(self, t, x, u):
            return dict(y=ca.log(u.u))

    d = Diagram(title="logarithms", blocks=dict(ref=Sine(unit="1", offset=0.5), log=Log(), lag=FirstOrderLag()), wires=["ref -> log -> lag"])
    simulate(d, stop=3.0, step=0.01)


@mistake(NotFinite, "?")
def the_logarithm_in_the_middle_of_a_loop():
    @block(register=False)
    class Log(Block):
        """Logarithm."""

        u = Input("a positive signal")
        y = Output("its logarithm")

        def outputs(self, t, x, u):
            return dict(y=ca.log(u.u))

    d = Diagram(title="logarithms", blocks=dict(ref=Constant(value=1.0), error=Sum(), lag=Integrator(gain=-1.0), log=Log()), wires=["ref -> error.plus", "error -> lag -> log -> error.minus"])
    simulate(d, stop=3.0, step=0.01)


@mistake(NotFinite, "?")
def an_unstable_loop():
    d = Diagram(title="runaway", blocks=dict(ref=Constant(value=1.0), error=Sum(signs="++"), grow=FirstOrderLag(gain=20.0)), wires=["ref -> error.plus1", "error -> grow -> error.plus2"])
    simulate(d, stop=10.0, step=0.01)


@mistake(NotFinite, "?")
def an_unstable_loop_logged_by_its_outputs_only():
    d = Diagram(title="runaway", blocks=dict(ref=Constant(value=1.0), error=Sum(signs="++"), grow=FirstOrderLag(gain=20.0)), wires=["ref -> error.plus1", "error -> grow -> error.plus2"], outputs={"r": "ref"})
    simulate(d, stop=10.0, step=0.01, log="outputs")


@mistake(NotFinite, "?")
def an_unstable_loop_of_samples():
    d = Diagram(title="runaway", blocks=dict(ref=Constant(value=1.0), error=Sum(signs="++"), k=Gain(gain=1e10), back=UnitDelay()), wires=["ref -> error.plus1", "error -> k -> back -> error.plus2"])
    simulate(d, stop=10.0, step=0.01)


@mistake(NotFinite, "?")
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


@mistake(NotFinite, "?")
def an_input_function_that_gives_nothing_useful():
    simulate(plant(), stop=1.0, inputs={"u": lambda t: np.log(t - 0.5)})


# ---- times


@mistake(RunError, "?")
def a_step_of_zero():
    simulate(position_loop(), step=0.0)


@mistake(RunError, "?")
def a_step_of_text():
    simulate(position_loop(), step="1 ms")


@mistake(RunError, "?")
def a_stop_before_the_start():
    simulate(position_loop(), stop=-1.0)


@mistake(RunError, "?")
def a_stop_of_text():
    simulate(position_loop(), stop="20 s")


@mistake(RunError, "?")
def a_stop_that_is_not_a_number():
    simulate(position_loop(), stop=float("nan"))


@mistake(RunError, "?")
def an_endless_run():
    simulate(position_loop(), stop=float("inf"))


@mistake(RunError, "?")
def a_start_of_text():
    simulate(position_loop(), start="now", stop=1.0)


@mistake(RunError, "?")
def a_step_longer_than_the_run():
    simulate(position_loop(), stop=0.001, step=0.01)


@mistake(RunError, "?")
def a_step_that_does_not_divide_the_run():
    simulate(position_loop(), stop=1.0, step=0.3)


@mistake(RunError, "?")
def a_run_too_long_to_keep():
    simulate(position_loop(), stop=1e6, step=1e-4)


@mistake(RunError, "?")
def every_nothing():
    simulate(position_loop(), stop=1.0, every=0)


@mistake(RunError, "?")
def a_period_that_is_no_multiple_of_the_step():
    d = Diagram(title="held", blocks=dict(ref=Sine(), hold=ZeroOrderHold(period=0.0025)), wires=["ref -> hold"])
    simulate(d, stop=1.0, step=1e-3)


@mistake(RunError, "?")
def a_period_shorter_than_the_step():
    d = Diagram(title="held", blocks=dict(ref=Sine(), hold=ZeroOrderHold(period=0.0005)), wires=["ref -> hold"])
    simulate(d, stop=1.0, step=1e-3)


@mistake(RunError, "?")
def a_delay_shorter_than_the_step():
    d = Diagram(title="delays", blocks=dict(ref=Sine(), delay=Delay(time=0.0005)), wires=["ref -> delay"])
    simulate(d, stop=1.0, step=1e-3)


# ---- methods, logs and results


@mistake(RunError, "?")
def an_unknown_method():
    simulate(position_loop(), stop=1.0, method="rk5")


@mistake(RunError, "?")
def an_unknown_backend():
    simulate(position_loop(), stop=1.0, backend="lvm")


@mistake(RunError, "?")
def a_log_that_matches_nothing():
    simulate(position_loop(), stop=1.0, log=["pdi.*"])


@mistake(RunError, "?")
def a_log_of_numbers():
    simulate(position_loop(), stop=1.0, log=[1])


@mistake(RunError, "?")
def an_unknown_start_value():
    simulate(position_loop(), stop=1.0, initial={"motor.speed": 1.0})


@mistake(RunError, "?")
def a_start_value_of_text():
    simulate(position_loop(), stop=1.0, initial={"motor.x1": "one"})


@mistake(RunError, "?")
def a_start_value_that_is_not_a_number():
    simulate(position_loop(), stop=1.0, initial={"motor.x1": float("nan")})


@mistake(RunError, "?")
def an_unknown_signal_of_a_run():
    simulate(position_loop(), stop=0.01)["motr.y"]


@mistake(RunError, "?")
def a_signal_that_was_not_logged():
    simulate(position_loop(), stop=0.01, log="outputs")["pid.y"]


@mistake(DataError, "?")
def a_run_saved_to_an_unknown_format():
    simulate(position_loop(), stop=0.01).save("run.xlsx")


@mistake(RunError, "?")
def a_batch_of_an_unknown_signal():
    simulate_batch(position_loop(), {"pid.kp": [1.0, 2.0]}, outputs=["motr"], stop=0.1)


@mistake(RunError, "?")
def a_batch_without_outputs():
    simulate_batch(position_loop(outputs={}), {"pid.kp": [1.0, 2.0]}, stop=0.1)


@mistake(RunError, "?")
def a_batch_result_by_another_name():
    simulate_batch(position_loop(), {"pid.kp": [1.0, 2.0]}, stop=0.1)["angel"]


@mistake(RunError, "?")
def a_batch_with_a_step_of_zero():
    simulate_batch(position_loop(), {"pid.kp": [1.0, 2.0]}, stop=0.1, step=0.0)


@mistake(RunError, "?")
def a_batch_with_every_nothing():
    simulate_batch(position_loop(), {"pid.kp": [1.0, 2.0]}, stop=0.1, every=0)


@mistake(RunError, "?")
def a_run_of_something_else():
    simulate("fig16", stop=1.0)


# ---- inputs


@mistake(DataError, "?")
def an_input_is_missing():
    simulate(plant(), stop=1.0)


@mistake(DataError, "?")
def an_input_is_unknown():
    simulate(plant(), stop=1.0, inputs={"u": 1.0, "load": 2.0})


@mistake(DataError, "?")
def an_input_is_misspelt():
    simulate(Diagram(title="plant", blocks=dict(motor=MotorTransferFunction()), inputs={"volts": "motor.u"}), stop=1.0, inputs={"volt": 1.0})


@mistake(DataError, "?")
def inputs_of_a_diagram_without_any():
    simulate(position_loop(), stop=1.0, inputs={"u": 1.0})


@mistake(DataError, "?")
def an_input_with_too_few_values():
    simulate(plant(), stop=1.0, inputs={"u": np.zeros(500)})


@mistake(DataError, "?")
def an_input_that_ends_too_soon():
    simulate(plant(), stop=1.0, inputs={"u": (np.linspace(0.0, 0.5, 51), np.zeros(51))})


@mistake(DataError, "?")
def an_input_that_begins_too_late():
    simulate(plant(), stop=1.0, inputs={"u": (np.linspace(0.5, 1.5, 51), np.zeros(51))})


@mistake(DataError, "?")
def an_input_with_a_gap():
    y = np.zeros(1001)
    y[7] = np.nan
    simulate(plant(), stop=1.0, inputs={"u": y})


@mistake(DataError, "?")
def an_input_whose_time_goes_back():
    simulate(plant(), stop=1.0, inputs={"u": ([0.0, 0.5, 0.4, 1.0], [0.0, 1.0, 2.0, 3.0])})


@mistake(DataError, "?")
def an_input_with_more_times_than_values():
    simulate(plant(), stop=1.0, inputs={"u": ([0.0, 0.5, 1.0], [0.0, 1.0])})


@mistake(DataError, "?")
def an_input_of_text():
    simulate(plant(), stop=1.0, inputs={"u": "24 V"})


@mistake(DataError, "?")
def an_input_of_texts():
    simulate(plant(), stop=1.0, inputs={"u": ["a", "b"]})


@mistake(DataError, "?")
def an_input_of_two_columns():
    simulate(plant(), stop=1.0, inputs={"u": np.zeros((1001, 2))})


@mistake(DataError, "?")
def an_input_that_is_not_finite():
    simulate(plant(), stop=1.0, inputs={"u": float("inf")})


@mistake(DataError, "?")
def an_input_of_nothing():
    simulate(plant(), stop=1.0, inputs={"u": []})


@mistake(DataError, "?")
def an_input_function_of_one_number():
    simulate(plant(), stop=1.0, inputs={"u": lambda t: np.zeros(3)})


@mistake(DataError, "?")
def an_input_function_that_fails():
    simulate(plant(), stop=1.0, inputs={"u": lambda t: 1.0 if t > 0.5 else 0.0})


@mistake(DataError, "?")
def a_hold_that_is_none():
    simulate(plant(), stop=1.0, inputs={"u": np.zeros(1001)}, hold="square")


@mistake(DataError, "?")
def a_cubic_through_two_points():
    simulate(plant(), stop=1.0, inputs={"u": ([0.0, 1.0], [0.0, 1.0])}, hold="cubic")


@mistake(DataError, "?")
def the_derivative_of_a_held_input():
    d = Diagram(title="rates", blocks=dict(d=Derivative()), inputs={"x": "d.u"}, outputs={"v": "d"})
    simulate(d, stop=1.0, inputs={"x": Samples(np.linspace(0, 1, 11), np.arange(11.0), "zero")})


@mistake(DataError, "?")
def the_derivative_of_an_input_function():
    d = Diagram(title="rates", blocks=dict(d=Derivative()), inputs={"x": "d.u"}, outputs={"v": "d"})
    simulate(d, stop=1.0, inputs={"x": np.sin})


@mistake(DataError, "?")
def the_second_derivative_of_a_linear_input():
    d = Diagram(title="rates", blocks=dict(d1=Derivative(), d2=Derivative()), wires=["d1 -> d2"], inputs={"x": "d1.u"}, outputs={"a": "d2"})
    simulate(d, stop=1.0, inputs={"x": np.zeros(1001)})


@mistake(DataError, "?")
def inputs_as_a_list():
    simulate(plant(), stop=1.0, inputs=[1.0])


# ---- sample by sample


@mistake(RunError, "?")
def a_step_without_its_input():
    Stepper(plant()).step()


@mistake(RunError, "?")
def a_step_with_a_misspelt_input():
    Stepper(plant()).step({"U": 1.0})


@mistake(RunError, "?")
def a_step_with_an_input_too_many():
    Stepper(plant()).step({"u": 1.0, "load": 2.0})


@mistake(RunError, "?")
def a_step_with_text():
    Stepper(plant()).step({"u": "one"})


@mistake(RunError, "?")
def a_stepper_of_a_recording():
    d = Diagram(title="recorded", blocks=dict(data=Recorded()), outputs={"y": "data"})
    Stepper(d)


@mistake(RunError, "?")
def a_stepper_that_needs_a_derivative():
    d = Diagram(title="rates", blocks=dict(d=Derivative()), inputs={"x": "d.u"}, outputs={"v": "d"})
    Stepper(d)


@mistake(RunError, "?")
def a_state_of_another_diagram():
    saved = Stepper(plant()).save()
    Stepper(position_loop()).restore(saved)


@mistake(RunError, "?")
def a_state_of_another_step():
    saved = Stepper(plant()).save()
    Stepper(plant(), step=1e-4).restore(saved)


@mistake(NotFinite, "?")
def a_stepper_that_leaves_the_finite():
    d = Diagram(title="quotients", blocks=dict(q=Divide()), inputs={"a": "q.num", "b": "q.den"}, outputs={"c": "q"})
    Stepper(d).step({"a": 1.0, "b": 0.0})


@mistake(NotFinite, "?")
def a_stepper_given_what_is_not_a_number():
    Stepper(plant()).step({"u": float("nan")})


del PID
