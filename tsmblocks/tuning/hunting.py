"""Whether a tuned loop hunts: signals that oscillate far more than before, which margins and errors do not detect."""

from __future__ import annotations

from collections.abc import Mapping, Sequence

import attrs
import numpy as np

from tsmblocks.common.tables import few
from tsmblocks.common.units import display_unit
from tsmblocks.metrics.metrics import Metric
from tsmblocks.model.diagram import Diagram
from tsmblocks.simulation.run_options import RunOptions
from tsmblocks.simulation.simulate import simulate
from tsmblocks.simulation.stability import no_step_warnings
from tsmblocks.studies import study, table
from tsmblocks.studies.study import signal_units

HUNTING_RATIO = 3.0
"""Factor by which the total variation of a signal, and its number of passes through its range, grow. Chosen."""
SWING_SHARE = 0.1
"""Prominence of a peak that counts as a swing, as a share of the signal's range. Chosen."""
LIMIT_ALLOWANCE = 2.0
"""The proposed limit of a total variation, as a multiple of that before. Chosen."""


@attrs.frozen
class _Variation:
    """Total variation of a signal, and the same in multiples of its range (``times``), before and after."""

    name: str
    case: str
    before: float
    after: float
    times: tuple[float, float]

    @property
    def growth(self) -> float:
        """Factor by which the total variation grows."""
        return self.after / max(self.before, 1e-9 * self.after, 1e-300)


def hunting(
    cases: Mapping[str, Diagram],
    own: Mapping[str, float],
    values: Mapping[str, float],
    goal: Metric,
    watched: Sequence[str],
    options: RunOptions,
) -> list[str]:
    """A warning where a signal hunts with ``values``, compared with the diagrams' ``own``; empty where none does.

    A signal hunts where its total variation, and its passes through its range, grow by ``HUNTING_RATIO`` (the passes
    compared with its own or those of the goal's signals before). Signals ``watched`` are checked first, then outputs of
    the tuned blocks, over the time of the goal.
    """
    units = signal_units(next(iter(cases.values())))
    blocks = {name.rpartition(".")[0] for name in own} - {""}
    tuned = [name for name in units if name.rpartition(".")[0] in blocks and name not in watched]
    for names in (list(watched), tuned):
        variations = _variations(cases, own, values, goal, [*goal.signals, *names], options)
        found = _hunting_signals(variations, goal, names)
        if found:
            most = LIMIT_ALLOWANCE * max(one.before for one in variations if one.name == found[0].name)
            return [_message(found, most, cases, values, goal, units, options)]
    return []


def _variations(
    cases: Mapping[str, Diagram],
    own: Mapping[str, float],
    values: Mapping[str, float],
    goal: Metric,
    names: Sequence[str],
    options: RunOptions,
) -> list[_Variation]:
    window = _window(goal)
    texts = {f"{kind} {name}": f"{kind}({name}{window})" for name in names for kind in ("variation", "peak_to_peak")}
    plan = table({name: [own[name], values[name]] for name in own})
    made = []
    for case, diagram in cases.items():
        with no_step_warnings():
            found = study(diagram, plan, texts, **options.arguments)
        for name in dict.fromkeys(names):
            variation, span = found[f"variation {name}"], found[f"peak_to_peak {name}"]
            passes = np.where(span > 0, variation / np.where(span > 0, span, 1.0), 0.0)
            made.append(
                _Variation(name, case, float(variation[0]), float(variation[1]), (float(passes[0]), float(passes[1])))
            )
    return made


def _hunting_signals(variations: Sequence[_Variation], goal: Metric, names: Sequence[str]) -> list[_Variation]:
    """The signals that hunt, each in its worst case, in the order of growth."""
    fewest_passes = {
        case: min(one.times[0] for one in variations if one.case == case and one.name in goal.signals)
        for case in {one.case for one in variations}
    }
    worst: dict[str, _Variation] = {}
    for one in sorted(variations, key=lambda one: -one.growth):
        passes_grow = one.times[1] >= HUNTING_RATIO * max(1.0, min(one.times[0], fewest_passes[one.case]))
        if one.name in names and one.growth >= HUNTING_RATIO and passes_grow:
            worst.setdefault(one.name, one)
    return list(worst.values())


def _message(
    found: Sequence[_Variation],
    most: float,
    cases: Mapping[str, Diagram],
    values: Mapping[str, float],
    goal: Metric,
    units: Mapping[str, str],
    options: RunOptions,
) -> str:
    one, *others = found
    factor, unit = display_unit(units.get(one.name, ""))
    grown = f"{one.growth:.2g} times as large as before" if one.before > 1e-9 * one.after else "new"
    frequency = _swing_frequency(cases[one.case].with_parameters(values), one.name, goal, options)
    swings = f", mostly at about {frequency:.2g} Hz" if frequency else ""
    more = f"; likewise {few(other.name for other in others)}" if len(others) > 1 else ""
    more = f"; likewise {others[0].name}" if len(others) == 1 else more
    sizes = f"{factor * one.before:.3g} -> {factor * one.after:.3g}{f' {unit}' if unit else ''}"
    limit = f"variation({one.name}{_window(goal)}) <= {most:.2g}"
    return (
        f"the loop hunts in case '{one.case}': the total variation of {one.name} is {grown} ({sizes}){swings}{more}. "
        f"To prevent it: subject_to=['{limit}']"
    )


def _window(goal: Metric) -> str:
    """The time of the goal, as arguments of a reduction."""
    part = goal.parts[0]
    given = {"after": part.after, "before": part.before}
    return "".join(f", {k}={v:.12g}" for k, v in given.items() if np.isfinite(v))


def _swing_frequency(diagram: Diagram, name: str, goal: Metric, options: RunOptions) -> float | None:
    """The median frequency of the swings of a signal in Hz; None for fewer than five peaks."""
    from scipy.signal import find_peaks

    with no_step_warnings():
        run = simulate(diagram, **options.arguments)
    part = goal.parts[0]
    inside = (run.t >= part.after - 1e-9) & (run.t <= part.before + 1e-9)
    t, y = run.t[inside], run[name][inside]
    tops, _ = find_peaks(y, prominence=SWING_SHARE * float(np.ptp(y)))
    return float(1.0 / np.median(np.diff(t[tops]))) if len(tops) > 4 else None
