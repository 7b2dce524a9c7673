"""A recorded signal that the diagram gives no unit adopts that of the recording, in base units."""

import numpy as np
import pytest

import tsmblocks as tsm
from tsmblocks.blocks import Bias, FirstOrderLag, Play
from tsmblocks.common.errors import DiagramError
from tsmblocks.files import dumps, loads

T = np.arange(0, 10, 0.02)
X = np.sin(T) + 0.3 * np.sin(3.1 * T)
NOTE = "x_out has no unit in the diagram and is taken to be in rad there; the recording is converted from deg."


def lag(**more):
    return tsm.Diagram(
        title="lag",
        blocks={"lag": FirstOrderLag(gain=0.8, time_constant=0.3)},
        outputs={"x_out": "lag"},
        **{"inputs": {"x_in": tsm.Inlet("lag.u", unit="rad")}, **more},
    )


def recorded(unit="deg"):
    factor = tsm.common.units.factor("rad", unit) if unit else 1.0
    y = tsm.simulate(lag(), inputs={"x_in": (T, X)}, step=0.02, parameters={"lag.gain": 1.02})["x_out"]
    y = y + 0.002 * np.random.default_rng(0).standard_normal(len(T))
    signals = {"x_in": factor * X, "x_out": factor * y}
    return tsm.Record("run", T, signals, {k: unit for k in signals if unit})


def test_a_gain_from_degrees_to_degrees_is_no_conversion():
    """It was 58.44, all starts agreeing, with the input converted and the output left as it was."""
    fit = tsm.fit(lag(), recorded())
    assert fit["lag.gain"].value == pytest.approx(1.02, abs=0.01)
    assert NOTE in fit.notes
    assert fit.differences.unit == "rad"
    assert fit.rms == pytest.approx(0.002, rel=0.1)
    assert fit.values == pytest.approx(tsm.fit(lag(), recorded("rad")).values, rel=1e-6)
    score = tsm.score(lag(), recorded(), parameters={"lag.gain": 1.02})
    assert (score.unit, score.rms) == ("rad", pytest.approx(0.002, rel=0.1))
    found = tsm.compare({"lag": lag()}, recorded())
    assert found.unit == "rad"
    assert NOTE in found.notes


def play(unit, rate=False):
    blocks = {"play": Play(half_width=0.1, gain=0.7), "lag": FirstOrderLag(time_constant=0.2), "offset": Bias()}
    wires = ["play -> lag", "lag -> offset"]
    outputs = {"x_out": "offset"}
    if rate:
        blocks["rate"], outputs["v_out"] = tsm.blocks.FilteredDerivative(), "rate"
        wires.append("offset -> rate")
    return tsm.Diagram(blocks=blocks, wires=wires, inputs={"x_in": tsm.Inlet(["play"], unit=unit)}, outputs=outputs)


@pytest.mark.parametrize("unit", ["deg", "rad", "mrad"])
def test_a_signal_behind_blocks_that_convert_adopts_the_scale_of_the_angles_of_the_diagram(unit):
    """Recordings in deg and an input declared in deg gave a gain of 0.01396 (0.8 pi/180): the output was in rad."""
    k = tsm.common.units.factor("deg", unit)
    x = 10 * X
    y = tsm.simulate(
        play(unit), inputs={"x_in": (T, k * x)}, step=0.02, parameters={"play.gain": 0.8, "play.half_width": k}
    )["x_out"]
    data = tsm.Record("run", T, {"x_in": x, "x_out": y / k}, {"x_in": "deg", "x_out": "deg"})
    fit = tsm.fit(play(unit), data, free=["play.*"], start={"play.half_width": 0.8 * k})
    assert fit["play.gain"].value == pytest.approx(0.8, abs=1e-3)
    assert fit.diagram.unit("x_out") == unit
    assert any("no unit in the diagram" in text for text in fit.notes) == (unit != "deg")


def test_rates_adopt_the_scale_of_the_angles_and_two_scales_mean_base_units():
    from tsmblocks.fitting.recordings import with_adopted_units

    data = tsm.Record("run", T, {"x_in": X, "x_out": X, "v_out": X}, {"x_in": "deg", "x_out": "deg", "v_out": "deg/s"})
    adopted, notes = with_adopted_units(play("deg", rate=True), {"run": data})
    assert [adopted.unit(k) for k in ("x_out", "v_out")] == ["deg", "deg/s"]
    assert not notes
    both = tsm.Diagram(
        blocks={"turn": tsm.blocks.Convert(source_unit="deg", target_unit="rad"), "lag": FirstOrderLag()},
        wires=["turn -> lag"],
        inputs={"x_in": "turn"},
        outputs={"x_out": "lag"},
    )
    adopted, notes = with_adopted_units(both, {"run": data})
    assert adopted.unit("x_out") == "rad"
    assert notes == [NOTE]


def test_a_diagnosis_adopts_it_too():
    found = tsm.diagnose(lag(), recorded(), noise_floor="0.115deg", effects=["drift"])
    assert NOTE in found.notes
    assert found.verdict == "none"
    assert found.augmented.parameters["lag.gain"] == pytest.approx(1.02, abs=0.01)


def test_without_any_unit_in_the_diagram_numbers_stay_as_they_are():
    bare = lag(inputs={"x_in": "lag.u"})
    fit = tsm.fit(bare, recorded())
    assert fit["lag.gain"].value == pytest.approx(1.02, abs=0.01)
    assert not any("no unit" in text for text in fit.notes)
    assert fit.rms == pytest.approx(np.degrees(0.002), rel=0.1)


def test_an_output_may_declare_its_unit():
    told = lag(output_units={"x_out": "deg"})
    assert told.unit("x_out") == told.outports["x_out"].unit == "deg"
    again = loads(dumps(told))
    assert again == told
    assert 'x_out = { signal = "lag.y", unit = "deg" }' in dumps(told)
    assert tsm.fit(told, recorded()).differences.unit == "deg"
    with pytest.raises(DiagramError, match=r"there is no output 'x_outt'\. Did you mean 'x_out'"):
        lag(output_units={"x_outt": "deg"})
    with pytest.raises(DiagramError, match="output 'x_out' is declared in V, and its signal is in rad"):
        tsm.Diagram(
            blocks={"gain": tsm.blocks.Gain(unit="rad")},
            inputs={"u": "gain"},
            outputs={"x_out": "gain"},
            output_units={"x_out": "V"},
        )
    assert told.insert("more", tsm.blocks.Bias(), before="x_out").unit("x_out") == "deg"


def test_the_run_of_a_command_converts_too(tmp_path, capsys):
    from tsmblocks.cli import main

    tsm.save(lag(), path := tmp_path / "lag.toml")
    recorded().save(tmp_path / "run.csv")
    status = main(["run", str(path), "--data", str(tmp_path / "run.csv"), "--set", "lag.gain=1.02", "--step", "0.02"])
    said = capsys.readouterr()
    assert status == 0
    assert "x_out has no unit in the diagram" in said.err.replace("\n", " ")
    row = next(line for line in said.out.splitlines() if line.startswith("x_out"))
    assert row.split()[1] == "deg"  # the unit of the recording
