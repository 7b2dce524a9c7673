"""Folders of the ready-made diagrams and of the examples, and names of the former. It does not know their content."""

from __future__ import annotations

from pathlib import Path

_PACKAGE = Path(__file__).parent.parent


def shipped_folder() -> Path:
    """Return the folder of ready-made diagram files: in the installed package, or in the checkout."""
    return _folder("diagrams")


def examples_folder() -> Path:
    """Return the folder of the examples: in the installed package, or in the checkout."""
    return _folder("examples")


def _folder(name: str) -> Path:
    packed = _PACKAGE / f"_{name}"
    return packed if packed.is_dir() else _PACKAGE.parent / name


def shipped_names() -> list[str]:
    """Return the names by which ``load`` finds the ready-made diagrams."""
    return sorted(path.stem for path in shipped_folder().glob("*.toml"))
