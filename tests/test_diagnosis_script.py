"""A diagnosis as a script: its lines make the same diagram, and with the recordings they find the same errors."""

import json
import math
from types import SimpleNamespace

import attrs
import numpy as np
import pytest

import tsmblocks as tsm
from tsmblocks.blocks import Bias, FirstOrderLag, Gain, GainChange, TemporaryGain
from tsmblocks.diagnosis import script
from tsmblocks.diagnosis.cautions import INCOMPLETE, MAYBE, changes_in_a_row, do_not_carry_over, taken_over
from tsmblocks.diagnosis.insertion_point import InsertionPoint
from tsmblocks.diagnosis.insertion_points import insertion_points
from tsmblocks.diagnosis.model_difference import in_code
from tsmblocks.diagnosis.presentation import fitted_rms, open_scale, output_traces
from tsmblocks.diagnosis.script import MAX_INLINE_EXPERIMENTS, diagram_source, literal, script_lines
from tsmblocks.diagnosis.verdict_text import verdict_sentence
from tsmblocks.effects import catalogue
from tsmblocks.effects.effect import PLACES
from tsmblocks.fitting.identifiability import Undetermined
from tsmblocks.fitting.text import cautions

T = np.arange(0.0, 6.0, 0.02)
X = 50 * np.sin(1.3 * T) + 20 * np.sin(5.1 * T)
EFFECTS = ("backlash", "drift", "dead_time")


def played(x, half_width=1.5, gain=0.92, seed=1):
    """Play as the textbook has it, in degrees, behind a gain, with noise; it does not begin in the middle."""
    middle, y = gain * x[0] + half_width, []
    for u in gain * x:
        middle = max(u - half_width, min(u + half_width, middle))
        y.append(middle)
    return np.array(y) + np.random.default_rng(seed).normal(0.0, 0.2, len(x))


def record(name, x, seed=1):
    noisy = x + np.random.default_rng(seed + 100).normal(0.0, 0.02, len(x))
    return tsm.Record(name, T, {"x_in": noisy, "x_out": played(x, seed=seed)}, {"x_in": "deg", "x_out": "deg"})


RECORDINGS = {"full": record("full", X), "half": record("half", X / 2, seed=2)}


@pytest.fixture(scope="module")
def found():
    return tsm.diagnose(tsm.load("tendon_sheath_linear"), RECORDINGS, noise_floor="0.2deg", effects=EFFECTS)


def told(diagnosis):
    """The rms by experiment that the report tells of the last model, in the diagram's unit."""
    (segment,) = diagnosis.segments
    return {t.experiment: fitted_rms(t)[1] for t in output_traces(segment, "x_out")}


def run(lines, recordings):
    """The names that lines of a script leave, and what they scored."""
    made, scored = "\n".join(lines), list[tsm.Differences]()
    names = {"recordings": recordings, "keep": scored.append}
    assert "print(" in made
    exec(made.replace("print(", "keep("), names)
    return names, {d.experiment: d.rms for one in scored for d in one}


# ---- the errors are found again


def test_from_the_folder_and_the_recordings_alone_the_errors_are_found_again(found, tmp_path):
    folder = found.save(tmp_path / "found")
    facts = json.loads((folder / "diagnosis.json").read_text(encoding="utf-8"))
    diagram, how = tsm.load(folder / "augmented.toml"), facts["simulated"]
    for name, one in RECORDINGS.items():
        score = tsm.score(
            diagram,
            {name: one.conditioned(how["conditioned"])},
            parameters=facts["start_states"][name],
            step=how["steps"][name],
            integrator=how["integrator"],
            hold=how["hold"],
        )
        assert score.rms == pytest.approx(told(found)[name], rel=1e-9)
        alone = tsm.score(diagram, {name: one.conditioned(diagram.simulation.condition)})  # the file says the same
        assert alone.rms == pytest.approx(told(found)[name], rel=1e-9)


