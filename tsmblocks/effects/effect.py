"""What an effect is: a block that may be missing from a model, where it stands, and what it is called."""

from __future__ import annotations

from collections.abc import Callable, Iterator, Mapping
from typing import Any

import attrs
import numpy as np

from tsmblocks.blocks import Sum
from tsmblocks.common.errors import ParameterError, in_words, near
from tsmblocks.common.tables import listed
from tsmblocks.model.block import Block, leaves
from tsmblocks.model.diagram import Diagram
from tsmblocks.model.wires import not_a_block

PLACES = ("output", "input", "drive", "across", "load", "brake")
"""Where an effect may stand.

``output``: on the wire of a measured output. ``input``: on the wire of a measured input. ``drive``: on the wire that
sets the measured output in motion (a force, a voltage: two integrations before it, or one where the output is a
speed). ``load``: there too, and it reads the motion as well. ``brake``: the same where the motion that is measured is a
speed, as its unit says. ``across``: on the wire of an output, and it reads the input as well. An effect made for one
diagram names its wire instead, ``"pump -> tank.inflow"``; it stands there in diagrams that have this port.
"""
TWO_SIGNAL_PLACES = ("across", "load", "brake")
"""Places at which an effect is given a second signal, at its input ``x``."""


@attrs.frozen
class Span:
    """How a signal moved over all experiments: its ends, its size, and its rate, in its own unit (and per s)."""

    low: float
    high: float
    rms: float
    speed: float
    fastest: float

    @property
    def middle(self) -> float:
        """Half way between the ends."""
        return (self.low + self.high) / 2

    @property
    def reach(self) -> float:
        """Half of the way between the ends."""
        return (self.high - self.low) / 2


@attrs.frozen
class Scales:
    """What is known of the data before an effect is tried: how large, how fast, how long.

    ``wire`` is the signal the effect stands on, ``other`` the signal it reads besides (the wire itself where it reads
    none). ``start`` and ``stop`` [s] are the ends of all experiments, ``step`` [s] the time between samples,
    ``shortest`` [s] the length of the shortest experiment. ``lines`` [Hz] are frequencies at which what the model
    leaves has most power, strongest first.
    """

    wire: Span
    other: Span
    start: float
    stop: float
    step: float
    shortest: float
    lines: tuple[float, ...] = ()

    @property
    def of_other(self) -> Scales:
        """The same with the other signal in the place of the wire."""
        return attrs.evolve(self, wire=self.other)


@attrs.frozen
class Trials:
    """What to try: numbers to begin from, and bounds that depend on the data.

    ``strengths`` maps the parameters that are zero where there is no effect (or ``null`` in the effect) to a size
    worth trying; ``shapes`` lists sets of the other parameters; ``fixed`` are numbers that are set and not fitted;
    ``bounds`` narrows what the block allows. ``refine`` names the shape parameter that is looked for again between
    its neighbours in ``shapes``, where a search downhill would not find the way.
    """

    strengths: Mapping[str, float]
    shapes: tuple[Mapping[str, float], ...] = ({},)
    fixed: Mapping[str, float] = attrs.field(factory=dict)
    bounds: Mapping[str, tuple[float | None, float | None]] = attrs.field(factory=dict)
    refine: str = ""

    def with_bounds(self, more: Mapping[str, tuple[float | None, float | None]]) -> Trials:
        """The same with further bounds."""
        return attrs.evolve(self, bounds={**self.bounds, **more})

    def under(self, block: str) -> Trials:
        """The same for a block of this name inside a diagram."""

        def named(given: Mapping[str, Any]) -> dict[str, Any]:
            return {f"{block}.{k}": v for k, v in given.items()}

        return Trials(
            named(self.strengths),
            tuple(map(named, self.shapes)),
            named(self.fixed),
            named(self.bounds),
            f"{block}.{self.refine}" if self.refine else "",
        )


def beside(name: str, block: Block) -> Diagram:
    """Signal ``u``, and what a block that passes its input on adds to another signal ``x``, as one diagram."""
    return Diagram(
        title=f"{name} beside",
        blocks={name: block, "added": Sum(signs="+-"), "both": Sum(signs="++")},
        wires=[f"{name} -> added.plus", "added -> both.plus2"],
        inputs={"u": "both.plus1", "x": [f"{name}.u", "added.minus"]},
        outputs={"y": "both"},
    )


@attrs.frozen(eq=False)
class Effect:
    """An effect that a model may lack, as a nested edit of its diagram.

    ``name`` and ``family`` identify it (several effects of one name are variants of it); ``words`` is what a sentence
    calls it. ``block`` is put on a wire at ``place``; its input ``u`` and its output ``y`` are used, and an input
    ``x`` reads the other signal where the place has one. With the parameters in ``null`` it passes ``u`` on bit for
    bit. ``free`` are the parameters that are fitted. ``trials`` turns the sizes of the data into starting numbers;
    None when these data cannot show the effect. ``excites`` says what a recording needs to show it, ``confused`` which
    effects look alike, ``separates`` which experiment tells them apart. ``settled`` are states of the block that begin
    at the value the wire has then. ``within`` are parameters that must lie off their bounds for the name to hold: at a
    bound the effect has turned into something else. ``contains`` are effects that are special cases of it. Raises
    ParameterError where this does not fit together.

    Where ``place`` is a wire of one diagram, ``reads`` is the signal that drives the input ``x`` of the block, and
    ``adds`` what else changes: a function from the diagram with the block in it, and the block's name, to a diagram.
    """

    name: str
    family: str
    words: str
    place: str
    block: Block | Diagram
    null: Mapping[str, float]
    free: tuple[str, ...]
    trials: Callable[[Scales], Trials | None] = attrs.field(repr=False)
    excites: str = ""
    confused: tuple[str, ...] = ()
    separates: str = ""
    variant: str = ""
    settled: tuple[str, ...] = ()
    within: tuple[str, ...] = ()
    contains: tuple[str, ...] = ()
    reads: str = ""
    adds: Callable[[Diagram, str], Diagram] | None = attrs.field(default=None, repr=False)

    @property
    def receiver(self) -> str:
        """The port in front of which an effect of one diagram stands; empty for the others."""
        return self.place.rpartition("->")[2].strip() if isinstance(self.place, str) and "->" in self.place else ""

    def accepts(self, trials: Trials) -> None:
        """Raises ParameterError where trials name what is not free to be fitted, so that they would go astray."""
        _refuse(self, _trial_faults(self, trials))

    def __attrs_post_init__(self) -> None:
        _refuse(self, _faults(self))


