"""Models compared: ranking on what was held out, parts and experiments, models that fail, default models, results."""

import json

import numpy as np
import pytest

import tsmblocks as tsm
from tests.test_fit_methods import LINEAR, noisy, own_play
from tests.test_fit_problem import record
from tsmblocks.blocks import Gain, Integrator, Square
from tsmblocks.cli import console
from tsmblocks.fitting import compare as comparing
from tsmblocks.fitting.compare import ready_made
from tsmblocks.fitting.text import ranking_rows
from tsmblocks.model.block import Block, Input, Output, block, parameter

T = 0.01 * np.arange(601)
U = 0.6 * np.sin(2.1 * T) + 0.4 * np.sin(5.3 * T)
RAD = {"x_in": "rad", "x_out": "rad"}
PLAY = tsm.load("tendon_sheath_play")
QUICK = dict(starts=1, step=0.01)


def rig(name="rig", half_width=0.15, bias=0.05, seed=0, sigma=0.01):
    return record(name, T, RAD, x_in=U, x_out=noisy(own_play((half_width, 0.9, bias), U), sigma, seed))


@block(register=False)
class Curve(Block):
    """A polynomial: with many coefficients it is better at what it has seen, and worse at what it has not."""

    k: tuple[float, ...] = parameter(default=(0.0, 1.0), about="coefficients, that of the constant first")
    u = Input("any signal", unit="rad")
    y = Output("the curve", unit="rad")

    def outputs(self, t, x, u):
        return dict(y=sum(k * u.u**i for i, k in enumerate(self.k)))


def curve(order):
    return tsm.Diagram(
        title=f"order {order}",
        blocks=dict(map=Curve(k=tuple(0.1 * (i == 1) for i in range(order + 1)))),
        inputs={"x_in": "map"},
        outputs={"x_out": "map"},
    )


@pytest.fixture(scope="module")
def ranked():
    return tsm.compare({"line": LINEAR, "slack": PLAY}, [rig(), rig("other", seed=1)], **QUICK)


# ---- the ranking


def test_the_model_that_made_the_data_wins(ranked):
    assert [row.name for row in ranked] == ["slack", "line"]
    assert ranked.best.figure == pytest.approx(0.01, rel=0.1)  # the noise
    assert ranked["slack"].train.rms < ranked["line"].train.rms


def test_each_figure_is_a_score_of_the_fit_on_the_rest(ranked):
    for row in ranked:
        parts = []
        for name, seed in (("rig", 0), ("other", 1)):
            data = rig(name, seed=seed)
            run = tsm.simulate(row.fit.diagrams[name], step=0.01, inputs={"x_in": tsm.Samples(T, U)})
            parts.append((data["x_out"] - run["x_out"])[T > 3.0])
        assert row.figure == row.held_out.rms == pytest.approx(np.sqrt(np.mean(np.concatenate(parts) ** 2)), rel=1e-9)
        assert [len(d.t) for d in row.train] == [301, 301]
        assert [d.t[0] for d in row.held_out] == pytest.approx([3.01, 3.01])


def test_what_fits_best_need_not_foretell_best():
    flat = record("flat", T, RAD, x_in=0.4 * T / 6, x_out=noisy(0.3 * T / 6, 0.01))
    found = tsm.compare([curve(1), curve(7)], flat, train=0.6, **QUICK)
    assert [row.name for row in found] == ["order 1", "order 7"]
    assert found["order 7"].train.rms < found["order 1"].train.rms
    assert found["order 7"].parameters == 8


def test_start_values_do_not_count_as_parameters(ranked):
    assert ranked["slack"].parameters == 3
    assert {e.name for e in ranked["slack"].fit if e.is_start} == {"play.m@rig", "play.m@other"}
    plain = tsm.compare({"slack": PLAY}, rig(), start_states=False, **QUICK)
    assert not any(e.is_start for e in plain.best.fit)


# ---- parts


