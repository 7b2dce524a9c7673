"""Points, linear models and frequency responses against python-control, closed forms and describing functions."""

import math

import attrs
import control
import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st

import tsmblocks as tsm
from tsmblocks.analysis import SettlingWarning, frequency_response, linearize, loop_gain, opened, trim
from tsmblocks.blocks import (
    PID,
    AsymmetricBoucWen,
    Constant,
    CoulombFriction,
    DeadTime,
    FirstOrderLag,
    Gain,
    Integrator,
    MotorTransferFunction,
    Power,
    Product,
    RateLimit,
    Saturation,
    Sine,
    StateSpace,
    Sum,
    TransferFunction,
    UnitDelay,
)
from tsmblocks.common.errors import RunError

W = np.logspace(-1, 2, 40)


def pi_loop(**more):
    blocks = {"e": Sum(signs="+-"), "c": PID(kp=2.0, ki=3.0, kd=0.0), "g": FirstOrderLag(gain=2.0, time_constant=0.5)}
    wires = ["e -> c -> g", "g -> e.minus"]
    return tsm.Diagram(title="pi", blocks={**blocks, **more}, wires=wires, inputs={"r": "e.plus"}, outputs={"y": "g"})


def scaled_point():
    return tsm.Diagram(title="other", blocks={"c": FirstOrderLag()}, inputs={"u": "c"}, outputs={"y": "c"})


def answer(system, w=W):
    return np.asarray(control.frequency_response(system, w).frdata)


def line(block, **outputs):
    return tsm.Diagram(title="line", blocks={"b": block}, inputs={"u": "b"}, outputs=outputs or {"y": "b"})


# ---- linear models


@given(st.integers(1, 4), st.integers(1, 3), st.integers(1, 3), st.integers(0, 10_000))
def test_a_state_space_comes_back(states, ins, outs, seed):
    rng = np.random.default_rng(seed)
    A, B, C, D = (
        rng.standard_normal(shape).round(3) for shape in ((states, states), (states, ins), (outs, states), (outs, ins))
    )
    block = StateSpace(A=A.tolist(), B=B.tolist(), C=C.tolist(), D=D.tolist())
    diagram = tsm.Diagram(
        title="ss",
        blocks={"s": block},
        inputs={f"i{k}": f"s.{p}" for k, p in enumerate(block.inports)},
        outputs={f"o{k}": f"s.{p}" for k, p in enumerate(block.outports)},
    )
    made = linearize(diagram)
    for name, wanted in zip("ABCD", (A, B, C, D), strict=True):
        assert getattr(made, name) == pytest.approx(wanted, abs=1e-12)


def test_names_are_kept():
    made = linearize(pi_loop(), outputs=["y", "c.y", "e.y"])
    assert made.input_labels == ["r"]
    assert made.output_labels == ["y", "c_y", "e_y"]
    assert made.state_labels == ["c_integral", "c_smooth", "g_value"]


def test_a_closed_loop_is_what_python_control_makes_of_its_parts():
    s = control.tf("s")
    L = (2 + 3 / s) * 2 / (0.5 * s + 1)
    assert answer(linearize(pi_loop())) == pytest.approx(answer(control.feedback(L)), rel=1e-9)
    for at in ("e -> c", "e.y", "g -> e.minus", "c"):
        assert answer(loop_gain(pi_loop(), at)) == pytest.approx(answer(L), rel=1e-9)


def test_the_papers_position_loop_has_the_margins_of_its_transfer_functions():
    diagram = tsm.load("fig09a_without_feedforward")
    p, s = diagram.parameters, control.tf("s")
    pid = p["controller.kp"] + p["controller.ki"] / s + p["controller.kd"] * s / (p["controller.tau"] * s + 1)
    L = pid * p["motor.K"] / (s * (p["motor.tau"] * s + 1))
    made = loop_gain(diagram, "controller -> drive")
    assert (made.input_labels, made.output_labels) == (["cut"], ["back"])
    assert set(made.state_labels) == {"controller_integral", "controller_smooth", "motor_speed", "motor_angle"}
    assert answer(made) == pytest.approx(answer(L), rel=1e-8)
    assert control.stability_margins(made)[1] == pytest.approx(control.stability_margins(L)[1], rel=1e-6)


