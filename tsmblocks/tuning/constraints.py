"""Limits of tuning: on metrics of the runs, and on stability margins of a loop opened at a wire."""

from __future__ import annotations

import ast
import math
import warnings
from collections.abc import Callable, Mapping, Sequence
from functools import lru_cache
from typing import Any

import attrs
import numpy as np

from tsmblocks.analysis import loop_gain
from tsmblocks.common.errors import ParameterError, TsmError, clip
from tsmblocks.metrics.metrics import Metric, metric
from tsmblocks.model.diagram import Diagram
from tsmblocks.tuning.smooth_metrics import differentiable

SIGNS = {ast.LtE: 1.0, ast.Lt: 1.0, ast.GtE: -1.0, ast.Gt: -1.0}
"""Sign of a limit by its comparison: 1 for an upper, -1 for a lower one."""
MARGINS = {"gain_margin": ("", 1e3), "phase_margin": ("deg", 180.0)}
"""Margins by name: their unit, and the largest one, that of a loop without a crossover. Chosen."""
PADE_ORDER = 5
"""Order of the Padé approximation of delays. Chosen: exact to 0.01 deg up to a phase of 180 deg."""
LIMIT_TOLERANCE = 1e-9
"""Excess of a limit, as a share of it, that is rounding. Chosen."""
LIMIT_MARGIN = 1e-3
"""Share of a limit by which a search stays within it. Chosen: its end is then not just beyond the limit."""
STABILITY_TOLERANCE = 1e-6
"""Real part of a stable pole, as a share of the fastest pole, that is rounding. Chosen."""
UNIT_CIRCLE_ANGLES = np.pi * np.concatenate([np.geomspace(1e-7, 0.01, 400), np.linspace(0.01, 1 - 1e-9, 1000)[1:]])
"""Angles of the unit circle at which a discrete-time loop is evaluated. Chosen: dense at low frequencies."""
POLE_DISTANCES = np.geomspace(0.1, 30.0, 12)
"""Further angles to each side of a pole, in multiples of its distance from the circle. Chosen."""


@attrs.frozen(eq=False)
class Limit:
    """An upper limit ``most``, a lower one where ``sign`` is -1, of a metric or of a margin at the wire ``at``."""

    text: str
    name: str
    most: float
    sign: float
    metric: Metric | None = None
    margin: str = ""
    at: str = ""

    @property
    def unit(self) -> str:
        """Unit of the metric or margin."""
        return self.metric.unit if self.metric is not None else MARGINS[self.margin][0]

    def excess(self, value: Any) -> Any:
        """Excess of values over the limit, as a share of it; negative within."""
        return self.sign * (value - self.most) / max(abs(self.most), 1e-9)

    def aimed(self, value: Any) -> Any:
        """As ``excess``, with ``LIMIT_MARGIN`` added unless the limit is zero."""
        return self.excess(value) + (LIMIT_MARGIN if self.most else 0.0)

    def margin_of(self, diagram: Diagram) -> float:
        """The margin of a diagram, linearised at its initial states; NaN where there is no linear model.

        A gain margin is the smallest factor, up or down, that makes the loop unstable, below 1 where it is unstable
        already. The phase margin is python-control's, negative where the loop is unstable.
        """
        try:
            system = loop_gain(diagram, self.at, pade=PADE_ORDER)
        except TsmError:
            return math.nan
        matrices = tuple((part.shape, part.tobytes()) for part in (system.A, system.B, system.C, system.D))
        return min(_margins(matrices, float(system.dt or 0.0))[self.margin], MARGINS[self.margin][1])


@lru_cache(maxsize=4096)
def _margins(matrices: tuple[tuple[tuple[int, ...], bytes], ...], dt: float) -> dict[str, float]:
    """Gain and phase margin of a state space, which is in discrete time where ``dt`` is not 0.

    Cached, by the bytes of the matrices: cases that differ in their signals only have the same loop.
    """
    parts = [np.frombuffer(data).reshape(shape) for shape, data in matrices]
    with np.errstate(all="ignore"):
        gains, phases = _sampled_crossings(*parts) if dt else _crossings(parts)
        factors = np.maximum(gains, 1.0 / gains)
    gain = factors.min(initial=math.inf) if _stable(parts, dt) else (1.0 / factors).max(initial=0.0)
    return {"gain_margin": float(gain), "phase_margin": min(map(float, phases), key=abs, default=math.inf)}


