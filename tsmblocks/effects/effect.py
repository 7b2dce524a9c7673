"""Effects: a block that a model may lack, and where it is inserted."""

from __future__ import annotations

import math
from collections.abc import Callable, Collection, Iterable, Iterator, Mapping
from typing import Any

import attrs

from tsmblocks.common.errors import ParameterError, in_words, near
from tsmblocks.common.tables import listed
from tsmblocks.common.units import parse
from tsmblocks.effects.sizes import Size
from tsmblocks.effects.trials import Scales, Trials
from tsmblocks.model.block import Block, leaves
from tsmblocks.model.diagram import Diagram
from tsmblocks.model.wires import not_a_block

PLACES = (
    "output",
    "input",
    "drive",
    "balance",
    "across",
    "load",
    "brake",
    "transmission",
    "deflection",
    "parallel",
    "branch",
    "element",
    "loop",
    "mode",
)
"""Where an effect may be inserted.

``output``: on the wire of a measured output. ``input``: on the wire of a measured input. ``drive``: on the wire that
drives the measured output (a force, a voltage: two integrations before it, or one where the output is a speed).
``balance``: where the output is a level, a temperature or the like, on the wire that fills or heats it, one integration
before it. ``load``: at the drive too, and its input ``x`` reads the motion. ``brake``: the same where the measured
motion is a speed, by its unit. ``across``: on the wire of an output, and its input ``x`` reads the input.
``transmission``: on an inner wire with a position, from one part of a transmission to the next. ``deflection``: on the
difference of two positions that the force there moves, as that of a spring. ``parallel``: as ``across``, where the
input reaches the output through a lag or an integrator. ``branch``: on the wire from an input to one of several blocks
that it drives, or behind that branch, where it enters a sum, or from a measured signal to the blocks that it drives,
behind its sensor. ``element``: on the wire into a gain or a viscous friction that makes a force, or a flow, of what the
model moves: a spring, a damper, a weight. ``loop``: on a wire of a control loop: the control error, the command, or
what is fed back. ``mode``: as ``across``, where what it reads drives the output through one or two integrations or
lags: a force, a voltage. An effect made for one diagram names its wire instead, ``"pump -> tank.inflow"``; it is
inserted in diagrams that have this port.
"""
QUANTITIES = {
    parse(unit).dimension: kind
    for kind, units in {"position": ("rad", "m"), "speed": ("rad/s", "m/s")}.items()
    for unit in units
}
"""Dimension of a signal -> what it is, for ``other_words``; anything else is ``"other"``."""
TWO_SIGNAL_PLACES = ("across", "load", "brake", "parallel", "mode")
"""Places at which the input ``x`` of an effect's block is connected to a second signal."""