def test_a_curve_has_the_slope_of_its_point():
    diagram = tsm.Diagram(
        title="square",
        blocks={"p": Power(exponent=3.0), "g": Gain(gain=2.0)},
        wires=["p -> g"],
        inputs={"u": "p"},
        outputs={"y": "g"},
    )
    point = trim(diagram, outputs={"y": 16.0}, start={"u": 1.0})
    assert point["u"] == pytest.approx(2.0)
    assert linearize(diagram, at=point).D[0, 0] == pytest.approx(2 * 3 * 4.0)


def test_inputs_that_enter_by_their_slope():
    """Hysteresis is driven by the rate of its input: at rest its slope is the mean of both ways."""
    block = AsymmetricBoucWen(alpha1=0.9, alpha2=0.95, A=-0.8, theta=4.0, delta=0.1)
    diagram = tsm.Diagram(title="tsm", blocks={"tsm": block}, inputs={"x_in": "tsm"}, outputs={"x_out": "tsm"})
    assert answer(linearize(diagram)) == pytest.approx(0.925 - 0.8, rel=1e-9)
    lagged = tsm.Diagram(
        title="tsm",
        blocks={"tsm": block, "lag": FirstOrderLag(time_constant=0.2)},
        wires=["tsm -> lag"],
        inputs={"x_in": "tsm"},
        outputs={"x_out": "lag"},
    )
    assert answer(linearize(lagged)).ravel() == pytest.approx(0.125 / (0.2j * W + 1), rel=1e-9)


@pytest.mark.parametrize("order", [1, 3, 5])
def test_dead_time_is_a_pade_approximation(order):
    diagram = tsm.Diagram(
        title="late",
        blocks={"g": FirstOrderLag(gain=2.0, time_constant=0.5), "d": DeadTime(time=0.2)},
        wires=["g -> d"],
        inputs={"u": "g"},
        outputs={"y": "d", "z": "g"},
    )
    made = linearize(diagram, pade=order)
    g, late = control.tf([2], [0.5, 1]), control.tf(*control.pade(0.2, order))
    assert answer(made)[0, 0] == pytest.approx(answer(g * late).ravel(), rel=1e-6)
    assert answer(made)[1, 0] == pytest.approx(answer(g).ravel(), rel=1e-9)
    assert made.nstates == 1 + order


def test_dead_time_in_a_loop():
    late = pi_loop().insert("d", DeadTime(time=0.1), after="g")
    s = control.tf("s")
    L = (2 + 3 / s) * 2 / (0.5 * s + 1) * control.tf(*control.pade(0.1, 6))
    low = W[W < 20]
    assert answer(linearize(late, pade=6), low) == pytest.approx(answer(control.feedback(L), low), rel=1e-6)
    exact = (2 + 3 / (1j * low)) * 2 / (0.5j * low + 1) * np.exp(-0.1j * low)
    assert answer(loop_gain(late, "e -> c", pade=6), low).ravel() == pytest.approx(exact, rel=1e-3)


def test_dead_times_in_series_add_up():
    late = pi_loop().insert("d", DeadTime(time=0.1), after="g").insert("d2", DeadTime(time=0.05), after="d")
    low = W[W < 20]
    exact = (2 + 3 / (1j * low)) * 2 / (0.5j * low + 1) * np.exp(-0.15j * low)
    assert answer(loop_gain(late, "e -> c", pade=6), low).ravel() == pytest.approx(exact, rel=1e-3)
    assert answer(linearize(late, pade=6), low).ravel() == pytest.approx(exact / (1 + exact), rel=1e-2)


def test_a_linear_model_is_what_a_small_motion_does():
    """A pendulum pushed a little off a point where gravity is held by the input."""
    blocks = {"sum": Sum(signs="++-"), "v": Integrator(), "x": Integrator(), "g": Product(), "k": Gain(gain=9.81)}
    wires = ["sum -> v -> x", "x -> k, g.u1", "k -> g.u2", "g -> sum.minus"]
    ports = tsm.Diagram(
        title="p", blocks=blocks, wires=[*wires, "v -> sum.plus2"], inputs={"u": "sum.plus1"}, outputs={"x": "x"}
    )
    point = trim(ports, outputs={"x": 0.5})
    assert point["u"] == pytest.approx(9.81 * 0.25)
    made, t = linearize(ports, at=point), np.linspace(0, 0.5, 501)
    run = tsm.simulate(ports, inputs={"u": point["u"] + 1e-4}, initial=point.states, stop=0.5)
    linear = control.forced_response(made, t, np.full(501, 1e-4)).outputs
    assert (run["x"] - 0.5) == pytest.approx(linear, rel=1e-3, abs=1e-9)


