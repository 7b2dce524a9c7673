"""Trial values of an effect, and the scales of the data from which they are chosen."""

from __future__ import annotations

import itertools
from collections.abc import Mapping
from typing import Any

import attrs
import numpy as np

INSTANT_COUNT = 48
"""Instants in the first grid of a sudden change. Chosen: for the run time; the grid is refined."""
TRANSITION = 2
"""Transition time of a sudden change [sampling steps]. Chosen: its instant can be fitted, and between two samples."""
PAIR_COUNT = 14
"""Instants in the first grid of a change that ends again, of which two are tried. Chosen: 63 simulations."""
LONGEST_INTERVAL = 0.5
"""Longest of these intervals [duration]. Chosen: a longer one and what lies outside it are each as temporary."""


@attrs.frozen
class Span:
    """Range and rate of a signal over all experiments.

    Parameters
    ----------
    low, high : float
        The smallest and the largest value, in the unit of the signal.
    rms : float
        Root mean square of the signal.
    speed, fastest : float
        Root mean square and largest absolute value of its rate, in its unit per s.
    turn : float, default 0.0
        A whole turn in its unit, where that is one of an angle; zero where it is not, or is not known.
    """

    low: float
    high: float
    rms: float
    speed: float
    fastest: float
    turn: float = 0.0

    @property
    def middle(self) -> float:
        """The middle of the range."""
        return (self.low + self.high) / 2

    @property
    def reach(self) -> float:
        """Half of the range."""
        return (self.high - self.low) / 2


@attrs.frozen
class Scales:
    """Scales of the data, from which the trial values of an effect are chosen.

    Parameters
    ----------
    wire : Span
        The signal on which the effect is inserted.
    other : Span
        The second signal that it reads; ``wire`` where it reads none.
    start, stop : float
        First and last instant [s] of all experiments.
    step : float
        The sampling step [s], the longest of all experiments.
    shortest : float
        Length [s] of the shortest experiment.
    lines : tuple of float, default ()
        Frequencies [Hz] of the strongest spectral lines of the residual, strongest first.
    one_clock : bool, default True
        Whether the times of all experiments may be those of one clock: False where two experiments overlap in time.
    """

    wire: Span
    other: Span
    start: float
    stop: float
    step: float
    shortest: float
    lines: tuple[float, ...] = ()
    one_clock: bool = True

    @property
    def of_other(self) -> Scales:
        """The same scales with the second signal as the wire."""
        return attrs.evolve(self, wire=self.other)


def _names(given: str | tuple[str, ...]) -> tuple[str, ...]:
    """One name, or several, as several."""
    return (given,) if isinstance(given, str) and given else tuple(given)


