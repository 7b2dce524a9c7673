"""Folder and names of the ready-made diagrams. It does not know their content."""

from __future__ import annotations

from pathlib import Path

_PACKAGE = Path(__file__).parent.parent


def shipped_folder() -> Path:
    """Return the folder of ready-made diagram files: in the installed package, or in the checkout."""
    packed = _PACKAGE / "_diagrams"
    return packed if packed.is_dir() else _PACKAGE.parent / "diagrams"


def shipped_names() -> list[str]:
    """Return the names by which ``load`` finds the ready-made diagrams."""
    return sorted(path.stem for path in shipped_folder().glob("*.toml"))
