"""The style of figures: sizes, texts, units and scales of axes; what a user has set stays. Never pixels."""

import os
import pickle
import subprocess
import sys

import numpy as np
import pytest

import tsmblocks as tsm
from tests.test_tuning import ERROR, GAINS
from tests.views_everywhere import LOOP, examples, registered
from tsmblocks import plots
from tsmblocks.analysis import frequency_response
from tsmblocks.common.displayed_units import axis_unit
from tsmblocks.common.palette import LIGHT
from tsmblocks.common.views import view
from tsmblocks.plots.panels import axes, decimal
from tsmblocks.plots.style import RESIDUAL, styled
from tsmblocks.studies import Uniform, grid, latin_hypercube
from tsmblocks.tuning.result import Oscillation

matplotlib = pytest.importorskip("matplotlib", reason="the extra [plots] brings it")
pyplot = pytest.importorskip("matplotlib.pyplot", reason="the extra [plots] brings it")
LineCollection = pytest.importorskip("matplotlib.collections").LineCollection
METRICS = {"error": "rms(x_ref - x_out)"}


@pytest.fixture(autouse=True)
def figures():
    pyplot.switch_backend("Agg")
    yield
    pyplot.close("all")


@pytest.fixture(scope="module")
def values():
    """A value of every class that has a figure."""
    made = examples().values()
    return [next(v for v in made if isinstance(v, cls)) for kind, cls in registered() if kind == "plot"]


def drawn(value, **options):
    if type(value).__name__ == "Responses":
        options["signal"] = "x_out"
    figure = view("plot", value, **options)
    figure.canvas.draw()
    return figure


def texts(figure):
    """Every text of a figure that is seen."""
    found = [t for t in figure.findobj(matplotlib.text.Text) if t.get_visible() and t.get_text().strip()]
    return [t for t in found if t.get_window_extent().width > 0]


@pytest.mark.parametrize("width", [None, 3.4])
def test_every_figure_fits_a_column_with_texts_of_eight_points(values, width):
    for value in values:
        figure = drawn(value, width=width)
        name = type(value).__name__
        assert figure.get_figwidth() <= (width or 7.0), name
        assert {round(t.get_fontsize(), 3) for t in texts(figure)} <= {8.0, 9.6}, name
        edge = figure.bbox.width + 2.0
        for text in figure.texts + [t for panel in figure.axes for t in (panel.xaxis.label, panel.yaxis.label)]:
            box = text.get_window_extent()
            assert box.x0 > -2.0, (name, text.get_text())
            assert box.x1 < edge, (name, text.get_text())


def test_legends_lie_beside_the_data_and_titles_beside_the_legends(values):
    for value in values:
        figure = drawn(value)
        for panel in figure.axes:
            legend = panel.get_legend()
            if legend is not None:
                box, data = legend.get_window_extent(), panel.get_window_extent()
                assert box.y0 >= data.y1 - 1.0, type(value).__name__
                title = panel.title if panel.title.get_text() else panel._left_title
                assert not title.get_text() or title.get_window_extent().y0 >= box.y1 - 4.0, type(value).__name__


def test_panels_of_a_narrow_figure_stand_below_each_other(values):
    fit = next(value for value in values if isinstance(value, tsm.Fit))
    beside, below = ([panel.get_position().x0 for panel in drawn(fit, width=w).axes] for w in (7.0, 3.4))
    assert max(beside) > 0.4
    assert max(below) < 0.3
    assert drawn(fit).get_size_inches() == pytest.approx([7.0, 4.0])  # one recording


@pytest.mark.parametrize("width", [1.9, 41, "7", None, True, float("nan")])
def test_a_width_that_no_figure_can_have_is_refused(values, width):
    if width is None:
        assert drawn(values[0], width=width)
        return
    with pytest.raises(tsm.TsmError, match=r"^width must be a number of inches from 2 to 40, got "):
        drawn(values[0], width=width)


# ---- what the user has set


def test_settings_of_the_user_hold_and_none_is_changed(values):
    own = {"font.size": 12.0, "grid.color": "#ff0000", "lines.linewidth": 3.0}
    run = next(value for value in values if isinstance(value, tsm.Run))
    with pyplot.rc_context(own):
        before = dict(pyplot.rcParams)
        figure = drawn(run)
        assert dict(pyplot.rcParams) == before
    panel = figure.axes[0]
    assert panel.xaxis.label.get_fontsize() == 12.0
    assert panel.lines[0].get_linewidth() == 3.0
    assert {line.get_color() for line in panel.get_xgridlines()} == {"#ff0000"}
    assert {t.get_fontsize() for t in panel.get_yticklabels()} == {12.0}


