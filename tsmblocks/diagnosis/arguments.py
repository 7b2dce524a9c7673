"""The arguments of a diagnosis, checked: recordings, measured outputs, effects, noise floors, model settings."""

from __future__ import annotations

from collections.abc import Iterable, Mapping, Sequence
from fnmatch import fnmatchcase
from typing import Any

import attrs
import numpy as np

from tsmblocks.common import arguments
from tsmblocks.common.errors import DataError, ParameterError, bare_name, near
from tsmblocks.common.interpolation import Hold
from tsmblocks.data import Record
from tsmblocks.diagnosis.model import ModelSettings
from tsmblocks.effects import Effect, Relative, catalogue, relatives
from tsmblocks.effects.other_names import OTHER_NAMES
from tsmblocks.fitting.experiments import Window, compared, refuse_missing, signal_of, span
from tsmblocks.fitting.noise import given_floors
from tsmblocks.fitting.parameters import chosen, given_bounds
from tsmblocks.fitting.recordings import Data, recordings, windows, with_adopted_units, without_units
from tsmblocks.model.diagram import Diagram
from tsmblocks.simulation.arguments import as_diagram

MIN_SAMPLES = 200
"""Samples of all experiments together that a diagnosis takes at least. Chosen: five time blocks of the least length."""

Windows = Mapping[str, Window] | None
"""The part of each experiment that is compared [s]; None where all of them are."""


@attrs.frozen(eq=False)
class Request:
    """The request of a diagnosis: diagram, recordings and settings.

    ``measured`` are the outputs compared; ``patterns`` the names of effects as they were given, None for all of the
    catalogue; ``noise_floors`` the given ones as (rms in the diagram's unit, text). ``spans`` holds the first and the
    last instant compared [s] of each experiment that is compared in part. ``adopted`` says which units the
    diagram took over from the recordings. ``wrong_readings`` are notes on samples of the outputs that the residuals of
    a part showed to be wrong, and that were interpolated since.
    """

    diagram: Diagram
    records: Mapping[str, Record]
    measured: tuple[str, ...]
    effects: tuple[Effect | Relative, ...]
    patterns: tuple[str, ...] | None
    noise_floors: Mapping[str, tuple[float, str]]
    settings: ModelSettings
    condition: bool
    spans: Mapping[str, tuple[float, float]]
    adopted: tuple[str, ...] = ()
    wrong_readings: tuple[str, ...] = ()

    @property
    def notes(self) -> list[str]:
        """Notes on the recordings, before anything is fitted."""
        result = [*self.adopted]
        result += without_units(self.records, self.diagram, self.measured)
        result += [f"{name}: {text}" for name, r in self.records.items() for text in r.notes]
        return result + [f"{k}: only {low:g} s to {high:g} s is compared." for k, (low, high) in self.spans.items()]


def checked(
    diagram: Diagram,
    experiments: Data,
    *,
    free: Iterable[str] | None,
    noise_floor: Any,
    effects: Iterable[str] | None,
    outputs: Sequence[str] | None,
    window: Any,
    start_states: bool,
    condition: bool,
    seed: int,
    step: float | None,
    integrator: str,
    hold: Hold,
    progress: Any,
    bounds: Mapping[str, Any] | None = None,
    local: Iterable[str] | None = None,
) -> Request:
    """The arguments of ``tsm.diagnose`` as a request. Raises the errors of ``tsm.diagnose`` for them."""
    arguments.as_callback(progress, "stage, done and of")
    records = recordings(experiments)
    diagram, adopted = with_adopted_units(as_diagram(diagram), records)
    inside = None if window is None else windows(window, records)
    measured = _measured(records, diagram, outputs, inside)
    for record in records.values():
        refuse_missing(record, diagram)
    patterns = None if effects is None else tuple(arguments.as_names("effects", effects, "backlash"))
    selected, seed = _selected(patterns), arguments.as_integer("seed", seed, 0)
    own = () if local is None else tuple(arguments.as_names("local", local, "offset.*"))
    may_change = [*chosen(diagram, free), *chosen(diagram, own, "local")]  # unknown names are refused before any work
    given_bounds(bounds, may_change, diagram.parameters)
    floors = given_floors(noise_floor, diagram, records, measured)
    names = None if free is None else tuple(arguments.as_names("free", free, "tsm.*"))
    start_states = arguments.as_bool("start_states", start_states)
    settings = ModelSettings(names, {}, (), start_states, step, integrator, hold, seed, inside, dict(bounds or {}), own)
    instants = _compared(records, inside).items()
    spans = {k: (float(t[0]), float(t[-1])) for k, t in instants if len(t) < len(records[k])}
    return Request(diagram, records, measured, selected, patterns, floors, settings, condition, spans, tuple(adopted))


def _measured(
    records: Mapping[str, Record], diagram: Diagram, outputs: Sequence[str] | None, inside: Windows
) -> tuple[str, ...]:
    """The measured outputs. Raises DataError where there are too few samples."""
    wanted = None if outputs is None else arguments.as_names("outputs", outputs, "x_out")
    names = compared(records, diagram, wanted)
    total = sum(len(t) for t in _compared(records, inside).values())
    if total < MIN_SAMPLES:
        raise DataError(
            f"a diagnosis takes at least {MIN_SAMPLES} samples of all experiments together, and there are "
            f"{total}: with fewer, no effect is distinguishable from chance."
        )
    measured = tuple(k for k in names if diagram.shown[k][0])
    if not measured:
        raise DataError(
            f"of '{diagram.title}' only {', '.join(names)} was measured, which is an input of the diagram "
            "itself: there is no model in between to diagnose."
        )
    for name, record in records.items():  # before any filter spreads a missing sample over its neighbours
        for k in (*(k for k in diagram.inports if k in record), *measured):
            signal_of(name, record, k, diagram.unit(k))
    return measured


def _compared(records: Mapping[str, Record], inside: Windows) -> dict[str, np.ndarray]:
    """The instants [s] of each experiment that are compared. Raises DataError where there are next to none."""
    return {name: r.t if inside is None else r.t[span(name, r, inside[name])] for name, r in records.items()}


def _selected(patterns: tuple[str, ...] | None) -> tuple[Effect | Relative, ...]:
    """The effects and relatives that the patterns name. Raises ParameterError for a pattern that names none."""
    every: tuple[Effect | Relative, ...] = (*catalogue(), *relatives())
    if patterns is None:
        return every
    if not patterns:
        raise ParameterError("effects is empty. Leave it out to try all effects of the catalogue.")
    known = {e.name for e in every}
    for pattern in patterns:
        if not any(fnmatchcase(name, pattern) for name in known):
            named = OTHER_NAMES.get(bare_name(pattern), "")
            hint = f" It is '{named}' here." if named in known else near(pattern, known)
            raise ParameterError(f"effects: '{pattern}' names no effect of the catalogue.{hint}")
    return tuple(e for e in every if any(fnmatchcase(e.name, pattern) for pattern in patterns))
