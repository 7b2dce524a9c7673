"""Files that may not grow, a home that is read-only, another process at the same work, a clock that goes back."""

import os
import random
import signal
import subprocess
import sys
import time
from pathlib import Path

import numpy as np
import pytest

from tsmblocks.common.errors import DataError
from tsmblocks.studies.store import Store

REPOSITORY = Path(__file__).parents[2]
POSIX_ONLY = pytest.mark.skipif(sys.platform == "win32", reason="limits and signals of POSIX")
STUDY = (
    "format = 1\ndiagram = 'fig09b_feedforward'\nstop = 0.2\nstep = 0.001\n[vary]\n"
    "theta = {{ low = 2.0, high = 12.0, count = {} }}\n[metrics]\nerror = 'rms(x_ref - x_out)'\n"
)
LIMITED = """
import resource, sys
resource.setrlimit(resource.RLIMIT_FSIZE, ({0}, {0}))
from tsmblocks.cli import main
sys.exit(main())
"""
BACK = """
import itertools, sys, time
steps = itertools.count()
time.time = lambda: 2e9 - 86400.0 * next(steps)
from tsmblocks.cli import main
sys.exit(main())
"""
"""The command where each look at the clock finds it set back by a day."""


def started(words, folder, code="", **more):
    env = {k: v for k, v in os.environ.items() if k not in ("HOME", *more)}
    env |= {"PYTHONPATH": str(REPOSITORY), **{k: v for k, v in more.items() if v is not None}}
    command = [sys.executable, *(["-c", code] if code else ["-m", "tsmblocks"]), *words]
    pipe = subprocess.PIPE
    return subprocess.Popen(command, cwd=folder, env=env, stdout=pipe, stderr=pipe, text=True)


def done(words, folder, code="", **more):
    process = started(words, folder, code, **more)
    printed, said = process.communicate(timeout=120)
    return process.returncode, printed, said


@pytest.fixture(scope="module")
def whole(tmp_path_factory):
    """Results of a study of 200 runs."""
    folder = tmp_path_factory.mktemp("whole")
    (folder / "study.toml").write_text(STUDY.format(200), encoding="utf-8")
    assert done(WITH_STUDY, folder)[0] == 0
    return (folder / "gains.csv").read_bytes()


@pytest.fixture
def here(tmp_path):
    """A folder with the study."""
    (tmp_path / "study.toml").write_text(STUDY.format(200), encoding="utf-8")
    return tmp_path


WITH_STUDY = ["study", "study.toml", "--out", "gains.csv"]


@POSIX_ONLY
@pytest.mark.parametrize(
    "words",
    [["run", "fig09b_feedforward", "--stop", "0.5", "--out", "a.csv"], ["export", "eq11_compensator", "--out", "a.c"]],
)
def test_a_file_that_may_not_grow_is_the_old_one(words, tmp_path):
    (tmp_path / words[-1]).write_text("the old file", encoding="utf-8")
    status, _, said = done(words, tmp_path, LIMITED.format(1000))
    assert (status, said) == (2, f"tsmblocks: {said.split()[1]} File too large.\n")
    assert said.split()[1] in ("a.csv:", "a.h:")
    assert [(path.name, path.read_text(encoding="utf-8")) for path in tmp_path.iterdir()] == [
        (words[-1], "the old file")
    ]