def test_pasted_lines_make_the_same_diagram_and_find_the_same_errors(found):
    names, scored = run(script_lines(found), RECORDINGS)
    assert names["diagram"] == found.augmented
    assert names["diagram"].parameters == found.augmented.parameters
    assert scored == pytest.approx(told(found), rel=1e-9)


def test_what_is_printed_and_what_stands_on_the_page_are_these_lines(found):
    assert "\n".join(f"  {line}".rstrip() for line in script_lines(found)) in found.details()


def test_diagrams_have_the_start_states_of_their_experiment(found):
    made = found.diagrams
    assert set(made) == {"full", "half"}
    for name, diagram in made.items():
        assert diagram == found.augmented.with_parameters(found.start_states[name])
        assert diagram.parameters["backlash.m"] == found.start_states[name]["backlash.m"] != 0


def test_a_window_is_part_of_the_lines():
    found = tsm.diagnose(
        tsm.load("tendon_sheath_linear"),
        RECORDINGS,
        noise_floor="0.2deg",
        effects=EFFECTS,
        window={"full": (1.0, None)},
        condition=False,
    )
    names, scored = run(script_lines(found), RECORDINGS)
    assert "conditioned" not in "\n".join(script_lines(found))
    assert names["diagram"] == found.augmented
    assert scored == pytest.approx(told(found), rel=1e-9)


def test_start_states_of_many_experiments_are_read_from_the_file(found, tmp_path, monkeypatch):
    starts = {f"e{k}": found.start_states["full"] for k in range(MAX_INLINE_EXPERIMENTS + 1)}
    many = attrs.evolve(found, simulated=attrs.evolve(found.simulated, start_states=starts))
    many.save(tmp_path)
    monkeypatch.chdir(tmp_path)
    _, scored = run(script_lines(many), {"e3": RECORDINGS["full"]})
    assert scored == {"e3": pytest.approx(told(found)["full"], rel=1e-9)}


def test_pieces_that_begin_anew_are_cut_by_the_lines(tmp_path, monkeypatch):
    motor = tsm.load("motor_linear")
    (drive,), (angle,) = motor.inputs, motor.outputs
    t = np.arange(0.0, 4.0, 0.01)
    u = 3 * np.sin(5 * t) + 2 * np.sin(13.0 * t)
    y = tsm.simulate(motor, inputs={drive: (t, u)}, stop=t[-1], step=0.01, hold="cubic")[angle]
    y = y + 0.02 * np.sin(0.8 * t) + 0.002 * np.random.default_rng(3).standard_normal(len(t))  # too much for one piece
    one = tsm.Record("run", t, {drive: u, angle: y}, {drive: motor.inports[drive].unit, angle: motor.unit(angle)})
    found = tsm.diagnose(motor, one, noise_floor="0.002rad", effects=["load_offset"])
    assert found.simulated is not None
    assert list(found.simulated.pieces) == ["run#1", "run#2", "run#3", "run#4"]
    names, scored = run(script_lines(found), {"run": one})
    assert names["diagram"] == found.augmented
    pieces = {trace.experiment: fitted_rms(trace)[1] for trace in found.segments[0].traces}
    assert scored == pytest.approx(pieces, rel=1e-9)
    found.save(tmp_path)
    monkeypatch.chdir(tmp_path)
    monkeypatch.setattr(script, "MAX_INLINE_EXPERIMENTS", 3)
    assert "pieces = saved['simulated']['pieces']" in script_lines(found)
    assert run(script_lines(found), {"run": one})[1] == pytest.approx(pieces, rel=1e-9)


# ---- the diagram is made again


def bench(place):
    """A diagram that has a wire of this kind."""
    if place in ("brake", "parallel"):
        return tsm.load("motor_linear").rewire(outputs={"v": "motor.v"})
    if place in ("drive", "load", "mode"):
        return tsm.load("motor_linear")
    inside = {
        "transmission": "belt_drive",
        "deflection": "flexible_joint",
        "branch": "fig07_observer",
        "loop": "fig09b_elementary",
        "balance": "two_tanks",
        "element": "flexible_joint",
    }
    return tsm.load(inside.get(place, "tendon_sheath_linear"))


