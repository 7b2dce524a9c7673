"""Options on the parameters of a model that several commands fit."""

from __future__ import annotations

from collections.abc import Callable

from tsmblocks.cli import common


def local_and_bounds(add: Callable[..., None]) -> None:
    """Declare --local and --bounds."""
    own = "parameters with a value of their own in each experiment"
    add("--local", metavar="PATTERN", default=[], help=own, **common.SEVERAL)
    sides = "bounds of a parameter; either side may be left out"
    add("--bounds", metavar="NAME=LOW:HIGH", type=bounds, default=[], help=sides, **common.SEVERAL)


def bounds(text: str) -> tuple[str, tuple[float | None, float | None]]:
    """``NAME=LOW:HIGH``; either may be left out."""
    form = "NAME=LOW:HIGH, such as tsm.theta=0.1:50"
    name, value = common.name_and_value(text, form)
    return name, common.number_range(value, form, text)
