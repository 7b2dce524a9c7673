"""Some of the faults in each run, drawn with one seed; ``python -m tests.faults`` tries all of them."""

import json
import os
import subprocess
import sys
from pathlib import Path

import pytest

from tests.faults.inject import can_run
from tests.faults.scenarios import TORN

pytestmark = pytest.mark.skipif(not can_run(), reason="needs Linux and a C compiler")
REPOSITORY = Path(__file__).parents[2]
SEED = 1


def injected(*words):
    env = os.environ | {"PYTHONPATH": str(REPOSITORY)}
    command = [sys.executable, "-m", "tests.faults", "--json", "--seed", str(SEED), *words]
    done = subprocess.run(command, cwd=REPOSITORY, env=env, capture_output=True, text=True, check=False, timeout=300)
    assert done.stderr == ""
    return [json.loads(line) for line in done.stdout.splitlines()]


@pytest.mark.parametrize(
    ("most", "names"),
    [(12, ["save", "study", "study again", "machine code"]), (6, ["records", "export c", "read npz", "check"])],
)
def test_a_call_that_fails_leaves_the_old_or_the_new_and_one_message(most, names):
    found = injected("--most", str(most), *names)
    assert [one["scenario"] for one in found] == names
    assert [one["faults"] for one in found] == [{}] * len(names)
    assert all(one["trials"] >= most and one["survived"] for one in found)
    assert any(one["refused"] for one in found)


def test_a_study_that_is_killed_goes_on():
    (found,) = injected("--kill", "6", "study")
    assert (found["killed"], found["faults"]) == (6, {})


def test_a_file_that_is_written_in_place_is_found():
    (found,) = injected(TORN)
    assert {"neither old nor new: torn.txt"} <= set(found["faults"])
    assert found["calls"] >= 4
