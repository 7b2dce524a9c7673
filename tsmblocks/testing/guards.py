"""Guards from TOML files: ``NAME.tracking.toml`` beside its baselines ``NAME.baseline.toml``."""

from __future__ import annotations

from collections.abc import Iterator, Mapping
from pathlib import Path
from typing import Any

from tsmblocks.errors import FileError, TsmError, in_words, near
from tsmblocks.file_text import read, tables
from tsmblocks.files import load_beside
from tsmblocks.testing.tracking import Guard, guard

KEYS = ("format", "title", "diagram", "stop", "step", "method", "tolerance", "metrics", "set", "cases")
FORMAT = 1


def read_guards(path: Path) -> dict[str, Guard]:
    """The guards of a file, by case; the case of a file without ``[cases]`` has no name.

    A metric is a text, or ``{ of = "rms(u)", tolerance = "loose" }``; a case is a table of parameters. Raises FileError
    with the line.
    """
    table, places = tables(read(path), str(path))

    def refuse(text: str, *place: str) -> FileError:
        line = places.line(*place)
        return FileError(str(path), [f"{path}{f':{line}' if line else ''}: {text}"])

    for text, place in _faults(table):
        raise refuse(text, *place)
    wanted, classes = _metrics(table.get("metrics"), table.get("tolerance", "normal"))
    how = {k: table[k] for k in ("stop", "step", "method") if k in table}
    made = {}
    for case, changes in (table.get("cases") or {"": {}}).items():
        try:
            diagram = load_beside(path.parent, table["diagram"]).with_parameters(table.get("set", {}))
            made[case] = guard(diagram, wanted, tolerance=classes, parameters=changes, **how)
        except FileError as error:
            raise refuse(error.problems[0], "diagram") from None
        except TsmError as error:
            raise refuse(str(error), *(("cases", case) if case else ("diagram",))) from None
    return made


def _faults(table: Mapping[str, Any]) -> Iterator[tuple[str, tuple[str, ...]]]:
    """What is wrong with a file, and where."""
    for key in table:
        if key not in KEYS:
            yield f"there is no '{key}' in a guard.{near(key, KEYS, 12)}", (key,)
    if table.get("format") != FORMAT:
        yield f"format = {FORMAT} is needed, got {in_words(table.get('format'))}.", ("format",)
    for key in ("metrics", "set", "cases"):
        if not isinstance(table.get(key, {}), dict):
            yield f"'{key}' must be a table: [{key}].", (key,)
    if not isinstance(table.get("diagram"), str):
        yield 'a guard needs its diagram: diagram = "fig16_feedforward_feedback".', ("diagram",)
    yield from _wrong_values(table)


def _wrong_values(table: Mapping[str, Any]) -> Iterator[tuple[str, tuple[str, ...]]]:
    for key in ("stop", "step"):
        if key in table and (not isinstance(table[key], (int, float)) or isinstance(table[key], bool)):
            yield f"'{key}' must be a number, got {in_words(table[key])}.", (key,)
    for name, one in table.get("metrics", {}).items():
        for key in one if isinstance(one, dict) else ():
            if key not in ("of", "tolerance"):
                yield f"a metric has no '{key}'.{near(key, ('of', 'tolerance'))}", ("metrics", name)


def _metrics(given: Any, usual: Any) -> tuple[Any, Any]:
    """Texts of metrics by name, and the class of each."""
    from tsmblocks.metrics import named

    if given is None:
        return None, usual
    texts = {k: v["of"] if isinstance(v, dict) and "of" in v else v for k, v in given.items()}
    classes = {named(k)[0]: v.get("tolerance", usual) if isinstance(v, dict) else usual
               for k, v in given.items()}  # fmt: skip
    return texts, classes
