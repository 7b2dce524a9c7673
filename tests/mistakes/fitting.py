"""Mistakes in fits: recordings, what is free, bounds, constraints, priors, options, and searches that cannot begin."""
# ruff: noqa: E501 - the text of a message stands on one line, as the user reads it

import casadi as ca
import numpy as np

import tsmblocks as tsm
from tests.mistakes.table import mistake
from tsmblocks.blocks import Delay, FirstOrderLag, Gain, Integrator, Sum, ZeroOrderHold
from tsmblocks.common.errors import DataError, NotFinite, ParameterError, RunError
from tsmblocks.model.block import Block, Input, Output, block, parameter

T = 0.01 * np.arange(201)
U = np.sin(3 * T)
SHEATH = tsm.load("tendon_sheath_linear")


def rig(name="rig", t=T, **signals):
    signals = signals or {"x_in": U, "x_out": 0.8 * U}
    return tsm.Record(name, t, signals, {k: "rad" for k in ("x_in", "x_out") if k in signals})


def fit(data=None, diagram=SHEATH, **given):
    return tsm.fit(diagram, rig() if data is None else data, **given)


def of(**named):
    """One block as a diagram with input u and output y, or several in a row."""
    names = list(named)
    return tsm.Diagram(
        title="bench",
        blocks=named,
        wires=[" -> ".join(names)] if len(names) > 1 else [],
        inputs={"u": names[0]},
        outputs={"y": names[-1]},
    )


def uy(u=U, y=U):
    return tsm.Record("rig", T, {"u": u, "y": y}, {})


# ---- recordings


@mistake(DataError, "there are no recordings to compare with: give a Record (tsm.read), a list, or a mapping.")
def no_recording_to_fit():
    fit([])


@mistake(
    DataError,
    "'experiment 2' must be a recording (tsm.read), a file or a pandas frame, got an array of shape (201, 2). "
    "tsm.Record(name, t, signals, units) makes one from arrays.",
)
def a_bare_array_as_a_recording():
    fit([rig(), np.zeros((201, 2))])


@mistake(
    DataError,
    "'rig.json' ends in '.json'; a fitted diagram is written to .toml. Estimates and intervals are in to_dict() and to_pandas().",
)
def a_fit_saved_as_what_it_is_not():
    fit().save("rig.json")


@mistake(
    DataError,
    "read takes the path of a file, got an array of shape (201,). tsm.from_pandas makes a recording from a frame, tsm.Record(name, t, signals, units) from arrays.",
)
def an_array_to_be_read():
    tsm.read(T)


@mistake(DataError, "two experiments are named 'rig#2'; give a mapping with different names.")
def recordings_whose_names_collide():
    fit([rig(), rig(), rig("rig#2")])


@mistake(DataError, "experiment 'rig' has 1 sample, and at least 4 are needed.")
def a_recording_of_one_sample():
    fit(rig(t=T[:1], x_in=U[:1], x_out=U[:1]))


@mistake(
    DataError, "experiment 'rig': times must be finite and increase, and sample 3 is at 0.01 s after one at 0.02 s."
)
def a_recording_whose_time_goes_back():
    fit(rig(t=np.array([0.0, 0.01, 0.02, 0.01, 0.03]), x_in=U[:5], x_out=U[:5]))


@mistake(DataError, "experiment 'rig': sample 7 of x_out is not finite (t = 0.07 s, value = nan).")
def a_gap_of_nan_in_a_recording():
    fit(rig(x_in=U, x_out=np.where(np.arange(201) == 7, np.nan, U)))


@mistake(
    DataError,
    "experiment 'rig': x_out reaches 8e+159, 8e+159 after weighting, and its square is out of range. Choose another unit.",
)
def a_recording_of_absurd_size():
    fit(rig(x_in=U, x_out=8e159 * np.sign(U)))


@mistake(
    DataError,
    "rig: 'Tendon sheath: a gain and an offset' needs its input 'x_in', and the recording has no such signal. Did you mean 'x_inn'? If it has another name there, map it when reading: map={'x_in': 'x_inn'}, or --map 'x_in=x_inn'.",
)
def a_recording_without_the_input():
    fit(rig(x_inn=U, x_out=U))


@mistake(
    DataError,
    "rig: none of the outputs of 'Tendon sheath: a gain and an offset' (x_out) was measured; the recording has x_in, tool. Map one when reading: map={'x_out': 'COLUMN'}, or --map 'x_out=COLUMN'; or give the diagram an output of that name.",
)
def a_recording_without_any_output():
    fit(rig(x_in=U, tool=U))


