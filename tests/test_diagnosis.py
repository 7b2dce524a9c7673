"""The diagnosis from end to end on data in which the effect is hidden, and what it says, keeps and refuses."""

import json
import math
import signal
from dataclasses import replace
from functools import cache

import numpy as np
import pytest

import tsmblocks as tsm
from tests.hidden import Spec, cases
from tests.hidden_bases import base_of, diagnosed, floor_of, recordings
from tsmblocks.blocks import Bias
from tsmblocks.common.errors import DataError, ParameterError
from tsmblocks.data.conditioning import conditioned
from tsmblocks.diagnosis import next_base
from tsmblocks.effects import Effect, Trials, catalogue, registered

SLOW_NEEDS = ["diagnosis", "diagrams/tendon_sheath_*"]
EVERY = 3
"""Every third sample is kept: a third of the time, and the same verdicts."""
STEP = 2e-3
"""Of the generator [s]: coarser than in the benchmark, far finer than the samples."""
FEW = ("sine", "two_sines", "odd_multisine", "offset_multisine")
"""Experiments of motor and chain that are kept: those whose references have no corners between samples."""
SPECS = {
    "nothing": Spec("null", seed=1, protocol="paper"),
    "backlash": Spec("single", "backlash", amplitude=0.6, seed=3, protocol="paper"),
    "lag": Spec("single", "first_order_lag", amplitude=15.0, seed=3, protocol="paper"),
    "jump": Spec("single", "jump", amplitude=0.6, seed=3, protocol="paper"),
    "ripple": Spec("single", "position_ripple", amplitude=0.4, seed=3, protocol="paper"),
    "outside": Spec("outside", "telegraph", amplitude=0.2, seed=3, protocol="paper"),
    "two": Spec("two", "backlash+jump", amplitude=0.6, seed=3, protocol="paper"),
    "unexcited": Spec("unexcited", "dead_zone", seed=3, protocol="paper"),
    "line": Spec("base_line", "hysteresis", amplitude=0.05, seed=4, protocol="paper"),
    "another line": Spec("base_line", "hysteresis", amplitude=0.05, seed=3, protocol="paper"),
    "motor": Spec("motor_closed", "coulomb_friction", amplitude=0.05, seed=3),
    "chain": Spec("chain", "sheath:backlash", amplitude=0.4, seed=3),
}
SOME = (
    *("backlash", "hysteresis", "dead_time", "jump", "position_ripple", "coulomb_friction", "resonance"),
    "first_order_lag",
)
"""Effects looked for where the whole catalogue would take too long."""


def thin(case, kept=None):
    """A case with every third sample, and some of its experiments."""
    records = {n: e for n, e in case.experiments.items() if kept is None or n in kept}
    return replace(case, experiments={n: {k: v[::EVERY] for k, v in e.items()} for n, e in records.items()})


@cache
def hidden(name):
    (made,) = cases([SPECS[name]], step=STEP)
    return thin(made, FEW if name in ("motor", "chain") else None)


@cache
def found(name, **more):
    return diagnosed(hidden(name), **more)


def names(diagnosis):
    return [e.name for e in diagnosis.effects]


# ---- what is hidden is named


ONE_EFFECT = {
    "backlash": ("backlash", "loop"),
    "lag": ("first_order_lag", "delay"),
    "jump": ("jump", "time"),
    "ripple": ("position_ripple", "map"),
    "line": ("hysteresis", "loop"),
    "another line": ("hysteresis", "loop"),
}
WHOLE = ("jump", "ripple", "another line")
"""Those that are looked for in the whole catalogue by default; other tests read what was said of two of them."""


@pytest.mark.parametrize(
    ("name", "more"),
    [
        *((name, {}) for name in WHOLE),
        *((name, {"effects": SOME}) for name in ONE_EFFECT if name not in WHOLE),
        *(pytest.param(name, {}, marks=pytest.mark.slow) for name in ONE_EFFECT if name not in WHOLE),
    ],
)
def test_one_effect_is_named(name, more):
    effect, family = ONE_EFFECT[name]
    said = found(name, **more)
    assert said.verdict == "named"
    assert names(said) == [effect]
    assert said.effects[0].family == family
    assert said.effects[0].share_removed > 0.85
    assert len(said.effects[0].also_possible) <= 2
    gap = said.segments[0].gaps[0]
    assert gap.held_out[-1] < 1.1 * gap.noise_floor < gap.held_out[0]


@pytest.mark.parametrize("name", ["nothing", "unexcited"])
def test_where_nothing_is_to_be_seen_nothing_is_said(name):
    said = found(name)
    assert said.verdict == "none"
    assert said.effects == ()
    assert said.augmented == said.base
    assert said.sentence.startswith("No unmodelled effect between x_in and x_out is detectable with these data")


