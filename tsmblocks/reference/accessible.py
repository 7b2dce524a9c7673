"""What the theme leaves out: an icon; for keyboards and screen readers names of regions, boxes that scroll by key."""

from __future__ import annotations

from pathlib import Path

from tsmblocks.html.pages import ICON

CHANGES = (
    ('<aside class="sidebar-drawer">', '<aside class="sidebar-drawer" aria-label="All pages">'),
    ('<aside class="toc-drawer', '<aside aria-label="On this page" class="toc-drawer'),
    ("</head>", f"{ICON}</head>"),  # a title may be that of a drawing
    ("<pre>", '<pre tabindex="0">'),
    ('<div class="plot docutils container">', '<div tabindex="0" role="group" aria-label="plot" class="plot">'),
    ('<div class="table-wrapper', '<div tabindex="0" class="table-wrapper'),
    ('<div id="search-results">', '<h1>Search</h1>\n<div id="search-results">'),
)
"""Markup of Sphinx and of the theme, and its replacement."""


def amend(folder: Path) -> None:
    """Change the built pages in a folder."""
    for path in folder.rglob("*.html"):
        text = path.read_text(encoding="utf-8")
        for old, new in CHANGES:
            text = text.replace(old, new)
        path.write_text(text, encoding="utf-8", newline="\n")
