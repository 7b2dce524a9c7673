"""The catalogue: at its null each effect gives the diagram back bit for bit, and everything that is tried shows."""

from __future__ import annotations

import math
from functools import cache
from importlib import import_module
from itertools import pairwise

import attrs
import numpy as np
import pytest
from hypothesis import example, given, settings
from hypothesis import strategies as st

import tsmblocks as tsm
from tests.hidden.kinds import FAMILIES
from tests.mistakes import diagnosing
from tests.mistakes.table import TABLE, said
from tsmblocks.blocks import AsymmetricBoucWen, Bias, FirstOrderLag, Gain, Integrator, Sum
from tsmblocks.common.errors import NotFinite, ParameterError, TsmError
from tsmblocks.diagnosis.candidates import unit_of_signal, whole_turn
from tsmblocks.diagnosis.insertion_points import insertion_points
from tsmblocks.effects import Effect, Scales, Span, Trials, catalogue, register, registered, relatives, span_of
from tsmblocks.effects.effect import PLACES
from tsmblocks.effects.other_names import OTHER_NAMES
from tsmblocks.engine.kernel_frame import JUMP_OFFSETS, time_jumps
from tsmblocks.engine.program import Program
from tsmblocks.files.shipped import shipped_names
from tsmblocks.model.block import REGISTRY
from tsmblocks.model.diagram import Diagram
from tsmblocks.simulation.compiled import equations

CONTRACT = {family: set(names.split()) for family, names in FAMILIES.items() if family != "unknown"}
ADDED = {
    "friction": {"viscous_friction"},
    "loop": {"capstan_friction"},
    "load": {"stiffness", "end_stop", "gravity"},
    "map": {"asymmetric_gain", "gain_error", "offset"},
}
"""Effects that the benchmark of hidden effects does not hide."""
SHEATHS = tuple(name for name in shipped_names() if name.startswith("tendon_sheath_"))
LOOPS = ("fig09a_without_feedforward", "fig09b_elementary", "fig16_feedforward_feedback", "sampled_position_loop")
SLOW_NEEDS = ["effects", "diagrams/*.toml"]
SLOW = (*SHEATHS[-3:], *LOOPS[:3])
"""Diagrams that the effects are slow to be put into: others are much like them."""
BACKENDS = ("llvm", "casadi")
STEP = 0.01
T = np.arange(0.0, 6.0, STEP)
TURNS = 0.5 * np.sin(1.3 * T) + 0.3 * np.sin(3.7 * T + 0.4) + 0.1 * np.sin(11 * T)
RICH = np.where(T < 1, 0.1 * T, np.where(T > 5, TURNS[500], TURNS))
"""Slow, fast and at rest."""
REFUSED = {
    "fig16_feedforward_feedback": {
        ("resonance", "x_in"),
        *((name, wire) for name in ("rate_dependence", "stribeck_friction") for wire in ("x_out", "x_in")),
    },
    "sampled_position_loop": {("hysteresis", "u")},
    "tank": {(name, "x_out") for name in ("rate_dependence", "stribeck_friction")},
}
"""Around a closed loop without a lag, and behind a level that sets its own, the rate of a signal would need itself; a
sampled command has none."""


UNSTABLE = {("hysteresis", "loop"), ("hysteresis", "branch"), ("resonance", "mode")}
"""Effects and places with which a fast loop may be unstable."""


def run(diagram, backend="llvm", parameters=None):
    more = dict(backend=backend, parameters=parameters or {}, check_step=False)
    if not diagram.inputs:
        return tsm.simulate(diagram, stop=0.6, step=1e-3, **more)
    (name,) = diagram.inputs
    step = STEP if name == "x_in" else STEP / 5  # of a motor, dry friction makes fast poles
    return tsm.simulate(diagram, inputs={name: (T, RICH)}, stop=T[-1], step=step, hold="cubic", **more)


BRANCHES = Diagram(
    title="a gain beside a lag",
    blocks={"gain": Gain(gain=0.5, unit="rad"), "lag": FirstOrderLag(time_constant=0.3), "both": Sum(signs="++")},
    wires=["gain -> both.plus1", "lag -> both.plus2"],
    inputs={"x_in": ["gain", "lag"]},
    outputs={"x_out": "both"},
)