def test_what_these_motions_do_not_reach_has_no_detection_limit():
    limits = {m.name: m for m in found("nothing").segments[0].limits}
    assert {e.name for e in catalogue()} == set(limits)
    assert math.radians(0.01) < limits["backlash"].value < math.radians(0.2)
    assert limits["coulomb_friction"].value is None


@pytest.mark.parametrize("size", [0.0, 0.05])
def test_wires_that_never_move_show_nothing_and_stop_nothing(size):
    """An input at rest, and one that stays within the slack of the model, so that its output rests."""
    t = np.arange(0.0, 6.0, 0.01)
    x_in = 0.1 + size * np.sin(2.0 * t)
    x_out = 0.01 * np.sin(5.0 * t) + np.random.default_rng(1).normal(0.0, 0.004, t.size)
    record = tsm.Record("rest", t, {"x_in": x_in, "x_out": x_out}, {"x_in": "rad", "x_out": "rad"})
    plant = tsm.load("tendon_sheath_play").with_parameters({"play.half_width": 0.2})
    found = tsm.diagnose(plant, record, noise_floor=0.004, free=["offset.*"], seed=1)
    assert found.verdict in ("named", "unknown")  # what swings by itself is a disturbance, and is there
    assert not {e.name for e in found.effects} & {"backlash", "hysteresis", "rate_dependence", "rate_limit"}


def test_what_is_in_no_catalogue_is_not_given_a_name():
    said = found("outside")
    assert said.verdict == "unknown"
    assert said.effects == ()
    assert f"that none of the {len(said.worst.effects_tried)} effects tried explains" in said.sentence


@pytest.mark.parametrize("more", [{"effects": SOME}, pytest.param({}, marks=pytest.mark.slow)])
def test_two_effects_are_both_named(more):
    assert sorted(names(found("two", **more))) == ["backlash", "jump"]


def test_friction_in_a_position_loop_is_told_from_position_and_voltage():
    said = diagnosed(hidden("motor"), effects=SOME)
    assert names(said) == ["coulomb_friction"]
    assert said.effects[0].wire == "drive.y -> motor.u"
    assert said.segments[0].outputs == ("u", "x_in")


def test_in_a_chain_the_segment_is_found():
    said = diagnosed(hidden("chain"), effects=SOME)
    assert {s.name: s.verdict for s in said.segments} == {"r -> u, x_in": "none", "x_in -> x_out": "named"}
    assert names(said) == ["backlash"]
    assert said.effects[0].segment == "x_in -> x_out"
    assert said.augmented.wires != said.base.wires


# ---- nothing is known beforehand


def test_names_order_and_units_of_the_recordings_change_nothing():
    plain = found("backlash", effects=SOME)
    case = hidden("backlash")
    order = dict(zip(("b7", "zz", "a"), (2, 0, 1), strict=True))
    given = list(recordings(case).values())
    turned = {}
    for name, k in order.items():
        r = given[k]
        turned[name] = tsm.Record(
            name, r.t, {s: np.deg2rad(r[s]) for s in ("x_out", "x_in")}, {"x_in": "rad", "x_out": "rad"}
        )
    said = tsm.diagnose(base_of(case), turned, noise_floor=floor_of(case), effects=SOME)
    assert said.verdict == plain.verdict
    assert names(said) == names(plain)
    assert said.effects[0].also_possible == plain.effects[0].also_possible
    assert said.effects[0].share_removed == pytest.approx(plain.effects[0].share_removed, abs=0.02)
    for k, q in plain.effects[0].parameters.items():  # at the kinks of a play rounding decides where a search ends
        assert said.effects[0].parameters[k].value == pytest.approx(q.value, abs=0.1 * (q.high - q.low))
    # what the search minimises are whitened residuals, so the rms is as near as the parameters are
    assert said.segments[0].gaps[0].train == pytest.approx(plain.segments[0].gaps[0].train, rel=1e-3)


def test_same_data_same_seed_same_bytes():
    one, again = found("jump", effects=SOME), diagnosed(hidden("jump"), effects=SOME)
    assert again.to_json() == one.to_json()
    assert again.augmented == one.augmented


def test_other_seeds_name_the_same():
    said = found("jump", seed=5, effects=SOME)
    assert said.seed == 5
    assert names(said) == ["jump"]


# ---- what was added


def after(differences, seconds):
    """Rms of the first output of each experiment once the loop has forgotten where it began."""
    each = []
    for d in differences.items:
        late = d.t > d.t[0] + seconds
        each.append((d.simulated - d.measured)[late])
    return float(np.sqrt(np.mean(np.concatenate(each) ** 2)))


