"""The noise floor of every measured output, given or found in the recordings."""

from __future__ import annotations

from collections.abc import Mapping, Sequence

import attrs

from tsmblocks.data import Record
from tsmblocks.diagram import Diagram
from tsmblocks.errors import DataError
from tsmblocks.fitting.noise_of import WEAK, noise_of

GIVEN = "given"
"""The way of a floor that the user knows."""


@attrs.frozen
class Floors:
    """Noise of each output, in the diagram's unit, and how it was found; ``known`` unless only fast noise was seen.

    ``given`` says it in the words of the user, where it was given.
    """

    sigma: Mapping[str, float]
    method: Mapping[str, str]
    known: bool
    given: Mapping[str, str] = attrs.field(factory=dict)


def floors(
    records: Mapping[str, Record], diagram: Diagram, outputs: Sequence[str], asked: Mapping[str, tuple[float, str]]
) -> Floors:  # fmt: skip
    """The noise floors: those that were asked for (see asked_floors), and for the other outputs those found.

    Raises DataError where an output shows no noise at all.
    """
    sigma, method = dict[str, float](), dict[str, str]()
    for name in outputs:
        if name in asked:
            sigma[name], method[name] = asked[name][0], GIVEN
        else:
            sigma[name], method[name] = _found(records, diagram, name)
    return Floors(sigma, method, all(m != WEAK for m in method.values()), {k: words for k, (_, words) in asked.items()})


def _found(records: Mapping[str, Record], diagram: Diagram, name: str) -> tuple[float, str]:
    """The noise that the recordings show. Raises DataError where they show none."""
    middle, method = noise_of(records, diagram, name)
    if not middle > 0:
        raise DataError(f"no noise was found in {name}, so nothing says what counts as a difference. Give the noise "
                        f"floor with its unit: noise_floor=…{diagram.unit(name)}.")  # fmt: skip
    return middle, method