# ---- points


def test_a_loop_with_an_integrator_finds_its_place():
    point = trim(pi_loop(), inputs={"r": 1.5})
    assert point["y"] == pytest.approx(1.5)
    assert point["e.y"] == pytest.approx(0.0, abs=1e-12)
    assert max(map(abs, point.rates.values())) < 1e-10
    run = tsm.simulate(pi_loop(), inputs={"r": 1.5}, initial=point.states, stop=1.0)
    assert run["y"] == pytest.approx(1.5, abs=1e-9)
    assert trim(pi_loop(), outputs={"y": 1.5})["r"] == pytest.approx(1.5)


@given(st.floats(-2.0, 2.0), st.floats(-0.5, 0.5))
def test_hysteresis_at_rest_stays_where_it_is(angle, zeta):
    """Any value of its state will do at rest; the one given stays, and so does a motor under its integrator."""
    blocks = {"motor": MotorTransferFunction(), "tsm": AsymmetricBoucWen()}
    diagram = tsm.Diagram(
        title="chain", blocks=blocks, wires=["motor.y -> tsm"], inputs={"u": "motor"}, outputs={"x_out": "tsm"}
    )
    start = {"motor.angle": angle, "tsm.zeta": zeta}
    point = trim(diagram, start=start)
    assert {k: point.states[k] for k in start} == pytest.approx(start, abs=1e-12)
    assert point.inputs == {"u": 0.0}


def test_a_point_is_found_through_a_bend_and_a_limit():
    diagram = tsm.Diagram(
        title="bent",
        blocks={"p": Power(exponent=3.0), "s": Saturation(low=-50.0, high=50.0), "lag": FirstOrderLag(gain=2.0)},
        wires=["p -> s -> lag"],
        inputs={"u": "p"},
        outputs={"y": "lag"},
    )
    assert trim(diagram, outputs={"y": 54.0}, start={"u": 1.0})["u"] == pytest.approx(3.0)
    with pytest.raises(RunError, match=r"'bent' has no equilibrium here: .* is .* off"):
        trim(diagram, outputs={"y": 1000.0}, start={"u": 1.0})


def behind_a_limit(**initial):
    """An integrator that drives a lag of gain 2 through a limit; the limit is left for |i| < 0.02 alone."""
    return tsm.Diagram(
        title="limited",
        blocks=dict(
            e=Sum(), i=Integrator(**initial), k=Gain(gain=50.0), s=Saturation(low=-1.0, high=1.0),
            g=FirstOrderLag(time_constant=0.1, gain=2.0),
        ),
        wires=["e -> i -> k -> s -> g -> e.minus"],
        inputs={"r": "e.plus"},
        outputs={"y": "g"},
    )  # fmt: skip


@pytest.mark.parametrize("integral", [0.0, 1.0, -3.0, 40.0])
def test_an_equilibrium_is_found_from_a_start_at_a_limit(integral):
    point = trim(behind_a_limit(integral=integral), inputs={"r": 0.2})
    assert point.states == pytest.approx({"i.integral": 0.1 / 50, "g.value": 0.2})
    point = trim(behind_a_limit(integral=integral), outputs={"y": -1.4})
    assert point.inputs["r"] == pytest.approx(-1.4)


def test_a_free_input_is_found_beyond_a_limit():
    d = tsm.Diagram(
        title="bias",
        blocks=dict(o=Constant(value=5.0), a=Sum(signs="++"), s=Saturation(low=-1.0, high=1.0), g=FirstOrderLag()),
        wires=["o -> a.plus2", "a -> s -> g"],
        inputs={"u": "a.plus1"},
        outputs={"y": "g"},
    )
    assert trim(d, outputs={"y": 0.3})["u"] == pytest.approx(-4.7)
    with pytest.raises(RunError, match=r"At the start u has no effect, as behind a block at its limit: start where it"):
        trim(d, outputs={"y": 3.0})


