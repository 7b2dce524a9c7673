"""Initial states of pieces of recordings, from the pieces before them."""

import attrs
import numpy as np
import pytest

import tsmblocks as tsm
from tsmblocks.diagnosis.model import ModelSettings, calibrate
from tsmblocks.diagnosis.partition import split_into_pieces
from tsmblocks.diagnosis.piece_states import continued
from tsmblocks.fitting.recordings import recordings

MOTOR = tsm.Diagram(
    title="a motor",
    blocks={"lag": tsm.blocks.FirstOrderLag(gain=3.0, time_constant=0.1), "turn": tsm.blocks.Integrator()},
    wires=["lag -> turn"],
    inputs={"u": "lag.u"},
    outputs={"x": "turn"},
)
STATES = {"lag.value": "lag.y", "turn.integral": "turn.y"}
SETTINGS = ModelSettings(None, {"x": 0.001}, ("x",))


@pytest.fixture(scope="module")
def run():
    t = np.arange(0.0, 12.0, 0.01)
    return tsm.simulate(MOTOR, inputs={"u": (t, np.sin(2.1 * t) + 0.4)}, stop=t[-1], step=0.01)


@pytest.fixture(scope="module")
def record(run):
    noise = np.random.default_rng(3).normal(0.0, 0.001, len(run.t))
    return tsm.Record("run", run.t, {"u": run["u"], "x": run["x"] + noise}, {"u": "", "x": ""})


def model_of(record, pieces):
    records, settings = recordings({"run": record}), SETTINGS
    if pieces:
        records, windows = split_into_pieces(records, length=2.0)
        settings = attrs.evolve(settings, window=windows)
    return calibrate(MOTOR, records, settings)


def test_a_piece_goes_on_where_the_one_before_it_is(record, run):
    """States far from those of the motor, which decay before the comparison, are set back to them."""
    model = model_of(record, pieces=True)
    off = model.theta + np.where([one.parameter == "lag.value" for one in model.problem.unknowns.items], 1e-3, 0.0)
    found = dict(zip(model.problem.unknowns.names, continued(attrs.evolve(model, theta=off)), strict=True))
    assert len(model.setup.experiments) > 4
    for one in model.setup.experiments[1:]:
        for state, signal in STATES.items():
            there = np.interp(one.record.t[0], run.t, run[signal])
            assert found[f"{state}@{one.name}"] == pytest.approx(there, abs=0.02)


def test_the_first_piece_begins_as_it_is_where_its_comparison_begins(record, run):
    model = model_of(record, pieces=True)
    found, first = dict(zip(model.problem.unknowns.names, continued(model), strict=True)), model.setup.experiments[0]
    assert first.t[0] > first.record.t[0]
    for state, signal in STATES.items():
        assert found[f"{state}@{first.name}"] == pytest.approx(np.interp(first.t[0], run.t, run[signal]), abs=0.02)


def test_a_whole_recording_stays_as_it_is(record):
    model = model_of(record, pieces=False)
    assert np.array_equal(continued(model), model.theta)
