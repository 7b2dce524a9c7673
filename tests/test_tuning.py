"""Tuning against optima known by hand, slopes against differences, and what cannot be tuned."""
# ruff: noqa: E501 - the text of a message stands on one line, as the user reads it

import re

import numpy as np
import pytest
from hypothesis import example, given, settings
from hypothesis import strategies as st

import tsmblocks as tsm
from tsmblocks.blocks import (
    PID,
    Constant,
    DeadTime,
    DiscretePID,
    FirstOrderLag,
    Gain,
    Integrator,
    MultiSine,
    Play,
    Saturation,
    Sine,
    Step,
    Sum,
    TransferFunction,
    UnitDelay,
)
from tsmblocks.common.errors import ParameterError, RunError
from tsmblocks.metrics.metrics import metric
from tsmblocks.simulation.arguments import RunOptions
from tsmblocks.studies import table
from tsmblocks.tuning import tune
from tsmblocks.tuning.constraints import POINTS, limit
from tsmblocks.tuning.smooth_metrics import SMOOTH_REDUCTIONS, differentiable

SLOW_NEEDS = ["tuning", "analysis", "blocks"]

T = np.linspace(0.0, 10.0, 2001)
TEXTS = [
    "rms(a - b)",
    "peak_to_peak(a - b, after=2)",
    "largest(a)",
    "highest(a * b)",
    "lowest(a)",
    "mean(a)",
    "final(b)",
    "integral(a, before=7)",
    "variation(a)",
    "share(abs(a) > 0.4)",
    "overshoot(a + 0.1, 0.5)",
    "settling_time(a, 0.4, before=9.5)",
    "integral(t * a * a)",
    "2 * rms(a) / highest(b) + largest(a - b)**2",
]


def scaled(**more):
    """y = gain * slope * t, or what it is driven by."""
    blocks = {"one": Constant(value=1.0), "plant": Gain(gain=1.0), "gain": Gain(gain=1.0), **more}
    return tsm.Diagram(title="scaled", blocks=blocks, wires=["one -> plant -> gain"], outputs={"y": "gain"})


def loop():
    blocks = {
        "r": Step(time=0.0),
        "e": Sum(signs="+-"),
        "pid": PID(kp=1.0, ki=0.5, kd=0.0),
        "g": FirstOrderLag(time_constant=0.5),
        "h": FirstOrderLag(time_constant=0.2),
    }
    return tsm.Diagram(
        title="loop",
        blocks=blocks,
        wires=["r -> e.plus", "e -> pid -> g -> h", "h -> e.minus"],
        outputs={"y": "h", "u": "pid", "e": "e"},
    )


# ---- slopes


@settings(max_examples=40, deadline=None)
@given(st.sampled_from(TEXTS), st.integers(0, 1000), st.sampled_from([0.05, 0.01]))
@example(TEXTS[-1], 999, 0.05)  # where a sample passes zero
def test_slopes_are_those_of_differences(text, seed, sharp):
    rng = np.random.default_rng(seed)
    base = {k: np.sin((1 + i + rng.random()) * T) + 0.3 * np.cos(3 * T + i) for i, k in enumerate("ab")}
    ways = {k: rng.standard_normal(2) * np.column_stack([np.cos(T), np.sin(2 * T)]) for k in "ab"}
    one = differentiable(metric(text, {"a": "", "b": ""}))

    def value(p):
        return one(T, {k: base[k] + ways[k] @ p for k in "ab"}, ways, sharp)

    _, slope = value(np.zeros(2))
    for k in range(2):
        step = 1e-6 * np.eye(2)[k]
        differences = (value(step)[0] - value(-step)[0]) / 2e-6
        assert slope[:, k] == pytest.approx(differences, rel=1e-3, abs=2e-3)


def test_the_largest_of_the_pieces_is_the_metric():
    signals = {"a": np.sin(3 * T), "b": np.cos(2 * T)}
    still = {k: np.zeros((len(T), 1)) for k in "ab"}
    for text in TEXTS:
        one = metric(text, {"a": "", "b": ""})
        values = differentiable(one)(T, signals, still, 0.002)[0]
        near = 0.02 if differentiable(one).smoothed else 1e-12
        near = T[1] if text.startswith("settling_time") else near  # located between samples
        peak = values.min() if text.startswith("lowest") else values.max()
        assert peak == pytest.approx(one(T, signals), rel=near, abs=near), text


def test_what_has_slopes_is_tested_here():
    assert {name for name in SMOOTH_REDUCTIONS if any(f"{name}(" in text for text in TEXTS)} == set(SMOOTH_REDUCTIONS)


