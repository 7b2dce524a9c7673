"""Parameters of a diagram that compensate for a large effect that is missing in it."""

from __future__ import annotations

from collections.abc import Mapping

from tsmblocks.diagnosis.model import Model

LARGE_ERROR = 25.0
"""Mean square of a residual [that of the noise] beside which a parameter far from its first value is in doubt. Chosen:
an error of five times the noise is a model error, and parameters compensate for what they can of it."""
MAX_FACTOR = 3.0
"""Ratio of a fitted value to the first one, or its inverse, up to which it is near. Chosen: a data sheet is better."""


def parameters_in_doubt(model: Model, given: Mapping[str, float], error: float) -> tuple[str, ...]:
    """Parameters that were fitted far from their values in the diagram, ``given``, in words: ``J.gain (310 for 2000)``.

    ``error`` is the mean square of the residual [that of the noise]. None beside a small one, and none that began at
    zero.
    """
    if error <= LARGE_ERROR:
        return ()
    pairs = {name: (value, float(given[name])) for name, value in model.parameters().items() if given.get(name)}
    far = {
        k: (value, first) for k, (value, first) in pairs.items() if not 1 / MAX_FACTOR <= value / first <= MAX_FACTOR
    }
    return tuple(f"{name} ({value:.3g} for {first:.3g})" for name, (value, first) in far.items())