def test_delays_stand_still_too():
    late = pi_loop().insert("d", DeadTime(time=0.1), after="g").insert("d2", DeadTime(time=0.2), after="d")
    point = trim(late, inputs={"r": 2.0})
    assert (point["y"], point["d.y"], point["d2.y"]) == pytest.approx((2.0, 2.0, 2.0))


# ---- sines


def test_a_linear_loop_answers_as_its_linear_model():
    f = np.array([0.1, 0.5, 2.0])
    found = frequency_response(pi_loop(), f, [0.5, 2.0], settle=12)
    expected = answer(linearize(pi_loop()), 2 * np.pi * f).ravel()
    for row in found.response:
        assert row == pytest.approx(expected, rel=2e-4)
    assert found.distortion.max() < 1e-4
    assert found.phase[0] == pytest.approx(np.degrees(np.unwrap(np.angle(expected))), abs=0.02)


def test_a_limit_has_its_describing_function():
    a = np.array([0.5, 1.0, 1.5, 4.0])
    found = frequency_response(line(Saturation(low=-1.0, high=1.0)), [1.0], a, samples=4000, settle=0)
    expected = control.describing_function(control.saturation_nonlinearity(1.0), a)
    assert found.gain[:, 0] == pytest.approx(np.abs(expected), rel=1e-4)
    theta = np.linspace(0, 2 * np.pi, 200_001)
    y = np.clip(4.0 * np.sin(theta), -1, 1)
    c1, c3 = (abs(np.trapezoid(y * np.exp(-1j * n * theta), theta)) for n in (1, 3))
    assert found.harmonics[3, 0, 1] == pytest.approx(c3 / c1, rel=1e-4)
    assert found.harmonics[3, 0, 0] < 1e-8


def test_backlash_has_its_describing_function():
    from tsmblocks.blocks import Play

    a = np.array([0.6, 1.0, 3.0])
    found = frequency_response(line(Play(half_width=0.5)), [1.0], a, samples=8000, settle=2)
    expected = control.describing_function(control.friction_backlash_nonlinearity(1.0), a)
    assert found.response[:, 0] == pytest.approx(expected, rel=2e-3)


def test_a_sine_in_the_diagram_can_be_the_source():
    inside = tsm.Diagram(
        title="own",
        blocks={"ref": Sine(offset=3.0), "g": FirstOrderLag(time_constant=0.1)},
        wires=["ref -> g"],
        outputs={"y": "g"},
    )
    found = frequency_response(inside, [1.0], [1.0], settle=6)
    assert found.response[0, 0] == pytest.approx(1 / (0.2j * np.pi + 1), rel=1e-4)
    assert (found.driven, found.output) == ("ref", "y")
    assert list(found.to_pandas().columns) == ["gain", "phase", "distortion"]


def test_the_figure_of_an_answer():
    figure = frequency_response(line(Saturation(low=-1.0, high=1.0)), [0.5, 1.0, 2.0], [0.5, 2.0], settle=0).plot()
    assert [panel.get_ylabel() for panel in figure.axes] == ["gain [dB]", "phase [deg]", "distortion [%]"]
    assert [len(panel.lines) for panel in figure.axes] == [2, 2, 2]
    assert [text.get_text() for text in figure.axes[0].get_legend().get_texts()] == ["0.5", "2"]


def test_sizes_of_angles_are_shown_in_degrees_and_ticks_as_numbers():
    angle = line(Saturation(low=-1.0, high=1.0))
    angle = angle.rewire(inputs={"u": tsm.Inlet(angle.inputs["u"].ports, unit="rad")})
    figure = frequency_response(angle, [0.5, 1.0, 2.0], np.deg2rad([10.0, 20.0]), settle=0).plot()
    legend = figure.axes[0].get_legend()
    assert legend.get_title().get_text() == "amplitude of u [deg]"
    assert [text.get_text() for text in legend.get_texts()] == ["10", "20"]
    figure.canvas.draw()
    ticks = {t.get_text() for t in figure.axes[2].xaxis.get_ticklabels(which="both")}
    assert {"0.5", "1", "2"} <= ticks
    assert not any("math" in t for t in ticks)