@attrs.frozen
class Trials:
    """Trial values of an effect: starting values for its fit, and bounds that depend on the data.

    Parameters
    ----------
    strengths : mapping of str to float
        A trial size for each parameter that is at its null where there is no effect.
    shapes : tuple of mapping of str to float, default ({},)
        Sets of values of the other fitted parameters, each a starting point.
    fixed : mapping of str to float, default {}
        Values of parameters that are set and not fitted.
    bounds : mapping of str to pair of (float or None), default {}
        Bounds (low, high), narrower than those of the block; None for none.
    refine : str or tuple of str, default ()
        The instant of a sudden change, a shape parameter whose grid is refined around the best of ``shapes``; both
        instants of a change that ends again. The parameter ``width`` beside it is its transition time [s].
    held_first : tuple of str, default ()
        Shape parameters that are held in a first fit: the sum of squares has many minima in them, and while the sizes
        and the parameters of the model are not near theirs, its derivative leads to a wrong one.
    """

    strengths: Mapping[str, float]
    shapes: tuple[Mapping[str, float], ...] = ({},)
    fixed: Mapping[str, float] = attrs.field(factory=dict)
    bounds: Mapping[str, tuple[float | None, float | None]] = attrs.field(factory=dict)
    refine: tuple[str, ...] = attrs.field(default=(), converter=_names)
    held_first: tuple[str, ...] = ()

    @property
    def without_end(self) -> tuple[Mapping[str, float], ...]:
        """For a change that ends again, one shape for each of its instants: it begins there and does not end.

        Empty for another change, and where there are further shape parameters, or no last instant is known.
        """
        shape, instants = set(self.shapes[0]), set(self.refine)
        end = self.bounds.get(self.refine[-1], (None, None))[1] if len(instants) > 1 and shape == instants else None
        if end is None:
            return ()
        first, last = self.refine
        return tuple({first: at, last: end} for at in sorted({one[k] for one in self.shapes for k in instants}))

    def with_bounds(self, more: Mapping[str, tuple[float | None, float | None]]) -> Trials:
        """Return the same trial values with further bounds.

        Parameters
        ----------
        more : mapping of str to pair of (float or None)
            Bounds (low, high) by parameter.

        Returns
        -------
        Trials
            The new trial values.
        """
        return attrs.evolve(self, bounds={**self.bounds, **more})

    def under(self, block: str) -> Trials:
        """Return the same trial values for a block inside a diagram.

        Parameters
        ----------
        block : str
            The name of the block.

        Returns
        -------
        Trials
            With names such as ``"block.parameter"``.
        """

        def named(given: Mapping[str, Any]) -> dict[str, Any]:
            return {f"{block}.{k}": v for k, v in given.items()}

        shapes = tuple(map(named, self.shapes))
        refine, held_first = (tuple(f"{block}.{k}" for k in names) for names in (self.refine, self.held_first))
        return Trials(named(self.strengths), shapes, named(self.fixed), named(self.bounds), refine, held_first)


def span_of(signals: list[np.ndarray], steps: list[float]) -> Span:
    """Return range and rate of a signal over several experiments.

    Parameters
    ----------
    signals : list of ndarray
        The values of the signal, one array (n,) for each experiment.
    steps : list of float
        The sampling step [s] of each experiment.

    Returns
    -------
    Span
        Range and rate of all experiments together.
    """
    rates = np.concatenate([np.abs(np.diff(y)) / h for y, h in zip(signals, steps, strict=True)])
    every = np.concatenate(signals)
    values = every.min(), every.max(), np.sqrt(np.mean(every**2)), np.sqrt(np.mean(rates**2)), rates.max()
    return Span(*map(float, values))


def instant_trials(scales: Scales, size: Mapping[str, float], shape: Mapping[str, float], within: str = "") -> Trials:
    """Return trial values of a sudden change, at instants evenly spread over the recordings.

    Parameters
    ----------
    scales : Scales
        Scales of the signals.
    size, shape : mapping of str to float
        Trial sizes of the change, and values of its other parameters at each instant.
    within : str, default ""
        The blocks, each with a dot behind it, in which the parameters ``time`` and ``width`` are.

    Returns
    -------
    Trials
        The trial values, whose instant is refined.
    """
    length = (scales.stop - scales.start) / (INSTANT_COUNT + 1)
    times = [scales.start + (k + 1) * length for k in range(INSTANT_COUNT)]
    # A change within the first or the last interval is no change.
    name, width = f"{within}time", {f"{within}width": TRANSITION * scales.step}
    return Trials(size, tuple({name: time, **shape} for time in times), width, {name: (times[0], times[-1])}, name)


def interval_trials(scales: Scales, size: Mapping[str, float]) -> Trials:
    """Return trial values of a change that ends again, over intervals of the recordings.

    Parameters
    ----------
    scales : Scales
        Scales of the signals.
    size : mapping of str to float
        Trial sizes of the change.

    Returns
    -------
    Trials
        The trial values, whose instants ``time`` and ``until`` are refined.
    """
    times = np.linspace(scales.start, scales.stop, PAIR_COUNT + 2)[1:-1].tolist()
    pairs = ((a, b) for a, b in itertools.combinations(times, 2) if b - a < LONGEST_INTERVAL * (times[-1] - times[0]))
    shapes = tuple({"time": first, "until": last} for first, last in pairs)
    bounds = dict.fromkeys(("time", "until"), (scales.start, scales.stop))
    return Trials(size, shapes, {"width": TRANSITION * scales.step}, bounds, ("time", "until"))