TANK = Diagram(
    title="a tank that a pump fills",
    blocks={
        "pump": Gain(gain=0.5, unit="m/s"),
        "net": Sum(),
        "level": Integrator(unit="m"),
        "outlet": Gain(gain=0.4, unit="m/s"),
    },
    wires=["pump -> net.plus", "net -> level -> outlet -> net.minus"],
    inputs={"x_in": "pump"},
    outputs={"x_out": "level"},
)


def plant(name):
    """A shipped diagram, the motor whose speed is measured, parallel branches, or a tank."""
    if name in ("branches", "tank"):
        return BRANCHES if name == "branches" else TANK
    return tsm.load("motor_linear").rewire(outputs={"v": "motor.v"}) if name == "motor_speed" else tsm.load(name)


@cache
def base(name, backend="llvm"):
    return run(plant(name), backend)


def scales(diagram, site, done):
    step = done.t[1] - done.t[0]

    def span(signal):
        found = span_of([RICH], [STEP]) if signal in diagram.inputs else span_of([done[signal]], [step])
        return attrs.evolve(found, turn=whole_turn(unit_of_signal(diagram, signal)))

    wire = span(site.signal)
    return Scales(
        wire, span(site.other) if site.other else wire, 0.0, done.t[-1], step, done.t[-1], (0.7, 3.1), one_clock=False
    )


def edits(name):
    """Every effect on every wire of a shipped diagram: the effect, its site, what is tried, and the diagram at null."""
    diagram, refused = plant(name), set()
    outputs = [k for k in diagram.outputs if k != "x_ref"]
    for site in insertion_points(diagram, outputs):
        for effect in catalogue():
            if effect.place != site.place:
                continue
            trials = effect.trials(scales(diagram, site, base(name)))
            if trials is None:
                continue
            try:
                made = site.put(diagram, "effect", effect.block)
                equations(made, loops="refuse")
            except TsmError:
                refused.add((effect.name, site.output))
                continue
            shape = {k: v for k, v in trials.shapes[0].items() if k not in effect.null}
            numbers = {f"effect.{k}": v for k, v in {**trials.fixed, **shape}.items()}
            yield effect, site, trials, made.with_parameters(numbers)
    assert refused == REFUSED.get(name, set())


def sets(trials, shapes=None):
    """Numbers that are tried."""
    for shape in trials.shapes if shapes is None else shapes:
        for strength in [{k: v} for k, v in trials.strengths.items()] or [{}]:
            yield {**shape, **strength}


# ---- names and words


def test_names_and_families_are_those_that_programs_rely_on():
    found = {}
    for effect in catalogue():
        found.setdefault(effect.family, set()).add(effect.name)
    assert found == {k: names | ADDED.get(k, set()) for k, names in CONTRACT.items()}


def test_variants_of_one_name_can_be_told_apart():
    keys = [(e.name, e.variant, e.place) for e in catalogue()]
    assert len(set(keys)) == len(keys)
    words = {}
    for e in catalogue():
        words.setdefault(e.words, set()).add(e.name)
    assert [names for names in words.values() if len(names) > 1] == []


@pytest.mark.parametrize("effect", catalogue(), ids=lambda e: f"{e.name}-{e.variant}")
def test_what_is_said_of_an_effect(effect):
    assert effect.place in PLACES
    assert effect.null
    assert effect.excites
    assert effect.separates
    assert effect.confused
    assert set(effect.confused) <= {e.name for e in catalogue()} - {effect.name}
    assert len(set(effect.confused)) == len(effect.confused)
    assert effect.free
    assert set(effect.settled) <= set(states(effect.block))
    assert set(effect.within) <= set(effect.free)


def states(block):
    if isinstance(block, Diagram):
        return [f"{k}.{s}" for k, inner in block.blocks.items() for s in states(inner)]
    return list(block.states)