# ---- optima known by hand


def test_a_target_is_met():
    found = tune(scaled(), {"gain.gain": (0.1, 5.0)}, "largest(y - 0.7)", stop=0.1, step=0.01)
    assert found.values["gain.gain"] == pytest.approx(0.7, abs=1e-4)
    assert found.worst == pytest.approx((0.3, 0.0), abs=1e-4)
    assert found.diagram.parameters["gain.gain"] == found.values["gain.gain"]


def test_a_limit_holds_where_it_binds():
    found = tune(
        scaled(), {"gain.gain": (0.1, 5.0)}, "rms(y - 2)", subject_to=["highest(y) <= 1.5"], stop=0.1, step=0.01
    )
    assert found.met
    assert found.values["gain.gain"] == pytest.approx(1.5, rel=2e-3)
    assert found.values["gain.gain"] <= 1.5


def test_the_worst_of_several_plants_counts():
    """min over g of max(|g - 1|, |3 g - 1|) is at g = 1/2."""
    plants = table({"plant.gain": [1.0, 3.0]})
    found = tune(scaled(), {"gain.gain": (0.01, 5.0)}, "largest(y - 1)", plants=plants, stop=0.1, step=0.01)
    assert found.values["gain.gain"] == pytest.approx(0.5, rel=1e-3)
    assert list(found.after) == ["scaled, plant 0", "scaled, plant 1"]
    assert found.worst[1] == pytest.approx(0.5, rel=1e-3)


def test_several_diagrams_are_cases():
    both = {"small": scaled(), "large": scaled(one=Constant(value=3.0))}
    found = tune(both, {"gain.gain": (0.01, 5.0)}, "largest(y - 1)", stop=0.1, step=0.01)
    assert found.values["gain.gain"] == pytest.approx(0.5, rel=1e-3)
    assert set(found.diagrams) == {"small", "large"}


def test_a_sine_is_followed_by_the_inverse_of_its_path():
    """Gain and lead of a first-order path: y = g (a + b s) / (1 + T s) r is r where g a = 1, g b = T."""
    blocks = {
        "r": Sine(amplitude=1.0, frequency=0.5),
        "lead": PID(kp=1.0, ki=0.0, kd=0.1, tau=1e-3),
        "path": FirstOrderLag(time_constant=0.3),
        "e": Sum(signs="+-"),
    }
    diagram = tsm.Diagram(
        title="lead", blocks=blocks, wires=["r -> lead -> path -> e.minus", "r -> e.plus"], outputs={"e": "e"}
    )
    found = tune(
        diagram, {"lead.kp": (0.1, 3.0), "lead.kd": (0.0, 1.0)}, "peak_to_peak(e, after=4)", stop=6.0, step=1e-3
    )
    assert found.worst[1] < 0.01
    assert found.values["lead.kd"] == pytest.approx(0.3, rel=0.02)


def test_overshoot_is_kept_below_its_limit():
    free = {"pid.kp": (0.1, 30.0), "pid.ki": (0.05, 30.0), "pid.kd": (0.0, 2.0)}
    found = tune(loop(), free, "rms(e)", subject_to=["overshoot(y, 1) <= 0.05", "largest(u) <= 8"], stop=5.0, step=5e-3)
    case = found.after["loop"]
    assert found.met
    assert case["overshoot(y, 1)"] <= 0.05
    assert case["largest(u)"] <= 8
    assert case["rms(e)"] < 0.75 * found.before["loop"]["rms(e)"]
    free_of_it = tune(loop(), free, "rms(e)", subject_to=["largest(u) <= 8"], stop=5.0, step=5e-3)
    assert free_of_it.worst[1] <= found.worst[1] * 1.001


@pytest.mark.parametrize("starts", [2, pytest.param(4, marks=pytest.mark.slow)])
def test_margins_are_kept(starts):
    free = {"pid.kp": (0.1, 30.0), "pid.ki": (0.05, 30.0)}
    limits = ["phase_margin('pid -> g') >= 50", "gain_margin('pid') >= 3"]
    free_of_it = tune(loop(), free, "rms(e)", stop=5.0, step=5e-3, starts=starts)
    found = tune(loop(), free, "rms(e)", subject_to=limits, stop=5.0, step=5e-3, starts=starts)
    import control

    margin = control.margin(tsm.analysis.loop_gain(found.diagram, "pid -> g"))
    assert found.met
    assert margin[1] == pytest.approx(50, abs=1.0)
    assert found.after["loop"]["phase_margin('pid -> g')"] == pytest.approx(margin[1])
    assert re.search(r"gain_margin\('pid'\), at least 3 .*\nloop +none +none", str(found))
    assert found.after["loop"]["gain_margin('pid')"] == 1000.0  # a second-order plant with PI never crosses -180 deg
    assert free_of_it.worst[1] < found.worst[1] < found.worst[0]


