"""A fitted parameter that acts beyond what the recordings reach is remarked on."""

import numpy as np
import pytest

import tsmblocks as tsm
from tsmblocks.blocks import CoulombFriction, Saturation
from tsmblocks.fitting.recorded_range import beyond_range

T = np.arange(0.0, 6.0, 0.01)
U = np.sin(2 * T)


def fitted(block, port, parameter, given, start):
    """A fit of one block, driven by a sine of amplitude 1 mm/s, on its own output with noise."""
    diagram = tsm.Diagram(
        title="alone",
        blocks={"block": block},
        inputs={"u": tsm.Inlet([f"block.{port}"], unit="mm/s")},
        outputs={"y": "block"},
    )
    run = tsm.simulate(diagram, inputs={"u": (T, U)}, step=0.01, parameters={parameter: given}, check_step=False)
    y = np.interp(T, run.t, run["y"]) + np.random.default_rng(1).normal(0.0, 1e-3, len(T))
    record = tsm.Record("run", T, {"u": U, "y": y}, {"u": "mm/s", "y": ""})
    return tsm.fit(diagram, record, free=[parameter], start={parameter: start}, starts=1, step=0.01)


@pytest.mark.parametrize(("smoothing", "remarked"), [(0.8, True), (0.2, False)])
def test_a_smoothing_speed_that_is_large_beside_the_speeds(smoothing, remarked):
    fit = fitted(CoulombFriction(level=1.0), "v", "block.smoothing", smoothing, 0.5)
    said = beyond_range(fit)
    assert bool(said) is remarked
    assert set(said) <= set(fit.to_dict()["notes"])
    if remarked:
        speed = fit["block.smoothing"].value
        assert said == [
            f"block.smoothing ({speed:.3g} mm/s) is large beside u in these recordings: 95 % of its "
            f"magnitudes are below {np.quantile(np.abs(U), 0.95):.3g} mm/s, and the transition ends at about "
            f"{2 * speed:.3g} mm/s. What the block does there is an extrapolation."
        ]
        assert "is large beside u" in str(fit).replace("\n  ", " ")


@pytest.mark.parametrize(("high", "remarked"), [(2.0, True), (0.6, False)])
def test_a_limit_that_the_signal_does_not_reach(high, remarked):
    fit = fitted(Saturation(low=-3.0), "u", "block.high", high, high)
    said = beyond_range(fit)
    assert said == (
        ["block.high (2 mm/s) is beyond the range of u in these recordings (-1 to 1 mm/s), so it is an extrapolation."]
        if remarked
        else []
    )


def test_a_recording_that_begins_later_is_simulated_from_there():
    """It was left out, and a limit that its signal reaches was called beyond the range of the others."""
    fit = fitted(Saturation(low=-3.0), "u", "block.high", 0.6, 0.6)
    early = fit.records["run"].part(0.0, 0.1)
    pieces = {"early": early, "late": fit.records["run"].part(0.5, 3.0)}
    found = tsm.fit(fit.diagram, pieces, free=["block.high"], starts=1, step=0.01)
    assert found["block.high"].value == pytest.approx(0.6, abs=0.01)
    assert beyond_range(found) == []


def test_parameters_that_were_not_fitted_are_not_examined():
    fit = fitted(CoulombFriction(smoothing=5.0), "v", "block.level", 1.0, 0.5)
    assert beyond_range(fit) == []


@pytest.mark.filterwarnings("error")
def test_signals_are_those_at_the_step_of_the_fit():
    diagram = tsm.Diagram(
        title="fast",
        blocks={"lag": tsm.blocks.FirstOrderLag(time_constant=2e-4), "limit": Saturation(low=-3.0, high=0.6)},
        wires=["lag -> limit"],
        inputs={"u": tsm.Inlet(["lag.u"], unit="mm/s")},
        outputs={"y": "limit"},
    )
    t = T[:200]
    y = np.minimum(U[:200], 0.6) + np.random.default_rng(1).normal(0.0, 1e-3, len(t))
    record = tsm.Record("run", t, {"u": U[:200], "y": y}, {"u": "mm/s", "y": "mm/s"})
    fit = tsm.fit(diagram, record, free=["limit.high"], start={"limit.high": 0.8}, starts=1, step=1e-4)
    assert fit["limit.high"].value == pytest.approx(0.6, abs=0.01)
    assert beyond_range(fit) == []
