"""Figures of fits and comparisons: what is on which axes, in which unit. The pictures themselves are looked at."""

import attrs
import numpy as np
import pytest

import tsmblocks as tsm
from tsmblocks.fitting.score import Difference, Differences
from tsmblocks.plots import (
    plot_autocorrelation,
    plot_comparison,
    plot_each,
    plot_fit,
    plot_fitted_loop,
    plot_history,
    plot_residual,
)

figure = pytest.importorskip("matplotlib.figure", reason="the extra [plots] brings it")

T = np.arange(0.0, 8.0, 0.02)
X = 0.9 * np.sin(1.3 * T) + 0.2 * np.sin(3.1 * T)
NOISE = 0.01


def record(name, seed=0, gain=0.8):
    y = gain * X + np.random.default_rng(seed).normal(0.0, NOISE, len(T))
    return tsm.Record(name, T, {"x_in": X, "x_out": y}, {"x_in": "rad", "x_out": "rad"})


def fitted(*records):
    return tsm.fit(tsm.load("tendon_sheath_linear"), list(records), starts=1)


@pytest.fixture(scope="module")
def one():
    return fitted(record("bend 60"))


def labels(panel):
    return [label for label in panel.get_legend_handles_labels()[1] if label]


def line(panel, label):
    return next(line for line in panel.lines if line.get_label() == label)


def test_a_fit_has_four_panels_in_degrees_and_one_legend(one):
    made = plot_fit(one)
    history, residual, loop, colour = made.axes
    assert made.get_suptitle() == "Tendon sheath: a gain and an offset"
    difference = one.differences["bend 60"]
    np.testing.assert_allclose(line(history, "measured").get_ydata(), np.degrees(difference.measured))
    np.testing.assert_allclose(line(history, "simulated").get_ydata(), np.degrees(difference.simulated))
    np.testing.assert_allclose(line(residual, "residual").get_ydata(), np.degrees(difference.residual))
    np.testing.assert_allclose(line(loop, "measured").get_xdata(), np.degrees(X))
    assert [panel.get_xlabel() for panel in made.axes] == ["t [s]", "t [s]", "x_in [deg]", "lag [s]"]
    assert [panel.get_ylabel() for panel in made.axes] == [
        "x_out [deg]",
        "residual [deg]",
        "x_out [deg]",
        "autocorrelation",
    ]
    rms, largest = np.degrees([difference.rms, difference.largest])
    assert history.get_title(loc="left") == "bend 60, x_out"
    assert residual.get_title(loc="left") == f"residual: rms {rms:.3g}, largest {largest:.3g} deg"
    assert line(colour, "residual").get_xdata()[0] == 0.0
    (legend,) = made.legends
    told = [text.get_text() for text in legend.get_texts()]
    assert told == ["measured", "simulated", "noise (± 2 rms)", "residual", "95 % band, white noise"]
    assert all(panel.get_legend() is None for panel in made.axes)
    made.canvas.draw()


def test_every_experiment_has_a_row_and_axes_are_named_once(one):
    made = plot_fit(fitted(record("a"), record("b", 1), record("c", 2)))
    panels = np.array(made.axes).reshape(3, 4)
    assert [row[0].get_title(loc="left") for row in panels] == ["a, x_out", "b, x_out", "c, x_out"]
    assert [[panel.get_xlabel() != "" for panel in row] for row in panels] == [[False] * 4, [False] * 4, [True] * 4]


def test_what_is_too_much_to_draw_is_counted(one):
    (difference,) = one.differences
    many = Differences("many", tuple(attrs.evolve(difference, experiment=f"e{k}") for k in range(10)))
    made = plot_fit(many)
    assert len(made.axes) == 8 * 4
    assert made.get_suptitle() == "many (the first 8 of 10)"


def test_the_residual_lies_in_the_band_of_the_noise(one):
    (difference,) = one.differences
    (residual,) = plot_residual(difference).axes
    (band,) = residual.patches
    corners = band.get_extents().transformed(residual.transData.inverted())
    assert corners.y1 == pytest.approx(2 * np.degrees(NOISE), rel=0.15)
    assert corners.y0 == pytest.approx(-corners.y1)
    left = line(residual, "residual").get_ydata()
    assert 0.92 < np.mean(np.abs(left) < corners.y1) < 0.98


def test_the_autocorrelation_is_over_seconds_and_white_noise_keeps_to_its_band(one):
    (difference,) = one.differences
    (colour,) = plot_autocorrelation(difference).axes
    lag, rho = line(colour, "residual").get_data()
    r = difference.residual
    assert (lag[1], rho[0]) == (pytest.approx(0.02), 1.0)
    assert rho[3] == pytest.approx(r[3:] @ r[:-3] / (r @ r))
    (band,) = colour.patches
    corners = band.get_extents().transformed(colour.transData.inverted())
    assert corners.y1 == pytest.approx(1.96 / np.sqrt(len(r)), rel=1e-3)
    low, high = colour.get_ylim()
    assert corners.y1 > 0.25 * high  # the band is seen
    assert (-low, np.abs(rho[1:]).max() < high) == (high, True)


