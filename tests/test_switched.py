"""Diagrams that are switched on and off, against solve_ivp from switch to switch, and recursions by hand."""

import itertools

import numpy as np
import pytest
from scipy.integrate import solve_ivp

import tsmblocks as tsm
from tests.test_export import c_rows, engine_rows, needs_compiler
from tsmblocks.blocks import (
    Comparison,
    Constant,
    Delay,
    DiscreteIntegrator,
    Enable,
    FirstOrderLag,
    Gain,
    Integrator,
    Play,
    Relay,
    Sine,
    Step,
    Sum,
    Trigger,
    UnitDelay,
)
from tsmblocks.common.errors import DiagramError, RunError

START, LEVEL, LAG = 0.2, 0.2, 0.2


def part(**options):
    """An integral and twice the input beside it, switched on and off."""
    return tsm.Diagram(
        title="part",
        blocks=dict(enable=Enable(**options), i=Integrator(integral=START), g=Gain(gain=2.0), s=Sum(signs="++")),
        wires=["i -> s.plus1", "g -> s.plus2"],
        inputs=dict(u=["i", "g"], on="enable.u"),
        outputs=dict(y="s", z="i"),
    )


def whole(**options):
    return tsm.Diagram(
        title="whole",
        blocks=dict(
            a=Sine(amplitude=1.0, frequency=0.3, phase=1.0),
            c=Sine(amplitude=1.0, frequency=0.5),
            above=Comparison(level=LEVEL),
            part=part(**options),
            lag=FirstOrderLag(time_constant=LAG),
        ),
        wires=["a -> part.u", "c -> above -> part.on", "part.y -> lag"],
        outputs=dict(lag="lag", y="part.y", z="part.z"),
    )


def reference(restart, while_off, stop, step):
    """The same by solve_ivp, one call for each stretch between switches, whose instants are known exactly."""

    def signal(t):
        return np.sin(0.6 * np.pi * t + 1.0)

    begins = np.arcsin(LEVEL) / np.pi
    switches = [k + one for k in np.arange(0, stop, 2.0) for one in (begins, 1.0 - begins)]
    edges = [0.0, *(t for t in switches if t < stop), stop]
    i, lag, held = START, 0.0, np.zeros(2)
    grid, rows = step * np.arange(round(stop / step) + 1), []
    for a, b in itertools.pairwise(edges):
        on = np.sin(0.5 * np.pi * (a + b)) > LEVEL
        i = START if on and restart == "reset" else i

        def outputs(t, i, on=on, held=held):
            off = held if while_off == "hold" else np.zeros(2)
            return np.array([i + 2 * signal(t), i]) if on else off

        def rates(t, x, on=on, outputs=outputs):
            return [signal(t) if on else 0.0, (outputs(t, x[0])[0] - x[1]) / LAG]

        here = grid[(grid >= a) & ((grid < b) | (b == stop))]
        found = solve_ivp(rates, (a, b), [i, lag], t_eval=[*here[here < b], b], rtol=1e-11, atol=1e-13)
        rows += [[x[1], *outputs(t, x[0])] for t, x in zip(here, found.y.T[: len(here)], strict=True)]
        i, lag = found.y[:, -1]
        held = outputs(b, i) if on else held
    return np.array(rows)


BOTH = [(restart, while_off) for restart in ("hold", "reset") for while_off in ("hold", "reset")]


@pytest.mark.parametrize("backend", ["llvm", "casadi"])
@pytest.mark.parametrize(("restart", "while_off"), BOTH)
def test_located_switches_are_exact(restart, while_off, backend):
    d, expected = whole(restart=restart, while_off=while_off), reference(restart, while_off, 4.0, 0.01)
    run = tsm.simulate(d, stop=4.0, step=0.01, locate=True, backend=backend)
    assert run["y"] == pytest.approx(expected[:, 1], abs=1e-9)
    assert run["z"] == pytest.approx(expected[:, 2], abs=1e-9)
    assert run["lag"] == pytest.approx(expected[:, 0], abs=2e-7)  # of the method, behind a jump
    switched = sorted({round(e.t, 6) for e in run.events})
    assert switched == pytest.approx([0.064094, 0.935906, 2.064094, 2.935906], abs=1e-6)


