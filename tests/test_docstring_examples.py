"""Examples in docstrings run, and print what they show."""

import doctest

import pytest

from tests.test_docstrings import PUBLIC

ROOMS = ("simulation", "analysis", "optimal", "tuning")
"""Packages whose examples are complete programs."""
FINDER = doctest.DocTestFinder(recurse=False)
EXAMPLES = {
    name: test
    for name, thing in PUBLIC.items()
    if name.split(".")[1] in ROOMS
    for test in FINDER.find(thing, name, globs={})
    if test.examples
}


@pytest.mark.parametrize("name", sorted(EXAMPLES))
def test_the_example_prints_what_it_shows(name, tmp_path, monkeypatch):
    monkeypatch.chdir(tmp_path)  # what an example writes stays out of the tree
    failures = []
    doctest.DocTestRunner(verbose=False).run(EXAMPLES[name], out=failures.append)
    assert failures == []
