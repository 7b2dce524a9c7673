"""The noise floor of every measured output, given or found in the recordings."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from typing import Any

import attrs
import numpy as np

from tsmblocks import units
from tsmblocks.arguments import is_number
from tsmblocks.data import Record, noise
from tsmblocks.diagram import Diagram
from tsmblocks.errors import DataError, ParameterError, in_words, near

GIVEN = "given"
"""The way of a floor that the user knows."""
WEAK = "high frequencies"
"""The way of finding a floor that misses slow noise: no model may be called wrong by it alone."""


@attrs.frozen
class Floors:
    """Noise of each output, in the diagram's unit, and how it was found; ``known`` unless only fast noise was seen."""

    sigma: Mapping[str, float]
    method: Mapping[str, str]
    known: bool


def floors(records: Mapping[str, Record], diagram: Diagram, outputs: Sequence[str], given: Any) -> Floors:
    """The noise floors. ``given`` is a number [unit of the output], a mapping by output, or None to look for them.

    Raises ParameterError for a floor that is none, DataError where an output shows no noise at all.
    """
    asked = asked_floors(given, outputs)
    sigma, method = dict[str, float](), dict[str, str]()
    for name in outputs:
        if name in asked:
            sigma[name], method[name] = asked[name], GIVEN
        else:
            sigma[name], method[name] = _found(records, diagram, name)
    return Floors(sigma, method, all(m != WEAK for m in method.values()))


def asked_floors(given: Any, outputs: Sequence[str]) -> dict[str, float]:
    """The floors that were given, by output; empty for None. Raises ParameterError for one that is none."""
    if given is None:
        return {}
    each = dict(given) if isinstance(given, Mapping) else dict.fromkeys(outputs, given)
    for name, value in each.items():
        if name not in outputs:
            raise ParameterError(f"noise_floor: '{name}' is no measured output.{near(name, outputs)}")
        if not is_number(value) or not 0 < value < np.inf:
            raise ParameterError(f"noise_floor of '{name}' must be a positive number, got {in_words(value)}.")
    return {name: float(value) for name, value in each.items()}


def _found(records: Mapping[str, Record], diagram: Diagram, name: str) -> tuple[float, str]:
    """The middle of what the experiments say, those before others that show more than fast noise."""
    inputs = [k for k in diagram.inports if all(k in r for r in records.values())]
    found = [(noise(r, name, inputs=inputs or None), r) for r in records.values()]
    sound = [one for one in found if one[0].method != WEAK] or found
    values = [n.floor * _factor(r.unit(name), diagram.unit(name)) for n, r in sound]
    middle = float(np.median(values))
    if not middle > 0:
        raise DataError(f"no noise was found in {name}, so nothing says what counts as a difference. Give the noise "
                        f"floor: noise_floor=… [{diagram.unit(name) or 'unit of the output'}].")  # fmt: skip
    methods = [n.method for n, _ in sound]
    return middle, max(sorted(set(methods)), key=methods.count)


def _factor(own: str, wanted: str) -> float:
    return units.factor(own, wanted) if own and wanted else 1.0
