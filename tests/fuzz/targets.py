"""What is attacked: inputs that are good, how they are spoilt, and what reads them."""

from __future__ import annotations

import contextlib
import io
import itertools
import json
import random
from collections.abc import Callable, Sequence
from functools import cache
from pathlib import Path
from typing import Any

import attrs
import numpy as np

import tsmblocks as tsm
from tests.fuzz.mutation import mutated, reworded
from tsmblocks.common import headings, units
from tsmblocks.common.errors import CONTROLS
from tsmblocks.files.shipped import shipped_folder, shipped_names
from tsmblocks.metrics import conditions
from tsmblocks.metrics.metrics import metrics
from tsmblocks.studies.files import load_study
from tsmblocks.studies.saved_results import read_study
from tsmblocks.testing.guards import read_guards
from tsmblocks.testing.tracking import Baseline, read_baseline

T = np.arange(200) / 100
LABELS = {"t": "s", "x_in": "rad", "x_out": "deg"}


@attrs.frozen
class Target:
    """``spoilt`` makes an input from a generator, in a folder; ``read`` takes it, and may raise ``TsmError`` alone."""

    spoilt: Callable[[random.Random, Path], Any]
    read: Callable[[Any], Any]
    good: tuple[tuple[str, Callable[[Path], Any]], ...] = ()
    """Names of good files, with the functions that write them."""


# ---- recordings


def recording(ending: str, *write: Callable[[Path], Any]) -> Target:
    """A reader of recordings, with the functions that write good files."""

    @cache
    def good(folder: Path) -> list[bytes]:
        made = []
        for one in write:
            one(folder / f"good{ending}")
            made.append((folder / f"good{ending}").read_bytes())
        return made

    def spoilt(rng: random.Random, folder: Path) -> Path:
        path = folder / f"spoilt{ending}"
        path.write_bytes(mutated(rng, rng.choice(good(folder))))
        return path

    return Target(spoilt, _read_either_way, tuple((f"good{ending}", one) for one in write))


def _read_either_way(path: Path) -> None:
    columns = None if path.suffix not in (".npy", ".csv") or path.stat().st_size % 2 else "t, x_in [deg]"
    tsm.read(path, columns=columns)


def _record(path: Path) -> None:
    tsm.Record("r", T, {"x_in": np.sin(T), "x_out": np.cos(T)}, {"x_in": "rad", "x_out": "deg"}).save(path)


def _text(content: str) -> Callable[[Path], Any]:
    return lambda path: path.write_text(content, encoding="utf-8")


def _commas(path: Path) -> None:
    rows = (f"{t:.3f};{t * t:.4f}".replace(".", ",") for t in T)
    path.write_text("time;x [deg]\n" + "\n".join(rows), encoding="utf-8")


def _clock(path: Path) -> None:
    rows = (f'2026-11-22 14:03:{k % 60:02d}.5,"{k * k}"' for k in range(50))
    path.write_text('"t [s]","x"\n' + "\n".join(rows), encoding="utf-8")


def _matrix(path: Path) -> None:
    np.save(path, np.column_stack([T, np.sin(T)]))


def _old_mat(**options: Any) -> Callable[[Path], Any]:
    def write(path: Path) -> None:
        from scipy.io import savemat

        inner = {"time": T, "signals": {"values": np.sin(T), "label": "x"}}
        plain = {"t": T, "x": np.sin(T)}
        more = {} if options.get("format") == "4" else {"s": inner, "c": np.array(["a", "bb"], dtype=object)}
        savemat(path, {**plain, **more}, **options)

    return write


def _hdf5(path: Path) -> None:
    import h5py

    with h5py.File(path, "w", userblock_size=512 if path.suffix == ".mat" else 0) as file:
        file["t"], group = T, file.create_group("s")
        group["x"], group["text"] = np.sin(T), np.array([120, 121], dtype=np.uint16)
        group["text"].attrs["MATLAB_class"] = np.bytes_("char")
        group.attrs["MATLAB_class"] = np.bytes_("struct")


def _xlsx(path: Path) -> None:
    from openpyxl import Workbook

    book = Workbook()
    for row in [["t [s]", "x [deg]"], *([t, float(np.sin(t))] for t in T[:40].tolist())]:
        book.active.append(row)
    book.save(path)


def _parquet(path: Path) -> None:
    from pyarrow import parquet, table

    parquet.write_table(table({"t": T, "x": np.sin(T)}), path)


def _rows() -> str:
    return json.dumps([{"t": t, "x": t * t} for t in T[:20]])


def _split() -> str:
    return json.dumps({"columns": ["t", "x"], "data": [[t, t * t] for t in T[:20]]})


