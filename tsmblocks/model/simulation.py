"""How a diagram was simulated on recordings: the settings with which its file reproduces the same errors."""

from __future__ import annotations

import functools
import math
from collections.abc import Iterable, Mapping
from types import MappingProxyType
from typing import Any

import attrs

from tsmblocks.common.errors import ParameterError, in_words, near
from tsmblocks.common.interpolation import HOLD_WORDS, Hold

METHODS = ("rk4", "euler", "heun", "sdirk2", "sdirk3", "sdirk4")
"""Names of the Runge-Kutta methods."""


def _table(given: Any) -> Any:
    """A read-only copy of a mapping; anything else as it is."""
    return MappingProxyType(dict(given)) if isinstance(given, Mapping) else given


def _tables(given: Any) -> Any:
    return MappingProxyType({name: _table(one) for name, one in given.items()}) if isinstance(given, Mapping) else given


def _names(given: Iterable[str]) -> tuple[str, ...]:
    return tuple(given)


def _step(_: Any, __: Any, given: Any) -> None:
    values = given.values() if isinstance(given, Mapping) else () if given is None else (given,)
    for value in values:
        if isinstance(value, bool) or not isinstance(value, (int, float)) or not 0 < value < math.inf:
            raise ParameterError(f"step must be a positive number of seconds, got {in_words(value)}.")


def _method(_: Any, __: Any, given: Any) -> None:
    if given != "" and given not in METHODS:
        raise ParameterError(
            f"method must be one of {', '.join(METHODS)}, got {in_words(given)}.{near(str(given), METHODS)}"
        )


def _hold(_: Any, __: Any, given: Any) -> None:
    for word in given.values() if isinstance(given, Mapping) else () if given == "" else (given,):
        if word not in HOLD_WORDS:
            raise ParameterError(
                f"hold must be one of {', '.join(HOLD_WORDS)}, got {in_words(word)}.{near(str(word), HOLD_WORDS)}"
            )


def _text(_: Any, attribute: Any, given: Any) -> None:
    if not isinstance(given, str):
        raise ParameterError(f"{attribute.name} must be text, got {in_words(given)}.")


def _start(_: Any, __: Any, given: Any) -> None:
    for name, states in given.items():
        for state, value in states.items():
            if isinstance(value, bool) or not isinstance(value, (int, float)) or not math.isfinite(value):
                raise ParameterError(f"start of '{state}' in '{name}' must be a finite number, got {in_words(value)}.")


@attrs.frozen(kw_only=True)
class Simulation:
    """How a diagram was simulated on recordings.

    Parameters
    ----------
    step : float or mapping of str to float, optional
        Step in s, one for all or by recording.
    method : str, default ""
        Runge-Kutta method, ``""`` for the default one.
    hold : str or mapping of str to str, default ""
        Interpolation between samples, one for all inputs or by input; ``""`` for the default one.
    condition : sequence of str, default ()
        Inputs whose noise was filtered out (``Record.conditioned``).
    stop_when : str, default ""
        Comparison of signals at which a run ends, as for ``simulate``; ``""`` for none.
    start : mapping of str to mapping of str to float, default {}
        Initial states by recording. Other recordings, and runs without any, begin with those of the diagram.

    Raises
    ------
    ParameterError
        For a step that is not positive, an unknown method or interpolation, or a start that is no number.
    """

    step: float | Mapping[str, float] | None = attrs.field(default=None, converter=_table, validator=_step)
    method: str = attrs.field(default="", validator=_method)
    hold: Hold = attrs.field(default="", converter=_table, validator=_hold)
    condition: tuple[str, ...] = attrs.field(default=(), converter=_names)
    stop_when: str = attrs.field(default="", validator=_text)
    start: Mapping[str, Mapping[str, float]] = attrs.field(factory=dict, converter=_tables, validator=_start)

    def step_of(self, recording: str = "") -> float | None:
        """Return the step of a recording.

        Parameters
        ----------
        recording : str, default ""
            Its name.

        Returns
        -------
        float or None
            The step in s: the finest one for a recording without one, None where no step is known.
        """
        if not isinstance(self.step, Mapping):
            return self.step
        return self.step.get(recording, min(self.step.values(), default=None))

    def start_of(self, recording: str) -> dict[str, float]:
        """Return the initial states of a recording.

        Parameters
        ----------
        recording : str
            Its name.

        Returns
        -------
        dict of str to float
            Values by name; empty for a recording that is not known.
        """
        return dict(self.start.get(recording, {}))

    def without(self, names: Iterable[str]) -> Simulation:
        """Return the same without the initial states of these names, which then have one value everywhere.

        Parameters
        ----------
        names : iterable of str
            Names of states.

        Returns
        -------
        Simulation
            The settings.
        """
        gone = set(names)
        start = {name: {k: v for k, v in own.items() if k not in gone} for name, own in self.start.items()}
        return attrs.evolve(self, start={name: own for name, own in start.items() if own})

    def __reduce__(self) -> Any:  # mapping proxies do not pickle
        start = {name: dict(states) for name, states in self.start.items()}
        step, hold = (dict(one) if isinstance(one, Mapping) else one for one in (self.step, self.hold))
        made: dict[str, Any] = dict(step=step, method=self.method, hold=hold, condition=self.condition, start=start)
        made["stop_when"] = self.stop_when
        return functools.partial(Simulation, **made), ()
