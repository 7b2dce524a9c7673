"""Samples that were interpolated over missing numbers have no weight: nobody measured them."""

import pickle

import numpy as np
import pytest

import tsmblocks as tsm
from tsmblocks.blocks import FirstOrderLag

T = 0.02 * np.arange(400)
LAG = tsm.Diagram(title="lag", blocks={"lag": FirstOrderLag()}, inputs={"u": "lag"}, outputs={"y": "lag"})
GONE = np.zeros(400, dtype=bool)
GONE[20:390:10] = GONE[21:390:10] = True


def recorded(path):
    """A square wave through a lag, with a tenth of the samples missing just after its edges, where y bends."""
    u = np.where(T % 0.4 < 0.2, 1.0, -1.0)
    y = tsm.simulate(LAG, inputs={"u": (T, u)}, step=0.02, parameters={"lag.gain": 1.5, "lag.time_constant": 0.05})["y"]
    y = y + 0.001 * np.random.default_rng(0).standard_normal(len(T))
    cells = ["" if gone else f"{value!r}" for value, gone in zip(y.tolist(), GONE, strict=True)]
    path.write_text(
        "t,u,y\n" + "\n".join(f"{a!r},{b!r},{c}" for a, b, c in zip(T.tolist(), u.tolist(), cells, strict=True))
    )
    return tsm.read(path), y


@pytest.fixture
def record(tmp_path):
    return recorded(tmp_path / "run.csv")


def test_a_record_knows_which_samples_were_interpolated(record):
    record, _ = record
    np.testing.assert_array_equal(record.filled["y"], GONE)
    assert "u" not in record.filled
    np.testing.assert_array_equal(record.part(0.0, 3.0).filled["y"], GONE[: len(record.part(0.0, 3.0))])
    assert record.renamed({"y": "z"}).filled.keys() == {"z"}
    assert record.with_signal("y", record["u"]).filled == {}
    np.testing.assert_array_equal(record.conditioned(["u"]).filled["y"], GONE)
    np.testing.assert_array_equal(pickle.loads(pickle.dumps(record)).filled["y"], GONE)
    assert record.resampled(0.01).filled["y"].sum() >= 2 * GONE.sum()


@pytest.mark.parametrize("method", ["gauss-newton", "ipopt", "ga"])
def test_a_fit_is_that_of_the_measured_samples(record, method):
    """The values in place of missing samples change nothing."""
    record, y = record
    wild = tsm.Record("run", T, {"u": record["u"], "y": np.where(GONE, 1e3, y)}, {}, filled={"y": GONE})
    options = dict(free=["lag.gain", "lag.time_constant"], method=method, starts=1)
    fits = [tsm.fit(LAG, one, **options) for one in (record, wild)]
    for fit in fits:
        assert fit["lag.gain"].value == pytest.approx(1.5, abs=2e-3)
        assert fit["lag.time_constant"].value == pytest.approx(0.05, abs=2e-4)
        assert fit.rms == pytest.approx(0.001, rel=0.15)
        assert len(fit.differences.items[0].t) == np.count_nonzero(~GONE)
    plain = tsm.fit(LAG, tsm.Record("run", T, dict(record.signals), {}), **options)
    assert abs(plain["lag.time_constant"].value - 0.05) > 1e-3  # what it was when they counted as measured


def test_scores_and_diagnoses_leave_them_out(record):
    record, _ = record
    true = {"lag.gain": 1.5, "lag.time_constant": 0.05}
    assert tsm.score(LAG, record, parameters=true).rms == pytest.approx(0.001, rel=0.15)
    options = dict(noise_floor=0.001, effects=["dead_time", "first_order_lag", "saturation"])
    found = tsm.diagnose(LAG, record, **options)
    assert found.verdict == "none"
    counted = tsm.Record("run", T, dict(record.signals), {})
    assert tsm.diagnose(LAG, counted, **options).verdict != "none"


def noisy(gone):
    """Noise of 0.02 on a slow signal that an input drives, with rests; some samples are straight lines."""
    t = 0.01 * np.arange(4000)
    u = np.sin(2 * np.pi * 0.5 * t + 0.05 * t**2) * (t % 20 < 12)
    y = u + np.random.default_rng(4).normal(0.0, 0.02, len(t))
    y = np.where(gone, np.interp(t, t[~gone], y[~gone]), y)
    return t, u, y


@pytest.mark.parametrize("kind", ["high frequencies", "stand-still", "repeats", "repeated periods"])
def test_the_noise_floor_reads_no_samples_that_were_interpolated(kind):
    """What was interpolated holds less noise, or none: the floor is that of the samples between."""
    gone = np.arange(4000) % 40 >= 30
    t, u, y = noisy(gone)
    filled = {"y": gone}
    units, draw = {"u": "rad", "y": "rad"}, np.random.default_rng(5)
    wave = np.sin(2 * np.pi * 0.5 * t)
    signals = {
        "high frequencies": {"y": y},
        "stand-still": {"u": u, "y": y},
        "repeats": {"u": u, "y": y},
        "repeated periods": {"u": wave, "y": y - u + wave},
    }[kind]
    records = [tsm.Record("gaps", t, signals, units, filled=filled)]
    if kind == "repeats":
        again = np.where(gone, y, u + draw.normal(0.0, 0.02, len(t)))
        records.append(tsm.Record("again", t, {"u": u, "y": again}, units, filled=filled))
    found = tsm.noise(records, "y", inputs=[k for k in signals if k != "y"])
    assert found.method == kind
    assert found.floor == pytest.approx(0.02, rel=0.06)
    if kind == "high frequencies":
        assert found.samples == 3000
