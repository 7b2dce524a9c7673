"""Figures: what is on which axes, in which unit. The pictures themselves are looked at, not compared."""

import os
import re
import subprocess
import sys

import numpy as np
import pytest

import tsmblocks as tsm
from tsmblocks.common.errors import ParameterError, RunError, TsmError
from tsmblocks.plots import plot_loop, plot_run, plot_tracking

figure = pytest.importorskip("matplotlib.figure", reason="the extra [plots] brings it")


@pytest.fixture(scope="module")
def run():
    return tsm.simulate(tsm.load("fig09a_without_feedforward"), stop=10.0, step=2e-3)


def test_a_run_has_a_panel_for_each_unit_and_angles_in_degrees(run):
    angles, volts = run.plot().axes
    assert [line.get_label() for line in angles.lines] == ["x_ref", "x_out", "x_in"]
    assert (angles.get_ylabel(), volts.get_ylabel(), volts.get_xlabel()) == ("angle [deg]", "u [V]", "t [s]")
    np.testing.assert_allclose(angles.lines[0].get_ydata(), np.degrees(run["x_ref"]))


def test_an_expression_is_a_signal_and_the_way_in_can_be_left_out(run):
    (panel,) = run.plot("x_ref - x_out", "x_out", after=5.0).axes
    late = run.t >= 5.0
    assert [line.get_label() for line in panel.lines] == ["x_ref - x_out", "x_out"]
    np.testing.assert_allclose(panel.lines[0].get_ydata(), np.degrees(run["x_ref"] - run["x_out"])[late])
    assert panel.lines[0].get_xdata()[0] == 5.0
    assert (panel.get_ylabel(), len(run.plot("x_ref - x_out", "u * 0.5", "u").axes)) == ("angle [deg]", 3)
    for text, error, said in (
        ("x_ref - x_uot", ParameterError, "there is no signal 'x_uot'. Did you mean 'x_out'?"),
        ("x_reff", RunError, "has no signal 'x_reff'. Did you mean 'x_ref'?"),
        ("x_ref - u", ParameterError, "this mixes rad and V."),
        ("x_ref > 1", ParameterError, "this is a comparison, which is no signal."),
    ):
        with pytest.raises(error, match=re.escape(said)):
            run.plot(text)
    with pytest.raises(TsmError, match=r"^a signal is given by its name, as in plot\('x_ref', 'x_out'\), got \["):
        run.plot(["x_ref", "x_out"])
    for after in (10.0, 20.0):
        with pytest.raises(TsmError, match=rf"^after={after:g} s leaves nothing of the run, which ends at 10 s.$"):
            run.plot("x_out", after=after)
    with pytest.raises(RunError, match="after must be a finite number, got 'a'"):
        run.plot("x_out", after="a")


def test_given_axes_are_drawn_on(run):
    panel = figure.Figure().subplots()
    assert plot_run(run, ["x_out", "u"], panel) is panel.figure
    assert [line.get_label() for line in panel.lines] == ["x_out", "u"]


def test_tracking_shows_the_reference_the_outputs_and_their_errors(run):
    above, below = plot_tracking({"a": run, "b": run}, after=5.0).axes
    assert [line.get_label() for line in above.lines] == ["reference", "a", "b"]
    assert above.lines[0].get_xdata()[0] == 5.0
    error = np.degrees(run["x_ref"] - run["x_out"])[run.t >= 5.0]
    np.testing.assert_allclose(below.lines[0].get_ydata(), error)
    assert below.lines[0].get_label() == f"a: {np.ptp(error):.3g} deg"
    assert below.get_legend().get_title().get_text() == "peak-to-peak error"
    with pytest.raises(TsmError, match="ax must be 2 axes here, got 1"):
        plot_tracking({"a": run}, figure.Figure().subplots())
    with pytest.raises(TsmError, match="at least one run"):
        plot_tracking({})


def test_loops_share_axes(run):
    first = plot_loop(run["x_in"], run["x_out"], label="one")
    panel = first.axes[0]
    assert plot_loop(run["x_in"], run["x_out"], panel, label="two") is first
    assert (panel.get_xlabel(), len(panel.lines)) == ("x_in [deg]", 2)
    assert panel.lines[0].get_color() != panel.lines[1].get_color()


def test_a_figure_is_found_by_pyplot_when_that_is_in_use(run):
    pyplot = pytest.importorskip("matplotlib.pyplot", reason="the extra [plots] brings it")
    pyplot.switch_backend("Agg")
    made = plot_run(run, ["x_out"])
    assert made.number in pyplot.get_fignums()
    pyplot.close(made)


def test_a_script_that_plots_first_can_show_the_figure_afterwards():
    """Without pyplot imported before: plt.show() finds the figure, as that of pandas."""
    code = (
        "import sys, tsmblocks as tsm\n"
        "run = tsm.simulate(tsm.load('motor_linear'), stop=0.1, inputs={'u': 12.0})\n"
        "assert 'matplotlib.pyplot' not in sys.modules\n"
        "figure = run.plot()\n"
        "import matplotlib.pyplot as plt\n"
        "assert plt.get_fignums() == [figure.number], plt.get_fignums()\n"
    )
    env = {**os.environ, "MPLBACKEND": "Agg"}
    done = subprocess.run([sys.executable, "-c", code], check=False, env=env, capture_output=True, text=True)
    assert done.stderr == ""
