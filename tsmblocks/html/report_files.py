"""The report of a diagnosis: one page that needs nothing else, beside its numbers and the augmented diagram."""

from __future__ import annotations

import functools
from pathlib import Path

from tsmblocks.common.atomic_write import replace_file
from tsmblocks.common.errors import TsmError
from tsmblocks.common.tables import listed
from tsmblocks.common.views import no_view
from tsmblocks.diagnosis.result import Diagnosis
from tsmblocks.files import save
from tsmblocks.html.report import page

NAMES = ("diagnosis.json", "augmented.toml", "report.html")
"""The files that are written, in this order."""
FILES = (".html", ".htm", ".json", ".toml", ".pdf", ".txt", ".md", ".csv")
"""File name endings that a folder is unlikely to have."""


def written(diagnosis: Diagnosis, folder: str | Path, back: tuple[str, str] | None = None) -> Path:
    """Write the files of ``NAMES`` into a folder, which is made; return its path. Raises as ``folder_for`` does.

    The page links ``back`` to the page it belongs to (its place, its name).
    """
    place = folder_for(folder)
    place.mkdir(parents=True, exist_ok=True)
    replace_file(place / NAMES[0], diagnosis.to_json())
    save(diagnosis.augmented, place / NAMES[1])
    replace_file(place / NAMES[2], page(diagnosis, back))
    return place


def folder_for(named: str | Path) -> Path:
    """The folder that a diagnosis is written into. Raises TsmError where it is a file, or has the name of one."""
    place = Path(named)
    wanted = f"name a folder for {listed(NAMES)}"
    if place.is_file():
        raise TsmError(f"'{place}' is a file; {wanted}.")
    if not place.exists() and place.suffix.lower() in FILES:
        raise TsmError(f"'{place}' is the name of a file; {wanted}, such as '{place.with_suffix('')}'.")
    return place


view = functools.singledispatch(no_view)
view.register(Diagnosis, written)

__all__ = ["NAMES", "folder_for", "page", "view", "written"]