def late_loop(block):
    """An integrator of gain 5 behind ``block``, with feedback."""
    return tsm.Diagram(
        title="late",
        blocks={"ref": Step(), "e": Sum(signs="+-"), "k": Gain(gain=5.0), "b": block, "x": Integrator()},
        wires=["ref -> e.plus", "e -> k -> b -> x -> e.minus"],
        outputs={"y": "x", "e": "e"},
    )


def test_margins_of_loops_with_dead_times_are_kept():
    """The phase of k exp(-Ts)/s at its crossover k is -90 deg - k T."""
    found = tune(
        late_loop(DeadTime(time=0.1)),
        {"k.gain": (1.0, 20.0)},
        "rms(e)",
        subject_to="phase_margin('k -> b') >= 45",
        stop=5.0,
        step=5e-3,
    )
    assert found.met
    gain = found.diagram.parameters["k.gain"]
    assert next(iter(found.after.values()))["phase_margin('k -> b')"] == pytest.approx(
        90 - np.rad2deg(gain * 0.1), abs=1e-2
    )


def test_a_margin_that_no_gains_can_have_is_refused_with_its_reason():
    with pytest.raises(ParameterError) as caught:
        tune(
            late_loop(Play(half_width=0.1)),
            {"k.gain": (1.0, 20.0)},
            "rms(e)",
            subject_to="phase_margin('k -> b') >= 45",
            stop=5.0,
            step=5e-3,
        )
    assert str(caught.value).startswith("phase_margin: b of 'late' acts at its own instants")


@pytest.mark.parametrize(
    ("num", "den", "gain", "wanted"),
    [
        ((1.0,), (1.0, 3.0, 3.0, 1.0), 2.0, 4.0),
        ((1.0,), (1.0, 3.0, 3.0, 1.0), 16.0, 0.5),  # unstable above 8
        ((1.0, 2.0, 1.0), (1.0, 0.0, 0.0, 0.0), 1.0, 2.0),
        ((1.0, 2.0, 1.0), (1.0, 0.0, 0.0, 0.0), 4.0, 8.0),  # below 1/2
        ((1.0, 2.0, 1.0), (1.0, 0.0, 0.0, 0.0), 0.25, 0.5),
        ((1.0,), (1.0, -1.0), 3.0, 3.0),
        ((1.0,), (1.0, -1.0), 0.5, 0.5),
        ((1.0,), (1.0, 1.0), 5.0, 1000.0),  # never
        ((-1.0,), (1.0, 1.0), 0.25, 4.0),
        ((-1.0,), (1.0, 1.0), 2.0, 0.5),  # the sign turned
    ],
)
def test_a_gain_margin_is_the_smallest_factor_up_or_down_that_makes_the_loop_unstable(num, den, gain, wanted):
    blocks = {"r": Step(time=0.0), "e": Sum(signs="+-"), "k": Gain(gain=gain), "g": TransferFunction(num=num, den=den)}
    diagram = tsm.Diagram(
        title="loop", blocks=blocks, wires=["r -> e.plus", "e -> k -> g -> e.minus"], outputs={"y": "g"}
    )
    assert limit("gain_margin('k -> g') >= 2", {}, diagram).margin_of(diagram) == pytest.approx(wanted, rel=1e-6)


