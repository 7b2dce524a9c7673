"""Identifiability: parameters and combinations without effect on the data, and estimates that are too uncertain."""

from __future__ import annotations

import math
from collections.abc import Sequence
from itertools import combinations

import attrs
import numpy as np

from tsmblocks.common.rounding import plus_minus, to_digits
from tsmblocks.common.tables import listed
from tsmblocks.fitting.column_space import column_space
from tsmblocks.fitting.jacobian import Jacobian
from tsmblocks.fitting.statistics import RANK, Uncertainty, intervals

SILENT = 1e-10
"""Sensitivity to a parameter, relative to the strongest, below which it is rounding. Chosen."""
SMALL = 0.05
"""Component of a combination without effect below which a parameter is only mentioned in passing. Chosen."""
LEADING = 0.2
"""The same for a combination that is only uncertain: else one uncertain parameter would bring in all others. Chosen."""
PASSING = 0.002
"""Component of a combination below which a parameter is not mentioned at all. Chosen."""
NEAR_ZERO = 0.1
"""Share of its size below which a parameter counts as near zero, where a percentage says nothing. Chosen."""
MOST_NAMED = 5
"""Parameters of a combination that are named in a message. Chosen."""
MOST_TRIED = 400
"""Most subsets of parameters that are tried for combinations of few parameters. Chosen."""

NO_INFLUENCE, COMBINATION, UNCERTAIN = "no influence", "combination", "uncertain"


@attrs.frozen
class Undetermined:
    """A parameter or combination that is not identifiable from the data.

    ``kind`` is ``"no influence"`` (a parameter that changes nothing), ``"combination"`` (parameters that only
    matter together) or ``"uncertain"`` (an estimate whose interval is wider than the parameter itself).
    ``names`` are the parameters, ``changes`` by which share of its size each moves along the combination, the
    largest being 1; ``effect`` is what moving all of them by a hundredth of that changes, in rms values of
    the residual. ``words`` says it in a sentence. ``exact`` is True for a combination that changes nothing but
    rounding: then its parameters have no intervals of their own.
    """

    kind: str
    names: tuple[str, ...]
    changes: tuple[float, ...]
    effect: float
    words: str
    exact: bool = False


def sizes(theta: np.ndarray, start: np.ndarray, low: np.ndarray, high: np.ndarray) -> np.ndarray:
    """Change of each parameter that counts as all of it, shape (p,).

    It is the larger of what was found (``theta``) and where the search began (``start``). A parameter that
    began at zero has no size: half its bounds where there are two, else one unit.
    """
    theta, start, half = np.abs(theta), np.abs(start), (np.asarray(high) - np.asarray(low)) / 2
    return np.maximum(theta, np.where(start > 0, start, np.where(np.isfinite(half), half, 1.0)))


def undetermined(
    J: np.ndarray | Jacobian,
    r: np.ndarray,
    names: Sequence[str],
    theta: np.ndarray,
    known: Uncertainty,
    *,
    scales: np.ndarray | None = None,
    prior: np.ndarray | None = None,
    held: np.ndarray | None = None,
    low: np.ndarray | None = None,
    high: np.ndarray | None = None,
    nearest: bool = False,
    units: Sequence[str] | None = None,
) -> tuple[Undetermined, ...]:
    """The parameters and combinations that are not identifiable from the data, the plainest first.

    ``J`` (N, p), ``r`` (N,), ``prior`` and ``held`` are those of the ``uncertainty`` that is ``known``.
    ``scales`` (p,) are the changes that count as all of a parameter (``sizes``; by default what was found,
    one for zero); ``low`` and ``high`` (p,) are bounds. ``nearest`` says that along combinations without any effect
    the values nearest to the diagram's own were taken. ``units`` (p,) are those of the parameters.

    Moving along a direction by all of its parameters' size must change the residuals by more than their autocorrelated
    noise can: otherwise the direction is named. For the data as a whole, that is when its confidence interval is wider
    than the direction is long. Parameters that are held, and whatever a prior determines, are not named.
    """
    theta = np.asarray(theta, dtype=float)
    scales = np.where(theta != 0, np.abs(theta), 1.0) if scales is None else np.asarray(scales, dtype=float)
    moved = Jacobian.of(J).scaled(scales)  # what each parameter changes when moved by all of its size
    labels = ("",) * len(names) if units is None else tuple(units)
    wording = _Wording(tuple(names), moved, float(np.sqrt(np.mean(np.square(r)))), theta, scales, labels)
    silent, weak = _without_effect(moved, scales, prior, held)
    found = [wording.without_influence(int(i)) for i in np.flatnonzero(silent)]
    found += [wording.combination(v, exact=True, nearest=nearest) for v in weak]
    half = intervals(np.zeros(len(theta)), known.covariance, known.freedom)[1] / scales
    vague = [v for v in _vague(known, scales, half) if (np.abs(v) >= LEADING).sum() > 1]
    found += [wording.combination(v, exact=False) for v in vague]
    named = {name for u in found for name in u.names}
    box = np.full(len(theta), math.inf)
    if low is not None and high is not None:
        box = (np.asarray(high) - np.asarray(low)) / 2 / scales
    for i in range(len(theta)):
        if names[i] not in named and math.isfinite(half[i]) and half[i] > min(1.0, box[i]):
            found.append(wording.uncertain(i, theta[i], half[i] * scales[i], bool(half[i] > box[i])))
    return tuple(found)


