"""Slow tests, of what has changed since they passed: ``python tests/slow.py`` names their files, ``… run`` runs them.

Tests marked ``slow`` are left out unless they are called for with ``-m slow``. Each file that has some says what they
depend on in ``SLOW_NEEDS``: packages of tsmblocks, with all that these import, and files (patterns). The file itself
and the helpers that it imports count too. A digest of all of it stands in ``tests/slow.txt``; comments, docstrings and
empty lines do not count. ``run`` writes those of the files that passed: they are committed with the change.
"""

import ast
import hashlib
import io
import subprocess
import sys
import tokenize
from collections.abc import Iterator
from functools import cache
from pathlib import Path

ROOT = Path(__file__).resolve().parents[1]
STAMPS = ROOT / "tests" / "slow.txt"
"""A digest and the file of tests that passed with it, one a line."""


def main(arguments: list[str]) -> int:
    """Names the files whose slow tests are due, or runs these; exit status of pytest."""
    waiting = due()
    if arguments[:1] != ["run"]:
        print("\n".join(waiting) or "no slow test is due")
        return 0
    for path in waiting:
        print(f"-- slow tests of {path}, since what they depend on has changed", flush=True)
    if not waiting:
        print("no slow test is due")
        return 0
    command = [sys.executable, "-m", "pytest", "-q", "-m", "slow", *arguments[1:], *waiting]
    done = subprocess.run(command, check=False, cwd=ROOT, stdout=subprocess.PIPE, text=True, encoding="utf-8")
    print(done.stdout, flush=True)
    if "needs measured data" in done.stdout:
        print("nothing is written to tests/slow.txt: tests on measured data were skipped")
    elif not done.returncode:
        write({path: digest(path) for path in waiting})
    return done.returncode


def due() -> list[str]:
    """Files of tests whose slow tests have not passed with what there is now."""
    known = stamps()
    return [path for path in with_slow_tests() if known.get(path) != digest(path)]


def with_slow_tests() -> list[str]:
    """Files of tests that say what their slow tests need."""
    found = (ROOT / "tests").rglob("test_*.py")
    return sorted(path.relative_to(ROOT).as_posix() for path in found if needs(path))


def needs(path: Path) -> list[str]:
    """What the slow tests of a file depend on: its ``SLOW_NEEDS``."""
    for node in ast.parse(path.read_text("utf-8")).body:
        if isinstance(node, ast.Assign) and ast.unparse(node.targets[0]) == "SLOW_NEEDS":
            return list(ast.literal_eval(node.value))
    return []


def stamps() -> dict[str, str]:
    """Digests with which the slow tests of files have passed."""
    lines = STAMPS.read_text("utf-8").splitlines() if STAMPS.exists() else []
    return {path: one for one, path in map(str.split, lines)}


def write(passed: dict[str, str]) -> None:
    """Keep digests of files whose slow tests have all passed."""
    known = {**stamps(), **passed}
    lines = [f"{known[path]} {path}\n" for path in with_slow_tests() if path in known]
    STAMPS.write_text("".join(lines), "utf-8", newline="\n")


def digest(path: str) -> str:
    """A digest of a file of tests and of everything that its slow tests depend on."""
    here = ROOT / path
    files = {*_with_helpers(here), *(file for need in needs(here) for file in _files(need))}
    lines = [f"{file.relative_to(ROOT).as_posix()} {_content(file)}" for file in sorted(files)]
    return hashlib.sha256("\n".join(lines).encode()).hexdigest()[:16]


def _files(need: str) -> Iterator[Path]:
    """Files of a package and of all packages that it imports, or those of a pattern."""
    if (ROOT / "tsmblocks" / need).is_dir():
        for package in _closure(need):
            yield from (ROOT / "tsmblocks" / package).rglob("*.py")
        return
    found = [path for path in ROOT.glob(need) if path.is_file()]
    if not found:
        raise SystemExit(f"SLOW_NEEDS names '{need}', which is neither a package of tsmblocks nor a file")
    yield from found


@cache
def _closure(package: str) -> frozenset[str]:
    """A package of tsmblocks and all that it imports, and they in turn; imports within functions count."""
    seen: set[str] = set()
    waiting = {package}
    while waiting:
        now = waiting.pop()
        seen.add(now)
        names = {
            name.split(".")[1]
            for file in (ROOT / "tsmblocks" / now).rglob("*.py")
            for name in _imports(file)
            if name.startswith("tsmblocks.")
        }
        waiting |= {name for name in names - seen if (ROOT / "tsmblocks" / name).is_dir()}
    return frozenset(seen)


def _with_helpers(file: Path) -> set[Path]:
    """A file of tests and the modules of tests that it imports, and they in turn."""
    seen: set[Path] = set()
    waiting = {file}
    while waiting:
        now = waiting.pop()
        seen.add(now)
        for name in _imports(now):
            module = ROOT / name.replace(".", "/")
            beside = {module.with_suffix(".py"), module / "__init__.py"} if name.startswith("tests.") else set()
            waiting |= {one for one in beside if one.exists()} - seen
    return seen


@cache
def _imports(file: Path) -> frozenset[str]:
    """Modules that a file imports, other than for types, and what it imports from them."""
    made: set[str] = set()
    waiting: list[ast.AST] = [ast.parse(file.read_text("utf-8"))]
    while waiting:
        node = waiting.pop()
        if isinstance(node, ast.If) and ast.unparse(node.test).endswith("TYPE_CHECKING"):
            continue
        waiting += ast.iter_child_nodes(node)
        if isinstance(node, ast.Import):
            made |= {one.name for one in node.names}
        elif isinstance(node, ast.ImportFrom):
            above = [*file.relative_to(ROOT).parts[: -node.level]] if node.level else []
            module = ".".join([*above, *([node.module] if node.module else [])])
            made |= {module, *(f"{module}.{one.name}" for one in node.names)}
    return frozenset(made)


@cache
def _content(file: Path) -> str:
    """A digest of what a file says: Python without comments, docstrings and empty lines."""
    if file.suffix != ".py":
        return hashlib.sha256(file.read_bytes().replace(b"\r\n", b"\n")).hexdigest()
    text = file.read_text("utf-8")
    lines = text.splitlines()
    for token in tokenize.generate_tokens(io.StringIO(text).readline):
        if token.type == tokenize.COMMENT:
            row, column = token.start
            lines[row - 1] = lines[row - 1][:column]
    for node in ast.walk(ast.parse(text)):
        if isinstance(node, ast.Expr) and isinstance(node.value, ast.Constant) and isinstance(node.value.value, str):
            for row in range(node.lineno, (node.end_lineno or node.lineno) + 1):
                lines[row - 1] = ""
    return hashlib.sha256("\n".join(line.rstrip() for line in lines if line.strip()).encode()).hexdigest()


if __name__ == "__main__":
    raise SystemExit(main(sys.argv[1:]))
