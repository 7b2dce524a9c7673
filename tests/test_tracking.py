"""The pytest plugin: planted changes are caught and described, rounding is not, baselines are accepted and readable."""

import subprocess
import sys
import tomllib
from pathlib import Path

import numpy as np
import pytest

import tsmblocks as tsm
from tsmblocks.common.errors import FileError, ParameterError
from tsmblocks.testing.guards import read_guards
from tsmblocks.testing.tracking import (
    MAX_INSTANTS,
    Baseline,
    Change,
    change_report,
    changes,
    first_deviation,
    guard,
    read_baseline,
)

ROOT = Path(__file__).parents[1]
GUARD = """format = 1
diagram = "fig16_feedforward_feedback"
stop = 5.0
step = 2e-3

[metrics]
"error [deg]" = "peak_to_peak(x_ref - x_out, after=2.5)"
effort = { of = "rms(u)", tolerance = "loose" }
"""
PYTHON = """import tsmblocks as tsm


def test_loop(tracking):
    diagram = tsm.load("fig09b_feedforward")
    tracking(diagram, {"error [deg]": "rms(x_ref - x_out)"}, stop=2.0, step=2e-3)
    tracking(diagram, "rms(u)", stop=1.0, step=2e-3, tolerance="tight", name="effort")
"""


def pytest_in(folder, *words):
    """Run pytest with the plugin; its status and what it said."""
    command = [sys.executable, "-m", "pytest", "-q", "-p", "tsmblocks.testing.plugin", "-p", "no:cacheprovider", *words]
    done = subprocess.run(
        command,
        cwd=folder,
        capture_output=True,
        text=True,
        check=False,
        env={"PYTHONPATH": str(ROOT), "PATH": "", "HOME": str(folder)},
    )
    return done.returncode, done.stdout + done.stderr


@pytest.fixture
def guarded(tmp_path):
    """A folder with a guard whose baseline has been accepted."""
    (tmp_path / "pytest.ini").write_text("[pytest]\n")
    (tmp_path / "loop.tracking.toml").write_text(GUARD)
    assert pytest_in(tmp_path, "--tracking-accept")[0] == 0
    return tmp_path


def with_changed(folder, **changes):
    lines = "".join(f'"{k}" = {v}\n' for k, v in changes.items())
    (folder / "loop.tracking.toml").write_text(f"{GUARD}\n[set]\n{lines}")


# ---- as a user meets it


def test_a_planted_change_of_two_per_cent_is_caught_and_described(guarded):
    kp = tsm.load("fig16_feedforward_feedback").parameters["pid.kp"]
    with_changed(guarded, **{"pid.kp": 1.02 * kp})
    status, said = pytest_in(guarded)
    assert status == 1
    assert "tracking has changed from loop.baseline.toml:" in said
    (row,) = [line.split() for line in said.splitlines() if line.startswith("error [deg]")]
    assert row[-2:] == ["0.1", "%"]
    assert 0.1 < abs(float(row[-4])) < 5
    assert "effort" not in said.partition("metric")[2].partition("Drawn")[0]
    assert "The signals deviate from t = " in said
    assert "If this is intended: pytest --tracking-accept" in said
    assert "Traceback" not in said
    picture = guarded / "tracking-failures" / "loop.tracking.toml.loop.png"
    assert picture.stat().st_size > 10_000
    assert pytest_in(guarded, "--tracking-accept")[0] == 0
    assert pytest_in(guarded)[0] == 0


def test_the_plugin_is_light_since_every_run_of_pytest_imports_it():
    code = "import sys, tsmblocks.testing.plugin; print({'casadi', 'llvmlite', 'scipy'}.isdisjoint(sys.modules))"
    assert subprocess.run([sys.executable, "-c", code], capture_output=True, text=True, check=True).stdout == "True\n"


def test_rounding_is_no_change(guarded):
    kp = tsm.load("fig16_feedforward_feedback").parameters["pid.kp"]
    with_changed(guarded, **{"pid.kp": kp * (1 + 1e-12)})
    assert pytest_in(guarded)[0] == 0


