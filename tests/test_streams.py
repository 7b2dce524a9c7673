"""Streams that are full or closed, and full memory: one message at most, the right exit status, no traceback."""

import os
import subprocess
import sys
from pathlib import Path

import pytest

from tsmblocks.cli import entry

pytestmark = pytest.mark.skipif(not os.path.exists("/dev/full"), reason="needs /dev/full of Linux")
REPOSITORY = Path(__file__).parents[1]
FULL = "tsmblocks: standard output: No space left on device.\n"
RUN = "run fig09b_feedforward --stop 0.01 --json"


def shell(words, folder, **more):
    env = os.environ | {"PYTHONPATH": str(REPOSITORY), "PYTHONUNBUFFERED": "", **more}
    line = f"{sys.executable} -m tsmblocks {words}"
    return subprocess.run(["sh", "-c", line], cwd=folder, env=env, capture_output=True, text=True, check=False)


@pytest.mark.parametrize("unbuffered", ["", "1"])
@pytest.mark.parametrize("command", ["blocks", RUN])
def test_full_output_is_one_message_that_names_it(command, unbuffered, tmp_path):
    done = shell(f"{command} > /dev/full", tmp_path, PYTHONUNBUFFERED=unbuffered)
    assert (done.returncode, done.stderr) == (2, FULL)


def test_after_another_error_nothing_is_said_of_full_output(tmp_path):
    """What was printed before the error is not written at the end of the process, either."""
    (tmp_path / "wrong.toml").write_text("format = 2", encoding="utf-8")
    done = shell("check motor_linear wrong.toml > /dev/full", tmp_path)
    assert done.returncode != 0
    assert "Exception ignored" not in done.stderr
    assert "No space left" not in done.stderr
    assert "wrong.toml:1: the format is 2" in done.stderr


@pytest.mark.parametrize("where", ["2> /dev/full", "2>&-"])
def test_errors_that_cannot_be_shown_keep_their_status(where, tmp_path):
    assert shell(f"nonsense {where}", tmp_path).returncode == 2
    assert shell(f"blocks {where} > blocks.txt", tmp_path).returncode == 0
    assert (tmp_path / "blocks.txt").stat().st_size > 1000


def test_output_that_is_closed_leads_nowhere(tmp_path):
    """The file of results does not get its number: what is printed would be in it."""
    done = shell(f"{RUN} --out run.csv >&-", tmp_path)
    assert (done.returncode, done.stderr) == (0, "")
    assert (tmp_path / "run.csv").read_text(encoding="utf-8").startswith("t [s],")


@pytest.mark.parametrize("text", ["", "Unable to allocate 7.45 GiB for an array with shape (1000000000,)"])
def test_no_memory_is_one_message(text, monkeypatch, capsys):
    def full(_args):
        raise MemoryError(*([text] if text else []))

    monkeypatch.setattr(entry.COMMANDS["blocks"], "execute", full)
    assert entry.main(["blocks"]) == 2
    assert capsys.readouterr().err == f"tsmblocks: there is not enough memory{text and ': '}{text}.\n"


def test_a_reader_that_has_enough_ends_the_command(tmp_path):
    done = shell("blocks | head -n 1", tmp_path)
    assert done.stderr == ""
