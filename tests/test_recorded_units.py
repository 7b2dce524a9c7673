"""Fits and diagnoses show outputs in the units of the recordings; files keep those of the diagram."""

import json
import re

import numpy as np
import pytest

import tsmblocks as tsm
from tsmblocks.blocks import Gain, Integrator, Play
from tsmblocks.cli import main
from tsmblocks.html.report import page

T = np.arange(0.0, 8.0, 0.01)
U = np.sin(2.3 * T) + 0.4 * np.sin(7.1 * T)


def press(gain=2e6):
    """A press: a pressure in proportion to a voltage, and a ram that moves by it."""
    return tsm.Diagram(
        title="Press",
        blocks={"valve": Gain(gain=gain, unit="Pa"), "flow": Gain(gain=5e-8, unit="m/s"), "ram": Integrator()},
        wires=["valve -> flow -> ram"],
        inputs={"u": tsm.Inlet(("valve.u",), "V", "")},
        outputs={"p": "valve.y", "x": "ram.y"},
    )


def recorded(pressure=("bar", 1e-5), position=("mm", 1e3), name="press", noise=1.0):
    """A recording of it in some units, with 0.1 bar and 0.05 mm of noise."""
    run, rng = tsm.simulate(press(), inputs={"u": (T, U)}, stop=T[-1], step=0.01), np.random.default_rng(1)
    p = pressure[1] * (run["p"] + noise * 1e4 * rng.standard_normal(len(T)))
    x = position[1] * (run["x"] + noise * 5e-5 * rng.standard_normal(len(T)))
    return tsm.Record(name, T, {"u": U, "p": p, "x": x}, {"u": "V", "p": pressure[0], "x": position[0]})


@pytest.fixture(scope="module")
def fit():
    return tsm.fit(press(1.5e6), recorded(), free=["valve.gain"])


def test_residuals_of_a_fit_are_in_the_units_of_the_recording(fit):
    p, x = str(fit).partition("residual")[2].splitlines()[1:3]
    assert [*p.split()[:2], p.split()[4]] == ["press,", "p", "bar"]
    assert float(p.split()[2]) == pytest.approx(0.1, rel=0.1)
    assert x.split()[4] == "mm"
    assert float(x.split()[2]) == pytest.approx(0.05, rel=0.1)


def test_files_of_a_fit_keep_the_units_of_the_diagram(fit):
    first = json.loads(json.dumps(fit.to_dict()))["differences"]["items"][0]
    assert first["unit"] == "Pa"
    assert first["rms"] == pytest.approx(1e4, rel=0.1)
    assert "bar" not in tsm.dumps(fit.diagram)


def test_plots_and_cards_of_a_fit_are_in_the_units_of_the_recording(fit):
    assert {"p [bar]", "x [mm]"} <= {panel.get_ylabel() for panel in fit.plot().axes}
    card = fit._repr_html_()
    assert "<td>bar</td>" in card.replace(' class="l"', "")
    assert "Pa" not in card.replace("tsmblocks", "").partition("Residuals")[2]


def test_of_several_recordings_the_first_unit_is_that_of_an_output():
    second = recorded(pressure=("kPa", 1e-3), name="second")
    both = tsm.score(press(), [recorded(), second], outputs=["p"])
    rows = [line.split() for line in str(both).splitlines() if ", p " in line]
    assert [row[4] for row in rows] == ["bar"] * 3
    assert rows[-1][0] == "all,"


def test_a_quantity_of_another_kind_leaves_a_unit_as_it_was():
    without = tsm.Record("press", T, dict(recorded().signals), {"u": "V"})
    assert " Pa " in str(tsm.score(press(), without, outputs=["p"]))


def test_a_comparison_is_in_the_unit_of_the_recording():
    models = {"right": press(), "wrong": press(1e6)}
    compared = tsm.compare(models, recorded(), free={name: ["flow.gain"] for name in models}, outputs=["p"])
    assert "rms in-sample [bar]" in str(compared)
    assert "bar rms" in " ".join(str(compared).split())
    assert compared.to_dict()["unit"] == "Pa"


def test_a_run_beside_a_recording_has_its_residuals_in_the_units_of_that(tmp_path, capsys):
    model, data = tmp_path / "press.toml", tmp_path / "press.csv"
    tsm.save(press(), model)
    recorded().save(data)
    assert main(["run", str(model), "--data", str(data)]) == 0
    table = capsys.readouterr().out.partition("measured less run")[2]
    assert re.search(r"\np +[\d.]+ bar +0\.\d+ bar", table)
    assert re.search(r"\nx +[\d.]+ mm +0\.\d+ mm", table)


# ---- a diagnosis


@pytest.fixture(scope="module")
def found():
    worn = press().insert("gap", Play(half_width=1e-3), before="x")
    run, rng = tsm.simulate(worn, inputs={"u": (T, U)}, stop=T[-1], step=0.01), np.random.default_rng(1)
    p, x = 1e-5 * run["p"] + 0.1 * rng.standard_normal(len(T)), 1e3 * run["x"] + 0.05 * rng.standard_normal(len(T))
    record = tsm.Record("press", T, {"u": U, "p": p, "x": x}, {"u": "V", "p": "bar", "x": "mm"})
    return tsm.diagnose(press(), record, free=["valve.gain", "flow.gain"], effects=["backlash", "drift", "rate_limit"])


def test_a_diagnosis_names_an_effect_in_the_unit_of_the_recording(found):
    (effect,) = found.effects
    assert effect.name == "backlash"
    assert re.search(r"gap width [12]\.\d+ ± 0\.\d+ mm\b", found.sentence)
    assert effect.sizes["gap width"].unit == "m"
    assert effect.sizes["gap width"].value == pytest.approx(2e-3, rel=0.05)
    assert re.search(r"half_width +(1\.0|0\.9)\d+ ± 0\.\d+ mm", found.details())


def test_tables_and_limits_of_a_diagnosis_are_in_the_units_of_the_recording(found):
    text = f"{found}\n\n{found.details()}"
    assert "rms of p [bar]" in text
    assert "rms of x [mm]" in text
    assert re.search(r"drift +(total drift|offset in the end) [\d.]+ (mm|bar)\n", text)
    assert re.search(r"rate_limit +fastest rise below [\d.]+ (mm|bar)/s\n", text)
    results = text.partition("changes from the fitted base model")[0] + found.details().partition("in a script")[0]
    assert not re.search(r"\d (Pa|m)\b", results)


def test_the_report_and_plots_of_a_diagnosis_are_in_the_units_of_the_recording(found):
    text = page(found)
    assert "rms of p [bar]" in text
    assert "residual of x [mm]" in text
    axes = {panel.get_ylabel() for panel in found.plot().axes}
    assert {"residual of p [bar]", "residual of x [mm]"} <= axes


def test_diagnosis_json_keeps_the_units_of_the_diagram(found):
    kept = json.loads(found.to_json())
    assert kept["gap"]["unit"] == "m"
    assert kept["effects"][0]["parameters"]["half_width"]["unit"] == "m"
    assert kept["effects"][0]["parameters"]["half_width"]["value"] == pytest.approx(1e-3, rel=0.05)
    assert [gap["unit"] for part in kept["segments"] for gap in part["gaps"]] == ["Pa", "m"]