@attrs.frozen(eq=False)
class Effect:
    """An effect that a model may lack: a block to insert, whose null parameters reproduce the model bit for bit.

    Parameters
    ----------
    name : str
        Name, an identifier; effects of one name are variants of it.
    family : str
        Group of related effects: ``"friction"``, ``"loop"``, ``"delay"``, ``"map"``, ``"time"``, ...
    words : str
        The effect in a sentence: ``"a backlash gap"``.
    place : str
        Where it is inserted, one of ``PLACES``, or the wire of one diagram: ``"pump -> tank.inflow"``.
    block : Block or Diagram
        The block, at its null; its input ``u`` and its output ``y`` are connected, and its input ``x`` to the second
        signal where the place has one.
    null : mapping of str to float
        Parameters with which the block passes ``u`` on unchanged.
    free : tuple of str
        The parameters that are fitted.
    trials : callable
        Function from ``Scales`` to ``Trials``; None where the data do not excite the effect.
    excites : str, default ""
        What a recording needs to excite it.
    confused : tuple of str, default ()
        Effects that are often indistinguishable from it.
    separates : str, default ""
        The experiment that separates it from them.
    variant : str, default ""
        Name of the variant.
    settled : tuple of str, default ()
        States of the block whose initial value is that of the wire.
    within : tuple of str, default ()
        Parameters that must not be at a bound for the name to hold.
    contains : tuple of str, default ()
        Effects that are special cases of it.
    reads : str, default ""
        For the wire of one diagram: the signal that drives the input ``x`` of the block.
    below : tuple of str, default ()
        Parameters that must not be at their upper bound for the name to hold.
    local : tuple of str, default ()
        Parameters with a separate value in each experiment: strengths of its trials, and what these refine.
    adds : callable, optional
        For the wire of one diagram: further changes, a function from the diagram with the block in it, and the
        block's name, to a diagram.
    sizes : tuple of Size, default ()
        Measurable sizes of it, the most informative first: an amplitude, a gap, a frequency. Texts and pages report
        them with intervals; for an effect without any they report the parameters.
    other_words : mapping of str to str, default {}
        The words where the signal on which it acts is of another quantity: ``"position"`` (an angle or a length),
        ``"speed"``, or ``"other"``.
    of_motion : bool, default False
        Whether it acts along a motion only, so that it is not looked for on a current, a force, a pressure or a speed.
    mechanical : bool, default False
        Whether it is one of moving parts or of forces, so that it is not looked for on a temperature, a pressure, a
        current, a power or a flow.
    sharp : tuple of str, default ()
        Parameters that smooth a corner of its form: at their lower bound the corner is sharp, and its sizes hold.
    rounds : tuple of str, default ()
        Parameters that round its form as those of ``sharp`` do, where a corner that is sharper than their lower bound
        makes no difference to what is reported.
    of_gain : bool, default False
        Whether its size is the error of a gain in per cent: two of them are compared by the ratio of the gains.

    Raises
    ------
    ParameterError
        Where these are inconsistent.

    Examples
    --------
    >>> from tsmblocks.blocks import Bias
    >>> from tsmblocks.effects import Effect, Trials
    >>> Effect(
    ...     name="offset",
    ...     family="map",
    ...     words="an offset",
    ...     place="output",
    ...     block=Bias(bias=0.0),
    ...     null={"bias": 0.0},
    ...     free=("bias",),
    ...     trials=lambda scales: Trials({"bias": 0.1 * scales.wire.reach}),
    ... ).name
    'offset'
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
    below: tuple[str, ...] = ()
    local: tuple[str, ...] = ()
    adds: Callable[[Diagram, str], Diagram] | None = attrs.field(default=None, repr=False)
    sizes: tuple[Size, ...] = attrs.field(default=(), repr=False)
    other_words: Mapping[str, str] = attrs.field(factory=dict, repr=False)
    of_motion: bool = False
    mechanical: bool = False
    sharp: tuple[str, ...] = ()
    rounds: tuple[str, ...] = ()
    of_gain: bool = False

    def words_on(self, unit: str) -> str:
        """Return the words for a signal on which the effect acts.

        Parameters
        ----------
        unit : str
            The unit of the signal; empty where it is not known.

        Returns
        -------
        str
            The words for this quantity; those of the effect where it has no others.
        """
        kind = QUANTITIES.get(parse(unit).dimension, "other") if unit else ""
        return self.other_words.get(kind, self.words)

    @property
    def receiver(self) -> str:
        """The port in front of which an effect of one diagram is inserted; empty for the others."""
        return self.place.rpartition("->")[2].strip() if isinstance(self.place, str) and "->" in self.place else ""

    def accepts(self, trials: Trials, scales: Scales | None = None) -> None:
        """Check trial values against the effect, and the functions of its sizes.

        Parameters
        ----------
        trials : Trials
            What the function ``trials`` returned.
        scales : Scales or None, default None
            What it was called with; without it the functions of the sizes are not called.

        Raises
        ------
        ParameterError
            Where they name parameters that are not fitted, or the function of a size fails.
        """
        refuse(self, _trial_faults(self, trials))
        if scales is not None:
            sizes_of(self, {**parameters_of(self.block), **trials.shapes[0]}, scales)

    def __attrs_post_init__(self) -> None:
        refuse(self, _faults(self))


def refuse(effect: Any, faults: Iterator[str]) -> None:
    """Raise ParameterError for the first fault, if there is one."""
    for fault in faults:
        raise ParameterError(f"effect {in_words(effect.name)}: {fault}")


def _faults(effect: Effect) -> Iterator[str]:
    """The fault of an effect, which would otherwise be left out without a message."""
    if not isinstance(effect.name, str) or not effect.name.isidentifier():
        yield (
            "blocks are named after it, so its name must be letters, digits and underscores, not starting with a digit."
        )
    if effect.place not in PLACES and not effect.receiver:
        yield f"there is no place {in_words(effect.place)}.{near(effect.place, PLACES)}"
    if not isinstance(effect.block, (Block, Diagram)):
        yield not_a_block("block", effect.block)
    yield from parameter_faults(effect)
    yield from _port_faults(effect)
    if not callable(effect.trials):
        yield f"trials must be a function from Scales to Trials, got {in_words(effect.trials)}."


def parameter_faults(effect: Effect) -> Iterator[str]:
    """The fault of the parameters that an effect names."""
    numbers, states = parameters_of(effect.block), _states(effect.block)
    yield from _unknown((*effect.null, *effect.free), numbers, "its block has no parameter '{}'.")
    for name, value in effect.null.items():
        if numbers[name] != value:
            yield f"its block must be at its null, and {name} is {numbers[name]:g} instead of {value:g}."
    if not effect.free:
        yield "none of its parameters is fitted; name parameters of its block in free."
    for what in ("within", "below", "local", "sharp", "rounds"):
        yield from _unknown(getattr(effect, what), effect.free, f"{what} names '{{}}', which is not free to be fitted.")
    yield from _unknown(effect.settled, states, "its block has no state '{}' to initialise.")
    for odd in (one for one in effect.sizes if not isinstance(one, Size)):
        yield f"sizes must be Size objects, got {in_words(odd)}."
    names = [one.name for one in effect.sizes]
    for twice in (name for k, name in enumerate(names) if name in names[:k]):
        yield f"two of its sizes are named '{twice}'."


def _port_faults(effect: Effect) -> Iterator[str]:
    for port, side in (("u", effect.block.inports), ("y", effect.block.outports)):
        if port not in side:
            yield f"its block needs a port '{port}', and has {', '.join(side) or 'none'} on that side."
    reads = ("u", "x") if effect.place in TWO_SIGNAL_PLACES or effect.reads else ("u",)
    for name, inlet in effect.block.inports.items():
        if name not in reads and not getattr(inlet, "rate_of", ""):
            also = f" (an input x is driven only at the places {listed(TWO_SIGNAL_PLACES)})" if name == "x" else ""
            yield f"nothing drives the input '{name}' of its block at the place '{effect.place}'{also}."


def _trial_faults(effect: Effect, trials: Any) -> Iterator[str]:
    if not isinstance(trials, Trials):
        yield f"trials must return Trials, or None where the data do not excite it, got {in_words(trials)}."
    elif not trials.shapes:
        yield "its trials have no shape to start with; leave shapes out where there is none."
    else:
        shape, free, numbers = trials.shapes[0], effect.free, parameters_of(effect.block)
        for odd in (one for one in trials.shapes if set(one) != set(shape)):
            yield f"all shapes of its trials must name the same parameters, and {in_words(dict(odd))} does not."
        for what, names, known in (
            ("strengths", trials.strengths, free),
            ("shapes", shape, free),
            ("refine", trials.refine, tuple(shape)),
            ("bounds", trials.bounds, (*free, *_states(effect.block))),
        ):
            yield from _unknown(names, known, f"{what} of its trials name '{{}}', which is not free to be fitted.")
        for instant in trials.refine:
            width = ".".join([*instant.split(".")[:-1], "width"])
            if width not in numbers:
                yield f"its trials refine the instant '{instant}', but its block lacks the transition time '{width}'."
        for name in (k for k in effect.local if k not in trials.strengths and k not in trials.refine):
            yield f"'{name}' has its own value in each experiment, so it must be a strength of its trials."
        instant = next((k for k in trials.refine if k in effect.local), "")
        for name in (k for k in trials.strengths if instant and k not in effect.local):
            yield f"'{name}' must be local, as '{instant}' is: with a shape of each experiment, sizes are separate too."
        for name in (k for k in trials.fixed if k in free):
            yield f"its trials fix '{name}', which is free to be fitted; a parameter is one or the other."
        yield from _unknown(trials.fixed, numbers, "its trials fix '{}', which is no parameter of its block.")


def _unknown(names: Iterable[str], known: Collection[str], text: str) -> Iterator[str]:
    """A message for each name that is not known: ``text`` with the name in place of its braces."""
    return (text.format(name) + near(name, known) for name in names if name not in known)


def _states(block: Block | Diagram) -> list[str]:
    if isinstance(block, Diagram):
        return [f"{name}.{state}" for name, inner in block.blocks.items() for state in _states(inner)]
    return list(block.states)


def sizes_of(
    effect: Effect, parameters: Mapping[str, float], scales: Scales, units: tuple[str, str] = ("", "")
) -> dict[str, tuple[float, str]]:
    """The sizes of an effect with some parameters of its block, each with its unit; without those that are endless.

    ``units`` are those of the signal on which it acts and of the second one. Raises ParameterError where the function
    of a size fails.
    """
    fitted = {name.rpartition(".")[2]: parameters[name] for name in effect.free}
    values = {**fitted, **parameters}
    found = {one.name: (_value(effect, one, values, scales), one.unit_for(*units)) for one in effect.sizes}
    return {name: one for name, one in found.items() if math.isfinite(one[0])}


def _value(effect: Effect, size: Size, values: Mapping[str, float], scales: Scales) -> float:
    """The number of a size; NaN where it is divided by zero."""
    try:
        return float(size.value(values, scales))
    except ArithmeticError:
        return math.nan
    except Exception as error:  # in a function of the user
        why = f"{type(error).__name__}: {error}"
        raise ParameterError(f"effect '{effect.name}': the function of its size '{size.name}' fails. {why}") from error


def parameters_of(block: Block | Diagram) -> Mapping[str, float]:
    """Every parameter of an effect's block, by name."""
    if isinstance(block, Diagram):
        return block.parameters
    return {leaf: number for key, value in block.parameters.items() for leaf, number in leaves(value, key)}