def test_colours_of_the_user_are_taken(values):
    run = next(value for value in values if isinstance(value, tsm.Run))
    with pyplot.rc_context({"axes.prop_cycle": matplotlib.cycler(color=["#123456", "#654321"])}):
        panel = drawn(run).axes[0]
    assert [line.get_color() for line in panel.lines[:3]] == ["#123456", "#654321", "#123456"]
    assert panel.lines[2].get_linestyle() != panel.lines[0].get_linestyle()  # the colours are used up


def test_axes_of_the_user_keep_their_look(values):
    run = next(value for value in values if isinstance(value, tsm.Run))
    panel = pyplot.figure().subplots()
    panel.set_title("mine")
    size = panel.xaxis.label.get_fontsize()
    run.plot("x_out", ax=panel)
    assert panel.get_title() == "mine"
    assert panel.xaxis.label.get_fontsize() == size
    assert all(panel.spines[side].get_visible() for side in ("top", "right"))
    with pyplot.rc_context({"legend.fontsize": 5.0}):
        run.plot("x_out", "x_ref", ax=panel)
    assert {t.get_fontsize() for t in panel.get_legend().get_texts()} == {5.0}


@pytest.mark.parametrize("backend", ["", "Agg", "TkAgg"])
@pytest.mark.parametrize("first", ["", "import matplotlib.pyplot as plt"])
def test_a_script_without_a_screen_saves_its_figure(backend, first, tmp_path):
    code = (
        f"{first}\nimport tsmblocks as tsm\n"
        "run = tsm.simulate(tsm.load('motor_linear'), stop=0.1, inputs={'u': 12.0})\n"
        "run.plot().savefig('run.png')\n"
    )
    env = {k: v for k, v in os.environ.items() if k not in ("DISPLAY", "WAYLAND_DISPLAY", "MPLBACKEND")}
    env |= {"MPLBACKEND": backend} if backend else {}
    words = [sys.executable, "-c", code]
    done = subprocess.run(words, check=False, env=env, cwd=tmp_path, capture_output=True, text=True)
    assert done.stderr == ""
    assert (tmp_path / "run.png").stat().st_size > 1000


def test_a_notebook_shows_a_figure_once(values, monkeypatch):
    """The figure that a cell ends with is shown; one of pyplot would be shown again at the end of the cell."""
    monkeypatch.setitem(sys.modules, "ipykernel", sys)
    figure = next(value for value in values if isinstance(value, tsm.Run)).plot()
    assert pyplot.get_fignums() == []
    assert figure._repr_png_().startswith(b"\x89PNG")  # with no backend of pyplot as well
    assert pickle.loads(pickle.dumps(figure)).get_figwidth() == 7.0


# ---- axes as people read them


@pytest.mark.parametrize(
    ("unit", "size", "factor", "label"),
    [
        ("V", 0.02, 1e3, "mV"),
        ("V", 0.25, 1, "V"),
        ("V", 2e4, 1e-3, "kV"),
        ("N*m", 3e-5, 1e6, "µN*m"),
        ("m/s", 1e-3, 1e3, "mm/s"),
        ("s", 0.05, 1e3, "ms"),
        ("s", 1e5, 1, "s"),
        ("m^2", 1e-3, 1, "m^2"),
        ("mm", 1e-3, 1, "mm"),
        ("kg", 1e-4, 1, "kg"),
        ("rad", 1e-4, 180 / np.pi, "deg"),
        ("", 1e-4, 1, ""),
        ("V", 0.0, 1, "V"),
        ("V", float("inf"), 1, "V"),
    ],
)
def test_units_of_axes_have_a_prefix_where_it_helps(unit, size, factor, label):
    k, shown = axis_unit(unit, size)
    assert (k, shown) == (pytest.approx(factor), label)


def test_small_signals_and_short_times_are_named_with_a_prefix():
    run = tsm.simulate(tsm.load("motor_linear"), stop=0.05, inputs={"u": 0.02})
    record = tsm.Record("short", run.t, {"u": 0.02 * np.ones_like(run.t), "f": 3e4 * run.t}, {"u": "V", "f": "N"})
    volts, force = record.plot().axes
    assert (volts.get_ylabel(), force.get_ylabel(), force.get_xlabel()) == ("u [mV]", "f [N]", "t [ms]")
    np.testing.assert_allclose(volts.lines[0].get_ydata(), 20.0)
    np.testing.assert_allclose(force.lines[0].get_xdata(), 1e3 * run.t)