@pytest.mark.parametrize(
    ("period", "kp", "ki", "kd", "late"),
    [(0.1, 1.0, 1.0, 0.3, 1), (0.02, 0.5, 0.2, 0.05, 2), (0.001, 5.0, 2.0, 1.0, 3), (0.5, 0.3, 0.3, 0.0, 0)],
)
def test_margins_of_sampled_loops_bring_a_pole_onto_the_unit_circle(period, kp, ki, kd, late):
    """The first of these has a phase margin of 17 deg, which polynomials of python-control 0.10 do not see."""
    delays = {f"d{k}": UnitDelay(period=period) for k in range(late)}
    blocks = {
        "e": Sum(signs="+-"),
        "c": DiscretePID(period=period, kp=kp, ki=ki, kd=kd),
        **delays,
        "g": TransferFunction(num=[9.0], den=[1.0, 1.2, 9.0]),
    }
    d = tsm.Diagram(
        title="loop",
        blocks=blocks,
        inputs={"r": "e.plus"},
        outputs={"y": "g"},
        wires=[" -> ".join(["e", "c", *delays, "g", "e.minus"])],
    )
    gain, phase = (limit(f"{kind}('c') >= 2", {}, d).margin_of(d) for kind in ("gain_margin", "phase_margin"))
    L = tsm.analysis.loop_gain(d, "c")

    def fastest(factor):
        return np.abs(np.linalg.eigvals(L.A - factor * L.B @ L.C / (1.0 + factor * L.D.item()))).max()

    assert fastest(1.0) < 1.0
    assert fastest(gain) == pytest.approx(1.0, abs=1e-8)
    assert fastest(0.999 * gain) < 1.0
    assert fastest(np.exp(-1j * np.deg2rad(phase))) == pytest.approx(1.0, abs=1e-8)
    assert fastest(np.exp(-0.999j * np.deg2rad(phase))) < 1.0


def test_a_gain_margin_of_reduction_is_met():
    asked = dict(subject_to=["gain_margin('controller -> drive') >= 2"], stop=1.0, step=2e-3, starts=1)
    found = tune(tsm.load(FIG16), {"controller.kp": (30.0, 100.0)}, "rms(x_ref - x_out)", **asked)
    assert found.met
    assert [one["gain_margin('controller -> drive')"] > 100 for one in found.after.values()] == [True]


def test_the_papers_gains_are_beaten():
    diagram = tsm.load("fig16_feedforward_feedback")
    found = tune(
        diagram,
        {"pid.kp": (0.1, 5.0), "pid.ki": (0.0, 10.0)},
        "peak_to_peak(x_ref - x_out, after=5)",
        subject_to=["share(abs(u) > 23.9) <= 0.001"],
        stop=10.0,
        step=2e-3,
        starts=2,
    )
    before, after = found.worst
    assert found.met
    assert after < 0.75 * before


# ---- how it goes


def test_the_same_call_gives_the_same_numbers():
    calls = [tune(loop(), {"pid.kp": (0.1, 30.0)}, "rms(e)", stop=2.0, step=1e-2, seed=3) for _ in range(2)]
    assert calls[0].values == calls[1].values
    assert calls[0].to_dict() == calls[1].to_dict()


def test_ctrl_c_keeps_the_best_so_far():
    def stop(stage, done, _):
        if done == 1:
            raise KeyboardInterrupt

    found = tune(scaled(), {"gain.gain": (0.1, 5.0)}, "largest(y - 0.7)", stop=0.1, step=0.01, progress=stop)
    assert found.status == "interrupted"
    assert found.values["gain.gain"] == pytest.approx(0.7, abs=1e-3)


def swinging(offset):
    """An angle that swings with an amplitude of 1 rad around an offset."""
    return tsm.Diagram(
        title="swinging",
        blocks={"r": Sine(amplitude=1.0, frequency=10.0, offset=offset, unit="rad")},
        wires=[],
        outputs={"y": "r"},
    )


TOLD = """\
error [deg] 114.6 -> 85.94, the worst of 2 cases; 2 of 2 starts ended there

parameter    before  tuned  from  to
r.amplitude       1    0.5   0.5   5  at its lower bound

error [deg]                                      before  tuned
low                                                57.3  28.65
high                                              114.6  85.94

highest(y) [deg], at least 11.46, at most 515.7  before  tuned
low                                                57.3  28.65
high                                              114.6  85.94

beware:
- r.amplitude is at its lower bound (0.5): better parameters may lie beyond it"""


def test_what_is_found_is_told_in_degrees_with_before_and_bounds():
    asked = dict(subject_to=["highest(y) >= 0.2", "highest(y) <= 9"], starts=2, stop=0.1, step=1e-3)
    for name, scale in (("error [mrad]", 1000.0), ("error [deg]", 180 / np.pi)):
        found = tune(
            {"low": swinging(0.0), "high": swinging(1.0)}, {"r.amplitude": (0.5, 5.0)}, {name: "largest(y)"}, **asked
        )
        assert found.objective == name
        assert found.worst == pytest.approx((2.0 * scale, 1.5 * scale), rel=1e-6)
        assert found.units == {name: name.split("[")[1][:-1], "highest(y)": "rad"}
    assert str(found) == TOLD
    assert repr(found) == "Tuned(r.amplitude 0.5; error [deg] 114.6 -> 85.94)"


