"""Variants of effects at other places: in front of the model, on a branch, inside a control loop, beside a signal."""

from __future__ import annotations

from collections.abc import Callable, Mapping

import attrs

from tsmblocks.blocks import Sum
from tsmblocks.effects.effect import Effect
from tsmblocks.effects.sizes import on_second_signal
from tsmblocks.effects.trials import Scales, Trials
from tsmblocks.model.block import Block
from tsmblocks.model.diagram import Diagram

LEFT = "left"
"""The sum, in the block of an effect, of what a force leaves of the drive."""


def resisting(title: str, chain: Mapping[str, Block | Diagram]) -> Diagram:
    """Drive ``u`` less a force that a chain of blocks makes of the motion ``x``, which the first of them takes."""
    first = next(iter(chain))
    return Diagram(
        title=title,
        blocks={**chain, LEFT: Sum(signs="+-")},
        wires=[" -> ".join([*chain, f"{LEFT}.minus"])],
        inputs={"u": f"{LEFT}.plus", "x": f"{first}.{next(iter(chain[first].inports))}"},
        outputs={"y": LEFT},
    )


def with_opposite_motion(effect: Effect) -> Effect:
    """The effect where its drive moves the signal ``x`` backwards: the force that resists the motion adds to the drive.

    Unchanged where its block does not subtract a force.
    """
    block = effect.block
    if not (isinstance(block, Diagram) and block.blocks.get(LEFT) == Sum(signs="+-")):
        return effect
    (force,) = [".".join(x.source) for x in block.links if x.target == (LEFT, "minus")]
    added = block.rewire(
        blocks={**block.blocks, LEFT: Sum(signs="++")},
        cut=[f"{force} -> {LEFT}.minus"],
        add=[f"{force} -> {LEFT}.plus2"],
        inputs={**block.inputs, "u": f"{LEFT}.plus1"},
    )
    return attrs.evolve(effect, block=added)


def in_front(effect: Effect, words: str = "") -> Effect:
    """The variant of an effect that acts on the input, in front of the whole model; its ``words`` say so."""
    said = words or f"{effect.words}, in front of the model"
    others = {kind: f"{said}, in front of the model" for kind, said in effect.other_words.items()}
    return attrs.evolve(effect, words=said, place="input", variant="input", other_words=others)


def on_branch(effect: Effect) -> Effect:
    """The variant of an effect that acts in one of several branches that an input drives."""
    variant = ", ".join(filter(None, ("branch", effect.variant.removeprefix("output"))))
    return attrs.evolve(effect, place="branch", variant=variant)


def of_element(effect: Effect) -> Effect:
    """The variant of a change of a gain that is one of an element: of a stiffness, a friction, a weight."""
    words = effect.words
    for gain in ("a gain", "the gain"):
        words = words.replace(gain, "a stiffness or a friction")
    return attrs.evolve(effect, words=words, place="element", variant=f"element, {effect.variant}")


def on_loop(effect: Effect) -> Effect:
    """The variant of an effect that acts inside a control loop."""
    words = f"{effect.words} inside the control loop"
    return attrs.evolve(effect, words=words, place="loop", variant="loop", other_words={})


def separate(effect: Effect, *instants: str, words: str = "") -> Effect:
    """The variant with a separate size, and separate ``instants``, for each of several recordings without one clock."""
    return attrs.evolve(
        effect,
        words=words or effect.words,
        trials=lambda scales: None if scales.one_clock else effect.trials(scales),
        variant=f"{effect.variant}, separate sizes{' and times' if instants else ''}".lstrip(", "),
        local=(*effect.null, *instants),
    )


def across(effect: Effect, name: str, variant: str) -> Effect:
    """A variant that adds to signal ``u`` the change that the block of an effect, under ``name``, makes to ``x``."""
    block = Diagram(
        title=f"{name} beside",
        blocks={name: effect.block, "added": Sum(signs="+-"), "both": Sum(signs="++")},
        wires=[f"{name} -> added.plus", "added -> both.plus2"],
        inputs={"u": "both.plus1", "x": [f"{name}.u", "added.minus"]},
        outputs={"y": "both"},
    )
    beside = attrs.evolve(effect, sizes=tuple(map(on_second_signal, effect.sizes)))
    return _inside(beside, name, block, "across", variant, lambda scales: effect.trials(scales.of_other))


def on_input(effect: Effect, name: str) -> Effect:
    """The variant in front of the model of an effect that reads two signals: both are the input."""
    block = Diagram(
        title=f"{name} in front",
        blocks={name: effect.block},
        inputs={"u": [f"{name}.u", f"{name}.x"]},
        outputs={"y": name},
    )
    return in_front(_inside(effect, name, block, "input", "input", effect.trials))


def _inside(
    effect: Effect, name: str, block: Diagram, place: str, variant: str, trials: Callable[[Scales], Trials | None]
) -> Effect:
    """An effect whose block is a part, under ``name``, of the diagram ``block``; ``trials`` are those of that part."""

    def under(scales: Scales) -> Trials | None:
        own = trials(scales)
        return None if own is None else own.under(name)

    kept = (effect.free, effect.settled, effect.within, effect.below, effect.local)
    free, settled, within, below, local = (tuple(f"{name}.{k}" for k in names) for names in kept)
    return attrs.evolve(
        effect,
        place=place,
        block=block,
        null={f"{name}.{k}": value for k, value in effect.null.items()},
        free=free,
        trials=under,
        variant=variant,
        settled=settled,
        within=within,
        below=below,
        local=local,
    )
