"""A step too long for the fastest pole is said once, by whatever runs the diagram, where the user asked for it."""
# ruff: noqa: E501 - the text of a message stands on one line, as the user reads it

import copy
import re
import warnings
from concurrent.futures import ProcessPoolExecutor

import numpy as np
import pytest

import tsmblocks as tsm
from tests.test_studies import lagged
from tsmblocks.blocks import FirstOrderLag, RateLimit, Step
from tsmblocks.cli import main
from tsmblocks.common.rounding import to_digits_below
from tsmblocks.export import to_c
from tsmblocks.simulation.batch import simulate_batch
from tsmblocks.simulation.stability import MOST_CHECKED, StepWarning, extreme_sets
from tsmblocks.simulation.stepper import Stepper
from tsmblocks.studies import latin_hypercube, responses

TOO_LONG = "the step of 0.1 s is too long for the fastest pole (100 rad/s, at lag.value); rk4 needs a step of about 0.027 s there, an implicit method (sdirk2) does not."
LAG = f"diagram 'lag': {TOO_LONG}"
SETS = {"gain.gain": [1.0, 2.0, 0.5], "lag.time_constant": [1.0, 0.01, 0.02]}
WORST = f"{LAG} Of 3 sets of parameters that were checked this concerns 2, most of all gain.gain = 2, lag.time_constant = 0.01."
HOW = dict(stop=1.0, step=0.1)


def quick():
    return lagged().with_parameters({"lag.time_constant": 0.01})


def plan(sets=SETS):
    return tsm.studies.table(sets)


CALLS = {
    "a stepper": (LAG, lambda: Stepper(quick(), step=0.1)),
    "a copy of one": (LAG, lambda: copy.copy(Stepper(quick(), step=0.1))),
    "C code": (LAG, lambda: to_c(quick(), step=0.1)),
    "a batch": (WORST, lambda: simulate_batch(lagged(), SETS, **HOW)),
    "a batch of one": (
        f"{LAG} This is for lag.time_constant = 0.01.",
        lambda: simulate_batch(lagged(), {"lag.time_constant": [0.01]}, **HOW),
    ),
    "a study": (WORST, lambda: tsm.study(lagged(), plan(), "rms(y)", **HOW)),
    "responses": (WORST, lambda: responses(lagged(), plan(), **HOW)),
    "tuning": (
        f"{LAG} Of 3 sets of parameters that were checked this concerns 1, most of all lag.time_constant = 0.01.",
        lambda: tsm.tune(lagged(), {"lag.time_constant": (0.01, 2.0)}, "rms(y)", starts=1, **HOW),
    ),
    "tuning of cases": (
        f"{LAG} Of 4 sets of parameters that were checked this concerns 1, most of all case 'a', lag.time_constant = 0.01.",
        lambda: tsm.tune({"a": lagged(), "b": lagged()}, {"lag.time_constant": (0.01, 2.0)}, "rms(y)", starts=1, **HOW),
    ),
}


@pytest.mark.parametrize("method", ["euler", "heun", "rk4"])
@pytest.mark.parametrize("zeta", [0.05, 0.7, 3.0])
def test_at_the_step_that_is_advised_nothing_is_said(method, zeta):
    """The step was that of a real pole of the size, rounded up: of a swing that decays slowly, 6 times too long."""
    swing = tsm.blocks.SecondOrderLag(omega=100.0, zeta=zeta)
    made = tsm.Diagram(title="swing", blocks={"lag": swing}, inputs={"u": "lag"}, outputs={"y": "lag"})

    def run(step):
        tsm.simulate(made, inputs={"u": lambda t: 0.0 * t}, stop=100 * step, step=step, method=method)

    with pytest.warns(StepWarning) as given:
        run(1.0)
    step = float(re.search(r"needs a step of about (\S+) s there", str(given[0].message))[1])
    with warnings.catch_warnings():
        warnings.simplefilter("error", StepWarning)
        run(step)
    with pytest.warns(StepWarning):
        run(1.15 * step)


@pytest.mark.parametrize(("value", "said"), [(0.02785, "0.027"), (0.5, "0.5"), (1234.0, "1200"), (0.0, "0")])
def test_a_largest_value_is_rounded_down(value, said):
    assert to_digits_below(value) == said


@pytest.mark.parametrize("call", CALLS)
def test_whatever_runs_a_diagram_says_so_once_and_where_it_was_asked_for(call):
    said, make = CALLS[call]
    with pytest.warns(StepWarning) as warned:
        make()
    assert [str(one.message) for one in warned] == [said]
    assert warned[0].filename == __file__


@pytest.mark.parametrize(("method", "step"), [("rk4", 0.027), ("euler", 0.019)])
def test_a_step_that_is_short_enough_is_none(method, step):
    Stepper(quick(), step=step, method=method)
    to_c(quick(), step=step, method=method)
    tsm.study(lagged(), plan(), "rms(y)", stop=1.0, step=step, method=method)


def test_many_runs_on_many_processes_say_it_once():
    many = latin_hypercube({"gain.gain": (1.0, 2.0), "lag.time_constant": (0.01, 0.02)}, 600)
    with ProcessPoolExecutor(2) as pool, pytest.warns(StepWarning, match="Of [345] sets .* concerns [345],") as warned:
        tsm.study(lagged(), many, "rms(y)", executor=pool, **HOW)
    assert len(warned) == 1


def test_of_many_sets_a_few_are_looked_at():
    rng = np.random.default_rng(0)
    assert extreme_sets({"a": np.array([2.0, 3.0, 1.0, 2.5]), "b": np.array(["x", "y", "x", "y"], object)}) == [0, 2, 1]
    assert len(extreme_sets({str(k): rng.random(1000) for k in range(50)})) == MOST_CHECKED


def test_options_that_make_other_equations_are_looked_at_too():
    blocks = {"step": Step(), "slow": RateLimit(), "lag": FirstOrderLag(time_constant=0.01)}
    diagram = tsm.Diagram(title="lag", blocks=blocks, wires=["step -> slow -> lag"], outputs={"y": "lag"})
    with pytest.warns(StepWarning, match=r"Of 2 sets .* concerns 2, most of all slow\.start = 'input'\.$"):
        tsm.study(diagram, {"slow.start": ["input", "last"]}, "rms(y)", **HOW)


def test_the_command_that_writes_c_says_so(tmp_path, capsys):
    out = tmp_path / "x.c"
    with warnings.catch_warnings():
        warnings.simplefilter("always")
        assert main(["export", "fig16_feedforward_feedback", "--out", str(out), "--step", "0.01"]) == 0
    assert " ".join(capsys.readouterr().err.split()) == (
        "tsmblocks: warning: diagram 'Feedforward plus PID feedback of the tip': the step of 0.01 s is too long for the fastest "
        "pole (424 rad/s, at motor.speed); rk4 needs a step of about 0.0065 s there, an implicit method (sdirk2) does not."
    )
