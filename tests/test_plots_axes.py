"""Every figure can be drawn on axes of one's own, and leaves everything else of pyplot alone."""

import inspect

import numpy as np
import pytest

import tsmblocks as tsm
from tsmblocks import plots
from tsmblocks.analysis import frequency_response
from tsmblocks.plots.runs import plot_tracking_changes
from tsmblocks.studies import latin_hypercube, responses, sweep

pyplot = pytest.importorskip("matplotlib.pyplot", reason="the extra [plots] brings it")
DRAWN = {name: getattr(plots, name) for name in plots.__all__} | {"plot_tracking_changes": plot_tracking_changes}
LOOP = tsm.load("fig09b_feedforward")


@pytest.fixture(scope="module")
def calls():
    """Arguments of each function, and how many axes it draws on."""
    pyplot.switch_backend("Agg")
    t = np.arange(0.0, 4.0, 0.01)
    x = 0.8 * np.sin(2 * t)
    y = 0.8 * x + 0.02 * np.sign(np.cos(2 * t)) + np.random.default_rng(1).normal(0.0, 0.002, len(t))
    record = tsm.Record("bend", t, {"x_in": x, "x_out": y}, {"x_in": "rad", "x_out": "rad"})
    fit = tsm.fit(tsm.load("tendon_sheath_linear"), record, starts=1)
    comparison = tsm.compare(["tendon_sheath_linear", "tendon_sheath_play"], record, starts=1)
    found = tsm.diagnose(tsm.load("tendon_sheath_linear"), record, noise_floor=0.002, effects=["backlash"])
    run = tsm.simulate(LOOP, stop=1.0)
    metrics = {"error": "rms(x_ref - x_out)", "effort": "rms(u)"}
    grid = tsm.study(LOOP, {"theta": [4.0, 5.0], "delta": [0.0, 0.1]}, metrics, stop=0.5)
    swept = tsm.study(LOOP, sweep({"theta": [4.0, 5.0]}), metrics, stop=0.5)
    many = responses(LOOP, {"theta": [4.0, 5.0]}, stop=0.5)
    baseline = type("Baseline", (), {"t": t, "signals": {"x": x}, "signal_units": {"x": "rad"}})
    tuned = tsm.tune(LOOP, {"theta": (4.0, 5.0)}, "rms(x_ref - x_out)", subject_to=["rms(u) <= 9"], stop=0.5, starts=1)
    one = fit.differences.items[0]
    return {
        "plot_run": ((run,), 1),
        "plot_record": ((run.record(),), 1),
        "plot_tracking": (({"a": run},), 2),
        "plot_loop": ((x, y), 1),
        "plot_fit": ((fit,), 4),
        "plot_history": ((one,), 1),
        "plot_residual": ((one,), 1),
        "plot_fitted_loop": ((one,), 1),
        "plot_autocorrelation": ((one,), 1),
        "plot_comparison": ((comparison,), 3),
        "plot_each": (({"bend": comparison},), 1),
        "plot_diagnosis": ((found,), 4),
        "plot_gap": ((found,), 1),
        "plot_disagreement": ((found,), 1),
        "plot_coordinate": ((found,), 1),
        "plot_study": ((grid,), 2),
        "plot_tornado": ((swept, "error"), 1),
        "plot_pareto": ((grid, "error", "effort"), 1),
        "plot_heat_map": ((grid, "error"), 1),
        "plot_distribution": ((grid, "error"), 1),
        "plot_scatter": ((grid, "error"), 2),
        "plot_tuned": ((tuned,), 2),
        "plot_envelope": ((many, "x_out"), 1),
        "plot_tracking_changes": ((baseline, baseline, "t"), 2),
        "plot_frequency_response": ((frequency_response(tsm.load("motor_linear"), [1.0, 2.0], [0.1]),), 3),
    }


