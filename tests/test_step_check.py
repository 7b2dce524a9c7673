"""A run whose step is too long says so: which signal is wrong, when, by how much, and what would do."""

import json
import re
import sys
import warnings
from pathlib import Path
from types import SimpleNamespace

import numpy as np
import pytest
from scipy.integrate import solve_ivp

import tsmblocks as tsm
from tests.stiff import VanDerPol
from tsmblocks.blocks import (
    DeadTime,
    DiscretePID,
    FirstOrderLag,
    Gain,
    Integrator,
    LuGreFriction,
    Relay,
    Saturation,
    SecondOrderLag,
    Sine,
    Sum,
)
from tsmblocks.cli import main
from tsmblocks.common.errors import NotFinite
from tsmblocks.engine.backends import CompiledKernel
from tsmblocks.engine.methods import method_named
from tsmblocks.engine.zero_crossing import Crossing
from tsmblocks.simulation import step_advice, step_check, step_look
from tsmblocks.simulation.repeated_steps import MOST_TURNS
from tsmblocks.simulation.stability import StepWarning, no_step_warnings

sys.path.insert(0, str(Path(__file__).parent / "benchmarks"))
import step_cases
import step_warnings

LONG = pytest.mark.filterwarnings("error::tsmblocks.simulation.stability.StepWarning")


@pytest.fixture(autouse=True)
def no_verdicts():
    step_check._VERDICTS.clear()


def warned(diagram, **how):
    """The warnings of a run, and the run."""
    with warnings.catch_warnings(record=True) as caught:
        warnings.simplefilter("always")
        run = tsm.simulate(diagram, **how)
    return [str(one.message) for one in caught if issubclass(one.category, StepWarning)], run


def oscillator(mu=1.0):
    return tsm.Diagram(title="van der pol", blocks={"v": VanDerPol(mu=mu)}, outputs={"y": "v"})


def exact(mu, t):
    def slope(_, x):
        return [x[1], mu * (1 - x[0] ** 2) * x[1] - x[0]]

    return solve_ivp(slope, (0, t[-1]), [2.0, 0.0], "DOP853", t_eval=t, rtol=1e-12, atol=1e-12).y


def sledge(sigma0=1e4, sigma1=50.0):
    rubbing = LuGreFriction(sigma0=sigma0, sigma1=sigma1, coulomb=1.0, static=1.3, stribeck=0.01)
    blocks = {"force": Sine(amplitude=2.0, frequency=0.5), "sum": Sum(signs="+-"), "mass": Integrator()}
    blocks |= {"friction": rubbing, "place": Integrator()}
    wires = ["force -> sum.plus", "sum -> mass -> friction -> sum.minus", "mass -> place"]
    return tsm.Diagram(title="a sledge", blocks=blocks, wires=wires, outputs={"x": "place"})


def loop(late=None):
    """A smooth loop with a limit, and dead time in it where asked for."""
    blocks = {
        "ref": Sine(amplitude=1.0, frequency=0.2),
        "sum": Sum(signs="+-"),
        "limit": Saturation(low=-0.6, high=0.6),
    }
    blocks |= {"plant": SecondOrderLag(omega=5.0, zeta=0.4), "gain": Gain(gain=0.8)}
    chain = "sum -> limit -> plant"
    if late is not None:
        blocks["late"] = late
        chain += " -> late"
    wires = ["ref -> sum.plus", f"{chain} -> gain -> sum.minus"]
    return tsm.Diagram(title="loop", blocks=blocks, wires=wires, outputs={"y": "plant"})


# ---- what is said