def test_implicit_methods_locate_them_too():
    expected = reference("reset", "hold", 4.0, 0.01)
    d = whole(restart="reset")
    run = tsm.simulate(d, stop=4.0, step=0.01, locate=True, method="sdirk4")
    found = np.column_stack([run[k] for k in ("lag", "y", "z")])
    assert found == pytest.approx(expected, abs=1e-7)


@pytest.mark.parametrize(("restart", "while_off"), BOTH)
def test_switches_on_the_grid_are_late_by_a_step_at_most(restart, while_off):
    d, errors = whole(restart=restart, while_off=while_off), []
    expected = reference(restart, while_off, 4.0, 0.01)
    for every in (10, 100):
        run = tsm.simulate(d, stop=4.0, step=0.01 / every, every=every)
        errors.append(np.abs(np.column_stack([run[k] for k in ("lag", "y", "z")]) - expected).max(axis=0))
    assert np.all(errors[0] < 5e-3)
    assert np.all(errors[1] < 6e-4)


def test_an_enable_of_its_own_diagram_acts_without_one_around_it():
    run = tsm.simulate(
        part(),
        inputs=dict(u=1.0, on=(np.array([0.0, 0.5, 1.0]), np.array([1.0, 0.0, 0.0]))),
        stop=1.0,
        step=0.05,
        hold="zero",
    )
    assert run["z"] == pytest.approx(START + np.minimum(run.t, 0.5), abs=1e-12)
    assert run["y"] == pytest.approx(run["z"] + 2.0, abs=1e-12)


def sampled(switch, drives=("sum",), outputs=None, **more):
    """A sum of samples of its input, switched by an input, and other blocks."""
    return tsm.Diagram(
        title="sampled",
        blocks=dict(switch=switch, sum=DiscreteIntegrator(period=0.1), **more),
        inputs=dict(u=list(drives), on="switch.u"),
        outputs=outputs or dict(y="sum"),
    )


@pytest.mark.parametrize("restart", ["hold", "reset"])
def test_sampled_blocks_do_not_sample_while_off(restart):
    t = 0.02 * np.arange(101)
    on = ((t > 0.15) & (t < 0.57)) | (t > 1.23)
    run = tsm.simulate(
        sampled(Enable(restart=restart)), inputs=dict(u=1.0, on=(t, on * 1.0)), stop=2.0, step=0.02, hold="zero"
    )
    expected, total, out, was = [], 0.0, 0.0, False
    for k, now in enumerate(on):
        if now and not was and restart == "reset":
            total = out = 0.0
        if now and k % 5 == 0:
            out, total = total, total + 0.1
        was = now
        expected.append(out)
    assert run["y"] == pytest.approx(expected, abs=1e-12)


@pytest.mark.parametrize("locate", [False, True])
def test_a_trigger_acts_once_at_each_rise(locate):
    ports = dict(y="sum", before="last")
    part = sampled(Trigger(initial=(7.0, 8.0)), ["sum", "last"], ports, last=UnitDelay(period=0.1))
    d = tsm.Diagram(
        title="counter",
        blocks=dict(c=Sine(amplitude=1.0, frequency=1.0), u=Sine(amplitude=1.0, frequency=0.21), part=part),
        wires=["c -> part.on", "u -> part.u"],
        outputs=dict(y="part.y", before="part.before"),
    )
    run = tsm.simulate(d, stop=5.0, step=0.01, locate=locate)
    rises = np.arange(5) + 1 / 12 if not locate else np.arange(5) + np.arcsin(0.5) / (2 * np.pi)
    at = np.ceil(rises / 0.01 - 1e-9) * 0.01 if not locate else rises
    taken = np.sin(2 * np.pi * 0.21 * at)
    for k, t in enumerate(run.t):
        count = np.searchsorted(at, t + 1e-9)
        if count:
            assert run["y"][k] == pytest.approx(0.1 * taken[: count - 1].sum(), abs=1e-9)
            assert run["before"][k] == pytest.approx(taken[count - 2] if count > 1 else 0.0, abs=1e-9)
        else:
            assert (run["y"][k], run["before"][k]) == (7.0, 8.0)


