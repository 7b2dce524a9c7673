"""Parameters of a diagram that compensate for a large effect that is missing in it."""

from __future__ import annotations

from collections.abc import Mapping

from tsmblocks.common.tables import listed
from tsmblocks.diagnosis.model import Model

LARGE_ERROR = 4.0
"""Mean square of a residual [that of the noise] beside which a parameter far from its first value is in doubt. Chosen:
an error of twice the noise is a model error, and parameters compensate for what they can of it."""
MAX_FACTOR = 3.0
"""Ratio of a fitted value to the first one, or its inverse, up to which it is near. Chosen: a data sheet is better."""
FAR = 1.5
"""The same, where no effect is found, from which a value is reported as far from the first one. Chosen: more than the
tolerance of most data sheets."""


def notes_on_moved(model: Model, given: Mapping[str, float]) -> list[str]:
    """A note where no effect is found and parameters were fitted far from the diagram's: they may stand in for one."""
    moved = _in_words(far_from(model, with_a_scale(given), FAR))
    if not moved:
        return []
    were, they = ("was", "it") if len(moved) == 1 else ("were", "they")
    return [
        f"{listed(moved, 4)} {were} fitted far from the diagram: {they} may compensate for an effect. Where a value of "
        "the diagram is known, leave it out of --free (in Python free)."
    ]


def parameters_in_doubt(model: Model, given: Mapping[str, float], error: float) -> tuple[str, ...]:
    """Parameters that were fitted far from their values in the diagram, ``given``, in words: ``J.gain (310 for 2000)``.

    ``error`` is the mean square of the residual [that of the noise]. None beside a small one, and none that began at
    zero.
    """
    return _in_words(far_from(model, given)) if error > LARGE_ERROR else ()


def far_from(model: Model, given: Mapping[str, float], factor: float = MAX_FACTOR) -> dict[str, tuple[float, float]]:
    """Parameters that were fitted to more than a factor of those given, with both values; none that began at zero."""
    pairs = {name: (value, float(given[name])) for name, value in model.parameters().items() if given.get(name)}
    return {k: (value, first) for k, (value, first) in pairs.items() if not 1 / factor <= value / first <= factor}


def with_a_scale(given: Mapping[str, float]) -> dict[str, float]:
    """Those of some parameters whose ratio means something: offsets have no scale."""
    return {name: value for name, value in given.items() if not name.endswith(".bias")}


def _in_words(far: Mapping[str, tuple[float, float]]) -> tuple[str, ...]:
    return tuple(f"{name} ({value:.3g} for {first:.3g})" for name, (value, first) in far.items())
