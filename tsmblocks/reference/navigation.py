"""The tree in the sidebar: two levels, and deeper where the open page is. It is an extension of Sphinx.

Sphinx resolves the whole tree for every page, which takes longer than all else together and lists every block.
"""

from __future__ import annotations

from collections.abc import Iterator, Mapping, Sequence
from html import escape
from typing import Any

ALWAYS = 2
"""Levels that are listed on every page; those below are listed on the way to the open page."""


def tree(
    children: Mapping[str, Sequence[str]], titles: Mapping[str, str], addresses: Mapping[str, str], path: Sequence[str]
) -> str:
    """The tree as nested lists; ``path`` are the pages from the first page of the site to the open one."""

    def branch(name: str, level: int) -> str:
        if not children.get(name) or (level > ALWAYS and name not in path):
            return ""
        return f"<ul>{''.join(entry(child, level) for child in children[name])}</ul>"

    def entry(name: str, level: int) -> str:
        current = " current" if name in path else ""
        link = f'<a class="reference internal{current}" href="{addresses[name]}">{escape(titles[name])}</a>'
        return f'<li class="toctree-l{level}{current}">{link}{branch(name, level + 1)}</li>'

    return branch(path[0], 1)


def way(parents: Mapping[str, str], page: str) -> list[str]:
    """The pages from the first page of the site to this one."""

    def upwards(name: str) -> Iterator[str]:
        yield name
        if name in parents:
            yield from upwards(parents[name])

    return list(upwards(page))[::-1]


def _offer(app: Any, pagename: str, _template: str, context: dict[str, Any], _doctree: Any) -> None:
    """Give the theme this tree in place of Sphinx's."""
    env, root = app.env, app.config.root_doc
    parents = {child: name for name, some in env.toctree_includes.items() for child in some}
    path = way(parents, pagename)
    titles = {name: title.astext() for name, title in env.titles.items()}
    addresses = {name: app.builder.get_relative_uri(pagename, name) for name in titles}
    made = tree(env.toctree_includes, titles, addresses, path if path[0] == root else [root])
    context["toctree"] = lambda **_: made


def setup(app: Any) -> dict[str, bool]:
    """Take part before the theme asks for the tree."""
    app.connect("html-page-context", _offer, priority=400)
    return {"parallel_read_safe": True, "parallel_write_safe": True}
