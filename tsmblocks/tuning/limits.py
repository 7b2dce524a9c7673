"""What tuning is to keep to: metrics of the runs, and margins of loops opened at a wire."""

from __future__ import annotations

import ast
import math
import warnings
from collections.abc import Mapping
from functools import lru_cache
from typing import Any

import attrs
import numpy as np

from tsmblocks.analysis import loop_gain, opened
from tsmblocks.diagram import Diagram
from tsmblocks.errors import ParameterError, TsmError, clip
from tsmblocks.metrics import Metric, metric
from tsmblocks.tuning.slopes import sloped

EXAMPLE = "Write for example 'largest(u) <= 20'."
MARGINS = {"gain_margin": (0, ""), "phase_margin": (1, "deg")}
"""Margins by name: their place in what python-control gives, and their unit."""
MET = 1e-3
"""Share of a limit by which it may be missed and still counts as met."""
ENOUGH = {"gain_margin": 1e3, "phase_margin": 180.0}
"""Margins of a loop that never crosses, in their unit; a larger one counts as this."""


@attrs.frozen(eq=False)
class Limit:
    """What is to stay below ``most``, or above it where ``sign`` is -1: a metric, or a margin at a wire ``at``."""

    text: str
    name: str
    most: float
    sign: float
    metric: Metric | None = None
    margin: str = ""
    at: str = ""

    @property
    def unit(self) -> str:
        """Unit of what is limited."""
        return self.metric.unit if self.metric is not None else MARGINS[self.margin][1]

    def excess(self, value: Any) -> Any:
        """How far values are beyond the limit, as a share of it; negative within."""
        return self.sign * (value - self.most) / max(abs(self.most), 1e-9)

    def margin_of(self, diagram: Diagram) -> float:
        """The margin of a diagram, linear around its start; NaN where there is no such linear model.

        An unstable loop has a negative phase margin, or a gain margin below 1, as python-control has it.
        """
        try:
            system = loop_gain(diagram, self.at)
        except TsmError:
            return math.nan
        matrices = tuple((part.shape, part.tobytes()) for part in (system.A, system.B, system.C, system.D))
        return min(_margins(matrices)[MARGINS[self.margin][0]], ENOUGH[self.margin])


@lru_cache(maxsize=4096)
def _margins(matrices: tuple[tuple[tuple[int, ...], bytes], ...]) -> tuple[float, float]:
    """Gain and phase margin of a state space: kept, since cases that differ in their signals share their loop."""
    import control

    parts = [np.frombuffer(data).reshape(shape) for shape, data in matrices]
    with warnings.catch_warnings(), np.errstate(all="ignore"):
        warnings.simplefilter("ignore")  # of a loop that never crosses
        gain, phase, *_ = control.margin(control.ss(*parts))
    return float(gain), float(phase)


def limit(text: Any, units: Mapping[str, str], diagram: Diagram) -> Limit:
    """Read a limit such as ``"largest(u) <= 20"`` or ``"phase_margin('controller -> drive') >= 45"``.

    Raises ParameterError.
    """
    try:
        tree = ast.parse(str(text).strip(), mode="eval").body
    except (SyntaxError, ValueError):
        tree = None
    if not isinstance(tree, ast.Compare) or len(tree.ops) != 1 or not isinstance(
            tree.ops[0], (ast.LtE, ast.Lt, ast.GtE, ast.Gt)):  # fmt: skip
        raise ParameterError(f"'{clip(str(text))}' is no limit of a metric. {EXAMPLE}")
    try:
        most = float(ast.literal_eval(tree.comparators[0]))
    except (ValueError, TypeError):
        raise ParameterError(f"'{clip(str(text))}': the limit must be a plain number, on the right.") from None
    sign = 1.0 if isinstance(tree.ops[0], (ast.LtE, ast.Lt)) else -1.0
    name = ast.unparse(tree.left)
    if isinstance(tree.left, ast.Call) and isinstance(tree.left.func, ast.Name) and tree.left.func.id in MARGINS:
        kind = tree.left.func.id
        return Limit(str(text), name, most, sign, margin=kind, at=_wire(tree.left, kind, diagram))
    try:
        one = metric(name, units)
    except TsmError as error:
        raise ParameterError(f"limit: {error}") from None
    sloped(one)
    return Limit(str(text), name, most, sign, one)


def _wire(call: ast.Call, kind: str, diagram: Diagram) -> str:
    """The wire that a margin names, checked."""
    where = call.args[0].value if len(call.args) == 1 and isinstance(call.args[0], ast.Constant) else None
    if not isinstance(where, str) or call.keywords:
        raise ParameterError(f"{kind} takes the wire at which the loop is opened: {kind}('controller -> drive').")
    try:
        opened(diagram, where)
    except TsmError as error:
        raise ParameterError(f"{kind}: {error}") from None
    return where
