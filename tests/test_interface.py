"""The package as seen from outside: names, words, annotations, sizes, layers, and what importing it costs."""

import ast
import functools
import inspect
import itertools
import re
import subprocess
import sys
import tomllib
import zipfile
from importlib import import_module
from pathlib import Path

import pytest

import tsmblocks
from tests.mistakes.all import TABLE

SOURCE = Path(tsmblocks.__file__).parent
ROOT = SOURCE.parent
FILES = sorted(SOURCE.rglob("*.py"))
ROOMS = {room: list(paths) for room, paths in itertools.groupby(FILES, lambda p: p.relative_to(SOURCE).parts[0])}
"""Package or top module -> its modules."""
LIMITS = dict(module=400, function=40)
EXCUSED: dict[str, str] = {}
"""path or path:function -> reason; empty is the goal."""
TAKES_ANY_KEYWORD = {"model/block.py:Block.replace": "a_misspelt_keyword_of_replace"}
"""Public functions with ``**``, and the mistake that proves that a misspelt name is refused."""
PASSED_ON = {
    "cli/common.py:add",
    "common/views.py:view",
    "common/views.py:no_view",
    "diagnosis/round_fits.py:fits_from_starts",
    "fitting/scale_notes.py:scale_notes_before",
}
"""Functions whose ``**`` goes to one of fixed signature."""
HEAVY = ("scipy", "control", "matplotlib", "pandas", "h5py", "llvmlite")


def name_of(path):
    return path.relative_to(SOURCE).as_posix()


@functools.cache
def tree_of(path):
    return ast.parse(path.read_text(encoding="utf-8"))


def public_things(path):
    """(qualified name, node) of every public class, function and method of a module, outermost first."""
    for node in tree_of(path).body:
        if isinstance(node, (ast.ClassDef, ast.FunctionDef)) and not node.name.startswith("_"):
            yield node.name, node
            if isinstance(node, ast.ClassDef) and "Protocol" not in {getattr(b, "id", "") for b in node.bases}:
                for part in node.body:
                    if isinstance(part, ast.FunctionDef) and not part.name.startswith("_"):
                        yield f"{node.name}.{part.name}", part


def things_of(room):
    """(path, qualified name, node) of everything public in a package."""
    for path in ROOMS[room]:
        for name, node in public_things(path):
            yield path, name, node


def inherited(path, name):
    """Whether a method is documented by a base of its class (a block's equations, by Block)."""
    owner, _, method = name.partition(".")
    if not method:
        return False
    module = import_module(".".join(["tsmblocks", *path.relative_to(SOURCE).with_suffix("").parts]))
    bases = getattr(module, owner).__mro__[1:]
    return any(inspect.getdoc(vars(base)[method]) for base in bases if method in vars(base))


# ---- names


def test_public_names_are_sorted_and_can_be_had():
    assert tsmblocks.__all__ == sorted(set(tsmblocks.__all__))
    for name in tsmblocks.__all__:
        assert getattr(tsmblocks, name) is not None
    assert set(tsmblocks.__all__) <= set(dir(tsmblocks))


def test_editors_and_type_checkers_read_the_same_names():
    stub = ast.parse((SOURCE / "__init__.pyi").read_text(encoding="utf-8")).body
    read = {alias.asname: node.module for node in stub for alias in node.names}
    assert all(alias.name == alias.asname for node in stub for alias in node.names), "a stub exports x as x alone"
    assert set(read) == {*tsmblocks.__all__, "__version__"}
    for name, module in read.items():
        if module == "tsmblocks":
            assert getattr(tsmblocks, name) is import_module(f"tsmblocks.{name}")
        else:
            assert getattr(tsmblocks, name) is getattr(import_module(module), name)


def test_the_package_is_imported_from_an_archive(tmp_path):
    archive = tmp_path / "tsmblocks.zip"
    with zipfile.ZipFile(archive, "w") as made:
        for path in [*FILES, SOURCE / "__init__.pyi"]:
            made.write(path, path.relative_to(ROOT).as_posix())
    code = (
        f"import sys; sys.path.insert(0, {str(archive)!r}); import tsmblocks; print(tsmblocks.__file__); tsmblocks.Run"
    )
    said = subprocess.run([sys.executable, "-c", code], cwd=tmp_path, capture_output=True, text=True, check=True)
    assert said.stdout.startswith(str(archive))


def has_list(path):
    return path.name != "__main__.py" and re.search(r"^__all__\b", path.read_text(encoding="utf-8"), re.M) is not None


def test_listed_names_exist():
    for path in filter(has_list, FILES):
        parts = path.relative_to(SOURCE).with_suffix("").parts
        module = import_module(".".join(["tsmblocks", *(p for p in parts if p != "__init__")]))
        assert [name for name in module.__all__ if not hasattr(module, name)] == [], path


def test_nothing_public_takes_any_keyword():
    """Else a misspelt name would be taken without a word."""
    found = {
        f"{name_of(path)}:{name}"
        for path in FILES
        for name, node in public_things(path)
        if isinstance(node, ast.FunctionDef) and node.args.kwarg is not None
    }
    assert found - PASSED_ON == set(TAKES_ANY_KEYWORD)


def test_what_takes_any_keyword_refuses_a_misspelt_one():
    assert set(TAKES_ANY_KEYWORD.values()) <= {row.make.__name__ for row in TABLE}


# ---- words and annotations


