"""Scenarios with one call failing: counted first, then run again for each call and each way in which it can fail.

A trial is a forked child of this process, in which ``shim.c`` is loaded; so modules are imported only once.
"""

from __future__ import annotations

import ctypes
import os
import random
import re
import shutil
import signal
import subprocess
import sys
import tempfile
import time
from collections import Counter
from collections.abc import Iterator, Sequence
from pathlib import Path

import attrs

from tests.faults.scenarios import OLD, SCENARIOS, Scenario
from tests.faults.trials import KILLED, KILLED_HALFWAY, KINDS, Trial, trials_of

LIMIT = 60.0
"""Seconds after which a trial hangs. Chosen: all of them are a matter of a second."""
IN_MEMORY = "/dev/shm"
"""A file system in memory, where there is one: fsync costs nothing there."""
UNFINISHED = re.compile(r"\.new$|\.tmp$|^tmp")
"""Names of files that take the place of others when they are finished."""

_TRACEBACK = re.compile(r"(?m)Traceback|Exception ignored|^E   ")
"""A traceback of Python or of pytest."""


@attrs.define
class Result:
    """What came of the trials of one scenario."""

    calls: int = 0
    trials: int = 0
    refused: int = 0
    survived: int = 0
    killed: int = 0
    aborted: int = 0
    faults: dict[str, str] = attrs.field(factory=dict)
    """The first trial of each fault."""
    counts: Counter[str] = attrs.field(factory=Counter)


@attrs.frozen
class End:
    """How a run ended: exit status (None where it hung, negative after a signal), what it printed, and its files."""

    status: int | None
    printed: str
    said: str
    files: dict[str, bytes]
    calls: tuple[tuple[str, str], ...] = ()


# ---- the library


def build(folder: Path) -> Path:
    """Compile the library that is preloaded."""
    made = folder / "shim.so"
    compiler = next(path for name in ("cc", "gcc", "clang") if (path := shutil.which(name)))
    source = Path(__file__).with_name("shim.c")
    subprocess.run([compiler, "-shared", "-fPIC", "-O1", "-o", str(made), str(source), "-ldl"], check=True)
    return made


def can_run() -> bool:
    """Whether this system preloads libraries, and has a compiler."""
    return sys.platform == "linux" and any(map(shutil.which, ("cc", "gcc", "clang")))


def _library() -> ctypes.CDLL:
    library = ctypes.CDLL(None)
    library.faults_name.restype = ctypes.c_char_p
    library.faults_calls.restype = ctypes.c_long
    library.faults_arm.argtypes = (ctypes.c_char_p, ctypes.c_long, ctypes.c_int, ctypes.c_int, ctypes.c_uint)
    return library


# ---- one run


@attrs.frozen
class Bench:
    """A scenario with the folder from which each of its runs begins."""

    scenario: Scenario
    folder: Path

    def ran(self, trial: Trial | None, again_in: Path | None = None) -> tuple[End, Path]:
        """Run in a fresh copy of the folder, or again in one; returns the end and the folder."""
        place = again_in or Path(tempfile.mkdtemp(prefix="run-", dir=self.folder.parent))
        root = place / "root"
        if not again_in:
            shutil.copytree(self.folder, root, symlinks=True)
        with tempfile.TemporaryFile() as printed, tempfile.TemporaryFile() as said:
            shown = place / "calls"
            child = os.fork()
            if child == 0:
                os.setpgid(0, 0)
                self._child(root, trial, printed.fileno(), said.fileno(), shown)
            status = _waited(child, float(trial.name[:-2]) if trial and trial.kind == "instant" else LIMIT)
            texts = []
            for file in (printed, said):
                file.seek(0)
                texts.append(file.read().decode(errors="replace").replace(str(root), "."))
        lines = shown.read_text(encoding="utf-8").splitlines() if shown.exists() else []
        calls = tuple((kind, name) for kind, _, name in (line.partition(" ") for line in lines))
        unfinished = {
            k: v for part in ("cache", "home") for k, v in _files(root / part).items() if UNFINISHED.search(k)
        }
        return End(status, *texts, {**_files(root / "work"), **unfinished}, calls), place

    def _child(self, root: Path, trial: Trial | None, printed: int, said: int, shown: Path) -> None:
        """Run the scenario, and never return."""
        status = 99
        try:
            os.chdir(root / "work")
            os.dup2(printed, 1)
            os.dup2(said, 2)
            sys.stdout, sys.stderr = (os.fdopen(k, "w", encoding="utf-8", closefd=False) for k in (1, 2))
            os.environ |= {"HOME": str(root / "home"), "XDG_CACHE_HOME": str(root / "home/.cache")}
            os.environ["TSMBLOCKS_CACHE"] = str(root / "cache")
            library = _library()
            if self.scenario.prints:
                library.faults_watch(1)
            library.faults_arm(str(root).encode(), *(trial.wanted if trial else (0, 0, 0, 0)))
            try:
                status = self.scenario.run()
                sys.stdout.flush()
            except OSError:  # as Python does at the end of a process
                status = 120
            finally:
                library.faults_disarm()
            if trial is None:
                numbers = range(1, library.faults_calls() + 1)
                lines = [f"{KINDS[library.faults_kind(k)]} {library.faults_name(k).decode()}" for k in numbers]
                shown.write_text("\n".join(lines), encoding="utf-8")
        except BaseException:
            import traceback

            traceback.print_exc(file=sys.stderr)
        finally:
            sys.stderr.flush()
            os._exit(status)


