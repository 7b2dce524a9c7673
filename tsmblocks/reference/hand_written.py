"""Pages written by hand: their code is run, and what it makes is shown where the page says so.

``.. drawn:: NAME`` shows the diagram or figure of this name that the page's code has made; its text describes it.
"""

from __future__ import annotations

import contextlib
import functools
import io
import linecache
import re
import sys
import tempfile
import textwrap
import types
from collections.abc import Iterator
from pathlib import Path
from typing import Any

from tsmblocks.model.block import REGISTRY
from tsmblocks.model.diagram import Diagram
from tsmblocks.reference import rst, uses

FOLDER = Path(__file__).parent / "pages"
_BLOCK = r"\n\n((?:   .*\n|\n)+)"
CODE = re.compile(rf"\.\. code-block:: python{_BLOCK}(?:\.\. code-block:: none{_BLOCK})?")
DRAWN = re.compile(r"^\.\. drawn:: (\w+)\n((?:   .+\n)+)", re.MULTILINE)
SHARP = 144
"""Dots per inch of figures."""


def shown(text: str) -> list[tuple[str, str]]:
    """Each piece of code of a page, with what the page says that it prints."""
    return [(textwrap.dedent(code), textwrap.dedent(said or "").strip()) for code, said in CODE.findall(text)]


@contextlib.contextmanager
def without_traces() -> Iterator[None]:
    """Run code in a folder of its own; blocks that it declares are gone after it, and so are its figures."""
    before, arguments = dict(REGISTRY), sys.argv
    with tempfile.TemporaryDirectory() as folder, contextlib.chdir(folder):
        try:
            yield
        finally:
            sys.argv = arguments
            if drawn := sys.modules.get("matplotlib.pyplot"):
                drawn.close("all")  # they can still be saved
            for name in set(REGISTRY) - set(before):
                del REGISTRY[name]


@functools.cache
def executed(text: str) -> tuple[list[str], dict[str, Any]]:
    """What each piece of code of a page prints, and the names that the page leaves behind."""
    module, pieces, printed = types.ModuleType("page"), [code for code, _ in shown(text)], []
    sys.modules["page"] = module
    try:
        with without_traces():
            # Messages and checks read lines of it.
            Path("page.py").write_text("".join(pieces), encoding="utf-8", newline="\n")
            linecache.checkcache("page.py")
            before = 0
            for code in pieces:
                said = io.StringIO()
                with contextlib.redirect_stdout(said):
                    exec(compile("\n" * before + code, "page.py", "exec"), vars(module))
                printed.append(said.getvalue().strip())
                before += code.count("\n")
    finally:
        del sys.modules["page"]
    return printed, vars(module)


def pages(folder: Path) -> dict[str, str]:
    """Every page that shows what its code makes, by its path; figures are written into ``folder``."""
    made = {}
    for path in sorted(FOLDER.rglob("*.rst")):
        text = path.read_text(encoding="utf-8")
        if DRAWN.search(text):
            made[path.relative_to(FOLDER).with_suffix("").as_posix()] = _with_pictures(text, path, folder)
    return made


def _with_pictures(text: str, path: Path, folder: Path) -> str:
    names = executed(text)[1]
    up = "../" * (len(path.relative_to(FOLDER).parts) - 1)

    def picture(found: re.Match[str]) -> str:
        value, words = names[found[1]], " ".join(found[2].split())
        if isinstance(value, Diagram):
            return rst.html(uses.linked_picture(value, up=up))
        name = f"{path.stem}_{found[1]}.png"
        value.savefig(folder / name, dpi=SHARP, bbox_inches="tight")
        return rst.image(f"/{folder.name}/{name}", words)

    return DRAWN.sub(picture, text)
