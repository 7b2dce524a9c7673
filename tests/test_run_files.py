"""Files of fitted and augmented diagrams say how they were simulated: running them gives the promised errors."""

import json
import pickle

import numpy as np
import pytest

import tsmblocks as tsm
from tsmblocks.blocks import Play
from tsmblocks.common.errors import FileError
from tsmblocks.diagnosis.consequence import inverse
from tsmblocks.model.simulation import Simulation

SHEATH, PLAY = tsm.load("tendon_sheath_asymmetric"), tsm.load("tendon_sheath_play")
T = np.arange(0, 12, 0.02)
NOISE = 0.003


def recorded(diagram, state, starts, extra=lambda t, x: 0.0 * t):
    """Recordings that begin away from zero, with a start of their own each."""
    rng, made = np.random.default_rng(4), {}
    for k, start in enumerate(starts):
        x = 0.5 * np.sin(1.1 * T + k) + 0.25 * np.sin(2.9 * T + 2 * k) + 0.4 * (k - 1)
        at = {name: value + (x[0] if name.endswith(".m") else 0.0) for name, value in zip(state, start, strict=True)}
        run = tsm.simulate(diagram.with_parameters(at), inputs={"x_in": (T, x)}, stop=T[-1], step=0.02, hold="cubic")
        y = run["x_out"] + extra(T, x) + rng.normal(0, NOISE, T.size)
        made[f"run {k}"] = tsm.Record(f"run {k}", T, {"x_in": x, "x_out": y}, {"x_in": "rad", "x_out": "rad"})
    return made


RECORDS = recorded(SHEATH, ["tsm.zeta"], [[-0.15], [0.0], [0.12]])
GAP = SHEATH.insert("gap", Play(half_width=0.06), before="x_out")
WITH_GAP = recorded(GAP, ["tsm.zeta", "gap.m"], [[-0.15, 0.02], [0.0, -0.03], [0.12, 0.0]])
STRANGE = recorded(SHEATH, ["tsm.zeta"], [[-0.15], [0.0], [0.12]], lambda t, x: 0.05 * np.sign(np.sin(37 * x * x)))


def rms(diagram, record):
    return tsm.score(diagram, record.conditioned(diagram.simulation.condition)).rms


def test_a_fitted_file_gives_the_residual_of_each_recording(tmp_path):
    fit = tsm.fit(SHEATH, RECORDS, start_states=True, starts=1, hold="cubic")
    loaded = tsm.load(fit.save(tmp_path / "fitted.toml"))
    assert loaded == fit.diagram
    assert loaded.simulation == fit.diagram.simulation
    assert loaded.simulation.step == fit.step
    for name, record in RECORDS.items():
        promised = fit.differences[name].rms
        assert rms(loaded, record) == pytest.approx(promised, rel=1e-9)
        moved = loaded.with_parameters({"tsm.zeta": loaded.simulation.start["run 1"]["tsm.zeta"]})
        assert (rms(moved, record) > 1.5 * promised) == (name != "run 1")  # one start does not serve them all
    unknown = tsm.Record("another", T, RECORDS["run 0"].signals, RECORDS["run 0"].units)
    assert rms(loaded, unknown) == pytest.approx(fit.differences["run 0"].rms, rel=1e-9)  # as the first


def test_a_fit_continues_from_the_starts_in_a_file(tmp_path):
    fit = tsm.fit(SHEATH, RECORDS, start_states=True, starts=1, hold="cubic")
    loaded = tsm.load(fit.save(tmp_path / "fitted.toml"))
    kept = tsm.fit(loaded, RECORDS, free=["tsm.alpha1"], starts=1)
    assert kept.differences.rms == pytest.approx(fit.differences.rms, rel=1e-6)
    assert kept.diagram.simulation.start == loaded.simulation.start
    again = tsm.fit(loaded, RECORDS, start_states=True, starts=1)
    assert [e.start for e in again if e.is_start] == pytest.approx([e.value for e in fit if e.is_start])


def test_the_commands_take_step_hold_and_starts_from_a_file(tmp_path, capsys, monkeypatch):
    from tsmblocks.cli.entry import main

    monkeypatch.chdir(tmp_path)
    fit = tsm.fit(SHEATH, RECORDS, start_states=True, starts=1, hold="cubic")
    fit.save("fitted.toml")
    for name, record in RECORDS.items():
        table = np.column_stack([T, record["x_in"], record["x_out"]])
        np.savetxt(f"{name}.csv", table, delimiter=",", header="t [s],x_in [rad],x_out [rad]", comments="", fmt="%.17g")
        assert main(["run", "fitted.toml", "--data", f"{name}.csv", "--json"]) == 0
        told = json.loads(capsys.readouterr().out)
        assert told["step"] == fit.step
        assert told["measured"][0]["rms"] == pytest.approx(fit.differences[name].rms, rel=1e-6)
        assert (
            main(["run", "fitted.toml", "--data", f"{name}.csv", "--json", "--step", "0.01", "--method", "heun"]) == 0
        )
        told = json.loads(capsys.readouterr().out)
        assert (told["step"], told["method"]) == (0.01, "heun")


