"""The command ``study``: a file in, a table and results out; every fault of a file with its line."""

import errno
import json
import os
import shutil
import subprocess
import sys
from pathlib import Path

import pytest

import tsmblocks
from tsmblocks.cli import main
from tsmblocks.cli.console import duration_text
from tsmblocks.cli.study import study_progress
from tsmblocks.common.errors import FileError
from tsmblocks.studies.files import load_study

STUDY = """format = 1
title = "Gains"
diagram = "fig16_feedforward_feedback"
stop = 2.0
step = 2e-3

[set]
"pid.kd" = 0.001

[metrics]
"error [deg]" = "peak_to_peak(x_ref - x_out)"
effort = "rms(u)"

[plan]
kind = "latin_hypercube"
runs = 40
seed = 1

[vary]
"pid.kp" = [0.5, 3.0]
"pid.ki" = { low = 0.1, high = 10, scale = "log" }
theta = { relative = 0.1 }
A = { mean = -0.81, deviation = 0.05, high = -0.1 }
"""
GRID = """format = 1
diagram = "fig16_feedforward_feedback"
stop = 1.0
step = 2e-3
[plan]
kind = "KIND"
[vary]
"pid.kp" = [1.0, 1.5]
"pid.ki" = { low = 1, high = 3, count = 3 }
"""


@pytest.fixture
def file(tmp_path, monkeypatch):
    monkeypatch.chdir(tmp_path)

    def write(text, name="study.toml"):
        Path(name).write_text(text, encoding="utf-8")
        return name

    return write


def test_a_study_is_run_kept_and_shown_again(file, capsys):
    name = file(STUDY)
    assert main(["study", name, "--out", "found.csv", "--plot", "found.png"]) == 0
    first = capsys.readouterr().out
    assert first.startswith("Gains: latin hypercube, 40 runs over pid.kp, pid.ki, theta, A\n")
    assert first.endswith("\n\nwrote found.csv\nwrote found.png\n")
    assert Path("found.png").stat().st_size > 5000
    kept = Path("found.csv").read_bytes()
    assert main(["study", name, "--out", "found.csv"]) == 0
    assert capsys.readouterr().out.split("\n\nwrote")[0] == first.split("\n\nwrote")[0]
    assert main(["study", "found.csv"]) == 0
    assert capsys.readouterr().out.strip() == first.split("\n\nwrote")[0].strip()
    assert Path("found.csv").read_bytes() == kept
    frame = tsmblocks.read_study("found.csv").to_pandas()
    assert frame["theta"].mean() == pytest.approx(4.382, rel=0.02)
    assert frame["pid.ki"].between(0.1, 10).all()
    assert frame["error [deg]"].between(1, 60).all()


def test_the_same_in_processes(file):
    name = file(STUDY)
    assert main(["study", name, "--out", "a.csv"]) == 0
    command = [sys.executable, "-m", "tsmblocks", "study", name, "--workers", "2", "--out", "b.csv"]
    subprocess.run(
        command,
        check=True,
        capture_output=True,
        cwd=Path.cwd(),
        env={"PYTHONPATH": str(Path(tsmblocks.__file__).parents[1]), "PATH": ""},
    )
    assert Path("a.csv").read_bytes() == Path("b.csv").read_bytes()


def test_processes_that_cannot_be_started_are_one_message(file, capsys, monkeypatch):
    def full(*_):
        raise BlockingIOError(errno.EAGAIN, os.strerror(errno.EAGAIN))

    monkeypatch.setattr("multiprocessing.util.spawnv_passfds", full)
    assert main(["study", file(STUDY), "--workers", "2"]) == 2
    said = "tsmblocks: --workers 2: no more processes can be started: resource temporarily unavailable.\n"
    assert capsys.readouterr().err == said


