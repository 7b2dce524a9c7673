"""Detection limits make sense, and where there is none the reason is given."""

import json

import attrs
import numpy as np
import pytest

import tsmblocks as tsm
from tests.diagnoses import LIMITS, diagnosis
from tests.test_effect_sizes import SCALES, candidate, effect
from tsmblocks.blocks import Gain, Integrator, Sum
from tsmblocks.diagnosis.detectable_sizes import limit_text
from tsmblocks.diagnosis.limits import CAUSES, _is_beyond
from tsmblocks.diagnosis.plain_values import limit_quantity
from tsmblocks.diagnosis.screening_score import ScreeningScore, ShapeSensitivity
from tsmblocks.html.report import page

T = np.arange(0.0, 20.0, 0.05)
F = 60.0 * np.sin(1.3 * T) + 20.0 * np.sin(4.1 * T)
VALVE = tsm.Diagram(
    title="spring",
    blocks={
        "force": Sum(signs="+--"),
        "rate": Gain(gain=0.1, unit="mm/s"),
        "travel": Integrator(),
        "spring": Gain(gain=40.0, unit="N"),
        "preload": tsm.blocks.Constant(value=10.0, unit="N"),
    },
    wires=["force -> rate -> travel -> spring -> force.minus1", "preload -> force.minus2"],
    inputs={"F": tsm.Inlet("force.plus", unit="N")},
    outputs={"x": "travel"},
    output_units={"x": "mm"},
)


@pytest.fixture(scope="module")
def found():
    """A valve stem against a spring, whose preload is free."""
    x = tsm.simulate(VALVE, inputs={"F": (T, F)}, stop=T[-1], step=0.05)["x"]
    x = x + np.random.default_rng(0).normal(0.0, 0.01, len(T))
    record = tsm.Record("run", T, {"F": F, "x": x}, {"F": "N", "x": "mm"})
    effects = ["offset", "gain_error", "coulomb_friction", "dead_time", "saturation", "rate_limit", "dead_zone"]
    free = ["preload.value", "spring.gain"]
    return tsm.diagnose(VALVE, record, free=free, effects=effects, noise_floor="0.01mm")


def test_the_parameter_that_absorbs_an_offset_is_named_with_its_change(found):
    (segment,) = found.segments
    offset = next(m for m in segment.limits if m.name == "offset")
    assert (offset.value, offset.cause) == (None, "absorbed")
    assert dict(offset.absorbed_by) == {"preload.value": "40 N per mm"}  # the stiffness of the spring
    assert "offset (acts as preload.value, 40 N per mm)" in " ".join(str(found).split())


def test_each_reason_is_the_same_in_text_page_and_file(found):
    (segment,) = found.segments
    said, shown = " ".join(str(found).split()), " ".join(page(found).split())
    saved = json.loads(found.to_json())["segments"][0]
    without = {m.name: m for m in segment.limits if m.value is None}
    assert {m.cause for m in without.values()} >= {"absorbed", "no insertion point"}
    assert list(saved["not_detectable"]) == [*without]
    for name, m in without.items():
        assert saved["detection_limits"][name] is None
        assert saved["not_detectable"][name] == {"cause": m.cause, "absorbed_by": dict(m.absorbed_by)}
        assert f"- {CAUSES[m.cause]}: " in said
        assert limit_text(m) in shown


def test_limits_are_within_the_range_of_their_signals(found):
    sizes = {m.name: limit_quantity(m) for m in found.segments[0].limits if m.value is not None}
    (name, value, unit), x = sizes["saturation"], found.segments[0].traces[0].measured
    assert name in ("lower limit", "upper limit")
    assert unit == "mm"
    assert x.min() < value < x.max()
    assert all(value and "_" not in name and not name[-1].isdigit() for name, value, _ in sizes.values())


def test_a_limit_is_that_of_the_simplest_form_where_it_is_seen_best():
    """A drift behind the spring is seen at once; one in front of it is hardly, since the spring holds against it."""
    x = tsm.simulate(VALVE, inputs={"F": (T, F)}, stop=T[-1], step=0.05)["x"]
    x = x + np.random.default_rng(0).normal(0.0, 0.01, len(T))
    record = tsm.Record("run", T, {"F": F, "x": x}, {"F": "N", "x": "mm"})
    settings = dict(free=["spring.gain"], effects=["drift"], noise_floor="0.01mm")
    limits = tsm.diagnose(VALVE, record, **settings).segments[0].limits
    (drift,) = limits
    assert (drift.size_name, drift.size_unit, drift.wire) == ("total drift", "mm", "travel.y -> x")
    later = tsm.Record("run", T, {"F": F, "x": x + 1.5 * drift.size * T / T[-1]}, {"F": "N", "x": "mm"})
    assert [one.name for one in tsm.diagnose(VALVE, later, **settings).effects] == ["drift"]


def test_a_reason_without_a_name_of_a_parameter():
    assert "- not excited by these experiments: coulomb_friction" in diagnosis().details()
    assert limit_text(LIMITS[2]) == "not excited by these experiments"


# ---- what makes no sense


@pytest.mark.parametrize(
    ("name", "variant", "size", "most"),
    [
        ("dead_zone", "low end", "slope lost", 100.0),
        ("backlash", "", "gap width", 3 * 2.2),  # the signal ranges from -1 to 1.2
        ("rate_limit", "output", "fastest rise", 5.0),
        ("dead_time", "", "delay", 20_000.0),  # ms
    ],
)
def test_a_size_far_beyond_its_signal_is_no_limit(name, variant, size, most):
    one = candidate(effect(name, variant))
    parameter = one.effect.free[0]
    assert not _is_beyond(one, parameter, size, 0.99 * most)
    assert _is_beyond(one, parameter, size, 1.01 * most)


def test_a_peak_of_a_transient_is_not_the_range_of_a_signal():
    one = candidate(effect("rate_limit", "output"))
    calm = attrs.evolve(one, scales=attrs.evolve(SCALES, wire=attrs.evolve(SCALES.wire, speed=0.1)))
    assert _is_beyond(calm, "rising", "fastest rise", 1.1)
    assert not _is_beyond(calm, "rising", "fastest rise", 0.9)


def score(one, *shapes):
    return ScreeningScore(one, None, None, 0.0, (), np.zeros(0), tuple(ShapeSensitivity(*s) for s in shapes))


def test_the_limit_of_a_saturation_is_the_mildest_that_shows_on_the_side_that_acts():
    one = candidate(effect("saturation", "output"))
    lower, upper = {"low": -0.9, "high": 1.3}, {"low": -1.1, "high": 1.0}
    found = score(one, (lower, 50.0, False), (upper, 20.0, False), ({"low": -1.0, "high": 1.19}, 1.0, False)).limits(4)
    assert [(x.parameter, x.value) for x in found] == [("high", 1.0), ("low", -0.9)]


def test_a_limit_of_zero_is_none():
    one = candidate(effect("backlash"))
    assert score(one, ({"half_width": 0.0}, 50.0, False)).limits(4.0) == []
    (found,) = score(one, ({"half_width": 0.4}, 16.0, False)).limits(4.0)
    assert (found.parameter, found.value) == ("half_width", pytest.approx(0.2))
