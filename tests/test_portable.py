"""What differs between systems: how files are written and named, what a process may do, where things are kept."""

import ast
import itertools
import subprocess
import sys
from pathlib import Path

import numpy as np
import pytest

import tsmblocks
from tsmblocks.cli import common, entry, main
from tsmblocks.common.tables import unique_names
from tsmblocks.effects import catalogue
from tsmblocks.engine import code_cache
from tsmblocks.files.shipped import shipped_names
from tsmblocks.model.block import REGISTRY

SOURCE = Path(tsmblocks.__file__).parent
FILES = sorted(SOURCE.rglob("*.py"))
ROOMS = {room: list(paths) for room, paths in itertools.groupby(FILES, lambda p: p.relative_to(SOURCE).parts[0])}
POSIX = {
    "fork",
    "getuid",
    "geteuid",
    "uname",
    "SIGALRM",
    "SIGKILL",
    "SIGUSR1",
    "setitimer",
    "chown",
    "symlink",
    "mkfifo",
}
"""Names that are not there on every system."""
ASKED_FIRST = {"engine/code_cache.py": {"getuid"}}
"""Where the system is asked before one is used."""
SCRIPT = """
import multiprocessing
from concurrent.futures import ProcessPoolExecutor
import tsmblocks as tsm

def work():
    with ProcessPoolExecutor(2, multiprocessing.get_context("spawn")) as pool:
        found = tsm.study(tsm.load("fig09b_feedforward"), {"theta": [4.0, 5.0]}, {"error": "rms(x_ref - x_out)"},
                          stop=0.5, step=0.005, executor=pool)
    print(found["error"].tolist())
"""


def name_of(path):
    return path.relative_to(SOURCE).as_posix()


def calls(path):
    """Every call of a module: what is called, its positional arguments and keywords."""
    for node in ast.walk(ast.parse(path.read_text(encoding="utf-8"))):
        if isinstance(node, ast.Call) and isinstance(node.func, (ast.Attribute, ast.Name)):
            name = node.func.attr if isinstance(node.func, ast.Attribute) else node.func.id
            yield name, node.args, {k.arg: ast.unparse(k.value) for k in node.keywords}


def calls_of(room):
    return ((path, *call) for path in ROOMS[room] for call in calls(path))


@pytest.mark.parametrize("room", ROOMS)
def test_texts_are_written_alike_everywhere(room):
    for path, name, args, given in calls_of(room):
        mode = next((a.value for a in args if isinstance(a, ast.Constant) and isinstance(a.value, str)), "")
        if name == "write_text" or (name in ("open", "fdopen") and set(mode) & set("wax") and "b" not in mode):
            assert (given.get("encoding"), given.get("newline")) == ("'utf-8'", r"'\n'"), (path, name)
        if name == "read_text" or (name == "open" and mode == "r"):
            assert given.get("encoding") == "'utf-8'", (path, name)
        assert name not in ("rename", "renames"), f"{path}: rename fails where there is a file, replace does not"


@pytest.mark.parametrize("room", ROOMS)
def test_nothing_is_asked_that_a_system_may_not_have(room):
    for path in ROOMS[room]:
        nodes = list(ast.walk(ast.parse(path.read_text(encoding="utf-8"))))
        used = {node.attr for node in nodes if isinstance(node, ast.Attribute)}
        assert used & POSIX == ASKED_FIRST.get(name_of(path), set()), path
        texts = [node.value for node in nodes if isinstance(node, ast.Constant) and isinstance(node.value, str)]
        assert not [text for text in texts if text.startswith(("/tmp", "/dev/", "/usr/", "/home", "C:\\"))], path


def test_names_stay_apart_where_capitals_do_not():
    for known in (REGISTRY, shipped_names(), [e.name for e in catalogue()]):
        each = set(known)
        assert len({name.casefold() for name in each}) == len(each)
        assert not {name.casefold() for name in each} & {"con", "prn", "aux", "nul", *(f"com{k}" for k in range(10))}
    for folder in (SOURCE, SOURCE.parent / "diagrams", SOURCE.parent / "tests", SOURCE.parent / "examples"):
        paths = [str(path) for path in folder.rglob("*") if "__pycache__" not in path.parts]
        assert len({path.casefold() for path in paths}) == len(paths)


def test_files_of_several_experiments_stay_apart_and_have_names_that_every_system_takes():
    paths = common.paths_by_name(Path("out") / "fitted.toml", ["bend 60", "bend:60", "Bend_60", "CON", "a/b\\c", "Δ"])
    made = [path.name for path in paths.values()]
    assert made == [
        "fitted_bend_60.toml",
        "fitted_bend_60_2.toml",
        "fitted_Bend_60_3.toml",
        "fitted_CON.toml",
        "fitted_a_b_c.toml",
        "fitted_.toml",
    ]
    assert len({name.casefold() for name in made}) == len(made)
    assert {path.parent for path in paths.values()} == {Path("out")}
    assert unique_names(["x", "X", "x"]) == ["x", "X", "x_2"]


