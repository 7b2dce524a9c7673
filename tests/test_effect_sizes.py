"""Sizes of effects: what a person would measure of them, with intervals that hold beside a Monte Carlo."""

import json
import math
from types import SimpleNamespace

import attrs
import numpy as np
import pytest

import tsmblocks as tsm
from tests.diagnoses import BACKLASH, NAMED
from tests.test_commands import PLANT
from tsmblocks.blocks import Play, Resonance, Ripple, Stretch
from tsmblocks.common.errors import ParameterError
from tsmblocks.diagnosis.candidates import Candidate
from tsmblocks.diagnosis.insertion_point import InsertionPoint
from tsmblocks.diagnosis.presentation import main_sizes
from tsmblocks.diagnosis.quantities import Estimate, detectable_size
from tsmblocks.diagnosis.verdict_text import verdict_sentence
from tsmblocks.effects import Scales, Size, Span, catalogue, registered
from tsmblocks.effects.effect import parameters_of, sizes_of
from tsmblocks.fitting.parameter_vector import Unknown

SCALES = Scales(
    Span(-1.0, 1.2, 0.6, 2.0, 5.0), Span(-0.8, 0.9, 0.5, 1.5, 4.0, 2 * math.pi), 0.0, 20.0, 0.01, 20.0, (3.0,), True
)
DRAWS = 20_000


def effect(name, variant=""):
    return next(e for e in catalogue() if (e.name, e.variant) == (name, variant))


def sizes(of, **parameters):
    return {k: value for k, (value, _) in sizes_of(of, {**parameters_of(of.block), **parameters}, SCALES).items()}


def candidate(of, diagram=None, block="added"):
    """The candidate of an effect behind a gain."""
    made = diagram or tsm.Diagram(
        title="gain", blocks={"gain": tsm.blocks.Gain()}, inputs={"u": "gain"}, outputs={"y": "gain"}
    )
    point = InsertionPoint("output", "y", "gain.y", other="u" if "x" in of.block.inports else "", after="gain.y")
    trials = of.trials(SCALES)
    edited = point.put(made, block, of.block)
    numbers = {**trials.fixed, **trials.shapes[0]}
    edited = edited.with_parameters({f"{block}.{k}": v for k, v in numbers.items()})
    return Candidate(of, point, block, edited, trials, SCALES)


@pytest.mark.parametrize("one", catalogue(), ids=lambda e: f"{e.name} {e.variant}".strip())
def test_every_effect_has_a_size_that_is_a_number_at_its_trial_values(one):
    local = one.trials(SCALES) or one.trials(attrs.evolve(SCALES, one_clock=False))
    values = {**parameters_of(one.block), **local.fixed, **local.shapes[0], **local.strengths}
    found = sizes_of(one, values, SCALES, ("rad", "m"))
    assert found
    zero = ("middle", "damping over stiffness")  # the trial values of these
    assert all(math.isfinite(value) and (value != 0 or name in zero) for name, (value, _) in found.items())
    assert not any("{" in unit for _, unit in found.values())


def test_the_size_of_a_ripple_is_what_one_reads_off_its_curve():
    block = Ripple(cosine=0.3, sine=-0.4, cycles=6.0)
    u = np.linspace(0.0, 4.0, 200_001)
    added = 0.3 * np.cos(6 * u) - 0.4 * np.sin(6 * u)
    found = sizes(effect("position_ripple"), **block.parameters)
    assert found["amplitude"] == pytest.approx(added.max(), rel=1e-6)
    crests = u[1:-1][(added[1:-1] > added[:-2]) & (added[1:-1] > added[2:])]
    assert found["period"] == pytest.approx(np.diff(crests).mean(), rel=1e-4)
    away = (crests[0] - found["position of a crest"]) / found["period"]
    assert away == pytest.approx(round(away), abs=1e-3)