def test_a_limit_cycle_that_drifts_is_said_with_a_step_that_would_do():
    said, run = warned(oscillator(10.0), stop=50.0, step=0.02)
    assert len(said) == 1
    assert said[0].startswith(
        "diagram 'van der pol': the step of 0.02 s is too long for this run: v.y is -1.092 at t = 47.26 s, where "
        "shorter steps give -1.121 (it is off by 1.4 % of its largest value). It begins to differ at t = 18.4 s."
    )
    assert said[0].endswith("A step of 0.005 s would do.")
    right = exact(10.0, run.t)
    at = np.argmax(np.abs(run["v.y"] - right[0]))
    assert run.t[at] == pytest.approx(47.26)
    assert right[0][at] == pytest.approx(-1.121, abs=1e-3)
    said, run = warned(oscillator(10.0), stop=50.0, step=0.005)
    assert said == []
    assert np.abs(run["y"] - exact(10.0, run.t)[0]).max() < 2.0 * 5e-4


def test_an_error_of_one_per_mille_is_said():
    said, run = warned(oscillator(), stop=50.0, step=0.1)
    off = np.abs(run["y"] - exact(1.0, run.t)[0]).max() / 2.0
    assert 5e-4 < off < 2e-3
    assert len(said) == 1


def test_a_result_beyond_all_measure_is_said():
    with pytest.raises(NotFinite) as caught:
        tsm.simulate(sledge(), stop=5.0, step=0.003)
    last = caught.value.run.t[-1]  # a run to there is finite
    said, run = warned(sledge(), stop=last, step=0.003)
    assert np.abs(run["friction.z"]).max() > 1.0  # 1.3e-4 in truth
    assert len(said) == 1
    assert "times its largest value). It begins to differ at t = 0" in said[0]
    said, run = warned(sledge(), stop=5.0, step=1e-3)
    assert "friction.z is " in said[0]
    assert said[0].endswith(" A step of 0.0005 s would do.")
    said, run = warned(sledge(), stop=5.0, step=5e-4)
    assert said == []
    assert np.abs(run["friction.z"]).max() < 1.31e-4


def relay_loop(width=0.2):
    blocks = {
        "ref": Sine(amplitude=1.0, frequency=0.3),
        "sum": Sum(signs="+-"),
        "lag": FirstOrderLag(time_constant=0.5),
    }
    blocks["relay"] = Relay(on=width, off=-width, high=1.0, low=-1.0)
    wires = ["ref -> sum.plus", "sum -> relay -> lag -> sum.minus"]
    return tsm.Diagram(title="two points", blocks=blocks, wires=wires, outputs={"y": "lag"})


def test_what_arises_at_switches_is_said_to_be_located():
    diagram = relay_loop()
    said, _ = warned(diagram, stop=5.0, step=0.01)
    assert len(said) == 1
    assert "or locate=True at this step (the error arises where limits and signs switch" in said[0]
    assert warned(diagram, stop=5.0, step=0.01, locate=True)[0] == []


def test_switches_are_located_in_a_few_steps_at_most_to_find_what_would_do(monkeypatch):
    """A run of 500 switches is warned of; how it would go with located switches is not tried to the end."""
    count, step = [0], Crossing.step

    def counted(*args):
        count[0] += 1
        return step(*args)

    monkeypatch.setattr(Crossing, "step", counted)
    said, _ = warned(relay_loop(0.01), stop=12.0, step=0.004)
    assert len(said) == 1
    assert 0 < count[0] <= 2 * MOST_TURNS


def test_a_method_of_low_order_is_said_to_need_another():
    said, _ = warned(oscillator(), stop=20.0, step=0.02, method="euler")
    assert len(said) == 1
    assert said[0].endswith("or method='rk4' at this step would do.")
    assert warned(oscillator(), stop=20.0, step=0.02)[0] == []


