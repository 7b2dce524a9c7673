"""Everything the README shows is run, and prints what it says."""

import contextlib
import io
import math
import re
import sys
import textwrap
import types
from pathlib import Path

import pytest

import tsmblocks.blocks  # noqa: F401 - so that the registry is full before it is looked at
from tsmblocks.model.block import REGISTRY

ROOT = Path(__file__).parents[1]
README = ROOT / "README.md"
TEXT = README.read_text(encoding="utf-8")
DOCUMENTS = ("README.md", "CONTRIBUTING.md")
GUARD = ROOT / "tsmblocks" / "reference" / "pages" / "howto" / "guard.rst"
SHELL = re.findall(r"^tsmblocks (.*)$", TEXT, re.MULTILINE)


def text_of(name):
    return (ROOT / name).read_text(encoding="utf-8")


@pytest.fixture
def scope(monkeypatch):
    """A module to run a document in; blocks that it declares are gone after it."""
    module = types.ModuleType("document")
    monkeypatch.setitem(sys.modules, "document", module)
    before = set(REGISTRY)
    yield vars(module)
    for name in set(REGISTRY) - before:
        del REGISTRY[name]


@pytest.mark.parametrize("name", DOCUMENTS)
def test_code_prints_what_the_document_says(name, scope):
    shown = re.findall(r"```python\n(.*?)```(?:\n\n```\n(.*?)```)?", text_of(name), re.DOTALL)
    assert len(shown) >= 2
    for code, expected in shown:
        printed = io.StringIO()
        with contextlib.redirect_stdout(printed):
            exec(compile(code, name, "exec"), scope)
        assert printed.getvalue() == expected


@pytest.mark.parametrize("line", SHELL)
def test_commands_in_the_readme_run(line, tmp_path, monkeypatch, capsys):
    from tsmblocks.blocks import Gain
    from tsmblocks.cli import main
    from tsmblocks.files import save
    from tsmblocks.model.diagram import Diagram

    monkeypatch.chdir(tmp_path)
    save(
        Diagram(title="mine", blocks={"g": Gain()}, inputs={"u": "g.u"}, outputs={"y": "g"}), tmp_path / "my_loop.toml"
    )
    rows = [f"{k / 20},{50 * math.sin(k / 20):.3f},{40 * math.sin(k / 20 - 0.5):.3f}" for k in range(260)]
    (tmp_path / "sheath.csv").write_text("\n".join(["t [s], x_in [deg], x_out [deg]", *rows]))
    assert main(line.split()) == 0
    assert capsys.readouterr().out


@pytest.mark.parametrize("name", DOCUMENTS)
def test_pictures_links_and_files_exist(name):
    text = text_of(name)
    assert all((ROOT / picture).is_file() for picture in re.findall(r"!\[[^]]*\]\(([^)]+)\)", text))
    assert all((ROOT / link).exists() for link in re.findall(r"(?<!!)\[[^]]*\]\(([^)#]+)\)", text))
    named = re.findall(r"\b(?:examples|tests|tsmblocks|diagrams)/[\w/]*\.(?:py|toml|md)", text)
    named = [one for one in named if "NN" not in one]
    assert len(named) > 3
    assert [one for one in named if not (ROOT / one).is_file()] == []


def test_what_the_page_on_security_names_is_there():
    from tsmblocks.engine import code_cache

    text = text_of("SECURITY.md")
    sources = "".join(path.read_text("utf-8") for path in (ROOT / "tsmblocks").rglob("*.py"))
    assert all(name in sources for name in re.findall(r"`((?:TSMBLOCKS|XDG)_\w+)", text))
    assert f"/tsmblocks/{code_cache.FOLDER}`" in text
    assert (ROOT / "tests" / "fuzz" / "__main__.py").is_file()
    assert all("SECURITY.md" in text_of(name) for name in DOCUMENTS)


@pytest.mark.parametrize("name", DOCUMENTS)
def test_commands_named_in_passing_exist(name):
    from tsmblocks.cli.entry import COMMANDS

    named = set(re.findall(r"`tsmblocks ([a-z]+)", text_of(name)))
    assert named <= set(COMMANDS), named - set(COMMANDS)
    assert len(named) > 3 or name != "README.md"


def test_files_of_the_reading_orders_exist():
    """Three orders: from a diagram to machine code, how a fit works, how a diagnosis decides."""
    orders = text_of("CONTRIBUTING.md").partition("## Read the code")[2].partition("\n## ")[0].split("\n- ")[1:]
    named = [re.findall(r"`([\w/]+\.py)`", order) for order in orders]
    assert [len(files) <= most for files, most in zip(named, (8, 6, 5), strict=True)] == [True] * 3
    assert [one for files in named for one in files if not (ROOT / "tsmblocks" / one).is_file()] == []


def test_figures_of_the_peers_are_those_of_the_whole_run():
    def cells(line):
        return [cell.strip() for cell in line.strip("|").split("|")]

    whole = text_of("tests/benchmarks/README.md")
    printed = {
        cells(line)[0]: cells(line)
        for line in whole.splitlines()
        if line.startswith("| ") and re.search(r"\d+\.\d+\.\d+ +\|", line)
    }
    said = TEXT.partition("## Speed")[2].partition("\n## ")[0]
    for tool, figure in (("tsmblocks 0.1.0", "0.0834"), ("Archimedes 0.4.4", "5.00"), ("Drake 1.51.1", "15.6")):
        assert figure in printed[tool]
        assert f"{figure} µs" in " ".join(said.split())
        assert tool.removesuffix(" 0.1.0") in said
    for figure in ("10000 |     5.66", "1477 |", "16.8 |", "45.8 |", "5.51 |", "15.1 |"):
        assert figure in whole


def test_the_picture_is_what_the_command_draws():
    import tsmblocks as tsm

    drawn = tsm.to_svg(tsm.load("fig16_feedforward_feedback"))
    assert (README.parent / "examples" / "fig16.svg").read_text(encoding="utf-8").strip() == drawn.strip()


def test_what_a_guard_says_is_what_its_page_shows(tmp_path):
    from tsmblocks.testing.guards import read_guards
    from tsmblocks.testing.tracking import change_report, changes

    page = GUARD.read_text(encoding="utf-8")
    text = textwrap.dedent(page.partition(".. code-block:: toml\n\n")[2].partition("\n\n``")[0])
    path = tmp_path / "loop.tracking.toml"
    path.write_text(text)
    (before,) = read_guards(path).values()
    path.write_text(f'{text}\n[set]\n"pid.kp" = 1.53\n')
    (now,) = read_guards(path).values()
    runs = before.run(), now.run()
    said = change_report(changes(before, *runs), *runs)
    assert f".. code-block:: none\n\n{textwrap.indent(said, '   ')}\n" in page
