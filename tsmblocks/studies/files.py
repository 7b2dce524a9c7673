"""Studies as TOML files: which diagram, what varies, what is measured. No text of a file is ever executed.

Format 1 has what ``page`` says, ``stop``, ``step``, ``method``, ``hold``, ``[plan]`` and ``[vary]``.
"""

from __future__ import annotations

import math
from collections.abc import Callable, Mapping
from pathlib import Path
from typing import Any

import numpy as np

from tsmblocks.common.arguments import as_number
from tsmblocks.common.errors import ParameterError, TsmError, in_words, near
from tsmblocks.model.diagram import Diagram
from tsmblocks.model.parameters import near_path
from tsmblocks.studies.distributions import Distribution, Normal, Uniform
from tsmblocks.studies.page import RunPage
from tsmblocks.studies.plans import MAX_RUNS, Plan, grid, latin_hypercube, monte_carlo, sweep
from tsmblocks.studies.study import filled_plan

KEYS = ("format", "title", "diagram", "stop", "step", "method", "hold", "set", "metrics", "plan", "vary")
"""Keys of a study file."""
RANDOM_PLANS: dict[str, Callable[..., Plan]] = {"latin_hypercube": latin_hypercube, "monte_carlo": monte_carlo}
"""Kinds of plans whose parameters have distributions."""
PLANS: dict[str, Callable[..., Plan]] = {"grid": grid, "sweep": sweep, **RANDOM_PLANS}
"""Kinds of plans, and what makes them."""
DISTRIBUTION_FORMS = ('low and high (and scale = "log")', "mean and deviation", "relative, a share")
"""How the distribution of a parameter is written, as messages show it."""


def load_study(path: str | Path) -> dict[str, Any]:
    """The arguments of ``study`` that a file has. Raises FileError with every fault and its line."""
    page = _StudyPage(path, "study", KEYS)
    diagram, arguments = page.named_diagram(), page.run_arguments(("stop", "step"), ("method", "hold"))
    arguments |= {"diagram": diagram, "title": page.text(page.content, "title", ())}
    arguments["metrics"] = page.section("metrics") if "metrics" in page.content else None
    if diagram is not None:
        arguments["plan"] = page.plan(diagram)
        page.check_metrics(arguments["metrics"], diagram)
    page.raise_faults()
    return arguments


class _StudyPage(RunPage):
    """A study file that is being read: what varies, by which plan."""

    def plan(self, diagram: Diagram) -> Plan | None:
        """The plan of ``[plan]`` and ``[vary]``; None where it has a fault."""
        plan, vary = self.section("plan"), self.section("vary")
        kind = plan.get("kind", "grid")
        if kind not in [*PLANS]:
            self.fault(("plan", "kind"), f"there is no plan {in_words(kind)}.{near(kind, PLANS)}")
            return None
        random = kind in RANDOM_PLANS
        self.known_keys(plan, ("kind", "runs", "seed") if random else ("kind",), ("plan",), f"a {kind}")
        if not vary:
            self.fault(("vary",), 'no parameter varies: write [vary] with lines such as "pid.kp" = [1.0, 1.5, 2.0].')
            return None
        if random and "runs" not in plan:
            self.fault(("plan",), f"a {kind} needs runs = …, how many.")
            return None
        sets = {k: (self.distribution if random else self.values)(k, v, diagram) for k, v in vary.items()}
        if any(v is None for v in sets.values()):
            return None
        sizes = {k: plan[k] for k in ("runs", "seed") if random and k in plan}
        made: Plan | None = self.attempt(lambda: PLANS[kind](sets, **sizes), "plan")
        if made is not None:
            self.attempt(lambda: filled_plan(diagram, made), "vary")
        return made

    def values(self, name: str, given: Any, diagram: Diagram) -> list[Any] | None:
        """Values of a grid or sweep: a list, or low, high and count."""
        if not self.varies(name, diagram):
            return None
        if isinstance(given, list):
            return given
        if isinstance(given, dict) and {"low", "high", "count"} <= given.keys() <= {"low", "high", "count", "scale"}:
            uniform, count = self.attempt(lambda: _uniform(given), "vary", name), given["count"]
            if not isinstance(count, int) or isinstance(count, bool) or not 2 <= count <= MAX_RUNS:
                self.wrong(("vary", name), f"count must be a whole number from 2 to {MAX_RUNS:,}", count)
                return None
            return None if uniform is None else uniform.quantile(np.linspace(0.0, 1.0, count)).tolist()
        self.wrong(("vary", name), f"'{name}' needs a list of values, or {{ low = …, high = …, count = … }}", given)
        return None

    def distribution(self, name: str, given: Any, diagram: Diagram) -> Distribution | None:
        """The distribution of a parameter of a random plan."""
        if not self.varies(name, diagram):
            return None
        if name not in diagram.parameters:
            self.fault(("vary", name), f"'{name}' is an option, and a random plan varies numbers. Use a grid for it.")
            return None
        if isinstance(given, list) and len(given) == 2:
            given = {"low": given[0], "high": given[1]}
        shapes: tuple[tuple[set[str], set[str], Callable[[], Distribution]], ...] = (
            ({"low", "high"}, {"scale"}, lambda: _uniform(given)),
            ({"mean", "deviation"}, {"low", "high"}, lambda: Normal(**given)),
            ({"relative"}, set(), lambda: _relative(diagram.parameters[name], given["relative"])),
        )
        for needed, more, make in shapes:
            if isinstance(given, dict) and needed <= given.keys() <= needed | more:
                return self.attempt(make, "vary", name)
        self.fault(("vary", name), f"'{name}' varies by {', by '.join(DISTRIBUTION_FORMS)}; got {in_words(given)}.")
        return None

    def varies(self, name: str, diagram: Diagram) -> bool:
        known = [*diagram.parameters, *diagram.parameter_names()]
        if name not in known:
            self.fault(("vary", name), f"diagram '{diagram.title}' has no parameter '{name}'.{near_path(name, known)}")
        return name in known


def _uniform(given: Mapping[str, Any]) -> Uniform:
    scale = given.get("scale", "linear")
    if scale not in ("linear", "log"):
        raise TsmError(f'scale is "linear" or "log", got {in_words(scale)}.')
    return Uniform(given["low"], given["high"], log=scale == "log")


def _relative(value: float, share: Any) -> Normal:
    """A normal distribution around a diagram's own number, its deviation a share of it; the sign stays."""
    if value == 0:
        raise TsmError("the diagram's own value is 0, so a share of it is 0; give mean and deviation.")
    low, high = (0.0, math.inf) if value > 0 else (-math.inf, 0.0)
    return Normal(value, abs(value) * as_number("relative", share, ParameterError), low, high)
