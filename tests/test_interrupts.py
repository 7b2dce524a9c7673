"""Ctrl-C and SIGTERM at many instants of the commands, and arguments of the wrong kind: no traceback."""

import os
import signal
import subprocess
import sys
import time
import warnings
from pathlib import Path

import numpy as np
import pytest

import tsmblocks as tsm
from tsmblocks.cli import main
from tsmblocks.cli.common import INTERRUPTED
from tsmblocks.common.interrupt import RAISED_AGAIN_AFTER, children_ignore_interrupts, defer_interrupt, note_interrupts
from tsmblocks.fitting import fit
from tsmblocks.fitting.experiments import Experiment

POSIX_ONLY = pytest.mark.skipif(sys.platform == "win32", reason="signals of POSIX")
REPOSITORY = Path(__file__).parents[1]
AT_IMPORT = """
import os, signal, sys
class Finder:
    count = 0
    def find_spec(self, name, *_):
        Finder.count += name.startswith(("tsmblocks.", "numpy.", "casadi", "attr", "scipy."))
        if Finder.count == {count}:
            signal.raise_signal(signal.{name})
        if {after!r} == name:
            signal.raise_signal(signal.{name})
sys.meta_path.insert(0, Finder())
"""
"""A module that Python imports first: it sends a signal when a given number of modules have been asked for."""


def interrupted(tmp_path, command, count=-1, name="SIGINT", after=""):
    (tmp_path / "sitecustomize.py").write_text(AT_IMPORT.format(count=count, name=name, after=after), encoding="utf-8")
    env = os.environ | {"PYTHONPATH": os.pathsep.join([str(tmp_path), str(REPOSITORY)])}
    done = subprocess.run(
        [sys.executable, "-m", "tsmblocks", *command],
        cwd=tmp_path,
        env=env,
        capture_output=True,
        text=True,
        timeout=120,
        check=False,
    )
    (tmp_path / "sitecustomize.py").unlink()
    return done


RUN = ["run", "fig09b_feedforward", "--stop", "0.1", "--out", "a.csv"]


@POSIX_ONLY
@pytest.mark.parametrize("count", [4, 25, 110, 200])
def test_ctrl_c_while_modules_are_imported(count, tmp_path):
    """The status of a process that the signal ended is 130 in a shell, too."""
    done = interrupted(tmp_path, RUN, count)
    assert done.returncode in (INTERRUPTED, -signal.SIGINT), done.stderr
    assert "Traceback" not in done.stderr
    assert done.stderr in ("", "tsmblocks: stopped before everything was done.\n")
    assert not list(tmp_path.glob("a.csv*"))


@POSIX_ONLY
@pytest.mark.parametrize("name", ["SIGINT", "SIGTERM"])
@pytest.mark.parametrize("after", ["tsmblocks.simulation.simulate", "tsmblocks.data.writing"])
def test_sigterm_leaves_what_ctrl_c_leaves(name, after, tmp_path):
    done = interrupted(tmp_path, RUN, name=name, after=after)
    assert done.returncode in (INTERRUPTED, -signal.SIGINT)
    assert done.stderr == "tsmblocks: stopped before everything was done.\n"
    assert not [path for path in tmp_path.iterdir() if path.name != "__pycache__"]


@pytest.mark.skipif(not Path("/proc/self/stat").exists(), reason="reads /proc of Linux")
def test_workers_of_a_study_end_with_the_command_when_it_is_killed(tmp_path):
    study = (
        "format = 1\ndiagram = 'fig09b_feedforward'\nstop = 300.0\nstep = 0.001\n"
        "[vary]\ntheta = { low = 2.0, high = 12.0, count = 4000 }\n[metrics]\nerror = 'rms(x_ref - x_out)'\n"
    )
    (tmp_path / "study.toml").write_text(study, encoding="utf-8")
    command = [sys.executable, "-m", "tsmblocks", "study", "study.toml", "--workers", "1", "--out", "a.csv"]
    env = os.environ | {"PYTHONPATH": str(REPOSITORY)}
    with subprocess.Popen(command, cwd=tmp_path, env=env, start_new_session=True) as process:
        while not (tmp_path / "a.csv").exists():  # the workers have been started by then
            assert process.poll() is None
            time.sleep(0.05)
        assert len(_in_session(process.pid)) > 1
        process.kill()
    until = time.monotonic() + 30.0
    while _in_session(process.pid) and time.monotonic() < until:
        time.sleep(0.1)
    alive = _in_session(process.pid)
    for pid in alive:
        os.kill(pid, signal.SIGKILL)
    assert alive == []