def _waited(child: int, limit: float) -> int | None:
    """The exit status of a child, which is killed when its time is over; None where it hangs."""
    until = time.monotonic() + limit
    while time.monotonic() < until:
        done, status = os.waitpid(child, os.WNOHANG)
        if done:
            return os.waitstatus_to_exitcode(status)
        time.sleep(0.002)
    os.kill(child, signal.SIGKILL)
    os.waitpid(child, 0)
    return None if limit == LIMIT else -signal.SIGKILL


def _files(folder: Path) -> dict[str, bytes]:
    return {
        path.relative_to(folder).as_posix(): path.read_bytes()
        for path in sorted(folder.rglob("*"))
        if path.is_file() and "__pycache__" not in path.parts
    }


# ---- what must hold


def faults_of(scenario: Scenario, trial: Trial, end: End, before: dict[str, bytes], good: End) -> Iterator[str]:
    """What is wrong with the end of a trial."""
    if end.status is None:
        yield "hang"
        return
    if trial.error not in (KILLED, KILLED_HALFWAY):
        yield from _wrong_end(scenario, end, good)
    yield from _wrong_files(trial, end, before, good)


def _wrong_end(scenario: Scenario, end: End, good: End) -> Iterator[str]:
    """What is wrong with the exit status and with what was printed."""
    extra = [line for line in _messages(end.said) if line not in _messages(good.said)]
    if _TRACEBACK.search(end.printed + end.said):
        yield "traceback"
    elif end.status not in (scenario.ends, *scenario.refused):
        yield f"exit status {end.status}"
    elif end.status == 0 and extra:
        yield "a message, and exit status 0"
    elif end.status and scenario.prints and len(extra) != 1:
        yield f"{len(extra)} messages"
    if ".new" in end.said:
        yield "a message that names a temporary file"
    if scenario.tolerated and (end.status, end.printed) != (0, good.printed):
        yield "not survived, or another result"


def _messages(text: str) -> list[str]:
    return [line for line in text.splitlines() if line.startswith("tsmblocks: ")]


def _wrong_files(trial: Trial, end: End, before: dict[str, bytes], good: End) -> Iterator[str]:
    after = good.files
    for name in sorted({*before, *after, *end.files}):
        content = end.files.get(name)
        if name not in before and name not in after and not _is_partial_study(name, content, after):
            killed = trial.error < 0 and UNFINISHED.search(name)  # nobody is left to delete it
            if trial.kind != "unlink" and trial.lasting != "gone" and not killed:
                yield f"left behind: {'a temporary file' if UNFINISHED.search(name) else name}"
        elif content not in (before.get(name), after.get(name)) and not _is_partial_study(name, content, after):
            yield f"neither old nor new: {name}{' (lost)' if content is None else ''}"
        elif end.status == 0 and content != after.get(name):
            yield f"exit status 0, and not written: {name}"


def _is_partial_study(name: str, content: bytes | None, after: dict[str, bytes]) -> bool:
    """Whether it is a table of results with some of the rows: the study goes on from there."""
    whole = after.get(name, b"")
    if name != "gains.csv" or content is None:
        return False
    *rows, last = content.split(b"\n")
    lines = whole.split(b"\n")
    return all(row in lines for row in rows) and any(line.startswith(last) for line in lines)


# ---- all of them