def test_gain_is_in_decibels_and_phase_has_ticks_at_parts_of_a_right_angle():
    response = frequency_response(tsm.load("motor_linear"), [1.0], [0.1, 0.3, 1.0, 3.0, 10.0])
    gain, phase, last = drawn(response).axes
    np.testing.assert_allclose(gain.lines[0].get_ydata(), 20 * np.log10(response.gain[0]))
    assert (gain.get_ylabel(), phase.get_ylabel()) == ("gain [dB re 1 rad/V]", "phase [deg]")
    assert gain.get_yscale() == "linear"
    low, high = phase.get_ylim()
    assert (low % 45, high % 45) == (0, 0)
    assert {round(tick % 15, 6) for tick in phase.get_yticks()} == {0.0}
    assert "1" in [text.get_text() for text in last.get_xticklabels()]


@pytest.mark.parametrize(
    ("ends", "names"),
    [
        ((0.9, 11.0), "1 2 5 10"),
        ((0.1, 10.0), "0.1 0.2 0.5 1 2 5 10"),
        ((3.0, 9.0), "3 4 5 6 7 8 9"),
        ((0.055, 0.085), "0.06 0.07 0.08"),
        ((4.2, 4.8), "4.2 4.35 4.5 4.65 4.8"),
        ((1.0, 1e5), "10$^0$"),
    ],
)
def test_a_logarithmic_axis_has_names_at_one_two_and_five_in_one_line(ends, names):
    panel = _logarithmic(*ends)
    panel.figure.canvas.draw()
    seen = [tick for which in (0, 1) for tick in panel.get_xticklabels(which=("major", "minor")[which])]
    seen = [text for text in seen if text.get_text() and ends[0] <= text.get_position()[0] <= ends[1] * (1 + 1e-9)]
    told = [text.get_text() for text in sorted(seen, key=lambda text: text.get_position()[0])]
    if names.startswith("10$"):
        assert "1" not in told  # powers of ten, as matplotlib writes them
        return
    assert told == names.split()
    assert len({round(text.get_window_extent().y1, 1) for text in seen}) == 1
    if ends[0] < 1 < ends[1]:
        fine = [tick.gridline for tick in panel.xaxis.get_minor_ticks()]
        assert all(line.get_visible() and line.get_linewidth() < 0.4 for line in fine)


@styled
def _logarithmic(low, high, ax=None):
    (panel,) = axes(ax, 1, height=1.5)
    panel.semilogx([low, high], [0.0, 1.0])
    panel.set_xlim(low, high)
    decimal(panel.xaxis)
    return panel


def test_a_frequency_response_names_amplitude_and_quotient():
    response = frequency_response(tsm.load("motor_linear"), [1.0], [0.1, 1.0])
    figure = drawn(response)
    assert figure.axes[0].get_legend().get_title().get_text() == "amplitude of u [V]"
    assert figure.get_suptitle().endswith(": x / u")


def test_values_of_a_logarithmic_plan_are_drawn_on_a_logarithmic_axis():
    plan = latin_hypercube({"pid.kp": Uniform(0.01, 10.0, log=True), "theta": (4.0, 5.0)}, 40, seed=1)
    found = tsm.study(LOOP, plan, METRICS, stop=0.1)
    scales = {panel.get_xlabel(): panel.get_xscale() for panel in found.plot().axes[1:]}
    assert scales == {"pid.kp": "log", "theta": "linear"}
    curve = tsm.study(LOOP, {"pid.kp": [0.1, 1.0, 10.0]}, METRICS, stop=0.1).plot().axes[0]
    assert curve.get_xscale() == "log"
    assert {"0.1", "1", "10"} <= {text.get_text() for text in curve.get_xticklabels()}
    even = tsm.study(LOOP, {"pid.kp": [1.0, 10.0, 19.0]}, METRICS, stop=0.1).plot().axes[0]
    assert even.get_xscale() == "linear"


def test_cells_of_a_heat_map_surround_their_values_on_either_scale():
    plan = grid({"pid.kp": [0.1, 1.0, 10.0], "theta": [4.0, 5.0]})
    panel = tsm.study(LOOP, plan, METRICS, stop=0.1).plot().axes[0]
    assert (panel.get_xscale(), panel.get_yscale()) == ("log", "linear")
    corners = panel.collections[0].get_coordinates()
    np.testing.assert_allclose(corners[0, :, 0], 10.0 ** np.array([-1.5, -0.5, 0.5, 1.5]))
    np.testing.assert_allclose(corners[:, 0, 1], [3.5, 4.5, 5.5])


