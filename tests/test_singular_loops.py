"""Linear algebraic loops whose gain passes 1 between two steps: found at the instant known in closed form, or not."""

import re

import numpy as np
import pytest

import tsmblocks as tsm
from tests.test_loops import Cubic
from tsmblocks.blocks import Constant, Gain, Integrator, Product, Ramp, Saturation, Sine, Step, Sum
from tsmblocks.simulation.singular_loops import LoopWarning


def loop(gain, *, signs="++", more=(), wires=(), **blocks):
    """e = 1 + k e, with the gain k of a block."""
    second = "plus2" if signs == "++" else "minus"
    first = "plus1" if signs == "++" else "plus"
    return tsm.Diagram(
        title="loop",
        blocks=dict(one=Constant(value=1.0), k=gain, m=Product(), e=Sum(signs=signs), i=Integrator(), **blocks),
        wires=[f"one -> e.{first}", "e -> m.u1, i", "k -> m.u2", f"m -> e.{second}", *wires],
        outputs={"y": "i"},
    )


def between(warning):
    return [float(v) for v in re.findall(r"t = (\S+) s and (\S+) s,", str(warning.message))[0]]


@pytest.mark.parametrize("options", [{}, {"locate": True}, {"method": "sdirk2"}, {"backend": "casadi"}, {"every": 7}])
def test_a_gain_that_passes_one_is_found(options):
    with pytest.warns(LoopWarning, match=r"loop (e\.y -> m\.y -> e\.y|m\.y -> e\.y -> m\.y) passes 1") as found:
        run = tsm.simulate(loop(Ramp()), stop=2.0, step=0.0031, log="outputs", **options)
    a, b = between(found[0])
    assert a < 1.0 < b
    assert b - a < 0.0031 * options.get("every", 1) + 1e-9
    assert [*run] == ["y", "i.y"]
    assert run["y"][run.t < 0.9] == pytest.approx(-np.log(1 - run.t[run.t < 0.9]), abs=2e-4)  # of 1 / (1 - t)


def test_a_gain_that_depends_on_a_state_is_found():
    """The gain of e = 1 + k e is that of a second integrator, 2 (1 - exp(-t)) by its own loop: 1 at t = ln 2."""
    d = loop(Gain(gain=2.0), j=Integrator(), s=Sum(), wires=["one -> s.plus", "s -> j -> s.minus", "j -> k"])
    with pytest.warns(LoopWarning) as found:
        tsm.simulate(d, stop=1.0, step=0.003)
    a, b = between(found[0])
    assert a < np.log(2.0) < b


@pytest.mark.parametrize("size", [3, 4, 6])
def test_coupled_loops_pass_where_their_matrix_is_singular(size):
    """s = 1 + t A s is singular at the reciprocals of the eigenvalues of A."""
    a = np.random.default_rng(size).normal(size=(size, size))
    values = np.linalg.eigvals(a)
    first = min(1 / v.real for v in values if abs(v.imag) < 1e-12 and v.real > 0)
    blocks, wires = {"one": Constant(value=1.0), "t": Ramp()}, []
    for i in range(size):
        blocks |= {f"s{i}": Sum(signs="+" * (size + 1)), f"m{i}": Product()}
        wires += [f"one -> s{i}.plus1", f"s{i} -> m{i}.u1", f"t -> m{i}.u2"]
        for j in range(size):
            blocks[f"g{i}_{j}"] = Gain(gain=float(a[i, j]))
            wires += [f"m{j} -> g{i}_{j}", f"g{i}_{j} -> s{i}.plus{j + 2}"]
    with pytest.warns(LoopWarning) as found:
        tsm.simulate(tsm.Diagram(title="coupled", blocks=blocks, wires=wires), stop=1.5 * first, step=first / 301.3)
    low, high = between(found[0])
    assert low < first < high


@pytest.mark.parametrize(
    "gain",
    [Ramp(slope=0.4), Step(time=0.7, before=0.5, after=3.0), Ramp(initial=1.5), Sine(amplitude=0.999)],
    ids=["below 1", "a jump across", "above 1", "nearly 1"],
)
def test_a_gain_that_does_not_pass_one_is_left_alone(gain):
    run = tsm.simulate(loop(gain), stop=2.0, step=0.0031)
    assert run["e.y"] == pytest.approx(1 / (1 - run["k.y"]), rel=1e-9)


def test_a_gain_that_is_negative_or_beside_a_nonlinear_loop():
    d = loop(Ramp(), signs="+-")
    tsm.simulate(d, stop=2.0, step=0.0031)
    blocks = dict(sum=Sum(), c=Cubic(), cap=Saturation(low=-2.0, high=2.0))
    wires = ["one -> sum.plus", "sum -> c -> sum.minus", "c -> cap"]
    with pytest.warns(LoopWarning):
        run = tsm.simulate(loop(Ramp(), wires=wires, **blocks), stop=2.0, step=0.0031)
    assert run["sum.y"] * 2 + run["sum.y"] ** 3 == pytest.approx(1.0)
    assert [one.linear for one in run.loops].count(True) == 1