@pytest.mark.parametrize(
    ("verdict", "records", "effects"),
    [("none", RECORDS, ["backlash"]), ("named", WITH_GAP, ["backlash", "drift"]), ("unknown", STRANGE, ["drift"])],
)
def test_an_augmented_file_gives_the_residual_of_each_recording(tmp_path, verdict, records, effects):
    found = tsm.diagnose(SHEATH, records, noise_floor=NOISE, effects=effects)
    assert found.verdict == verdict
    found.save(tmp_path)
    loaded, (segment,) = tsm.load(tmp_path / "augmented.toml"), found.segments
    assert loaded.simulation.condition == ("x_in",)
    for name, record in records.items():
        assert rms(loaded, record) == pytest.approx(segment.fit.differences[name].rms, rel=1e-6)


def test_a_compensator_rebuilt_from_an_augmented_file_leaves_no_mean_error():
    told = SHEATH.with_parameters({"tsm.delta": 0.05})
    found = tsm.diagnose(told, RECORDS, noise_floor=NOISE, effects=["backlash"])
    loaded, record = tsm.loads(tsm.dumps(found.augmented)), RECORDS["run 0"]
    assert loaded.parameters["tsm.zeta"] == loaded.simulation.start["run 0"]["tsm.zeta"]
    wanted = record["x_out"][0] + 0.6 * (1 - np.cos(1.3 * T))
    compensator = inverse(loaded, "x_in", "x_out", gain=50.0, start=float(record["x_in"][0]))
    whole = tsm.Diagram(
        blocks={"compensator": compensator, "plant": SHEATH.with_parameters({"tsm.zeta": -0.15})},
        wires=["compensator -> plant.x_in"],
        inputs={"wanted": "compensator.wanted"},
        outputs={"x_out": "plant.x_out"},
    )
    run = tsm.simulate(whole, inputs={"wanted": (T, wanted)}, stop=T[-1], step=1e-3)
    error = (run["x_out"] - np.interp(run.t, T, wanted))[run.t > 2.0]
    assert abs(np.mean(error)) < np.deg2rad(0.1)
    assert np.sqrt(np.mean(error**2)) < np.deg2rad(1.5)


SETTINGS = Simulation(
    step={"a": 0.01, "b b": 0.02},
    method="heun",
    hold={"x_in": "zero"},
    condition=["x_in"],
    start={"b b": {"tsm.zeta": 0.25}, "run.1": {"tsm.zeta": -1.0}},
)


def test_settings_of_a_simulation_are_read_as_they_were_written():
    text = tsm.dumps(SHEATH.with_simulation(SETTINGS))
    assert tsm.loads(text).simulation == SETTINGS
    assert tsm.loads(tsm.dumps(SHEATH)).simulation == Simulation()
    assert "simulation" not in tsm.dumps(SHEATH)
    nested = tsm.loads(tsm.dumps(SHEATH) + "\n[start.a]\ntsm.zeta = 0.5\n")
    assert nested.simulation.start_of("a") == {"tsm.zeta": 0.5}
    assert SETTINGS.step_of("b b") == 0.02
    assert SETTINGS.step_of("another") == 0.01


def test_settings_of_a_simulation_are_kept_by_edits_and_copies():
    told = SHEATH.with_simulation(SETTINGS)
    assert pickle.loads(pickle.dumps(told)).simulation == SETTINGS
    assert told.insert("gap", Play(), before="x_out").simulation == SETTINGS
    assert told.rewire(title="other").simulation == SETTINGS


def test_a_state_that_is_set_counts_for_every_recording():
    changed = SHEATH.with_simulation(SETTINGS).with_parameters({"tsm.zeta": 0.0})
    assert changed.simulation.start == {}
    assert changed.simulation.step_of("a") == 0.01
    other = SHEATH.with_simulation(SETTINGS).with_parameters({"offset.bias": 0.3})
    assert other.simulation == SETTINGS


@pytest.mark.parametrize(
    ("text", "said"),
    [
        ("[simulation]\nstep = 0.0", "step must be a positive number of seconds, got 0."),
        ("[simulation]\nstp = 0.1", "'stp' is not a key of [simulation]. Did you mean 'step'?"),
        (
            "[simulation]\nhold = 'cubik'",
            "hold must be one of auto, zero, linear, cubic, got 'cubik'. Did you mean 'cubic'?",
        ),
        ("[simulation]\nhold = { x_inn = 'zero' }", "hold: there is no input 'x_inn'. Did you mean 'x_in'?"),
        (
            "[simulation]\nmethod = 'rk5'",
            "method must be one of rk4, euler, heun, sdirk2, sdirk3, sdirk4, got 'rk5'. Did you mean 'rk4'?",
        ),
        ("[simulation]\ncondition = 'x_in'", "condition must be a list of inputs such as [\"x_in\"], got 'x_in'."),
        ("[start.a]\n'tsm.zet' = 0.1", "the diagram has no state 'tsm.zet'. Did you mean 'tsm.zeta'?"),
        ("[start.a]\n'tsm.zeta' = 'x'", "the start of 'tsm.zeta' must be a number, got 'x'."),
        ("[start]\na = 0.1", "start.a must be a table of initial states, got 0.1."),
    ],
)
def test_faults_of_these_sections_are_placed(text, said):
    whole = tsm.dumps(SHEATH) + "\n" + text + "\n"
    with pytest.raises(FileError) as error:
        tsm.loads(whole, "own.toml")
    line = len(whole.splitlines()) if "= " in text else 0
    assert f"own.toml:{line}: {said}" in str(error.value)
