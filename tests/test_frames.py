"""Results as pandas frames and xarray data sets: names, coordinates, units, and the way to have the libraries."""

import numpy as np
import pytest

import tsmblocks as tsm
from tsmblocks.analysis import frequency_response
from tsmblocks.blocks import DiscreteIntegrator, Sine
from tsmblocks.common.errors import TsmError
from tsmblocks.studies import latin_hypercube, responses

pd = pytest.importorskip("pandas")
xr = pytest.importorskip("xarray")

LOOP = tsm.load("fig16_feedforward_feedback")
T = np.arange(0.0, 3.0, 0.01)
X = 0.8 * np.sin(2 * T)


@pytest.fixture(scope="module")
def run():
    return tsm.simulate(LOOP, stop=1.0)


@pytest.fixture(scope="module")
def record():
    y = 0.8 * X + np.random.default_rng(1).normal(0.0, 0.002, len(T))
    return tsm.Record("bend", T, {"x_in": X, "x_out": y}, {"x_in": "rad"}, "bend.csv", ("one", "two"))


@pytest.fixture(scope="module")
def fit(record):
    return tsm.fit(tsm.load("tendon_sheath_linear"), record, starts=1)


def whole(made, tmp_path):
    """The data set, once it has been to the disk and back."""
    made.to_netcdf(tmp_path / "a.nc", engine="scipy")
    with xr.open_dataset(tmp_path / "a.nc", engine="scipy", decode_times=False) as again:
        xr.testing.assert_allclose(again.load(), made)
    return made


def test_a_run_is_a_frame_over_time_with_units(run):
    frame = run.to_pandas()
    assert frame.index.name == "t"
    assert list(frame.columns) == run.keys()
    assert frame.attrs["units"]["x_out"] == "rad"
    assert frame.attrs["units"]["t"] == "s"
    np.testing.assert_array_equal(frame["u"], run["u"])
    assert list(run.to_pandas(["u"]).attrs["units"].items()) == [("t", "s"), ("u", "V")]


def test_a_run_is_a_data_set_over_time_with_units(run, tmp_path):
    made = whole(run.to_xarray(), tmp_path)
    assert list(made.data_vars) == run.keys()
    assert (made["x_out"].dims, made["x_out"].attrs, made["t"].attrs) == (("t",), {"units": "rad"}, {"units": "s"})
    assert made.attrs == {"title": LOOP.title, "step": 0.001, "method": "rk4", "complete": 1}
    assert float(made["x_out"].sel(t=0.5)) == run["x_out"][500]
    assert list(run.to_xarray(["motor.y"]).data_vars) == ["motor.y"]


def test_a_recording_goes_to_pandas_and_back(record, tmp_path):
    again = tsm.from_pandas(record.to_pandas(), name="bend")
    assert again.units == record.units
    assert again.names == record.names
    np.testing.assert_array_equal(again["x_out"], record["x_out"])
    assert tsm.from_pandas(record.to_pandas(), units={"x_out": "deg"}).unit("x_out") == "deg"
    made = whole(record.to_xarray(), tmp_path)
    assert made.attrs == {"name": "bend", "origin": "bend.csv", "notes": "one\ntwo"}
    assert (made["x_in"].attrs, made["x_out"].attrs) == ({"units": "rad"}, {})


def test_a_run_goes_to_pandas_and_is_fitted_as_a_recording(run):
    record = tsm.from_pandas(run.to_pandas(["x_in", "x_out"]))
    np.testing.assert_array_equal(record.t, run.t)
    assert record.units == {"x_in": "rad", "x_out": "rad"}


def test_a_batch_has_sets_with_parameters_and_instants(tmp_path):
    batch = tsm.simulate_batch(LOOP, {"pid.kp": [0.5, 1.0, 2.0]}, stop=0.1)
    made = whole(batch.to_xarray(), tmp_path)
    assert made["u"].dims == ("set", "t")
    assert made["u"].attrs == {"units": "V"}
    assert made["pid.kp"].dims == ("set",)
    np.testing.assert_array_equal(made["u"].swap_dims(set="pid.kp").sel({"pid.kp": 1.0}), batch["u"][1])
    reduced = tsm.simulate_batch(LOOP, {"pid.kp": [0.5, 1.0]}, stop=0.1, reduce=lambda t, y: {"last": y["u"][-1]})
    assert reduced.to_xarray()["last"].dims == ("set",)
    assert "t" not in reduced.to_xarray().coords
    assert list(reduced.to_pandas().columns) == ["pid.kp", "last"]
    assert reduced.units == {}


def test_a_whole_grid_has_its_parameters_as_dimensions(tmp_path):
    values = {"pid.kp": [2.0, 0.5, 1.0], "pid.ki": [1.0, 3.0]}
    study = tsm.study(LOOP, values, {"error [deg]": "rms(x_ref - x_out)"}, stop=1.0)
    made = whole(study.to_xarray(), tmp_path)
    assert made["error"].dims == ("pid.kp", "pid.ki")
    assert made["error"].attrs == {"units": "deg"}
    for k in range(len(study)):
        row = study.row(k)
        assert float(made["error"].sel({name: row[name] for name in values})) == row["error"]
    assert study.to_pandas().attrs["units"] == {"error [deg]": "deg"}


