"""A bounded attack on every reader, the same in each run; ``python -m tests.fuzz`` goes on without end."""

import random

import pytest

from tests.fuzz.attack import attack
from tests.fuzz.mutation import mutated, reworded
from tests.fuzz.targets import NEEDS, TARGETS

INPUTS = {"command": 40, "diagram": 60, "mat": 80, "hdf5": 80}
"""Inputs by target where each takes longer than the others."""
SEED = 1


@pytest.mark.parametrize("name", TARGETS)
def test_nothing_but_refusals(name, tmp_path):
    for package in NEEDS.get(name, ()):
        pytest.importorskip(package)
    count = attack(name, tmp_path, SEED, inputs=INPUTS.get(name, 150))
    assert count.faults == {}
    assert count.refused > 0
    assert count.refused < count.inputs or name == "results"


def test_an_attack_can_be_repeated_and_sees_a_fault(tmp_path, monkeypatch):
    first, second = (attack("unit", tmp_path, 7, inputs=50) for _ in range(2))
    assert (first.inputs, first.refused) == (second.inputs, second.refused)
    broken = TARGETS["unit"].__class__(TARGETS["unit"].spoilt, lambda text: text.index("no such word"))
    monkeypatch.setitem(TARGETS, "unit", broken)
    count = attack("unit", tmp_path, 7, inputs=50)
    assert [place.split(":")[0] for place in count.faults] == ["ValueError in ?"]


def test_changes_depend_on_the_seed_alone():
    content = bytes(range(256)) * 4
    made = [[mutated(random.Random(k), content) for k in range(40)] for _ in range(2)]
    assert made[0] == made[1]
    assert all(one != content for one in made[0][:5])
    texts = [[reworded(random.Random(k), "a = rms(x - y)") for k in range(40)] for _ in range(2)]
    assert texts[0] == texts[1]
