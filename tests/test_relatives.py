"""Blocks that are replaced by relatives: the table, the edit, and a diagnosis that names a replacement."""

import json
import math

import casadi as ca
import numpy as np
import pytest

import tsmblocks as tsm
from tsmblocks import blocks as b
from tsmblocks.diagnosis.replacements import replacement_points, replacements
from tsmblocks.diagnosis.script import literal, script_lines
from tsmblocks.effects import Relative, Scales, Span, Trials, catalogue, register, registered, relatives, replacement
from tsmblocks.effects.relatives_loops import LOOPS, loop_of
from tsmblocks.fitting.parameters import with_initial_values
from tsmblocks.model.block import leaves
from tsmblocks.model.diagram import Diagram


@tsm.block(register=False)
class Softening(tsm.Block):
    """A characteristic that a user declares."""

    source = "definition"
    slope: float = tsm.parameter(default=1.0, about="slope in the middle")
    bend: float = tsm.parameter(default=0.1, about="curvature", above=0.0)
    u = tsm.Input("any signal", unit="?u")
    y = tsm.Output("the signal, bent", unit="?u")

    def outputs(self, t, x, u):
        return dict(y=self.slope * ca.atan(self.bend * u.u) / self.bend)


T = np.arange(0.0, 12.0, 0.01)
MOTION = 0.02 * np.sin(3.0 * T) + 0.008 * np.sin(7.3 * T)
RICH = 0.8 * np.sin(1.3 * T) + 0.4 * np.sin(4.1 * T) + 0.05
SPAN = Span(-0.9, 1.1, 0.6, 1.5, 4.0)
SCALES = Scales(SPAN, SPAN, 0.0, 12.0, 0.01, 12.0)
IDS = [f"{r.of.__name__} {r.variant}" for r in relatives()]


def bench(kind):
    """A diagram with a block of this kind: friction behind a rate, any other block alone."""
    block = kind(low=-0.6, high=0.6) if kind is b.Saturation else kind()
    port = next(iter(block.inports))
    if port == "x" or kind in (b.Play, b.Saturation, b.SecondOrderLag):
        return Diagram(title="one", blocks={"part": block}, inputs={"x": f"part.{port}"}, outputs={"y": "part"})
    return Diagram(
        title="behind a rate",
        blocks={"rate": b.Derivative(), "part": block},
        wires=[f"rate -> part.{port}"],
        inputs={"x": "rate.u"},
        outputs={"y": "part"},
    )


def numbers(block):
    if isinstance(block, Diagram):
        return dict(block.parameters)
    return {leaf: value for key, given in block.parameters.items() for leaf, value in leaves(given, key)}


# ---- the table


@pytest.mark.parametrize("relative", relatives(), ids=IDS)
def test_what_is_tried_fits_the_block_and_its_bounds(relative):
    old = bench(relative.of).blocks["part"]
    effect = replacement(relative, "part", old, SCALES)
    trials = effect.trials(SCALES)
    effect.accepts(trials)
    known = numbers(effect.block)
    for shape in trials.shapes:
        assert set(shape) == set(relative.free) <= set(known)
        for name, value in shape.items():
            low, high = trials.bounds.get(name, (None, None))
            assert (-math.inf if low is None else low) <= value <= (math.inf if high is None else high)


@pytest.mark.parametrize("relative", relatives(), ids=IDS)
def test_a_relative_starts_near_the_block_that_it_replaces(relative):
    """Less than half of the variance of the block's output is lost, so that a fit begins in the right basin."""
    diagram = bench(relative.of)
    (point,) = replacement_points(diagram, "y", [relative], ())
    ((effect, _),) = replacements(diagram, [point], lambda _: SCALES)
    made = point.put(diagram, "part", effect.block)
    shape = effect.trials(SCALES).shapes[0]
    made = made.with_parameters({f"part.{k}": v for k, v in shape.items()})

    def run(which):
        return tsm.simulate(which, inputs={"x": (T, RICH)}, stop=T[-1], step=2e-4, hold="cubic")["y"]

    before, after = run(diagram), run(made)
    late = len(before) // 3
    assert np.isfinite(after).all()
    assert np.var(after[late:] - before[late:]) < 0.5 * np.var(before[late:])


@pytest.mark.parametrize("relative", relatives(), ids=IDS)
def test_an_expression_of_a_script_replaces_as_the_search_does(relative):
    diagram = bench(relative.of)
    (point,) = replacement_points(diagram, "y", [relative], ())
    effect = replacement(relative, "part", diagram.blocks["part"], SCALES)
    text = point.code("part", effect.block).replace("…", literal(effect.block), 1)
    names = {"tsm": tsm, "diagram": diagram, **{k: getattr(b, k) for k in dir(b)}}
    assert eval(text, names) == point.put(diagram, "part", effect.block)