def test_widths_are_those_of_the_whole_gap_and_the_whole_loop():
    t = np.linspace(0.0, 20.0, 20_001)
    u = 2 * np.sin(2 * np.pi * 0.1 * t)
    for name, block in (("backlash", Play(half_width=0.2)), ("hysteresis", Stretch(half_width=0.2, distance=0.05))):
        diagram = tsm.Diagram(title="loop", blocks={"b": block}, inputs={"u": "b.u"}, outputs={"y": "b"})
        run = tsm.simulate(diagram, inputs={"u": (t, u)}, stop=20.0, step=1e-3)
        late = run.t >= 10.0
        up, moved = np.gradient(u)[late] > 0, run["y"][late]
        at_zero = [np.interp(0.0, *sides) for sides in ((u[late][up], moved[up]), (-u[late][~up], moved[~up]))]
        (width, *_) = sizes(effect(name), **block.parameters).values()
        assert width == pytest.approx(at_zero[1] - at_zero[0], rel=0.02)


def test_a_resonance_is_given_by_frequency_and_damping_and_a_lag_in_milliseconds():
    found = sizes(effect("resonance"), **Resonance(share=0.25, omega=2 * math.pi * 7.5, zeta=0.08).parameters)
    assert found == pytest.approx({"natural frequency": 7.5, "damping ratio": 0.08, "share of the signal": 25.0})
    assert sizes(effect("dead_time"), time=0.012) == pytest.approx({"delay": 12.0})
    assert sizes(effect("first_order_lag"), time_constant=0.05) == pytest.approx({"time constant": 50.0})
    drift = sizes(effect("drift"), rate=0.001, curve=1e-5)
    assert drift == pytest.approx({"total drift": 0.001 * 20 + 1e-5 * 400, "initial drift rate": 0.06})


def test_units_are_those_of_the_signals():
    size = Size("stiffness", lambda p, _: 0.0, "{u}/{x}")
    assert size.unit_for("V", "rad") == "V/rad"
    assert size.unit_for("", "rad") == "1/rad"
    assert size.unit_for("rad", "rad") == ""
    assert size.unit_for("cm", "") == "cm"
    assert size.unit_for("mm", "m/s^2") == "mm/(m/s^2)"
    assert attrs.evolve(size, unit="{u}/s").unit_for("rad/s", "") == "rad/s^2"
    assert attrs.evolve(size, unit="{x}*s").unit_for("V", "rad/s") == "rad"
    assert attrs.evolve(size, unit="ms").unit_for("rad", "rad") == "ms"


def test_faults_in_sizes_are_refused():
    with pytest.raises(ParameterError, match="a size needs a name in words, got ''"):
        Size("", lambda p, _: 0.0)
    with pytest.raises(ParameterError, match="size 'gap': value must be a function, got 2"):
        Size("gap", 2)
    with pytest.raises(ParameterError, match="sizes must be Size objects, got 'gap'"):
        attrs.evolve(effect("backlash"), sizes=("gap",))
    with pytest.raises(ParameterError, match="size 'gap': unit must be text, got None"):
        Size("gap", lambda p, _: 0.0, None)
    twice = [Size("gap", lambda p, _, k=k: k) for k in (1.0, 2.0)]
    with pytest.raises(ParameterError, match="effect 'backlash': two of its sizes are named 'gap'"):
        attrs.evolve(effect("backlash"), sizes=twice)


@pytest.mark.parametrize(
    ("function", "why"),
    [
        (lambda p, _: p["width"], "KeyError: 'width'"),
        (lambda p, _: "wide", "ValueError: could not convert string to float: 'wide'"),
        (lambda p, scales: scales.reach, "AttributeError: 'Scales' object has no attribute 'reach'"),
    ],
)
def test_a_function_of_a_size_that_fails_is_named_before_the_search(function, why):
    t = np.arange(0, 5, 0.02)
    data = tsm.Record("run", t, {"x_in": np.sin(2 * t), "x_out": np.sin(2 * t)}, {"x_in": "rad", "x_out": "rad"})
    wide = attrs.evolve(effect("backlash"), name="wide", sizes=(Size("gap", function),))
    with registered(wide), pytest.raises(ParameterError) as caught:
        tsm.diagnose(tsm.load("tendon_sheath_linear"), data, effects=["wide"])
    assert str(caught.value) == f"effect 'wide': the function of its size 'gap' fails. {why}"


def test_a_size_that_is_divided_by_zero_is_left_out():
    made = attrs.evolve(effect("backlash"), sizes=(Size("ratio", lambda p, _: 1 / (0 * p["half_width"])),))
    assert sizes(made, half_width=0.1) == {}


