"""The same arguments and the same seed give the same bytes: whatever the hash seed, the threads, the processes."""

import functools
import json
import os
import subprocess
import sys
from concurrent.futures import ThreadPoolExecutor
from pathlib import Path

import numpy as np
import pytest

import tsmblocks as tsm
from tsmblocks.common.one_thread import _libraries, on_one_thread

ROOT = Path(__file__).resolve().parents[1]
SLOW_NEEDS = ["cli", "demo", "reference", "html", "tests/determinism.py"]
PLAIN = {"PYTHONHASHSEED": "0", "OPENBLAS_NUM_THREADS": "1", "TSMBLOCKS_CACHE": "off"}
OTHER = {"PYTHONHASHSEED": "7", "OPENBLAS_NUM_THREADS": "2"}


def made(what, environment, workers):
    """Digests by file and result, made by another process."""
    done = subprocess.run(
        [sys.executable, str(ROOT / "tests" / "determinism.py"), what, str(workers)],
        env={**os.environ, "PYTHONPATH": str(ROOT), **environment},
        check=False,
        capture_output=True,
        text=True,
    )
    assert done.returncode == 0, done.stderr
    return json.loads(done.stdout)


def compared(what):
    with ThreadPoolExecutor(2) as pool:
        one, other = pool.map(functools.partial(made, what), (PLAIN, OTHER), (1, 2))
    assert one.keys() == other.keys()
    assert [key for key in one if one[key] != other[key]] == []
    return one


def test_fits_diagnoses_studies_code_and_pages():
    found = compared("quick")
    assert {"fit", "genetic", "diagnosis", "study", "study.csv", "run.csv", "code/loop.c", "loop.svg"} <= found.keys()
    assert {"report/report.html", "report/diagnosis.json"} <= found.keys()


@pytest.mark.slow
@pytest.mark.parametrize("what", ["demo", "reference"])
def test_the_demonstration_and_the_reference(what):
    assert len(compared(what)) > 10


def test_a_seed_decides():
    one, same, other = (tsm.studies.latin_hypercube({"theta": (4.0, 5.0)}, runs=5, seed=k)["theta"] for k in (1, 1, 2))
    assert one.tolist() == same.tolist() != other.tolist()


def test_linear_algebra_has_one_thread_in_a_call_and_its_own_afterwards():
    def threads():
        return [library["num_threads"] for library in _libraries().info()]

    with _libraries().limit(limits=2):
        before = threads()
        assert set(on_one_thread(threads)()) == {1}
        assert threads() == before
        with pytest.raises(ZeroDivisionError):
            on_one_thread(lambda: 1 / 0)()
        assert threads() == before


@pytest.mark.parametrize("call", [tsm.fit, tsm.diagnose])
def test_fits_and_diagnoses_run_on_one_thread(call):
    t = np.arange(400) * 0.02
    x = np.sin(t) + np.sin(2.3 * t)
    noise = 0.01 * np.random.default_rng(0).standard_normal(400)
    record = tsm.Record("bend", t, {"x_in": x, "x_out": 0.8 * x + noise}, {"x_in": "rad", "x_out": "rad"})
    seen = set()

    def progress(*_):
        seen.update(library["num_threads"] for library in _libraries().info())

    with _libraries().limit(limits=2):
        call(tsm.load("tendon_sheath_linear"), record, progress=progress)
    assert seen == {1}
