"""Curves through samples: a zero-order hold, straight lines or a cubic spline, and which of them a signal follows."""

from __future__ import annotations

from collections.abc import Callable, Mapping, Sequence

import numpy as np

from tsmblocks.common.errors import DataError, in_words, near

Hold = str | Mapping[str, str]
"""The hold of all inputs, or those by name of the input; one that is not named is found from the samples."""
HOLDS = ("zero", "linear", "cubic")
"""Curves between samples by name, as ``hold`` takes them."""
AUTO = "auto"
"""The value of ``hold`` that leaves the curve to ``found_hold``."""
HOLD_WORDS = (AUTO, *HOLDS)
"""All values that ``hold`` takes."""
ORDERS = {"zero": 0, "linear": 1}
"""Highest time derivative of an input that exists with a hold; a cubic has all that blocks use."""
SWITCHED_LEVELS = 4
"""Values that a signal takes at most to be switched between them, whenever that happens. Chosen: a motion that was
quantised so coarsely would be no measurement."""
MIN_SWITCHED_STANDING = 0.25
"""Share of the steps from sample to sample that leave it unchanged, at least. Chosen: half of that of random bits."""
MIN_STANDING = 0.5
"""Share of the steps from sample to sample that leave a held signal unchanged, at least. Derived: one that changes at
every second sample; what changes more often is like a motion."""
NEXT_TO_JUMP = 0.01
"""Change beside a jump [that jump] up to which the signal rests there. Chosen: what a filter leaves of noise; in a
motion neighbouring changes are alike."""
MIN_JUMPED = 0.9
"""Share of its travel that a held signal makes in jumps, with next to no change on both sides. Chosen: motion makes
next to none of its travel so, except where it is quantised."""
ONE_SIZE = 2.2
"""Ratio of jumps up to which they may be steps of one quantum. Chosen: a quantum that was rounded once more, for
printing, gives steps of one and of two units."""
SMALL_SIZES = 0.05
"""Quantile of the sizes of jumps that counts as the smallest. Chosen: a few may be parts of a step."""
WHOLE, ODD_JUMPS = 0.15, 0.1
"""Distance of a jump from a whole number of quanta [quanta] up to which it may be that number, and the share of jumps
that are at more from which they are no quanta. Chosen: 0.0879 printed as 0.09 and 0.08 is off by 0.13."""
MIN_CLOCKED = 10
"""Jumps of a held signal at least that show its period; fewer are those of a step test. Chosen: by chance 10 instants
are multiples of a period of two samples in one of 1000 signals, and a motion of 10 quanta was hardly measured."""
MOST_COMPARED = 20_000
"""Samples that are compared at most. Chosen: they show it as well as all of them do, in less time than a run takes."""
SHARP, MOST_BENT = 1e-3, 0.2
"""Bend of a straight side over that of the sharpest corner, and share of samples that bend more, at most. Chosen:
rounding of printed samples bends a side by less, and smooth motions bend nearly everywhere."""
MIN_COMPARED = 9
"""Samples at least that show which curve they lie on. Chosen: fewer leave next to none to predict."""


def interpolation(t: np.ndarray, x: np.ndarray, kind: str) -> Callable[[np.ndarray], np.ndarray]:
    """Return the function of time that interpolates the samples: ``"zero"``, ``"linear"`` or ``"cubic"`` (a spline)."""
    if kind == "zero":
        late = 1e-6 * float(np.median(np.diff(t))) if len(t) > 1 else 0.0  # rounded times are no later sample
        return lambda at: x[np.clip(np.searchsorted(t, at + late, side="right") - 1, 0, len(t) - 1)]
    if kind == "linear":
        return lambda at: np.interp(at, t, x)
    from scipy.interpolate import CubicSpline

    return CubicSpline(t, x)


def polynomial_weights(away: np.ndarray) -> np.ndarray:
    """Weights of values at these distances in the polynomial through them, taken at 0; shape (places, values)."""
    w = np.ones_like(away)
    for j in range(away.shape[1]):
        for i in range(away.shape[1]):
            if i != j:
                w[:, j] *= -away[:, i] / (away[:, j] - away[:, i])
    return w