def estimate(names, theta, covariance, experiments=()):
    items = tuple(Unknown(name, 0.0, -1.0, 1.0, "rad", "", experiment) for name, experiment in names)
    values = {name: value for (name, _), value in zip(names, theta, strict=True)}
    problem = SimpleNamespace(unknowns=SimpleNamespace(items=items))
    model = SimpleNamespace(theta=np.array(theta), problem=problem, values=values)
    return Estimate(model, np.array(covariance), np.full(len(theta), np.inf))


def test_intervals_of_sizes_are_those_of_a_monte_carlo():
    """The delta method against 20 000 draws of the parameters, which are strongly correlated."""
    theta = np.array([0.0063, 0.0084, 8.0, 1.0])
    deviations = np.array([1e-4, 1.5e-4, 0.02, 0.1])
    correlation = np.array([[1, -0.6, 0.3, 0], [-0.6, 1, 0.5, 0], [0.3, 0.5, 1, 0], [0, 0, 0, 1.0]])
    covariance = correlation * np.outer(deviations, deviations)
    names = [(f"added.{k}", "") for k in ("cosine", "sine", "cycles")] + [("gain.gain", "")]
    found = estimate(names, theta, covariance).sizes(candidate(effect("position_ripple")))
    a, b, n, _ = np.random.default_rng(5).multivariate_normal(theta, covariance, DRAWS).T
    drawn = {"amplitude": np.hypot(a, b), "period": 2 * np.pi / n, "position of a crest": np.arctan2(b, a) / n}
    assert list(found) == list(drawn)
    for name, values in drawn.items():
        low, high = np.quantile(values, [0.025, 0.975])
        assert (found[name].high - found[name].low) == pytest.approx(high - low, rel=0.03)
        assert found[name].low == pytest.approx(low, abs=0.05 * (high - low))
    fixed = covariance.copy()
    fixed[2] = fixed[:, 2] = 0.0  # held at a value
    narrower = estimate(names, theta, fixed).sizes(candidate(effect("position_ripple")))
    assert narrower["period"].low == narrower["period"].value == pytest.approx(2 * np.pi / 8)


def test_sizes_of_parameters_of_each_experiment_are_given_for_each():
    names = [("added.frequency", ""), *((f"added.{k}", e) for e in ("a", "b") for k in ("cosine", "sine"))]
    one = effect("periodic_disturbance", "output, separate sizes")
    made = candidate(attrs.evolve(one, trials=effect("periodic_disturbance", "output").trials))
    found = estimate(names, [3.0, 0.3, 0.4, 0.0, 0.2], np.diag([1e-4] * 5)).sizes(made)
    assert {k: q.value for k, q in found.items()} == pytest.approx(
        {"frequency": 3.0, "amplitude@a": 0.5, "amplitude@b": 0.2}
    )
    assert found["amplitude@b"].high - 0.2 == pytest.approx(1.96 * 0.01, rel=1e-3)


def test_detection_limits_are_sizes_where_these_are_in_proportion():
    assert detectable_size(candidate(effect("position_ripple")), "cosine", 0.01, {}) == ("amplitude", 0.01, "")
    assert detectable_size(candidate(effect("backlash")), "half_width", 0.01, {}) == ("gap width", 0.02, "")
    assert detectable_size(candidate(effect("resonance")), "share", 0.1, {})[0] == "share of the signal"
    name, value, _ = detectable_size(candidate(effect("saturation", "output")), "low", 0.9, {})
    assert (name, value) == ("lower limit", -0.9)


def test_a_size_that_depends_on_the_shape_is_that_of_the_shape_with_the_limit():
    memory = candidate(effect("nonlocal_memory", "output"))
    shape = memory.trials.shapes[0]
    name, value, _ = detectable_size(memory, "weights[0]", 0.2, shape)
    assert name == "loop width"
    assert value == pytest.approx(2 * 0.2 * shape["radii[0]"])
    bow = candidate(effect("odd_nonlinearity", "middle and ends"))  # its slope depends on the width as well
    slopes = [detectable_size(bow, "size", 0.1, shape) for shape in bow.trials.shapes]
    assert {name for name, _, _ in slopes} == {"slope added in the middle"}
    assert len({value for _, value, _ in slopes}) > 1