def test_a_picture_that_cannot_be_drawn_does_not_hide_the_change(guarded):
    with_changed(guarded, **{"pid.kp": 3.0})
    (guarded / "pictures").write_text("a file", encoding="utf-8")
    status, said = pytest_in(guarded, "--tracking-pictures", "pictures/here")
    assert status == 1
    assert "tracking has changed from" in said
    assert "Not drawn: " in said


def test_a_baseline_that_cannot_be_written_is_one_message(tmp_path):
    (tmp_path / "loop.tracking.toml").write_text(GUARD, encoding="utf-8")
    (tmp_path / "loop.baseline.toml").mkdir()
    status, said = pytest_in(tmp_path, "--tracking-accept")
    assert status == 1
    assert "loop.baseline.toml: cannot be written: is a directory." in said
    assert "atomic_write" not in said


def test_a_change_from_some_time_on_is_told_with_the_time(tmp_path):
    (tmp_path / "pytest.ini").write_text("[pytest]\n")
    text = 'format = 1\ndiagram = "late.toml"\nstop = 4.0\n[metrics]\nerror = "rms(y)"\n'
    (tmp_path / "late.tracking.toml").write_text(text)
    block = tsm.blocks.Step(time=2.5)
    diagram = tsm.Diagram(title="late", blocks={"s": block}, outputs={"y": "s"})
    tsm.save(diagram, tmp_path / "late.toml")
    assert pytest_in(tmp_path, "--tracking-accept")[0] == 0
    tsm.save(diagram.with_parameters({"s.after": 1.5}), tmp_path / "late.toml")
    status, said = pytest_in(tmp_path)
    assert status == 1
    assert "The signals deviate from t = 2.5 s on, y first." in said


def test_without_a_baseline_the_way_to_one_is_told(tmp_path):
    (tmp_path / "pytest.ini").write_text("[pytest]\n")
    (tmp_path / "loop.tracking.toml").write_text(GUARD)
    status, said = pytest_in(tmp_path)
    assert status == 1
    assert "there is no baseline loop.baseline.toml yet: pytest --tracking-accept writes it." in said


def test_the_fixture_guards_tests_in_python(tmp_path):
    (tmp_path / "pytest.ini").write_text("[pytest]\n")
    (tmp_path / "test_mine.py").write_text(PYTHON)
    status, said = pytest_in(tmp_path)
    assert status == 1
    assert "there is no baseline baselines/test_mine.test_loop.toml yet" in said
    assert pytest_in(tmp_path, "--tracking-accept")[0] == 0
    assert sorted(p.name for p in (tmp_path / "baselines").iterdir()) == [
        "test_mine.test_loop.effort.toml",
        "test_mine.test_loop.toml",
    ]
    assert pytest_in(tmp_path)[0] == 0
    (tmp_path / "test_mine.py").write_text(PYTHON.replace("stop=1.0", "stop=1.1"))
    status, said = pytest_in(tmp_path)
    assert status == 1
    assert "test_mine.test_loop.effort.toml" in said


def test_cases_have_baselines_of_their_own(tmp_path):
    (tmp_path / "pytest.ini").write_text("[pytest]\n")
    (tmp_path / "loop.tracking.toml").write_text(GUARD + '\n[cases]\nusual = {}\n"less gain" = { "pid.kp" = 1.0 }\n')
    assert pytest_in(tmp_path, "--tracking-accept")[0] == 0
    assert (tmp_path / "loop.usual.baseline.toml").exists()
    assert (tmp_path / "loop.less_gain.baseline.toml").exists()
    status, said = pytest_in(tmp_path, "-vv")
    assert status == 0
    assert "less gain" in said


def test_a_fault_in_a_file_is_one_message(tmp_path):
    (tmp_path / "pytest.ini").write_text("[pytest]\n")
    (tmp_path / "loop.tracking.toml").write_text(GUARD.replace("stop", "stopp"))
    status, said = pytest_in(tmp_path)
    assert status == 2
    assert "3: 'stopp' is not a key of a guard. Did you mean 'stop'?" in said
    assert "Traceback" not in said


