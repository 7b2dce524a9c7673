"""One block of a diagram file: of a type, from another file, or a diagram written in place.

Types are looked up among the registered blocks and other files are read as text; no file can cause an import or run
code.
"""

from __future__ import annotations

from collections.abc import Iterator, Mapping, Sequence
from pathlib import Path, PureWindowsPath
from typing import TYPE_CHECKING, Any

from tsmblocks.common.errors import DiagramError, FileError, ParameterError, TsmError, clip, in_words, near
from tsmblocks.files.faults import DIAGRAM_KEYS, REFUSED, UNEXPECTED_ERRORS, KeyPath, Part, dotted_name, misspelt_keys
from tsmblocks.files.shipped import shipped_folder, shipped_names
from tsmblocks.files.toml_text import load_text, parse_tables
from tsmblocks.model.aliases import block_hint, field_hint
from tsmblocks.model.arguments import DEEPEST
from tsmblocks.model.block import REGISTRY, Block, plain, validate
from tsmblocks.model.diagram import Diagram

if TYPE_CHECKING:
    from tsmblocks.files.reader import DiagramPage

FAULTY = Part(None, 1)
"""A block that could not be read."""
OWN_BLOCKS_HINT = " A block of your own is known once its module is imported (by a command: --with FILE.py)."
"""Hint for an unknown type without a near miss."""
TOO_DEEP = f"diagrams are nested more than {DEEPEST} deep."
"""Fault of a diagram inside of others, in this file or by files that use each other."""
LONGEST_TEXT = 10_000
"""Characters of one option: a sum has an input for each sign. Chosen: far above any real block."""


def read_block(page: DiagramPage, name: str, spec: Any, path: KeyPath, level: int) -> Part:
    """The block that ``spec`` describes; its faults are collected by the page."""
    if not isinstance(spec, dict):
        above = f" To give the diagram's {name}, move the line above the first [section]."
        expected = f"block '{clip(name)}' must be a table such as {{ type = \"Gain\" }}"
        page.wrong(path, expected, spec, above if name in DIAGRAM_KEYS else "")
        return FAULTY
    if "type" in spec:
        return Part(_typed(page, spec, path), 1)
    if "use" in spec:
        return _used(page, spec, path, level)
    if not spec.keys() & set(DIAGRAM_KEYS):
        meant = misspelt_keys(spec, ("type", "use")).items()
        hint = next((f" Is '{key}' meant to be '{word}'?" for key, word in meant), "")
        text = f"block '{dotted_name(path)}' has no type. Write {{ type = \"Gain\" }}, or use = another diagram."
        page.fault(path, f"{text}{hint}")
        return FAULTY
    if level >= DEEPEST:
        page.fault(path, TOO_DEEP)
        return FAULTY
    return page.diagram(spec, path, level + 1)


# ---- a block of a type ------------------------------------------------------------------------


def _typed(page: DiagramPage, spec: dict[str, Any], path: KeyPath) -> Block | None:
    """A block of a registered type."""
    kind = spec["type"]
    if not isinstance(kind, str):
        expected = f"block '{dotted_name(path)}': the type must be text such as \"Gain\""
        page.wrong((*path, "type"), expected, kind)
        return None
    cls = REGISTRY.get(kind)
    if cls is None:
        hint = block_hint(kind, REGISTRY, OWN_BLOCKS_HINT)
        page.block_fault(path, f"there is no block type '{clip(kind)}'.{hint}", "type")
        return None
    values = {k: v for k, v in spec.items() if k != "type"}
    faults = {k: _fault_of(cls, k, v) for k, v in values.items() if v is not REFUSED}
    for key, fault in faults.items():
        if fault:
            page.block_fault(path, fault, key)
    return _built(page, cls, values, path) if len(faults) == len(values) and not any(faults.values()) else None


def _fault_of(cls: type[Block], key: str, value: Any) -> str:
    """The fault of one value, ``""`` if there is none."""
    field = cls.fields().get(key)
    if field is None:
        return f"{cls.__name__} has no parameter '{clip(key)}'.{field_hint(key, cls.fields())}"
    if isinstance(value, str) and len(value) > LONGEST_TEXT:
        return f"{cls.__name__}.{key} is a text of {len(value):,} characters; at most {LONGEST_TEXT:,} are read."
    if _holds_table(value):
        return f"{cls.__name__}.{key} cannot be a table, got {in_words(value)}. It is: {field.about}."
    try:
        validate(cls.__name__, key, field, plain(value))
    except ParameterError as error:
        return str(error)
    return ""


def _holds_table(value: Any) -> bool:
    """Whether a value is a table, or a list with one."""
    return isinstance(value, dict) or (isinstance(value, list) and any(map(_holds_table, value)))