@POSIX_ONLY
def test_a_study_that_found_no_room_goes_on_where_there_is(here, whole):
    status, _, said = done(WITH_STUDY, here, LIMITED.format(len(whole) // 2))
    assert (status, said.count("tsmblocks: "), "File too large" in said) == (2, 1, True)
    assert whole.startswith((here / "gains.csv").read_bytes()[:200])
    assert done(WITH_STUDY, here)[0] == 0
    assert (here / "gains.csv").read_bytes() == whole


@pytest.mark.skipif(not os.path.isdir("/proc/self"), reason="needs /proc, in which nothing can be made")
@pytest.mark.parametrize("home", ["/proc", None])
def test_a_home_that_is_read_only_or_missing_changes_nothing(home, here, whole):
    assert done(WITH_STUDY, here, HOME=home, XDG_CACHE_HOME=None, TSMBLOCKS_CACHE=None)[0] == 0
    assert (here / "gains.csv").read_bytes() == whole


def test_two_processes_at_one_study_end_with_the_same_file(here, whole):
    both = [started(WITH_STUDY, here) for _ in range(2)]
    ends = [process.communicate(timeout=120) for process in both]
    assert [process.returncode for process in both] == [0, 0], ends
    assert (here / "gains.csv").read_bytes() == whole
    assert sorted(path.name for path in here.iterdir()) == ["gains.csv", "gains.study.json", "study.toml"]


@POSIX_ONLY
def test_one_of_two_processes_is_killed(here, whole):
    first, second = started(WITH_STUDY, here), started(WITH_STUDY, here)
    while first.poll() is None and not (here / "gains.csv").exists():
        time.sleep(0.005)
    first.send_signal(signal.SIGKILL)
    for process in (first, second):
        process.communicate(timeout=120)
    assert second.returncode == 0
    assert (here / "gains.csv").read_bytes() == whole


def test_a_clock_that_goes_back_changes_nothing(here, whole):
    for _ in range(2):  # the second finds machine code that seems to be of the future
        (here / "gains.csv").unlink(missing_ok=True)
        assert done(WITH_STUDY, here, BACK, TSMBLOCKS_CACHE=str(here / "cache"))[0] == 0
        assert (here / "gains.csv").read_bytes() == whole


# ---- any order of what two processes do, of which each may be killed while it writes a row

RUNS = 30
THETA = np.round(np.linspace(2.0, 12.0, RUNS), 6)


class Writer:
    """One of the processes: it begins, adds rows in an order of its own, and puts them in order at the end."""

    def __init__(self, path, rng):
        facts = {"format": 1, "runs": RUNS, "plan": "a", "title": "any"}
        self.store, self.rng = Store(path, facts, ("run", "theta", "error"), (THETA,)), rng
        self.store.begin()

    def add(self):
        missing = [k for k in range(RUNS) if k not in self.store.done]
        runs = self.rng.sample(missing, min(len(missing), self.rng.randint(1, 4)))
        self.store.add(runs, (THETA[runs], np.sqrt(THETA[runs])))
        if len(self.store.done) == RUNS:
            self.store.finish()
        return len(self.store.done) < RUNS

    def killed(self):
        """Add a row of which a part reaches the file."""
        missing = [k for k in range(RUNS) if k not in self.store.done]
        if missing:
            path, size = self.store.path, self.store.path.stat().st_size
            self.store.add(missing[:1], (THETA[missing[:1]], np.sqrt(THETA[missing[:1]])))
            os.truncate(path, self.rng.randint(size, path.stat().st_size))


def test_any_order_of_two_writers_gives_the_right_rows_or_is_refused(tmp_path):
    path, refused = tmp_path / "gains.csv", []
    complete(path, random.Random(0))
    right = path.read_bytes()
    for seed in range(80):
        rng = random.Random(seed)
        path.unlink()
        try:
            attacked(path, rng)
            complete(path, rng)
        except DataError as error:
            refused.append(str(error))
            path.write_bytes(right)
        assert path.read_bytes() == right
    assert all(str(path) in text for text in refused)
    assert len(refused) < 40


def complete(path, rng):
    """Let one process do all that is missing."""
    writer = Writer(path, rng)
    while writer.add():
        pass


def attacked(path, rng):
    """Let two processes work at once, which are killed and begun again."""
    writers = [None, None]
    for _ in range(rng.randint(4, 16)):
        k = rng.randrange(2)
        if writers[k] is None:
            writers[k] = Writer(path, rng)
        elif rng.random() < 0.25:
            writers[k].killed()
            writers[k] = None
        elif not writers[k].add():
            writers[k] = None