def test_a_stiff_diagram_is_said_to_need_an_implicit_method():
    """A lag becomes stiff as the signal that sets its rate grows: from nothing to 10,000 rad/s in the end."""
    blocks = {"ref": Sine(amplitude=1.0, frequency=0.2), "sum": Sum(signs="+-"), "rate": tsm.blocks.Ramp(slope=4000.0)}
    blocks |= {"limit": Saturation(low=-1.0, high=1.0), "product": tsm.blocks.Product(n=2)}
    blocks |= {"lag": Integrator(), "after": FirstOrderLag(time_constant=0.2)}
    wires = ["ref -> sum.plus", "sum -> limit -> product.u1", "rate -> product.u2"]
    wires += ["product -> lag -> sum.minus", "lag -> after"]
    diagram = tsm.Diagram(title="stiffer", blocks=blocks, wires=wires, outputs={"y": "after"})
    said, _ = warned(diagram, stop=2.5, step=0.003)
    assert len(said) == 1
    assert "method='sdirk4' at this step (the diagram is stiff)" in said[0]
    assert warned(diagram, stop=2.5, step=0.003, method="sdirk4")[0] == []


def test_a_chaotic_run_is_said_not_to_settle():
    pair = "-> ".join
    blocks = {"x": Integrator(integral=1.0), "y": Integrator(integral=1.0), "z": Integrator(integral=1.0)}
    blocks |= {
        "dx": Sum(signs="+-"),
        "s": Gain(gain=10.0),
        "r": Gain(gain=28.0),
        "dy": Sum(signs="+--"),
        "b": Gain(gain=8 / 3),
    }
    blocks |= {"xz": tsm.blocks.Product(n=2), "xy": tsm.blocks.Product(n=2), "dz": Sum(signs="+-")}
    wires = ["y -> dx.plus", "x -> dx.minus", pair(["dx ", "s ", "x"]), "x -> r -> dy.plus", "y -> dy.minus1"]
    wires += ["x -> xz.u1", "z -> xz.u2", "xz -> dy.minus2", "dy -> y", "x -> xy.u1", "y -> xy.u2", "xy -> dz.plus"]
    wires += ["z -> b -> dz.minus", "dz -> z"]
    lorenz = tsm.Diagram(title="lorenz", blocks=blocks, wires=wires, outputs={"x": "x"})
    said, _ = warned(lorenz, stop=60.0, step=0.01)
    assert len(said) == 1
    assert "results do not settle: the diagram may be chaotic" in said[0]


@pytest.mark.parametrize(("gaps", "step"), [((0.4, 0.2, 0.1), 2.0**-10), ((0.9, 0.63, 0.44), None)])
def test_a_step_is_predicted_only_where_it_is_not_shorter_beyond_reason(gaps, step):
    """At order 1 eight more halvings leave 0.1 / 256; at order 1/2 it would take twenty."""
    plan = SimpleNamespace(method=method_named("rk4"))
    session = SimpleNamespace(h=1.0, kernel=SimpleNamespace(plan=plan))
    found = SimpleNamespace(run=SimpleNamespace(session=session), gaps=gaps, part=SimpleNamespace(n=10), states=None)
    found.error = lambda _: np.zeros(1)
    assert step_advice.advice(found, 5e-4).step == step


# ---- when nothing is said


@LONG
@pytest.mark.parametrize("name", ["fig09a_without_feedforward", "fig09b_feedforward", "fig16_feedforward_feedback"])
def test_nothing_is_said_of_the_figures_of_the_paper(name):
    tsm.simulate(tsm.load(name), stop=20.0)


def test_it_can_be_left_out(tmp_path, capsys):
    how = dict(stop=50.0, step=0.05)
    assert len(warned(oscillator(10.0), **how)[0]) == 1
    assert warned(oscillator(10.0), **how, check_step=False)[0] == []
    with no_step_warnings():
        assert warned(oscillator(10.0), **how)[0] == []
    path = tmp_path / "sledge.toml"
    tsm.save(sledge(), path)
    command = ["run", str(path), "--stop", "5", "--step", "0.001", "--json"]
    with warnings.catch_warnings():
        warnings.simplefilter("always")
        assert main(command) == 0
        out, err = capsys.readouterr()
        assert "x" in json.loads(out)["outputs"]
        assert "tsmblocks: warning: diagram 'a sledge': the step of 0.001 s is too long" in " ".join(err.split())
        assert main([*command, "--no-step-check"]) == 0
    assert capsys.readouterr().err == ""