def is_held(x: np.ndarray) -> bool:
    """Whether a sampled signal (n,) is piecewise constant, as the command of a sampled controller or a step test is.

    A signal that alternates between rest and motion is not held: its travel is then made in consecutive samples. Many
    steps of one size, or of twice that, are those of a quantised motion, unless they come at multiples of a period.
    """
    d = np.diff(x)
    size = np.abs(d)
    moved = size > 1e-9 * float(np.ptp(x)) if len(x) else size > 0
    if not moved.any() or not np.isfinite(size).all():
        return False
    if (~moved).mean() < MIN_SWITCHED_STANDING:
        return False
    if len(np.unique(x)) <= min(SWITCHED_LEVELS, (len(x) - 1) // 2):
        return True
    beside = np.concatenate([[0.0], size, [0.0]])
    alone = moved & (np.maximum(beside[:-2], beside[2:]) <= NEXT_TO_JUMP * size)
    if (~moved).mean() < MIN_STANDING or size[alone].sum() < MIN_JUMPED * size.sum():
        return False
    jumps = size[moved]
    alike = jumps <= ONE_SIZE * np.quantile(jumps, SMALL_SIZES)
    if jumps[alike].sum() < MIN_JUMPED * jumps.sum():
        return True
    quanta = jumps[alike] / jumps.min()
    at = np.flatnonzero(moved)
    few, any_size = len(at) < MIN_CLOCKED, (np.abs(quanta - np.rint(quanta)) > WHOLE).mean() > ODD_JUMPS
    return bool(few or any_size or int(np.gcd.reduce(np.diff(at))) > 1)


def has_straight_sides(t: np.ndarray, x: np.ndarray) -> bool:
    """Whether a sampled signal (n,) runs straight from corner to corner, as the trapezoids of a command do.

    A corner between two samples bends it at both.
    """
    bend = np.abs(np.diff(np.diff(x) / np.diff(t)))
    bent = bend > SHARP * float(bend.max(initial=0.0))
    if not bent.any() or bent.mean() > MOST_BENT:
        return False
    return not (bent[:-2] & bent[1:-1] & bent[2:]).any()


def smooth_hold(t: np.ndarray, x: np.ndarray) -> str:
    """``"cubic"`` or ``"linear"``, whichever predicts samples (n,) better from their neighbours.

    A cubic fits a smooth motion better; it is worse than a straight line where noise dominates the residual of the
    line, and between the corners of a trapezoid.
    """
    if len(t) < MIN_COMPARED or has_straight_sides(t, x):
        return "linear"
    some = len(t) // MOST_COMPARED + 1
    x = x / (np.abs(x).max() or 1.0)
    times, values = (np.stack([v[k : len(v) - 6 + k : some] for k in (0, 2, 4, 6)], axis=1) for v in (t, x))
    away = times - t[3 : len(t) - 3 : some, None]
    line, cubic = (np.sum(polynomial_weights(away[:, k]) * values[:, k], axis=1) for k in (slice(1, 3), slice(0, 4)))
    truth = x[3 : len(x) - 3 : some]
    return "cubic" if np.sum((cubic - truth) ** 2) < np.sum((line - truth) ** 2) else "linear"


def found_hold(t: np.ndarray, x: np.ndarray, order: int = 0) -> str:
    """The hold of a signal (n,), found from its samples at the times ``t`` [s].

    ``"zero"`` where it is piecewise constant (``is_held``), else as ``smooth_hold`` finds. ``order`` is the
    highest time derivative that is needed, and the curve has that derivative.
    """
    if order == 0 and is_held(x):
        return "zero"
    smooth = smooth_hold(t, x)
    return smooth if order <= ORDERS.get(smooth, order) or len(t) < 4 else "cubic"


def hold_of_each(hold: Hold, names: Sequence[str]) -> dict[str, str]:
    """The hold that is given for each of the inputs. Raises DataError for an unknown hold or input."""
    if isinstance(hold, Mapping):
        for name in hold:
            if name not in names:
                raise DataError(f"hold: there is no input '{name}'.{near(name, names)}")
        each = {name: hold.get(name, AUTO) for name in names}
    else:
        each = dict.fromkeys(names, hold)
    for name, one in each.items():
        if not isinstance(one, str):
            raise DataError(
                f"hold must be one of {', '.join(HOLD_WORDS)}, or a mapping from inputs to these, got {in_words(one)}."
            )
        check_hold(name, one)
    return each


def check_hold(name: str, hold: str) -> None:
    """Raise DataError for a hold of an input that is not known."""
    if hold not in HOLD_WORDS:
        raise DataError(f"input '{name}': there is no hold '{hold}'.{near(hold, HOLD_WORDS)}")
