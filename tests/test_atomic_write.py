"""Files are replaced in one step, whoever else writes or reads there, and by whatever command."""

import ast
import errno
import os
import stat
import sys
import tempfile
import threading
import time
from pathlib import Path

import numpy as np
import pytest

import tsmblocks as tsm
from tsmblocks.common import atomic_write
from tsmblocks.common.atomic_write import replace_figure, replace_file, replacing
from tsmblocks.data.record import Record
from tsmblocks.draw import to_png
from tsmblocks.export import to_c, to_mat

POSIX_ONLY = pytest.mark.skipif(sys.platform == "win32", reason="links, modes and devices of POSIX")
SOURCE = Path(tsm.__file__).parent
RECORD = Record("ramp", np.arange(50) / 10, {"x": np.arange(50.0)}, {"x": "rad"})
WRITERS = {
    "diagram": ("d.toml", lambda path: tsm.save(tsm.load("motor_linear"), path)),
    "csv": ("d.csv", RECORD.save),
    "npz": ("d.npz", RECORD.save),
    "mat": ("d.mat", RECORD.save),
    "diagram as mat": ("d.mat", lambda path: to_mat(tsm.load("motor_linear"), path)),
    "c": ("controller.h", lambda path: to_c(tsm.load("motor_linear"), step=1e-3).save(path.parent)),
    "picture": ("d.png", lambda path: to_png(tsm.load("motor_linear"), path)),
}
"""File and what writes it."""


def test_threads_that_write_one_file_never_meet(tmp_path):
    target, texts, failed = tmp_path / "d.toml", [str(k) * 20_000 for k in range(6)], []
    replace_file(target, texts[0])

    def write(text):
        try:
            for _ in range(30):
                replace_file(target, text)
                assert target.read_text(encoding="utf-8") in texts
        except Exception as error:
            failed.append(error)

    threads = [threading.Thread(target=write, args=(text,)) for text in texts]
    for thread in threads:
        thread.start()
    for thread in threads:
        thread.join()
    assert failed == []
    assert [path.name for path in tmp_path.iterdir()] == ["d.toml"]


@POSIX_ONLY
@pytest.mark.parametrize("kind", WRITERS)
def test_a_file_that_cannot_be_finished_is_the_old_one(kind, tmp_path, monkeypatch):
    """The last call before the new file takes its place fails once: a full disk often says so only there."""
    name, write = WRITERS[kind]
    target = tmp_path / name
    target.write_text("the old file", encoding="utf-8")

    def full(_handle):
        raise OSError(errno.ENOSPC, "No space left on device")

    with monkeypatch.context() as patched:
        patched.setattr(os, "fsync", full)
        with pytest.raises((OSError, tsm.TsmError), match=r"(?i)no space left on device") as caught:
            write(target)
    assert name in str(caught.value)
    assert target.read_text(encoding="utf-8") == "the old file"
    assert [path.name for path in tmp_path.iterdir()] == [name]
    write(target)
    assert target.stat().st_size > 100


@pytest.mark.parametrize("kind", [*WRITERS, "run as svg", "run as pdf", "run as png"])
def test_the_same_written_later_is_the_same_file(kind, tmp_path, monkeypatch):
    if kind.startswith("run"):
        pytest.importorskip("matplotlib")
        figure = tsm.simulate(tsm.load("fig09b_feedforward"), stop=0.05).plot()
        name, write = f"run.{kind[-3:]}", lambda path: replace_figure(path, figure, dpi=60)
    else:
        name, write = WRITERS[kind]
    made = []
    for at in (1e9, 1.5e9):
        with monkeypatch.context() as patched:
            patched.setattr(time, "time", lambda at=at: at)
            patched.setattr(time, "localtime", lambda *_, at=at: time.gmtime(at))
            patched.setattr(time, "asctime", lambda *_, at=at: f"at {at}")
            write(tmp_path / name)
        made.append((tmp_path / name).read_bytes())
        time.sleep(1.01 if kind == "run as pdf" else 0.0)  # the library asks the system
    assert made[0] == made[1]


@POSIX_ONLY
def test_links_stay_links_and_new_files_have_the_usual_mode(tmp_path):
    (tmp_path / "far").mkdir()
    real, link = tmp_path / "far" / "real.txt", tmp_path / "link.txt"
    link.symlink_to(real)
    replace_file(link, "one")
    assert link.is_symlink()
    assert real.read_text(encoding="utf-8") == "one"
    plain = tmp_path / "plain.txt"
    plain.write_text("", encoding="utf-8")
    assert stat.S_IMODE(real.stat().st_mode) == stat.S_IMODE(plain.stat().st_mode)
    real.chmod(0o640)
    replace_file(link, "two")
    assert stat.S_IMODE(real.stat().st_mode) == 0o640