def _bench_folder() -> tempfile.TemporaryDirectory[str]:
    return tempfile.TemporaryDirectory(prefix="faults-", dir=IN_MEMORY if Path(IN_MEMORY).is_dir() else None)


def inject(
    name: str, *, most: int | None = None, seed: int = 0, kinds: Sequence[str] = KINDS, mapped: int = 20
) -> Result:
    """Run the trials of a scenario: all, or ``most`` of them drawn with a seed; of mmap ``mapped`` calls at most."""
    scenario, result, rng = SCENARIOS[name], Result(), random.Random(f"{name} {seed}")
    with _bench_folder() as folder:
        for present in (True, False) if scenario.writes else (False,):
            bench = _prepared(scenario, Path(folder) / f"begin-{present}", present)
            before = _files(bench.folder / "work")
            good, _ = bench.ran(None)
            assert good.status == scenario.ends, f"{good.status}: {good.said}"
            trials = [one for one in trials_of(good.calls) if one.kind in kinds]
            maps = [one for one in trials if one.kind == "mmap"]
            dropped = set(maps) - set(rng.sample(maps, min(mapped, len(maps))))
            trials = [one for one in trials if one not in dropped]
            if most is not None:
                trials = sorted(rng.sample(trials, min(most, len(trials))))
            result.calls += len(good.calls)
            for trial in trials:
                _try(bench, trial, before, good, result)
    return result


def _try(bench: Bench, trial: Trial, before: dict[str, bytes], good: End, result: Result) -> None:
    """Run one trial, and where it left something between old and new, run again without a fault."""
    end, place = bench.ran(trial)
    result.trials += 1
    result.refused += end.status in bench.scenario.refused
    result.killed += trial.error < 0
    result.survived += end.status == bench.scenario.ends
    found = list(faults_of(bench.scenario, trial, end, before, good))
    if trial.kind == "mmap" and end.status == -signal.SIGABRT:  # no memory for the compiler: LLVM ends the process
        result.aborted += 1
        found = [one for one in found if not one.startswith("exit status")]
    if end.files not in (before, good.files) and end.status is not None:
        second, _ = bench.ran(None, again_in=place)
        left = {name for name in end.files if UNFINISHED.search(name)}
        if {k: v for k, v in second.files.items() if k not in left} != good.files or second.status != good.status:
            found.append("another result when run again")
    for one in found:
        result.counts[one] += 1
        result.faults.setdefault(one, f"{trial.words}\n    {end.said.strip()[-400:]}")
    shutil.rmtree(place, ignore_errors=True)


def kill(name: str, count: int, seed: int = 0) -> Result:
    """Kill a scenario at so many instants, spread over the time it takes, and run it again after each."""
    scenario, result, rng = SCENARIOS[name], Result(), random.Random(f"{name} {seed}")
    with _bench_folder() as folder:
        bench = _prepared(scenario, Path(folder) / "begin", bool(scenario.writes), keep=scenario.slow)
        before = _files(bench.folder / "work")
        good, _ = bench.ran(None)
        began = time.monotonic()
        bench.ran(None)
        took = time.monotonic() - began
        result.calls = len(good.calls)
        for k in range(count):
            trial = Trial(0, "instant", f"{(k + rng.random()) / count * took:.3f} s", KILLED)
            _try(bench, trial, before, good, result)
    return result


def _prepared(scenario: Scenario, folder: Path, present: bool, *, keep: bool = True) -> Bench:
    """The folder of a scenario, whose modules are imported after this; with ``present`` what it writes is there."""
    work = folder / "work"
    for part in (work, folder / "home", folder / "cache"):
        part.mkdir(parents=True, mode=0o700)
    here, streams = Path.cwd(), (sys.stdout, sys.stderr)
    saved = [os.dup(k) for k in (1, 2)]
    with open(os.devnull, "w", encoding="utf-8") as null, tempfile.TemporaryDirectory() as warm:
        for k in (1, 2):
            os.dup2(null.fileno(), k)
        sys.stdout = sys.stderr = null
        try:
            if keep:
                scenario.kept()
            for place in (Path(warm), work):
                os.chdir(place)
                scenario.prepare()
                if place != work:
                    scenario.run()
        finally:
            os.chdir(here)
            sys.stdout, sys.stderr = streams
            for k, one in enumerate(saved, start=1):
                os.dup2(one, k)
                os.close(one)
    for name in scenario.writes if present else ():
        (work / name).parent.mkdir(exist_ok=True)
        (work / name).write_text(OLD, encoding="utf-8")
    return Bench(scenario, folder)
