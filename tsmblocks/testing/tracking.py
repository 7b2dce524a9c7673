"""Regression tests on tracking error: a diagram's metrics compared with a baseline, and when its signals deviate.

A guard says which diagram is run and what is measured; a baseline, kept in a file that people can read, holds its
metrics and its signals at some instants.
"""

from __future__ import annotations

import math
import tomllib
from collections.abc import Mapping, Sequence
from pathlib import Path
from typing import Any

import attrs
import numpy as np

from tsmblocks.common.atomic_write import replace_file
from tsmblocks.common.errors import FileError, ParameterError, RunError, in_words, near
from tsmblocks.data import heading
from tsmblocks.metrics.metrics import Metric, metrics, named
from tsmblocks.model.diagram import Diagram
from tsmblocks.simulation.simulate import simulate
from tsmblocks.studies.study import signal_units

FORMAT = 1
"""Version of the format of a baseline."""
TOLERANCES = {"exact": 1e-12, "tight": 1e-6, "normal": 1e-3, "loose": 1e-2, "coarse": 5e-2}
"""Largest change of a metric, as a share of its baseline, by class. Chosen: rounding makes less than ``tight``."""
ZERO_TOLERANCE = 1e-15
"""Magnitude of a metric, in its own unit, below which it counts as zero. Chosen: some units of rounding near 1."""
MAX_INSTANTS = 200
"""Instants of the signals that a baseline keeps at most. Chosen: a file that people can read."""
DIGITS = 7
"""Digits of a signal in a baseline. Chosen: below what a plot resolves."""


@attrs.frozen(eq=False)
class Guard:
    """A diagram, how it is run, and metrics with the tolerance class of each.

    ``how`` are arguments of ``simulate``; ``tolerances`` are the largest relative changes, by metric.
    """

    diagram: Diagram
    metrics: tuple[Metric, ...]
    tolerances: Mapping[str, float]
    how: Mapping[str, Any]

    def run(self) -> Baseline:
        """Run the diagram and measure."""
        wanted = list(dict.fromkeys(name for one in self.metrics for name in one.signals))
        run = simulate(self.diagram, **self.how)
        step = max(1, math.ceil((len(run.t) - 1) / MAX_INSTANTS))
        found = {one.name: one(run.t, {k: run[k] for k in one.signals}) for one in self.metrics}
        for name, value in found.items():
            if math.isnan(value):
                raise RunError(f"metric '{name}' is not a number here, so it cannot be guarded.")
        return Baseline(
            found,
            {one.name: one.unit for one in self.metrics},
            run.t[::step],
            {k: run[k][::step] for k in wanted},
            {k: run.unit(k) for k in wanted},
        )


@attrs.frozen(eq=False)
class Baseline:
    """Metrics of a run with their units, and signals at some instants ``t`` [s]."""

    metrics: Mapping[str, float]
    units: Mapping[str, str]
    t: np.ndarray
    signals: Mapping[str, np.ndarray]
    signal_units: Mapping[str, str]

    def text(self) -> str:
        """The baseline as TOML."""
        lines = [
            "# Metrics as accepted; pytest --tracking-accept writes them again.",
            f"format = {FORMAT}",
            "",
            "[metrics]",
        ]
        lines += [f"{_key(heading(k, self.units[k]))} = {_number(v)}" for k, v in self.metrics.items()]
        instants = ", ".join(f"{v:.{DIGITS}g}" for v in self.t)
        lines += ["", "[instants]", f'"t [s]" = [{instants}]', "", "[signals]"]
        for name, values in self.signals.items():
            shown = ", ".join(_number(float(f"{v:.{DIGITS}g}")) for v in values)
            lines.append(f"{_key(heading(name, self.signal_units[name]))} = [{shown}]")
        return "\n".join(lines) + "\n"

    def save(self, path: Path) -> None:
        """Write the baseline; its folder is made where it is missing."""
        path.parent.mkdir(parents=True, exist_ok=True)
        replace_file(path, self.text())


@attrs.frozen
class Change:
    """A metric that has changed; ``before`` is None for a new one, ``now`` for one that was removed."""

    name: str
    unit: str
    before: float | None
    now: float | None
    allowed: float

    @property
    def share(self) -> float:
        """The change as a share of the baseline; infinite where that is zero."""
        if self.before is None or self.now is None or not abs(self.before) > ZERO_TOLERANCE:
            return math.inf
        return (self.now - self.before) / abs(self.before)


def guard(
    diagram: Diagram,
    wanted: Any = None,
    *,
    tolerance: str | Mapping[str, str] = "normal",
    stop: float | None = None,
    step: float = 1e-3,
    method: str = "rk4",
    inputs: Mapping[str, Any] | None = None,
    hold: str = "linear",
    parameters: Mapping[str, Any] | None = None,
) -> Guard:
    """A guard of a diagram: ``wanted`` metrics as for ``measure``, each in a tolerance class.

    ``tolerance`` is one class for all (exact, tight, normal, loose, coarse), or a mapping from metrics to classes.
    Other arguments as for ``simulate``. Raises ParameterError.
    """
    diagram = diagram if parameters is None else diagram.with_parameters(parameters)
    found = metrics(wanted, signal_units(diagram))
    if not isinstance(tolerance, (str, Mapping)):
        raise ParameterError(
            f"tolerance is one of {', '.join(TOLERANCES)}, or maps metrics to them, got {in_words(tolerance)}."
        )
    classes = {one.name: tolerance for one in found} if isinstance(tolerance, str) else dict(tolerance)
    names = [one.name for one in found]
    for name, kind in classes.items():
        if name not in names:
            raise ParameterError(f"tolerance: there is no metric '{name}'.{near(name, names)}")
        if not isinstance(kind, str) or kind not in TOLERANCES:
            raise ParameterError(f"tolerance of '{name}': there is no class {in_words(kind)}.{near(kind, TOLERANCES)}")
    how = {"stop": stop, "step": step, "method": method, "inputs": inputs, "hold": hold}
    return Guard(diagram, found, {name: TOLERANCES[str(classes.get(name, "normal"))] for name in names}, how)