@pytest.mark.parametrize(
    ("train", "fitted", "held"),
    [
        (0.5, (0.0, 3.0), (3.01, 6.0)),
        (0.25, (0.0, 1.5), (1.51, 6.0)),
        ((1.0, 4.0), (1.0, 4.0), (4.01, 6.0)),
        ((2.0, None), (2.0, 6.0), (0.0, 1.99)),
        ({"rig": (None, 2.0)}, (0.0, 2.0), (2.01, 6.0)),
        (1, (0.0, 6.0), None),
        (1.0, (0.0, 6.0), None),
        ((None, None), (0.0, 6.0), None),
        (None, (0.0, 3.0), (3.01, 6.0)),
    ],
)
def test_parts_that_are_fitted_and_held_out(train, fitted, held):
    row = tsm.compare({"line": LINEAR}, rig(), train=train, **QUICK).best
    assert (row.train["rig"].t[0], row.train["rig"].t[-1]) == pytest.approx(fitted)
    if held is None:
        assert row.held_out is None
        assert row.figure == row.train.rms
    else:
        assert (row.held_out["rig"].t[0], row.held_out["rig"].t[-1]) == pytest.approx(held)


def test_whole_experiments_are_held_out():
    data = [rig(), rig("other", half_width=0.1, seed=1)]
    row = tsm.compare({"slack": PLAY}, data, train=1, held_out=["other"], **QUICK).best
    assert [d.experiment for d in row.train] == ["rig"]
    assert [d.experiment for d in row.held_out] == ["other"]
    assert row.figure == pytest.approx(tsm.score(row.fit.diagram, data[1], step=0.01).rms, rel=1e-9)
    default = tsm.compare({"slack": PLAY}, data, held_out=["other"], **QUICK).best
    assert default.figure == row.figure
    both = tsm.compare({"slack": PLAY}, data, train=0.5, held_out="other", **QUICK).best
    assert [(d.experiment, len(d.t)) for d in both.held_out] == [("other", 601), ("rig", 300)]


# ---- models


def test_a_model_that_cannot_be_fitted_comes_last_with_its_reason():
    elsewhere = tsm.Diagram(title="elsewhere", blocks=dict(k=Gain()), inputs={"angle": "k"}, outputs={"x_out": "k"})
    found = tsm.compare({"none": elsewhere, "line": LINEAR, "slack": PLAY}, rig(), **QUICK)
    assert [row.name for row in found] == ["slack", "line", "none"]
    row = found["none"]
    assert (row.fit, row.train, row.held_out, row.figure, row.parameters) == (None, None, None, np.inf, 0)
    assert row.fault == (
        "rig: 'elsewhere' needs its input 'angle', and the recording has no such signal. Known here: x_in, x_out. If "
        "it has another name there, map it when reading: map={'angle': 'COLUMN'}, or --map 'angle=COLUMN'."
    )
    assert "needs its input 'angle'" in " ".join(str(found).split())


def test_a_model_that_escapes_where_it_is_held_out_was_fitted_and_comes_last():
    """1 / (4 - t) fits the first half without fault, and ends at 4 s."""
    blocks = dict(square=Square(), grows=Integrator(integral=0.25))
    escapes = tsm.Diagram(
        title="escapes", blocks=blocks, wires=["grows -> square -> grows"], outputs={"x_out": "grows"}
    )
    y = np.where(T < 3.0, 1 / (4.0 - np.minimum(T, 3.0)), np.cos(T - 3.0))
    data = record("rig", T, RAD, x_in=T, x_out=noisy(y, 0.003, 0))
    found = tsm.compare({"escapes": escapes, "line": LINEAR}, data, **QUICK)
    assert [row.name for row in found] == ["line", "escapes"]
    row = found["escapes"]
    assert (row.held_out, row.figure) == (None, np.inf)
    assert row.train.rms == row.fit.differences.rms == pytest.approx(0.003, rel=0.2)
    said = "with the fitted parameters, experiment 'rig' cannot be simulated: "
    assert row.fault.startswith(said)
    assert "diverges" in row.fault
    told = " ".join(str(found).split())
    assert "could not be fitted" not in told
    assert "could not be fitted" not in found._repr_html_()
    assert f"- escapes: {said}" in told
    assert ranking_rows(found)[2][:4] == ("escapes", "1", "-", f"{row.train.rms:.4g}")
    assert found.to_dict()["models"][1]["train"]["rms"] == row.train.rms