def test_of_poles_and_of_the_run_there_is_one_warning():
    """Stiff at the start, where it grows for a moment, and wrong by far later on."""
    said, _ = warned(oscillator(10.0), stop=0.5, step=0.1)
    assert len(said) == 1
    assert "needs a step of about" in said[0]
    assert re.search(r"there, an implicit method \(sdirk2\) does not\. In this run v\.\w+ is \S+ at t = ", said[0])
    assert re.search(r"\. A step of 0\.0\d+ s .*would do\.$", said[0])
    plain, _ = warned(oscillator(10.0), stop=0.5, step=0.1, check_step=False)
    assert said[0].startswith(plain[0])


# ---- however it is run


@pytest.mark.parametrize(
    "how",
    [
        dict(log="outputs"),
        dict(every=7),
        dict(log="outputs", every=10),
        dict(stop_when="y > 1e3"),
        dict(backend="casadi"),
        dict(start=3.0, stop=53.0),
    ],
    ids=str,
)
def test_it_is_said_however_the_run_is_kept(how):
    said, _ = warned(oscillator(10.0), **(dict(stop=50.0, step=0.05) | how))
    assert len(said) == 1


def test_it_does_not_change_the_run():
    how = dict(stop=40.0, step=1e-3, log="outputs")
    for diagram in (loop(), loop(DeadTime(time=0.0503)), tsm.load("fig16_feedforward_feedback")):
        one, two = tsm.simulate(diagram, **how), tsm.simulate(diagram, **how, check_step=False)
        assert np.array_equal(one.rows, two.rows)
        assert np.array_equal(one.state.memory.x, two.state.memory.x)


def test_a_run_that_goes_on_from_another_is_checked_too():
    said, first = warned(oscillator(10.0), stop=10.0, step=0.02)
    assert said == []
    assert len(warned(oscillator(10.0), initial=first.state, stop=50.0, step=0.02)[0]) == 1
    _, fine = warned(oscillator(10.0), stop=10.0, step=0.005)
    assert warned(oscillator(10.0), initial=fine.state, stop=50.0, step=0.005)[0] == []


def test_of_a_long_run_parts_are_taken_again():
    said, run = warned(oscillator(10.0), stop=1000.0, step=0.02)
    assert len(run.t) > 4 * step_check.WHOLE_STEPS
    assert len(said) == 1
    assert warned(oscillator(1.0), stop=400.0, step=0.01)[0] == []


@LONG
@pytest.mark.parametrize("late", [DeadTime(time=0.0503), tsm.blocks.Delay(time=0.05)], ids=["DeadTime", "Delay"])
@pytest.mark.parametrize("stop", [5.0, 40.0])
def test_the_past_of_delays_is_taken_along(late, stop, monkeypatch):
    """In steps of half and of twice the length, from the middle of a run, the past must be that of the run."""
    gaps = []
    look = step_look.looks_at

    def seen(run, parts, finer):
        gaps.extend(one.most for f in (0.5, 2.0) for one in look(run, parts, f))
        return look(run, parts, finer)

    monkeypatch.setattr(step_look, "looks_at", seen)
    tsm.simulate(loop(late), stop=stop, step=1e-3)
    assert len(gaps) == 2 if stop < 8 else len(gaps) >= 2 * 9
    assert max(gaps) < 2e-5


@LONG
def test_a_run_that_goes_on_between_two_instants_that_are_kept_is_compared_where_they_are():
    how = dict(step=1e-3, every=10)
    _, first = warned(oscillator(), stop=1.005, **how)
    for stop in (1.205, 21.005):
        assert warned(oscillator(), initial=first.state, stop=stop, **how)[0] == []