def _in_session(session):
    """Processes of a session, without those that have ended and were not waited for."""
    found = []
    for entry in Path("/proc").iterdir():
        if entry.name.isdecimal():
            try:
                fields = (entry / "stat").read_text(encoding="utf-8").rpartition(")")[2].split()
            except OSError:  # it has ended since
                continue
            if int(fields[3]) == session and fields[0] != "Z":
                found.append(int(entry.name))
    return found


@POSIX_ONLY
def test_workers_of_a_study_leave_ctrl_c_to_the_command(tmp_path):
    study = (
        "format = 1\ndiagram = 'fig09b_feedforward'\nstop = 300.0\nstep = 0.001\n[vary]\ntheta = [1, 2, 3, 4, 5, 6]\n"
    )
    (tmp_path / "s.toml").write_text(f"{study}[metrics]\nerror = 'rms(x_ref - x_out)'\n", encoding="utf-8")
    command = [sys.executable, "-m", "tsmblocks", "study", "s.toml", "--workers", "2"]
    env = os.environ | {"PYTHONPATH": str(REPOSITORY)}
    with subprocess.Popen(
        command, cwd=tmp_path, env=env, stderr=subprocess.PIPE, stdout=subprocess.PIPE, start_new_session=True
    ) as process:
        time.sleep(1.2)  # the workers are being started, or have been
        os.killpg(process.pid, signal.SIGINT)
        _, errors = process.communicate(timeout=120)
    assert process.returncode in (INTERRUPTED, 0)
    assert b"Traceback" not in errors


