"""Mistakes in effects: where they stand, their blocks and ports, their nulls, and what is there already."""
# ruff: noqa: E501 - the text of a message stands on one line, as the user reads it

import numpy as np

import tsmblocks as tsm
from tests.mistakes.table import mistake
from tsmblocks.blocks import (
    AsymmetricBoucWen,
    Bias,
    Constant,
    Gain,
    Jump,
    Play,
    PositionDependentLoop,
    Resonance,
    Saturation,
    Slack,
    Sum,
)
from tsmblocks.common.errors import DataError, ParameterError, RunError
from tsmblocks.effects import Effect, Trials, catalogue, register
from tsmblocks.model.diagram import Diagram


def effect(**changes):
    given = dict(
        name="louder",
        family="map",
        words="a gain that is off",
        place="output",
        block=Gain(),
        null={"gain": 1.0},
        free=("gain",),
        trials=lambda scales: Trials({}, ({"gain": 1.1},)),
    )
    return Effect(**{**given, **changes})


@mistake(ParameterError, "effect 'louder': there is no place 'outputs'. Did you mean 'output'?")
def an_effect_at_a_misspelt_place():
    effect(place="outputs")


@mistake(
    ParameterError,
    "effect 'louder': there is no place 'sensor'. Known here: across, balance, brake, branch, deflection, drive, element, input, … (14 in all).",
)
def an_effect_at_an_unknown_place():
    effect(place="sensor")


@mistake(ParameterError, "effect 'louder': its block has no parameter 'gian'. Did you mean 'gain'?")
def a_null_of_a_misspelt_parameter():
    effect(null={"gian": 1.0})


@mistake(ParameterError, "effect 'louder': its block has no parameter 'slope'. Known here: gain.")
def a_free_parameter_that_the_block_has_not():
    effect(free=("slope",))


@mistake(ParameterError, "effect 'louder': its block has no parameter 'width'. Did you mean 'half_width'?")
def a_free_parameter_of_another_block():
    effect(block=Play(half_width=0.0), null={"half_width": 0.0}, free=("width",))


@mistake(ParameterError, "effect 'louder': its block must be at its null, and gain is 2 instead of 1.")
def a_block_that_does_not_stand_at_its_null():
    effect(block=Gain(gain=2.0))


@mistake(ParameterError, "effect 'louder': its block must be at its null, and k.bias is 0.5 instead of 0.")
def a_diagram_that_does_not_stand_at_its_null():
    inner = Diagram(title="inner", blocks={"k": Bias(bias=0.5)}, inputs={"u": "k"}, outputs={"y": "k"})
    effect(block=inner, null={"k.bias": 0.0}, free=("k.bias",))


@mistake(ParameterError, "effect 'louder': its block needs a port 'u', and has x, v on that side.")
def an_effect_whose_input_has_another_name():
    effect(block=AsymmetricBoucWen(), null={"delta": 0.14522}, free=("delta",))


@mistake(ParameterError, "effect 'louder': its block needs a port 'u', and has none on that side.")
def an_effect_of_a_source():
    effect(block=Constant(value=1.0), null={"value": 1.0}, free=("value",))


@mistake(ParameterError, "effect 'louder': its block needs a port 'y', and has out on that side.")
def an_effect_whose_output_has_another_name():
    inner = Diagram(title="inner", blocks={"k": Gain()}, inputs={"u": "k"}, outputs={"out": "k"})
    effect(block=inner, null={"k.gain": 1.0}, free=("k.gain",))


@mistake(
    ParameterError,
    "effect 'my effect': blocks are named after it, so its name must be letters, digits and underscores, not starting with a digit.",
)
def an_effect_whose_name_no_block_can_have():
    effect(name="my effect")


@mistake(ParameterError, "effect 'louder': block must be a block or a diagram, got the class Gain. Write Gain().")
def an_effect_with_the_class_of_a_block():
    effect(block=Gain)


@mistake(ParameterError, "effect 'louder': none of its parameters is fitted; name parameters of its block in free.")
def an_effect_with_nothing_to_fit():
    effect(free=())


@mistake(ParameterError, "effect 'louder': within names 'edge', which is not free to be fitted. Known here: share.")
def an_effect_within_the_bounds_of_what_is_not_fitted():
    effect(block=Slack(), null={"share": 0.0}, free=("share",), within=("edge",))


@mistake(ParameterError, "effect 'louder': its block has no state 'swin' to initialise. Did you mean 'swing'?")
def an_effect_settled_in_a_misspelt_state():
    effect(block=Resonance(), null={"share": 0.0}, free=("share",), settled=("swin",))


@mistake(
    ParameterError,
    "effect 'louder': nothing drives the input 'x' of its block at the place 'output' (an input x is driven only at the places across, load, brake, parallel and mode).",
)
def an_effect_that_reads_a_second_signal_where_there_is_none():
    effect(block=PositionDependentLoop(), null={"gain": 0.0})


@mistake(ParameterError, "effect 'louder': nothing drives the input 'w' of its block at the place 'load'.")
def an_effect_that_reads_a_third_signal():
    inner = Diagram(
        title="inner",
        blocks={"k": Gain(), "sum": Sum(signs="+++")},
        wires=["k -> sum.plus1"],
        outputs={"y": "sum"},
        inputs={"u": "k", "x": "sum.plus2", "w": "sum.plus3"},
    )
    effect(block=inner, place="load", null={"k.gain": 1.0}, free=("k.gain",))