@pytest.mark.parametrize(("frequency", "damping"), [(5.0, 0.01), (5.1, 0.01), (0.1, 0.7)])
def test_a_slow_answer_is_waited_for(frequency, damping):
    diagram = line(tsm.blocks.SecondOrderLag(omega=2 * np.pi * 5, zeta=damping))
    found = frequency_response(diagram, [frequency], [1.0])
    exact = answer(linearize(diagram), [2 * np.pi * frequency]).ravel()
    assert found.response[0] == pytest.approx(exact, rel=5e-3)
    assert found.distortion.max() < 2e-3


def test_what_never_settles_has_no_answer():
    oscillator = tsm.blocks.SecondOrderLag(omega=2 * np.pi * 5.37, zeta=0.0)
    said = (
        r"^the response of 'y' to 2 of 2 sines never becomes periodic: 1 at 1 Hz and 1 at 2 Hz. It is NaN there. "
        r"Causes are a limit cycle or a drifting signal; tsm.simulate shows which.$"
    )
    with pytest.warns(SettlingWarning, match=said):
        found = frequency_response(line(oscillator), [1.0, 2.0], [1.0])
    assert np.isnan(found.response).all()
    assert np.isnan(found.phase).all()


def test_an_output_that_stands_still_has_no_phase_and_spoils_no_other():
    from tsmblocks.blocks import Play

    found = frequency_response(line(Play(half_width=0.5)), [0.5, 1.0], [0.3, 3.0], settle=2)
    assert found.gain[0].tolist() == [0.0, 0.0]
    assert np.isnan(found.phase[0]).all()
    assert np.isnan(found.distortion[0]).all()
    assert np.isfinite(found.phase[1]).all()
    gain = found.plot().axes[0]
    assert gain.get_ylim()[0] > 20 * np.log10(0.1)  # zero gain has no place on it
    assert gain.lines[2].get_xdata().tolist() == [0.5, 1.0]  # crosses, of the size that moves nothing
    latched = tsm.Diagram(
        title="latched",
        blocks={"e": Sum(), "k": Gain(gain=-3.0), "lim": Saturation(), "p": FirstOrderLag(gain=5.0, time_constant=0.5)},
        wires=["e -> k -> lim -> p -> e.minus"],
        inputs={"r": "e.plus"},
        outputs={"y": "p"},
    )
    held = frequency_response(latched.with_parameters({"p.value": -5.0}), [0.5, 1.0, 4.0], [0.1])
    assert held.gain.tolist() == [[0.0, 0.0, 0.0]]
    answers = np.array([[np.exp(-3.0j), np.nan, 0.0, np.exp(-4.0j)]])
    spoilt = attrs.evolve(found, response=answers, frequencies=np.array([1.0, 2.0, 3.0, 4.0]))
    assert spoilt.phase[0] == pytest.approx(np.rad2deg([-3.0, np.nan, np.nan, -4.0]), nan_ok=True)


def test_sines_go_around_a_bias():
    """The slope of a square is twice where it is looked at."""
    square = line(Power(exponent=2.0))
    found = frequency_response(square, [1.0], [0.1], bias=3.0, settle=1)
    assert found.gain[0, 0] == pytest.approx(6.0, rel=1e-6)
    inside = tsm.Diagram(
        title="own", blocks={"s": Sine(offset=3.0), "g": Power(exponent=2.0)}, wires=["s -> g"], outputs={"y": "g"}
    )
    assert frequency_response(inside, [1.0], [0.1], settle=1).gain[0, 0] == pytest.approx(6.0, rel=1e-6)


def test_an_open_loop_stands_where_the_closed_one_does():
    blocks = {
        "r": Constant(value=1.0),
        "e": Sum(signs="+-"),
        "k": Gain(gain=2.0),
        "sq": Power(exponent=2.0),
        "lag": FirstOrderLag(time_constant=1.0),
    }
    diagram = tsm.Diagram(
        title="bent",
        blocks=blocks,
        wires=["r -> e.plus", "e -> k -> sq -> lag", "lag -> e.minus"],
        outputs={"y": "lag"},
    )
    at_start = loop_gain(diagram, "k -> sq")
    assert control.dcgain(at_start) == pytest.approx(2 * 2.0 * 2.0)
    point = trim(diagram)
    assert control.dcgain(loop_gain(diagram, "k -> sq", point=point)) == pytest.approx(2 * point["k.y"] * 2.0)