def null_directions(J: Jacobian, scales: np.ndarray, prior: np.ndarray | None, held: np.ndarray | None) -> np.ndarray:
    """Directions (p, q) without any effect on the residuals, in shares of each parameter's size ``scales`` (p,).

    They span what ``undetermined`` names as without influence, or as a combination; arguments as there.
    """
    p = len(scales)
    silent, weak = _without_effect(J.scaled(scales), scales, prior, held)
    return np.array([*np.eye(p)[silent], *weak]).reshape(-1, p).T


def _without_effect(
    moved: Jacobian, scales: np.ndarray, prior: np.ndarray | None, held: np.ndarray | None
) -> tuple[np.ndarray, list[np.ndarray]]:
    """Which parameters have no effect (p,), and combinations without any, in shares of each parameter's size.

    ``moved`` is the Jacobian by shares of the sizes ``scales`` (p,); ``prior`` and ``held`` as for ``undetermined``.
    """
    p = len(scales)
    weight = np.zeros((p, p)) if prior is None else prior * np.outer(scales, scales)
    size = np.sqrt(moved.norms**2 + np.diag(weight))
    held = np.empty((0, p)) if held is None else np.asarray(held, dtype=float).reshape(-1, p) * scales
    loose = np.abs(np.linalg.norm(_free(held), axis=1) - 1) < 1e-6  # held back by nothing else
    silent = loose & (size <= SILENT * size.max(initial=0.0))
    space = column_space(moved, RANK, weight, np.vstack([held, np.eye(len(size))[silent]]))
    return silent, _sparse(space.unseen / space.scale[:, None])  # no effect but rounding


def _free(held: np.ndarray) -> np.ndarray:
    """Orthonormal directions (p, q), in shares of each parameter's size, that ``held`` (m, p) leaves free."""
    if not held.size:
        return np.eye(held.shape[1])
    _, size, turn = np.linalg.svd(held / np.maximum(np.linalg.norm(held, axis=1, keepdims=True), 1e-300))
    return turn[int((size > 1e-10).sum()) :].T


def _vague(known: Uncertainty, scales: np.ndarray, half: np.ndarray) -> list[np.ndarray]:
    """Combinations, in shares of each parameter's size, along which the interval is wider than they are long."""
    fixed = np.isfinite(half) & (half > 0)
    if not fixed.any():
        return []
    spread = (known.covariance / np.outer(scales, scales))[np.ix_(fixed, fixed)]
    values, vectors = np.linalg.eigh(spread)
    tail = (half[fixed] / np.sqrt(np.diag(spread))).max()
    reach = tail * np.sqrt(np.maximum(values, 0.0)) * np.abs(vectors).max(axis=0)
    made = np.zeros((len(scales), int((reach > 1.0).sum())))
    made[fixed] = vectors[:, reach > 1.0]
    return _sparse(made)


def _sparse(basis: np.ndarray) -> list[np.ndarray]:
    """Vectors that span the columns of ``basis``, of few parameters each, the largest entry being 1."""
    p, q = basis.shape
    if q == 0:
        return []
    basis = np.linalg.qr(basis)[0]
    few = math.comb(p, q - 1) <= MOST_TRIED
    found = [_leaving(basis, list(out)) for out in combinations(range(p), q - 1)] if few else []
    found += [basis[:, k] for k in range(q)]
    found = [v / v[np.argmax(np.abs(v) * (1 - 1e-9 * np.arange(p)))] for v in found]
    found.sort(key=lambda v: (int((np.abs(v) >= SMALL).sum()), float(np.abs(v).sum())))
    kept = _independent(found, q, 0.1)
    return [v / np.abs(v).max() for v in (kept if len(kept) == q else _independent(found, q, 1e-6))]


def _independent(found: list[np.ndarray], most: int, apart: float) -> list[np.ndarray]:
    """The first vectors of which none is nearly a combination of those before it."""
    kept: list[np.ndarray] = []
    for v in found:
        experiment = [*kept, v / np.linalg.norm(v)]
        if len(kept) < most and np.linalg.svd(np.array(experiment), compute_uv=False)[-1] > apart:
            kept = experiment
    return kept