@mistake(
    DataError,
    "rig: none of the outputs of 'Tendon sheath: a gain and an offset' (x_out) was measured; the recording has x_in, X Out. Map one when reading: map={'x_out': 'X Out'}, or --map 'x_out=X Out'; or give the diagram an output of that name.",
)
def a_recording_with_an_output_in_another_spelling():
    fit(rig(**{"x_in": U, "X Out": U}))


@mistake(
    DataError,
    "rig: none of the outputs of 'Tendon sheath: a gain and an offset' (x_out) was measured; the recording has x_in. Map one when reading: map={'x_out': 'COLUMN'}, or --map 'x_out=COLUMN'; or give the diagram an output of that name.",
)
def one_of_two_recordings_without_any_output():
    fit([rig("whole"), rig(x_in=U)])


@mistake(
    DataError,
    "no output of 'bench' was measured in all experiments (one: v; two: y). Give those together that have an output in common.",
)
def recordings_without_an_output_in_common():
    two = of(a=Gain(), b=Gain())
    fit(
        [tsm.Record("one", T, {"u": U, "v": U}, {}), tsm.Record("two", T, {"u": U, "y": U}, {})],
        tsm.Diagram(title="bench", blocks=two.blocks, wires=two.wires, inputs={"u": "a"}, outputs={"v": "a", "y": "b"}),
    )


@mistake(DataError, "diagram 'Tendon sheath: a gain and an offset' has no output 'x_ou'. Did you mean 'x_out'?")
def an_output_to_compare_is_misspelt():
    fit(outputs=["x_ou"])


@mistake(DataError, "rig: there is no signal 'x_out' to compare with. Did you mean 'xout'?")
def an_output_to_compare_was_not_measured():
    fit(rig(x_in=U, xout=U), outputs="x_out")


@mistake(ParameterError, "outputs takes names such as 'x_out', got 3.")
def a_number_as_an_output_to_compare():
    fit(outputs=3)


# ---- windows and steps


@mistake(DataError, "window must be a pair (start, stop) in s, None for an end, got 0.5.")
def a_window_of_one_number():
    fit(window=0.5)


@mistake(DataError, "window must be two times in order, got (2, 1) s.")
def a_window_that_ends_before_it_starts():
    fit(window=(2, 1))


@mistake(DataError, "window: there is no experiment 'rigg'. Did you mean 'rig'?")
def a_window_of_an_unknown_experiment():
    fit(window={"rigg": (0, 1)})


@mistake(
    DataError,
    "experiment 'rig': the window from 5 s on holds 0 samples, and at least 4 are needed; it was recorded from 0 to 2 s.",
)
def a_window_after_the_recording():
    fit(window=(5, None))


@mistake(RunError, "experiment 'rig': the step of 10 s is longer than the run of 2 s.")
def a_step_longer_than_the_recording():
    fit(step=10.0)


@mistake(RunError, "experiment 'rig': a step of 1e-09 s makes 2e+09 steps of its 2 s; 1e+08 are the most.")
def a_step_that_no_memory_holds():
    fit(step=1e-9)


@mistake(RunError, "step must be a positive number of seconds, got 0.")
def a_step_of_nothing_in_a_fit():
    fit(step=0)


@mistake(
    RunError,
    "experiment 'rig': no step that divides the 0.01 s between samples is valid for the diagram: the sample period 0.00037 s of hold is not a multiple of the step 0.00015625 s. A step of 9.25e-05 s would do.",
)
def a_period_that_no_step_of_the_recording_divides():
    fit(uy(), of(hold=ZeroOrderHold(period=0.00037), lag=FirstOrderLag()))


# ---- what is free


@mistake(ParameterError, "free takes names such as 'tsm.*', got {'gain.gain': 1.0}.")
def free_as_a_mapping():
    fit(free={"gain.gain": 1.0})


@mistake(ParameterError, "free takes names such as 'tsm.*', got 3.")
def a_number_among_the_free():
    fit(free=["gain.gain", 3])


@mistake(
    ParameterError,
    "free 'bias' names no parameter of 'Tendon sheath: a gain and an offset'. Did you mean 'offset.bias'?",
)
def free_by_the_end_of_a_name():
    fit(free=["bias"])


@mistake(
    ParameterError,
    "local 'gain.gian' names no parameter of 'Tendon sheath: a gain and an offset'. Did you mean 'gain.gain'?",
)
def a_local_number_is_misspelt():
    fit(local=["gain.gian"])


@mistake(ParameterError, "free 'i.low': it is infinite, so it cannot be estimated; set a finite value first.")
def a_limit_that_never_acts_is_freed():
    fit(uy(), of(i=Integrator()), free=["i.low"])