def changes(watched: Guard, before: Baseline, now: Baseline) -> list[Change]:
    """Metrics that differ from their baseline by more than their class allows, and those that were added or removed."""
    found = []
    for name, value in now.metrics.items():
        old, allowed = before.metrics.get(name), watched.tolerances[name]
        other = old is not None and before.units[name] != now.units[name]
        if old is None or other or not _within_tolerance(old, value, allowed):
            found.append(Change(name, now.units[name], old, value, allowed))
    gone = [name for name in before.metrics if name not in now.metrics]
    return [*found, *(Change(name, before.units[name], before.metrics[name], None, 0.0) for name in gone)]


def _within_tolerance(before: float, now: float, allowed: float) -> bool:
    """Whether a change is at most ``allowed`` times the baseline; infinite values must be equal."""
    if math.isfinite(before) and math.isfinite(now):
        return abs(now - before) <= max(allowed * abs(before), ZERO_TOLERANCE)
    return before == now


def first_deviation(before: Baseline, now: Baseline, share: float) -> tuple[str, float] | None:
    """The signal that first deviates by more than a share of its range, and when [s]; None if none does."""
    first: tuple[str, float] | None = None
    for name in now.signals:
        if name not in before.signals:
            continue
        old = np.interp(now.t, before.t, before.signals[name])
        size = max(float(np.ptp(old)), float(np.abs(old).max()), 1e-12)
        away = np.flatnonzero(~(np.abs(now.signals[name] - old) <= share * size))
        if len(away) and (first is None or now.t[away[0]] < first[1]):
            first = name, float(now.t[away[0]])
    return first


def change_report(found: Sequence[Change], before: Baseline, now: Baseline) -> str:
    """A table of the changes, and the time from which on the signals deviate."""
    from tsmblocks.common.tables import columns

    rows = [("metric", "baseline", "now", "change", "allowed")]
    for one in found:
        share = (
            f"{100 * one.share:+.3g} %"
            if math.isfinite(one.share)
            else "new"
            if one.before is None
            else "gone"
            if one.now is None
            else "from zero"
        )
        rows.append(
            (heading(one.name, one.unit), _shown(one.before), _shown(one.now), share, f"{100 * one.allowed:g} %")
        )
    allowed = min((one.allowed for one in found if one.now is not None), default=1e-3)
    start = first_deviation(before, now, max(0.1 * allowed, 1e-7))
    when = f"\nThe signals deviate from t = {start[1]:.4g} s on, {start[0]} first." if start else ""
    return f"{columns(rows)}{when}"


def read_baseline(path: Path) -> Baseline:
    """Read a baseline. Raises FileError where the file is none."""
    try:
        table = tomllib.loads(path.read_text(encoding="utf-8"))
        if table["format"] != FORMAT:
            raise ValueError(f"format {table['format']!r} is not known here")
        measured = {named(k): float(v) for k, v in table["metrics"].items()}
        signals = {named(k): np.array(v, dtype=float) for k, v in table["signals"].items()}
        t = np.array(table["instants"]["t [s]"], dtype=float)
        if any(v.shape != t.shape for v in signals.values()):
            raise ValueError("signals and t differ in length")
    except (OSError, ValueError, KeyError, TypeError, AttributeError) as error:
        why = f"'{error.args[0]}' is missing" if isinstance(error, KeyError) else str(error)
        raise FileError(
            str(path), [f"{path}: this is no baseline: {why}. pytest --tracking-accept writes it again."]
        ) from None
    return Baseline(
        {k: v for (k, _), v in measured.items()},
        dict(measured.keys()),
        t,
        {k: v for (k, _), v in signals.items()},
        dict(signals.keys()),
    )


def draw(found: Sequence[Change], before: Baseline, now: Baseline, path: Path, title: str) -> Path:
    """Plot the signals before and now, and their difference; returns the path. Needs matplotlib."""
    from tsmblocks.plots.runs import plot_tracking_changes

    path.parent.mkdir(parents=True, exist_ok=True)
    names = [one.name for one in found]
    plot_tracking_changes(before, now, f"{title}: {', '.join(names)}").savefig(path, dpi=120)
    return path


def _shown(value: float | None) -> str:
    return "" if value is None else f"{value:.6g}"


def _number(value: float) -> str:
    return (
        repr(float(value)) if math.isfinite(value) else "nan" if math.isnan(value) else "inf" if value > 0 else "-inf"
    )


def _key(name: str) -> str:
    escaped = name.replace("\\", "\\\\").replace('"', '\\"')
    return f'"{escaped}"'
