"""What tuning is to keep to: metrics of the runs, and margins of loops opened at a wire."""

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
from tsmblocks.tuning.smooth_metrics import sloped

EXAMPLE = "Write for example 'largest(u) <= 20'."
MARGINS = {"gain_margin": (0, ""), "phase_margin": (1, "deg")}
"""Margins by name: their place in what ``_margins`` gives, and their unit."""
PADE = 5
"""Order of the approximation of dead times, exact to a hundredth of a degree up to half a turn of phase."""
MET = 1e-9
"""Share of a limit by which it may be missed through rounding and still counts as met."""
INSIDE = 1e-3
"""Share of a limit by which a search aims to stay within it, so that what it ends at is not just beyond."""
STILL = 1e-6
"""Share of the fastest pole by which one may be to the right of the axis through rounding only."""
ALONG = np.pi * np.concatenate([np.geomspace(1e-7, 0.01, 400), np.linspace(0.01, 1 - 1e-9, 1000)[1:]])
"""Angles of the unit circle at which the loop of samples is looked at."""
SPREAD = np.geomspace(0.1, 30.0, 12)
"""More of them: how far to each side of a pole, in its distances from the circle."""
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

    def aimed(self, value: Any) -> Any:
        """As ``excess``, of the limit that a search aims at: a little within, but for one that is zero."""
        return self.excess(value) + (INSIDE if self.most else 0.0)

    def margin_of(self, diagram: Diagram) -> float:
        """The margin of a diagram, linear around its start; NaN where there is no such linear model.

        A gain margin is the smallest factor, up or down, that makes the loop unstable; one that is unstable has a gain
        margin below 1. The phase margin is python-control's, negative where the loop is unstable. Dead times are
        taken by Padé's approximation of order ``PADE``.
        """
        try:
            system = loop_gain(diagram, self.at, pade=PADE)
        except TsmError:
            return math.nan
        matrices = tuple((part.shape, part.tobytes()) for part in (system.A, system.B, system.C, system.D))
        return min(_margins(matrices, float(system.dt or 0.0))[MARGINS[self.margin][0]], ENOUGH[self.margin])


@lru_cache(maxsize=4096)
def _margins(matrices: tuple[tuple[tuple[int, ...], bytes], ...], dt: float) -> tuple[float, float]:
    """Gain and phase margin of a state space, of samples where ``dt`` is not 0.

    They are kept, since cases that differ in their signals share their loop.
    """
    parts = [np.frombuffer(data).reshape(shape) for shape, data in matrices]
    with np.errstate(all="ignore"):
        gains, phases = _sampled_crossings(*parts) if dt else _crossings(parts)
        factors = np.maximum(gains, 1.0 / gains)
    phase = min(map(float, phases), key=abs, default=math.inf)
    if _stable(parts, dt):
        return float(factors.min(initial=math.inf)), phase
    return float((1.0 / factors).max(initial=0.0)), phase


def _crossings(parts: Sequence[np.ndarray]) -> tuple[np.ndarray, np.ndarray]:
    """Factors that bring a loop to the edge of stability, and its phases [deg] where its gain is 1."""
    import control

    with warnings.catch_warnings():
        warnings.simplefilter("ignore")  # of a loop that never crosses
        gains, phases, *_ = control.stability_margins(control.ss(*parts), returnall=True)
    return np.asarray(gains), np.asarray(phases)


def _sampled_crossings(A: np.ndarray, B: np.ndarray, C: np.ndarray, D: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
    """As ``_crossings``, of samples: looked for along the unit circle, closer together where poles are near to it.

    python-control, which solves for the roots of polynomials, loses some where poles lie close together.
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
    near = (np.abs(1 - np.abs(poles)) + 1e-9)[:, None] * np.concatenate([-SPREAD, SPREAD])
    angles = np.concatenate([ALONG, (np.abs(np.angle(poles))[:, None] + near).ravel()])
    angles = np.unique(np.clip(angles, ALONG[0], ALONG[-1]))
    along = loop(angles)
    turned = np.concatenate([loop(roots(np.imag)), along[[0, -1]]])
    turned = turned[(turned.real < 0) & (np.abs(turned.imag) <= 1e-6 * np.abs(turned.real))]
    return -1.0 / turned.real, np.degrees(np.angle(-loop(roots(lambda values: np.abs(values) - 1.0))))


def _stable(parts: Sequence[np.ndarray], dt: float) -> bool:
    """Whether the loop is stable when it is closed."""
    A, B, C, D = parts
    if not A.size or 1.0 + D.item() == 0.0:
        return 1.0 + D.item() > 0.0
    found = np.linalg.eigvals(A - B @ C / (1.0 + D.item()))
    if dt:
        return bool(np.all(np.abs(found) <= 1.0 + STILL))
    return bool(np.all(found.real <= STILL * np.abs(found).max()))


def limit(text: Any, units: Mapping[str, str], diagram: Diagram) -> Limit:
    """Read a limit such as ``"largest(u) <= 20"`` or ``"phase_margin('controller -> drive') >= 45"``.

    Raises ParameterError.
    """
    try:
        tree = ast.parse(str(text).strip(), mode="eval").body
    except (SyntaxError, ValueError):
        tree = None
    if (
        not isinstance(tree, ast.Compare)
        or len(tree.ops) != 1
        or not isinstance(tree.ops[0], (ast.LtE, ast.Lt, ast.GtE, ast.Gt))
    ):
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
        loop_gain(diagram, where, pade=PADE)  # what no gains can mend is said before any search
    except TsmError as error:
        raise ParameterError(f"{kind}: {error}") from None
    return where