@mistake(
    ParameterError,
    "nothing is free in this fit of 'Tendon sheath: a gain and an offset': name parameters (free=['block.*']).",
)
def nothing_is_free():
    fit(free=[])


@mistake(ParameterError, "start must be a mapping by name, such as {'tsm.theta': 3.0}, got 2.")
def a_start_without_a_name():
    fit(start=2.0)


@mistake(ParameterError, "gain: Gain has no parameter 'gian'. Did you mean 'gain'?")
def a_start_of_an_unknown_parameter():
    fit(start={"gain.gian": 2.0})


# ---- bounds


@mistake(ParameterError, "bounds must be a mapping by name, such as {'tsm.theta': (0.1, 50.0)}, got [(0, 1)].")
def bounds_without_names():
    fit(bounds=[(0, 1)])


@mistake(ParameterError, "bounds takes names, such as {'tsm.theta': (0.1, 50.0)}, got 0.")
def bounds_by_number():
    fit(bounds={0: (0, 1)})


@mistake(ParameterError, "bounds: 'offset.bias' is not free in this fit. Known here: gain.gain.")
def bounds_of_what_stays():
    fit(free=["gain.gain"], bounds={"offset.bias": (0, 1)})


@mistake(ParameterError, "bounds: 'ofset.*' names no parameter that is free. Did you mean 'offset.bias'?")
def bounds_of_nothing():
    fit(bounds={"ofset.*": (0, 1)})


@mistake(ParameterError, "bounds of 'gain.gain' must be a pair (low, high), None for no bound, got 'low'.")
def bounds_that_are_no_pair():
    fit(bounds={"gain.gain": "low"})


@mistake(ParameterError, "bounds of 'gain.gain': the lower one must be below the upper one, got (1, nan).")
def bounds_of_nan():
    fit(bounds={"gain.gain": (1, np.nan)})


@mistake(ParameterError, "bounds of 'lag.time_constant': (-2, -1) do not overlap the bounds of its block, (0, inf).")
def bounds_that_a_block_excludes():
    fit(uy(), of(lag=FirstOrderLag()), bounds={"lag.time_constant": (-2, -1)})


@mistake(
    ParameterError,
    "'gain.gain' starts at 0.92, outside its bounds of 1 to 2. Start inside: start={'gain.gain': …}, or other bounds.",
)
def a_start_outside_its_bounds():
    fit(bounds={"gain.gain": (1, 2)})


# ---- constraints, ties, priors, weights


@mistake(
    ParameterError,
    "no values of the free parameters within their bounds meet all constraints. At the starting point, gain > 2 is missed by 1.08; sum is missed by 0.42. Relax a constraint or a bound, or free more parameters.",
)
def constraints_that_exclude_each_other():
    fit(constraints={"": "gain > 2", "sum": "gain + abs(bias) < 0.5"})


@mistake(
    ParameterError,
    "no values of the free parameters within their bounds meet all constraints. At the starting point, log(bias) > 1 is no number. Relax a constraint or a bound, or free more parameters.",
)
def a_constraint_that_is_no_number_at_the_start():
    fit(constraints="log(bias) > 1")


@mistake(
    RunError,
    "method='ga' samples random parameter sets, none of which meets the equality gain == 2 * bias. Write it as a tie, or use another method.",
)
def an_equality_for_the_genetic_route():
    fit(constraints="gain == 2 * bias", method="ga")


@mistake(ParameterError, "priors must be a mapping by name, such as {'tsm.theta': (5.0, 0.5)}, got [(1, 2)].")
def priors_without_names():
    fit(priors=[(1, 2)])


@mistake(ParameterError, "priors: 'gian.gain' is not free in this fit. Did you mean 'gain.gain'?")
def a_prior_of_an_unknown_parameter():
    fit(priors={"gian.gain": (1, 2)})


@mistake(ParameterError, "the prior of 'gain.gain' must be a pair (mean, standard deviation), got 1.")
def a_prior_without_a_deviation():
    fit(priors={"gain.gain": 1})


@mistake(ParameterError, "the prior of 'gain.gain' needs a finite mean and a positive standard deviation, got (1, -2).")
def a_prior_with_a_negative_deviation():
    fit(priors={"gain.gain": (1, -2)})


@mistake(
    ParameterError,
    "the prior of 'gain.gain' is so narrow (1e-300) that it fixes the parameter. Set its value instead of freeing it.",
)
def a_prior_that_leaves_nothing():
    fit(priors={"gain.gain": (1, 1e-300)})