def test_grids_and_sweeps(file, capsys):
    assert main(["study", file(GRID.replace("KIND", "grid")), "--json"]) == 0
    found = json.loads(capsys.readouterr().out)
    assert (found["runs"], found["status"], found["failed"]) == (6, "complete", 0)
    assert list(found["metrics"]) == ["peak-to-peak error", "rms error", "largest error", "effort"]
    assert found["metrics"]["rms error"]["best"]["pid.ki"] in (1.0, 2.0, 3.0)
    assert main(["study", file(GRID.replace("KIND", "sweep"))]) == 0
    assert "sweep, 6 runs" in capsys.readouterr().out


def test_a_diagram_beside_the_file_and_measured_inputs(file, capsys):
    shipped = Path(tsmblocks.__file__).parents[1] / "diagrams"
    shutil.copy(shipped / "tendon_sheath_play.toml", "mine.toml")
    Path("data.csv").write_text(
        "t [s],x_in [deg]\n" + "".join(f"{0.01 * k},{k % 50}\n" for k in range(200)), encoding="utf-8"
    )
    text = 'format = 1\ndiagram = "mine.toml"\nstep = 0.01\n[metrics]\nhigh = "highest(x_out)"\n[vary]\n'
    name = file(text + '"play.half_width" = [0.0, 0.1]\n')
    assert main(["study", name, "--data", "data.csv", "--json"]) == 0
    found = json.loads(capsys.readouterr().out)["metrics"]["high"]
    assert found["highest"] - found["lowest"] == pytest.approx(0.1, rel=0.2)
    assert main(["study", name]) == 2
    assert "needs its input x_in" in capsys.readouterr().err


FAULTS = {
    "unknown key": (STUDY.replace("stop =", "stopp ="), "4: 'stopp' is not a key of a study. Did you mean 'stop'?"),
    "no format": (STUDY.replace("format = 1\n", ""), " format = 1 is needed, got None."),
    "no diagram": (
        STUDY.replace("diagram =", "diagramm ="),
        "3: 'diagramm' is not a key of a study. Did you mean 'diagram'?",
    ),
    "unknown diagram": (
        STUDY.replace("fig16_feedforward_feedback", "fig61"),
        "3: there is no file 'fig61', and no ready-made diagram of that name.",
    ),
    "stop": (STUDY.replace("2.0", '"2"'), "4: 'stop' must be a number, got '2'."),
    "set": (STUDY.replace('"pid.kd"', '"pid.kdd"'), "8: pid: PID has no parameter 'kdd'. Did you mean 'kd'?"),
    "metric": (STUDY.replace("rms(u)", "rms(w)"), "12: metric 'effort': there is no signal 'w'."),
    "metric's unit": (STUDY.replace("[deg]", "[V]"), "11: metric 'error': 'rad' does not convert to 'V'."),
    "plan": (
        STUDY.replace("latin_hypercube", "latin_cube"),
        "15: there is no plan 'latin_cube'. Did you mean 'latin_hypercube'?",
    ),
    "plan's key": (STUDY.replace("seed", "sede"), "17: 'sede' is not a key of a latin_hypercube. Did you mean 'seed'?"),
    "no runs": (STUDY.replace("runs = 40\n", ""), "14: a latin_hypercube needs runs = …, how many."),
    "runs": (STUDY.replace("runs = 40", "runs = 0"), "14: runs must be a whole number of at least 1, got 0."),
    "nothing varies": (
        STUDY.partition("[vary]")[0],
        ' no parameter varies: write [vary] with lines such as "pid.kp" = [1.0, 1.5, 2.0].',
    ),
    "parameter": (
        STUDY.replace('"pid.kp"', '"pid.pk"'),
        "20: diagram 'Feedforward plus PID feedback of the tip' has no parameter 'pid.pk'. Did you mean 'pid.kp'?",
    ),
    "belief": (
        STUDY.replace("relative", "relativ"),
        "22: 'theta' varies by low and high (and scale = \"log\"), by mean "
        "and deviation, by relative, a share; got {'relativ': 0.1}.",
    ),
    "scale": (STUDY.replace('"log"', '"logarithmic"'), '21: scale is "linear" or "log", got \'logarithmic\'.'),
    "upside down": (STUDY.replace("[0.5, 3.0]", "[3.0, 0.5]"), "20: low must be below high, got low=3, high=0.5."),
    "share of nothing": (
        STUDY.replace("theta", '"pid.kd"').replace("0.001", "0.0"),
        "22: the diagram's own value is 0, so a share of it is 0; give mean and deviation.",
    ),
    "count": (
        GRID.replace("KIND", "grid").replace("count = 3", "count = 1"),
        "9: count must be a whole number from 2 to 10,000,000, got 1.",
    ),
    "value": (
        GRID.replace("KIND", "grid").replace("[1.0, 1.5]", "1.5"),
        "8: 'pid.kp' needs a list of values, or { low = …, high = …, count = … }, got 1.5.",
    ),
    "not TOML": (STUDY.replace("[plan]", "[plan"), "14: this is not TOML"),
    "words": (
        STUDY.replace("mean = -0.81", 'mean = "low"'),
        "23: a number of Uniform or Normal must be a finite number, got 'low'.",
    ),
}


