"""Attacks on one target, counted: what was read, what was refused, and each other exception by where it arose."""

from __future__ import annotations

import random
import re
import time
import traceback
import warnings
from pathlib import Path
from typing import Any

import attrs

from tests.fuzz.targets import TARGETS
from tsmblocks.common.errors import CONTROLS, TsmError

SLOW = 10.0
"""Seconds from which an input is slow. Chosen: all of them are a matter of milliseconds."""
MOST_MESSAGE = 20_000
"""Characters of a message. Chosen: twenty problems of a file."""


@attrs.define
class Count:
    """Inputs of one target, and the first input of each fault by the place where it arose."""

    inputs: int = 0
    refused: int = 0
    faults: dict[str, Any] = attrs.field(factory=dict)

    def fault(self, place: str, given: Any) -> None:
        """Note a fault."""
        self.faults.setdefault(place, given)


def attack(name: str, folder: Path, seed: int, *, inputs: int | None = None, seconds: float = float("inf")) -> Count:
    """Attack a target with so many inputs, or for so long; the same seed gives the same inputs."""
    target, count, until = TARGETS[name], Count(), time.monotonic() + seconds
    rng = random.Random(f"{name} {seed}")
    with warnings.catch_warnings():
        warnings.simplefilter("ignore")
        while time.monotonic() < until and (inputs is None or count.inputs < inputs):
            given = target.spoilt(rng, folder)
            began = time.monotonic()
            count.inputs += 1
            try:
                target.read(given)
            except TsmError as error:
                count.refused += 1
                said = str(error)
                if CONTROLS.search(said) or len(said) > MOST_MESSAGE:
                    count.fault("a message with control characters, or too long", kept(given))
            except Exception as error:  # a fault, whatever it is
                count.fault(place_of(error), kept(given))
            if time.monotonic() - began > SLOW:
                count.fault(f"slow: {time.monotonic() - began:.0f} s", kept(given))
    return count


def place_of(error: Exception) -> str:
    """Kind of an exception, and the innermost function of the package in which it arose."""
    ours = [frame for frame in traceback.extract_tb(error.__traceback__) if "/tsmblocks/" in frame.filename]
    where = f"{Path(ours[-1].filename).name}:{ours[-1].name}" if ours else "?"
    return re.sub(r"0x[0-9a-f]+", "0x…", f"{type(error).__name__} in {where}: {str(error)[-200:]}")


def kept(given: Any) -> Any:
    """An input, as it can be kept: the content of a file."""
    return given.read_bytes() if isinstance(given, Path) else given
