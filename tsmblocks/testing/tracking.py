"""Regression tests on tracking error: what a diagram's metrics were, what they are, and from when on they differ.

A guard says which diagram is run and what is measured; a baseline, kept in a file that people can read, holds its
metrics and a thinned-out course of its signals.
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
TOLERANCES = {"exact": 1e-12, "tight": 1e-6, "normal": 1e-3, "loose": 1e-2, "coarse": 5e-2}
"""How far a metric may move, as a share of its baseline. Rounding moves it by less than ``tight``."""
NOTHING = 1e-15
"""A metric below this (in its own unit) is zero, and may be any other number below it."""
COURSE = 200
"""Instants of the signals that a baseline keeps, at most."""
DIGITS = 7
"""Digits of a signal in a baseline."""


@attrs.frozen(eq=False)
class Guard:
    """What is watched: a diagram, how it is run, metrics with the tolerance class of each.

    ``how`` are arguments of ``simulate``.
    """

    diagram: Diagram
    metrics: tuple[Metric, ...]
    tolerances: Mapping[str, float]
    how: Mapping[str, Any]

    def run(self) -> Baseline:
        """Run the diagram and measure."""
        wanted = list(dict.fromkeys(name for one in self.metrics for name in one.signals))
        run = simulate(self.diagram, **self.how)
        step = max(1, math.ceil((len(run.t) - 1) / COURSE))
        found = {one.name: one(run.t, {k: run[k] for k in one.signals}) for one in self.metrics}
        for name, value in found.items():
            if math.isnan(value):
                raise RunError(f"metric '{name}' is no number here, so there is nothing to guard by it.")
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
            "# What the metrics were when this was accepted; pytest --tracking-accept writes it anew.",
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
class Moved:
    """A metric that is not what it was; ``before`` is None for a new one, ``now`` for one that is gone."""

    name: str
    unit: str
    before: float | None
    now: float | None
    allowed: float

    @property
    def share(self) -> float:
        """By how much, as a share of what it was; infinite where that was nothing."""
        if self.before is None or self.now is None or not abs(self.before) > NOTHING:
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


def moved(watched: Guard, before: Baseline, now: Baseline) -> list[Moved]:
    """Metrics that are further from their baseline than their class allows, and those that came or went."""
    found = []
    for name, value in now.metrics.items():
        old, allowed = before.metrics.get(name), watched.tolerances[name]
        other = old is not None and before.units[name] != now.units[name]
        if old is None or other or not _same(old, value, allowed):
            found.append(Moved(name, now.units[name], old, value, allowed))
    gone = [name for name in before.metrics if name not in now.metrics]
    return [*found, *(Moved(name, before.units[name], before.metrics[name], None, 0.0) for name in gone)]


def _same(before: float, now: float, allowed: float) -> bool:
    if math.isfinite(before) and math.isfinite(now):
        return abs(now - before) <= max(allowed * abs(before), NOTHING)
    return before == now


def since(before: Baseline, now: Baseline, share: float) -> tuple[str, float] | None:
    """The signal that first leaves its course by more than a share of its range, and when [s]; None if none does."""
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


def in_sentences(found: Sequence[Moved], before: Baseline, now: Baseline) -> str:
    """What moved, by how much, and from when in the run on."""
    from tsmblocks.common.tables import columns

    rows = [("metric", "baseline", "now", "moved", "allowed")]
    for one in found:
        share = (
            f"{100 * one.share:+.3g} %"
            if math.isfinite(one.share)
            else "new"
            if one.before is None
            else "gone"
            if one.now is None
            else "from nothing"
        )
        rows.append(
            (heading(one.name, one.unit), _shown(one.before), _shown(one.now), share, f"{100 * one.allowed:g} %")
        )
    allowed = min((one.allowed for one in found if one.now is not None), default=1e-3)
    start = since(before, now, max(0.1 * allowed, 1e-7))
    when = f"\nThe signals part at t = {start[1]:.4g} s, {start[0]} first." if start else ""
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
            str(path), [f"{path}: this is no baseline: {why}. pytest --tracking-accept writes it anew."]
        ) from None
    return Baseline(
        {k: v for (k, _), v in measured.items()},
        dict(measured.keys()),
        t,
        {k: v for (k, _), v in signals.items()},
        dict(signals.keys()),
    )


def draw(found: Sequence[Moved], before: Baseline, now: Baseline, path: Path, title: str) -> Path:
    """A picture of the signals then and now, and of their difference; its path. Needs matplotlib."""
    from tsmblocks.plots.tracking import plot_moved

    path.parent.mkdir(parents=True, exist_ok=True)
    names = [one.name for one in found]
    plot_moved(before, now, f"{title}: {', '.join(names)}").savefig(path, dpi=120)
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