@pytest.mark.parametrize("name", FAULTS)
def test_every_fault_has_its_line(name, file, capsys):
    text, said = FAULTS[name]
    path = file(text)
    with pytest.raises(FileError) as found:
        load_study(path)
    assert any(one.startswith(f"{path}:{said}") for one in found.value.problems), found.value.problems
    assert main(["study", path]) == 2
    assert "Traceback" not in capsys.readouterr().err


def test_all_faults_are_told_at_once(file):
    text = STUDY.replace("stop =", "stopp =").replace("rms(u)", "rms(w)").replace("relative", "relativ")
    with pytest.raises(FileError) as found:
        load_study(file(text))
    assert [one.split(":")[1] for one in found.value.problems] == ["4", "12", "22"]


WRONG = {
    ("no.toml",): "no.toml: there is no such file.",
    ("study.toml", "--out", "x.txt"): "'x.txt' must end in .csv.",
    ("study.toml", "--plot", "x.txt"): "'x.txt' must end in .png, .svg or .pdf.",
    ("study.toml", "--workers", "0"): "argument --workers: '0' is not a whole number of at least 1",
    ("study.toml", "--workers", "2", "--dask", "a:1"): "argument --dask: not allowed with argument --workers",
    ("found.csv", "--out", "b.csv"): "results are printed again as they are; --out is for a study file.",
    ("found.csv",): "found.csv: cannot be read: No such file or directory.",
    ("study.toml", "--data", "x.csv"): "has no inputs, so there is nothing that --data could drive.",
}


@pytest.mark.parametrize("words", WRONG)
def test_what_is_typed_wrong(words, file, capsys):
    file(STUDY)
    assert main(["study", *words]) == 2
    assert WRONG[words] in capsys.readouterr().err


@pytest.mark.filterwarnings("default")
def test_a_scheduler_that_is_not_there(file, capsys, monkeypatch):
    distributed = pytest.importorskip("distributed")
    client = distributed.Client
    monkeypatch.setattr(distributed, "Client", lambda address, timeout: client(address, timeout="1s"))
    assert main(["study", file(STUDY), "--dask", "tcp://127.0.0.1:9"]) == 2
    assert "no Dask scheduler answers at 'tcp://127.0.0.1:9'" in capsys.readouterr().err


def test_a_terminal_sees_rate_and_time_left(monkeypatch):
    clock = iter([0.0, 2.0])
    monkeypatch.setattr("tsmblocks.cli.study.time.monotonic", lambda: next(clock))
    words = study_progress()
    assert [words(100, 1000), words(300, 1000)] == [
        "100 of 1000 runs done",
        "300 of 1000 runs done, 100 runs/s, about 7 s left",
    ]
    assert [duration_text(s) for s in (0.4, 59, 200, 7500)] == ["1 s", "59 s", "3 min 20 s", "2 h 5 min"]