def test_of_many_plants_the_worst_are_shown():
    plants = table({"plant.gain": [1.0 + 0.1 * k for k in range(20)]})
    found = tune(scaled(), {"gain.gain": (0.5, 5.0)}, "largest(y)", plants=plants, starts=1, stop=0.1, step=0.01)
    shown = [line.split()[2] for line in str(found).splitlines() if line.startswith("scaled, plant")]
    assert shown == [str(k) for k in range(8, 20)]
    assert "… (20 in all, the worst shown)" in str(found)


def test_limits_that_cannot_be_met_are_told():
    never = tune(
        scaled(), {"gain.gain": (0.1, 0.5)}, "largest(y - 0.7)", subject_to=["highest(y) >= 1.0"], stop=0.1, step=0.01
    )
    assert not never.met
    assert never.remarks == (
        "highest(y) >= 1.0 is not met: it is 0.5",
        "gain.gain is at its upper bound (0.5): better parameters may lie beyond it",
    )
    assert "\n\nbeware:\n- highest(y) >= 1.0 is not met: it is 0.5\n- gain.gain is at its upper" in str(never)
    assert never.to_dict()["remarks"] == list(never.remarks)


def test_a_limit_that_is_just_missed_is_told_with_digits_that_show_it():
    free = {"gain.gain": (1.000004, 3.0)}
    missed = tune(scaled(), free, "rms(y)", subject_to=["highest(y) <= 1"], stop=0.1, step=0.01, starts=1)
    assert not missed.met
    assert missed.remarks[0] == "highest(y) <= 1 is not met: it is 1.000004"


def test_one_limit_need_not_be_a_list():
    asked = dict(free={"gain.gain": (0.1, 5.0)}, minimise="largest(y - 2)", stop=0.1, step=0.01, starts=1)
    one, listed = (tune(scaled(), subject_to=given, **asked) for given in ("highest(y) <= 1.5", ["highest(y) <= 1.5"]))
    assert one.to_dict() == listed.to_dict()
    assert one.values["gain.gain"] == pytest.approx(1.5, rel=2e-3)


def test_a_limit_of_zero_can_be_met():
    found = tune(
        scaled(), {"gain.gain": (0.1, 3.0)}, "largest(y - 2)", subject_to=["share(y > 1.5) <= 0"], stop=0.1, step=0.01
    )
    assert found.met
    assert found.values["gain.gain"] == pytest.approx(1.5, rel=0.05)
    assert found.values["gain.gain"] <= 1.5


@pytest.mark.parametrize("most", [5.0, 20.0])
def test_what_is_limited_ends_within_its_limit(most):
    limit = f"variation(u, after=5) <= {most:g}"
    # with four starts: where a single one ends, of several limit cycles, is a matter of rounding
    found = tune(tsm.load(FIG16), GAINS, ERROR, subject_to=[limit], stop=10.0, step=2e-3)
    (values,) = found.after.values()
    assert found.met
    assert 0.95 * most <= values["variation(u, after=5)"] <= most


def test_what_changes_nothing_is_told():
    idle = tsm.Diagram(
        title="idle",
        blocks={"s": Sine(amplitude=1.0, frequency=1.0), "g": Gain(), "h": Gain()},
        wires=["s -> g", "s -> h"],
        outputs={"y": "g", "z": "h"},
    )
    found = tune(idle, {"g.gain": (0.1, 5.0), "h.gain": (0.1, 5.0)}, "rms(y - 3 * s.y)", stop=1.0, step=0.01, starts=2)
    assert found.values["g.gain"] == pytest.approx(3.0, abs=1e-3)
    assert found.remarks == ("h.gain has no effect on the objective and the limits",)


def test_nothing_better_is_told():
    found = tune(scaled(), {"gain.gain": (1.0, 5.0)}, "largest(y)", stop=0.1, step=0.01, starts=2)
    assert not found.improved
    assert found.remarks == ("no better parameters were found than the diagram's own",)


def test_what_is_found_is_a_frame_and_a_figure():
    found = tune(
        {"low": scaled(), "high": scaled(one=Constant(value=2.0))},
        {"gain.gain": (0.1, 5.0)},
        {"error": "largest(y - 0.7)"},
        subject_to=["highest(y) <= 1"],
        stop=0.1,
        step=0.01,
        starts=1,
    )
    frame = found.to_pandas()
    assert list(frame) == ["error", "highest(y)"]
    for case, after in found.after.items():
        assert frame.loc[(case, "tuned")].to_dict() == after
        assert frame.loc[(case, "before")].to_dict() == found.before[case]
    errors, heights = found.plot().axes
    assert [bar.get_width() for bar in errors.patches] == pytest.approx(
        [side[case]["error"] for side in (found.before, found.after) for case in found.after]
    )
    assert [line.get_xdata()[0] for line in heights.lines] == [1.0]
    with pytest.raises(RunError, match=r"the tuning has no metric 'eror'\. Did you mean 'error'\?"):
        found.plot("eror")


