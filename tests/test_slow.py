"""Slow tests are due where something that they depend on has changed, and nowhere else."""

from pathlib import Path

import pytest

from tests import slow


@pytest.fixture
def tree(tmp_path, monkeypatch):
    """A project of three packages, one of which imports another, and a file of slow tests with a helper."""
    texts = {
        "tsmblocks/low/a.py": '"""Low."""\n\n\ndef one():\n    """One."""\n    return 1\n',
        "tsmblocks/high/b.py": "def two():\n    from tsmblocks.low.a import one\n\n    return 2 * one()\n",
        "tsmblocks/apart/c.py": "THREE = 3\n",
        "tests/helper.py": "FOUR = 4\n",
        "tests/test_it.py": "from tests.helper import FOUR\n\nSLOW_NEEDS = ['high', 'examples/1_*']\n",
        "tests/test_quick.py": "FIVE = 5\n",
        "examples/1_first.py": "print(1)\n",
        "examples/2_second.py": "print(2)\n",
    }
    for name, text in texts.items():
        (tmp_path / name).parent.mkdir(parents=True, exist_ok=True)
        (tmp_path / name).write_text(text, "utf-8")
    monkeypatch.setattr(slow, "ROOT", tmp_path)
    monkeypatch.setattr(slow, "STAMPS", tmp_path / "tests" / "slow.txt")

    def changed(name, old="", new=""):
        if name:
            path = tmp_path / name
            path.write_text(path.read_text("utf-8").replace(old, new), "utf-8")
        forget()
        return slow.due()

    assert changed("") == ["tests/test_it.py"]
    slow.write({path: slow.digest(path) for path in slow.due()})
    assert changed("") == []
    yield changed
    forget()


def forget():
    for each in (slow._closure, slow._imports, slow._content):
        each.cache_clear()


@pytest.mark.parametrize(
    ("name", "old", "new"),
    [
        ("tsmblocks/high/b.py", "2 *", "3 *"),
        ("tsmblocks/low/a.py", "return 1", "return 2"),
        ("tests/helper.py", "= 4", "= 5"),
        ("tests/test_it.py", "FOUR", "FOUR as four"),
        ("examples/1_first.py", "print(1)", "print(2)"),
    ],
)
def test_what_they_depend_on_makes_them_due(tree, name, old, new):
    assert tree(name, old, new) == ["tests/test_it.py"]
    assert tree(name, new, old) == []


@pytest.mark.parametrize(
    ("name", "old", "new"),
    [
        ("tsmblocks/low/a.py", "One.", "The number one.\n\n    It is odd.\n    "),
        ("tsmblocks/low/a.py", "return 1", "return 1  # the first\n\n# more"),
        ("tsmblocks/apart/c.py", "3", "4"),
        ("tests/test_quick.py", "5", "6"),
        ("examples/2_second.py", "2", "3"),
    ],
)
def test_nothing_else_does(tree, name, old, new):
    assert tree(name, old, new) == []


def test_a_need_that_is_neither_package_nor_file_is_an_error(tree):
    with pytest.raises(SystemExit, match="SLOW_NEEDS names 'hihg', which is neither a package of tsmblocks nor a file"):
        tree("tests/test_it.py", "'high'", "'hihg'")


def test_every_file_with_slow_tests_says_what_they_need():
    marked = [
        path.relative_to(slow.ROOT).as_posix()
        for path in (slow.ROOT / "tests").rglob("test_*.py")
        if "pytest.mark.slow" in path.read_text("utf-8") and path != Path(__file__)
    ]
    assert sorted(marked) == slow.with_slow_tests()
    named = {need for path in marked for need in slow.needs(slow.ROOT / path)}
    assert all((slow.ROOT / "tsmblocks" / need).is_dir() or [*slow.ROOT.glob(need)] for need in named)