def test_the_augmented_diagram_loads_runs_and_has_the_errors_that_were_told(tmp_path):
    said, case = found("ripple"), hidden("ripple")
    tsm.save(said.augmented, tmp_path / "augmented.toml")
    loaded = tsm.load(tmp_path / "augmented.toml")
    assert loaded == said.augmented
    assert set(loaded.blocks) - set(said.base.blocks) == {"position_ripple"}
    quiet = {n: conditioned(r, ["x_in"]) for n, r in recordings(case).items()}
    gap = said.segments[0].gaps[0]
    for diagram, k in ((said.base, 0), (loaded, -1)):
        rms = after(tsm.score(diagram, quiet, hold="cubic"), 5.0)
        assert rms == pytest.approx(gap.train[k], rel=0.06)
        assert rms == pytest.approx(gap.held_out[k], rel=0.06)


def test_the_gap_shrinks_on_an_experiment_that_was_never_seen():
    case = hidden("ripple")
    *seen, unseen = recordings(case).values()
    said = tsm.diagnose(base_of(case), seen, noise_floor=floor_of(case), effects=SOME)
    assert names(said) == ["position_ripple"]
    quiet = {unseen.name: conditioned(unseen, ["x_in"])}
    base, augmented = (after(tsm.score(d, quiet, hold="cubic"), 5.0) for d in (said.base, said.augmented))
    floor = math.radians(case.floor)
    assert augmented < 1.1 * floor
    assert base > 3 * floor


def test_the_interval_of_what_is_hidden_holds_it():
    q = found("jump").effects[0].parameters
    assert q["size"].unit == "rad"
    assert q["size"].low < math.radians(0.6) < q["size"].high
    true = hidden("jump").numbers["jump.at"]
    assert q["time"].value == pytest.approx(true, abs=0.05)


def test_a_users_own_effect_takes_part_and_is_named():
    """A gain that is off by its own rule: nothing in the catalogue scales an input."""

    def trials(scales):
        return Trials({"bias": 0.1 * scales.wire.reach})

    shift = Effect(
        "loose_belt",
        "belt",
        "a belt that jumped",
        "input",
        Bias(bias=0.0),
        {"bias": 0.0},
        ("bias",),
        trials,
        excites="any motion",
    )
    records = {}
    for name, r in recordings(hidden("nothing")).items():
        x = r["x_in"] + 8.0
        records[name] = tsm.Record(name, r.t, {"x_in": x, "x_out": r["x_out"]}, dict(r.units))
    base = tsm.load("tendon_sheath_play")
    with registered(shift):
        said = tsm.diagnose(base, records, free=["play.*"], effects=["loose_belt", "backlash"])
    assert names(said) == ["loose_belt"]
    assert "loose_belt" not in {e.name for e in catalogue()}


# ---- what is written


def test_the_json_is_what_other_programs_rely_on():
    said = found("jump")
    told = json.loads(said.to_json())
    assert told["format"] == 1
    assert (told["diagram"], told["seed"], told["status"]) == (said.diagram, 0, "done")
    assert told["experiments"] == ["sine", "two_sines", "two_sines_apart"]
    assert told["verdict"] == "named"
    (effect,) = told["effects"]
    text = ("name", "family", "words", "wire", "block", "separating_experiment")
    assert all(isinstance(effect[k], str) for k in text)
    assert isinstance(effect["also_possible"], list)
    assert 0 <= effect["share_removed"] <= 1
    for q in effect["parameters"].values():
        assert set(q) == {"value", "low", "high", "unit"}
        assert q["low"] <= q["value"] <= q["high"]
    gap = told["gap"]
    assert gap["unit"] == "rad"
    assert gap["noise_floor"] > 0
    for k in ("train", "held_out"):
        assert gap[k]["after"] < gap[k]["before"]
    assert {"coordinate", "share", "words"} == set(told["where"][0])
    assert {"name", "wire", "held_out_gain", "statistic", "line", "in_set"} <= set(told["ranking"][0])
    assert {r["name"] for r in told["ranking"]} <= {e.name for e in catalogue()}
    assert set(told["detection_limits"]) == {e.name for e in catalogue()}
    assert all(v is None or v > 0 for v in told["detection_limits"].values())
    assert len(told["ranking"]) > 25


@pytest.mark.parametrize("name", ["nothing", "outside"])
def test_the_json_is_whole_where_nothing_is_named(name):
    told = json.loads(found(name).to_json())
    assert told["effects"] == []
    assert told["gap"]["held_out"]["before"] == told["gap"]["held_out"]["after"]
    assert not any(r["named"] for r in told["ranking"])


# ---- stopped, or refused