@mistake(
    ParameterError,
    "effect 'louder': strengths of its trials name 'gian', which is not free to be fitted. Did you mean 'gain'?",
)
def trials_of_a_misspelt_strength():
    effect().accepts(Trials({"gian": 0.1}))


@mistake(
    ParameterError,
    "effect 'behind': shapes of its trials name 'low', which is not free to be fitted. Known here: high.",
)
def trials_of_a_shape_that_is_not_free():
    inf = float("inf")
    limit = effect(name="behind", block=Saturation(low=-inf, high=inf), null={"high": inf}, free=("high",))
    limit.accepts(Trials({}, ({"low": -1.0},)))


@mistake(
    ParameterError,
    "effect 'louder': bounds of its trials name 'gains', which is not free to be fitted. Did you mean 'gain'?",
)
def trials_with_bounds_of_nothing():
    effect().accepts(Trials({"gain": 0.1}, bounds={"gains": (0.0, 1.0)}))


@mistake(
    ParameterError,
    "effect 'louder': its trials fix 'gain', which is free to be fitted; a parameter is one or the other.",
)
def trials_that_fix_what_is_fitted():
    effect().accepts(Trials({"gain": 0.1}, fixed={"gain": 1.0}))


@mistake(
    ParameterError, "effect 'louder': its trials fix 'slope', which is no parameter of its block. Known here: gain."
)
def trials_that_fix_nothing():
    effect().accepts(Trials({"gain": 0.1}, fixed={"slope": 1.0}))


@mistake(
    ParameterError,
    "effect 'louder': its trials refine the instant 'gain', but its block lacks the transition time 'width'.",
)
def trials_that_refine_what_is_no_instant():
    effect().accepts(Trials({}, ({"gain": 0.1}, {"gain": 0.2}), refine="gain"))


@mistake(ParameterError, "effect 'louder': all shapes of its trials must name the same parameters, and {} does not.")
def trials_whose_shapes_differ():
    effect().accepts(Trials({}, ({"gain": 1.1}, {})))


@mistake(
    ParameterError, "effect 'louder': its trials have no shape to start with; leave shapes out where there is none."
)
def trials_without_a_shape():
    effect().accepts(Trials({}, ()))


@mistake(
    ParameterError,
    "effect 'louder': refine of its trials name 'time', which is not free to be fitted. Known here: gain.",
)
def trials_that_refine_nothing():
    effect().accepts(Trials({}, ({"gain": 1.1},), refine="time"))


@mistake(
    ParameterError,
    "effect 'late': 'size' must be local, as 'time' is: with a shape of each experiment, sizes are separate too.",
)
def an_instant_of_its_own_with_one_size_for_all():
    late = effect(name="late", block=Jump(), null={"size": 0.0}, free=("size", "time"), local=("time",))
    late.accepts(Trials({"size": 0.1}, ({"time": 1.0},), refine="time"))


@mistake(
    ParameterError,
    "effect 'louder': trials must return Trials, or None where the data do not excite it, got {'gain': 1.1}.",
)
def trials_that_are_none():
    effect().accepts({"gain": 1.1})


@mistake(RunError, "progress must be a function of stage, done and of, got 3.")
def a_diagnosis_with_progress_that_cannot_be_told():
    tsm.diagnose("tendon_sheath_linear", {}, progress=3)


@mistake(ParameterError, "effects is empty. Leave it out to try all effects of the catalogue.")
def a_diagnosis_that_looks_for_nothing():
    t = np.arange(300) * 0.01
    record = tsm.Record("a", t, {"x_in": np.sin(t), "x_out": np.sin(t)}, {"x_in": "rad", "x_out": "rad"})
    tsm.diagnose(tsm.load("tendon_sheath_linear"), record, effects=[])


@mistake(ParameterError, "effect 'louder': trials must be a function from Scales to Trials, got {'gain': 1.1}.")
def numbers_instead_of_a_function_that_gives_them():
    effect(trials={"gain": 1.1})


@mistake(ParameterError, "register takes an Effect or a Relative, got Gain(gain=1.0, unit='').")
def a_block_is_registered():
    register(Gain())


@mistake(
    ParameterError,
    "there is an effect 'backlash' at the place 'output' already; give this one another name, or a variant.",
)
def an_effect_is_registered_that_is_there():
    register(next(e for e in catalogue() if e.name == "backlash"))


@mistake(
    ParameterError,
    "there is an effect 'drift' at the place 'output' already; give this one another name, or a variant.",
)
def an_effect_of_a_name_that_is_taken():
    register(effect(name="drift"))


@mistake(DataError, "bench: signal 'x_out [mm]' is wanted in rad. 'mm' does not convert to 'rad'.")
def a_recording_that_measures_another_thing():
    t = np.arange(0.0, 4.0, 0.01)
    noise = 0.1 * np.random.default_rng(0).standard_normal(len(t))
    signals = {"x_in": np.sin(3 * t), "x_out": np.sin(3 * t) + noise}
    record = tsm.Record("bench", t, signals, {"x_in": "rad", "x_out": "mm"})
    tsm.diagnose(tsm.load("tendon_sheath_play"), record)