@pytest.mark.parametrize("name", DRAWN)
def test_every_figure_takes_axes_and_gives_their_figure(name, calls, monkeypatch):
    monkeypatch.setattr(pyplot, "show", lambda *_, **__: pytest.fail("a figure shows itself"))
    parameter = inspect.signature(DRAWN[name]).parameters["ax"]
    assert parameter.default is None
    words, count = calls[name]
    mine, panels = pyplot.subplots(count, 1, squeeze=False)
    other = pyplot.figure()
    before = (pyplot.get_fignums(), dict(pyplot.rcParams))
    assert DRAWN[name](*words, ax=panels[0, 0] if count == 1 else panels) is mine
    assert all(panel.has_data() or panel.texts for panel in panels.flat)
    assert (pyplot.get_fignums(), dict(pyplot.rcParams)) == before
    assert pyplot.gcf() is other
    assert mine.get_suptitle() == ""
    pyplot.close("all")


@pytest.mark.parametrize("name", DRAWN)
def test_every_figure_makes_one_of_its_own(name, calls):
    words, count = calls[name]
    made = DRAWN[name](*words)
    assert pyplot.get_fignums() == [made.number]
    assert len([panel for panel in made.axes if panel.get_label() != "<colorbar>"]) >= count - (
        name in ("plot_run", "plot_record")
    )
    with pytest.raises(tsm.TsmError, match=r"ax must be \d+ axes here, got 7"):
        DRAWN[name](*words, ax=pyplot.figure().subplots(7, 1))
    pyplot.close("all")


def test_methods_hand_axes_on(calls):
    for name in ("plot_fit", "plot_comparison", "plot_diagnosis", "plot_study"):
        (thing,), count = calls[name]
        mine, panels = pyplot.subplots(1, count)
        assert thing.plot(ax=panels) is mine
    pyplot.close("all")


def test_angles_of_studies_are_shown_in_degrees(calls):
    (grid,), _ = calls["plot_study"]
    drawn = plots.plot_pareto(grid, "error", "effort").axes[0]
    np.testing.assert_allclose(drawn.collections[0].get_offsets()[:, 0], np.degrees(grid["error"]))
    assert (drawn.get_xlabel(), drawn.get_ylabel()) == ("error [deg]", "effort [V]")
    heat = plots.plot_heat_map(grid, "error")
    np.testing.assert_allclose(
        np.sort(heat.axes[0].collections[0].get_array().ravel()), np.sort(np.degrees(grid["error"]))
    )
    assert heat.axes[1].get_ylabel() == "error [deg]"
    spread = plots.plot_distribution(grid, "error").axes[0]
    assert spread.get_xlabel() == "error [deg]"
    assert spread.lines[0].get_label() == f"median {np.degrees(grid.quantiles('error')['median']):.4g}"
    pyplot.close("all")


def test_random_runs_are_shown_over_each_number():
    plan = latin_hypercube({"theta": (4.0, 5.0), "delta": (0.0, 0.1)}, 40, seed=1)
    found = tsm.study(LOOP, plan, {"error [deg]": "rms(x_ref - x_out)", "effort": "rms(u)"}, stop=0.5)
    panels = found.plot().axes
    assert len(panels) == 6  # a distribution, and two numbers, of two metrics
    for panel, name in zip(panels[1:3], ("theta", "delta"), strict=True):
        points = panel.collections[0].get_offsets()
        np.testing.assert_allclose(np.sort(points[:, 0]), np.sort(found[name]))
        np.testing.assert_allclose(np.sort(points[:, 1]), np.sort(found["error"]))
        first = np.argsort(found[name])[:4]  # of 40 runs in ten stretches
        x, y = (line[0] for line in panel.lines[0].get_data())
        assert (x, y) == pytest.approx((np.median(found[name][first]), np.median(found["error"][first])))
    assert [panel.get_xlabel() for panel in panels[4:]] == ["theta", "delta"]
    assert panels[1].get_ylabel() == "error [deg]"
