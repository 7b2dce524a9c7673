"""The table of mistakes: what a user does wrong, and the whole text of what we answer.

A mistake is a function that makes it. ``@mistake(error, text)`` enters it; ``HERE`` in the text
stands for the file and line in which the diagram was written.
"""

from __future__ import annotations

import re
from collections.abc import Callable
from typing import Any

import attrs

from tsmblocks.blocks import PID, Saturation, Sine, Sum, TransferFunction
from tsmblocks.model.diagram import Diagram


@attrs.frozen
class Mistake:
    """One row of the table; ``cause`` says that the user's own exception is shown with ours."""

    make: Callable[[], Any]
    error: type[Exception]
    text: str
    cause: bool = False

    def __str__(self) -> str:
        return f"{self.make.__module__.rpartition('.')[2]}-{self.make.__name__}"


TABLE: list[Mistake] = []


def mistake(error: type[Exception], text: str, *, cause: bool = False) -> Callable[..., Any]:
    """Enter a function into the table, with what it raises."""

    def enter(make: Callable[[], Any]) -> Callable[[], Any]:
        TABLE.append(Mistake(make, error, text.strip("\n"), cause))
        return make

    return enter


def said(error: BaseException) -> str:
    """What the user reads, with places in test files made the same everywhere."""
    return re.sub(r"/[^\s:()]*/tests/mistakes/\w+\.py:\d+", "HERE", str(error))


BLOCKS: dict[str, Any] = dict(
    ref=Sine(amplitude=0.96, frequency=0.2, unit="rad"),
    error=Sum(signs="+-"),
    pid=PID(),
    drive=Saturation(),
    motor=TransferFunction(num=(2.0,), den=(0.02, 1.0, 0.0)),
)
WIRES = ("ref -> error.plus", "error -> pid -> drive -> motor -> error.minus")


def position_loop(**changes: Any) -> Diagram:
    """A sound position loop, with some of it changed."""
    given: dict[str, Any] = dict(blocks=BLOCKS, wires=WIRES, outputs={"angle": "motor"})
    return Diagram(title="position loop", **{**given, **changes})
