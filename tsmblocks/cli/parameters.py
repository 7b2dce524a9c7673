"""Options on the parameters of a model that several commands take."""

from __future__ import annotations

import re
from collections.abc import Callable, Iterable
from typing import TYPE_CHECKING, Any

from tsmblocks.cli import common
from tsmblocks.common import units

if TYPE_CHECKING:
    from tsmblocks.model.diagram import Diagram

_QUANTITY = re.compile(r"([+-]?(?:\d+\.?\d*|\.\d+)(?:[eE][+-]?\d+)?)\s*([^\W\d_].*)")
"""A number and its unit."""


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


def noise_names(what: str) -> tuple[tuple[str, str], ...]:
    """The argument ``what`` that gives noise, as messages name it, and its option."""
    option = f"--{what.replace('_', '-')}"
    return (rf"\b{what}=", f"{option} "), (rf"^{what}\b", option)


def noise(what: str) -> Callable[[str], str]:
    """The type of the option that gives noise as argument ``what``: a number, optionally with a unit and an output."""

    def checked(text: str) -> str:
        from tsmblocks.fitting.noise import parsed

        with common.option_names(noise_names(what)):
            parsed(text, what)
        return text

    return checked


def with_settings(diagram: Diagram, settings: Iterable[tuple[str, Any]]) -> Diagram:
    """The diagram with the values of --set; one with a unit (``1deg``) is converted to that of its parameter.

    Raises UsageError where a unit does not fit, ParameterError as ``Diagram.with_parameters``.
    """
    return diagram.with_parameters({name: _in_own_unit(diagram, name, value) for name, value in settings})


def _in_own_unit(diagram: Diagram, name: str, value: Any) -> Any:
    """A value of --set; unchanged where it is no number with a unit, or the name is none of a number."""
    match = _QUANTITY.fullmatch(value) if isinstance(value, str) else None
    if match is None or name not in diagram.parameters:
        return value
    from tsmblocks.fitting.parameters import numbers
    from tsmblocks.model.parameter_units import unit_of

    unit = unit_of(name, diagram, numbers(diagram)[name])
    if not unit:
        raise common.UsageError(f"--set {name}={value}: no unit of {name} is known; give a plain number.")
    try:
        return float(match[1]) * units.factor(match[2], unit)
    except units.UnitError as error:
        raise common.UsageError(f"--set {name}={value}: {error}") from None