def test_an_effect_is_found_by_what_people_call_it():
    names = {one.name for one in catalogue()} | {one.name for one in relatives()}
    assert set(OTHER_NAMES.values()) <= names
    assert not names & set(OTHER_NAMES)
    record = tsm.Record("run", np.arange(300.0), {"x_in": np.ones(300), "x_out": np.ones(300)}, {})
    with pytest.raises(ParameterError, match=r"effects: 'Stick-slip' names no effect .* It is 'coulomb_friction' here"):
        tsm.diagnose(tsm.load("tendon_sheath_linear"), record, effects=["Stick-slip"])


def test_the_order_is_always_the_same():
    assert [id(e) for e in catalogue()] == [id(e) for e in catalogue()]


# ---- what is tried

SPANS = st.builds(
    lambda middle, reach, rms, speed, fastest, turn: Span(
        middle - reach, middle + reach, rms * reach, speed * reach, fastest * speed * reach, turn
    ),
    st.floats(-10, 10),
    st.floats(1e-3, 1e3),
    st.floats(0.2, 1.5),
    st.floats(0.1, 100),
    st.floats(1, 10),
    st.sampled_from((0.0, 2 * math.pi, 360.0)),
)
SCALES = st.builds(
    lambda wire, other, start, length, step, share, lines, one_clock: Scales(
        wire, other, start, start + length, step, share * length, tuple(lines), one_clock
    ),
    SPANS,
    SPANS,
    st.floats(0, 100),
    st.floats(5, 1e4),
    st.floats(1e-3, 0.02),
    st.floats(0.3, 1),
    st.lists(st.floats(0.3, 20), max_size=6),
    st.booleans(),
)
FAR_FROM_ZERO = Span(99.9, 100.1, 0.05, 0.2, 1.0)
"""A wire that moves little about a large value, as a preloaded spring does."""


@pytest.mark.parametrize("effect", catalogue(), ids=lambda e: f"{e.name}-{e.variant}")
@settings(max_examples=15, deadline=None)
@example(scales=Scales(FAR_FROM_ZERO, FAR_FROM_ZERO, 0.0, 10.0, 0.01, 10.0))
@given(scales=SCALES)
def test_what_is_tried_fits_the_block_and_its_bounds(effect, scales):
    trials = effect.trials(scales)
    if trials is None:
        no_line = not any(f * (scales.stop - scales.start) >= 2 for f in scales.lines)
        no_time = scales.shortest <= 500.01 * scales.step
        one_sign = min(scales.wire.high, -scales.wire.low) <= 0.1 * scales.wire.reach
        excuse = {
            "periodic_disturbance": no_line,
            "creep": effect.variant == "broad" and no_time,
            "asymmetric_gain": one_sign,
            "gravity": not scales.other.turn,
            "drift": effect.variant.startswith("settling") and no_time,
            "parameter_change": "settling" in effect.variant and no_time,
        }
        assert excuse.get(effect.name) or (effect.local and scales.one_clock)
        return
    effect.accepts(trials)
    shaped = set().union(*trials.shapes)
    assert set(trials.strengths) | shaped == set(effect.free)
    assert set(trials.strengths) <= set(effect.null) | set(effect.free)
    assert not set(trials.fixed) & set(effect.free)
    assert set(trials.bounds) <= {*effect.free, *states(effect.block)}
    assert set(trials.strengths) or set(effect.null) <= shaped, "what is null must be tried"
    assert all(not shaped or set(shape) == shaped for shape in trials.shapes)
    for low, high in trials.bounds.values():
        assert (-math.inf if low is None else low) < (math.inf if high is None else high)
    for made in sets(trials):
        told = {**trials.fixed, **made}
        assert all(math.isfinite(v) for v in told.values())
        for name, value in made.items():
            low, high = trials.bounds.get(name, (None, None))
            inside = np.clip(value, -np.inf if low is None else low, np.inf if high is None else high)
            assert inside == pytest.approx(value, rel=1e-9), name
        holder = effect.block if isinstance(effect.block, Diagram) else alone(effect.block)
        prefix = "" if isinstance(effect.block, Diagram) else "effect."
        holder.with_parameters({f"{prefix}{k}": v for k, v in told.items()})  # within the block's own bounds


def alone(block):
    return Diagram(
        blocks={"effect": block}, inputs={k: f"effect.{k}" for k in block.inports if not block.inports[k].rate_of}
    )


