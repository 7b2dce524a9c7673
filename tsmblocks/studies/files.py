"""Studies as TOML files: which diagram, what varies, what is measured. Nothing that a file says is ever run.

Format 1 has ``title``, ``diagram`` (a ready-made one, or a file beside this one), ``stop``, ``step``, ``method``,
``[set]`` for numbers that all runs have, ``[metrics]``, ``[plan]`` and ``[vary]``.
"""

from __future__ import annotations

import math
from collections.abc import Callable, Mapping
from functools import partial
from pathlib import Path
from typing import Any

import attrs

from tsmblocks.diagram import Diagram
from tsmblocks.errors import FileError, TsmError, in_words, near
from tsmblocks.file_places import Places
from tsmblocks.file_text import read, tables
from tsmblocks.files import load_beside
from tsmblocks.metrics import metric, metrics
from tsmblocks.studies.plans import MOST, Belief, Normal, Plan, Uniform, grid, latin_hypercube, monte_carlo, sweep
from tsmblocks.studies.study import own_numbers, signal_units

FORMAT = 1
KEYS = ("format", "title", "diagram", "stop", "step", "method", "hold", "set", "metrics", "plan", "vary")
PLANS = ("grid", "sweep", "latin_hypercube", "monte_carlo")
RANDOM = PLANS[2:]
VARIES = ('low and high (and scale = "log")', "mean and deviation", "relative, a share")
"""Ways in which a number of a random plan varies."""


@attrs.frozen(eq=False)
class StudyFile:
    """What a file asks for: arguments of ``study``, by name in ``how``."""

    title: str
    diagram: Diagram
    plan: Plan
    metrics: Mapping[str, str] | None
    how: Mapping[str, Any]


def load_study(path: str | Path) -> StudyFile:
    """Read a study from a file. Raises FileError with every fault and its line."""
    where = Path(path)
    table, places = tables(read(where), str(where))
    return _Page(str(where), places, where.parent).whole(table)


