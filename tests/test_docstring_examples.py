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
def test_the_example_prints_what_it_shows(name):
    told = []
    doctest.DocTestRunner(verbose=False).run(EXAMPLES[name], out=told.append)
    assert told == []