def test_names_are_those_of_the_catalogue():
    assert {r.name for r in relatives()} <= {e.name for e in catalogue()}


def test_relatives_of_one_block_have_words_of_their_own():
    words = [(r.of, r.words) for r in relatives()]
    assert len(set(words)) == len(words)


@pytest.mark.parametrize("kind", LOOPS)
def test_the_width_of_a_loop_is_that_of_its_simulation(kind):
    """At zero input the branches are apart by twice the half width, times the slope."""
    block = kind()
    loop, x = loop_of(block), 1.0 * np.sin(2 * np.pi * T / 4.0)
    run = tsm.simulate(bench(kind), inputs={"x": (T, x)}, stop=T[-1], step=1e-3, hold="cubic")
    t, y = run.t, run["y"]
    up, down = (float(np.interp(at, t, y)) for at in (8.0, 10.0))
    assert abs(up - down) / 2 == pytest.approx(loop.half_width * loop.gain, rel=0.25)


# ---- where it may stand


def test_a_rate_that_something_else_reads_stays():
    relative = next(r for r in relatives() if r.of is b.CoulombFriction and r.instead_of_rate)
    alone = bench(b.CoulombFriction)
    assert replacement_points(alone, "y", [relative], ())
    shared = alone.rewire(blocks={**alone.blocks, "more": b.Gain()}, add=["rate -> more"])
    assert not replacement_points(shared, "y", [relative], ())
    shown = alone.rewire(outputs={"y": "part", "v": "rate"})
    assert not replacement_points(shown, "y", [relative], ())


def test_blocks_that_were_named_are_not_replaced():
    assert replacement_points(bench(b.Play), "y", relatives(), ())
    assert not replacement_points(bench(b.Play), "y", relatives(), ("part",))


def test_a_value_used_twice_is_read():
    diagram = bench(b.CoulombFriction).rewire(values={"level": 0.7})
    diagram = diagram.replace("part", b.CoulombFriction(level="$level"))
    relative = next(r for r in relatives() if r.of is b.CoulombFriction and r.variant == "Dahl")
    (point,) = replacement_points(diagram, "y", [relative], ())
    ((effect, _),) = replacements(diagram, [point], lambda _: SCALES)
    assert effect.block.coulomb == 0.7


# ---- a diagnosis


def damper(block):
    return Diagram(
        title="damper",
        blocks={"rate": b.Derivative(), "friction": block, "offset": b.Bias(bias=0.0)},
        wires=["rate -> friction -> offset"],
        inputs={"x": tsm.Inlet("rate.u", "m") if hasattr(tsm, "Inlet") else "rate.u"},
        outputs={"F": "offset"},
    )


@pytest.fixture(scope="module")
def presliding():
    """Dahl friction under a model of Coulomb friction: what looks like a delay is a distance."""
    truth = damper(b.DahlFriction(sigma0=2000.0, coulomb=8.0))
    y = tsm.simulate(truth, inputs={"x": (T, MOTION)}, stop=T[-1], step=1e-3, hold="cubic", log="outputs")
    y = np.interp(T, y.t, y["F"]) + np.random.default_rng(1).normal(0.0, 0.05, T.size)
    record = tsm.Record("run", T, {"x": MOTION, "F": y}, {"x": "m", "F": ""})
    base = damper(b.CoulombFriction(level=5.0, smoothing=0.005))
    some = ["dead_time", "first_order_lag", "presliding_friction", "stribeck_friction"]
    return base, record, tsm.diagnose(base, record, noise_floor=0.05, effects=some)


def test_presliding_is_named_where_a_delay_would_explain_less(presliding):
    found = presliding[2]
    (effect,) = found.effects
    assert (effect.name, effect.family, effect.block) == ("presliding_friction", "friction", "friction")
    assert effect.words == "Coulomb friction replaced by Dahl friction (presliding)"
    assert effect.wire == "rate.y -> friction.v"
    assert effect.parameters["sigma0"].low < 2000 < effect.parameters["sigma0"].high
    assert effect.parameters["coulomb"].low < 8 < effect.parameters["coulomb"].high
    assert "dead_time" not in effect.also_possible
    assert found.segments[0].gaps[0].held_out[-1] == pytest.approx(0.05, rel=0.05)


