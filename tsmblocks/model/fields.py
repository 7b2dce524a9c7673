"""Declarations of a block: ports, states, and parameters with meaning, unit and bounds.

One declaration serves the error message, the default bounds of a fit, the file format, the axis label and the
generated test of bad values, so each fact about a block is stated once, in its class.
"""

from __future__ import annotations

import math
from typing import Any

import attrs
import numpy as np

from tsmblocks.model.values import plain


@attrs.frozen
class Input:
    """An input port of a block.

    Parameters
    ----------
    about : str
        Meaning of the signal.
    unit : str, default ""
        A label (``"rad/s"``); ``""`` for any unit; ``"?u"`` or ``"?u/s"`` for one that ports with this letter share.
    rate_of : str, default ""
        Another input, of which this one is the time derivative. Unconnected, it is formed exactly, from the expression
        of the driving signal. A rate may have a rate.
    unit_option : str, default ""
        Option of the block that overrides ``unit`` where it is not empty.
    """

    about: str
    unit: str = ""
    rate_of: str = ""
    unit_option: str = ""


@attrs.frozen
class Output:
    """An output port of a block.

    Parameters
    ----------
    about : str
        Meaning of the signal.
    unit : str, default ""
        Its unit, as for ``Input``.
    unit_option : str, default ""
        Option of the block that overrides ``unit`` where it is not empty.
    """

    about: str
    unit: str = ""
    unit_option: str = ""


@attrs.frozen
class Tape:
    """A signal that the equations read and that ``Block.tapes`` supplies as samples (noise, a recording).

    Parameters
    ----------
    about : str
        Meaning of the signal.
    """

    about: str


@attrs.frozen
class Past:
    """A past value of an input port, which the equations read as a delayed signal.

    Parameters
    ----------
    about : str
        Meaning of the signal.
    of : str
        The input port that is delayed.
    by : str
        Parameter that holds the delay [s]. It may not be shorter than a step, unless ``now`` is set.
    initial : str
        Parameter that holds the value of the port before the run.
    now : bool, default False
        Whether the present value takes part in the interpolation: any delay from 0 on, with direct feedthrough.
    first : bool, default False
        Whether the value before the run is the first value of the port, instead of ``initial``.
    """

    about: str
    of: str
    by: str
    initial: str
    now: bool = False
    first: bool = False


@attrs.frozen
class State:
    """A state of a block.

    Parameters
    ----------
    start : float
        Initial value; a symbol in a block with symbols.
    about : str
        Meaning of the state.
    unit : str, default ""
        Its unit.
    """

    start: Any
    about: str
    unit: str = ""


@attrs.frozen(eq=False)
class Samples:
    """A signal known at instants only, which a run may not exceed (a zero-order hold keeps its last value).

    Parameters
    ----------
    t : ndarray, shape (N,)
        Increasing times [s].
    y : ndarray, shape (N,)
        Values at these times.
    hold : {"auto", "zero", "linear", "cubic"}, default "auto"
        Interpolation between the samples; by default it is found from them.
    """

    t: np.ndarray
    y: np.ndarray
    hold: str = "auto"


FLAT_LIST = "tuple[float, ...]"
"""Annotation of a parameter that is one list of numbers."""


@attrs.frozen
class Field:
    """The declaration of one field of a block, with the arguments of ``parameter`` and ``option``.

    A tuple that is ``flat`` holds numbers alone, and no rows of them: its annotation is ``FLAT_LIST``.
    """

    kind: str  # "parameter", "option" or "state"
    about: str
    unit: str = ""
    above: float = -math.inf
    below: float = math.inf
    at_least: float = -math.inf
    at_most: float = math.inf
    finite: bool = True
    choices: tuple[Any, ...] = ()
    default: Any = None
    known: bool = False
    initial: bool = False
    flat: bool = False
    omitted: Any = None
    opposite: str = ""
    acts_at: str = ""
    factor: str = ""
    by_definition: float | None = None

    @property
    def low(self) -> float:
        """Lower bound, whether or not it is included."""
        return max(self.above, self.at_least)

    @property
    def high(self) -> float:
        """Upper bound, whether or not it is included."""
        return min(self.below, self.at_most)

    @property
    def default_in_files(self) -> Any:
        """The value that applies where a file does not give it."""
        return self.default if self.omitted is None else self.omitted

    def allows(self, value: float) -> bool:
        """Whether one number lies within the bounds (NaN never does)."""
        if math.isinf(value):
            return not self.finite and value == (self.low if value < 0 else self.high)
        return self.above < value < self.below and self.at_least <= value <= self.at_most

    def bounds(self) -> str:
        """The bounds in interval notation."""
        left = f"({self.above:g}" if self.above >= self.at_least else f"[{self.at_least:g}"
        right = f"{self.below:g})" if self.below <= self.at_most else f"{self.at_most:g}]"
        return f"{left}, {right}"