def test_without_models_those_for_tendon_sheaths_are_compared():
    short = rig().part(stop=1.5)
    found = tsm.compare(None, short, starts=1, step=0.01)
    assert (
        {f"tendon_sheath_{row.name}" for row in found}
        == set(ready_made())
        >= {"tendon_sheath_linear", "tendon_sheath_symmetric", "tendon_sheath_asymmetric", "tendon_sheath_play"}
    )
    figures = [row.figure for row in found]
    assert figures == sorted(figures)


def test_models_come_as_names_files_diagrams_or_a_mapping(tmp_path):
    path = tsm.fit(PLAY, rig(), **QUICK).save(tmp_path / "mine.toml")
    found = tsm.compare(["tendon_sheath_linear", path, PLAY], rig(), **QUICK)
    assert {row.name for row in found} == {"linear", "mine", PLAY.title}
    assert tsm.compare("tendon_sheath_linear", rig(), **QUICK).best.name == "linear"
    assert tsm.compare(LINEAR, rig(), **QUICK).best.name == LINEAR.title


def test_the_names_that_are_shown_stand_for_the_models(tmp_path, monkeypatch):
    found = tsm.compare(["linear", "play"], rig(), **QUICK)
    again = tsm.compare([row.name for row in found], rig(), **QUICK)
    assert {row.name: row.figure for row in again} == {row.name: row.figure for row in found}
    monkeypatch.chdir(tmp_path)
    (tmp_path / "play").write_text(tsm.dumps(LINEAR))  # a file of that name is the file
    assert tsm.compare(["play"], rig(), **QUICK).best.fit.diagram.title == LINEAR.title


def test_what_is_free_is_said_model_by_model():
    found = tsm.compare({"line": LINEAR, "slack": PLAY}, rig(), free={"line": ["offset.bias"]}, **QUICK)
    assert found["line"].fit.names == ("offset.bias",)
    assert found["slack"].parameters == 3


# ---- progress, Ctrl-C, seed


def test_progress_names_the_model():
    told = []
    tsm.compare({"line": LINEAR, "slack": PLAY}, rig(), progress=lambda *now: told.append(now), **QUICK)
    assert list(dict.fromkeys(name for name, _, _ in told)) == ["line", "slack"]


def test_ctrl_c_keeps_the_models_so_far():
    def stop(name, *_):
        if name == "slack":
            raise KeyboardInterrupt

    models = {"line": LINEAR, "slack": PLAY, "never": curve(1)}
    found = tsm.compare(models, rig(), progress=stop, **QUICK)
    assert found.interrupted
    assert {row.name for row in found} == {"line", "slack"}
    assert found["slack"].fit.status == "interrupted"


def test_ctrl_c_between_two_fits_keeps_the_models_so_far(monkeypatch):
    whole = comparing.score

    def press(diagram, *given, **more):
        if diagram.title == PLAY.title:
            raise KeyboardInterrupt
        return whole(diagram, *given, **more)

    monkeypatch.setattr(comparing, "score", press)
    models = {"line": LINEAR, "slack": PLAY, "never": curve(1)}
    found = tsm.compare(models, rig(), **QUICK)
    assert found.interrupted
    assert [row.name for row in found] == ["line"]
    with pytest.raises(KeyboardInterrupt):
        tsm.compare({"slack": PLAY}, rig(), **QUICK)


def test_same_seed_same_ranking():
    one, other = (tsm.compare([LINEAR, PLAY], rig(), starts=3, seed=4) for _ in range(2))
    assert json.dumps(one.to_dict()) == json.dumps(other.to_dict())


