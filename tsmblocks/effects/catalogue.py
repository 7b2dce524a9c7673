"""The catalogue of effects: those that come with the toolbox, and those that users register."""

from __future__ import annotations

from collections.abc import Iterator
from contextlib import contextmanager

from tsmblocks.common.errors import ParameterError, in_words
from tsmblocks.effects import delay, friction, loop, maps, time_varying
from tsmblocks.effects.effect import Effect
from tsmblocks.model.block import REGISTRY

_OWN: list[Effect] = []


def catalogue() -> tuple[Effect, ...]:
    """Every effect, the toolbox's own first, in a fixed order; variants of one name follow each other."""
    shipped = (friction, loop, delay, maps, time_varying)
    return (*(effect for module in shipped for effect in module.EFFECTS), *_OWN)


def register(effect: Effect) -> Effect:
    """Let an effect take part in every diagnosis from now on.

    Where its block has been defined anew (a notebook's cell, a module loaded again), the effect replaces the one of
    the block before. Raises ParameterError for one that is there already.
    """
    if not isinstance(effect, Effect):
        raise ParameterError(f"register takes an Effect, got {in_words(effect)}.")
    _OWN[:] = [one for one in _OWN if not _outlived(one, effect)]
    if any(_key(e) == _key(effect) for e in catalogue()):
        raise ParameterError(
            f"there is an effect '{effect.name}' at the place '{effect.place}' already; give this one "
            "another name, or a variant."
        )
    _OWN.append(effect)
    return effect


def _outlived(old: Effect, new: Effect) -> bool:
    """Whether an effect is the same as a new one, but of a block that no longer is what its name means."""
    kind, known = type(old.block), REGISTRY.get(type(old.block).__name__)
    return _key(old) == _key(new) and type(new.block) is known is not kind


def _key(effect: Effect) -> tuple[str, str, str]:
    return effect.name, effect.variant, effect.place


@contextmanager
def registered(*effects: Effect) -> Iterator[None]:
    """Effects that take part within a ``with`` block. Raises what ``register`` raises, and then none takes part."""
    count = len(_OWN)
    try:
        for effect in effects:
            register(effect)
        yield
    finally:
        _OWN[count:] = [one for one in _OWN[count:] if not any(one is effect for effect in effects)]