def _crossings(parts: Sequence[np.ndarray]) -> tuple[np.ndarray, np.ndarray]:
    """Factors that bring a loop to the edge of stability, and its phases [deg] where its gain is 1."""
    import control

    with warnings.catch_warnings():
        warnings.simplefilter("ignore")  # of a loop without a crossover
        gains, phases, *_ = control.stability_margins(control.ss(*parts), returnall=True)
    return np.asarray(gains), np.asarray(phases)


def _sampled_crossings(A: np.ndarray, B: np.ndarray, C: np.ndarray, D: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
    """As ``_crossings``, in discrete time: searched along the unit circle, densely near poles.

    python-control solves for roots of polynomials, and misses some where poles are close together.
    """
    from scipy.optimize import brentq

    def loop(angles: Any) -> np.ndarray:
        z = np.exp(1j * np.atleast_1d(angles))[:, None, None]
        return np.asarray(C @ np.linalg.solve(z * np.eye(len(A)) - A, B[None].astype(complex)) + D)[:, 0, 0]

    def roots(of: Callable[[np.ndarray], np.ndarray]) -> list[float]:
        values = of(along)
        places = np.flatnonzero(values[:-1] * values[1:] < 0)
        return [brentq(lambda a: float(of(loop(a))[0]), angles[k], angles[k + 1], xtol=1e-15) for k in places]

    poles = np.linalg.eigvals(A)
    near = (np.abs(1 - np.abs(poles)) + 1e-9)[:, None] * np.concatenate([-POLE_DISTANCES, POLE_DISTANCES])
    angles = np.concatenate([UNIT_CIRCLE_ANGLES, (np.abs(np.angle(poles))[:, None] + near).ravel()])
    angles = np.unique(np.clip(angles, UNIT_CIRCLE_ANGLES[0], UNIT_CIRCLE_ANGLES[-1]))
    along = loop(angles)
    at_axis = np.concatenate([loop(roots(np.imag)), along[[0, -1]]])
    negative = at_axis.real[(at_axis.real < 0) & (np.abs(at_axis.imag) <= 1e-6 * np.abs(at_axis.real))]
    return -1.0 / negative, np.degrees(np.angle(-loop(roots(lambda values: np.abs(values) - 1.0))))


def _stable(parts: Sequence[np.ndarray], dt: float) -> bool:
    """Whether the closed loop is stable."""
    A, B, C, D = parts
    if not A.size or 1.0 + D.item() == 0.0:
        return 1.0 + D.item() > 0.0
    poles = np.linalg.eigvals(A - B @ C / (1.0 + D.item()))
    if dt:
        return bool(np.all(np.abs(poles) <= 1.0 + STABILITY_TOLERANCE))
    return bool(np.all(poles.real <= STABILITY_TOLERANCE * np.abs(poles).max()))


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
        raise ParameterError(f"{shown} is no limit of a metric. Write for example 'largest(u) <= 20'.")
    try:
        most = float(ast.literal_eval(tree.comparators[0]))
    except (ValueError, TypeError):
        raise ParameterError(f"{shown}: the limit must be a plain number, on the right.") from None
    call, sign, name = tree.left, SIGNS[type(tree.ops[0])], ast.unparse(tree.left)
    if isinstance(call, ast.Call) and isinstance(call.func, ast.Name) and call.func.id in MARGINS:
        return Limit(str(text), name, most, sign, margin=call.func.id, at=_wire(call, call.func.id, diagram))
    try:
        one = metric(name, units)
    except TsmError as error:
        raise ParameterError(f"limit: {error}") from None
    differentiable(one)
    return Limit(str(text), name, most, sign, one)


def _wire(call: ast.Call, kind: str, diagram: Diagram) -> str:
    """The wire that a margin names, checked."""
    where = call.args[0].value if len(call.args) == 1 and isinstance(call.args[0], ast.Constant) else None
    if not isinstance(where, str) or call.keywords:
        raise ParameterError(f"{kind} takes the wire at which the loop is opened: {kind}('controller -> drive').")
    try:
        loop_gain(diagram, where, pade=PADE_ORDER)  # an error that no parameters can mend is raised before any search
    except TsmError as error:
        raise ParameterError(f"{kind}: {error}") from None
    return where