@mistake(ParameterError, "sigma: 'x_ou' is not compared here. Did you mean 'x_out'?")
def a_sigma_of_an_unknown_output():
    fit(sigma={"x_ou": 1.0})


@mistake(
    ParameterError, "sigma of 'x_out' must be a positive number, or one with its unit such as '0.05deg', got [0.1]."
)
def a_sigma_that_is_no_number():
    fit(sigma={"x_out": [0.1]})


@mistake(
    ParameterError,
    "sigma=0.06 has no unit, and x_out is in deg in the recording 'm' but compared in rad: write '0.06deg' or '0.06rad'.",
)
def a_sigma_that_could_be_in_two_units():
    t = np.arange(100) * 0.01
    record = tsm.Record("m", t, {"x_in": np.sin(t), "x_out": np.sin(t)}, {"x_in": "deg", "x_out": "deg"})
    tsm.fit(tsm.load("tendon_sheath_linear"), record, sigma=0.06)


@mistake(ParameterError, "sigma is given for some outputs, but not for 'y'.")
def a_sigma_too_few():
    both = tsm.Diagram(title="two", blocks=dict(k=Gain()), inputs={"u": "k"}, outputs={"y": "k", "z": "k"})
    tsm.fit(both, tsm.Record("rig", T, {"u": U, "y": U, "z": U}, {}), sigma={"z": 0.1})


@mistake(
    DataError,
    "experiment 'rig': x_out reaches 0.8, 8e-201 after weighting, and its square is out of range. Choose another unit or sigma.",
)
def a_sigma_of_absurd_size():
    fit(rig(x_in=U, x_out=0.8 * np.sign(U)), sigma=1e200)


# ---- methods and options


@mistake(RunError, "there is no method 'gauss_newton' of fitting. Did you mean 'gauss-newton'?")
def a_method_of_fitting_is_misspelt():
    fit(method="gauss_newton")


@mistake(RunError, "starts must be a whole number of at least 1, got 2.5.")
def half_a_start():
    fit(starts=2.5)


@mistake(RunError, "seed must be a whole number of at least 0, got None.")
def a_seed_of_nothing():
    fit(seed=None)


@mistake(RunError, "start_states must be True or False, got 'all'.")
def start_states_by_name():
    fit(start_states="all")


@mistake(DataError, "hold must be one of auto, zero, linear, cubic, or a mapping from inputs to these, got None.")
def a_hold_of_nothing():
    fit(hold=None)


@mistake(RunError, "integrator must be a text, got 4.")
def an_integrator_that_is_a_number():
    fit(integrator=4)


@mistake(RunError, "iterations must be a whole number of at least 0, got 'many'.")
def a_limit_in_words():
    fit(iterations="many")


@mistake(RunError, "segments=5 (multiple shooting) needs method='ipopt', got 'gauss-newton'.")
def pieces_for_another_method():
    fit(segments=5)


@mistake(
    RunError,
    "multiple shooting does not support transport delays (late.past): the content of a delay cannot be an initial state. Use one segment.",
)
def pieces_of_a_delay():
    fit(uy(), of(late=Delay(time=0.1), lag=FirstOrderLag()), method="ipopt", segments=3)


@mistake(RunError, "progress must be a function of stage, evaluations and rms, got True.")
def progress_that_cannot_be_told():
    fit(progress=True)


@mistake(
    RunError,
    "only a diagram can be run, got 'tendon_sheath_linear'. Load it first: tsmblocks.load('tendon_sheath_linear').",
)
def a_fit_of_a_name():
    tsm.fit("tendon_sheath_linear", rig())


# ---- searches that cannot begin, or end badly


def feedback():
    return tsm.Diagram(
        title="loop",
        blocks=dict(error=Sum(signs="+-"), k=Gain(), i=Integrator()),
        wires=["error -> k -> i -> error.minus"],
        inputs={"u": "error.plus"},
        outputs={"y": "i"},
    )


@mistake(
    NotFinite,
    "experiment 'rig' cannot be simulated: i.integral = -inf at t = 0.79 s: a state of i (Integrator) diverges. One step before: i.integral = -3.46894e+302. The loop may be unstable, or the step too long for it; try a smaller step.",
)
def a_start_from_which_the_simulation_runs_away():
    fit(uy(), feedback(), start={"k.gain": -2000.0}, starts=1, step=0.01)


@mistake(
    RunError,
    "the search cannot begin: at its start the simulation is so far from the measurement that the squared residual overflows. Is an initial state or a unit wrong?",
)
def a_start_too_far_off_to_be_squared():
    fit(start={"gain.gain": 1e200}, starts=1)


