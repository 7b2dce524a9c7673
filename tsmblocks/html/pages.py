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

FLUSH_LEFT = "l:"
"""Prefix of the name of a column that is flush left."""


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
    environment.globals["style"] = style
    environment.filters["sentence"] = sentence
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


@functools.cache
def style(name: str) -> Markup:
    """A style sheet on one line, without its comments; ``@light``, ``@dark`` and ``@either`` are palettes."""
    text = (files("tsmblocks.html") / "templates" / name).read_text(encoding="utf-8")
    for mark, palette in {"@light": LIGHT, "@dark": DARK, "@either": EITHER}.items():
        text = text.replace(mark, css_variables(palette))
    return Markup(" ".join(re.sub(r"/\*.*?\*/", "", text, flags=re.DOTALL).split()))


def sentence(words: str) -> Markup:
    """A sentence as HTML; a number and its percent sign stay together."""
    kept = (
        str(escape(without_controls(words)))
        .replace(" %", "&nbsp;%")
        .replace(" ± ", "&nbsp;±&nbsp;")
        .replace(" -&gt;", "&nbsp;→")
    )
    return Markup(kept)
