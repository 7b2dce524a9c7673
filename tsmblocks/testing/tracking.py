"""Regression tests on tracking error: a diagram's metrics compared with a baseline, and when its signals deviate.

A guard defines which diagram is run and what is measured; a baseline, kept in a readable file, holds its metrics and
its signals at some instants.
"""

from __future__ import annotations

import json
import math
import tomllib
from collections.abc import Mapping, Sequence
from pathlib import Path
from typing import Any

import attrs
import numpy as np

from tsmblocks.common.atomic_write import replace_figure, replace_file
from tsmblocks.common.errors import FileError, ParameterError, RunError, in_words, near
from tsmblocks.common.headings import heading
from tsmblocks.common.tables import columns
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
"""Instants of the signals that a baseline keeps at most. Chosen: a readable file."""
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
        found = {one.name: one(run.t, run) for one in self.metrics}
        for name, value in found.items():
            if math.isnan(value):
                raise RunError(f"metric '{name}' is not a number here, so it cannot be guarded.")
        signals = {k: run[k][::step] for k in wanted}
        metric_units = {one.name: one.unit for one in self.metrics}
        return Baseline(found, metric_units, run.t[::step], signals, {k: run.unit(k) for k in wanted})


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
        lines = ["# Metrics as accepted; pytest --tracking-accept writes them again.", f"format = {FORMAT}"]
        lines += ["", "[metrics]", *(f"{_key(k, self.units[k])} = {float(v)!r}" for k, v in self.metrics.items())]
        instants = ", ".join(f"{v:.{DIGITS}g}" for v in self.t)
        lines += ["", "[instants]", f'"t [s]" = [{instants}]', "", "[signals]"]
        for name, values in self.signals.items():
            shown = ", ".join(repr(float(f"{v:.{DIGITS}g}")) for v in values)
            lines.append(f"{_key(name, self.signal_units[name])} = [{shown}]")
        return "\n".join(lines) + "\n"

    def save(self, path: Path) -> None:
        """Write the baseline; its folder is made where it is missing. Raises FileError where that is not possible."""
        try:
            path.parent.mkdir(parents=True, exist_ok=True)
            replace_file(path, self.text())
        except OSError as error:
            raise FileError(str(path), [f"{path}: cannot be written: {str(error.strerror).lower()}."]) from None


@attrs.frozen
class Change:
    """A metric that has changed; ``before`` is None for a new one, ``now`` for one that was removed."""

    name: str
    unit: str
    before: float | None
    now: float | None
    allowed: float

    @property
    def relative(self) -> str:
        """The change as a share of the baseline, in words where there is none."""
        if self.before is None or self.now is None:
            return "new" if self.before is None else "gone"
        share = (self.now - self.before) / abs(self.before) if abs(self.before) > ZERO_TOLERANCE else math.inf
        return f"{100 * share:+.3g} %" if math.isfinite(share) else "from zero"


def guard(
    diagram: Diagram, wanted: Any, tolerance: str | Mapping[str, str], how: Mapping[str, Any], parameters: Any = None
) -> Guard:
    """A guard of a diagram: ``wanted`` metrics as for ``measure``, each in a tolerance class.

    ``tolerance`` is one class for all (exact, tight, normal, loose, coarse), or a mapping from metrics to classes;
    ``how`` are arguments of ``simulate``, and ``parameters`` are changed in the diagram. Raises ParameterError.
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
    return Guard(diagram, found, {name: TOLERANCES[str(classes.get(name, "normal"))] for name in names}, how)


def changes(watched: Guard, before: Baseline, now: Baseline) -> list[Change]:
    """Metrics that differ from their baseline by more than their class allows, and those that were added or removed."""
    found = []
    for name, value in now.metrics.items():
        old, allowed = before.metrics.get(name), watched.tolerances[name]
        if old is None or before.units[name] != now.units[name] or not _within_tolerance(old, value, allowed):
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
    found = []
    for name in filter(before.signals.__contains__, now.signals):
        old = np.interp(now.t, before.t, before.signals[name])
        size = max(float(np.ptp(old)), float(np.abs(old).max()), 1e-12)
        away = np.flatnonzero(~(np.abs(now.signals[name] - old) <= share * size))
        if len(away):
            found.append((name, float(now.t[away[0]])))
    return min(found, key=lambda one: one[1], default=None)


def change_report(found: Sequence[Change], before: Baseline, now: Baseline) -> str:
    """A table of the changes, and the time from which on the signals deviate."""
    rows = [("metric", "baseline", "now", "change", "allowed")]
    for one in found:
        old, new = ("" if value is None else f"{value:.6g}" for value in (one.before, one.now))
        rows.append((heading(one.name, one.unit), old, new, one.relative, f"{100 * one.allowed:g} %"))
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
        units, signal_units = (dict(map(named, table[part])) for part in ("metrics", "signals"))
        found = {named(k)[0]: float(v) for k, v in table["metrics"].items()}
        signals = {named(k)[0]: np.array(v, dtype=float) for k, v in table["signals"].items()}
        t = np.array(table["instants"]["t [s]"], dtype=float)
        if any(v.shape != t.shape for v in signals.values()):
            raise ValueError("signals and t differ in length")
    except (OSError, ValueError, KeyError, TypeError, AttributeError) as error:
        why = f"'{error.args[0]}' is missing" if isinstance(error, KeyError) else str(error)
        why = f"{path}: this is no baseline: {why}. pytest --tracking-accept writes it again."
        raise FileError(str(path), [why]) from None
    return Baseline(found, units, t, signals, signal_units)


def draw(found: Sequence[Change], before: Baseline, now: Baseline, path: Path, title: str) -> Path:
    """Plot the signals before and now, and their difference; returns the path. Needs matplotlib; raises OSError."""
    from tsmblocks.plots.runs import plot_tracking_changes

    path.parent.mkdir(parents=True, exist_ok=True)
    names = ", ".join(one.name for one in found)
    replace_figure(path, plot_tracking_changes(before, now, f"{title}: {names}"), dpi=120)
    return path


def _key(name: str, unit: str) -> str:
    """A heading as a quoted key of TOML, which escapes as JSON does."""
    return json.dumps(heading(name, unit), ensure_ascii=False)
