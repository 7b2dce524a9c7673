"""Whether a tuned loop hunts: signals that go to and fro far more than before, which margins and errors do not show."""

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

MANY = 3.0
"""How many times as far a signal goes, and how many times as often through its range, for it to hunt."""
SWING = 0.1
"""Share of a signal's range that a swing has at least, where swings are counted."""
ROOM = 2.0
"""How far a signal may go in the limit that is proposed, in what it went before."""


@attrs.frozen
class _Way:
    """How far a signal goes, its changes added up, and how often that is through its range, before and after."""

    name: str
    case: str
    before: float
    after: float
    times: tuple[float, float]

    @property
    def growth(self) -> float:
        """How many times as far it goes."""
        return self.after / max(self.before, 1e-9 * self.after, 1e-300)


def hunting(
    cases: Mapping[str, Diagram],
    own: Mapping[str, float],
    values: Mapping[str, float],
    goal: Metric,
    watched: Sequence[str],
    options: RunOptions,
) -> list[str]:
    """What to beware of in words, empty where no signal hunts: with some ``values`` against the diagrams' ``own``.

    A signal hunts that goes ``MANY`` times as far as before, and as often through its range, as it or what the goal
    is made of did before. Those ``watched`` are looked at first, then the outlets of the blocks that were tuned. The
    instants that count are those of the goal.
    """
    units = signal_units(next(iter(cases.values())))
    blocks = {name.rpartition(".")[0] for name in own} - {""}
    tuned = [name for name in units if name.rpartition(".")[0] in blocks and name not in watched]
    for names in (list(watched), tuned):
        ways = _ways(cases, own, values, goal, [*goal.signals, *names], options)
        found = _found(ways, goal, names)
        if found:
            most = ROOM * max(one.before for one in ways if one.name == found[0].name)
            return [_said(found, most, cases, values, goal, units, options)]
    return []


def _ways(
    cases: Mapping[str, Diagram],
    own: Mapping[str, float],
    values: Mapping[str, float],
    goal: Metric,
    names: Sequence[str],
    options: RunOptions,
) -> list[_Way]:
    window = _window(goal)
    texts = {f"{kind} {name}": f"{kind}({name}{window})" for name in names for kind in ("variation", "peak_to_peak")}
    plan = table({name: [own[name], values[name]] for name in own})
    made = []
    for case, diagram in cases.items():
        with no_step_warnings():
            found = study(diagram, plan, texts, **options.arguments)
        for name in dict.fromkeys(names):
            way, size = found[f"variation {name}"], found[f"peak_to_peak {name}"]
            times = np.where(size > 0, way / np.where(size > 0, size, 1.0), 0.0)
            made.append(_Way(name, case, float(way[0]), float(way[1]), (float(times[0]), float(times[1]))))
    return made


def _found(ways: Sequence[_Way], goal: Metric, names: Sequence[str]) -> list[_Way]:
    """Those that hunt, each in the case where it goes farthest, the one that has grown most first."""
    calm = {
        case: min(one.times[0] for one in ways if one.case == case and one.name in goal.signals)
        for case in {one.case for one in ways}
    }
    worst: dict[str, _Way] = {}
    for one in sorted(ways, key=lambda one: -one.growth):
        often = one.times[1] >= MANY * max(1.0, min(one.times[0], calm[one.case]))
        if one.name in names and one.growth >= MANY and often:
            worst.setdefault(one.name, one)
    return list(worst.values())


def _said(
    found: Sequence[_Way],
    most: float,
    cases: Mapping[str, Diagram],
    values: Mapping[str, float],
    goal: Metric,
    units: Mapping[str, str],
    options: RunOptions,
) -> str:
    one, *others = found
    factor, unit = display_unit(units.get(one.name, ""))
    grown = f"{one.growth:.2g} times as far as before" if one.before > 1e-9 * one.after else "to and fro"
    often = _swings(cases[one.case].with_parameters(values), one.name, goal, options)
    swings = f", mostly in swings of some {often:.2g} Hz" if often else ""
    more = f"; so do {few(other.name for other in others)}" if len(others) > 1 else ""
    more = f"; so does {others[0].name}" if len(others) == 1 else more
    sizes = f"{factor * one.before:.3g} -> {factor * one.after:.3g}{f' {unit}' if unit else ''}"
    limit = f"variation({one.name}{_window(goal)}) <= {most:.2g}"
    return (
        f"the loop hunts in case '{one.case}': {one.name} goes {grown} ({sizes} of changes in all){swings}{more}. "
        f"To prevent it: subject_to=['{limit}']"
    )


def _window(goal: Metric) -> str:
    """The instants that count, as a reduction takes them."""
    part = goal.parts[0]
    given = {"after": part.after, "before": part.before}
    return "".join(f", {k}={v:.12g}" for k, v in given.items() if np.isfinite(v))


def _swings(diagram: Diagram, name: str, goal: Metric, options: RunOptions) -> float | None:
    """How often a signal swings to and fro, in Hz, half its swings being faster; None where there are few."""
    from scipy.signal import find_peaks

    with no_step_warnings():
        run = simulate(diagram, **options.arguments)
    part = goal.parts[0]
    inside = (run.t >= part.after - 1e-9) & (run.t <= part.before + 1e-9)
    t, y = run.t[inside], run[name][inside]
    tops, _ = find_peaks(y, prominence=SWING * float(np.ptp(y)))
    return float(1.0 / np.median(np.diff(t[tops]))) if len(tops) > 4 else None
