"""The whole reference: pages written into a folder of their own, and built by Sphinx."""

from __future__ import annotations

import importlib
import io
import re
import shutil
import tempfile
from collections.abc import Callable, Mapping
from functools import partial
from pathlib import Path
from typing import Any

from tsmblocks.common.errors import TsmError
from tsmblocks.common.version import __version__
from tsmblocks.html.pages import with_palettes
from tsmblocks.reference import (
    accessible,
    blocks,
    diagrams,
    effects,
    figures,
    front,
    gallery,
    glossary,
    hand_written,
    names,
    python,
    units,
)

SHEET = "tsmblocks.css"
"""The style sheet, whose colours are those of all charts."""
WRITING = 0.7
"""Share of the time in which pages are written, before they are built. Measured: pictures and examples are run."""
SETTINGS: dict[str, Any] = {
    "project": "tsmblocks",
    "version": __version__,
    "release": __version__,
    "copyright": "",
    "extensions": [
        "sphinx.ext.autodoc",
        "numpydoc",
        "sphinx_copybutton",
        "tsmblocks.html.mathml",
        "tsmblocks.reference.navigation",
        "tsmblocks.reference.python",
    ],
    "numpydoc_show_class_members": False,
    "autodoc_typehints": "none",  # the lists of arguments have the types
    "html_theme": "furo",
    "html_title": f"tsmblocks {__version__}",
    "html_math_renderer": "mathml",
    "html_static_path": ["_static"],
    "html_css_files": [SHEET],
    "html_use_index": False,  # its entries serve the search
    "html_copy_source": False,
    "html_show_sourcelink": False,
    "html_show_copyright": False,
    "html_show_sphinx": False,
    "html_show_search_summary": False,  # it would fetch pages, which browsers refuse for files
    "html_permalinks_icon": "#",
    "smartquotes": False,
    "templates_path": [],
    "nitpicky": False,
    "copybutton_exclude": ".linenos, .gp, .go",
    "copybutton_selector": "div:not(.highlight-none) > div.highlight > pre",
    "autodoc_member_order": "bysource",
    "pygments_style": "default",
    "pygments_dark_style": "github-dark",
    "highlight_language": "none",
}
"""Settings of Sphinx; the pages load nothing from elsewhere."""


class PagesError(TsmError):
    """Pages that cannot be built."""


def need_sphinx() -> None:
    """Raise TsmError, with the way out, where the pages cannot be built; before long work rather than after it."""
    try:
        for name in ("furo", "latex2mathml", "matplotlib", "numpydoc", "sphinx", "sphinx_copybutton"):
            importlib.import_module(name)
    except ImportError as error:
        raise TsmError(
            f'The reference needs {error.name}, which is not installed: pip install "tsmblocks[reference]"'
        ) from None


def build(
    out: Path, commands: Mapping[str, tuple[str, str]], progress: Callable[[str, float], None] | None = None
) -> int:
    """Write all pages as HTML into ``out``; return their number.

    ``commands`` maps each command to its summary and its help. ``progress`` is called with the stage and the share
    done. Raises TsmError where Sphinx is missing, and PagesError with every warning of Sphinx.
    """
    need_sphinx()
    progress = progress or (lambda *_: None)
    with tempfile.TemporaryDirectory() as folder:
        source = Path(folder) / "source"
        pages = _write(source, commands, progress)
        progress("building pages", WRITING)
        _sphinx(source, out, Path(folder) / "doctrees")
    return pages


def _write(source: Path, helps: Mapping[str, tuple[str, str]], progress: Callable[[str, float], None]) -> int:
    shutil.copytree(hand_written.FOLDER, source)
    sheet = source / "_static" / SHEET
    sheet.write_text(with_palettes(sheet.read_text(encoding="utf-8")), encoding="utf-8", newline="\n")
    pictures = source / gallery.PICTURES
    pictures.mkdir()
    makers: tuple[Callable[[], Mapping[str, str]], ...] = (
        front.pages, partial(hand_written.pages, pictures), partial(gallery.pages, pictures), blocks.pages, names.pages,
        diagrams.pages, effects.pages, glossary.pages, units.pages, python.pages, partial(python.commands, helps),
    )  # fmt: skip
    settings = "\n".join(f"{key} = {value!r}" for key, value in SETTINGS.items())
    (source / "conf.py").write_text(settings + "\n", encoding="utf-8", newline="\n")
    for place, maker in enumerate(makers):
        progress("writing pages", WRITING * place / len(makers))
        for name, text in maker().items():
            path = source / f"{name}.rst"
            path.parent.mkdir(parents=True, exist_ok=True)
            path.write_text(text, encoding="utf-8", newline="\n")
    for path in pictures.rglob("*.png"):
        figures.lighten(path)
    return len(list(source.rglob("*.rst")))


def _sphinx(source: Path, out: Path, doctrees: Path) -> None:
    from sphinx.application import Sphinx
    from sphinx.util.docutils import docutils_namespace, patch_docutils

    warnings = io.StringIO()
    with patch_docutils(), docutils_namespace():
        Sphinx(source, source, out, doctrees, "html", status=None, warning=warnings, freshenv=True).build(
            force_all=True
        )
    messages = re.sub(r"\x1b\[[0-9;]*m", "", warnings.getvalue()).strip()
    if messages:
        raise PagesError(f"the pages are in {out}, with warnings of Sphinx:\n{messages}")
    for name in ("objects.inv", ".buildinfo"):
        (out / name).unlink(missing_ok=True)
    shutil.rmtree(out / "_sources", ignore_errors=True)
    accessible.amend(out)