JUMPS = (("jump", "r1", 0.6), ("jump", "r2", 0.01), ("time", "r1", 2.91), ("time", "r2", 11.6))


def test_texts_and_files_report_the_size_and_not_a_coefficient():
    text = verdict_sentence(NAMED)
    assert "gap width 1.000 ± 0.040 deg" in text
    assert "half_width" not in text
    assert main_sizes(attrs.evolve(BACKLASH, sizes={}), NAMED) == ["half_width 0.500 ± 0.020 deg"]
    own = {f"amplitude@{k}": attrs.evolve(BACKLASH.sizes["gap width"], value=v) for k, v in (("a", 0.01), ("b", -0.2))}
    (words,) = main_sizes(attrs.evolve(BACKLASH, sizes=own), NAMED)
    assert words.startswith("amplitude -11.459 ±")
    assert words.endswith("in b, where it is largest")


def test_sizes_of_one_recording_are_reported_together():
    """The jump is in r1; the time of what is no jump in r2 is later."""
    gap = BACKLASH.sizes["gap width"]
    sizes = {f"{name}@{k}": attrs.evolve(gap, value=v) for name, k, v in JUMPS}
    said = main_sizes(attrs.evolve(BACKLASH, sizes=sizes), NAMED)
    assert said[0].startswith("jump 34.377 ±")
    assert said[1].startswith("time 166.731 ±")
    assert ", ".join(said).count("in r1, where it is largest") == 1


def test_the_file_has_sizes_beside_the_parameters():
    from tests.diagnoses import diagnosis

    told = json.loads(diagnosis(NAMED).to_json())
    assert told["effects"][0]["sizes"]["gap width"]["value"] == pytest.approx(0.0174533, rel=1e-5)
    assert told["effects"][0]["parameters"]["half_width"]["unit"] == "rad"
    assert told["segments"][0]["detection_limits"]["backlash"]["size"]["name"] == "gap width"
    assert "size" not in told["segments"][0]["detection_limits"]["drift"]


def test_an_effect_is_clear_of_zero_by_one_of_its_sizes():
    names = [(f"added.{k}", "") for k in ("cosine", "sine", "cycles")]
    ripple = candidate(effect("position_ripple"))
    spread = np.diag([0.1, 0.1, 0.01]) ** 2
    assert estimate(names, [0.3, 0.4, 8.0], spread).is_clear_of_zero(ripple)
    assert not estimate(names, [0.1, 0.1, 8.0], spread).is_clear_of_zero(ripple)  # its period is, and tells nothing
    unknown = np.diag([np.inf, np.inf, 0.01])
    assert not estimate(names, [0.3, 0.4, 8.0], unknown).is_clear_of_zero(ripple)


def test_an_effect_with_an_endless_null_has_no_size_to_be_clear_of():
    names = [("added.low", ""), ("added.high", "")]
    assert estimate(names, [-0.9, 0.9], np.eye(2)).is_clear_of_zero(candidate(effect("saturation", "output")))


def test_a_limit_that_is_not_reached_is_not_reported():
    """It was the edge of the range, with an interval: 15.002 ± 0.010 % where the least command was 15 %."""
    base = tsm.loads(PLANT).with_parameters({"lag.time_constant": 0.4, "gain.gain": 1.0})
    t = 0.05 * np.arange(1600)
    u = 3.0 + np.sin(0.9 * t) + 0.7 * np.sin(2.3 * t)
    run = tsm.simulate(base, inputs={"u": (t, np.minimum(u, 3.9))}, stop=t[-1], step=0.05)
    y = run["y"] + 0.002 * np.random.default_rng(5).standard_normal(len(t))
    record = tsm.Record("a", t, {"u": u, "y": y}, {"u": "V", "y": "V"})
    (one,) = tsm.diagnose(base, record, effects=["saturation", "odd_nonlinearity"]).effects
    assert (one.name, list(one.sizes)[:2]) == ("saturation", ["cut off at the upper end", "upper limit"])
    assert "lower limit" not in one.sizes
    assert one.sizes["upper limit"].value == pytest.approx(3.9, abs=0.01)
    assert one.sizes["cut off at the upper end"].value == pytest.approx(np.max(u) - 3.9, abs=0.02)