@pytest.mark.parametrize("room", ROOMS)
def test_every_module_says_what_it_is(room):
    first = {name_of(path): (ast.get_docstring(tree_of(path)) or "").partition("\n")[0] for path in ROOMS[room]}
    assert {name: text for name, text in first.items() if not re.match(r"[^\n]+[.:]$", text)} == {}


@pytest.mark.parametrize("room", ROOMS)
def test_everything_public_is_documented(room):
    bare = [(p, name) for p, name, node in things_of(room) if not ast.get_docstring(node) and not inherited(p, name)]
    assert bare == []


@pytest.mark.parametrize("room", ROOMS)
def test_everything_public_is_annotated(room):
    bare = []
    for path, name, node in things_of(room):
        if not isinstance(node, ast.FunctionDef):
            continue
        every = [*node.args.posonlyargs, *node.args.args, *node.args.kwonlyargs, node.args.vararg, node.args.kwarg]
        silent = [a.arg for a in every if a is not None and a.annotation is None and a.arg not in ("self", "cls")]
        if silent or node.returns is None:
            bare.append(f"{name_of(path)}:{name}({', '.join(silent)})")
    assert bare == []


# ---- sizes


@functools.cache
def length_of(path):
    return len(path.read_text(encoding="utf-8").splitlines())


@pytest.mark.parametrize("room", ROOMS)
def test_modules_stay_small(room):
    long = [(name_of(path), length_of(path)) for path in ROOMS[room] if length_of(path) > LIMITS["module"]]
    faults = [f"tsmblocks/{name} has {lines} lines" for name, lines in long if name not in EXCUSED]
    assert not faults, f"{', '.join(faults)}; at most {LIMITS['module']} are allowed: move its second subject out"


def nodes_of(path):
    return ((name_of(path), node) for node in ast.walk(tree_of(path)))


@pytest.mark.parametrize("room", ROOMS)
def test_functions_fit_a_page(room):
    """Arguments and docstrings do not count: a list of options has a line for each."""
    long = {}
    for name, node in itertools.chain.from_iterable(nodes_of(path) for path in ROOMS[room]):
        if isinstance(node, (ast.FunctionDef, ast.AsyncFunctionDef)):
            body = node.body[1:] if ast.get_docstring(node) else node.body
            lines = body[-1].end_lineno - body[0].lineno + 1 if body else 0
            if lines > LIMITS["function"]:
                long[f"{name}:{node.name}"] = lines
    assert {name: lines for name, lines in long.items() if name not in EXCUSED} == {}


def test_excuses_are_not_kept_longer_than_needed():
    for name in EXCUSED:
        path, _, function = name.partition(":")
        assert (SOURCE / path).exists()
        assert not function or f"def {function}(" in (SOURCE / path).read_text(encoding="utf-8")
        assert function or length_of(SOURCE / path) > LIMITS["module"], f"{name} fits now: it needs no excuse"


# ---- layers


def contracts():
    return tomllib.loads((ROOT / "pyproject.toml").read_text(encoding="utf-8"))["tool"]["importlinter"]["contracts"]


def test_each_layer_imports_only_what_is_below_it():
    pytest.importorskip("importlinter")
    command = [
        sys.executable,
        "-c",
        "from importlinter.cli import lint_imports; raise SystemExit(lint_imports(no_cache=True))",
    ]
    done = subprocess.run(command, cwd=ROOT, capture_output=True, text=True, check=False)
    assert done.returncode == 0, done.stdout


def test_no_module_stands_outside_the_layers():
    layers = next(c for c in contracts() if c["type"] == "layers")["layers"]
    named = {name.strip() for layer in layers for name in re.split("[|:]", layer)}
    there = {p.stem for p in SOURCE.iterdir() if p.suffix == ".py" or (p / "__init__.py").exists()}
    assert there - {"__init__", "__main__"} == named
    assert {p.name for p in SOURCE.glob("*.py")} == {"__init__.py", "__main__.py"}


def test_no_contract_has_exceptions():
    assert not any("ignore_imports" in contract for contract in contracts())


@pytest.mark.parametrize("name", ["block", "errors", "blocks", "effects", "studies", "testing", "analysis", "export"])
def test_modules_that_scripts_import_stay_importable(name):
    assert import_module(f"tsmblocks.{name}").__name__.startswith("tsmblocks.")
    code = f"from tsmblocks.block import Block, parameter; import tsmblocks.{name}; print(Block.__name__)"
    done = subprocess.run([sys.executable, "-c", code], cwd=ROOT, capture_output=True, text=True, check=True)
    assert done.stdout.strip() == "Block"


def test_a_contract_keeps_blocks_out_of_the_engine():
    kept = next(c for c in contracts() if c["type"] == "forbidden" and "tsmblocks.engine" in c["source_modules"])
    assert {f"tsmblocks.{k}" for k in ("model", "blocks", "compiler")} <= set(kept["forbidden_modules"])


# ---- cost


@pytest.mark.parametrize(
    "statement", ["import tsmblocks", "import tsmblocks.blocks", "from tsmblocks import Diagram, load"]
)
def test_importing_needs_nothing_heavy(statement):
    code = f"import sys; {statement}; print([m for m in {HEAVY!r} if m in sys.modules])"
    done = subprocess.run([sys.executable, "-c", code], cwd=ROOT, capture_output=True, text=True, check=True)
    assert done.stdout.strip() == "[]"


def test_the_package_is_typed():
    assert (SOURCE / "py.typed").exists()