def test_a_nested_controller_is_opened_at_its_wire():
    inner = tsm.Diagram(
        title="c", blocks={"l": FirstOrderLag(gain=3.0, time_constant=0.1)}, inputs={"u": "l"}, outputs={"y": "l"}
    )
    blocks = {"e": Sum(signs="+-"), "c": inner, "p": FirstOrderLag(time_constant=1.0)}
    diagram = tsm.Diagram(
        title="n", blocks=blocks, wires=["e -> c -> p", "p -> e.minus"], inputs={"r": "e.plus"}, outputs={"y": "p"}
    )
    s = control.tf("s")
    expected = answer(3 / ((0.1 * s + 1) * (s + 1)))
    for point in (None, trim(diagram)):
        assert answer(loop_gain(diagram, "c -> p", point=point)) == pytest.approx(expected, rel=1e-9)


def test_names_that_would_be_one_stay_apart():
    inner = tsm.Diagram(title="i", blocks={"c": FirstOrderLag()}, inputs={"u": "c"}, outputs={"y": "c"})
    diagram = tsm.Diagram(
        title="o",
        blocks={"b": inner, "b_c": FirstOrderLag()},
        wires=["b -> b_c"],
        inputs={"u": "b"},
        outputs={"y": "b_c"},
    )
    assert linearize(diagram).state_labels == ["b_c_value", "b_c_value_2"]
    assert linearize(diagram, outputs=["y", "y"]).output_labels == ["y", "y_2"]


# ---- what goes wrong


REFUSED = {
    "no input": (lambda: linearize(pi_loop(), inputs=["q"]), "diagram 'pi' has no input 'q'. Known here: r."),
    "no signal": (lambda: linearize(pi_loop(), outputs="g.z"), "diagram 'pi' has no signal 'g.z'. Did you mean 'g.y'?"),
    "no point": (
        lambda: linearize(pi_loop(), at={"r": 1}),
        "at must be a point that trim returned, or a run, got {'r': 1}.",
    ),
    "samples": (
        lambda: trim(line(UnitDelay(period=0.1))),
        "b of 'line' acts at its own instants (samples, or "
        "memory from step to step, as a backlash has it), so its rates do not determine an equilibrium. Replace or "
        "remove it first: diagram.remove('b').",
    ),
    "memory": (lambda: trim(line(RateLimit())), "b of 'line' acts at its own instants"),
    "dead time": (
        lambda: linearize(line(DeadTime(time=0.2))),
        "'line' has dead times (0.2 s), which no state space holds. Give pade=3 for an approximation of third order.",
    ),
    "pade": (lambda: linearize(line(DeadTime(time=0.2)), pade=0), "pade must be a whole number of at least 1, got 0."),
    "slope of what is late": (
        lambda: linearize(
            tsm.Diagram(
                title="l",
                blocks={"d": DeadTime(time=0.1), "v": tsm.blocks.Derivative(), "g": FirstOrderLag()},
                wires=["d -> v -> g"],
                inputs={"u": "d"},
                outputs={"y": "g"},
            ),
            pade=3,
        ),
        "'l' depends on the derivative of a delayed signal, which no state space holds. Put a lag behind the delay.",
    ),
    "another's point": (
        lambda: linearize(line(FirstOrderLag()), at=trim(scaled_point())),
        "the point is one of 'other': it has no 'b.value', as 'line' has.",
    ),
    "no wire at all": (
        lambda: loop_gain(pi_loop(), None),
        "at is a wire such as 'controller -> drive', or a signal, got None.",
    ),
    "a word to begin at": (
        lambda: trim(pi_loop(), start={"g.value": "z"}),
        "start: 'g.value' must be a finite number, got 'z'.",
    ),
    "slowly moving": (
        lambda: trim(
            tsm.Diagram(
                title="two",
                blocks={"c": Constant(value=5.0), "i": Integrator(), "j": Integrator(integral=1e9)},
                wires=["c -> i"],
                inputs={"u": "j"},
                outputs={"y": "i"},
            )
        ),
        "'two' has no equilibrium here: the rate of i.integral",
    ),
    "far too slow": (lambda: frequency_response(pi_loop(), [1e-9]), "a run at 1e-09 Hz would take"),
    "slope": (
        lambda: linearize(line(tsm.blocks.Derivative())),
        "a signal of 'line' depends on the derivative of its input 'u' at "
        "once, so there is no state space from there. Put a lag on the input, or choose other outputs.",
    ),
    "no wire": (lambda: loop_gain(pi_loop(), "e -> g"), "at='e -> g': there is no wire 'e.y -> g.u'."),
    "no block": (lambda: loop_gain(pi_loop(), "f.y"), "at='f.y' names block 'f'"),
    "no listener": (lambda: opened(line(Gain()), "b"), "at='b': no wire begins there."),
    "taken": (lambda: opened(opened(pi_loop(), "e"), "c"), "'pi' has an input 'cut' already."),
    "moving": (
        lambda: trim(line(TransferFunction(num=(1.0,), den=(1.0, 0.0))), inputs={"u": 1.0}),
        "'line' has no equilibrium here: the rate of b.",
    ),
    "start": (
        lambda: trim(pi_loop(), start={"g.vale": 1.0}),
        "start: there is no state or free input 'g.vale'. Did you mean 'g.value'?",
    ),
    "held": (lambda: trim(pi_loop(), inputs={"r": 1.0}, outputs={"y": 2.0}), "'pi' has no equilibrium here"),
    "output": (lambda: trim(pi_loop(), outputs={"z": 2.0}), "diagram 'pi' has no signal 'z'."),
    "a word": (lambda: trim(pi_loop(), inputs={"r": "much"}), "input 'r' must be a finite number, got 'much'."),
    "frequencies": (lambda: frequency_response(pi_loop(), [0.0]), "frequencies must be positive numbers, got [0.0]."),
    "amplitudes": (
        lambda: frequency_response(pi_loop(), [1.0], "big"),
        "amplitudes must be positive numbers, got 'big'.",
    ),
    "driven": (
        lambda: frequency_response(pi_loop(), [1.0], driven="s"),
        "'pi' has no input and no Sine block 's'. Known here: r.",
    ),
    "shown": (lambda: frequency_response(pi_loop(), [1.0], output="z"), "diagram 'pi' has no signal 'z'."),
    "samples asked": (
        lambda: frequency_response(pi_loop(), [1.0], samples=3),
        "samples must be a whole number of at least 20, got 3.",
    ),
}


