"""Relatives: blocks that may replace a block of a model, such as Dahl for Coulomb friction."""

from __future__ import annotations

from collections.abc import Callable, Iterator, Mapping
from typing import Any

import attrs

from tsmblocks.common.errors import in_words
from tsmblocks.effects.effect import Effect, parameter_faults, refuse
from tsmblocks.effects.sizes import Size
from tsmblocks.effects.trials import Scales, Trials
from tsmblocks.model.block import Block
from tsmblocks.model.diagram import Diagram

REPLACED = "replaced"
"""The place of an effect that replaces a block."""


@attrs.frozen(eq=False)
class Relative:
    """A block that may replace a block of another class: another law for the same part of a machine.

    Parameters
    ----------
    of : type
        The class of the block that is replaced.
    name : str
        Name of the effect that this adds to the model, an identifier: ``"presliding_friction"``.
    family : str
        Group of related effects, as for ``Effect``.
    words : str
        The replacement in a sentence: ``"Coulomb friction replaced by Dahl friction (presliding)"``.
    block : callable
        Function from the fitted block and ``Scales`` to the block that replaces it, with parameters as near to the old
        ones as its law allows. The wire of the scales is the output of the old block, ``other`` the signal it reads.
    trials : callable
        Function from the same to ``Trials``: shapes give a starting value for each parameter in ``free``; None where
        the data do not excite the relative.
    free : tuple of str
        The parameters of the new block that are fitted.
    ports : mapping of str to str, default {}
        Ports of the old block, and the ports of the new block that take their wires, where names differ.
    instead_of_rate : bool, default False
        Whether the new block reads a position where the old one read its rate: it replaces the ``Derivative`` in front
        as well, and is tried only where there is one that drives nothing else.
    excites, separates, variant : str, default ""
        As for ``Effect``.
    confused, within, contains : tuple of str, default ()
        As for ``Effect``.
    sizes : tuple of Size, default ()
        As for ``Effect``.
    states : mapping of str to str, default {}
        States of the new block, and those of the old one that are the same under another name.

    Examples
    --------
    >>> from tsmblocks.blocks import Gain, Tanh
    >>> from tsmblocks.effects import Relative, Trials
    >>> Relative(
    ...     of=Gain,
    ...     name="saturation",
    ...     family="map",
    ...     words="a gain replaced by a tanh characteristic",
    ...     block=lambda old, scales: Tanh(),
    ...     trials=lambda old, scales: Trials({}, ({"scale": scales.other.reach},)),
    ...     free=("scale",),
    ... ).name
    'saturation'
    """

    of: type[Block]
    name: str
    family: str
    words: str
    block: Callable[[Any, Scales], Block | Diagram] = attrs.field(repr=False)
    trials: Callable[[Any, Scales], Trials | None] = attrs.field(repr=False)
    free: tuple[str, ...]
    ports: Mapping[str, str] = attrs.field(factory=dict)
    instead_of_rate: bool = False
    excites: str = ""
    separates: str = ""
    variant: str = ""
    confused: tuple[str, ...] = ()
    within: tuple[str, ...] = ()
    contains: tuple[str, ...] = ()
    sizes: tuple[Size, ...] = attrs.field(default=(), repr=False)
    states: Mapping[str, str] = attrs.field(factory=dict)

    def __attrs_post_init__(self) -> None:
        refuse(self, _faults(self))


@attrs.frozen(eq=False)
class Replacement(Effect):
    """The replacement of one block of a diagram by a relative, as an effect; made by ``replacement``.

    Parameters
    ----------
    name, family, words, place : str
        As for ``Effect``; the place is ``REPLACED``.
    block : Block or Diagram
        The new block.
    null : mapping of str to float
        Empty: a replacement has no null.
    free : tuple of str
        As for ``Effect``.
    trials : callable
        As for ``Effect``.
    excites : str, default ""
        As for ``Effect``.
    confused : tuple of str, default ()
        As for ``Effect``.
    separates, variant : str, default ""
        As for ``Effect``.
    settled, within, contains : tuple of str, default ()
        As for ``Effect``.
    reads : str, default ""
        Not used.
    below, local : tuple of str, default ()
        As for ``Effect``.
    adds : callable, optional
        Not used.
    sizes : tuple of Size, default ()
        As for ``Effect``.
    other_words : mapping of str to str, default {}
        Not used.
    of_motion : bool, default False
        Not used.
    mechanical : bool, default False
        Not used.
    sharp, rounds : tuple of str, default ()
        As for ``Effect``.
    of_gain : bool, default False
        As for ``Effect``.
    relative : Relative
        The relative.
    replaces : str
        The name of the block that is replaced.
    old : Block
        That block, with fitted parameters.
    """

    relative: Relative = attrs.field(kw_only=True)
    replaces: str = attrs.field(kw_only=True)
    old: Block = attrs.field(kw_only=True)

    def __attrs_post_init__(self) -> None:
        refuse(self, parameter_faults(self))


def replacement(relative: Relative, name: str, old: Block, scales: Scales) -> Replacement:
    """Return the replacement of block ``old`` of a diagram, called ``name``, by a relative.

    Parameters
    ----------
    relative : Relative
        The relative.
    name : str
        The name of the block in its diagram.
    old : Block
        The block, with fitted parameters.
    scales : Scales
        Scales of its output and of the signal that it reads.

    Returns
    -------
    Replacement
        The effect.
    """
    return Replacement(
        relative.name,
        relative.family,
        relative.words,
        REPLACED,
        relative.block(old, scales),
        {},
        relative.free,
        lambda scales: relative.trials(old, scales),
        excites=relative.excites,
        confused=relative.confused,
        separates=relative.separates,
        variant=relative.variant,
        within=relative.within,
        contains=relative.contains,
        sizes=relative.sizes,
        relative=relative,
        replaces=name,
        old=old,
    )


def _faults(relative: Relative) -> Iterator[str]:
    """The fault of a relative, as far as it can be checked without a block to replace."""
    if not isinstance(relative.name, str) or not relative.name.isidentifier():
        yield "programs read its name, so it must be letters, digits and underscores, not starting with a digit."
    if not (isinstance(relative.of, type) and issubclass(relative.of, Block)):
        yield f"of must be a class of blocks, such as CoulombFriction, got {in_words(relative.of)}."
    for what in ("block", "trials"):
        if not callable(getattr(relative, what)):
            yield f"{what} must be a function of the old block and Scales, got {in_words(getattr(relative, what))}."
    if not relative.free:
        yield "none of its parameters is fitted; name parameters of the new block in free."