def _built(page: DiagramPage, cls: type[Block], values: dict[str, Any], path: KeyPath) -> Block | None:
    """The block, or None if its values are inconsistent."""
    try:
        fixed = {k: f for k, f in cls.fields().items() if f.omitted is not None or f.opposite}
        meant = {k: field.default_in_files for k, field in fixed.items()}
        block = cls(**{**meant, **values})
        _ = block.inports, block.outports, block.states  # these may depend on options that check() does not read
    except TsmError as error:
        page.block_fault(path, str(error))
    except UNEXPECTED_ERRORS as error:
        page.block_fault(path, f"{cls.__name__} cannot be made of these values: {clip(str(error))}.")
    else:
        return block
    return None


# ---- another file -----------------------------------------------------------------------------


def _used(page: DiagramPage, spec: dict[str, Any], path: KeyPath, level: int) -> Part:
    """The diagram of another file, with the parameters that ``set`` gives it."""
    said = f"block '{dotted_name(path)}'"
    page.known_keys(spec, ("use", "set"), path, f"{said}, which uses another diagram")
    name, changes = spec["use"], spec.get("set", {})
    if not isinstance(name, str):
        page.wrong((*path, "use"), f"{said}: use must name a diagram", name)
        return FAULTY
    file = _find(page, name, path)
    part = FAULTY if file is None else _read_other(page, file, path, level)
    if not isinstance(changes, dict):
        page.wrong((*path, "set"), f'{said}: set must be a table such as {{ "drive.high" = 12.0 }}', changes)
        return FAULTY
    if not isinstance(part.block, Diagram) or not changes:
        return part
    return Part(_with_changes(page, part.block, dict(_flattened(changes)), path), part.size)


def _find(page: DiagramPage, name: str, path: KeyPath) -> Path | None:
    """The file that ``use`` names: next to this one, or below, or among the ready-made diagrams."""
    windows, found = PureWindowsPath(name), None
    file = name if name.endswith(".toml") else f"{name}.toml"
    folders = [page.folder] if "/" in name else [page.folder, shipped_folder()]
    if not name.strip() or name != name.strip() or "\\" in name or not name.isprintable():
        fault = "is not the name of a diagram."
    elif windows.drive or windows.root or ".." in windows.parts:
        fault = "is outside the folder of this file. Name a diagram next to it or below."
    else:
        try:
            found = next((f / file for f in folders if f is not None and (f / file).is_file()), None)
            beside = [p.stem for p in page.folder.glob("*.toml")] if page.folder is not None else []
            hint = "" if found else near(name, [*beside, *shipped_names()])
            fault = f"is neither next to this file nor among the ready-made diagrams.{hint}"
        except OSError as error:
            fault = f"cannot be read: {(error.strerror or str(error)).lower()}."
    if found is None:
        page.block_fault(path, f"use = '{clip(name)}' {fault}", "use")
    return found


def _read_other(page: DiagramPage, file: Path, path: KeyPath, level: int) -> Part:
    """The diagram in another file, read once however often it is used."""
    reading, key = page.reading, file.resolve()
    if key in reading.open:
        ring = " -> ".join(p.name for p in [*reading.open[reading.open.index(key) :], key])
        page.block_fault(path, f"the files use each other in a cycle: {ring}.", "use")
        return FAULTY
    if key in reading.done:
        return reading.done[key]
    if level >= DEEPEST:
        page.fault((*path, "use"), TOO_DEEP)
        return FAULTY
    reading.open.append(key)
    part = FAULTY
    try:
        table, places = parse_tables(load_text(file), str(file))
        part = type(page)(reading, str(file), places, file.parent).whole(table, level + 1)
    except FileError as error:
        for problem in error.problems:
            reading.add(problem)
    reading.open.pop()
    reading.done[key] = part
    return part


def _flattened(table: Mapping[str, Any], prefix: str = "") -> Iterator[tuple[str, Any]]:
    """Names and values of a table: ``drive.high``, whether written with dots, quotes or tables."""
    for key, value in table.items():
        if isinstance(value, dict):
            yield from _flattened(value, f"{prefix}{key}.")
        else:
            yield prefix + key, value


def _with_changes(page: DiagramPage, diagram: Diagram, changes: dict[str, Any], path: KeyPath) -> Diagram | None:
    """A diagram with the parameters that ``set`` gives it."""
    known = set(diagram.parameter_names())
    strange = [name for name in changes if name not in known]
    for name in strange:
        page.block_fault(path, f"set: there is no parameter '{clip(name)}'.{near(name, known)}", "set", name)
    if strange or REFUSED in changes.values():
        return None
    try:
        return diagram.with_parameters(changes)
    except DiagramError as error:
        problems: Sequence[str] = error.problems
    except (TsmError, *UNEXPECTED_ERRORS) as error:
        problems = [clip(str(error), 300)]
    for problem in problems:
        page.block_fault(path, f"set: {problem}", "set")
    return None