class _Page:
    """One file that is being read, and the faults found so far."""

    def __init__(self, where: str, places: Places, folder: Path) -> None:
        self.where, self.places, self.folder = where, places, folder
        self.faults: list[tuple[int, str]] = []

    def whole(self, table: dict[str, Any]) -> StudyFile:
        for key in table:
            if key not in KEYS:
                self.fault(f"there is no '{key}' in a study.{near(key, KEYS, 12)}", key)
        if table.get("format") != FORMAT:
            self.fault(f"format = {FORMAT} is needed, got {in_words(table.get('format'))}.", "format")
        diagram = self.diagram(table)
        how: dict[str, Any] = {k: self.of("a number", float, table[k], k) for k in ("stop", "step") if k in table}
        how |= {k: self.of("a text", str, table[k], k) for k in ("method", "hold") if k in table}
        title = self.of("a text", str, table.get("title", ""), "title") or (diagram.title if diagram else "")
        asked = self.section(table, "metrics") if "metrics" in table else None
        plan = self.plan(table, diagram) if diagram is not None else None
        if diagram is not None:
            self.metrics(asked, diagram)
        if self.faults or diagram is None or plan is None:
            raise FileError(self.where, [f"{self.where}{f':{line}' if line else ''}: {text}"
                                         for line, text in sorted(self.faults)])  # fmt: skip
        return StudyFile(title, diagram, plan, asked, how)

    def fault(self, text: str, *path: str) -> None:
        self.faults.append((self.places.line(*path) or 0, text))

    def of(self, what: str, kind: type, value: Any, *path: str) -> Any:
        """A value of a kind, or None where it is something else."""
        if kind is float and isinstance(value, (int, float)) and not isinstance(value, bool) and math.isfinite(value):
            return float(value)
        if kind is not float and isinstance(value, kind) and not isinstance(value, bool):
            return value
        self.fault(f"'{'.'.join(path)}' must be {what}, got {in_words(value)}.", *path)
        return None

    def section(self, table: Mapping[str, Any], key: str) -> dict[str, Any]:
        return self.of(f"a table: [{key}]", dict, table.get(key, {}), key) or {}

    def tried(self, make: Callable[[], Any], *path: str) -> Any:
        """What is made, or None where it is refused."""
        try:
            return make()
        except FileError as error:
            for problem in error.problems:
                self.fault(problem, *path)
        except TsmError as error:
            self.fault(str(error), *path)
        return None

    def diagram(self, table: Mapping[str, Any]) -> Diagram | None:
        if "diagram" not in table:
            self.fault('a study needs its diagram: diagram = "fig16_feedforward_feedback".')
            return None
        name = self.of("the name or file of a diagram", str, table["diagram"], "diagram")
        if name is None:
            return None
        found = self.tried(partial(load_beside, self.folder, name), "diagram")
        for key, value in self.section(table, "set").items() if found is not None else ():
            found = self.tried(partial(found.with_parameters, {key: value}), "set", key) or found
        return found

    def metrics(self, asked: dict[str, Any] | None, diagram: Diagram) -> None:
        known = signal_units(diagram)
        if asked is None:
            self.tried(lambda: metrics(None, known), "diagram")
            return
        for name, text in asked.items():
            self.tried(partial(metric, text, known, name), "metrics", name)

    def plan(self, table: Mapping[str, Any], diagram: Diagram) -> Plan | None:
        plan, vary = self.section(table, "plan"), self.section(table, "vary")
        kind = plan.get("kind", "grid")
        if kind not in PLANS:
            self.fault(f"there is no plan {in_words(kind)}.{near(kind, PLANS)}", "plan", "kind")
            return None
        allowed = ("kind", "runs", "seed") if kind in RANDOM else ("kind",)
        for key in plan:
            if key not in allowed:
                self.fault(f"a {kind} takes no '{key}'.{near(key, allowed)}", "plan", key)
        if not vary:
            self.fault('say what varies: [vary] with lines such as "pid.kp" = [1.0, 1.5, 2.0].', "vary")
            return None
        if kind in RANDOM and "runs" not in plan:
            self.fault(f"a {kind} needs runs = …, how many.", "plan")
            return None
        made = {k: (self.belief if kind in RANDOM else self.values)(k, v, diagram) for k, v in vary.items()}
        if any(v is None for v in made.values()):
            return None
        build: Callable[[], Plan] = {
            "grid": lambda: grid(made), "sweep": lambda: sweep(made),
            "latin_hypercube": lambda: latin_hypercube(made, plan["runs"], seed=plan.get("seed", 0)),
            "monte_carlo": lambda: monte_carlo(made, plan["runs"], seed=plan.get("seed", 0)),
        }[kind]  # fmt: skip
        found = self.tried(build, "plan")
        if found is not None:
            self.tried(lambda: own_numbers(diagram, found), "vary")
        return found

    def values(self, name: str, given: Any, diagram: Diagram) -> list[Any] | None:
        """Values of a grid or sweep: a list, or low, high and count."""
        if not self.varies(name, diagram):
            return None
        if isinstance(given, list):
            return given
        if isinstance(given, dict) and {"low", "high", "count"} <= given.keys() <= {"low", "high", "count", "scale"}:
            between = self.tried(lambda: _uniform(given), "vary", name)
            count = given["count"]
            if not isinstance(count, int) or isinstance(count, bool) or not 2 <= count <= MOST:
                self.fault(f"count must be a whole number from 2 to {MOST:,}, got {in_words(count)}.", "vary", name)
                return None
            import numpy as np

            return None if between is None else [float(v) for v in between.quantile(np.linspace(0.0, 1.0, count))]
        self.fault(f"'{name}' needs a list of values, or {{ low = …, high = …, count = … }}, got {in_words(given)}.",
                   "vary", name)  # fmt: skip
        return None

    def belief(self, name: str, given: Any, diagram: Diagram) -> Belief | None:
        """How a number of a random plan varies."""
        if not self.varies(name, diagram):
            return None
        if name not in diagram.parameters:
            self.fault(f"'{name}' is an option, and a random plan varies numbers. Use a grid for it.", "vary", name)
            return None
        if isinstance(given, list) and len(given) == 2:
            given = {"low": given[0], "high": given[1]}
        shapes: tuple[tuple[set[str], set[str], Callable[[], Belief]], ...] = (
            ({"low", "high"}, {"scale"}, lambda: _uniform(given)),
            ({"mean", "deviation"}, {"low", "high"}, lambda: Normal(**{k: _number(v) for k, v in given.items()})),
            ({"relative"}, set(), lambda: _relative(diagram.parameters[name], _number(given["relative"]))),
        )
        for needed, more, make in shapes:
            if isinstance(given, dict) and needed <= given.keys() <= needed | more:
                return self.tried(make, "vary", name)
        self.fault(f"'{name}' varies by {', by '.join(VARIES)}; got {in_words(given)}.", "vary", name)
        return None

    def varies(self, name: str, diagram: Diagram) -> bool:
        known = [*diagram.parameters, *diagram.parameter_names()]
        if name not in known:
            self.fault(f"diagram '{diagram.title}' has no parameter '{name}'.{near(name, known)}", "vary", name)
        return name in known


def _uniform(given: Mapping[str, Any]) -> Uniform:
    scale = given.get("scale", "linear")
    if scale not in ("linear", "log"):
        raise TsmError(f'scale is "linear" or "log", got {in_words(scale)}.')
    return Uniform(_number(given["low"]), _number(given["high"]), log=scale == "log")


def _relative(value: float, share: float) -> Normal:
    """A normal belief around a diagram's own number, its deviation a share of it; the sign stays."""
    if value == 0:
        raise TsmError("the diagram's own number is 0, so a share of it is nothing; say mean and deviation.")
    return Normal(value, abs(value) * share, *((0.0, math.inf) if value > 0 else (-math.inf, 0.0)))


def _number(value: Any) -> float:
    if not isinstance(value, (int, float)) or isinstance(value, bool):
        raise TsmError(f"a number is wanted, got {in_words(value)}.")
    return float(value)
