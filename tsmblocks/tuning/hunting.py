"""Whether a tuned loop hunts: signals that oscillate far more than before, which margins and errors do not detect."""

from __future__ import annotations

from collections.abc import Mapping, Sequence

import attrs
import numpy as np

from tsmblocks.common.displayed_units import display_unit
from tsmblocks.common.rounding import to_digits
from tsmblocks.common.tables import few
from tsmblocks.metrics.metrics import Metric
from tsmblocks.simulation.simulate import simulate
from tsmblocks.simulation.stability import no_step_warnings
from tsmblocks.studies import study, table
from tsmblocks.studies.study import signal_units
from tsmblocks.tuning.result import Oscillation
from tsmblocks.tuning.search import Search

HUNTING_RATIO = 3.0
"""Factor by which the total variation of a signal, and its number of passes through its range, grow. Chosen."""
SWING_SHARE = 0.1
"""Prominence of a peak that counts as a swing, as a share of the signal's range. Chosen."""
LIMIT_ALLOWANCE = 2.0
"""The proposed limit of a total variation, as a multiple of that before. Chosen."""


@attrs.frozen
class _Variation:
    """Total variation of a signal in a case before and after, and as multiples of its range (``passes``)."""

    name: str
    case: str
    before: float
    after: float
    passes_before: float
    passes_after: float

    @property
    def growth(self) -> float:
        """Factor by which the total variation grows."""
        return self.after / max(self.before, 1e-9 * self.after, 1e-300)


def hunting(
    search: Search, own: Mapping[str, float], values: Mapping[str, float]
) -> tuple[tuple[str, ...], Oscillation | None]:
    """A warning where a signal hunts with ``values``, compared with the diagrams' ``own``, and the signal.

    A signal hunts where its total variation, and its passes through its range, grow by ``HUNTING_RATIO`` (the passes
    compared with its own or those of the goal's signals before). Signals that the search watches are checked first,
    then outputs of the tuned blocks, over the time of the goal.
    """
    units = signal_units(next(iter(search.cases.values())))
    blocks = {name.rpartition(".")[0] for name in own} - {""}
    watched = search.watched
    tuned = [name for name in units if name.rpartition(".")[0] in blocks and name not in watched]
    for names in (watched, tuned):
        variations = _variations(search, own, values, names)
        signals = _hunting_signals(variations, search.goal, names)
        if signals:
            most = LIMIT_ALLOWANCE * max(one.before for one in variations if one.name == signals[0].name)
            found = _oscillation(search, signals[0], own, values, units.get(signals[0].name, ""))
            return (_message(signals, most, found.frequency, _window(search.goal), units),), found
    return (), None


def _variations(
    search: Search, own: Mapping[str, float], values: Mapping[str, float], names: Sequence[str]
) -> list[_Variation]:
    """The variations of these signals, and of those of the goal, in all cases."""
    window = _window(search.goal)
    names = list(dict.fromkeys([*search.goal.signals, *names]))
    texts = {f"{kind} {name}": f"{kind}({name}{window})" for name in names for kind in ("variation", "peak_to_peak")}
    plan = table({name: [own[name], values[name]] for name in own})
    variations = []
    for case, diagram in search.cases.items():
        with no_step_warnings():
            results = study(diagram, plan, texts, **search.options.arguments)
        for name in names:
            variation, span = results[f"variation {name}"], results[f"peak_to_peak {name}"]
            passes = np.where(span > 0, variation / np.where(span > 0, span, 1.0), 0.0)
            variations.append(_Variation(name, case, *map(float, (*variation, *passes))))
    return variations


def _hunting_signals(variations: Sequence[_Variation], goal: Metric, names: Sequence[str]) -> list[_Variation]:
    """The signals that hunt, each in its worst case, in the order of growth."""
    fewest = {
        case: min(one.passes_before for one in variations if one.case == case and one.name in goal.signals)
        for case in {one.case for one in variations}
    }
    worst: dict[str, _Variation] = {}
    for one in sorted(variations, key=lambda one: -one.growth):
        least = HUNTING_RATIO * max(1.0, min(one.passes_before, fewest[one.case]))
        if one.name in names and one.growth >= HUNTING_RATIO and one.passes_after >= least:
            worst.setdefault(one.name, one)
    return list(worst.values())


def _message(
    signals: Sequence[_Variation], most: float, frequency: float | None, window: str, units: Mapping[str, str]
) -> str:
    one, *others = signals
    factor, unit = display_unit(units.get(one.name, ""))
    grown = f"{to_digits(one.growth)} times as large as before" if one.before > 1e-9 * one.after else "new"
    swings = f", mostly at about {to_digits(frequency)} Hz" if frequency else ""
    more = f"; likewise {few(other.name for other in others)}" if others else ""
    sizes = f"{factor * one.before:.3g} -> {factor * one.after:.3g} {unit}".rstrip()
    return (
        f"the loop hunts in case '{one.case}', or follows a fast reference better: the total variation of {one.name} "
        f"is {grown} ({sizes}){swings}{more}. Look at it; if it hunts, limit it: "
        f"subject_to=['variation({one.name}{window}) <= {to_digits(most)}']"
    )


def _window(goal: Metric) -> str:
    """The time of the goal, as arguments of a reduction."""
    part = goal.parts[0]
    limits = {"after": part.after, "before": part.before}
    return "".join(f", {k}={v:.12g}" for k, v in limits.items() if np.isfinite(v))


def _oscillation(
    search: Search, one: _Variation, own: Mapping[str, float], values: Mapping[str, float], unit: str
) -> Oscillation:
    """A signal that hunts, with both sets of parameters, over the time of the goal."""
    with no_step_warnings():
        before, after = (
            simulate(search.cases[one.case].with_parameters(chosen), **search.options.arguments)
            for chosen in (own, values)
        )
    part = search.goal.parts[0]
    inside = (after.t >= part.after - 1e-9) & (after.t <= part.before + 1e-9)
    t, y = after.t[inside], after[one.name][inside]
    return Oscillation(one.name, one.case, unit, t, before[one.name][inside], y, _swing_frequency(t, y))


def _swing_frequency(t: np.ndarray, y: np.ndarray) -> float | None:
    """The median frequency of the swings of a signal in Hz; None for fewer than five peaks."""
    from scipy.signal import find_peaks

    tops, _ = find_peaks(y, prominence=SWING_SHARE * float(np.ptp(y)))
    return float(1.0 / np.median(np.diff(t[tops]))) if len(tops) > 4 else None