def outputs_of(diagram):
    return [name for name, end in diagram.shown.items() if end[0]]


@pytest.mark.parametrize("effect", catalogue(), ids=lambda e: f"{e.name} {e.variant}".strip())
def test_an_expression_of_a_script_puts_each_effect_where_it_was_put(effect):
    diagram = bench(effect.place)
    places = [one for one in insertion_points(diagram, outputs_of(diagram)) if one.place == effect.place]
    assert places
    for place in places:
        text = place.code("added", effect.block).replace("…", literal(effect.block), 1)
        assert eval(text, names_of(diagram)) == place.put(diagram, "added", effect.block)


def names_of(diagram):
    from tsmblocks import blocks
    from tsmblocks.effects import delay, friction, loop, maps
    from tsmblocks.effects import time_varying as timely

    own = {k: v for home in (delay, friction, loop, maps, timely) for k, v in vars(home).items()}
    return {**own, **{k: getattr(blocks, k) for k in dir(blocks)}, "tsm": tsm, "diagram": diagram}


def test_every_place_has_been_tried():
    assert {effect.place for effect in catalogue()} == set(PLACES)


def test_a_block_of_several_outputs_is_put_there_by_the_same_expression():
    two = tsm.Diagram(
        title="two",
        blocks={"a": Gain(gain=2.0), "b": Gain(), "both": tsm.blocks.Sum(signs="++")},
        wires=["a -> both.plus1", "b -> both.plus2"],
        inputs={"u": "a.u", "x": "b.u"},
        outputs={"y": "both", "half": "a"},
    )
    diagram = tsm.load("tendon_sheath_linear").insert("front", Gain(), before="gain.u")
    place = InsertionPoint("across", "x_out", "offset.y", "front.y", after="offset.y")
    text = place.code("added", two).replace("…", literal(two), 1)
    assert eval(text, names_of(diagram)) == place.put(diagram, "added", two)


def test_numbers_without_end_and_options_are_written_so_that_they_can_be_read():
    names = names_of(None)
    for block in (tsm.blocks.Saturation(low=-math.inf, high=2.0), tsm.blocks.Sum(signs="+-+"), Gain()):
        assert eval(literal(block), names) == block
    assert "signs" not in in_code(tsm.blocks.Sum(signs="+-+"))


def test_a_diagram_is_loaded_by_the_name_under_which_it_was_found(tmp_path):
    assert diagram_source(tsm.load("tendon_sheath_linear")) == "tendon_sheath_linear"
    tsm.save(tsm.load("tendon_sheath_linear"), tmp_path / "mine.toml")
    assert diagram_source(tsm.load(tmp_path / "mine.toml")) == str(tmp_path / "mine.toml")
    assert diagram_source(tsm.Diagram(blocks={"a": Bias()}, inputs={"u": "a.u"})) == ""


# ---- what to beware of


def test_what_a_fit_of_the_augmented_model_would_warn_of_is_told():
    twice = tsm.load("tendon_sheath_linear").insert("again", Gain(), before="gain.u")
    found = tsm.diagnose(twice, RECORDINGS, noise_floor="0.2deg", effects=EFFECTS, start_states=False)
    (segment,) = found.segments
    ready = {name: one.conditioned(["x_in"]) for name, one in RECORDINGS.items()}
    free = [e.name for e in segment.fit if not e.is_start]
    assert free == ["gain.gain", "offset.bias", "again.gain", "backlash.half_width"]
    own = tsm.fit(
        found.augmented,
        ready,
        free=free,
        starts=1,
        sigma="0.2deg",
        step=found.simulated.steps["full"],
        hold=found.simulated.hold,
    )
    assert [e.name for e in segment.fit] == [e.name for e in own]
    left = () if segment.complete else (INCOMPLETE,)
    assert segment.cautions == (*left, *(text for text in cautions(own) if text not in own.notes))
    assert cautions(own)[0].startswith("gain.gain and again.gain are determined only in combination: with ")
    text = str(found)
    assert "\n- gain.gain and again.gain are determined only in combination: with " in text
    details = found.details()
    table = details[details.index("fitted parameters of the diagram:") :].split("\n\n")[0]
    assert "not determined" in table
    assert segment.cautions[0] in json.loads(found.to_json())["segments"][0]["cautions"]


