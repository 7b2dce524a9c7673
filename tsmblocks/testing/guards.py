"""Guards from TOML files: ``NAME.tracking.toml`` beside its baselines ``NAME.baseline.toml``."""

from __future__ import annotations

from collections.abc import Mapping
from functools import partial
from pathlib import Path
from typing import Any

from tsmblocks.metrics.metrics import named
from tsmblocks.studies.page import RunPage
from tsmblocks.testing.tracking import Guard, guard

KEYS = ("format", "title", "diagram", "stop", "step", "method", "tolerance", "metrics", "set", "cases")
"""Keys of a guard file."""


def read_guards(path: Path) -> dict[str, Guard]:
    """The guards of a file, by case; the case of a file without ``[cases]`` has no name.

    A metric is a text, or ``{ of = "rms(u)", tolerance = "loose" }``; a case is a table of parameters. Raises FileError
    with every fault and its line.
    """
    page = RunPage(path, "guard", KEYS)
    diagram, how = page.named_diagram(), page.run_arguments(("stop", "step"), ("method",))
    usual = page.value("a class of tolerance", str, page.content.get("tolerance", "normal"), "tolerance")
    given = page.section("metrics") if "metrics" in page.content else None
    read = {name: _metric(page, name, one, usual) for name, one in (given or {}).items()}
    texts = None if given is None else {name: text for name, (text, _) in read.items()}
    classes = usual if given is None else {named(name)[0]: kind for name, (_, kind) in read.items()}
    cases = {k: page.value("a table of parameters", dict, v, "cases", k) for k, v in page.section("cases").items()}
    if diagram is None:
        page.raise_faults()
    assert diagram is not None
    for name, (text, kind) in read.items():
        if text is not None:
            page.attempt(partial(guard, diagram, {name: text}, {named(name)[0]: kind}, {}), "metrics", name)
    page.raise_faults()
    made = {}
    for case, changes in (cases or {"": {}}).items():
        place = ("cases", case) if case else ("metrics" if given is not None else "diagram",)
        made[case] = page.attempt(partial(guard, diagram, texts, classes, how, changes), *place)
    page.raise_faults()
    return made


def _metric(page: RunPage, name: str, given: Any, usual: str) -> tuple[Any, Any]:
    """Text and tolerance class of a metric, which is a text or a table of both; None where there is no text."""
    if not isinstance(given, Mapping):
        return given, usual
    page.known_keys(given, ("of", "tolerance"), ("metrics", name), "a metric")
    if "of" not in given:
        expected = '{ of = "rms(u)", tolerance = "loose" }'
        page.fault(("metrics", name), f"a metric with a tolerance has its text under of: {expected}.")
    return given.get("of"), given.get("tolerance", usual)
