"""Limits of tuning: on metrics of the runs, and on stability margins of a loop opened at a wire."""

from __future__ import annotations

import ast
import math
import re
from collections.abc import Mapping
from typing import Any

import attrs

from tsmblocks.analysis import Point, trim
from tsmblocks.analysis.crossings import stability_margins
from tsmblocks.analysis.linearization import end_of_run
from tsmblocks.analysis.loops import opened_loop
from tsmblocks.common.errors import ParameterError, TsmError, clip, in_words, near
from tsmblocks.metrics.metrics import Metric, metric
from tsmblocks.model.diagram import Diagram
from tsmblocks.simulation.arguments import RunOptions
from tsmblocks.simulation.run import Run
from tsmblocks.simulation.simulate import simulate
from tsmblocks.simulation.stability import no_step_warnings
from tsmblocks.tuning.smooth_metrics import differentiable

SIGNS = {ast.LtE: 1.0, ast.Lt: 1.0, ast.GtE: -1.0, ast.Gt: -1.0}
"""Sign of a limit by its comparison: 1 for an upper, -1 for a lower one."""
MARGINS = {"gain_margin": ("", 1e3), "phase_margin": ("deg", 180.0)}
"""Margins by name: their unit, and the largest one, that of a loop without a crossover. Chosen."""
POINTS = ("end", "start", "trim")
"""Where margins can be taken: at the end of each case's run (by default), at its initial states, or at the equilibrium
next to the end of the run."""
PADE_ORDER = 5
"""Order of the Padé approximation of delays. Chosen: exact to 0.01 deg up to a phase of 180 deg."""
LIMIT_TOLERANCE = 1e-9
"""Excess of a limit, as a share of it, that is rounding. Chosen."""
LIMIT_MARGIN = 1e-3
"""Share of a limit by which a search stays within it. Chosen: its end is then not just beyond the limit."""


@attrs.frozen(eq=False)
class Limit:
    """An upper limit ``most``, a lower one where ``sign`` is -1, of a metric or of a margin at the wire ``at``.

    ``point`` is where a margin is taken, one of ``POINTS``.
    """

    text: str
    name: str
    most: float
    sign: float
    metric: Metric | None = None
    margin: str = ""
    at: str = ""
    point: str = "end"

    @property
    def unit(self) -> str:
        """Unit of the metric or margin."""
        return self.metric.unit if self.metric is not None else MARGINS[self.margin][0]

    def is_none(self, value: float) -> bool:
        """Whether a value is that of a loop without such a margin, since no gain or phase makes it unstable."""
        return bool(self.margin) and value >= MARGINS[self.margin][1]

    def excess(self, value: Any) -> Any:
        """Excess of values over the limit, as a share of it; negative within."""
        return self.sign * (value - self.most) / max(abs(self.most), 1e-9)

    def aimed(self, value: Any) -> Any:
        """As ``excess``, with ``LIMIT_MARGIN`` added unless the limit is zero."""
        return self.excess(value) + (LIMIT_MARGIN if self.most else 0.0)

    def margin_of(self, diagram: Diagram, options: RunOptions | None = None) -> float:
        """The margin of a diagram, linearised at its operating point; NaN where there is no linear model.

        ``options`` are those of the run at whose end it is taken; without them it is taken at the initial states. A
        gain margin is the smallest factor, up or down, that makes the loop unstable, below 1 where it is unstable
        already; the phase margin is negative where the loop is unstable. Where a block on the loop is at a limit
        the loop has no margin: a factor of 1, a phase of 0.
        """
        try:
            point = None if options is None else operating_point(self.point, diagram, options)
            loop = opened_loop(diagram, self.at, point=point, pade=PADE_ORDER)
        except TsmError:
            return math.nan
        gain, phase = (1.0, 0.0) if loop.blocked else stability_margins(loop.transfer)
        return min({"gain_margin": gain, "phase_margin": phase}[self.margin], MARGINS[self.margin][1])


def operating_point(kind: str, diagram: Diagram, options: RunOptions) -> Point | Run | None:
    """Where a margin is taken; None for the initial states. Raises TsmError."""
    if kind == "start":
        return None
    with no_step_warnings():
        run = simulate(diagram, log=[*diagram.inputs] or "outputs", **options.arguments)
    if kind == "end":
        return run
    end = end_of_run(run, diagram)
    return trim(diagram, inputs=end.inputs, start=end.states, t=end.t)


def limit(text: Any, units: Mapping[str, str], diagram: Diagram) -> Limit:
    """Read a limit such as ``"largest(u) <= 20"`` or ``"phase_margin('controller -> drive') >= 45"``.

    Raises ParameterError.
    """
    try:
        tree = ast.parse(str(text).strip(), mode="eval").body
    except (SyntaxError, ValueError):
        tree = None
    shown = f"'{clip(str(text))}'"
    if not isinstance(tree, ast.Compare) or len(tree.ops) != 1 or type(tree.ops[0]) not in SIGNS:
        share = re.search(r"(\d+\.?\d*) ?%\s*$", str(text))
        hint = f" {share[1]} % is written {float(share[1]) / 100:g}." if share else ""
        raise ParameterError(f"{shown} is no limit of a metric.{hint} Write for example 'largest(u) <= 20'.")
    try:
        most = float(ast.literal_eval(tree.comparators[0]))
    except (ValueError, TypeError):
        raise ParameterError(f"{shown}: the limit must be a plain number, on the right.") from None
    call, sign, name = tree.left, SIGNS[type(tree.ops[0])], ast.unparse(tree.left)
    if isinstance(call, ast.Call) and isinstance(call.func, ast.Name) and call.func.id in MARGINS:
        at, point = _wire_and_point(call, call.func.id, diagram)
        return Limit(str(text), name, most, sign, margin=call.func.id, at=at, point=point)
    try:
        one = metric(name, units)
    except TsmError as error:
        raise ParameterError(f"limit: {error}") from None
    differentiable(one)
    return Limit(str(text), name, most, sign, one)


def _wire_and_point(call: ast.Call, kind: str, diagram: Diagram) -> tuple[str, str]:
    """The wire that a margin names, and where it is taken, both checked."""
    where = call.args[0].value if len(call.args) == 1 and isinstance(call.args[0], ast.Constant) else None
    given = {one.arg: getattr(one.value, "value", None) for one in call.keywords}
    if not isinstance(where, str) or given.keys() - {"point"}:
        raise ParameterError(f"{kind} takes the wire at which the loop is opened: {kind}('controller -> drive').")
    point = given.get("point", POINTS[0])
    if point not in POINTS:
        raise ParameterError(f"{kind}: point is {in_words(point)}, which is not a choice.{near(point, POINTS)}")
    try:
        opened_loop(
            diagram, where, pade=PADE_ORDER
        )  # an error that does not depend on parameters is raised before any search
    except TsmError as error:
        raise ParameterError(f"{kind}: {error}") from None
    return where, str(point)
