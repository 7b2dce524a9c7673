"""Diagrams as TOML files: ``load``, ``loads``, ``dumps`` and ``save``.

Format 1 has ``title``, ``source``, ``wires``, ``[blocks]``, ``[inputs]``, ``[outputs]`` and ``[values]``. Files of
fitted diagrams also have ``[simulation]`` (step, method, hold, condition) and ``[start.RECORDING]`` (initial states of
each recording), which fits, scores and the commands with ``--data`` take up. Loading executes nothing from a file, and
reports every fault of a file with its line.
"""

from __future__ import annotations

import os
from pathlib import Path

from tsmblocks.common.atomic_write import replace_file
from tsmblocks.common.errors import FileError, clip, in_words, near
from tsmblocks.files.shipped import shipped_folder, shipped_names
from tsmblocks.model.diagram import Diagram


def load(name_or_path: str | os.PathLike[str]) -> Diagram:
    """Return the diagram in a file, or a ready-made one.

    Parameters
    ----------
    name_or_path : str or path
        A path, where a file of that name exists, or the text ends in ``.toml`` or contains a separator; else the name
        of a ready-made diagram (``"fig16_feedforward_feedback"``).

    Returns
    -------
    Diagram
        The diagram.

    Raises
    ------
    FileError
        With every fault of the file.
    DiagramError
        Where all faults are of the wiring.

    Examples
    --------
    >>> import tsmblocks as tsm
    >>> tsm.load("tendon_sheath_linear")
    Diagram('Tendon sheath: a gain and an offset', 2 blocks, inputs x_in [rad], outputs x_out [rad])
    """
    from tsmblocks.files.reader import diagram_from
    from tsmblocks.files.toml_text import load_text

    _fill_registry()
    path = _path_of(name_or_path)
    return diagram_from(load_text(path), str(path), path.parent, path.resolve())


def load_beside(folder: Path, name: str) -> Diagram:
    """The diagram in the file ``name`` of a folder, where there is one, else as ``load``. Raises as ``load``."""
    beside = folder / name
    return load(beside if _is_file(beside) else name)


def loads(text: str, where: str = "<text>", folder: str | os.PathLike[str] | None = None) -> Diagram:
    """Return the diagram that a text describes.

    Parameters
    ----------
    text : str
        The text of a diagram file.
    where : str, default "<text>"
        Name of the text in messages.
    folder : str or path, optional
        Folder of the diagrams that the text uses, beside the ready-made ones.

    Returns
    -------
    Diagram
        The diagram.

    Raises
    ------
    FileError
        With every fault of the text.
    DiagramError
        Where all faults are of the wiring.

    Examples
    --------
    >>> import tsmblocks as tsm
    >>> diagram = tsm.load("tendon_sheath_linear")
    >>> tsm.loads(tsm.dumps(diagram)) == diagram
    True
    """
    from tsmblocks.files.reader import diagram_from

    if not isinstance(text, str):
        raise FileError(where, [f"loads takes the text of a diagram, got {in_words(text)}. For a file, use load."])
    _fill_registry()
    return diagram_from(text, where, None if folder is None else Path(folder))


def dumps(diagram: Diagram) -> str:
    """Return a diagram as the text of a file.

    Values that are a block's default are left out, and a diagram inside is written in place; ``loads`` of the text
    gives an equal diagram.

    Parameters
    ----------
    diagram : Diagram
        The diagram.

    Returns
    -------
    str
        Text in TOML.

    Raises
    ------
    FileError
        For contents that a file cannot hold, such as a block that is not registered.

    Examples
    --------
    >>> import tsmblocks as tsm
    >>> print(tsm.dumps(tsm.load("tendon_sheath_linear")).splitlines()[0])
    format = 1
    """
    from tsmblocks.files.writer import text_of

    if not isinstance(diagram, Diagram):
        raise FileError("dumps", [f"only a Diagram can be written, got {in_words(diagram)}."])
    return text_of(diagram)


def save(diagram: Diagram, path: str | os.PathLike[str]) -> None:
    """Write a diagram to a file.

    An existing file is replaced in one step, so that a reader finds the old or the new file, never a part of one.

    Parameters
    ----------
    diagram : Diagram
        The diagram.
    path : str or path
        File, which ends in ``.toml`` if it has an ending.

    Raises
    ------
    FileError
        For contents that a file cannot hold, for another ending, and where the file cannot be written.

    Examples
    --------
    >>> import tsmblocks as tsm
    >>> diagram = tsm.load("motor_linear")
    >>> tsm.save(diagram, "motor.toml")  # doctest: +SKIP
    """
    text = dumps(diagram)
    if not isinstance(path, (str, os.PathLike)):
        raise FileError("save", [f"a file is named by text or a path, got {in_words(path)}."])
    if Path(path).suffix.lower() not in ("", ".toml"):
        raise FileError("save", [f"'{clip(str(path))}' must end in .toml, since a diagram is written as TOML."])
    try:
        replace_file(path, text)
    except (OSError, ValueError) as error:
        reason = (getattr(error, "strerror", None) or str(error)).lower()
        raise FileError(clip(str(path)), [f"{clip(str(path))}: cannot be written: {reason}."]) from None


def _path_of(given: str | os.PathLike[str]) -> Path:
    """The file that a name or path means."""
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
            clip(text), [f"'{text}' is not among the ready-made diagrams. For the file, write '{text}.toml'."]
        )
    hint = near(text, shipped_names(), otherwise=" `tsmblocks diagrams` lists them.")
    raise FileError(clip(text), [f"there is no file '{clip(text)}', and no ready-made diagram of that name.{hint}"])


def _is_file(path: Path) -> bool:
    try:
        return path.is_file()
    except OSError:  # a name too long to be one
        return False


def _fill_registry() -> None:
    """Register every block of the toolbox; a file may name these and the user's own."""
    import tsmblocks.blocks  # noqa: F401 - imported for what it registers