def test_the_autocorrelation_of_a_residual_that_is_no_noise_is_seen_as_a_whole(one):
    (difference,) = one.differences
    slow = attrs.evolve(difference, simulated=difference.measured - np.sin(T))
    (colour,) = plot_autocorrelation(slow).axes
    assert colour.get_ylim()[1] == pytest.approx(1.05)


@pytest.mark.parametrize("draw", [plot_history, plot_residual, plot_fitted_loop, plot_autocorrelation])
def test_each_panel_can_be_drawn_alone(one, draw):
    (difference,) = one.differences
    mine = figure.Figure()
    left, right = mine.subplots(1, 2)
    assert draw(difference, right) is mine
    assert (len(left.lines), len(right.lines) > 0) == (0, True)
    own = draw(difference)
    assert own is not mine
    assert [text.get_text() for text in own.axes[0].get_legend().get_texts()] == labels(own.axes[0])
    assert labels(own.axes[0]) == labels(right) != []


@pytest.mark.parametrize("inputs", [{}, {"u": (X, "V"), "v": (X, "")}])
def test_without_one_input_measured_is_drawn_over_simulated(inputs):
    difference = Difference("e", "y", "N", T, X + 0.1, X, inputs)
    (panel,) = plot_fitted_loop(difference).axes
    np.testing.assert_array_equal(panel.lines[0].get_data(), (X, X + 0.1))
    assert (panel.get_xlabel(), panel.get_ylabel()) == ("y simulated [N]", "measured [N]")
    assert panel.lines[1].get_slope() == 1


def test_a_few_samples_and_a_perfect_simulation_are_drawn_all_the_same():
    few = Difference("e", "y", "", T[:5], X[:5], X[:5] + 0.1, {})
    (residual,) = plot_residual(few).axes
    assert labels(residual) == ["residual"]  # five samples say nothing of noise
    plot_fit(Differences("d", (few, Difference("f", "y", "", T, X, X, {})))).canvas.draw()


# ---- models beside each other


@pytest.fixture(scope="module")
def comparison():
    return tsm.compare(["tendon_sheath_linear", "tendon_sheath_play"], record("r"), starts=1)


def test_a_comparison_shows_every_model_and_the_best_in_detail(comparison):
    made = plot_comparison(comparison)
    errors, loop, residual = made.axes
    best = comparison.best
    figures = np.degrees([row.figure for row in comparison])[::-1]
    np.testing.assert_allclose(line(errors, "rms held-out").get_xdata(), figures)
    np.testing.assert_allclose(
        line(errors, "rms in-sample").get_xdata(), np.degrees([row.train.rms for row in comparison])[::-1]
    )
    assert errors.get_xlabel() == "rms held-out [deg]"
    assert [text.get_text() for text in errors.get_yticklabels()] == [
        f"{row.name}  {np.degrees(row.figure):.3g}" for row in comparison.rows[::-1]
    ]
    assert loop.get_title(loc="left") == f"{best.name}: r, x_out (held out)"
    np.testing.assert_array_equal(line(residual, "residual").get_xdata(), best.held_out["r"].t)
    assert len(made.legends) == 1
    made.canvas.draw()


def test_without_held_out_parts_the_error_is_that_of_the_fit():
    made = plot_comparison(tsm.compare(["tendon_sheath_linear"], record("r"), train=1, starts=1))
    errors, loop, _ = made.axes
    assert (labels(errors), errors.get_xlabel()) == (["rms"], "rms [deg]")
    assert loop.get_title(loc="left") == "linear: r, x_out"


def test_errors_far_apart_stand_on_a_scale_that_keeps_the_best_apart(comparison):
    near, far = comparison.rows
    assert plot_comparison(comparison).axes[0].get_xscale() == "linear"
    worse = attrs.evolve(
        far, held_out=Differences("d", tuple(attrs.evolve(d, simulated=d.simulated + 1) for d in far.held_out))
    )
    panel = plot_comparison(attrs.evolve(comparison, rows=(near, worse))).axes[0]
    assert panel.get_xscale() == "log"
    assert "10" in [label.get_text() for label in panel.get_xticklabels()]


def test_files_fitted_by_themselves_have_a_mark_each(comparison):
    near, far = comparison.rows
    failed = attrs.evolve(far, fit=None, train=None, held_out=None, fault="did not run")
    found = {"a": comparison, "b": attrs.evolve(comparison, rows=(near, failed))}
    (panel,) = plot_each(found).axes
    assert labels(panel) == ["a", "b", "all"]
    assert [text.get_text().split()[0] for text in panel.get_yticklabels()] == [far.name, near.name]
    np.testing.assert_allclose(line(panel, "a").get_xdata(), np.degrees([near.figure, far.figure]))
    np.testing.assert_array_equal(line(panel, "a").get_ydata(), [1, 0])
    np.testing.assert_allclose(line(panel, "b").get_xdata(), np.degrees([near.figure]))
    assert line(panel, "a").get_color() != line(panel, "b").get_color()
    assert line(panel, "a").get_marker() != line(panel, "b").get_marker()
    mine = figure.Figure().subplots()
    assert plot_each(found, mine) is mine.figure
