"""Which signals of a run are kept: names, patterns, and their columns."""

from __future__ import annotations

import math
from collections.abc import Iterable, Sequence
from fnmatch import fnmatchcase

from tsmblocks.common.arguments import as_list
from tsmblocks.common.errors import RunError, in_words, near
from tsmblocks.engine.equations import Equations
from tsmblocks.simulation.arguments import TimeGrid

MOST_NUMBERS = 250_000_000
"""Logged numbers (2 GB) above which a run is refused. Chosen."""


def logged_signals(eq: Equations, log: str | Iterable[str], times: TimeGrid) -> tuple[tuple[int, ...], tuple[str, ...]]:
    """Columns and names of the signals that are kept. Raises RunError for too many numbers."""
    chosen = _chosen(eq, log)
    if times.kept * len(chosen) > MOST_NUMBERS:
        fewer = times.every * 10 ** math.ceil(math.log10(times.kept * len(chosen) / MOST_NUMBERS))
        raise RunError(
            f"{times.kept} instants of {len(chosen)} signals would take "
            f"{times.kept * len(chosen) * 8 / 1e9:.0f} GB. Keep less: log='outputs', or every={fewer}."
        )
    return chosen, tuple(eq.y[k] for k in chosen)


def _chosen(eq: Equations, log: str | Iterable[str]) -> tuple[int, ...]:
    if log == "all":
        return tuple(range(len(eq.y)))
    patterns = [] if log == "outputs" else as_list(log) if isinstance(log, Iterable) else [log]
    for pattern in patterns:
        if not isinstance(pattern, str):
            raise RunError(f"log takes names and patterns such as 'tsm.*', got {in_words(pattern)}.")
    shown = set(eq.aliases.values())
    chosen = [
        k
        for k, name in enumerate(eq.y)
        if name in shown or any(fnmatchcase(name, eq.aliases.get(p, p)) for p in patterns)
    ]
    for pattern in patterns:
        if not any(fnmatchcase(name, eq.aliases.get(pattern, pattern)) for name in eq.y):
            raise RunError(f"log '{pattern}' matches no signal.{near(pattern, eq.y)}")
    return tuple(chosen)


def signal_positions(eq: Equations, names: Sequence[str]) -> list[int]:
    """Positions of signals or outputs in ``eq.y``. Raises RunError for an unknown name."""
    made = []
    for name in names:
        signal = eq.aliases.get(name, name)
        if signal not in eq.y:
            raise RunError(f"diagram '{eq.title}' has no signal '{name}'.{near(name, [*eq.aliases, *eq.y])}")
        made.append(eq.y.index(signal))
    return made


def kept_columns(eq: Equations, names: Sequence[str]) -> tuple[int, ...]:
    """The same positions, each once, as a kernel logs them. Raises RunError where no signal is named."""
    if not names:
        raise RunError(f"diagram '{eq.title}' has no outputs, so name the signals to keep: outputs=['block.port'].")
    return tuple(dict.fromkeys(signal_positions(eq, names)))
