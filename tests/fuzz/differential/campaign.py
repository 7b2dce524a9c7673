"""Many random diagrams, each run in ways that take turns; faults are kept with their seed and the shrunk diagram."""

from __future__ import annotations

import itertools
import shutil
import time

from tests.fuzz.attack import Count
from tests.fuzz.differential.agreement import Disagreement, check, shrunk
from tests.fuzz.differential.diagrams import Drawn, drawn
from tsmblocks.common.errors import TsmError

TURNS = (("casadi",), ("nested",), ("batch",), ("stepper",))
"""Ways of one diagram after the other. Chosen: compiling takes most of the time."""
C_EVERY = 24
"""Every how many diagrams the C code is compiled, too."""
PER_ROUND = 1_000_000
"""Seeds of diagrams that belong to one seed of a campaign."""


def campaign(seed: int, *, diagrams: int | None = None, seconds: float = float("inf")) -> Count:
    """Compare so many diagrams, or for so long; the same seed gives the same diagrams. ``refused``: not compared."""
    count, until = Count(), time.monotonic() + seconds
    for k in itertools.count():
        if time.monotonic() >= until or k == diagrams:
            return count
        ways = TURNS[k % len(TURNS)] + (("C",) if k % C_EVERY == 0 and shutil.which("gcc") else ())
        made = drawn(PER_ROUND * seed + k)
        count.inputs += 1
        fault = fault_of(made, ways)
        if fault is None:
            continue
        if fault.startswith(("refused", "no reference", "huge", "sensitive")):
            count.refused += 1
        else:
            count.fault(
                fault, described(shrunk(made, lambda less, w=ways, f=fault: kind(fault_of(less, w)) == kind(f)))
            )
    return count


def fault_of(made: Drawn, ways: tuple[str, ...]) -> str | None:
    """What is wrong with a diagram, or why it was not compared; None where all agree."""
    try:
        return check(made, ways) or None
    except Disagreement as error:
        return str(error)
    except TsmError as error:
        return f"refused by one way alone: {type(error).__name__}: {error}"
    except Exception as error:
        return f"{type(error).__name__}: {error}"


def kind(fault: str | None) -> str:
    """A fault without its numbers."""
    return (fault or "").partition(":")[0]


def described(made: Drawn) -> str:
    """A diagram in words: its seed, method and inputs, its blocks and what drives them."""
    lines = [f"seed {made.seed}, {made.method}, inputs { ({k: hold for k, (hold, _) in made.inputs.items()}) }"]
    for name, block in made.blocks.items():
        wires = {port: ".".join(made.driver[name, port]) for port in block.inports if (name, port) in made.driver}
        lines.append(f"{name} = {block} {wires}")
    return "\n".join(lines)