# ---- what it warns of

FIG16 = "fig16_feedforward_feedback"
GAINS = {"pid.kp": (0.1, 5.0), "pid.ki": (0.0, 20.0), "pid.kd": (0.0, 0.1)}
ERROR = "peak_to_peak(x_ref - x_out, after=5)"


def far(diagram):
    """How far u goes from 5 s on, at a step far below that of the tuning."""
    run = tsm.simulate(diagram, stop=10.0, step=2e-4)
    return np.abs(np.diff(run["u"][run.t >= 5.0])).sum()


def test_a_loop_that_hunts_is_told_and_a_limit_prevents_it():
    """Linear margins do not show it: hysteresis and a high gain swing at 24 Hz at each reversal."""
    shipped = tsm.load(FIG16)
    asked = dict(minimise=ERROR, stop=10.0, step=2e-3, starts=1)
    found = tune(shipped, GAINS, subject_to=["largest(abs(u)) <= 12"], **asked)
    assert far(found.diagram) > 20 * far(shipped)
    (said,) = found.hunting
    assert said in found.remarks
    assert said.startswith(
        "the loop hunts in case 'Feedforward plus PID feedback of the tip', or follows a fast reference better: the total "
        "variation of u is "
    )
    swings = float(said.split("mostly at about ")[1].split(" Hz")[0])
    assert 15 < swings < 35
    assert repr(found).endswith(", it hunts)")
    limit = said.split("subject_to=['")[1].split("']")[0]
    calm = tune(shipped, GAINS, subject_to=["largest(abs(u)) <= 12", limit], **asked)
    assert not calm.hunting
    assert calm.met
    assert far(calm.diagram) < 2.5 * far(shipped)
    assert found.worst[1] < calm.worst[1] < 0.9 * calm.worst[0]


def test_a_loop_that_moves_faster_does_not_hunt():
    """A step that is followed ten times as fast: u goes farther, once."""
    found = tune(
        loop(),
        {"pid.kp": (0.1, 30.0), "pid.ki": (0.05, 30.0), "pid.kd": (0.0, 2.0)},
        "rms(e)",
        subject_to=["overshoot(y, 1) <= 0.05", "largest(u) <= 8"],
        stop=5.0,
        step=5e-3,
        starts=1,
    )
    assert found.after["loop"]["largest(u)"] > 4 * found.before["loop"]["largest(u)"]
    assert not found.hunting


def test_a_search_that_ends_where_limits_just_hold_brings_something_back():
    """Where u swings, its largest value depends on the last digits: the end of a search may be just outside."""
    halves = MultiSine(amplitudes=(np.deg2rad(28),) * 2, frequencies=(0.2, 0.5), phases=(0.0, 0.0), unit="rad")
    loops = {"one": tsm.load(FIG16), "two": tsm.load(FIG16).replace("ref", halves)}
    found = tune(
        loops,
        GAINS,
        "peak_to_peak(x_ref - x_out, after=10)",
        subject_to=["largest(abs(u)) <= 12"],
        stop=20.0,
        step=1e-3,
        starts=1,
    )
    assert found.met
    assert found.improved
    assert found.worst[1] < 0.7 * found.worst[0]


