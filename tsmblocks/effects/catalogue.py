"""The catalogue of effects: those of the toolbox, and those that users register."""

from __future__ import annotations

from collections.abc import Iterator
from contextlib import contextmanager
from typing import TypeVar

from tsmblocks.common.errors import ParameterError, in_words
from tsmblocks.effects import (
    delay,
    end_stops,
    friction,
    limits,
    loads,
    loop,
    maps,
    scale_and_zero,
    time_varying,
    transmission,
)
from tsmblocks.effects.effect import Effect
from tsmblocks.effects.relative import Relative
from tsmblocks.effects.relatives import RELATIVES
from tsmblocks.model.block import REGISTRY

_OWN: list[Effect | Relative] = []
One = TypeVar("One", bound=Effect | Relative)


def catalogue() -> tuple[Effect, ...]:
    """Return every effect of the catalogue.

    Returns
    -------
    tuple of Effect
        The effects of the toolbox in a fixed order, then the registered ones; variants of one name are neighbours.
    """
    modules = (friction, loop, delay, limits, maps, end_stops, loads, scale_and_zero, time_varying, transmission)
    shipped = [effect for module in modules for effect in module.EFFECTS]
    names = list(dict.fromkeys(effect.name for effect in shipped))
    shipped.sort(key=lambda effect: names.index(effect.name))
    return (*shipped, *(e for e in _OWN if isinstance(e, Effect)))


def relatives() -> tuple[Relative, ...]:
    """Return every relative: the blocks that may replace a block of a model.

    Returns
    -------
    tuple of Relative
        The relatives of the toolbox in a fixed order, then the registered ones.
    """
    return (*RELATIVES, *(one for one in _OWN if isinstance(one, Relative)))


def register(effect: One) -> One:
    """Add an effect, or a relative, to the catalogue.

    Where its block has been redefined (in a notebook, or a reloaded module), it replaces the effect of the earlier one.

    Parameters
    ----------
    effect : Effect or Relative
        The effect, or the relative.

    Returns
    -------
    Effect or Relative
        The same one.

    Raises
    ------
    ParameterError
        For an effect that is in the catalogue already.
    """
    if not isinstance(effect, (Effect, Relative)):
        raise ParameterError(f"register takes an Effect or a Relative, got {in_words(effect)}.")
    _OWN[:] = [one for one in _OWN if not _is_redefined(one, effect)]
    known: tuple[Effect | Relative, ...] = (*catalogue(), *relatives())
    if any(_key(one) == _key(effect) for one in known):
        what = (
            f"an effect '{effect.name}' at the place '{effect.place}'"
            if isinstance(effect, Effect)
            else f"a relative '{effect.name}' of {effect.of.__name__}"
        )
        raise ParameterError(f"there is {what} already; give this one another name, or a variant.")
    _OWN.append(effect)
    return effect


def _is_redefined(old: Effect | Relative, new: Effect | Relative) -> bool:
    """Whether an effect is the same as a new one, but of a block that has been redefined."""
    if not isinstance(old, Effect) or not isinstance(new, Effect):
        return False
    kind, known = type(old.block), REGISTRY.get(type(old.block).__name__)
    return _key(old) == _key(new) and type(new.block) is known is not kind


def _key(one: Effect | Relative) -> tuple[str, str, str | type]:
    """The key that identifies an effect, or a relative."""
    return one.name, one.variant, one.place if isinstance(one, Effect) else one.of


@contextmanager
def registered(*effects: Effect | Relative) -> Iterator[None]:
    """Add effects to the catalogue, and relatives, within a ``with`` block.

    Parameters
    ----------
    *effects : Effect or Relative
        The effects and relatives.

    Yields
    ------
    None
        Nothing.

    Raises
    ------
    ParameterError
        As ``register`` does; none of the effects is then added.
    """
    count = len(_OWN)
    try:
        for effect in effects:
            register(effect)
        yield
    finally:
        _OWN[count:] = [one for one in _OWN[count:] if not any(one is effect for effect in effects)]