CLASSES = """import pytest
import tsmblocks as tsm


class TestA:
    @pytest.mark.parametrize("gain", [1.0, 2.0])
    def test_x(self, tracking, gain):
        tracking(tsm.load("fig09b_feedforward"), "rms(u)", stop=0.5, step=2e-3, parameters={"ref.amplitude": gain})


class TestB:
    def test_x(self, tracking):
        diagram = tsm.load("fig09b_feedforward")
        tracking(diagram, {"α": "rms(u)"}, stop=0.5, step=2e-3, parameters={"ref.amplitude": 3.0}, name="α")
        tracking(diagram, {"α": "rms(u)"}, stop=0.5, step=2e-3, parameters={"ref.amplitude": 4.0}, name="β")
"""


def test_every_check_has_a_baseline_of_its_own(tmp_path):
    (tmp_path / "pytest.ini").write_text("[pytest]\n")
    (tmp_path / "test_mine.py").write_text(CLASSES, encoding="utf-8")
    assert pytest_in(tmp_path, "--tracking-accept")[0] == 0
    assert len(list((tmp_path / "baselines").iterdir())) == 4
    status, said = pytest_in(tmp_path)
    assert status == 0, said


def test_a_fault_at_run_time_is_one_message_too(guarded):
    (guarded / "loop.baseline.toml").write_text("format = 1")
    status, said = pytest_in(guarded)
    assert status == 1
    assert "this is no baseline: 'metrics' is missing" in said
    assert "Traceback" not in said
    assert "repr_failure" not in said
    assert len(said.splitlines()) < 15


def test_a_signal_may_be_called_t():
    diagram = tsm.Diagram(title="t", blocks={"s": tsm.blocks.Sine()}, outputs={"t": "s"})
    made = guard(diagram, "rms(t)", "normal", {"stop": 1.0}).run()
    assert tomllib.loads(made.text())["signals"]["t [rad]" if made.signal_units["t"] else "t"]


def test_what_is_no_number_guards_nothing():
    with pytest.raises(tsm.errors.RunError, match=r"metric 'overshoot\(x_out, 0\)' is not a number here"):
        guard(tsm.load("fig09b_feedforward"), "overshoot(x_out, 0)", "normal", {"stop": 1.0, "step": 2e-3}).run()


# ---- parts


def small(tolerance="normal"):
    return guard(tsm.load("fig09b_feedforward"), "rms(x_ref - x_out)", tolerance, {"stop": 1.0, "step": 2e-3})


def test_a_baseline_is_read_back_as_it_was(tmp_path):
    made = guard(
        tsm.load("fig09b_feedforward"),
        {"e [deg]": "rms(x_ref - x_out)", "never": "settling_time(u, 1e-9)"},
        "normal",
        {"stop": 10.0},
    ).run()
    made.save(tmp_path / "deep" / "b.toml")
    again = read_baseline(tmp_path / "deep" / "b.toml")
    assert again.metrics == made.metrics
    assert again.metrics["never"] == np.inf
    assert again.units == made.units == {"e": "deg", "never": "s"}
    assert len(again.t) <= MAX_INSTANTS + 1
    for name, values in made.signals.items():
        assert again.signals[name] == pytest.approx(values, rel=1e-6, abs=1e-12)
    assert again.signal_units == made.signal_units
    assert tomllib.loads((tmp_path / "deep" / "b.toml").read_text())["format"] == 1


@pytest.mark.parametrize(("kind", "allowed"), [("exact", 1e-12), ("tight", 1e-6), ("normal", 1e-3), ("coarse", 5e-2)])
def test_each_class_allows_what_it_says(kind, allowed):
    watched = small(tolerance=kind)
    before = watched.run()
    (name,) = before.metrics
    for factor, count in ((0.9, 0), (1.1, 1)):
        size = before.metrics[name] * (1 + factor * allowed)
        now = Baseline({name: size}, before.units, before.t, before.signals, before.signal_units)
        assert len(changes(watched, before, now)) == count


