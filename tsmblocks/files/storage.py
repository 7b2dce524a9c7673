"""Diagrams as TOML files: ``load``, ``loads``, ``dumps`` and ``save``.

Format 1 has ``title``, ``source``, ``wires``, ``[blocks]``, ``[inputs]``, ``[outputs]`` and
``[values]``. Loading runs nothing that a file says, and reports every fault of a file with its line.
"""

from __future__ import annotations

import os
from pathlib import Path

from tsmblocks.common.atomic_write import replace_file
from tsmblocks.common.errors import FileError, clip, in_words, near
from tsmblocks.files.shipped import shipped_folder, shipped_names
from tsmblocks.model.diagram import Diagram


def load(name_or_path: str | os.PathLike[str]) -> Diagram:
    """Return the diagram in a file, or the ready-made one of that name (``"fig16_feedforward_feedback"``).

    What exists as a file, ends in ``.toml`` or holds a separator is a path. Raises FileError with
    every fault of the file, or DiagramError when all of them are of the wiring.
    """
    from tsmblocks.files.reader import diagram_from
    from tsmblocks.files.toml_text import read

    _fill_registry()
    path = _path_of(name_or_path)
    return diagram_from(read(path), str(path), path.parent, path.resolve())


def load_beside(folder: Path, name: str) -> Diagram:
    """Return the diagram that a file in a folder names: one beside it, else as ``load``. Raises as ``load`` does."""
    beside = folder / name
    return load(beside if beside.is_file() else name)


def loads(text: str, where: str = "<text>", folder: str | os.PathLike[str] | None = None) -> Diagram:
    """Return the diagram that a text describes.

    ``where`` is what messages call the text; ``folder`` is where the diagrams it uses may lie, in
    addition to the ready-made ones. Raises as ``load`` does.
    """
    from tsmblocks.files.reader import diagram_from

    if not isinstance(text, str):
        raise FileError(where, [f"the text of a diagram is needed, got {in_words(text)}. For a file, use load."])
    _fill_registry()
    return diagram_from(text, where, None if folder is None else Path(folder))


def dumps(diagram: Diagram) -> str:
    """Return a diagram as the text of a file; ``loads`` of it gives an equal diagram.

    Values that are a block's default are left out, and a diagram inside is written in place. Raises
    FileError for what a file cannot hold, such as a block that is not registered.
    """
    from tsmblocks.files.writer import text_of

    if not isinstance(diagram, Diagram):
        raise FileError("dumps", [f"a Diagram is needed to be written, got {in_words(diagram)}."])
    return text_of(diagram)


def save(diagram: Diagram, path: str | os.PathLike[str]) -> None:
    """Write a diagram to a file, which is at any moment the old one or the new one, never a part.

    Raises FileError when the diagram cannot be written down, or the file cannot be written.
    """
    text = dumps(diagram)
    if not isinstance(path, (str, os.PathLike)):
        raise FileError("save", [f"a file is named by text or a path, got {in_words(path)}."])
    try:
        replace_file(Path(os.path.realpath(path)), text)  # a link stays a link
    except (OSError, ValueError) as error:
        reason = (getattr(error, "strerror", None) or str(error)).lower()
        raise FileError(clip(str(path)), [f"{clip(str(path))}: cannot be written: {reason}."]) from None


def _path_of(given: str | os.PathLike[str]) -> Path:
    """Return the file that a name or path means."""
    try:
        text = os.fspath(given)
    except TypeError:
        text = None
    if not isinstance(text, str) or not text.strip() or "\0" in text:
        raise FileError("load", [f"a diagram is named by text or a path, got {in_words(given)}."])
    path = Path(text)
    separated = any(mark in text for mark in (os.sep, os.altsep) if mark)
    if separated or path.suffix == ".toml" or not isinstance(given, str) or _is_file(path) or not path.name:
        return path
    ready = shipped_folder() / f"{text}.toml"
    if _is_file(ready):
        return ready
    if _is_file(path.with_name(f"{path.name}.toml")):
        raise FileError(
            clip(text), [f"'{text}' is not among the ready-made diagrams. For the file, say '{text}.toml'."]
        )
    hint = near(text, shipped_names(), otherwise=" `tsmblocks diagrams` lists them.")
    raise FileError(clip(text), [f"there is no file '{clip(text)}', and no ready-made diagram of that name.{hint}"])


def _is_file(path: Path) -> bool:
    try:
        return path.is_file()
    except OSError:  # a name too long to be one
        return False


def _fill_registry() -> None:
    """Have every block of the toolbox registered; a file may name those and the user's own."""
    import tsmblocks.blocks  # noqa: F401 - imported for what it registers
