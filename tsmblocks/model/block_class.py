"""A class as a block: what it may declare, how its blocks are made, and that they do not change."""

from __future__ import annotations

import functools
from collections.abc import Callable, Mapping
from typing import TYPE_CHECKING, Any

from tsmblocks.common.errors import BlockError, ParameterError, in_words
from tsmblocks.model.aliases import unknown_fields
from tsmblocks.model.values import is_reference, plain, validate

if TYPE_CHECKING:
    from tsmblocks.model.block import Block


def check_declarations(cls: type[Block]) -> None:
    """Raise BlockError for a name that no block can use, ParameterError for a default out of its bounds."""
    owner, base = cls.__name__, cls.__bases__[0]
    for name, annotation in vars(cls).get("__annotations__", {}).items():
        if name in cls._declared:
            raise BlockError(f"{owner}.{name} is a port and takes no annotation: {name} = Input(…) or Output(…).")
        if name not in cls._fields and "ClassVar" not in str(annotation):
            raise BlockError(f"{owner}.{name} must be made by parameter, option or state (or be a ClassVar).")
    for name in (*cls._declared, *cls._fields):
        if hasattr(base, name) or name.startswith("_"):
            raise BlockError(f"{owner}: '{name}' cannot name a port or a parameter. Choose another name.")
    for name, field in cls._fields.items():
        try:
            validate(owner, name, field, plain(field.default))
        except ParameterError as error:
            raise ParameterError(f"the default of {error}") from None


def by_name_only(init: Callable[..., None], cls: type[Block]) -> Callable[..., None]:
    """The constructor, with this package's message for an unknown name or a positional argument."""

    @functools.wraps(init)
    def by_name(self: Block, *args: Any, **values: Any) -> None:
        if args:
            first = next(iter(cls._fields), "gain")
            raise ParameterError(f"{cls.__name__} takes its parameters by name: {first}={in_words(args[0])}.")
        if unknown := [name for name in values if name not in cls._fields]:
            raise ParameterError(unknown_fields(cls.__name__, unknown, cls._fields))
        init(self, **values, **_opposites(cls, values))

    return by_name


def _opposites(cls: type[Block], given: Mapping[str, Any]) -> dict[str, float]:
    """Values of parameters of which only the opposite is given. Raises ParameterError where that is no number."""
    made = {}
    for name, field in cls._fields.items():
        if field.opposite in given and name not in given:
            other = plain(given[field.opposite])
            if is_reference(other):
                fault = f"{cls.__name__}.{name} must be given where {field.opposite} refers to values ({other})"
                raise ParameterError(f"{fault}. It is: {field.about}.")
            if isinstance(other, float) and cls._fields[field.opposite].allows(other):  # else that is refused
                made[name] = 0.0 - other
    return made


class Unchanging(AttributeError):
    """An attempt to set an attribute of a block."""


def refuse_change(self: Block, name: str, value: Any) -> None:
    """Raise Unchanging, with the way to a changed block or diagram."""
    one = f"A {type(self).__name__} with another {name} is block.replace({name}={in_words(value)})"
    whole = (
        f"a diagram with it is diagram.with_parameters({{'NAME.{name}': {in_words(value)}}}), NAME being the block's."
    )
    raise Unchanging(f"a block does not change. {one}; {whole}", name=name)