def _named() -> str:
    return json.dumps({"t": T.tolist(), "x": np.sin(T).tolist(), "units": {"x": "deg"}})


RECORDINGS = {
    "csv": recording(".csv", _record, _commas, _clock),
    "npz": recording(".npz", _record),
    "npy": recording(".npy", _matrix),
    "mat": recording(".mat", _record, _old_mat(), _old_mat(do_compression=True), _old_mat(format="4"), _hdf5),
    "hdf5": recording(".h5", _hdf5),
    "json": recording(".json", _text(_rows()), _text(_split()), _text(_named())),
    "xlsx": recording(".xlsx", _xlsx),
    "parquet": recording(".parquet", _parquet),
    "jsonl": recording(".jsonl", _text("\n".join(json.dumps({"t": k, "x": k * k}) for k in range(20)))),
}


def _odd_arrays(rng: random.Random, _folder: Path) -> dict[str, Any]:
    n = rng.choice([0, 1, 3, 50])
    kinds = [
        lambda: np.array([rng.choice([0.0, 1.0, np.nan, np.inf, -1e308, 1e-320]) for _ in range(n)]),
        lambda: np.arange(n) / 10,
        lambda: np.arange(n) * rng.choice([0, -1, 10**15]),
        lambda: np.zeros((n, 2)),
        lambda: [rng.choice(["1", "x", None, 1, 10**400]) for _ in range(n)],
        lambda: np.ma.masked_equal(np.arange(n), 2),
        lambda: np.array(["2026-01-01"] * n, dtype="datetime64[s]"),
        lambda: rng.choice([None, 3, "abc", {}, 1j]),
    ]
    given = {name: rng.choice(kinds)() if rng.random() < 0.3 else T[:n].copy() for name in ("t", "x_in", "x_out")}
    labels = {"x_in": rng.choice(["rad", "", "nonsense", 3, None])}
    return {"name": rng.choice(["r", "", None]), "t": given.pop("t"), "signals": given, "units": labels}


def _use_arrays(given: dict[str, Any]) -> None:
    record = tsm.Record(**given)
    str(record), record.resampled(0.05), record.part(0.1, 0.3)


# ---- diagrams, studies, baselines


def text_file(name: str, texts: Callable[[Path], Sequence[str]], read: Callable[[Path], Any]) -> Target:
    """A reader of texts."""

    def spoilt(rng: random.Random, folder: Path) -> Path:
        (folder / name).write_bytes(_spoilt_text(rng, rng.choice(texts(folder))))
        return folder / name

    return Target(spoilt, read)


def _spoilt_text(rng: random.Random, text: str) -> bytes:
    return reworded(rng, text).encode() if rng.random() < 0.6 else mutated(rng, text.encode())


@cache
def _results(folder: Path) -> dict[str, str]:
    """The two files of a study's results, by name."""
    diagram = tsm.load("fig09b_feedforward")
    tsm.study(diagram, {"theta": [4.0, 5.0]}, "rms(x_ref - x_out)", stop=0.1, step=0.005, out=folder / "results.csv")
    return {name: (folder / name).read_text(encoding="utf-8") for name in ("results.csv", "results.study.json")}


def _spoilt_results(rng: random.Random, folder: Path) -> Path:
    files, chosen = _results(folder), rng.randrange(2)
    for k, (name, text) in enumerate(files.items()):
        (folder / name).write_bytes(_spoilt_text(rng, text) if k == chosen else text.encode())
    return folder / "results.csv"


@cache
def _diagrams(_folder: Path) -> list[str]:
    return [(shipped_folder() / f"{name}.toml").read_text(encoding="utf-8") for name in shipped_names()]


def _use_diagram(path: Path) -> None:
    diagram = tsm.load(path)
    tsm.dumps(diagram)


STUDY = """\
format = 1
diagram = "fig09b_feedforward"
stop = 0.5
step = 0.005
[vary]
theta = { low = 3.0, high = 5.0, count = 3 }
"controller.kp" = [1.0, 2.0]
[metrics]
error = "rms(x_ref - x_out)"
"""
GUARD = """\
format = 1
diagram = "fig09b_feedforward"
stop = 2.0
tolerance = "tight"
[metrics]
"rms [deg]" = "rms(x_ref - x_out, after=1)"
"highest voltage" = { of = "largest(u)", tolerance = "loose" }
[cases]
fast = { theta = 4.0 }
"""
BASELINE = Baseline({"error": 0.25}, {"error": "rad"}, T[:5], {"x": T[:5]}, {"x": "rad"}).text()


# ---- expressions, units, command lines

