"""Measurable sizes of effects: an amplitude, a gap, a frequency in Hz, a delay in ms."""

from __future__ import annotations

import math
from collections.abc import Callable, Mapping

import attrs

from tsmblocks.common.displayed_units import DisplayedUnit, times, unit_over
from tsmblocks.common.errors import ParameterError, in_words
from tsmblocks.common.units import per
from tsmblocks.effects.trials import Scales

OWN_UNITS = ("{u}", "{x}")
"""In the unit of a size: the unit of the signal on which the effect acts, and that of the second signal it reads."""
UNTIL = "until"
"""Name of the instant at which a change ends; before it stands that at which it begins."""
MINUTE, PERCENT, MILLISECONDS = 60.0, 100.0, 1000.0
"""Seconds in a minute, and factors from a share to percent and from s to ms."""


@attrs.frozen(eq=False)
class Size:
    """A quantity that gives the size of an effect, derived from the parameters of its block.

    Parameters
    ----------
    name : str
        Its name in words: ``"amplitude"``, ``"gap width"``.
    value : callable
        Function from the parameters of the block (a mapping of name to number, in the units of the block) and the
        ``Scales`` of its signals to a number in ``unit``. A parameter inside a diagram has its name there, and that
        of a fitted one may be left without its block: ``"force.cosine"``, or ``"cosine"``.
    unit : str, default "{u}"
        Unit: ``{u}`` is replaced by that of the signal on which the effect acts, ``{x}`` by that of the second signal.

    Raises
    ------
    ParameterError
        Where these are not a name, a function and a text.

    Examples
    --------
    >>> from tsmblocks.effects import Size
    >>> gap = Size("gap width", lambda p, _: 2 * p["half_width"])
    >>> gap.value({"half_width": 0.25}, None)
    0.5
    """

    name: str
    value: Callable[[Mapping[str, float], Scales], float] = attrs.field(repr=False)
    unit: str = "{u}"

    def __attrs_post_init__(self) -> None:
        if not (isinstance(self.name, str) and self.name):
            raise ParameterError(f"a size needs a name in words, got {in_words(self.name)}.")
        if not callable(self.value):
            raise ParameterError(f"size '{self.name}': value must be a function, got {in_words(self.value)}.")
        if not isinstance(self.unit, str):
            raise ParameterError(f"size '{self.name}': unit must be text, got {in_words(self.unit)}.")

    def unit_for(self, wire: str, other: str) -> str:
        """Return the unit of the size, with the units of the signals filled in.

        Parameters
        ----------
        wire, other : str
            Unit of the signal on which the effect acts, and of the second signal; empty for none.

        Returns
        -------
        str
            The unit; empty for a pure number.
        """
        over, slash, under = self.unit.partition("/")
        units = dict(zip(OWN_UNITS, (wire, other), strict=True))
        over, under = units.get(over, over), units.get(under, under)
        if not slash:
            signal, product, _ = over.partition("*s")
            return times(units.get(signal, signal), "s") if product else over
        if under == "s":
            return times(over, "s", -1)
        if over == under:
            return ""
        if not under:  # per a pure number
            return over
        recorded = DisplayedUnit in {type(over), type(under)}
        return unit_over(over or "1", under) if recorded or under == "min" else per(over or "1", under)


def in_proportion(name: str, parameter: str, unit: str = "{u}", factor: float = 1.0) -> Size:
    """Return a size that is a parameter times a factor.

    Parameters
    ----------
    name, parameter : str
        Name of the size, and of the parameter.
    unit : str, default "{u}"
        Its unit.
    factor : float, default 1.0
        The factor.

    Returns
    -------
    Size
        The size.
    """
    return Size(name, lambda p, _: factor * p[parameter], unit)


def on_second_signal(size: Size) -> Size:
    """Return the same size for a block that reads the second signal instead of the wire.

    Parameters
    ----------
    size : Size
        The size.

    Returns
    -------
    Size
        The size, of the scales and the units of that signal.
    """
    return attrs.evolve(size, value=lambda p, scales: size.value(p, scales.of_other))


def wave(cosine: str = "cosine", sine: str = "sine", name: str = "amplitude") -> Size:
    """Return the amplitude of a wave that is given by its cosine and its sine.

    Parameters
    ----------
    cosine, sine : str
        Names of the parameters.
    name : str, default "amplitude"
        Name of the size.

    Returns
    -------
    Size
        The amplitude.
    """
    return Size(name, lambda p, _: math.hypot(p[cosine], p[sine]))