def test_a_transient_in_the_midst_of_a_long_run_is_looked_at():
    blocks = {"step": tsm.blocks.Step(time=11.5, after=1.0), "plant": SecondOrderLag(omega=800.0, zeta=0.3)}
    diagram = tsm.Diagram(title="late", blocks=blocks, wires=["step -> plant"], outputs={"y": "plant"})
    for how in (dict(log="all"), dict(log="outputs")):
        said, _ = warned(diagram, stop=20.0, step=1e-3, **how)
        assert len(said) == 1
        assert "It begins to differ at t = 11.5" in said[0]


def test_where_an_error_grows_up_to_the_end_of_what_was_looked_at_it_is_followed():
    case = step_cases.build(7108)
    assert case.stop / case.step > 2 * step_look.WHOLE_STEPS
    assert len(warned(case.diagram, **case.run)[0]) == 1


@pytest.mark.parametrize("seed", [4111, 4178])
def test_a_run_with_more_located_switches_than_are_located_again_is_compared_with_steps_that_do_not_locate(seed):
    case = step_cases.build(seed)
    assert case.locate
    assert len(warned(case.diagram, **case.run)[0]) == 1
    warned(case.diagram, **case.run, log="outputs")  # states are not known there: nothing can be said


@pytest.fixture
def taken(monkeypatch):
    """The steps of each call of a compiled kernel, as they are taken."""
    taken = []
    advance = CompiledKernel.advance

    def counted(self, memory, u, y, steps):
        taken.append(steps.n)
        advance(self, memory, u, y, steps)

    monkeypatch.setattr(CompiledKernel, "advance", counted)
    return taken


@LONG
@pytest.mark.parametrize("name", ["fig16_feedforward_feedback", "fig09b_feedforward"])
@pytest.mark.parametrize("stop", [20.0, 100.0])
def test_a_long_run_is_checked_in_a_third_of_its_steps(name, stop, taken):
    tsm.simulate(tsm.load(name), stop=stop)
    assert 1000 * stop < sum(taken) < 1.34 * 1000 * stop
    assert len(taken) < 110


def test_the_same_run_is_checked_once(monkeypatch):
    looked = []
    verdict = step_check.verdict
    monkeypatch.setattr(step_check, "verdict", lambda run: looked.append(1) or verdict(run))
    driven = tsm.Diagram(title="lag", blocks={"lag": FirstOrderLag()}, inputs={"u": "lag"}, outputs={"y": "lag"})
    t = np.linspace(0.0, 1.0, 1001)
    for size in (1.0, 1.0, 2.0):
        tsm.simulate(driven, stop=1.0, inputs={"u": size * np.sin(3 * t)})
    assert len(looked) == 2
    tsm.simulate(driven, stop=1.0, inputs={"u": np.sin(3 * t)}, parameters={"lag.time_constant": 0.06})
    assert len(looked) == 3
    for _ in range(2):
        assert len(warned(oscillator(10.0), stop=50.0, step=0.05)[0]) == 1
    assert len(looked) == 4


def test_a_sampled_controller_at_every_step_is_taken_in_half_steps():
    blocks = {
        "ref": Sine(amplitude=1.0, frequency=0.5),
        "sum": Sum(signs="+-"),
        "plant": SecondOrderLag(omega=20.0, zeta=0.1),
    }
    blocks["pid"] = DiscretePID(kp=2.0, period=0.02)
    wires = ["ref -> sum.plus", "sum -> pid -> plant -> sum.minus"]
    diagram = tsm.Diagram(title="sampled", blocks=blocks, wires=wires, outputs={"y": "plant"})
    assert warned(diagram, stop=5.0, step=0.005)[0] == []
    said, _ = warned(diagram, stop=5.0, step=0.02)
    assert len(said) == 1


# ---- of many sets


MU = {"v.mu": [0.1, 1.0, 5.0]}
ONE_OF_THREE = " Of 3 sets of parameters that were checked this concerns 1, most of all v.mu = 5."