def _field(default: Any, spec: Field) -> Any:
    # An option that is a whole number keeps its type, which ``validate`` and the block read; a parameter is a float.
    default = default if type(default) is int and spec.kind == "option" else plain(default)
    return attrs.field(default=default, metadata={"tsm": attrs.evolve(spec, default=default)})


def parameter(
    *,
    default: Any,
    about: str,
    unit: str = "",
    above: float = -math.inf,
    below: float = math.inf,
    at_least: float = -math.inf,
    at_most: float = math.inf,
    finite: bool = True,
    known: bool = False,
    initial: bool = False,
    omitted: float | None = None,
    opposite: str = "",
    acts_at: str = "",
    factor: str = "",
    by_definition: float | None = None,
) -> Any:
    """Declare a parameter: a number or a tuple that stays a symbol until the run, to be swept, fitted, differentiated.

    Parameters
    ----------
    default : float or tuple
        Default value, of the kind that values must have: a number, a list of numbers, or of rows.
    about : str
        Meaning of the parameter.
    unit : str, default ""
        Its unit, as for ``Input``.
    above, below : float, default -inf and inf
        Bounds that are excluded; for a tuple they hold for each element.
    at_least, at_most : float, default -inf and inf
        Bounds that are included.
    finite : bool, default True
        Whether infinity (a limit that never acts) is refused even where no bound excludes it.
    known : bool, default False
        Whether a fit keeps it fixed unless it is named: it is taken from a data sheet, or chosen.
    initial : bool, default False
        Whether it is a list of initial values, one for each state, or an empty one for zeros: a property of a
        recording, not of a machine.
    omitted : float, optional
        Value that applies where a file does not give it, if the default was different when such files were written.
    opposite : str, default ""
        Another parameter; where only that one is given, this one has the same magnitude and the opposite sign.
    acts_at : str, default ""
        The input whose values it is compared with, such as the speed below which friction is linear: a fit remarks
        where recordings do not reach it.
    factor : str, default ""
        The parameter (itself or another) that is the factor of its term, as ``kd`` is for the derivative filter of a
        PID controller: where that is zero, the term is absent, and a fit keeps the parameter unless it is named.
    by_definition : float, optional
        The value that a factor on the input has by definition where the units of the signals are known, such as 1 for
        the integral of a speed, which is the position: a fit keeps it unless it is named.

    Returns
    -------
    attrs field
        The declaration, for the class body of a block.

    Examples
    --------
    In the class body of a block::

        gain: float = tsm.parameter(default=2.0, about="gain", unit="N*m/rad", above=0.0)
    """
    spec = Field("parameter", about, unit, above, below, at_least, at_most, finite, known=known, initial=initial)
    spec = attrs.evolve(spec, omitted=omitted, opposite=opposite, acts_at=acts_at)
    return _field(default, attrs.evolve(spec, factor=factor, by_definition=by_definition))


def option(
    *,
    default: Any,
    about: str,
    unit: str = "",
    choices: tuple[Any, ...] = (),
    above: float = -math.inf,
    at_least: float = -math.inf,
    at_most: float = math.inf,
) -> Any:
    """Declare an option: a choice that shapes the equations (a sign string, an order, a period); never a symbol.

    Parameters
    ----------
    default : bool, int, float, str or tuple
        Default value. Its type is the type that values must have.
    about : str
        Meaning of the option.
    unit : str, default ""
        Unit of a number.
    choices : tuple, default ()
        Allowed values; any where it is empty.
    above : float, default -inf
        Lower bound of a number that is excluded.
    at_least, at_most : float, default -inf and inf
        Bounds that are included.

    Returns
    -------
    attrs field
        The declaration, for the class body of a block.

    Examples
    --------
    In the class body of a block::

        signs: str = tsm.option(default="+-", about="sign of each input")
    """
    return _field(
        default, Field("option", about, unit, above=above, at_least=at_least, at_most=at_most, choices=choices)
    )


def state(*, default: float, about: str, unit: str = "") -> Any:
    """Declare a state. Its initial value may be fitted like a parameter.

    Parameters
    ----------
    default : float
        Default of the initial value.
    about : str
        Meaning of the state.
    unit : str, default ""
        Its unit.

    Returns
    -------
    attrs field
        The declaration, for the class body of a block.

    Examples
    --------
    In the class body of a block::

        z: tsm.State = tsm.state(default=0.0, about="deflection", unit="rad")
    """
    return _field(default, Field("state", about, unit))