def stopping(stage, count):
    """A progress that presses Ctrl-C when a stage begins for the ``count``-th time."""
    begun = []

    def progress(now, done, of):
        assert 0 <= done <= of
        if not begun or begun[-1] != now:
            begun.append(now)
        if begun.count(stage) == count:
            raise KeyboardInterrupt

    return progress


def test_ctrl_c_in_the_fits_after_a_name_keeps_it(monkeypatch):
    """No progress is reported there."""
    whole, after = next_base.refine_memories, []

    def pressed(model, *rounds):
        if not rounds:  # of the next base, not of a candidate
            signal.raise_signal(signal.SIGINT)
            model.problem.cost(model.theta)
            after.append(model)
        return whole(model, *rounds)

    monkeypatch.setattr(next_base, "refine_memories", pressed)
    said = diagnosed(hidden("jump"), effects=SOME)
    assert said.status == "interrupted"
    assert names(said) == ["jump"]
    assert not after


def test_ctrl_c_keeps_what_was_found():
    said = diagnosed(hidden("jump"), effects=SOME, progress=stopping("tried", 2))
    assert said.status == "interrupted"
    assert names(said) == ["jump"]
    assert json.loads(said.to_json())["status"] == "interrupted"


def test_a_search_that_was_stopped_with_more_than_noise_left_is_incomplete():
    said = diagnosed(hidden("two"), effects=SOME, progress=stopping("tried", 2))
    assert said.status == "interrupted"
    assert len(names(said)) == 1
    assert not said.complete
    assert (
        "the search was stopped before every effect had been tried beside the named ones" in said.segments[0].sentence
    )
    assert "Let the search run to its end" in str(said)


@pytest.mark.parametrize("stage", ["conditioned", "calibrated", "tried", "fitted"])
def test_ctrl_c_before_anything_was_found_is_passed_on(stage):
    with pytest.raises(KeyboardInterrupt):
        diagnosed(hidden("jump"), effects=SOME, progress=stopping(stage, 1))


TITLE = "'Tendon sheath: symmetric Bouc-Wen and an offset'"
FAULTS = {
    "too short": (
        dict(short=True),
        DataError,
        "a diagnosis takes at least 200 samples of all experiments together, and there are 51: with fewer, no effect "
        "is distinguishable from chance.",
    ),
    "no output": (
        dict(signals=("x_in",)),
        DataError,
        f"sine: none of the outputs of {TITLE} (x_out) was measured; the recording has x_in. Map one when reading: "
        "map={'x_out': 'COLUMN'}, or --map 'x_out=COLUMN'; or give the diagram an output of that name.",
    ),
    "no input": (
        dict(signals=("x_out",)),
        DataError,
        f"sine: {TITLE} needs its input 'x_in', and the recording has no such signal. Known here: x_out. If it has "
        "another name there, map it when reading: map={'x_in': 'COLUMN'}, or --map 'x_in=COLUMN'.",
    ),
    "no recordings": (
        dict(none=True),
        DataError,
        "there are no recordings to compare with: give a Record (tsm.read), a list, or a mapping.",
    ),
    "floor of nan": (
        dict(noise_floor=math.nan),
        ParameterError,
        "noise_floor must be a positive number, or one with its unit such as '0.05deg', got nan.",
    ),
    "floor of nothing measured": (
        dict(noise_floor={"x_uot": 1.0}),
        ParameterError,
        "noise_floor: 'x_uot' is not compared here. Did you mean 'x_out'?",
    ),
    "unknown effect": (
        dict(effects=["baklash"]),
        ParameterError,
        "effects: 'baklash' names no effect of the catalogue. Did you mean 'backlash'?",
    ),
    "unknown parameter": (
        dict(free=["tsm.alpa"], noise_floor=1e-3),
        ParameterError,
        f"free 'tsm.alpa' names no parameter of {TITLE}. Did you mean 'tsm.alpha_x'?",
    ),
    "unknown output": (
        dict(outputs=["x_uot"]),
        DataError,
        f"diagram {TITLE} has no output 'x_uot'. Did you mean 'x_out'?",
    ),
}


@pytest.mark.parametrize("fault", FAULTS)
def test_what_cannot_be_diagnosed_is_said_in_one_message(fault):
    more, kind, text = FAULTS[fault]
    more = dict(more)
    case = hidden("jump")
    records = recordings(case, more.pop("signals", None))
    r = records["sine"]
    given = r.part(r.t[0], r.t[0] + 1.5) if more.pop("short", False) else r
    given = {} if more.pop("none", False) else given
    with pytest.raises(kind) as caught:
        tsm.diagnose(base_of(case), given, **more)
    assert str(caught.value) == text