REFUSED = {
    "no bounds": (dict(free={"gain.gain": 3}), "'gain.gain' needs bounds (low, high), got 3."),
    "no mapping": (
        dict(free=["gain.gain"]),
        "free maps parameters to bounds, such as {'pid.kp': (0.1, 5.0)}, got ['gain.gain'].",
    ),
    "unknown": (
        dict(free={"gain.gian": (0, 1)}),
        "diagram 'scaled' has no parameter 'gain.gian'. Did you mean 'gain.gain'?",
    ),
    "the end of a name": (
        dict(diagrams=loop(), free={"kp": (0, 1)}),
        "diagram 'loop' has no parameter 'kp'. Did you mean 'pid.kp'?",
    ),
    "the end of several": (
        dict(diagrams=loop(), free={"time_constant": (0, 1)}),
        "diagram 'loop' has no parameter 'time_constant'. Did you mean 'g.time_constant' or 'h.time_constant'?",
    ),
    "limits that are none": (
        dict(subject_to=3),
        "subject_to takes a limit such as 'largest(u) <= 20', or a list of them, got 3.",
    ),
    "one limit that is none": (
        dict(subject_to="rms(y)"),
        "'rms(y)' is no limit of a metric. Write for example 'largest(u) <= 20'.",
    ),
    "upside down": (
        dict(free={"gain.gain": (2, 1)}),
        "bounds of 'gain.gain': low must be below high, got low=2, high=1.",
    ),
    "metric": (dict(minimise="rms(z)"), "metric: there is no signal 'z'."),
    "no slope": (
        dict(minimise="rise_time(y, 0.1)"),
        "metric 'rise_time(y, 0.1)': rise_time is not differentiable, so it cannot be used for tuning.",
    ),
    "no limit": (
        dict(subject_to=["rms(y)"]),
        "'rms(y)' is no limit of a metric. Write for example 'largest(u) <= 20'.",
    ),
    "share": (
        dict(subject_to=["overshoot(y, 1) < 5%"]),
        "'overshoot(y, 1) < 5%' is no limit of a metric. 5 % is written 0.05. Write for example 'largest(u) <= 20'.",
    ),
    "limit on the left": (
        dict(subject_to=["2 >= rms(y)"]),
        "'2 >= rms(y)': the limit must be a plain number, on the right.",
    ),
    "limit of nothing": (dict(subject_to=["rms(z) <= 2"]), "limit: metric: there is no signal 'z'."),
    "no wire": (
        dict(subject_to=["phase_margin(3) >= 45"]),
        "phase_margin takes the wire at which the loop is opened: phase_margin('controller -> drive').",
    ),
    "another wire": (dict(subject_to=["phase_margin('plant -> gian') >= 45"]), "phase_margin: at='plant -> gian'"),
    "plants": (
        dict(plants={"plant.gain": [1]}),
        "plants is a plan such as monte_carlo gives, got {'plant.gain': [1]}.",
    ),
    "no instant": (
        dict(minimise="rms(y, after=3)"),
        "metric 'rms(y, after=3)': no instant of the run lies between 3 and inf s; it is from 0 to 0.1 s.",
    ),
    "two metrics": (
        dict(minimise={"a": "rms(y)", "b": "mean(y)"}),
        "minimise is one metric, such as 'rms(x_ref - x_out)', or with a name and a unit {'error [deg]': 'rms(x_ref - x_out)'}, got ",
    ),
    "starts": (dict(starts=0), "starts must be a whole number of at least 1, got 0."),
    "diagrams": (dict(diagrams={}), "tune needs at least one diagram."),
}


@pytest.mark.parametrize("name", REFUSED)
def test_what_cannot_be_tuned(name):
    asked, said = REFUSED[name]
    usual = dict(diagrams=scaled(), free={"gain.gain": (0.1, 5.0)}, minimise="rms(y)", stop=0.1, step=0.01)
    with pytest.raises(tsm.TsmError) as found:
        tune(**{**usual, **asked})
    assert str(found.value).startswith(said), str(found.value)


def position(kp, ki, kd):
    """A motor behind a limit that the derivative drives it into: the largest volts then change no more."""
    blocks = dict(
        e=Sum(signs="+-"),
        pid=PID(kp=kp, ki=ki, kd=kd),
        limit=Saturation(low=-10.0, high=10.0),
        motor=FirstOrderLag(gain=18.15, time_constant=0.146),
        x=Integrator(gain=0.8),
    )
    return tsm.Diagram(
        title="position",
        blocks=blocks,
        wires=["e -> pid -> limit -> motor -> x -> e.minus"],
        inputs={"r": "e.plus"},
        outputs={"x": "x", "u": "limit", "e": "e"},
    )


@pytest.mark.parametrize("kp", [0.5, 2.0])
def test_limits_that_hold_only_where_gains_are_next_to_off_are_met(kp):
    free = {"pid.kp": (0.01, 5.0), "pid.ki": (0.0, 5.0), "pid.kd": (0.0, 0.5)}
    how = dict(inputs={"r": 20.0}, stop=3.0, step=2e-3)
    goal, limits = "rms(e, after=0.1)", {"over": "overshoot(x, 20)", "volts": "largest(abs(u))"}
    found = tune(
        position(kp, 0.1, 0.02),
        free,
        goal,
        subject_to=[f"{limits['over']} <= 0.02", f"{limits['volts']} <= 9.9"],
        **how,
    )
    assert found.met
    by = {"pid.kp": np.linspace(0.1, 0.5, 21), "pid.ki": [0.0, 0.01], "pid.kd": [0.0, 0.001, 0.002, 0.003, 0.004]}
    by_hand = tsm.study(position(kp, 0.1, 0.02), tsm.studies.grid(by), {"goal": goal, **limits}, **how)
    meets = (by_hand["over"] <= 0.02) & (by_hand["volts"] <= 9.9)
    assert 0 < meets.sum() < len(meets)
    assert found.worst[1] < 1.001 * by_hand["goal"][meets].min()


