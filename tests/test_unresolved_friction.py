"""Fits with a step too long for a steep friction: their notes, and their confidence intervals."""

from types import SimpleNamespace

import numpy as np
import pytest

import tsmblocks as tsm
from tsmblocks.blocks import CoulombFriction, Gain, Integrator, Sum
from tsmblocks.fitting.discontinuous import SMOOTH, _measure_plateaus, _Search

T = np.arange(0.0, 6.0, 0.01)
FORCE = 6.0 * np.sin(2.0 * T) + 3.0 * np.sin(5.1 * T + 1.0)


def slide(level, inverse_mass):
    return tsm.Diagram(
        blocks={
            "net": Sum(signs="+---"),
            "mass": Gain(gain=inverse_mass, unit="m/s^2"),
            "speed": Integrator(),
            "x": Integrator(),
            "spring": Gain(gain=50.0, unit="N"),
            "damper": Gain(gain=2.0, unit="N"),
            "dry": CoulombFriction(level=level, smoothing=0.001),
        },
        wires=[
            "net -> mass -> speed -> x -> spring -> net.minus1",
            "speed -> damper -> net.minus2",
            "speed -> dry -> net.minus3",
        ],
        inputs={"F": tsm.Inlet("net.plus", unit="N")},
        outputs={"y": "x"},
    )


def test_a_step_too_long_for_a_friction_that_holds_is_said():
    run = tsm.simulate(slide(1.5, 2.0), inputs={"F": (T, FORCE)}, stop=T[-1], step=2e-4, check_step=False)
    y = np.interp(T, run.t, run["y"]) + np.random.default_rng(0).normal(0.0, 1e-3, len(T))
    record = tsm.Record("r", T, {"F": FORCE, "y": y}, {"F": "N", "y": "m"})
    free = ["mass.gain", "dry.level", "spring.gain", "damper.gain"]
    fit = tsm.fit(slide(1.0, 1.5), record, free=free, starts=2, step=0.01)
    said = [text for text in fit.notes if text.startswith(("speed.integral", "the outputs change erratically"))]
    assert said[0].startswith("speed.integral changes faster than a step of 0.01 s can simulate, as where a steep")
    assert said[1].startswith("the outputs change erratically with damper.gain: more by tiny changes than by those of")
    assert all(one.high - one.low > 1e-3 * abs(one.value) for one in fit.estimates)


@pytest.mark.parametrize(("grain", "resolved"), [(1e-10, False), (1e-3, True)])
def test_an_unknown_that_changes_the_outputs_at_every_scale_gets_no_interval_of_zero_width(grain, resolved):
    """Cost that jumps from grain to grain: over a hundredth where that is the step of the data, over rounding else."""

    def costs(thetas):
        return 1.0 + (np.floor(thetas[:, 0] / grain) != np.floor(2.0 / grain)) * 0.5

    item = SimpleNamespace(start=2.0, low=-np.inf, high=np.inf)
    unknowns = SimpleNamespace(start=np.array([2.0]), items=[item])
    none = SimpleNamespace(names=())
    problem = SimpleNamespace(samples=100, unknowns=unknowns, constraints=none, costs=costs)
    search = _Search(problem, np.array([2.0]), 1.0, 0, "converged", 10, lambda *_: None, None)
    _measure_plateaus(search, [0], None)
    assert search.steps is not None
    assert search.steps[0] == (pytest.approx(grain, rel=1.0) if resolved else pytest.approx(SMOOTH * 2.0))