SIGNALS = {"x_in": "rad", "x_out": "rad", "u": "V", "pid.e": "rad"}
EXPRESSIONS = [
    "rms(x_in - x_out)", "max(abs(x_out), 0.5, 1.0) / max(abs(x_in))", "overshoot(x_out)", "share(abs(u) > 20)",
    "mean(sin(x_in)**2 + cos(x_in)**2)", "max(x_out) - min(x_out)", "x_out > 1.5", "abs(pid.e) <= 1e-3 and u < 2",
]  # fmt: skip
UNITS = ["rad/s^2", "N*m/rad", "(rad)", "m^2*kg/s^3", "deg", "mm/s", "1/s", "%"]


def _words_of(texts: Sequence[str]) -> Callable[[random.Random, Path], str]:
    return lambda rng, _folder: reworded(rng, rng.choice(texts))


def _use_expression(text: str) -> None:
    with contextlib.suppress(tsm.TsmError):
        conditions.condition("stop_when", text, SIGNALS)
    metrics([text], SIGNALS)


def _use_unit(text: str) -> None:
    name, label = headings.split_heading(f"x [{text}]")
    headings.heading(name, label)
    units.factor(label, "rad")


COMMANDS = [
    "run fig09b_feedforward --stop 0.05 --set pid.kp=2 --out a.csv --json", "check fig07_observer motor_linear",
    "draw motor_linear --out a.svg --highlight motor", "blocks PID", "diagrams", "export motor_linear --out m.c",
    "run tendon_sheath_linear --data good.csv --map x_in=x_in --rows 1:50 --sampling 0.01",
    "fit tendon_sheath_linear --data good.csv --free gain.* --starts 1 --time-limit 1", "--version", "completion bash",
    "compare tendon_sheath_linear --data good.csv --starts 1", "study good.csv",
]  # fmt: skip
ARGUMENTS = [
    "--json", "--out", "--set", "--data", "--stop", "-1", "0", "nan", "1e9", "1e400", "''", "a.csv", "good.csv", "x=y",
    "--with", "none.py", "*", "..", "/", "--help", "-", "--", "é", "\x1b[31m", "x" * 300, "=", ":", "5:1", "rk4",
    "--method", "--rows", "--map", "--columns", "t,x", "--step", "--every", "--log", "--free", "--plot", "a.png",
]  # fmt: skip
WRITTEN = ("--out", "--plot", "--with", "--dask", "--workers", "--progress")


def _command_line(rng: random.Random, folder: Path) -> tuple[list[str], Path]:
    _record(folder / "good.csv")
    words = rng.choice(COMMANDS).split()
    for _ in range(rng.choice([1, 2, 3])):
        at, kind = rng.randrange(len(words)), rng.randrange(4)
        if kind == 0:
            words[at] = rng.choice(ARGUMENTS)
        elif kind == 1 and len(words) > 1:
            del words[at]
        elif kind == 2:
            words.insert(at, rng.choice(ARGUMENTS))
        else:
            words[at] = reworded(rng, words[at])
    for option, word in itertools.pairwise(list(words)):
        if option in WRITTEN and ("/" in word or ".." in word):
            words = ["diagrams", "/"]  # nothing is written outside the folder
    return [word.replace("\0", "") for word in words], folder


def _run_command(given: tuple[list[str], Path]) -> None:
    from tsmblocks.cli import main

    words, folder = given
    out, err = io.StringIO(), io.StringIO()
    with contextlib.chdir(folder), contextlib.redirect_stdout(out), contextlib.redirect_stderr(err):
        status = main(words)
    if status == 2 and CONTROLS.search(err.getvalue()) is None:
        raise tsm.TsmError(err.getvalue())
    if status not in (0, 2, 130) or "Traceback" in err.getvalue():
        raise AssertionError(f"status {status}: {err.getvalue()[-600:]}")


TARGETS = {
    **RECORDINGS,
    "arrays": Target(_odd_arrays, _use_arrays),
    "diagram": text_file("spoilt.toml", _diagrams, _use_diagram),
    "study": text_file("study.toml", lambda _: [STUDY], load_study),
    "results": Target(_spoilt_results, read_study),
    "guard": text_file("spoilt.tracking.toml", lambda _: [GUARD], read_guards),
    "baseline": text_file("baseline.toml", lambda _: [BASELINE], read_baseline),
    "expression": Target(_words_of(EXPRESSIONS), _use_expression),
    "unit": Target(_words_of(UNITS), _use_unit),
    "command": Target(_command_line, _run_command),
}
"""Targets by name."""
NEEDS = {"hdf5": ["h5py"], "mat": ["h5py"], "xlsx": ["openpyxl"], "parquet": ["pyarrow"]}
"""Packages that write the good files."""