def test_a_part_inside_a_part_is_on_where_both_are():
    inner = part()
    middle = tsm.Diagram(
        title="middle",
        blocks=dict(enable=Enable(), part=inner),
        inputs=dict(u="part.u", on="part.on", outer="enable.u"),
        outputs=dict(z="part.z"),
    )
    t = np.arange(0.0, 2.01, 0.1)
    on, outer = 1.0 * (t < 1.25), 1.0 * (np.abs(t - 0.8) > 0.22)
    run = tsm.simulate(middle, inputs=dict(u=1.0, on=(t, on), outer=(t, outer)), stop=2.0, step=0.1, hold="zero")
    expected = START + 0.1 * np.concatenate([[0.0], np.cumsum(on * outer)[:-1]])
    assert run["z"] == pytest.approx(expected, abs=1e-12)
    again = tsm.simulate(
        middle.with_parameters({"enable.restart": "reset"}),
        inputs=dict(u=1.0, on=1.0, outer=(t, outer)),
        stop=2.0,
        step=0.1,
        hold="zero",
    )
    assert again["z"][-1] == pytest.approx(START + 0.9, abs=1e-12)  # anew since 1.1 s


def test_memory_stands_still():
    d = tsm.Diagram(
        title="play",
        blocks=dict(enable=Enable(), play=Play(half_width=0.1)),
        inputs=dict(u="play", on="enable.u"),
        outputs=dict(y="play"),
    )
    t = np.arange(0.0, 1.01, 0.01)
    on = (t < 0.3) | (t > 0.7)
    run = tsm.simulate(d, inputs=dict(u=(t, np.sin(9 * t)), on=(t, 1.0 * on)), stop=1.0, step=0.01, hold="zero")
    expected, z, was = [], 0.0, False
    for now, u in zip(on, np.sin(9 * t), strict=True):
        follows = min(max(z, u - 0.1), u + 0.1)
        z = follows if now else z
        expected.append(follows if now or was else expected[-1] if expected else 0.0)  # its value at that instant
        was = now
    assert run["y"] == pytest.approx(expected, abs=1e-12)


def test_derivatives_batches_and_files():
    d, names = whole(restart="reset"), ["part.i.integral", "part.g.gain", "part.i.gain"]
    made = tsm.sensitivities(d, names, stop=4.0, step=0.01)
    for k, name in enumerate(names):
        at, by = d.parameters[name], 1e-5
        high, low = (tsm.simulate(d, stop=4.0, step=0.01, parameters={name: at + h})["lag"] for h in (by, -by))
        assert made.jacobian[:, 0, k] == pytest.approx((high - low) / (2 * by), abs=1e-8)
        assert np.abs(made.jacobian[:, 0, k]).max() > 0.1
    batch = tsm.simulate_batch(d, {"part.g.gain": [2.0, 3.0]}, stop=4.0, step=0.01)
    assert batch["lag"][0] == pytest.approx(tsm.simulate(d, stop=4.0, step=0.01)["lag"], abs=1e-12)
    assert tsm.loads(tsm.dumps(d)) == d
    assert 'enable = { type = "Enable", restart = "reset" }' in tsm.dumps(d)


@needs_compiler
@pytest.mark.parametrize("d", [part(restart="reset"), part(while_off="reset", initial=(0.5, 0.7)), sampled(Trigger())])
def test_c_code(d, tmp_path):
    t = 0.01 * np.arange(300)
    values = np.column_stack([np.sin(3 * t), 1.0 * (np.sin(7 * t) > 0.3)])
    found = c_rows(d, tmp_path, values, 0.01, 300)
    assert found == pytest.approx(engine_rows(d, ["u", "on"], values, 0.01, 300, "rk4"), abs=1e-12)
    assert np.ptp(found) > 0.05


