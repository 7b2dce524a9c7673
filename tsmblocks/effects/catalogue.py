"""The catalogue of effects: those of the toolbox, and those that users register."""

from __future__ import annotations

from collections.abc import Iterator
from contextlib import contextmanager
from typing import TypeVar

from tsmblocks.common.errors import ParameterError, in_words
from tsmblocks.effects import delay, friction, loop, maps, time_varying
from tsmblocks.effects.effect import Effect
from tsmblocks.effects.relative import Relative
from tsmblocks.effects.relatives import RELATIVES
from tsmblocks.model.block import REGISTRY

_OWN: list[Effect] = []
_OWN_RELATIVES: list[Relative] = []
One = TypeVar("One", bound=Effect | Relative)


def catalogue() -> tuple[Effect, ...]:
    """Return every effect of the catalogue.

    Returns
    -------
    tuple of Effect
        The effects of the toolbox in a fixed order, then the registered ones; variants of one name are neighbours.
    """
    shipped = (friction, loop, delay, maps, time_varying)
    return (*(effect for module in shipped for effect in module.EFFECTS), *_OWN)


def relatives() -> tuple[Relative, ...]:
    """Return every relative: the blocks that may replace a block of a model.

    Returns
    -------
    tuple of Relative
        The relatives of the toolbox in a fixed order, then the registered ones.
    """
    return (*RELATIVES, *_OWN_RELATIVES)


def register(effect: One) -> One:
    """Add an effect to the catalogue, or a relative to the blocks that may replace others.

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
    if isinstance(effect, Relative):
        if any(_relative_key(one) == _relative_key(effect) for one in relatives()):
            raise ParameterError(
                f"there is a relative '{effect.name}' of {effect.of.__name__} already; give this one another name, or "
                "a variant."
            )
        _OWN_RELATIVES.append(effect)
        return effect
    if not isinstance(effect, Effect):
        raise ParameterError(f"register takes an Effect or a Relative, got {in_words(effect)}.")
    _OWN[:] = [one for one in _OWN if not _is_redefined(one, effect)]
    if any(_key(e) == _key(effect) for e in catalogue()):
        raise ParameterError(
            f"there is an effect '{effect.name}' at the place '{effect.place}' already; give this one "
            "another name, or a variant."
        )
    _OWN.append(effect)
    return effect


def _is_redefined(old: Effect, new: Effect) -> bool:
    """Whether an effect is the same as a new one, but of a block that has been redefined."""
    kind, known = type(old.block), REGISTRY.get(type(old.block).__name__)
    return _key(old) == _key(new) and type(new.block) is known is not kind


def _key(effect: Effect) -> tuple[str, str, str]:
    return effect.name, effect.variant, effect.place


def _relative_key(relative: Relative) -> tuple[type, str, str]:
    return relative.of, relative.name, relative.variant


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
    count, relative_count = len(_OWN), len(_OWN_RELATIVES)
    try:
        for effect in effects:
            register(effect)
        yield
    finally:
        _OWN[count:] = [one for one in _OWN[count:] if not any(one is effect for effect in effects)]
        kept = [one for one in _OWN_RELATIVES[relative_count:] if not any(one is effect for effect in effects)]
        _OWN_RELATIVES[relative_count:] = kept