@pytest.mark.parametrize("name", REFUSED)
def test_what_cannot_be_analysed(name):
    make, said = REFUSED[name]
    with pytest.raises(tsm.TsmError) as found:
        make()
    assert str(found.value).startswith(said), str(found.value)


def test_friction_at_rest_has_a_slope():
    """Dry friction smoothed over a speed is a damper at rest."""
    made = linearize(line(CoulombFriction(level=0.3, smoothing=0.02)))
    assert made.D[0, 0] == pytest.approx(0.3 / 0.02)


def test_a_point_is_shown_with_units():
    said = str(trim(tsm.load("motor_linear"))).splitlines()
    assert said[1:] == [
        "state        value  unit",
        "motor.angle      0  rad",
        "motor.speed      0  rad/s",
        "input",
        "u                0  V",
    ]


# ---- operating points of loops, and what may be chosen for an equilibrium ----------------------------------


def limited_loop(time=0.0, gain=200.0):
    """A motor under a proportional controller whose drive is at its limit as a step begins."""
    blocks = {
        "r": tsm.blocks.Step(time=time),
        "e": Sum(signs="+-"),
        "k": Gain(gain=gain),
        "drive": tsm.blocks.Saturation(low=-24.0, high=24.0),
        "motor": MotorTransferFunction(),
    }
    wires = ["r -> e.plus", "e -> k -> drive -> motor", "motor.y -> e.minus"]
    return tsm.Diagram(title="loop", blocks=blocks, wires=wires, outputs={"y": "motor.y", "u": "drive"})


def true_phase_margin(gain=200.0):
    motor = MotorTransferFunction()
    return control.margin(gain * control.tf([motor.K], [motor.tau, 1.0, 0.0]))[1]


def test_a_loop_at_a_limit_is_open_and_says_so():
    loop = limited_loop()
    with pytest.warns(tsm.analysis.OperatingPointWarning, match=r"drive\.y \(24\) blocks small changes"):
        loop_gain(loop, "k -> drive")
    with pytest.raises(RunError, match=r"open at the initial states.*point=tsm\.trim"):
        tsm.analysis.margins(loop, "k -> drive")
    begins_later = limited_loop(time=1.0)  # at rest until then
    assert tsm.analysis.margins(begins_later, "k -> drive").phase == pytest.approx(true_phase_margin())