@POSIX_ONLY
def test_a_file_that_is_protected_stays():
    """The folder alone would allow to replace it."""
    with tempfile.TemporaryDirectory() as folder:
        os.chmod(folder, 0o777)
        target = Path(folder) / "baseline.toml"
        target.write_text("mine", encoding="utf-8")
        target.chmod(0o444)
        root = os.getuid() == 0  # who may write to everything
        if root:
            os.setresuid(65534, 65534, 0)
        try:
            with pytest.raises(PermissionError) as caught:
                replace_file(target, "text")
        finally:
            if root:
                os.setresuid(0, 0, 0)
        assert caught.value.filename == str(target)
        assert target.read_text(encoding="utf-8") == "mine"
        assert [path.name for path in Path(folder).iterdir()] == ["baseline.toml"]


def test_a_file_system_without_permissions_is_written_to(tmp_path, monkeypatch):
    def refused(*_, **__):
        raise PermissionError(errno.EPERM, os.strerror(errno.EPERM))

    monkeypatch.setattr(os, "chmod", refused)
    for text in ("one", "two"):
        replace_file(tmp_path / "d.toml", text)
        assert (tmp_path / "d.toml").read_text(encoding="utf-8") == text


@POSIX_ONLY
def test_the_name_lasts_as_the_content_does(tmp_path, monkeypatch):
    """The folder is synchronised too, after the file is in its place; a folder that cannot be makes no error."""
    synchronised, real = [], os.fsync

    def noted(handle):
        synchronised.append((stat.S_ISDIR(os.fstat(handle).st_mode), (tmp_path / "d.toml").exists()))
        if synchronised[-1][0]:
            raise OSError(errno.EINVAL, os.strerror(errno.EINVAL))
        real(handle)

    monkeypatch.setattr(os, "fsync", noted)
    replace_file(tmp_path / "d.toml", "text")
    assert synchronised == [(False, False), (True, True)]


@POSIX_ONLY
def test_what_is_planted_under_names_that_can_be_guessed_is_not_written_to(tmp_path):
    victim, target = tmp_path / "victim", tmp_path / "d.toml"
    victim.write_text("mine", encoding="utf-8")
    for name in (f".d.toml.{os.getpid()}.new", ".d.toml.new", "d.toml.tmp"):
        (tmp_path / name).symlink_to(victim)
    replace_file(target, "text")
    assert victim.read_text(encoding="utf-8") == "mine"
    assert not target.is_symlink()


@POSIX_ONLY
def test_devices_and_pipes_are_written_to(tmp_path):
    replace_file("/dev/null", "text")
    assert stat.S_ISCHR(os.stat("/dev/null").st_mode)
    pipe, got = tmp_path / "pipe", []
    os.mkfifo(pipe)
    reader = threading.Thread(target=lambda: got.append(pipe.read_text(encoding="utf-8")))
    reader.start()
    replace_file(pipe, "text")
    reader.join()
    assert got == ["text"]


def test_the_error_names_the_target(tmp_path):
    for target in (tmp_path, tmp_path / "none" / "d.txt"):
        with pytest.raises(OSError) as caught:
            replace_file(target, "text")
        assert caught.value.filename == str(target)


def test_a_name_as_long_as_systems_allow(tmp_path):
    target = tmp_path / ("n" * 255)
    replace_file(target, "text")
    assert target.read_text(encoding="utf-8") == "text"


def test_what_the_writer_raises_leaves_no_file(tmp_path):
    def write():
        with replacing(tmp_path / "d.txt") as file:
            file.write(b"half")
            raise KeyboardInterrupt

    with pytest.raises(KeyboardInterrupt):
        write()
    assert not list(tmp_path.iterdir())


ALLOWED = {
    "common/atomic_write.py",
    "engine/code_cache.py",
    "plots/notebook.py",  # into memory
    "reference/hand_written.py",  # a temporary folder, where the code of a page runs
    "reference/accessible.py",  # the pages that Sphinx wrote
    "reference/site.py",  # a folder of its own, which Sphinx reads
    "studies/store.py",  # rows are added as runs end
    "testing/reader_checks.py",  # spoilt copies in a temporary folder
}
"""Modules that open files for writing themselves."""


def test_no_other_module_writes_a_file_by_itself():
    found = set()
    for path in SOURCE.rglob("*.py"):
        for node in ast.walk(ast.parse(path.read_text(encoding="utf-8"))):
            if not (isinstance(node, ast.Call) and isinstance(node.func, ast.Attribute | ast.Name)):
                continue
            name = node.func.attr if isinstance(node.func, ast.Attribute) else node.func.id
            modes = [arg.value for arg in node.args if isinstance(arg, ast.Constant)]
            nowhere = isinstance(node.func, ast.Attribute) and ast.unparse(node.func.value) == "Path(os.devnull)"
            opened = name == "open" and not nowhere and any(str(mode)[:1] in "wax" for mode in modes)
            if opened or name in ("write_text", "write_bytes", "savefig"):
                found.add(path.relative_to(SOURCE).as_posix())
    assert found <= ALLOWED
    assert "common/atomic_write.py" in found
    assert atomic_write.NAME_CHARACTERS < 100