def _leaving(basis: np.ndarray, out: list[int]) -> np.ndarray:
    """A vector of the span that leaves the parameters ``out`` alone."""
    turn = np.linalg.svd(basis[out])[2]
    made = basis @ turn[-1]
    made[np.abs(made) < 1e-9 * np.abs(made).max()] = 0.0
    return made


@attrs.frozen(eq=False)
class _Wording:
    """Puts findings in words. ``moved`` (N, p) is what each parameter changes when moved by all of its size."""

    names: tuple[str, ...]
    moved: Jacobian
    rms: float
    theta: np.ndarray
    scales: np.ndarray
    units: tuple[str, ...]

    def effect(self, v: np.ndarray) -> float:
        """The change of the outputs by a hundredth of ``v``, in rms values of the residual."""
        change = 0.01 * float(np.sqrt(np.mean(np.square(self.moved @ v))))
        return change / self.rms if self.rms > 0 else (math.inf if change > 0 else 0.0)

    def without_influence(self, i: int) -> Undetermined:
        """One parameter that changes nothing."""
        name, v = self.names[i], np.eye(len(self.names))[i]
        words = f"{name} has no influence on the outputs in these experiments."
        return Undetermined(NO_INFLUENCE, (name,), (1.0,), self.effect(v), words)

    def combination(self, v: np.ndarray, *, exact: bool, nearest: bool = False) -> Undetermined:
        """Several parameters along ``v``, in the order given, that change nothing (``exact``) or hardly anything.

        Those of small part, and initial states beside parameters, are mentioned last.
        """
        small = SMALL if exact else LEADING
        every = [i for i in range(len(v)) if abs(v[i]) >= small]
        main = [i for i in every if "@" not in self.names[i]] or every
        others = [i for i in range(len(v)) if i not in main and (i in every or PASSING <= abs(v[i]) < small)]
        v = v * np.sign(v[main[0]])
        effect, (moves, factor) = self.effect(v), self.moves(v, main)
        shown = sorted(sorted(main, key=lambda i: -abs(v[i]))[:MOST_NAMED]) if len(main) > MOST_NAMED + 1 else main
        steps = [moves[i] for i in shown] + [f"{len(main) - len(shown)} more changed"] * (len(main) > len(shown))
        also = f" (and {listed([self.names[i] for i in others], 3)} adjusted)" if others else ""
        names = listed([self.names[i] for i in main], MOST_NAMED)
        what = "are determined only in combination" if exact else "are indistinguishable with these data"
        alone = "is not determined separately" if others else "hardly matters"
        words = (
            f"{names} {what if len(main) > 1 else alone}: with {listed(steps, MOST_NAMED + 1)}{also}, "
            f"{self.change(exact, factor * effect)}."
        )
        words += " Of values that fit equally well, those closest to the diagram's own are reported." if nearest else ""
        named = [i for i in range(len(v)) if i in every or (exact and i in others)]
        named.sort(key=lambda i: (i not in every, i))
        parts = tuple(self.names[i] for i in named), tuple(float(v[i]) for i in named)
        return Undetermined(COMBINATION, *parts, effect, words, exact)

    @staticmethod
    def change(exact: bool, amount: float) -> str:
        """By how much the outputs change, in rms values of the residual."""
        if exact or not 0 < amount < math.inf:
            return "the outputs stay the same"
        if amount >= 1:
            return f"the outputs change by {to_digits(amount, 1)} times the residual, but as slowly as that does"
        return f"the outputs change by no more than {to_digits(amount, 1)} times the residual"

    def moves(self, v: np.ndarray, main: list[int]) -> tuple[dict[int, str], float]:
        """What each parameter of ``main`` does along ``v``, the largest step being 1 % of what was found; and how many
        hundredths of ``v`` that is. A parameter that was found near zero moves by an absolute amount.
        """
        step = np.abs(v * self.scales)
        known = [i for i in main if abs(self.theta[i]) >= NEAR_ZERO * self.scales[i]]
        factor = 1 / max((step[i] / abs(self.theta[i]) for i in known), default=1.0)
        made = {}
        for i in main:
            size = factor * step[i]
            by = f"{to_digits(size / abs(self.theta[i]))} %" if i in known else f"{to_digits(0.01 * size)}"
            up, down = (
                ("closer to zero", "farther from zero") if i in known and self.theta[i] < 0 else ("higher", "lower")
            )
            made[i] = f"{self.names[i]} {by} {up if v[i] > 0 else down}"
        return made, factor

    def uncertain(self, i: int, value: float, half: float, beyond: bool) -> Undetermined:
        """One parameter whose interval is wider than it, or (``beyond``) than its bounds."""
        than = "its bounds" if beyond else "its value"
        estimate = plus_minus(value, half, self.units[i])
        words = f"{self.names[i]} is poorly determined: {estimate}, a confidence interval wider than {than}."
        v = np.eye(len(self.names))[i]
        return Undetermined(UNCERTAIN, (self.names[i],), (1.0,), self.effect(v), words)
