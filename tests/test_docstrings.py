"""Public docstrings follow numpydoc: every argument with its type and meaning, what is returned and raised."""

import doctest
import inspect
from importlib import import_module

import pytest
from numpydoc.validate import validate

import tsmblocks

ROOMS = ("analysis", "effects", "errors", "export", "studies", "testing", "tuning")
"""Packages of which all names are public; blocks declare what is known of their parameters."""
CHECKED = {
    "GL05", "GL06", "GL07", "GL08", "GL10",  # sections: tabs, unknown, out of order, none at all, wrong underlines
    "SS01", "SS03",  # a summary that ends in a period
    "PR01", "PR02", "PR03", "PR04", "PR05", "PR07", "PR09", "PR10",  # each argument, in order, with type and words
    "RT01", "RT03", "RT05", "YD01",  # what is returned, in words
}  # fmt: skip


def home(thing):
    return f"{thing.__module__}.{thing.__qualname__}"


def public():
    """Every public function and class, with the public methods of each class, by its full name."""
    found = {name: getattr(tsmblocks, name) for name in tsmblocks.__all__}
    for room in ROOMS:
        module = import_module(f"tsmblocks.{room}")
        names = getattr(module, "__all__", None) or [k for k in vars(module) if not k.startswith("_")]
        found |= {f"{room}.{name}": getattr(module, name) for name in names}
    things = {}
    for thing in found.values():
        if not callable(thing) or not getattr(thing, "__module__", "").startswith("tsmblocks"):
            continue
        things[home(thing)] = thing
        if inspect.isclass(thing) and not issubclass(thing, Exception):
            for name, part in vars(thing).items():
                if not name.startswith("_") and inspect.isfunction(part):
                    things[f"{home(thing)}.{name}"] = part
    return things


PUBLIC = public()


@pytest.mark.parametrize("name", sorted(PUBLIC))
def test_the_docstring_follows_numpydoc(name):
    wrong = [f"{code}: {text}" for code, text in validate(name)["errors"] if code in CHECKED]
    assert wrong == []


TOP = sorted(home(t) for n in tsmblocks.__all__ if inspect.isfunction(t := getattr(tsmblocks, n)))


@pytest.mark.parametrize("name", TOP)
def test_what_users_call_first_has_an_example(name):
    assert ">>>" in inspect.getdoc(PUBLIC[name]) or "Examples\n--------" in inspect.getdoc(PUBLIC[name])


@pytest.mark.parametrize(
    "name", sorted(name for name, thing in PUBLIC.items() if ">>>" in (inspect.getdoc(thing) or ""))
)
def test_examples_are_complete_and_print_what_they_show(name, tmp_path, monkeypatch):
    monkeypatch.chdir(tmp_path)  # what an example writes stays out of the tree
    thing, printed = PUBLIC[name], []
    example = doctest.DocTestParser().get_doctest(inspect.getdoc(thing), {}, name, None, 0)
    runner = doctest.DocTestRunner(verbose=False)
    runner.run(example, out=printed.append)
    assert runner.failures == 0, "".join(printed)