@pytest.mark.parametrize(
    ("across", "said"),
    [
        ({"creep": None}, []),
        ({"creep": 0.4, "lag": -0.03}, []),
        (
            {"creep": -0.3, "lag": 0.9},
            [
                "creep makes the error of experiments that are held out whole larger: its parameters, fitted to the "
                "others, do not carry over to them."
            ],
        ),
        (
            {"creep": -0.3, "lag": -2.0},
            [
                "creep and lag make the error of experiments that are held out whole larger: their parameters, fitted "
                "to the others, do not carry over to them."
            ],
        ),
    ],
)
def test_effects_that_do_not_carry_over_to_other_experiments_are_told(across, said):
    assert do_not_carry_over(across) == said


def test_effects_that_do_not_carry_over_are_told_with_the_result(found):
    (segment,) = found.segments
    (backlash,) = segment.effects
    assert backlash.across > 0.9
    assert "held out whole" not in str(found)
    worse = attrs.evolve(segment, effects=(attrs.evolve(backlash, across=-0.3),))
    text = str(attrs.evolve(found, segments=(worse,)))
    assert "- backlash makes the error of experiments that are held out whole larger:" in text


def test_an_effect_that_takes_the_place_of_a_block_of_the_model_is_told():
    """A dead zone behind a lag is found in front of it, and then the lag in front of the dead zone."""
    lag = tsm.Diagram(
        blocks={"slow": FirstOrderLag(time_constant=0.3), "first_order_lag": FirstOrderLag(time_constant=0.3)},
        wires=["first_order_lag -> slow"],
        inputs={"u": tsm.Inlet("first_order_lag.u", "V")},
        outputs={"y": "slow"},
    )
    t = 0.01 * np.arange(400)
    y = tsm.simulate(
        lag.with_parameters({"slow.time_constant": 1e-4, "first_order_lag.time_constant": 0.4}),
        inputs={"u": (t, np.sin(3 * t))},
        stop=t[-1],
        step=1e-4,
    )["y"][::100]
    record = tsm.Record("run", t, {"u": np.sin(3 * t), "y": y}, {"u": "V"})
    fit = tsm.fit(lag, record, free=["slow.time_constant", "first_order_lag.time_constant"], starts=1, step=1e-3)
    small = fit if fit["slow.time_constant"].value < 0.01 else None
    names = ("slow", "first_order_lag") if small else ("first_order_lag", "slow")
    (said,) = taken_over(fit, [names[1]])
    assert said.startswith(f"{names[0]}.time_constant went to zero beside {names[1]}, which takes its place:")
    assert taken_over(fit, [names[0]]) == []


def test_two_changes_of_one_signal_over_time_are_doubted():
    """A coil that heats was named one whose gain changes suddenly, twice."""
    blocks = {"coil": Gain(gain=2.0), "one": GainChange(change=0.02), "two": TemporaryGain(change=-0.01)}
    ends = {"inputs": {"u": "coil"}, "outputs": {"y": "two"}}
    row = SimpleNamespace(diagram=tsm.Diagram(blocks=blocks, wires=["coil -> one -> two"], **ends))
    (said,) = changes_in_a_row(row, ["one", "two"])
    assert said.startswith("one and two change one signal over time:")
    assert changes_in_a_row(row, ["two"]) == []
    ends["inputs"] = {"u": "one"}
    apart = SimpleNamespace(diagram=tsm.Diagram(blocks=blocks, wires=["one -> coil -> two"], **ends))
    assert changes_in_a_row(apart, ["one", "two"]) == []


