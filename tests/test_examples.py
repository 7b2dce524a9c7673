"""Every example runs from top to bottom, without warnings, and prints what it answers."""

import re
import runpy
from pathlib import Path

import pytest

EXAMPLES = sorted((Path(__file__).parents[1] / "examples").glob("[0-9]*.py"))
ANSWERS = {
    "01_feedforward": [28.3, 13.7],
    "02_why_not_zero": [13.0, 0.8],
    "03_observer_on_the_motor": [13.7, 2.7, 6.5, 0.5],
    "04_sampled_controller": [1.02, 1.03, 1.05, 1.09],
    "05_a_block_of_your_own": [1.5],
}


@pytest.mark.parametrize("path", EXAMPLES, ids=lambda p: p.stem)
def test_example(path, capsys):
    before = dict(__import__("tsmblocks").block.__globals__["REGISTRY"])
    runpy.run_path(str(path))
    registry = __import__("tsmblocks").block.__globals__["REGISTRY"]
    for name in set(registry) - set(before):
        del registry[name]  # an example's own block is no block of the package
    printed = [float(x) for x in re.findall(r"(?<![\w.])\d+\.\d+", capsys.readouterr().out)]
    assert printed == pytest.approx(ANSWERS[path.stem], abs=0.06)


def test_every_example_has_its_answer():
    assert {p.stem for p in EXAMPLES} == set(ANSWERS)
