"""What commands that search take alike: values, bounds and local parameters; and commands that they print."""

import json
import shlex

import numpy as np
import pytest

import tsmblocks as tsm
from tsmblocks.blocks import FirstOrderLag, Gain
from tsmblocks.cli import main
from tsmblocks.common.errors import ParameterError

T = np.arange(0, 6, 0.02)


@pytest.fixture
def folder(tmp_path, monkeypatch):
    """Two recordings of a play, each with another offset; the columns have other names."""
    monkeypatch.chdir(tmp_path)
    x, rng = np.sin(2 * T) + 0.4 * np.sin(5.3 * T), np.random.default_rng(1)
    model = tsm.load("tendon_sheath_linear").insert("slack", tsm.blocks.Play(half_width=0.1), before="offset")
    for name, bias in (("a 1", 0.1), ("b", -0.2)):
        y = tsm.simulate(model, inputs={"x_in": (T, x)}, step=0.02, parameters={"offset.bias": bias})["x_out"]
        y = y + 0.002 * rng.standard_normal(len(T))
        tsm.Record(name, T, {"motor": x, "tip": y}, {"motor": "rad", "tip": "rad"}).save(f"{name}.csv")
    return tmp_path


def test_the_command_that_a_comparison_prints_runs_as_it_is_printed(folder, capsys):
    named = ["--map", "x_in=motor", "x_out=tip", "--rows", "1:250"]
    assert main(["compare", "linear", "--data", "a 1.csv", *named, "--starts", "1"]) == 0
    (line,) = (line for line in capsys.readouterr().out.splitlines() if line.startswith("  tsmblocks "))
    words = shlex.split(line)
    assert words[:3] == ["tsmblocks", "diagnose", "tendon_sheath_linear"]
    assert main([*words[1:], "--effects", "backlash"]) == 0
    assert "backlash" in capsys.readouterr().out


def test_a_comparison_suggests_a_model_that_the_data_determine(folder, capsys):
    """The command named the best model, two of whose parameters were one product."""
    simple = tsm.load("tendon_sheath_linear")
    tsm.save(simple.insert("lag", FirstOrderLag(time_constant=0.1), before="offset"), "rich.toml")
    tsm.save(simple, "poor.toml")
    named = ["--data", "a 1.csv", "--map", "x_in=motor", "x_out=tip", "--starts", "1"]
    assert main(["compare", "rich.toml", "poor.toml", *named]) == 0
    said = capsys.readouterr().out
    assert "rich fits best" in said
    assert "The data do not determine all of rich; poor is the simplest model that they determine." in " ".join(
        said.split()
    )
    assert "  tsmblocks diagnose poor.toml " in said


def test_a_diagnosis_takes_values_bounds_and_local_parameters(folder, capsys):
    files = ["--data", "a 1.csv", "b.csv", "--map", "x_in=motor", "x_out=tip", "--noise-floor", "0.002rad"]
    options = ["--effects", "backlash", "--set", "gain.gain=0.7", "--bounds", "gain.gain=0.5:0.9"]
    assert main(["diagnose", "tendon_sheath_linear", *files, *options, "--local", "offset.bias", "--out", "found"]) == 0
    assert "backlash" in capsys.readouterr().out
    augmented = tsm.load("found/augmented.toml")
    assert augmented.parameters["gain.gain"] <= 0.9
    assert main(["diagnose", "tendon_sheath_linear", *files, "--bounds", "gain.gian=0:1"]) == 2
    assert "gain.gian" in capsys.readouterr().err


def test_local_parameters_differ_between_the_experiments_of_a_diagnosis():
    lag = tsm.Diagram(
        blocks={"lag": FirstOrderLag(time_constant=0.2), "gain": Gain()},
        wires=["lag -> gain"],
        inputs={"u": "lag"},
        outputs={"y": "gain"},
    )
    rng, u = np.random.default_rng(0), np.sin(2 * T) + np.sin(0.7 * T)
    records = {}
    for name, k in (("one", 1.0), ("two", 2.0)):
        y = tsm.simulate(lag, inputs={"u": (T, u)}, step=0.02, parameters={"gain.gain": k})["y"]
        records[name] = tsm.Record(name, T, {"u": u, "y": y + 0.01 * rng.standard_normal(len(T))}, {})
    options = {"free": ["lag.time_constant"], "noise_floor": 0.01, "effects": ["drift", "dead_time"]}
    found = tsm.diagnose(lag, records, local=["gain.gain"], bounds={"lag.time*": (0.01, 1.0)}, **options)
    assert found.verdict == "none"
    gains = [found.simulated.start_states[name]["gain.gain"] for name in records]
    assert gains == pytest.approx([1.0, 2.0], abs=0.01)
    with pytest.raises(ParameterError, match=r"local 'gian\.gain' names no parameter"):
        tsm.diagnose(lag, records, local=["gian.gain"], **options)


def test_a_figure_without_unit_is_no_share():
    """Only figures pooled over several outputs are shares of their spread."""
    gain = tsm.Diagram(blocks={"k": Gain()}, inputs={"u": "k"}, outputs={"y": "k", "z": "k"})
    u = np.sin(T)
    data = tsm.Record("run", T, {"u": u, "y": 2 * u + 0.1 * u**2, "z": 2 * u}, {})
    one, two = (tsm.compare({"k": gain}, data, outputs=names, starts=1) for names in (["y"], ["y", "z"]))
    assert "of the spread" not in str(one)
    assert "[of the spread]" in str(two)


def test_a_value_may_have_a_unit(tmp_path, monkeypatch, capsys):
    monkeypatch.chdir(tmp_path)
    blocks = dict(ref=tsm.blocks.Sine(unit="rad"), slack=tsm.blocks.Play(), lag=FirstOrderLag())
    tsm.save(tsm.Diagram(blocks=blocks, wires=["ref -> slack -> lag"], outputs={"y": "lag"}), "d.toml")

    def largest(*settings):
        assert main(["run", "d.toml", "--stop", "5", "--json", "--set", *settings]) == 0
        return json.loads(capsys.readouterr().out)["outputs"]["y"]["max"]

    assert largest("slack.half_width=10deg", "lag.time_constant=300 ms") == pytest.approx(
        largest("slack.half_width=0.17453292519943295", "lag.time_constant=0.3"), rel=1e-12
    )
    for setting, said in (
        ("slack.half_width=1V", "--set slack.half_width=1V: 'V' does not convert to 'rad'."),
        ("lag.gain=1V", "--set lag.gain=1V: no unit of lag.gain is known; give a plain number."),
    ):
        assert main(["run", "d.toml", "--set", setting]) == 2
        assert said in capsys.readouterr().err


def test_a_name_with_a_blank_needs_quotes(folder, capsys):
    assert main(["fit", "tendon_sheath_play", "--data", "b.csv", "--map", "x_in=Motor", "pos"]) == 2
    said = "'pos' is not NAME=COLUMN; a name with blanks needs quotes, such as 'x_in=Motor pos'"
    assert said in " ".join(capsys.readouterr().err.split())