# ---- margins where the loop is at work -----------------------------------------------------------------


def drive_loop(gain=200.0):
    """A step at the very start brings the drive to its limit: there the linear loop is open."""
    blocks = {
        "r": Step(time=0.0),
        "e": Sum(signs="+-"),
        "k": Gain(gain=gain),
        "drive": tsm.blocks.Saturation(low=-24.0, high=24.0),
        "motor": tsm.blocks.MotorTransferFunction(),
    }
    wires = ["r -> e.plus", "e -> k -> drive -> motor", "motor.y -> e.minus"]
    return tsm.Diagram(title="loop", blocks=blocks, wires=wires, outputs={"y": "motor.y", "e": "e", "u": "drive"})


def test_margins_are_those_of_the_loop_at_work():
    """Taken at the start, where the drive is at its limit, the margin would be 180 deg and any limit met."""
    asked = dict(subject_to="phase_margin('k -> drive') >= 45", stop=2.0, step=2e-3, starts=1)
    found = tsm.tune(drive_loop(), {"k.gain": (1.0, 400.0)}, "rms(e)", **asked)
    import control

    motor = tsm.blocks.MotorTransferFunction()
    true = control.margin(found.values["k.gain"] * control.tf([motor.K], [motor.tau, 1.0, 0.0]))[1]
    assert found.met
    assert true == pytest.approx(45.0, abs=0.2)
    name = "phase_margin('k -> drive')"
    assert found.after["loop"][name] == pytest.approx(true, rel=1e-6)
    assert found.before["loop"][name] == pytest.approx(20.04, abs=0.01)


def test_the_point_of_a_margin_is_stated_in_its_limit():
    loop, options = drive_loop(), RunOptions(stop=2.0, step=2e-3)
    taken = {p: limit(f"phase_margin('k', point='{p}') >= 45", {}, loop).margin_of(loop, options) for p in POINTS}
    assert taken["end"] == pytest.approx(20.04, abs=0.01)
    assert taken["trim"] == pytest.approx(taken["end"])
    assert taken["start"] == 0.0  # at a limit there is no margin
    assert limit("gain_margin('k', point='start') >= 2", {}, loop).margin_of(loop, options) == 1.0
    with pytest.raises(ParameterError, match=r"point is 'tirm', which is not a choice\. Did you mean 'trim'"):
        limit("phase_margin('k', point='tirm') >= 45", {}, loop)


def test_a_metric_with_time_has_its_derivative():
    """Of exp(-p t): the integral of t e^2 is 1/(4 p^2), its derivative -1/(2 p^3)."""
    t, p = np.linspace(0.0, 30.0, 30_001), 1.3
    e = np.exp(-p * t)
    one = differentiable(metric("integral(t * e * e)", {"e": ""}))
    values, gradient = one(t, {"e": e}, {"e": (-t * e)[:, None]}, 0.01)
    assert values[0] == pytest.approx(1 / (4 * p**2), rel=1e-5)
    assert gradient[0, 0] == pytest.approx(-1 / (2 * p**3), rel=1e-5)


def test_a_loop_is_tuned_to_settle():
    """y = 1 - exp(-k t) settles to 2 % at ln(50)/k: as fast as the largest gain lets it, or as a limit of it."""
    blocks = {"r": Step(time=0.0), "e": Sum(signs="+-"), "k": Gain(gain=1.0), "i": tsm.blocks.Integrator()}
    wires = ["r -> e.plus", "e -> k -> i -> e.minus"]
    d = tsm.Diagram(title="loop", blocks=blocks, wires=wires, outputs={"e": "e", "u": "k"})
    asked = dict(subject_to="settling_time(e, 0.02) <= 1.0", stop=8.0, step=1e-3, starts=1)
    found = tsm.tune(d, {"k.gain": (0.2, 20.0)}, "largest(u)", **asked)
    assert found.met
    assert found.values["k.gain"] == pytest.approx(np.log(50.0), rel=5e-3)