def _refuse(effect: Effect, faults: Iterator[str]) -> None:
    fault = next(faults, "")
    if fault:
        raise ParameterError(f"effect {in_words(effect.name)}: {fault}")


def _faults(effect: Effect) -> Iterator[str]:
    """What is wrong with an effect; otherwise it would never stand on any wire, and nobody would be told."""
    if not isinstance(effect.name, str) or not effect.name.isidentifier():
        yield (
            "blocks are named after it, so its name must be letters, digits and underscores, not starting with a digit."
        )
    if effect.place not in PLACES and not effect.receiver:
        yield f"there is no place {in_words(effect.place)}.{near(effect.place, PLACES)}"
    if not isinstance(effect.block, (Block, Diagram)):
        yield not_a_block("block", effect.block)
    yield from _number_faults(effect)
    yield from _port_faults(effect)
    if not callable(effect.trials):
        yield f"trials must be a function from Scales to Trials, got {in_words(effect.trials)}."


def _trial_faults(effect: Effect, trials: Any) -> Iterator[str]:
    if not isinstance(trials, Trials):
        yield f"trials must give Trials, or None where the data cannot show it, got {in_words(trials)}."
    elif not trials.shapes:
        yield "its trials have no shape to begin with; leave shapes out where there is none."
    else:
        odd = [one for one in trials.shapes if set(one) != set(trials.shapes[0])]
        if odd:
            yield f"all shapes of its trials must name the same numbers, and {in_words(dict(odd[0]))} does not."
        yield from _strange_names(effect, trials)


def _strange_names(effect: Effect, trials: Trials) -> Iterator[str]:
    """Names in trials of what cannot be tried, bounded or fixed."""
    free, numbers = effect.free, _known(effect.block)
    for what, given, known in (
        ("strengths", trials.strengths, free),
        ("shapes", trials.shapes[0], free),
        ("refine", filter(None, [trials.refine]), tuple(trials.shapes[0])),
        ("bounds", trials.bounds, (*free, *_states(effect.block))),
    ):
        for name in given:
            if name not in known:
                yield f"{what} of its trials name '{name}', which is not free to be fitted.{near(name, known)}"
    for name in trials.fixed:
        if name in free:
            yield f"its trials fix '{name}', which is free to be fitted; a number is one or the other."
        elif name not in numbers:
            yield f"its trials fix '{name}', which is no parameter of its block.{near(name, numbers)}"


def _number_faults(effect: Effect) -> Iterator[str]:
    known = _known(effect.block)
    for name in (*effect.null, *effect.free, *effect.within):
        if name not in known:
            yield f"its block has no parameter '{name}'.{near(name, known)}"
    for name, value in effect.null.items():
        if known[name] != value:
            yield f"its block must stand at its null, and {name} is {known[name]:g} instead of {value:g}."
    if not effect.free:
        yield "nothing of it is free to be fitted; name parameters of its block in free."
    for name in effect.within:
        if name not in effect.free:
            yield f"within names '{name}', which is not free to be fitted.{near(name, effect.free)}"
    own = _states(effect.block)
    for name in effect.settled:
        if name not in own:
            yield f"its block has no state '{name}' to be settled.{near(name, own)}"


def _port_faults(effect: Effect) -> Iterator[str]:
    for port, side in (("u", effect.block.inports), ("y", effect.block.outports)):
        if port not in side:
            yield f"its block needs a port '{port}', and has {', '.join(side) or 'none'} on that side."
    reads = ("u", "x") if effect.place in TWO_SIGNAL_PLACES or effect.reads else ("u",)
    for name, inlet in effect.block.inports.items():
        if name not in reads and not getattr(inlet, "rate_of", ""):
            also = f" (an input x is driven at the places {listed(TWO_SIGNAL_PLACES)} alone)" if name == "x" else ""
            yield f"nothing would drive the input '{name}' of its block at the place '{effect.place}'{also}."


def _states(block: Block | Diagram) -> list[str]:
    if isinstance(block, Diagram):
        return [f"{name}.{state}" for name, inner in block.blocks.items() for state in _states(inner)]
    return list(block.states)


def _known(block: Block | Diagram) -> Mapping[str, float]:
    """Every number of an effect's block, by name."""
    return block.parameters if isinstance(block, Diagram) else _numbers(block)


def _numbers(block: Block) -> dict[str, float]:
    return {leaf: number for key, value in block.parameters.items() for leaf, number in leaves(value, key)}


def span_of(signals: list[np.ndarray], steps: list[float]) -> Span:
    """How signals (one array for each experiment, samples ``steps`` [s] apart) moved, all taken together."""
    rates = np.concatenate([np.abs(np.diff(y)) / h for y, h in zip(signals, steps, strict=True)])
    every = np.concatenate(signals)
    return Span(
        float(every.min()),
        float(every.max()),
        float(np.sqrt(np.mean(every**2))),
        float(np.sqrt(np.mean(rates**2))),
        float(rates.max()),
    )