# ---- the result


def test_rows_by_name_and_in_order(ranked):
    assert len(ranked) == 2
    assert ranked.best is ranked["slack"] is next(iter(ranked))
    assert not ranked.interrupted
    assert ranked.unit == "rad"


def test_all_of_it_is_plain_json(ranked):
    told = json.loads(json.dumps(console.json_value(ranked.to_dict()), allow_nan=False))
    assert [m["name"] for m in told["models"]] == ["slack", "line"]
    assert told["models"][0]["held_out"]["rms"] == pytest.approx(ranked.best.figure)
    assert told["models"][0]["fit"]["format"] == told["format"] == 1
    assert told["models"][1]["fault"] is None


def test_a_table_is_shown_in_degrees(ranked):
    text = str(ranked)
    assert "deg" in text
    assert f"{np.rad2deg(ranked.best.figure):.4g}" in text
    assert text.index("slack") < text.index("line")


def test_how_far_the_best_stays_from_the_noise_is_told(ranked):
    assert ranked.noise == pytest.approx(0.01, rel=0.15)
    assert ranked.above_noise == pytest.approx(ranked.best.figure / ranked.noise)
    assert str(ranked).startswith(f"slack fits best: its error is {ranked.above_noise:#.2g} times the noise floor")
    assert (
        " deg rms, from repeats: what differs between recordings with the same inputs). "
        in str(ranked).replace("\n", " ") + " "
    )
    assert "tsmblocks diagnose" not in str(ranked)
    poor = tsm.compare({"line": LINEAR}, rig(), **QUICK)
    assert poor.above_noise > 1.5
    assert f"{poor.above_noise:#.2g} times the noise floor (" in str(poor).replace("\n", " ")
    assert str(poor).startswith("The error of line is ")
    assert "). It lacks an effect, or is simulated with the wrong hold or step. " in str(poor).replace("\n", " ")
    both = tsm.compare({"line": LINEAR, "another": LINEAR}, rig(), **QUICK)
    assert "). Every model leaves more than noise: all of them lack an effect, " in str(both).replace("\n", " ")
    assert "A diagnosis (tsm.diagnose, tsmblocks diagnose) searches for it." in str(poor).replace("\n", " ")
    assert poor.to_dict()["noise"] == poor.noise


def test_several_outputs_have_no_noise_in_common():
    both = tsm.Diagram(
        title="both",
        blocks=dict(a=Gain(gain=0.5), b=Gain(gain=2.0)),
        inputs={"x_in": ["a.u", "b.u"]},
        outputs={"x_out": "a", "other": "b"},
    )
    data = record("two", T, {}, x_in=U, x_out=noisy(0.6 * U, 0.01, 1), other=noisy(1.7 * U, 0.05, 2))
    found = tsm.compare({"both": both}, data, **QUICK)
    assert np.isnan(found.noise)
    assert found.to_dict()["noise"] is None
    assert "noise" not in str(found)


def test_a_model_whose_numbers_the_data_leave_open_is_told_in_its_row():
    twice = tsm.Diagram(
        title="twice",
        blocks=dict(a=Gain(gain=0.5), b=Gain(gain=2.0)),
        wires=["a -> b"],
        inputs={"x_in": tsm.Inlet("a.u", unit="rad")},
        outputs={"x_out": "b"},
    )
    once = twice.replace("b", tsm.blocks.Bias())
    found = tsm.compare({"twice": twice, "once": once}, rig(), **QUICK)
    assert {row[0]: row[-1] for row in ranking_rows(found)[1:]} == {"twice": "not determined", "once": ""}
    assert str(found).count("not determined") == 1
    (row,) = (line.split() for line in str(found).splitlines() if line.startswith("twice "))
    assert row[1] == f"{found['twice'].parameters}?"


def test_it_can_be_drawn(ranked):
    pytest.importorskip("matplotlib").use("Agg")
    assert len(ranked.plot().axes) >= 1