# ---- a null is nothing, and a trial is something

QUICK = pytest.mark.filterwarnings("ignore::tsmblocks.simulation.stability.StepWarning")
"""A drive that jumps turns a loop round at once, which is too fast for any step, and harmless."""


def most_off(diagram):
    """Largest difference that an effect at its null may make, as a share of the largest value: none.

    Where a signal jumps with time alone, as the rate of a change that begins does, the last stage of a step is taken
    that share of the step before its end.
    """
    return JUMP_OFFSETS[0] if time_jumps(Program(equations(diagram).rhs)) else 0.0


@QUICK
@pytest.mark.parametrize(
    "name",
    [
        pytest.param(name, marks=pytest.mark.slow) if name in SLOW else name
        for name in (*SHEATHS, "motor_linear", "belt_drive", "flexible_joint", "branches", "tank", *LOOPS)
    ],
)
def test_at_its_null_an_effect_gives_the_diagram_back(name):
    seen = 0
    for effect, site, _, made in edits(name):
        most = most_off(made)
        for backend in BACKENDS:
            done = run(made, backend)
            for output in made.outputs:
                without = base(name, backend)[output]
                off = np.abs(done[output] - without).max() / max(np.abs(without).max(), 1e-300)
                assert off <= most, (effect, site, backend, output, off)
        seen += 1
    assert seen >= 25


