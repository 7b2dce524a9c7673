"""The sections ``[simulation]`` and ``[start.RECORDING]``: how a diagram was simulated on recordings."""

from __future__ import annotations

from collections.abc import Iterator, Mapping
from typing import Any

from tsmblocks.common.errors import ParameterError, clip, near
from tsmblocks.files.faults import REFUSED, Page
from tsmblocks.model.diagram import Diagram
from tsmblocks.model.parameters import near_path
from tsmblocks.model.simulation import Simulation

SIMULATION_KEYS = ("simulation", "start")
"""Sections of a file, beside those of its diagram."""
KEYS = ("step", "method", "hold", "condition", "stop_when")
"""Keys of ``[simulation]``."""


def read_simulation(page: Page, table: dict[str, Any], diagram: Diagram) -> Simulation:
    """The settings that a file gives; faults are collected, and faulty settings left out."""
    given = page.table(table, "simulation", ())
    page.known_keys(given, KEYS, ("simulation",), "[simulation]")
    made: dict[str, Any] = {}
    for key in KEYS:
        if key in given and given[key] is not REFUSED:
            _take(page, made, key, given[key], ("simulation", key))
    for key in ("hold", "condition"):
        value = made.get(key, ())
        for name in () if isinstance(value, str) else value:
            if name not in diagram.inputs:
                page.fault(("simulation", key), f"{key}: there is no input '{clip(name)}'.{near(name, diagram.inputs)}")
    return Simulation(**made, start=_starts(page, page.table(table, "start", ()), diagram))


def _take(page: Page, made: dict[str, Any], key: str, value: Any, at: tuple[str, ...]) -> None:
    """Take a setting, unless it is refused."""
    if key == "condition" and not (isinstance(value, list) and all(isinstance(one, str) for one in value)):
        page.wrong(at, 'condition must be a list of inputs such as ["x_in"]', value)
        return
    try:
        Simulation(**{key: value})
    except ParameterError as error:
        page.fault(at, str(error))
        return
    made[key] = value


def _starts(page: Page, given: Mapping[str, Any], diagram: Diagram) -> dict[str, dict[str, float]]:
    """Initial states by recording."""
    made, known = dict[str, dict[str, float]](), diagram.parameters
    for name, states in given.items():
        at = ("start", name)
        if not isinstance(states, dict):
            page.wrong(at, f"start.{clip(name)} must be a table of initial states", states)
            continue
        for key, value, path in _leaves(states, at):
            if key not in known:
                page.fault(path, f"the diagram has no state '{clip(key)}'.{near_path(key, known)}")
            elif isinstance(value, bool) or not isinstance(value, (int, float)):
                page.wrong(path, f"the start of '{key}' must be a number", value)
            else:
                made.setdefault(name, {})[key] = float(value)
    return made


def _leaves(
    table: Mapping[str, Any], at: tuple[str, ...], prefix: str = ""
) -> Iterator[tuple[str, Any, tuple[str, ...]]]:
    """Full name, value and path of each state: ``"tsm.zeta" = 0.1`` and ``tsm.zeta = 0.1`` are the same."""
    for key, value in table.items():
        if isinstance(value, dict):
            yield from _leaves(value, (*at, key), f"{prefix}{key}.")
        else:
            yield f"{prefix}{key}", value, (*at, key)