def test_what_is_no_whole_grid_is_a_list_of_runs(tmp_path):
    plan = latin_hypercube({"pid.kp": (0.5, 2.0)}, runs=5, seed=1)
    twice = {"pid.kp": [1.0, 1.0], "pid.ki": [1.0, 3.0]}
    for plan_ in (plan, twice):
        study = tsm.study(LOOP, plan_, "rms(x_ref - x_out)", stop=0.5)
        made = whole(study.to_xarray(), tmp_path)
        (metric,) = made.data_vars
        assert made[metric].dims == ("run",)
        np.testing.assert_array_equal(made["pid.kp"], study["pid.kp"])


def test_options_of_a_grid_are_texts(tmp_path):
    sums = tsm.Diagram(blocks={"ref": Sine(), "sum": DiscreteIntegrator()}, wires=["ref -> sum"], outputs={"y": "sum"})
    choices = ["forward", "trapezoidal"]
    study = tsm.study(sums, {"sum.method": choices}, "rms(y)", stop=0.5)
    made = whole(study.to_xarray(), tmp_path)
    assert made["sum.method"].values.tolist() == choices
    assert float(made["rms(y)"].sel({"sum.method": "trapezoidal"})) == study["rms(y)"][1]


def test_responses_sensitivities_and_frequency_responses_name_their_coordinates(tmp_path):
    made = whole(responses(LOOP, {"pid.kp": [0.5, 1.0]}, ["u"], stop=0.1).to_xarray(), tmp_path)
    assert (made["u"].dims, made["u"].attrs) == (("run", "t"), {"units": "V"})
    slopes = tsm.sensitivities(LOOP, ["pid.kp", "pid.ki"], outputs=["u"], stop=0.1)
    jacobian = slopes.to_xarray()["jacobian"].sel(signal="u", parameter="pid.ki")
    np.testing.assert_array_equal(jacobian, slopes.jacobian[:, 0, 1])
    answer = frequency_response(tsm.load("motor_linear"), [0.5, 1.0, 2.0], [0.1, 0.2])
    made = whole(answer.to_xarray(), tmp_path)
    assert made["gain"].dims == ("amplitude", "frequency")
    assert (made["frequency"].attrs, made["phase"].attrs) == ({"units": "Hz"}, {"units": "deg"})
    assert float(made["phase"].sel(amplitude=0.2, frequency=2.0)) == answer.phase[1, 2]
    assert answer.to_pandas().index.names == ["amplitude", "frequency"]


def test_a_difference_is_a_frame_of_what_drove_it_and_what_is_left(fit):
    (one,) = fit.differences
    made = one.to_pandas()
    assert made.index.name == "t"
    np.testing.assert_array_equal(made["residual"], made["measured"] - made["simulated"])
    assert list(made.columns) == [*one.inputs, "measured", "simulated", "residual"]
    assert made.attrs["units"] == {
        "t": "s",
        **{k: u for k, (_, u) in one.inputs.items()},
        **dict.fromkeys(("measured", "simulated", "residual"), one.unit),
    }


def test_a_fit_is_a_frame_of_numbers_with_intervals(fit):
    frame = fit.to_pandas()
    assert list(frame.index) == list(fit.names)
    one = fit["gain.gain"]
    assert frame.loc["gain.gain", ["value", "low", "high"]].tolist() == [one.value, one.low, one.high]
    assert frame.loc["offset.bias", "unit"] == "rad"
    left = fit.differences.to_pandas()
    assert left.index.names == ["experiment", "output"]
    assert left.loc[("bend", "x_out"), "rms"] == fit.differences["bend"].rms


def test_models_compared_are_a_frame_the_best_first(record):
    found = tsm.compare(["linear", "play"], record, train=0.5)
    frame = found.to_pandas()
    assert list(frame.index) == [row.name for row in found]
    assert frame["rms held-out"].tolist() == [row.figure for row in found]
    assert frame["rms held-out"].is_monotonic_increasing
    assert frame.attrs["units"] == {"rms in-sample": "rad", "rms held-out": "rad"}


def test_candidates_of_a_diagnosis_are_a_frame():
    from tests.diagnoses import diagnosis

    found = diagnosis()
    frame = found.to_pandas()
    ranking = found.to_dict()["ranking"]
    assert frame["name"].tolist() == [row["name"] for row in ranking]
    assert frame.loc[frame["named"], "name"].tolist() == [e.name for e in found.effects]
    assert {"round", "wire", "share", "share_across", "statistic", "line", "in_set"} <= set(frame.columns)


@pytest.mark.parametrize(("library", "extra"), [("pandas", "data"), ("xarray", "xarray")])
def test_without_the_library_the_way_out_is_told(library, extra, run, record, fit, monkeypatch):
    monkeypatch.setitem(__import__("sys").modules, library, None)
    wanted = f'to_{library} needs {library}: pip install "tsmblocks[{extra}]"'
    batch = tsm.simulate_batch(LOOP, {"pid.kp": [0.5, 1.0]}, stop=0.01)
    answer = frequency_response(tsm.load("motor_linear"), [1.0], [0.1])
    asked = [getattr(one, f"to_{library}") for one in (run, record, batch, answer)]
    for call in [*asked, *([fit.to_pandas, fit.differences.to_pandas] if library == "pandas" else [])]:
        with pytest.raises(TsmError) as caught:
            call()
        assert str(caught.value) == wanted
