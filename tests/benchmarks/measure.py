"""How this benchmark measures: contestants race in turns, results are checked before a time is shown."""

from __future__ import annotations

import json
import time
from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass, field
from pathlib import Path
from typing import Any

import numpy as np


@dataclass
class Best:
    """The shortest times of several repetitions, in s."""

    wall: float = float("inf")
    cpu: float = float("inf")
    count: int = 0

    def add(self, wall: float, cpu: float) -> None:
        """Take one more repetition into account."""
        self.wall, self.cpu, self.count = min(self.wall, wall), min(self.cpu, cpu), self.count + 1


def timed(run: Callable[[], Any], best: Best | None = None) -> Best:
    """Run once and note the times."""
    best = best or Best()
    wall, cpu = time.perf_counter(), time.process_time()
    run()
    best.add(time.perf_counter() - wall, time.process_time() - cpu)
    return best


def race(contestants: Mapping[str, Callable[[], Any]], rounds: int, budget: float = 0.1) -> dict[str, Best]:
    """Best times of each, taken in turns so that a slow minute of the machine hits all alike.

    In each round a contestant runs once, and again while it has used less than ``budget`` seconds.
    """
    best = {name: Best() for name in contestants}
    for _ in range(rounds):
        for name, run in contestants.items():
            began = time.perf_counter()
            while True:
                timed(run, best[name])
                if time.perf_counter() - began > budget:
                    break
    return best


def difference(a: Mapping[str, np.ndarray], b: Mapping[str, np.ndarray]) -> float:
    """Largest difference between the signals that two runs share; NaN counts as infinite."""
    shared = [k for k in a if k in b]
    if not shared:
        return float("inf")
    worst = 0.0
    for k in shared:
        if np.shape(a[k]) != np.shape(b[k]):
            return float("inf")
        largest = float(np.max(np.abs(np.asarray(a[k]) - np.asarray(b[k]))))
        worst = max(worst, largest if np.isfinite(largest) else float("inf"))
    return worst


def spread_of_tail(error: np.ndarray) -> float:
    """Peak to peak over the last half of a run: of 20 s, the last 10."""
    return float(np.ptp(error[len(error) // 2 :]))


@dataclass
class Report:
    """Everything found: tables as printed, checks of equality, bars."""

    quick: bool
    found: dict[str, Any] = field(default_factory=dict)
    bars: list[tuple[str, str, str, bool | None]] = field(default_factory=list)
    failed: list[str] = field(default_factory=list)

    def say(self, text: str = "") -> None:
        """Print at once, so that a long run shows where it is."""
        print(text, flush=True)

    def check(self, name: str, off: float, tolerance: float) -> bool:
        """Note whether a result is equal within its tolerance."""
        good = bool(off <= tolerance)
        self.found.setdefault("checks", {})[name] = {"difference": off, "tolerance": tolerance, "equal": good}
        if not good:
            self.failed.append(f"{name}: differs by {off:.3g}, tolerance {tolerance:g}")
            self.say(f"CHECK FAILED  {self.failed[-1]}; its time is withheld.")
        return good

    def table(self, title: str, head: Sequence[str], rows: Sequence[Sequence[str]]) -> None:
        """Print a Markdown table and keep it."""
        widths = [max(len(str(r[k])) for r in [head, *rows]) for k in range(len(head))]

        def line(cells: Sequence[str]) -> str:
            padded = [
                str(c).ljust(w) if k == 0 else str(c).rjust(w)
                for k, (c, w) in enumerate(zip(cells, widths, strict=True))
            ]
            return f"| {' | '.join(padded)} |"

        rule = "|".join(["", "-" * (widths[0] + 2), *(f"{'-' * (w + 1)}:" for w in widths[1:]), ""])
        self.say(f"\n{title}\n\n{line(head)}\n{rule}")
        for row in rows:
            self.say(line(row))
        self.found.setdefault("tables", []).append(
            {"title": title, "head": list(head), "rows": [list(r) for r in rows]}
        )

    def note(self, key: str, value: Any) -> None:
        """Keep a number for the JSON file."""
        self.found.setdefault("numbers", {})[key] = value

    def bar(self, what: str, figure: float | None, limit: float, unit: str = "", at_least: bool = False) -> None:
        """Hold a figure against a bar of the design; None when it could not be measured."""
        sign = "at least" if at_least else "at most"
        if figure is None or not np.isfinite(figure):
            self.bars.append((what, "not measured", f"{sign} {limit:g}{unit}", None))
        else:
            good = figure >= limit if at_least else figure <= limit
            self.bars.append((what, f"{figure:.3g}{unit}", f"{sign} {limit:g}{unit}", bool(good)))

    def finish(self, path: Path | None) -> int:
        """Print the bars, write the JSON file; the exit code."""
        words = {True: "pass", False: "MISS", None: "-"}
        self.table("Bars", ["bar", "figure", "limit", ""], [(a, b, c, words[d]) for a, b, c, d in self.bars])
        for text in self.failed:
            self.say(f"CHECK FAILED  {text}")
        if path is not None:
            self.found["bars"] = [
                dict(zip(("bar", "figure", "limit", "passed"), row, strict=True)) for row in self.bars
            ]
            self.found["failed"] = self.failed
            path.write_text(json.dumps(self.found, indent=1, default=float) + "\n")
        return 1 if self.failed else 0


def ms(seconds: float) -> str:
    """Milliseconds, three figures."""
    return three(1e3 * seconds)


def three(x: float) -> str:
    """Three significant figures without an exponent."""
    if not np.isfinite(x):
        return "-"
    digits = max(0, 2 - int(np.floor(np.log10(abs(x))))) if x else 0
    return f"{x:.{digits}f}"
