"""Every form of kernel, in registers or in pieces, single or on lanes, explicit or implicit, on small runs."""

import sys
from pathlib import Path

import casadi as ca
import numpy as np
import pytest

import tsmblocks as tsm
from tests.test_engine import everything
from tests.tolerances import BACKENDS, EXACT
from tsmblocks.blocks import Constant, Integrator, Sine
from tsmblocks.compiler.compile import compile_diagram
from tsmblocks.engine import code_cache, jit, session
from tsmblocks.model.block import Block, Input, Output, State, block, parameter, state

STEPS = {"stop": 0.2, "step": 1e-3}


@pytest.fixture
def in_pieces(monkeypatch):
    """Kernels in the form of large diagrams, whatever their size."""
    session.single_kernel.cache_clear()
    monkeypatch.setattr("tsmblocks.engine.backends.LARGE_OPERATIONS", 0)
    yield
    session.single_kernel.cache_clear()


@pytest.mark.parametrize("method", ["rk4", "sdirk3"])
def test_one_of_each_in_pieces(method, in_pieces):
    sets = {"lag.time_constant": [0.1, 0.2, 0.3], "delay.time": [0.0337, 0.05, 0.01], "tsm.theta": [2.0, 5.0, 8.0]}
    batch = tsm.simulate_batch(everything(), sets, method=method, **STEPS)
    for k in range(3):
        one = {name: values[k] for name, values in sets.items()}
        run = tsm.simulate(everything(), method=method, parameters=one, **STEPS)
        plain = tsm.simulate(everything(), method=method, parameters=one, backend="casadi", **STEPS)
        for name in run.aliases:
            assert np.abs(run[name] - plain[name]).max() < BACKENDS, name
            assert np.abs(batch[name][k] - plain[name]).max() < BACKENDS, name


@tsm.function_block(register=False)
def angles(u, k=0.5):
    """Functions that lanes have no instructions for."""
    return ca.atan2(u, k) + ca.asin(k * u / 2) + ca.fmod(u, k) + ca.log1p(k * u * u)


def test_lanes_compute_functions_of_libm_one_by_one():
    d = tsm.Diagram(
        title="libm", blocks={"s": Sine(frequency=3.0), "a": angles()}, wires=["s -> a"], outputs={"y": "a", "u": "s"}
    )
    k = np.array([0.3, 0.5, 0.7, 0.9])
    batch = tsm.simulate_batch(d, {"a.k": k}, **STEPS)
    u = batch["u"]
    k = k[:, None]
    expected = np.arctan2(u, k) + np.arcsin(k * u / 2) + np.fmod(u, k) + np.log1p(k * u * u)
    assert np.abs(batch["y"] - expected).max() < EXACT


@block(register=False)
class Still(Block):
    """A state that never moves and an output that is always zero: results without any operation."""

    scale: float = parameter(default=1.0, about="scale")
    z: State = state(default=3.0, about="what stays")
    u = Input("in")
    y = Output("nothing")
    kept = Output("what stays")

    def outputs(self, t, x, u):
        return dict(y=ca.SX(1, 1), kept=self.scale * x.z)  # as a derivative that CasADi finds to be zero

    def derivatives(self, t, x, u):
        return dict(z=ca.jacobian(u.u, x.z))


@pytest.mark.parametrize("form", ["registers", "pieces"])
@pytest.mark.parametrize("method", ["euler", "rk4", "sdirk3"])
def test_results_that_are_zero_whatever_happens(form, method, request):
    if form == "pieces":
        request.getfixturevalue("in_pieces")
    d = tsm.Diagram(
        title="still", blocks={"s": Sine(), "q": Still()}, wires=["s -> q"], outputs={"y": "q.y", "kept": "q.kept"}
    )
    run = tsm.simulate(d, method=method, **STEPS)
    assert (set(run["y"]), set(run["kept"])) == ({0.0}, {3.0})
    batch = tsm.simulate_batch(d, {"q.scale": [1.0, 2.0, 4.0]}, method=method, **STEPS)
    assert [set(row) for row in batch["kept"]] == [{3.0}, {6.0}, {12.0}]
    assert not batch["y"].any()


@pytest.mark.parametrize("backend", ["llvm", "casadi"])
def test_single_steps_are_those_of_a_run(backend):
    d = tsm.load("motor_linear")
    inputs = np.sin(np.arange(201))
    run = tsm.simulate(d, inputs={"u": inputs}, hold="zero", backend=backend, **STEPS)
    stepper = tsm.Stepper(d, step=STEPS["step"], backend=backend)
    for k in range(20):
        assert abs(stepper.step({"u": inputs[k]})["x"] - run["x"][k + 1]) < BACKENDS


def test_numbers_whose_sum_is_infinite_are_finite():
    d = tsm.Diagram(
        title="large", blocks={"a": Constant(value=1.5e308), "b": Constant(value=1.5e308)}, outputs={"a": "a", "b": "b"}
    )
    run = tsm.simulate(d, **STEPS)
    assert len(run.t) == 201
    assert set(run["a"] - run["b"]) == {0.0}


@pytest.mark.parametrize("backend", ["llvm", "casadi"])
def test_memory_may_begin_at_other_values(backend):
    run = tsm.simulate(everything(), backend=backend, **STEPS)
    later = tsm.simulate(everything(), backend=backend, initial={"play.m": 0.07, "lag.value": 0.2}, **STEPS)
    assert (run["played"][0], later["played"][0], later["y"][0]) == (0.0, 0.07, 0.2)


def test_what_equations_and_sensitivities_say_of_themselves():
    d = tsm.Diagram(title="ramp", blocks={"c": Constant(), "i": Integrator()}, wires=["c -> i"], outputs={"y": "i"})
    found = tsm.sensitivities(d, ["c.value"], **STEPS)
    assert repr(found) == "Sensitivities(y by c.value, 201 instants)"
    equations = compile_diagram(d)
    assert repr(equations) == "Equations('ramp', 1 states, 5 parameters, outputs y)"
    assert equations.outputs == ("y",)


# ---- where machine code is kept, and where there is none


def test_the_cache_is_switched_off_or_has_no_place(monkeypatch):
    monkeypatch.setenv("TSMBLOCKS_CACHE", "off")
    assert code_cache.cache_directory() is None
    monkeypatch.delenv("TSMBLOCKS_CACHE")
    monkeypatch.delenv("XDG_CACHE_HOME", raising=False)
    monkeypatch.setattr("sys.platform", "linux")

    def nowhere():
        raise RuntimeError("Could not determine home directory.")

    monkeypatch.setattr(Path, "home", nowhere)
    assert code_cache.cache_directory() is None


@pytest.mark.parametrize(("variable", "modules"), [("casadi", {}), ("", {"llvmlite.binding": None})])
def test_without_a_compiler_runs_are_interpreted(variable, modules, monkeypatch):
    monkeypatch.setenv("TSMBLOCKS_ENGINE", variable)
    for name, module in modules.items():
        monkeypatch.setitem(sys.modules, name, module)
    assert not jit.available()
