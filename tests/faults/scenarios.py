"""What is done while calls fail: commands and functions that write files, each in a folder of its own."""

from __future__ import annotations

import os
import traceback
from collections.abc import Callable
from functools import cache
from pathlib import Path
from typing import Any

import attrs
import numpy as np

STUDY = """format = 1
diagram = "fig09b_feedforward"
stop = 0.2
step = 1e-3
[vary]
theta = [2.0, 5.0, 12.0]
[metrics]
"error [deg]" = "rms(x_ref - x_out)"
"""
GUARD = """format = 1
diagram = "../loop.toml"
stop = 0.2
[metrics]
"error [deg]" = "rms(x_ref - x_out)"
"""
OLD = "the old file"
"""Content of a file that is to be replaced."""
TORN = "written in place"
"""A scenario with the fault that all others must not have."""


@attrs.frozen
class Scenario:
    """Something done in the working folder.

    ``prepare`` makes the files that it reads; ``run`` does it and returns the exit status; ``writes`` are files that it
    makes, of which each is an old one in half of the trials. ``kept`` computes beforehand what is slow and meets no
    file. With ``tolerated`` it succeeds whatever fails. ``ends`` is the exit status without a fault, ``refused`` those
    with one. Where it ``prints``, standard output fails as well. Of a ``slow`` one also the kills meet only what
    follows what is kept.
    """

    run: Callable[[], int]
    prepare: Callable[[], None] = lambda: None
    writes: tuple[str, ...] = ()
    kept: Callable[[], None] = lambda: None
    tolerated: bool = False
    ends: int = 0
    refused: tuple[int, ...] = (2,)
    prints: bool = True
    slow: bool = False


def command(*words: str) -> Callable[[], int]:
    """A command, in this process."""

    def run() -> int:
        from tsmblocks.cli import main

        return main(list(words))

    return run


def function(act: Callable[[], Any]) -> Callable[[], int]:
    """A function, whose errors are printed as a command does."""

    def run() -> int:
        from tsmblocks.cli.console import print_error
        from tsmblocks.common.errors import TsmError

        try:
            act()
        except (TsmError, OSError) as error:
            print_error(str(error))
            return 2
        except Exception:
            traceback.print_exc()
            return 1
        return 0

    return run


# ---- files that are read


def recording() -> None:
    """A recording of a play of 0.1 rad with a little noise."""
    t = np.arange(0, 6, 0.01)
    x, y, at = np.sin(2.3 * t) * (0.4 + 0.1 * t), [], 0.0
    for value in x:
        at = min(max(at, value - 0.05), value + 0.05)
        y.append(at)
    noise = np.random.default_rng(1).normal(0, 2e-3, len(t))
    rows = np.column_stack([t, x, np.array(y) + noise])
    heading = "t [s],x_in [rad],x_out [rad]"
    np.savetxt("sheath.csv", rows, delimiter=",", fmt="%.6g", header=heading, comments="")


def study_file() -> None:
    """A study of three runs."""
    Path("study.toml").write_text(STUDY, encoding="utf-8")


def half_a_study() -> None:
    """A study that was killed after the second run, in the middle of a line."""
    study_file()
    command("study", "study.toml", "--out", "gains.csv")()
    text = Path("gains.csv").read_text(encoding="utf-8")
    Path("gains.csv").write_text(text[: text.rindex(",")], encoding="utf-8")


def guard_file() -> None:
    """A diagram and a guard of it."""
    import tsmblocks as tsm

    tsm.save(tsm.load("fig09b_feedforward"), "loop.toml")
    Path("guards").mkdir()
    Path("guards/loop.tracking.toml").write_text(GUARD, encoding="utf-8")


def recordings() -> None:
    """The recording as CSV, NPZ and MAT 5."""
    from tsmblocks.data import read

    recording()
    record = read("sheath.csv")
    record.save(Path("sheath.npz"))
    record.save(Path("sheath.mat"))


def recording_of_hdf5() -> None:
    """The recording as MAT 7.3."""
    import h5py

    from tsmblocks.data import read

    recording()
    record = read("sheath.csv")
    with h5py.File("new.mat", "w", userblock_size=512) as file:
        for name, values in {"t": record.t, **record.signals}.items():
            file[name] = values.reshape(1, -1)
            file[name].attrs["MATLAB_class"] = np.bytes_("double")
    content = bytearray(Path("new.mat").read_bytes())
    content[:128] = b"MATLAB 7.3 MAT-file".ljust(124) + b"\x00\x02IM"
    Path("new.mat").write_bytes(content)


# ---- what is computed once


@cache
def _remembered(module: Any, name: str) -> None:
    """Let a function return what it returned first."""
    made, real = [], getattr(module, name)

    def again(*args: Any, **more: Any) -> Any:
        if not made:
            made.append(real(*args, **more))
        return made[0]

    setattr(module, name, again)


def keep_fit() -> None:
    """Remember a fit."""
    from importlib import import_module

    _remembered(import_module("tsmblocks.fitting.fit"), "fit")


def keep_diagnosis() -> None:
    """Remember a diagnosis."""
    from importlib import import_module

    _remembered(import_module("tsmblocks.diagnosis.diagnose"), "diagnose")


