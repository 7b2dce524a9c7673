"""Interpolation of the inputs of recordings between samples: as given, or as found from the samples, input by input."""

from __future__ import annotations

from collections.abc import Iterable, Iterator, Mapping

import numpy as np

from tsmblocks.common.interpolation import AUTO, Hold, found_hold, hold_of_each, is_held
from tsmblocks.data import Record


def resolved_holds(record: Record, inputs: Iterable[str], hold: Hold, orders: Mapping[str, int]) -> dict[str, str]:
    """The hold of each input of a recording; ``orders`` are the highest time derivatives that the diagram takes.

    Raises DataError for an unknown hold, and for one of an unknown input.
    """
    given = hold_of_each(hold, list(inputs))
    return {k: found_hold(record.t, record[k], orders.get(k, 0)) if v == AUTO else v for k, v in given.items()}


def common_holds(experiments: Iterable[tuple[Record, Mapping[str, str]]]) -> dict[str, str]:
    """The hold of each input in all experiments, ``"auto"`` where it differs; an input that rests has any."""
    found: dict[str, set[str]] = {}
    for record, holds in experiments:
        for name, hold in holds.items():
            found.setdefault(name, set()).update([hold] if np.ptp(record[name]) > 0 else [])
    return {name: next(iter(those)) if len(those) == 1 else AUTO for name, those in found.items()}


def in_one_word(holds: Mapping[str, str]) -> Hold:
    """The hold of all inputs where they share one, else those by input."""
    those = set(holds.values())
    return dict(holds) if len(those) > 1 else those.pop() if those else AUTO


def hold_text(hold: Hold) -> str:
    """The hold of all inputs, or of each of them, in words."""
    return hold if isinstance(hold, str) else ", ".join(f"{name} {one}" for name, one in hold.items())


def hold_notes(record: Record, holds: Mapping[str, str], given: Hold) -> Iterator[str]:
    """A note on inputs that are piecewise constant: that they are held, or the consequence of another interpolation."""
    asked = hold_of_each(given, list(holds))
    for name, hold in holds.items():
        if name not in record or not is_held(record[name]):
            continue
        if asked[name] != AUTO:
            if hold != "zero":
                yield (
                    f"the input {name} is piecewise constant, and hold='{hold}' spreads each of its steps over a "
                    "sample interval. If it was a zero-order hold, as at the output of a sampled controller, give "
                    "hold='zero', or --hold zero."
                )
        elif hold == "zero":
            yield f"{name} is piecewise constant: held between samples (hold='zero')."
        else:
            yield (
                f"{name} is piecewise constant, but its rate drives the diagram: taken as {hold} between samples, "
                "which spreads each jump over a sample interval."
            )