@block(register=False)
class Root(Block):
    """A gain whose slope is infinite at zero."""

    k: float = parameter(default=0.0, about="square of the gain", at_least=0.0)
    u = Input("any signal")
    y = Output("the signal, scaled")

    def outputs(self, t, x, u):
        return dict(y=ca.sqrt(self.k) * u.u)


@mistake(
    RunError,
    "the search ended where the derivative of the outputs with respect to root.k is not finite, as for a square root at zero, or for friction that changes within a step. Start elsewhere, exclude this value by a bound, or give a smaller step.",
)
def an_end_at_an_infinite_slope():
    fit(uy(y=0 * U), of(root=Root()), starts=1)


@block(register=False)
class Ordered(Block):
    """A straight line that wants its numbers in order."""

    a: float = parameter(default=1.0, about="slope")
    b: float = parameter(default=2.0, about="offset")
    u = Input("any signal")
    y = Output("the line")

    def check(self):
        if self.a >= self.b:
            raise ParameterError(f"Ordered needs a < b, got a={self.a:g}, b={self.b:g}.")

    def outputs(self, t, x, u):
        return dict(y=self.a * u.u + self.b)


@mistake(
    ParameterError,
    "the fit ended where a block refuses its parameters: line: Ordered needs a < b, got a=3, b=1. Exclude them by bounds or a constraint.",
)
def an_end_that_a_block_refuses():
    fit(uy(y=3 * U + 1), of(line=Ordered()), starts=1)


# ---- results


@mistake(ParameterError, "the fit has no estimate 'gain.gian'. Did you mean 'gain.gain'?")
def an_estimate_is_misspelt():
    fit(starts=1)["gain.gian"]


@mistake(ParameterError, "'gain' may be a.gain or b.gain in this fit. Give the full name.")
def an_estimate_that_may_mean_two():
    fit(uy(), of(a=Gain(), b=Gain()), starts=1)["gain"]


@mistake(DataError, "there is no difference 'rigg'. Did you mean 'rig'?")
def a_difference_is_misspelt():
    tsm.score(SHEATH, rig())["rigg"]


@mistake(DataError, "'x_out' may be the difference one.x_out or two.x_out. Give the full name.")
def a_difference_that_may_mean_two():
    tsm.score(SHEATH, [rig("one"), rig("two")])["x_out"]


# ---- comparisons


def compare(models=("tendon_sheath_linear", "tendon_sheath_play"), **given):
    return tsm.compare(models, rig(), **{"starts": 1, **given})


@mistake(RunError, "models must be diagrams, a list or a mapping of them, got 3.")
def models_that_are_a_number():
    compare(3)


@mistake(RunError, "a model must be a diagram, a diagram file or the name of one, got None.")
def a_model_that_is_nothing():
    compare([None])


@mistake(RunError, "there are no models to compare.")
def no_models():
    compare([])


@mistake(RunError, "two models are named 'linear'; give a mapping with different names.")
def two_models_of_one_name():
    compare(["tendon_sheath_linear", "tendon_sheath_linear"])


@mistake(RunError, "free: there is no model 'plai'. Did you mean 'play'?")
def free_of_an_unknown_model():
    compare(free={"plai": ["play.*"]})


@mistake(ParameterError, "free must be a mapping by name, such as {'play': ['play.*']}, got ['play.*'].")
def free_for_no_model():
    compare(free=["play.*"])


@mistake(
    DataError, "train must be a share of each recording, above 0 and up to 1, or a window (start, stop) in s, got 50."
)
def a_share_in_percent():
    compare(train=50)


@mistake(DataError, "train must be a pair (start, stop) in s, None for an end, got 'half'.")
def a_share_in_words():
    compare(train="half")


@mistake(DataError, "held_out: there is no experiment 'bend 60'. Known here: rig.")
def an_unknown_experiment_is_held_out():
    compare(held_out=["bend 60"])


@mistake(DataError, "every experiment is held out, so no data remain to fit.")
def everything_is_held_out():
    compare(held_out="rig")


@mistake(
    RunError, "none of the models could be fitted. there is no method 'newton' of fitting. Did you mean 'gauss-newton'?"
)
def a_comparison_by_no_method():
    compare(method="newton")


@mistake(
    RunError,
    "none of the models could be fitted. linear: diagram 'Tendon sheath: a gain and an offset' has no output 'tip'. Known here: x_out. play: diagram 'Tendon sheath: play and an offset' has no output 'tip'. Known here: x_out.",
)
def a_comparison_of_an_unknown_output():
    compare(outputs=["tip"])


@mistake(RunError, "no model 'plai' was compared. Did you mean 'play'?")
def a_compared_model_is_misspelt():
    compare()["plai"]