def test_what_a_library_makes_of_ctrl_c_is_no_fault_of_the_program(monkeypatch, capsys):
    from tsmblocks.cli import blocks

    def library(_args):
        try:
            signal.raise_signal(signal.SIGINT)
        except KeyboardInterrupt:
            raise SystemError("returned a result with an exception set") from None

    monkeypatch.setattr(blocks, "execute", library)
    assert main(["blocks"]) == INTERRUPTED
    assert capsys.readouterr().err == "tsmblocks: stopped before everything was done.\n"
    monkeypatch.setattr(blocks, "execute", lambda _: 1 // 0)
    assert main(["blocks"]) == 1
    assert "ZeroDivisionError" in capsys.readouterr().err


def test_ctrl_c_in_a_destructor_comes_again():
    class Closing:
        def __del__(self):
            signal.raise_signal(signal.SIGINT)

    def work():
        with note_interrupts() as noted:
            closing = [Closing()]
            closing.clear()
            time.sleep(20 * RAISED_AGAIN_AFTER)
            pytest.fail(f"nothing came, noted: {noted}")

    before, hook = signal.getsignal(signal.SIGINT), sys.unraisablehook
    with pytest.raises(KeyboardInterrupt):
        work()
    assert (signal.getsignal(signal.SIGINT), sys.unraisablehook) == (before, hook)


def test_a_search_defers_ctrl_c_within_a_command():
    with note_interrupts() as noted, defer_interrupt() as flag:
        signal.raise_signal(signal.SIGINT)
        assert flag.stop
        assert not noted.stop


@POSIX_ONLY
def test_processes_that_are_started_meanwhile_never_see_ctrl_c():
    code = "import os, signal; os.kill(os.getpid(), signal.SIGINT); print('alive')"
    with children_ignore_interrupts():
        done = subprocess.run([sys.executable, "-c", code], capture_output=True, text=True, check=True)
    assert done.stdout == "alive\n"
    assert signal.SIGINT not in signal.pthread_sigmask(signal.SIG_BLOCK, [])


# ---- within one simulation


def pressed_at(monkeypatch, which):
    """Press Ctrl-C in the simulation of this number; the list has an entry for each simulation after it."""
    advance, count, after = Experiment._advance, [0], []

    def counted(self, *args):
        count[0] += 1
        after.extend([count[0]] * (count[0] > which))
        if count[0] == which:
            signal.raise_signal(signal.SIGINT)
        return advance(self, *args)

    monkeypatch.setattr(Experiment, "_advance", counted)
    return after


@pytest.mark.parametrize(
    "given",
    [{}, {"method": "ipopt"}, {"method": "ipopt", "segments": 3}, {"method": "ga"}],
    ids=["gauss-newton", "ipopt", "segments", "ga"],
)
def test_a_fit_ends_within_one_simulation_of_ctrl_c(given, monkeypatch):
    slack = tsm.load("tendon_sheath_play")
    t = np.arange(0, 1, 0.01)
    x = np.sin(2 * np.pi * t) * (1 + t)
    record = tsm.Record("a", t, {"x_in": x, "x_out": 0.8 * x + 0.1}, {"x_in": "rad", "x_out": "rad"})
    records = {f"run {k}": record for k in range(20)}
    begun = tsm.score(slack, records).rms
    after = pressed_at(monkeypatch, 50)
    summarise, until = fit.summarise, []
    monkeypatch.setattr(fit, "summarise", lambda *args, **named: until.append(len(after)) or summarise(*args, **named))
    found = tsm.fit(slack, records, **given)
    assert found.status == "interrupted"
    assert found.rms <= begun * (1 + 1e-9)
    assert until[0] <= len(records)  # for the cost of the start


def test_ctrl_c_in_the_last_step_of_a_fit_is_not_lost(monkeypatch):
    whole = fit.nearest_of

    def pressed(*given):
        signal.raise_signal(signal.SIGINT)
        return whole(*given)

    monkeypatch.setattr(fit, "nearest_of", pressed)
    t = np.arange(0, 1, 0.01)
    record = tsm.Record("a", t, {"x_in": np.sin(9 * t), "x_out": 0.8 * np.sin(9 * t)}, {"x_in": "rad", "x_out": "rad"})
    found = tsm.fit(tsm.load("tendon_sheath_linear"), record)
    assert found.status == "interrupted"
    assert found["gain.gain"].value == pytest.approx(0.8)


# ---- arguments of the wrong kind

ODD = [
    [], {}, np.arange(3), object(), 10**400, -(10**400), None, "x" * 5000, float("nan"), b"a", True, (), set(), 1j,
    [1, 2], lambda: 1, "\x1b[31m", {"a": 1}, range(3), type, [[]], np.float64("nan"), np.array(1.0), np.array("a"),
]  # fmt: skip
T = np.arange(0, 1, 0.01)
MOTOR = tsm.load("motor_linear")
SIMULATE = dict(stop=0.01, inputs={"u": 1.0})
CALLS = {
    "simulate": (
        lambda **given: tsm.simulate(MOTOR, **SIMULATE | given),
        "stop step start parameters method inputs hold every log initial progress backend locate stop_when loops "
        "check_step",
    ),
    "batch": (
        lambda **given: tsm.simulate_batch(MOTOR, **dict(parameters={"motor.K": [1, 2]}) | SIMULATE | given),
        "parameters stop step start method inputs hold outputs every backend loops",
    ),
    "record": (
        lambda **given: tsm.Record(**dict(name="d", t=T, signals={"u": T}, units={}) | given),
        "t signals units filled",
    ),
    "read": (tsm.read, "path"),
    "diagram": (
        lambda **given: tsm.Diagram(**dict(title="a", blocks={}, wires=[]) | given),
        "title blocks wires inputs outputs values source",
    ),
    "gain": (tsm.blocks.Gain, "gain"),
    "input": (lambda u: tsm.simulate(MOTOR, stop=0.01, inputs={"u": u}), "u"),
    "parameter": (lambda value: MOTOR.with_parameters({"motor.K": value}), "value"),
    "load": (tsm.load, "name_or_path"),
    "text": (tsm.loads, "text"),
    "no diagram": (tsm.simulate, "diagram"),
}
"""Function and names of its arguments."""


def refusal(function, **given):
    """The message with which a call is refused, ``""`` where it is not."""
    try:
        function(**given)
    except tsm.TsmError as error:
        return str(error)
    return ""


@pytest.mark.parametrize("call", CALLS)
def test_an_argument_of_the_wrong_kind_has_one_message(call):
    function, names = CALLS[call]
    with warnings.catch_warnings():
        warnings.simplefilter("ignore")
        for name in names.split():
            for value in ODD:
                assert len(refusal(function, **{name: value})) < 6000, (name, value)