def test_fits_of_experiments_that_differ_in_capitals_are_all_there(tmp_path, monkeypatch, capsys):
    monkeypatch.chdir(tmp_path)
    t = np.arange(0.0, 2.0, 0.01)
    for folder, name, gain in (("one", "bend", 0.8), ("two", "Bend", 0.6)):
        Path(folder).mkdir()
        rows = "".join(f"{a:.2f},{np.sin(3 * a):.6f},{gain * np.sin(3 * a):.6f}\n" for a in t)
        Path(folder, f"{name}.csv").write_text("t [s],x_in [rad],x_out [rad]\n" + rows, encoding="utf-8")
    data = ["--data", "one/bend.csv", "two/Bend.csv", "--local", "gain.gain", "--starts", "1", "--out", "f.toml"]
    assert main(["fit", "tendon_sheath_linear", *data]) == 0
    assert sorted(path.name for path in tmp_path.glob("*.toml")) == ["f_Bend_2.toml", "f_bend.toml"]
    capsys.readouterr()


@pytest.mark.parametrize("name", ["a.csv", "a.CSV", "a.NPZ", "a.Mat"])
def test_results_are_written_whatever_the_case_of_the_ending_and_with_plain_newlines(name, tmp_path):
    run = tsmblocks.simulate(tsmblocks.load("motor_linear"), inputs={"u": 1.0}, stop=0.05, step=0.01)
    path = run.save(tmp_path / name)
    assert [p.name for p in tmp_path.iterdir()] == [name]
    np.testing.assert_allclose(tsmblocks.read(path)["x"], run["x"])
    if name == "a.csv":
        assert path.read_bytes().startswith(b"t [s],x [rad]\n")
        assert b"\r" not in path.read_bytes()


@pytest.mark.parametrize(
    ("platform", "error", "gone"),
    [
        ("linux", BrokenPipeError(), True),
        ("win32", BrokenPipeError(), True),
        ("win32", OSError(22, "Invalid"), True),
        ("linux", OSError(22, "Invalid"), False),
        ("win32", OSError(22, "Invalid", "a:b.csv"), False),
    ],
)
def test_a_reader_that_goes_away_is_known_by_what_the_system_says(platform, error, gone, monkeypatch):
    monkeypatch.setattr(sys, "platform", platform)
    assert entry._is_closed_pipe(error) is gone


# ---- processes


def ran(folder, tail):
    (folder / "script.py").write_text(SCRIPT + tail, encoding="utf-8")
    return subprocess.run(
        [sys.executable, "script.py"], cwd=folder, capture_output=True, text=True, timeout=120, check=False
    )


def test_a_study_runs_in_processes_that_share_nothing(tmp_path):
    done = ran(tmp_path, '\nif __name__ == "__main__":\n    work()\n')
    assert done.stderr == ""
    diagram, metrics = tsmblocks.load("fig09b_feedforward"), {"error": "rms(x_ref - x_out)"}
    alone = tsmblocks.study(diagram, {"theta": [4.0, 5.0]}, metrics, stop=0.5, step=0.005)
    assert done.stdout.strip() == str(alone["error"].tolist())


def test_a_script_without_a_guard_is_told_what_it_lacks(tmp_path):
    done = ran(tmp_path, "\nwork()\n")
    assert done.returncode == 1
    assert 'A script that starts processes must do so under if __name__ == "__main__":.' in done.stderr


# ---- where machine code is kept


@pytest.mark.parametrize(
    ("platform", "place", "wanted"),
    [
        ("linux", {"XDG_CACHE_HOME": "/x"}, "/x/tsmblocks/machine-code"),
        ("linux", {}, "~/.cache/tsmblocks/machine-code"),
        ("darwin", {"XDG_CACHE_HOME": "/x"}, "~/Library/Caches/tsmblocks/machine-code"),
        ("win32", {"LOCALAPPDATA": "/l"}, "/l/tsmblocks/machine-code"),
        ("win32", {}, "~/AppData/Local/tsmblocks/machine-code"),
        ("linux", {"TSMBLOCKS_CACHE": "/own"}, "/own/machine-code"),
    ],
)
def test_machine_code_is_kept_where_the_system_keeps_such_things(platform, place, wanted, monkeypatch):
    for name in ("XDG_CACHE_HOME", "LOCALAPPDATA", "TSMBLOCKS_CACHE"):
        monkeypatch.delenv(name, raising=False)
    for name, value in place.items():
        monkeypatch.setenv(name, value)
    monkeypatch.setattr(sys, "platform", platform)
    assert code_cache.cache_directory() == Path(wanted).expanduser()


def test_code_that_cannot_be_put_in_its_place_leaves_nothing_behind(tmp_path, monkeypatch):
    monkeypatch.setenv("TSMBLOCKS_CACHE", str(tmp_path))
    folder = tmp_path / "machine-code"
    (folder / "taken.o").mkdir(parents=True, mode=0o700)
    (folder / "taken.o" / "x").write_text("", encoding="utf-8")
    (folder / code_cache.MARK).write_bytes(code_cache.MARK_TEXT)
    code_cache.write_code("taken", b"code")  # as where another process has the file open
    assert sorted(path.name for path in folder.iterdir()) == [code_cache.MARK, "taken.o"]
