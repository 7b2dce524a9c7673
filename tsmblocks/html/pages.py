"""Pages, cards and parts of them, rendered from templates (Jinja2), without scripts and without network.

Values are text and are escaped, unless they are ``Markup``: parts made by a template, and charts.
"""

from __future__ import annotations

import functools
import re
from collections.abc import Mapping
from importlib.resources import files
from typing import Any

from jinja2 import Environment, PackageLoader, StrictUndefined
from markupsafe import Markup, escape

from tsmblocks.common.errors import without_controls
from tsmblocks.common.palette import DARK, EITHER, LIGHT, css_variables
from tsmblocks.common.version import __version__

FLUSH_LEFT = "l:"
"""Prefix of the name of a column that is flush left."""
HEADING = re.compile(r"<h([23])>(.*?)</h\1>", re.DOTALL)
"""Heading of a section, or of a part of one."""


@functools.cache
def _templates() -> Environment:
    environment = Environment(
        loader=PackageLoader("tsmblocks.html"),
        autoescape=True,
        finalize=_without_controls,
        undefined=StrictUndefined,
        trim_blocks=True,
        lstrip_blocks=True,
    )
    environment.globals |= {"style": style, "icon": Markup(ICON), "version": __version__}
    environment.filters |= {"sentence": sentence, "headings": headings, "with_ids": with_ids, "width": width}
    environment.tests["flush_left"] = lambda name: name.startswith(FLUSH_LEFT)
    return environment


def _without_controls(value: Any) -> Any:
    """What a template shows of a value: of text that is to be escaped, no control characters."""
    return without_controls(value) if isinstance(value, str) and not isinstance(value, Markup) else value


def rendered(template: str, values: Mapping[str, Any]) -> str:
    """A template filled with values: the same text for the same values."""
    return _templates().get_template(template).render(values)


def part(name: str, *arguments: Any) -> Markup:
    """The HTML that a macro of ``parts.html`` makes."""
    return getattr(_templates().get_template("parts.html").module, name)(*arguments)


ICON = (
    '<link rel="icon" href="data:image/svg+xml,'
    "%3Csvg xmlns='http://www.w3.org/2000/svg' viewBox='0 0 16 16'%3E%3Cpath d='M0 8h3m10 0h3M3 3h10v10H3z' "
    "fill='none' stroke='%23888' stroke-width='2'/%3E%3C/svg%3E\">"
)
"""The icon of all pages in their heads: a block with its wires."""


@functools.cache
def style(name: str) -> Markup:
    """A style sheet on one line, without its comments, with the palettes that it names."""
    text = with_palettes((files("tsmblocks.html") / "templates" / name).read_text(encoding="utf-8"))
    return Markup(" ".join(re.sub(r"/\*.*?\*/", "", text, flags=re.DOTALL).split()))


def with_palettes(text: str) -> str:
    """A style sheet with the colours of ``@light``, ``@dark`` and ``@either`` as variables."""
    for mark, palette in {"@light": LIGHT, "@dark": DARK, "@either": EITHER}.items():
        text = text.replace(mark, css_variables(palette))
    return text


def sentence(words: str) -> Markup:
    """A sentence as HTML; a number and its percent sign stay together, as do both ends of an arrow."""
    if isinstance(words, Markup):
        return words
    kept = (
        str(escape(without_controls(words)))
        .replace(" %", "&nbsp;%")
        .replace(" ± ", "&nbsp;±&nbsp;")
        .replace(" -&gt; ", "&nbsp;→&nbsp;")
    )
    return Markup(kept)


def headings(content: str) -> list[tuple[str, Markup]]:
    """The sections of a page: id and words of their headings."""
    return [(name, Markup(words)) for level, name, words in _identified(content) if level == "2"]


def with_ids(content: str) -> Markup:
    """The same content with an id in each heading."""
    found = iter(_identified(content))

    def heading(_: re.Match[str]) -> str:
        level, name, words = next(found)
        return f'<h{level} id="{name}">{words}</h{level}>'

    return Markup(HEADING.sub(heading, content))


def _identified(content: str) -> list[tuple[str, str, str]]:
    """Level, id and words of each heading; of ids that would be the same the later ones have a number."""
    found, counts = [], dict[str, int]()
    for level, words in HEADING.findall(content):
        name = "-".join(re.findall(r"[a-z0-9]+", re.sub(r"<[^>]*>|&\w+;", " ", words).lower())) or "part"
        counts[name] = counts.get(name, 0) + 1
        found.append((level, name if counts[name] == 1 else f"{name}-{counts[name]}", words))
    return found


def width(drawing: str) -> str:
    """The width of a drawing in pixels, as it is written in it."""
    found = re.search(r'<svg[^>]* width="([\d.]+)"', drawing)
    return found.group(1) if found else "0"