def test_the_augmented_diagram_holds_the_relative(presliding, tmp_path):
    base, record, found = presliding
    assert isinstance(found.augmented.blocks["friction"], b.DahlFriction)
    assert set(found.augmented.blocks) == set(base.blocks)
    folder = found.save(tmp_path / "out")
    assert tsm.load(folder / "augmented.toml") == found.augmented
    told = json.loads((folder / "diagnosis.json").read_text(encoding="utf-8"))
    assert told["effects"][0]["name"] == "presliding_friction"
    assert "replaced by Dahl friction" in (folder / "report.html").read_text(encoding="utf-8")
    assert "replaced by Dahl friction" in " ".join(str(found).split())
    names = {"recordings": {"run": record}, "diagram": base}
    lines = script_lines(found)
    last = next(k for k, line in enumerate(lines) if line.startswith("# recordings"))
    exec("\n".join(lines[:last]), names)
    assert names["diagram"].blocks["friction"] == found.augmented.blocks["friction"]


def test_a_relative_of_a_user_takes_part():
    """A gain that is a soft saturation in truth, for which the user has a law of one parameter."""
    own = Relative(
        of=b.Gain,
        name="softening",
        family="map",
        words="a gain replaced by an arctan characteristic",
        block=lambda old, scales: Softening(slope=old.gain, bend=0.1 / scales.other.reach),
        trials=lambda old, scales: Trials({}, ({"slope": old.gain, "bend": 0.5 / scales.other.reach},)),
        free=("slope", "bend"),
    )
    y = 1.3 * np.arctan(0.8 * RICH) / 0.8 + np.random.default_rng(2).normal(0.0, 0.01, T.size)
    record = tsm.Record("run", T, {"x_in": RICH, "x_out": y}, {"x_in": "rad", "x_out": "rad"})
    before = relatives()
    with registered(own):
        assert relatives()[-1] is own
        with pytest.raises(tsm.errors.ParameterError, match="there is a relative 'softening' of Gain already"):
            register(own)
        some = ["softening", "backlash"]
        found = tsm.diagnose(tsm.load("tendon_sheath_linear"), record, noise_floor=0.01, effects=some)
    assert relatives() == before
    (effect,) = found.effects
    assert (effect.name, effect.block, effect.wire) == ("softening", "gain", "x_in -> gain.u")
    assert effect.parameters["bend"].low < 0.8 < effect.parameters["bend"].high


def test_what_a_relative_must_have():
    with pytest.raises(tsm.errors.ParameterError, match="of must be a class of blocks"):
        Relative(of="Gain", name="one", family="map", words="", block=len, trials=len, free=("a",))
    with pytest.raises(tsm.errors.ParameterError, match="none of its parameters is fitted"):
        Relative(of=b.Gain, name="one", family="map", words="", block=len, trials=len, free=())


# ---- linear order


def test_a_second_mode_is_named_and_its_ringing_at_the_start_is_fitted():
    """Both modes ring when the recording begins: the initial states of a transfer function are free as all others."""
    rng = np.random.default_rng(3)
    t = np.arange(0.0, 8.0, 0.01)
    u = np.interp(t, t[::3], rng.normal(0.0, 1.0, t[::3].size))
    one, two = (b.TransferFunction(num=(w * w,), den=(1.0, 2 * z * w, w * w)) for w, z in ((36.0, 0.005), (80.0, 0.01)))
    plant = Diagram(
        title="two modes",
        blocks={"one": one, "two": two, "both": b.Sum(signs="++")},
        wires=["one -> both.plus1", "two -> both.plus2"],
        inputs={"u": ["one.u", "two.u"]},
        outputs={"a": "both"},
    )
    starts = {"one.x0": (0.002, 0.0), "two.x0": (0.0, 0.0)}
    plant = with_initial_values(plant)
    plant = plant.with_parameters({f"one.x0[{k}]": v for k, v in enumerate(starts["one.x0"])})
    run = tsm.simulate(plant, inputs={"u": (t, u)}, stop=t[-1], step=1e-3, hold="cubic", log="outputs")
    a = np.interp(t, run.t, run["a"]) + rng.normal(0.0, 0.02, t.size)
    record = tsm.Record("run", t, {"u": u, "a": a}, {"u": "", "a": ""})
    base = Diagram(
        title="one mode",
        blocks={"arm": b.TransferFunction(num=(0.1, 0.0, 5000.0), den=(1.0, 1.0, 6300.0))},
        inputs={"u": "arm.u"},
        outputs={"a": "arm"},
    )
    found = tsm.diagnose(base, record, noise_floor=0.02, effects=["resonance", "dead_time"], condition=False)
    (effect,) = found.effects
    assert effect.name == "resonance"
    assert "higher order" in effect.words
    assert found.segments[0].gaps[0].held_out[-1] < 0.025
    assert {"arm.x0[0]", "arm.x0[1]"} <= set(found.start_states["run"])
    assert found.diagrams["run"].parameters["arm.x0[0]"] == found.start_states["run"]["arm.x0[0]"]