@QUICK
@pytest.mark.parametrize("name", [*SHEATHS, "motor_linear", "belt_drive", "flexible_joint", *LOOPS[2:]])
def test_every_trial_shows_and_stays_finite(name):
    for effect, site, trials, made in edits(name):
        some = trials.shapes[:: max(len(trials.shapes) // 6, 1)]
        for tried in sets(trials, some):
            try:
                done = run(made, parameters={f"effect.{k}": v for k, v in tried.items()})
            except NotFinite:
                assert (effect.name, site.place) in UNSTABLE
                continue
            assert all(np.isfinite(done[k]).all() for k in made.outputs), (effect, tried)
            changed = any(not np.array_equal(done[k], base(name)[k]) for k in made.outputs)
            assert changed or tried.get("until", T[-1]) < 1, (effect, site, tried)  # before, a play is in its gap


def test_every_effect_finds_a_place():
    names = (
        "tendon_sheath_linear",
        "motor_linear",
        "motor_speed",
        "belt_drive",
        "flexible_joint",
        "branches",
        "tank",
        LOOPS[0],
    )
    found = {(e.name, e.variant, e.place) for name in names for e, *_ in edits(name)}
    assert found == {(e.name, e.variant, e.place) for e in catalogue()}


@pytest.mark.parametrize("backend", BACKENDS)
@pytest.mark.parametrize("name", ["backlash", "rate_limit"])
def test_at_null_the_rate_passes_too(name, backend):
    """A sheath behind reads the rate of what it is given."""
    effect = next(e for e in catalogue() if e.name == name)
    plain = Diagram(blocks={"tsm": AsymmetricBoucWen()}, inputs={"x_in": "tsm.x"}, outputs={"x_out": "tsm"})
    before = run(plain.insert("effect", effect.block, after="x_in"), backend)
    assert np.array_equal(before["x_out"], run(plain, backend)["x_out"])


# ---- sizes of signals


@given(st.lists(st.lists(st.floats(-1e3, 1e3), min_size=2, max_size=20), min_size=1, max_size=4), st.floats(1e-3, 1))
def test_the_span_of_signals(signals, step):
    span = span_of([np.array(y) for y in signals], [step] * len(signals))
    every = np.concatenate(signals)
    assert (span.low, span.high) == (every.min(), every.max())
    assert span.rms == pytest.approx(math.sqrt(sum(v * v for v in every) / len(every)))
    rates = [abs(b - a) / step for y in signals for a, b in pairwise(y)]
    assert span.fastest == pytest.approx(max(rates))
    assert span.speed == pytest.approx(math.sqrt(sum(v * v for v in rates) / len(rates)))
    assert span.middle == pytest.approx((span.low + span.high) / 2)
    assert span.reach == pytest.approx((span.high - span.low) / 2)


def test_no_rate_is_formed_from_one_experiment_to_the_next():
    assert span_of([np.zeros(5), np.full(5, 9.0)], [0.1, 0.1]).fastest == 0


def test_bounds_are_added():
    trials = Trials({"a": 1.0}, bounds={"a": (0.0, 1.0)})
    more = trials.with_bounds({"b": (None, 2.0), "a": (0.0, 3.0)})
    assert more.bounds == {"a": (0.0, 3.0), "b": (None, 2.0)}
    assert trials.bounds == {"a": (0.0, 1.0)}


# ---- users' own


def own(**changes):
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


def test_a_registered_effect_takes_part_until_it_is_taken_out():
    before = catalogue()
    mine = own()
    with registered(mine, own(variant="twin")):
        assert catalogue()[: len(before)] == before
        assert catalogue()[len(before)] is mine
        assert len(catalogue()) == len(before) + 2
    assert catalogue() == before


def test_an_error_within_takes_it_out_as_well():
    before = catalogue()
    with pytest.raises(ZeroDivisionError), registered(own()):
        raise ZeroDivisionError
    assert catalogue() == before


def test_of_several_of_which_one_is_refused_none_stays():
    before = catalogue()
    with pytest.raises(ParameterError), registered(own(), own()):
        pass
    assert catalogue() == before


def test_register_gives_the_effect_back(monkeypatch):
    monkeypatch.setattr(import_module("tsmblocks.effects.catalogue"), "_OWN", [])
    mine = own()
    assert register(mine) is mine
    assert catalogue()[-1] is mine


def test_an_effect_of_a_block_defined_anew_replaces_the_one_before(monkeypatch):
    """As when a notebook's cell is run again."""
    monkeypatch.setattr(import_module("tsmblocks.effects.catalogue"), "_OWN", [])
    cell = """
@tsm.block
class RunAgain(tsm.Block):
    gain: float = tsm.parameter(default=1.0, about="gain")
    u = tsm.Input("in")
    y = tsm.Output("out")
    def outputs(self, t, x, u):
        return dict(y=self.gain * u.u)
"""
    try:
        for _ in range(2):
            exec(cell, scope := {"tsm": tsm, "__name__": "cell"})
            register(own(name="run_again", block=scope["RunAgain"]()))
        with pytest.raises(ParameterError, match="there is an effect 'run_again' at the place 'output' already"):
            register(own(name="run_again", block=scope["RunAgain"]()))
        assert [type(e.block) for e in catalogue() if e.name == "run_again"] == [scope["RunAgain"]]
    finally:
        REGISTRY.pop("RunAgain")


def test_an_effect_may_be_a_diagram():
    inner = Diagram(blocks={"k": Bias(bias=0.0)}, inputs={"u": "k"}, outputs={"y": "k"})
    effect = own(block=inner, null={"k.bias": 0.0}, free=("k.bias",))
    assert effect.block is inner


@pytest.mark.parametrize("row", [r for r in TABLE if r.make.__module__ == diagnosing.__name__], ids=str)
def test_what_is_refused(row):
    with pytest.raises(row.error) as caught:
        row.make()
    assert said(caught.value) == row.text


@pytest.mark.parametrize(
    ("name", "unit", "words"),
    [
        ("position_ripple", "kN", "a ripple over the value of the signal"),
        ("position_ripple", "mm", "a ripple over the position (eccentricity)"),
        ("position_ripple", "", "a ripple over the position (eccentricity)"),
        ("load_offset", "deg", "an offset of the command"),
        ("load_offset", "V", "an offset of the load"),
        ("backlash", "kN", "a backlash gap"),
    ],
)
def test_words_fit_the_quantity_of_the_signal(name, unit, words):
    assert next(e for e in catalogue() if e.name == name).words_on(unit) == words


def test_words_of_an_effect_in_front_of_the_model_say_so_for_every_quantity():
    one = next(e for e in catalogue() if (e.name, e.variant) == ("position_ripple", "input"))
    assert one.words_on("kN") == "a ripple over the value of the signal, in front of the model"