def test_what_came_went_or_is_no_number():
    watched = small()
    before = watched.run()
    (name,) = before.metrics

    def changed(metrics):
        return Baseline(metrics, dict.fromkeys(metrics, "rad"), before.t, before.signals, before.signal_units)

    assert [m.now for m in changes(watched, changed({name: 1.0, "old": 2.0}), changed({name: 1.0}))] == [None]
    assert [m.before for m in changes(watched, changed({}), changed({name: 1.0}))] == [None]
    assert len(changes(watched, changed({name: np.nan}), changed({name: np.nan}))) == 1
    assert len(changes(watched, changed({name: np.inf}), changed({name: 1.0}))) == 1
    assert changes(watched, changed({name: 0.0}), changed({name: 1e-16})) == []
    said = change_report([Change("a", "", None, 1.0, 1e-3), Change("b", "V", 2.0, None, 0.0)], before, before)
    assert [line.split()[0] for line in said.splitlines()] == ["metric", "a", "b"]
    assert "new" in said
    assert "gone" in said


def test_signals_that_part():
    before = small().run()
    signals = {k: np.where(before.t >= 0.5, v + 0.1, v) for k, v in before.signals.items()}
    now = Baseline(before.metrics, before.units, before.t, signals, before.signal_units)
    assert first_deviation(before, before, 1e-6) is None
    assert first_deviation(before, now, 1e-3)[1] == before.t[before.t >= 0.5][0]


REFUSED = {
    GUARD.replace("format = 1", "format = 2"): "1: format = 1 is needed, got 2.",
    GUARD.replace("rms(u)", "rms(w)"): "8: metric 'effort': there is no signal 'w'.",
    GUARD.replace('"loose"', '"lose"'): "8: tolerance of 'effort': there is no class 'lose'. Did you mean 'loose'?",
    GUARD.replace(
        '"loose"', "3"
    ): "8: tolerance of 'effort': there is no class 3. Known here: coarse, exact, loose, normal, tight.",
    GUARD.replace("tolerance", "tolerence"): "8: 'tolerence' is not a key of a metric. Did you mean 'tolerance'?",
    GUARD.replace("diagram =", "title ="): ": a guard needs its diagram",
    GUARD.replace("5.0", '"x"'): "3: 'stop' must be a number, got 'x'.",
    GUARD + "[cases]\na = { kp = 1 }\n": "10: diagram",
    GUARD.replace("[metrics]", "metrics = 3\n[set]"): "6: metrics must be a table, written [metrics], got 3.",
    GUARD.replace("rms(u)", "rms(u"): "8: metric 'effort': this cannot be read from here on.",
    GUARD.replace('of = "rms(u)", ', ""): '8: a metric with a tolerance has its text under of: { of = "rms(u)", '
    'tolerance = "loose" }.',
    GUARD.replace(
        "format = 1\n", 'format = 1\ntolerance = "lose"\n'
    ): "8: tolerance of 'error': there is no class 'lose'.",
    GUARD + "[cases]\na = 3\n": "10: 'cases.a' must be a table of parameters, got 3.",
    GUARD + "[set]\nkp = 3\n": "10: diagram",
}


@pytest.mark.parametrize("text", REFUSED, ids=range(len(REFUSED)))
def test_what_is_no_guard(text, tmp_path):
    path = tmp_path / "loop.tracking.toml"
    path.write_text(text)
    with pytest.raises(FileError) as found:
        read_guards(path)
    assert found.value.problems[0].startswith(f"{path}:{REFUSED[text]}".replace("::", ":")), found.value.problems


def test_what_is_no_baseline(tmp_path):
    path = tmp_path / "b.toml"
    for text, said in (
        ("format = 3", "format 3 is not known here"),
        ("format = 1", "'metrics' is missing"),
        (
            'format = 1\n[metrics]\na = 1\n[signals]\ny = [1]\n[instants]\n"t [s]" = [0, 1]',
            "signals and t differ in length",
        ),
        ("= 1", "Invalid statement"),
    ):
        path.write_text(text)
        with pytest.raises(FileError, match="this is no baseline") as found:
            read_baseline(path)
        assert said in str(found.value)
    with pytest.raises(ParameterError, match="tolerance: there is no metric 'rsm'"):
        small(tolerance={"rsm": "tight"})


def test_all_faults_of_a_guard_are_told_at_once(tmp_path):
    path = tmp_path / "loop.tracking.toml"
    path.write_text(GUARD.replace("stop =", "stopp =").replace("rms(u)", "rms(w)") + "[set]\nkp = 3\n")
    with pytest.raises(FileError) as found:
        read_guards(path)
    assert [one.split(":")[1] for one in found.value.problems] == ["3", "8", "10"]
