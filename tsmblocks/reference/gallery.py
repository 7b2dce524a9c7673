"""The gallery: a page for each example, with what it prints and draws, and the shipped diagrams at a glance."""

from __future__ import annotations

import ast
import contextlib
import io
import re
import runpy
import sys
from collections.abc import Iterator
from pathlib import Path

import attrs

from tsmblocks.files.shipped import examples_folder
from tsmblocks.html.pages import part
from tsmblocks.reference import hand_written, rst, uses

LONGEST = 4
"""Seconds up to which an example is run for its page."""
EXCERPT = 8
"""Lines of what an example prints that a card shows at most."""
PICTURES = "_pictures"
"""Folder of pictures in the source of the site."""
ROW = re.compile(r"^\| \[(\w+)\]\(\w+\.py\) \| (.+) \| (\d+) s \|$")


SPELT = (("Emps", "EMPS"), ("Python control", "python-control"))
"""Names as their owners spell them."""


@attrs.frozen
class Example:
    """An example, as the list of examples describes it."""

    name: str
    section: str
    words: str
    seconds: int

    @property
    def text(self) -> str:
        """Its code."""
        return (examples_folder() / f"{self.name}.py").read_text(encoding="utf-8")

    @property
    def title(self) -> str:
        """Its name in words."""
        words = self.name.partition("_")[2].replace("_", " ").capitalize()
        return next((words.replace(*pair) for pair in SPELT if pair[0] in words), words)

    @property
    def summary(self) -> str:
        """What it shows, as a sentence."""
        words = re.sub(r" \((?:pictures?|data)\)", "", self.words)
        return f"{words[0].upper()}{words[1:]}.".replace("`", "")

    @property
    def quick(self) -> bool:
        """Whether it is run for its page: it takes little time, and needs neither measured data nor a C compiler."""
        return self.seconds <= LONGEST and "(data)" not in self.words and "C compiler" not in self.words

    @property
    def diagrams(self) -> list[str]:
        """Shipped diagrams that it loads."""
        return [name for name in uses.shipped() if f'"{name}"' in self.text]


def listed() -> Iterator[Example]:
    """The examples in their order."""
    section = ""
    for line in (examples_folder() / "README.md").read_text(encoding="utf-8").splitlines():
        if line.startswith("## "):
            section = line.removeprefix("## ")
        if found := ROW.match(line):
            yield Example(found[1], section, found[2], int(found[3]))


def pages(folder: Path) -> dict[str, str]:
    """Every page by its path; pictures that examples draw are written into ``folder``."""
    made, cards = {}, {}
    for example in listed():
        said, pictures = _ran(example, folder) if example.quick else ("", [])
        made[f"gallery/{example.name}"] = _page(example, said, pictures)
        cards[example] = _thumbnail(example, said, pictures)
    return {"gallery/index": _index(cards), **made}


def _ran(example: Example, folder: Path) -> tuple[str, list[str]]:
    """What an example prints, and the names of the pictures that it draws."""
    target, said = folder / example.name, io.StringIO()
    arguments = [str(target)] if "(picture" in example.words else []
    with hand_written.without_traces(), contextlib.redirect_stdout(said):
        sys.argv = [example.name, *arguments]
        runpy.run_path(str(examples_folder() / f"{example.name}.py"))
    return said.getvalue(), sorted(path.name for path in target.glob("*.png"))


def _page(example: Example, said: str, pictures: list[str]) -> str:
    question, _, more = (ast.get_docstring(ast.parse(example.text)) or "").partition("\n\n")
    blocks = [rst.link(f"/diagrams/{name}", name) for name in example.diagrams]
    return rst.page(
        rst.heading(example.title),
        rst.plain(question),
        *(rst.plain(paragraph) for paragraph in more.split("\n\n")),
        *(rst.image(f"/{PICTURES}/{example.name}/{name}", f"{rst.plain(question)} ({name})") for name in pictures),
        f"Diagrams: {', '.join(blocks)}." if blocks else "",
        *((rst.heading("What it prints", 1), rst.block(said, "none")) if said else ()),
        rst.heading("The code", 1),
        f"``examples/{example.name}.py``, some {example.seconds} s.",
        rst.block(example.text, "python"),
    )


def _thumbnail(example: Example, said: str, pictures: list[str]) -> str:
    """A picture that the example draws, a diagram that it uses, or else how what it prints begins."""
    if pictures:
        return part("thumbnail", f"../_images/{pictures[0]}", example.title)
    if example.diagrams:
        return uses.small_picture(uses.shipped()[example.diagrams[0]])
    return part("excerpt", said.strip().splitlines()[:EXCERPT]) if said else ""


def _index(cards: dict[Example, str]) -> str:
    parts = [
        rst.heading("Gallery"),
        rst.indexed(("Examples", "Gallery", "Sample code", "Demo")),
        "Examples, from first steps to measured machines, each with one idea. They are in the folder ``examples/`` of "
        "the source code and run from any folder. Those that need measured data say where it is found.",
    ]
    for section in dict.fromkeys(example.section for example in cards):
        shown = [
            (f"{one.name}.html", one.title, one.summary, card) for one, card in cards.items() if one.section == section
        ]
        parts += [rst.heading(section, 1), rst.html(part("gallery", shown))]
    return rst.page(*parts, rst.contents(f"/gallery/{example.name}" for example in cards))