def test_the_end_of_a_run_and_an_equilibrium_are_operating_points_of_a_loop():
    loop = limited_loop()
    for point in (
        tsm.simulate(loop, stop=4.0),
        tsm.simulate(loop, stop=4.0, log="outputs"),
        trim(loop, start={"motor.angle": 0.9}),
    ):
        found = tsm.analysis.margins(loop, "k -> drive", point=point)
        assert found.phase == pytest.approx(true_phase_margin(), rel=1e-6)
        assert found.gain == math.inf
        assert "gain margin none" in str(found)


def test_the_inputs_of_a_run_belong_to_its_operating_point():
    loop = limited_loop().rewire(cut=["r -> e.plus"], inputs={"w": "e.plus"})
    run = tsm.simulate(loop, inputs={"w": 1.0}, stop=0.01)
    assert tsm.analysis.margins(loop, "k", point=tsm.simulate(loop, inputs={"w": 1.0}, stop=4.0)).phase > 10
    with pytest.raises(RunError, match="the loop is open at this point"):
        tsm.analysis.margins(loop, "k", point=run)


def test_a_gain_margin_where_only_rounding_crosses_the_axis_is_none():
    """A third-order lag of relative degree one never turns by 180 deg; python-control may find a crossing at 1e15."""
    blocks = {"e": Sum(signs="+-"), "g": tsm.blocks.TransferFunction(num=[1.0, 3.0, 2.1], den=[1.0, 3.5, 3.5, 1.0])}
    loop = tsm.Diagram(
        title="lag", blocks=blocks, wires=["e -> g -> e.minus"], inputs={"r": "e.plus"}, outputs={"y": "g"}
    )
    assert tsm.analysis.margins(loop, "g").gain == math.inf


def test_a_state_is_held_and_a_parameter_freed_for_an_equilibrium():
    """A mass on a spring: at a given deflection the force, or the stiffness, follows in closed form."""
    blocks = {
        "f": tsm.blocks.Constant(value=3.0),
        "net": Sum(signs="+--"),
        "v": tsm.blocks.Integrator(gain=0.5),
        "x": tsm.blocks.Integrator(),
        "spring": Gain(gain=7.0),
        "damper": Gain(gain=0.3),
    }
    wires = ["f -> net.plus", "net -> v -> x -> spring -> net.minus1", "v -> damper -> net.minus2"]
    d = tsm.Diagram(title="mass", blocks=blocks, wires=wires, outputs={"x": "x"})
    assert trim(d)["x.integral"] == pytest.approx(3.0 / 7.0)
    point = trim(d, at={"x.integral": 0.5}, free=["spring.gain"])
    assert point["x.integral"] == 0.5
    assert point["spring.gain"] == pytest.approx(6.0, rel=1e-12)
    assert point.parameters == {"spring.gain": point["spring.gain"]}
    assert trim(d, outputs={"x": 0.25}, free=["f.value"])["f.value"] == pytest.approx(7.0 / 4.0)
    poles = linearize(d.rewire(inputs={"w": "net.plus"}, cut=["f -> net.plus"]), at=None).poles()
    assert poles.imag.max() > 0
    with pytest.raises(RunError, match=r"no input is free|No input is free"):
        trim(d, at={"x.integral": 0.5})
    with pytest.raises(RunError, match=r"at: 'mass' has no state 'x\.integrall'\. Did you mean 'x\.integral'"):
        trim(d, at={"x.integrall": 0.5})
    with pytest.raises(RunError, match=r"free: 'mass' has no parameter 'spring\.gian'"):
        trim(d, free=["spring.gian"])


def test_a_linear_model_at_a_point_has_the_parameters_that_were_freed():
    diagram = line(tsm.blocks.FirstOrderLag(gain=2.0, time_constant=0.5))
    point = trim(diagram, inputs={"u": 1.5}, outputs={"y": 6.0}, free=["b.gain"])
    assert point["b.gain"] == pytest.approx(4.0)
    assert linearize(diagram, at=point).dcgain() == pytest.approx(4.0)