def test_a_linear_model_takes_the_part_as_it_is():
    d = part(restart="reset")
    on = tsm.linearize(d, at=tsm.simulate(d, inputs=dict(u=0.0, on=1.0), stop=1.0, step=0.1))
    assert (on.A, on.B[:, 0], on.C[0], on.D[0, 0]) == (0.0, 1.0, 1.0, 2.0)
    off = tsm.linearize(d, at=tsm.simulate(d, inputs=dict(u=0.0, on=0.0), stop=1.0, step=0.1))
    assert not np.any(off.B)
    assert not np.any(off.C)
    assert not np.any(off.D)
    point = tsm.trim(d, inputs=dict(u=0.0, on=1.0))
    assert point["i.integral"] == START
    # What is held while off is where the rest of the diagram stands.
    squared = tsm.Diagram(
        title="squared",
        blocks=dict(part=part(), p=tsm.blocks.Square(), g=Gain()),
        wires=["part.z -> p", "p -> g"],
        inputs=dict(u="part.u", on="part.on"),
        outputs=dict(y="g"),
    )
    held = tsm.simulate(
        squared,
        inputs=dict(u=1.0, on=(np.array([0.0, 0.5, 1.0]), np.array([1.0, 0, 0]))),
        stop=1.0,
        step=0.1,
        hold="zero",
    )
    assert held["y"][-1] == pytest.approx((START + 0.5) ** 2)


def test_the_picture_says_that_a_part_is_switched():
    assert "(enabled)" in whole()._repr_svg_()
    assert "(enabled)" not in part()._repr_svg_()
    assert ">enable<" in part()._repr_svg_()


def refused(diagram, **inputs):
    with pytest.raises(DiagramError) as caught:
        tsm.simulate(diagram, inputs=inputs or dict(u=0.0, on=1.0), stop=1.0)
    return list(caught.value.problems)


def test_what_cannot_be_switched():
    assert refused(part(initial=(1.0,))) == [
        "enable.initial needs one value for each output of its diagram, 2 (y, z), got 1."
    ]
    both = part().rewire(blocks={**part().blocks, "t": Trigger()}, inputs={**part().inputs, "tick": "t.u"})
    assert refused(both) == [
        "enable and t both switch their diagram. Keep one, driven by a Logic block that combines the conditions."
    ]
    ports = dict(y="lag", z="past")
    d = sampled(Trigger(), ["sum", "lag", "past"], ports, lag=FirstOrderLag(), past=Delay())
    assert refused(d) == [
        "lag (FirstOrderLag) has a continuous state (value), which cannot change only at the instants of switch. Use "
        "a sampled block, or an Enable instead of the Trigger.",
        "past (Delay) reads past values, which continue while switch is off. Put it outside of this diagram.",
    ]


def test_a_port_that_is_misspelt():
    blocks = dict(part=part(), c=Constant(), on=Step())
    with pytest.raises(DiagramError, match=r"has no input 'onn'\. Did you mean 'on'\?"):
        tsm.Diagram(title="q", blocks=blocks, wires=["on -> part.onn", "c -> part.u"], outputs=dict(y="part.y"))


def test_a_relay_inside_is_switched_too():
    d = tsm.Diagram(
        title="relay",
        blocks=dict(enable=Enable(), r=Relay(on=0.5, off=-0.5, high=1.0, low=-1.0)),
        inputs=dict(u="r", on="enable.u"),
        outputs=dict(y="r"),
    )
    t = np.arange(0.0, 3.01, 0.01)
    run = tsm.simulate(
        d, inputs=dict(u=(t, np.sin(2 * np.pi * t)), on=(t, 1.0 * (t > 1.3))), stop=3.0, step=0.01, hold="zero"
    )
    assert not np.any(run["y"][: np.searchsorted(t, 1.3)])
    assert set(run["y"][t > 1.4]) == {-1.0, 1.0}
    with pytest.raises(RunError, match="r of 'relay' acts at its own instants"):
        tsm.trim(d)