def keep_demo() -> None:
    """Remember what the demonstration computes, and draw nothing: its pictures are written as letters."""
    from importlib import import_module

    from matplotlib.figure import Figure

    Figure.savefig = lambda _self, file, **_: file.write(b"picture" * 9000)
    for name in ("cases", "run"):
        _remembered(import_module("tsmblocks.demo.paper"), name)
    _remembered(import_module("tsmblocks.demo.story"), "build_story")
    _remembered(import_module("tsmblocks.demo.page"), "page")


# ---- what is done


def _save() -> None:
    import tsmblocks as tsm

    tsm.save(tsm.load("fig07_observer"), "saved.toml")


def _records() -> None:
    from tsmblocks.data.record import Record

    record = Record("ramp", np.arange(3000) / 10, {"x": np.arange(3000.0)}, {"x": "rad"})
    for ending in ("csv", "npz", "mat"):
        record.save(Path(f"ramp.{ending}"))


def _guards(*options: str) -> Callable[[], int]:
    def run() -> int:
        import pytest

        quiet = ("-q", "-p", "no:cacheprovider", "-p", "no:randomly", "-p", "no:xdist", "--rootdir=.", "-c", os.devnull)
        return int(pytest.main([*quiet, *options, "guards/loop.tracking.toml"]))

    return run


def _changed_guard() -> None:
    guard_file()
    _guards("--tracking-accept")()
    baseline = next(Path("guards").glob("*.baseline.toml"))
    text = baseline.read_text(encoding="utf-8")
    baseline.write_text(text.replace('"error [deg]" = ', '"error [deg]" = 1'), encoding="utf-8")


def _with_machine_code() -> None:
    """Two functions that are not loaded, one of them called again after it was dropped."""
    import ctypes

    from tsmblocks.engine import jit

    for value in (3, 4, 3):
        jit._LOADED.clear()
        text = f"define void @run(ptr %t) {{\n  store i64 {value}, ptr %t\n  ret void\n}}\n"
        target = ctypes.c_int64()
        jit.compile_text(text, promote=True)(ctypes.addressof(target))
        assert target.value == value


def _tune() -> None:
    import tsmblocks as tsm

    loop = tsm.load("fig09b_feedforward")
    found = tsm.tune(loop, {"theta": (3.0, 8.0)}, "rms(x_ref - x_out)", stop=0.2, starts=2)
    tsm.save(next(iter(found.diagrams.values())), "tuned.toml")


RUN = ("run", "tendon_sheath_play", "--data", "sheath.csv", "--out", "run.csv")
FIT = ("fit", "tendon_sheath_linear", "--data", "sheath.csv", "--starts", "1", "--out", "fitted.toml")
DIAGNOSE = ("diagnose", "tendon_sheath_linear", "--data", "sheath.csv", "--effects", "backlash", "--out", "found")
WITH_STUDY = ("study", "study.toml", "--out", "gains.csv")
PLAYED = ("run", "tendon_sheath_play", "--stop", "1", "--data")

SCENARIOS = {
    "save": Scenario(function(_save), writes=("saved.toml",)),
    "records": Scenario(function(_records), writes=("ramp.csv", "ramp.npz", "ramp.mat")),
    "run": Scenario(command(*RUN), recording, ("run.csv",)),
    "study": Scenario(command(*WITH_STUDY), study_file),
    "study again": Scenario(command(*WITH_STUDY), half_a_study),
    "study in processes": Scenario(command(*WITH_STUDY, "--workers", "2"), study_file, slow=True),
    "fit": Scenario(command(*FIT), recording, ("fitted.toml",), keep_fit),
    "diagnose": Scenario(
        command(*DIAGNOSE),
        recording,
        ("found/diagnosis.json", "found/augmented.toml", "found/report.html"),
        keep_diagnosis,
    ),
    "tune": Scenario(function(_tune), writes=("tuned.toml",)),
    TORN: Scenario(function(lambda: Path("torn.txt").write_text("new" * 9000, encoding="utf-8")), writes=("torn.txt",)),
    "demo": Scenario(command("demo", "--out", "story"), writes=("story/index.html",), kept=keep_demo, slow=True),
    "guard accepted": Scenario(_guards("--tracking-accept"), guard_file, refused=(1, 2, 3), prints=False),
    "guard changed": Scenario(
        _guards("--tracking-pictures", "pictures"), _changed_guard, ends=1, refused=(1, 2, 3), prints=False
    ),
    "machine code": Scenario(function(_with_machine_code), tolerated=True),
    "export c": Scenario(command("export", "eq11_compensator", "--out", "part.c"), writes=("part.c", "part.h")),
    "export mat": Scenario(command("export", "motor_linear", "--out", "part.mat"), writes=("part.mat",)),
    "draw": Scenario(command("draw", "motor_linear", "--out", "d.svg"), writes=("d.svg",)),
    "compare": Scenario(
        command("compare", "tendon_sheath_play", "--data", "sheath.csv", "--plot", "c.png"), recording, ("c.png",)
    ),
    **{
        f"read {kind}": Scenario(command(*PLAYED, f"sheath.{kind}", "--json"), recordings)
        for kind in ("csv", "npz", "mat")
    },
    "read mat 7.3": Scenario(command(*PLAYED, "new.mat", "--json"), recording_of_hdf5),
    "check": Scenario(command("check", "loop.toml"), guard_file),
}
"""Scenarios by name."""