def batches(step, **how):
    return {
        "batch": lambda: tsm.simulate_batch(oscillator(), MU, stop=50.0, step=step, **how),
        "study": lambda: tsm.study(oscillator(), MU, "rms(y)", stop=50.0, step=step, **how),
        "responses": lambda: tsm.studies.responses(oscillator(), tsm.studies.table(MU), stop=50.0, step=step, **how),
    }


@pytest.mark.parametrize("kind", ["batch", "study", "responses"])
@pytest.mark.parametrize("backend", ["", "casadi"])
def test_of_many_sets_the_worst_is_said_in_one_warning(kind, backend):
    with pytest.warns(StepWarning) as caught:
        batches(0.1, backend=backend)[kind]()
    assert len(caught) == 1
    said = str(caught[0].message)
    assert said.startswith("diagram 'van der pol': the step of 0.1 s is too long for this run: v.")
    assert said.endswith(ONE_OF_THREE)
    assert Path(caught[0].filename) == Path(__file__)
    with warnings.catch_warnings():
        warnings.simplefilter("error", StepWarning)
        batches(0.005, backend=backend)[kind]()
        with no_step_warnings():
            batches(0.1, backend=backend)[kind]()


def test_tuning_says_it_of_its_bounds():
    def tuned(step):
        tsm.tune(oscillator(), {"v.mu": (0.5, 5.0)}, "rms(y)", stop=20.0, step=step, starts=1)

    with pytest.warns(StepWarning) as caught:
        tuned(0.1)
    assert [Path(one.filename) for one in caught] == [Path(__file__)]
    assert str(caught[0].message).endswith("this concerns 1, most of all v.mu = 5.")
    with warnings.catch_warnings():
        warnings.simplefilter("error", StepWarning)
        tuned(0.005)


def test_the_error_that_is_said_of_a_set_is_that_of_its_run():
    with pytest.warns(StepWarning) as caught:
        batches(0.1)["batch"]()
    said, _ = warned(oscillator(5.0), stop=50.0, step=0.1)
    assert str(caught[0].message) == said[0] + ONE_OF_THREE


@pytest.mark.parametrize("sets", [200, 2000])
def test_a_batch_is_checked_in_a_tenth_of_its_steps(sets, taken):
    gains = {"pid.kp": np.linspace(0.5, 2.0, sets)}
    tsm.simulate_batch(tsm.load("fig16_feedforward_feedback"), gains, stop=2.0, outputs=["x_out"])
    groups = -(-sets // 32)
    assert groups * 2000 < sum(taken) < 1.1 * groups * 2000


@LONG
def test_inputs_that_are_held_and_signals_that_jump_are_no_error_of_the_step():
    blocks = {"lag": FirstOrderLag(time_constant=0.5), "relay": Relay(on=0.5, off=-0.5)}
    wires = ["lag -> relay"]
    diagram = tsm.Diagram(
        title="held", blocks=blocks, wires=wires, inputs={"u": "lag"}, outputs={"y": "lag", "z": "relay"}
    )
    t = np.arange(0.0, 5.0, 0.01)
    u = np.sign(np.sin(2 * t))
    sets = {"lag.time_constant": np.linspace(0.3, 1.0, 40)}
    for hold in ("zero", "linear"):
        tsm.simulate_batch(diagram, sets, inputs={"u": (t, u)}, hold=hold, stop=4.9, step=0.005)


# ---- on random diagrams


def test_on_random_diagrams_what_is_wrong_is_said_and_what_is_right_is_not():
    """The benchmark tests/benchmarks/step_warnings.py, bounded: its seeds were not looked at while this was made."""
    found = [step_warnings.outcome(seed) for seed in range(3000, 3030)]
    wrong = [one["warned"] for one in found if one["outcome"] == "wrong"]
    right = [one["warned"] for one in found if one["outcome"] == "right"]
    assert len(wrong) >= 8
    assert len(right) >= 4
    assert all(wrong)
    assert not any(right)