def test_a_size_in_proportion_to_what_is_not_determined_is_said(found):
    """Before, a friction was given to 2 % beside a scale of the force that could have been any."""
    (segment,), names = found.segments, ("gain.gain", "backlash.half_width")
    backlash = next(one for one in segment.effects if one.name == "backlash")
    open_one = Undetermined("combination", names, (1.0, 1.0), 0.0, "", exact=True)
    fit = attrs.evolve(segment.fit, undetermined=(open_one,))
    scaled = attrs.evolve(segment, fit=fit)
    assert open_scale(backlash, scaled) == "gain.gain"
    said = "The size of backlash is known in proportion to gain.gain only, which these data do not determine."
    assert said in verdict_sentence(scaled)
    assert said not in verdict_sentence(segment)
    for one in (attrs.evolve(open_one, exact=False), attrs.evolve(open_one, changes=(1.0, 0.01))):
        assert open_scale(backlash, attrs.evolve(segment, fit=attrs.evolve(fit, undetermined=(one,)))) == ""


@pytest.mark.parametrize(
    ("verdict", "floor", "told"), [("none", 1.0, True), ("none", 3.0, False), ("named", 1.0, False)]
)
def test_that_a_model_error_and_slow_noise_are_indistinguishable_is_a_caution(found, verdict, floor, told):
    (segment,) = found.segments
    (gap,) = segment.gaps
    one = attrs.evolve(segment, verdict=verdict, gaps=(attrs.evolve(gap, noise_floor=gap.held_out[0] / (2.0 / floor)),))
    assert (MAYBE in one.cautions) is told


# ---- of several parts


U = 2 * np.sin(1.3 * T) + 0.8 * np.sin(5.1 * T)
RATIO = 25.0


@pytest.fixture(scope="module")
def parts():
    """A drive that has no memory, and a lag behind it that the step of the recordings is too long for."""
    drive = tsm.Diagram(
        title="drive and tip",
        blocks={"drive": Gain(gain=RATIO), "lag": FirstOrderLag(time_constant=0.003), "tip": Gain(gain=0.92)},
        wires=["drive -> lag -> tip"],
        inputs={"u": "drive"},
        outputs={"x_in": "drive", "x_out": "tip"},
    )
    x = RATIO * U + np.random.default_rng(5).normal(0.0, 0.02, len(T))
    record = tsm.Record("run", T, {"u": U, "x_in": x, "x_out": played(RATIO * U)}, {})
    floors = {"x_in": 0.02, "x_out": 0.2}
    found = tsm.diagnose(drive, record, noise_floor=floors, effects=["backlash"], free=["*.gain"])
    assert [e.name for e in found.effects] == ["backlash"]
    return found, record


def test_the_step_of_the_new_diagram_is_the_finest_of_its_parts(parts, tmp_path):
    found, record = parts
    diagram = tsm.load(found.save(tmp_path / "found") / "augmented.toml")
    assert diagram.simulation.step == found.simulated.steps["run"] < 0.0084  # its limit of stability
    score = tsm.score(diagram, record.conditioned(diagram.simulation.condition))
    assert [d.rms for d in score] == pytest.approx([0.02, 0.2], rel=0.2)


def test_the_errors_of_several_parts_are_found_again_by_the_lines(parts, tmp_path, monkeypatch):
    found, record = parts
    names, scored = {"recordings": {"run": record}, "keep": (every := []).append}, {}
    exec("\n".join(script_lines(found)).replace("print(", "keep("), names | {"diagram": found.first})
    for one in every:
        scored |= {d.output: d.rms for d in one}
    reported = {k: fitted_rms(t)[1] for s in found.segments for k in s.outputs for t in output_traces(s, k)}
    assert scored == pytest.approx(reported, rel=1e-9)
    assert [*scored] == ["x_in", "x_out"]
    found.save(tmp_path)
    monkeypatch.chdir(tmp_path)
    monkeypatch.setattr(script, "MAX_INLINE_EXPERIMENTS", 0)
    assert "start_states = saved['segments'][1]['start_states']" in script_lines(found)
    every.clear()
    exec("\n".join(script_lines(found)).replace("print(", "keep("), names | {"diagram": found.first})
    assert [d.rms for one in every for d in one] == pytest.approx([*reported.values()], rel=1e-9)