def test_a_loop_that_hunts_is_shown_where_it_swings_most():
    found = tsm.tune(
        tsm.load("fig16_feedforward_feedback"),
        GAINS,
        ERROR,
        subject_to=["largest(abs(u)) <= 12"],
        stop=10.0,
        step=2e-3,
        starts=1,
    )
    assert isinstance(found.oscillation, Oscillation)
    assert f"{found.oscillation.frequency:.2g} Hz" in found.hunting[0]
    *metrics, swings = drawn(found).axes
    assert len(metrics) == 2
    assert swings.get_title(loc="left") == f"the loop hunts, swings at about {found.oscillation.frequency:.2g} Hz"
    before, tuned = swings.lines
    assert (before.get_label(), tuned.get_label()) == ("before", "tuned")
    assert (before.get_color(), tuned.get_color()) == (LIGHT["before"], LIGHT["after"])
    t, y = tuned.get_data()
    assert t[-1] - t[0] == pytest.approx(12 / found.oscillation.frequency, rel=0.01)
    assert np.ptp(y) > 0.8 * np.ptp(found.oscillation.tuned)
    run = tsm.simulate(found.diagram, stop=10.0, step=2e-3)
    np.testing.assert_allclose(found.oscillation.tuned, run["u"][run.t >= 5.0 - 1e-9], atol=1e-12)


def test_the_same_colour_means_the_same(values):
    fit = next(value for value in values if isinstance(value, tsm.Fit))
    history, residual, *_ = drawn(fit).axes
    colours = {line.get_label(): line.get_color() for panel in (history, residual) for line in panel.lines}
    assert colours["measured"] == LIGHT["measured"]
    assert (colours["simulated"], colours["residual"]) == (LIGHT["after"], RESIDUAL)
    shades = [matplotlib.colors.to_hex(patch.get_facecolor()) for panel in drawn(fit).axes for patch in panel.patches]
    assert shades == [LIGHT["floor"], RESIDUAL]  # noise of the measurement, and what white noise stays in
    found = next(value for value in values if isinstance(value, tsm.Diagnosis))
    residuals = {line.get_label(): line.get_color() for line in drawn(found).axes[1].lines}
    assert residuals == {"before": LIGHT["before"], "after": LIGHT["after"]}


def test_the_legend_of_a_diagnosis_has_bars_lines_dots_and_the_strip(values):
    figure = drawn(next(value for value in values if isinstance(value, tsm.Diagnosis)))
    (legend,) = figure.legends
    labels = [text.get_text() for text in legend.get_texts()]
    assert len(labels) == len(set(labels))
    assert {"before", "after", "noise", "error by block of time", "reported effects"} <= set(labels)
    bars, residual, loop, along = figure.axes
    assert bars.get_title(loc="left") == "x_in -> x_out: backlash"
    for panel in (bars, residual, loop, along):
        assert {"before", "after"} <= set(panel.get_legend_handles_labels()[1])
    signs = [type(sign).__name__ for sign in legend.get_patches() + legend.get_lines() + legend.findobj(LineCollection)]
    assert signs.count("Rectangle") >= 5  # two bars, a hollow one, noise and strip
    assert "LineCollection" in signs  # standard errors of the dots


def test_labels_of_axes_keep_clear_of_ticks_and_stand_in_one_line(values):
    """An underscore beside a tick with a minus read as part of it."""
    run = next(value for value in values if isinstance(value, tsm.Run))
    figure = drawn(run, width=3.4)
    boxes = [panel.yaxis.label.get_window_extent() for panel in figure.axes]
    assert len(boxes) > 1
    assert len({round(box.x1, 1) for box in boxes}) == 1
    for panel, box in zip(figure.axes, boxes, strict=True):
        low, high = panel.get_ylim()
        ticks = [text for text in panel.get_yticklabels() if low <= text.get_position()[1] <= high]
        assert min(text.get_window_extent().x0 for text in ticks) - box.x1 > 3.5 * figure.dpi / 72
        assert not any("-" in text.get_text() for text in ticks)  # a minus is no hyphen


def test_a_model_that_misses_nothing_has_the_colour_of_a_model(values):
    fitted = tsm.load("tendon_sheath_play")
    record = next(value for value in values if isinstance(value, tsm.Record))
    found = tsm.diagnose(fitted, record, noise_floor=0.002, effects=["drift"])
    assert found.verdict == "none"
    bars, residual, *_ = drawn(found).axes
    assert matplotlib.colors.to_hex(bars.patches[0].get_facecolor()) == LIGHT["after"]
    assert [line.get_label() for line in residual.lines] == ["model"]
    assert bars.patches[0].get_height() < 0.5 * np.ptp(bars.get_ylim())


def test_plots_that_are_drawn_again_on_a_figure_made_here_keep_its_style():
    t = np.linspace(0, 6.3, 100)
    figure = plots.plot_loop(np.sin(t), np.cos(t), label="one")
    plots.plot_loop(np.sin(t), 0.5 * np.cos(t), figure.axes[0], label="two")
    legend = figure.axes[0].get_legend()
    assert [text.get_text() for text in legend.get_texts()] == ["one", "two"]
    assert {text.get_fontsize() for text in legend.get_texts()} == {8.0}
