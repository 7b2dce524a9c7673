"""What a diagnosis says: the verdict, the effects named, how the gap shrank, and what could not have been seen."""

from __future__ import annotations

import json
from collections.abc import Mapping
from pathlib import Path
from typing import Any

import attrs
import numpy as np

from tsmblocks.common.frames import frame
from tsmblocks.common.tables import few
from tsmblocks.common.views import view
from tsmblocks.diagnosis.settings import Provenance, Simulated
from tsmblocks.fitting.result import Fit
from tsmblocks.fitting.text import cautions
from tsmblocks.model.diagram import Diagram


@attrs.frozen
class Quantity:
    """A number found, with the interval that holds it with a probability of 95 %, given this structure."""

    value: float
    low: float
    high: float
    unit: str = ""


@attrs.frozen
class NamedEffect:
    """An effect found missing.

    ``wire`` is where ``block`` was put, in wire notation; ``share_removed`` the share of the explainable error that it
    removes held out, together with the effects before it; ``across`` the same with whole experiments held out (None
    with a single experiment). ``also_possible`` are effects that these data cannot tell from it, and
    ``separating_experiment`` what would. ``code`` is the line that adds the block to a diagram.
    """

    name: str
    family: str
    words: str
    segment: str
    wire: str
    block: str
    parameters: Mapping[str, Quantity]
    share_removed: float
    across: float | None
    also_possible: tuple[str, ...]
    separating_experiment: str
    code: str


@attrs.frozen
class RankedCandidate:
    """A candidate tried: how much it removes held out [variances of the noise], and its t beside the line of chance.

    ``round`` counts from 1; ``gain`` is what was promised where a candidate was not worth a fit (``fitted`` False).
    ``share`` is the gain over the error above the noise; ``across`` and ``new`` are gain and share with whole
    experiments held out (NaN with a single one, or without a fit).
    """

    round: int
    segment: str
    name: str
    variant: str
    family: str
    wire: str
    gain: float
    share: float
    across: float
    t: float
    line: float
    in_set: bool
    named: bool
    fitted: bool
    at_bound: tuple[str, ...]
    parameters: Mapping[str, float]
    units: Mapping[str, str] = attrs.field(factory=dict)
    new: float = float("nan")


@attrs.frozen
class Gap:
    """Rms of the difference between simulation and measurement, before and after each effect that was named.

    ``train`` and ``held_out`` hold the base and then one number for each effect, ``experiments`` the same held out for
    each experiment; ``noise_floor`` is what no model can go below: the noise of the output and what the noise of
    measured inputs makes of it. ``method`` says where it is from, ``given`` in what words it was given, if it was.
    """

    output: str
    unit: str
    noise_floor: float
    method: str
    train: tuple[float, ...]
    held_out: tuple[float, ...]
    experiments: Mapping[str, tuple[float, ...]]
    given: str = ""


@attrs.frozen
class ResidualCoordinate:
    """A coordinate along which model and data disagree, and the share of the excess that it foretells held out."""

    coordinate: str
    share: float
    words: str


@attrs.frozen
class DetectionLimit:
    """The smallest size of an effect that these experiments would have shown; None where they do not excite it."""

    name: str
    parameter: str
    value: float | None
    unit: str
    excites: str


@attrs.frozen
class Consequence:
    """Tracking of a recorded motion [unit]: without compensation, and with one built on the base and on the new model.

    Each pair is peak-to-peak and rms error. The plant is the augmented model, the best that is known. ``words`` say
    what to make of a compensator on it that does no better than one on the base.
    """

    unit: str
    reference: str
    none: tuple[float, float]
    base: tuple[float, float]
    augmented: tuple[float, float]
    words: str = ""


@attrs.frozen(eq=False)
class Trace:
    """One output of one experiment: instants [s], and in ``unit`` measured, simulated before, simulated after.

    ``drive`` is the input beside it (empty where there is none), ``excess`` (blocks, 3) start, stop [s] and mean
    square of what the base leaves there, in variances of the noise.
    """

    experiment: str
    output: str
    unit: str
    t: np.ndarray = attrs.field(repr=False)
    measured: np.ndarray = attrs.field(repr=False)
    before: np.ndarray = attrs.field(repr=False)
    after: np.ndarray = attrs.field(repr=False)
    drive: np.ndarray = attrs.field(repr=False)
    drive_name: str
    excess: np.ndarray = attrs.field(repr=False)


@attrs.frozen(eq=False)
class Segment:
    """What was found between measured signals: a part of the diagram that was looked at by itself.

    ``fit`` is the last model as ``tsm.fit`` would return it: all numbers with intervals, and what the data leave open.
    """

    name: str
    inputs: tuple[str, ...]
    outputs: tuple[str, ...]
    verdict: str
    excess: float
    noise_floor: Mapping[str, float]
    effects: tuple[NamedEffect, ...]
    gaps: tuple[Gap, ...]
    where: tuple[ResidualCoordinate, ...]
    ranking: tuple[RankedCandidate, ...]
    limits: tuple[DetectionLimit, ...]
    traces: tuple[Trace, ...] = attrs.field(repr=False)
    ceiling: float
    sentence: str
    fit: Fit | None = attrs.field(default=None, repr=False)

    @property
    def cautions(self) -> tuple[str, ...]:
        """What to know before the numbers of the last model are believed: what a fit of it would warn of."""
        return () if self.fit is None else tuple(cautions(attrs.evolve(self.fit, notes=())))


@attrs.frozen(eq=False)
class Diagnosis:
    """The outcome of ``tsm.diagnose``.

    ``verdict`` is ``"named"`` where effects were named, ``"unknown"`` where something is missing that no block of the
    catalogue explains, ``"none"`` where nothing is missing that these data could show. ``base`` is the diagram with
    its numbers refitted, ``augmented`` the one with the named blocks in place. ``status`` is ``"done"``, or
    ``"interrupted"`` after Ctrl-C: what was found until then is here. ``windows`` are the first and the last instant
    compared [s] of each experiment of which a part was asked for. ``given`` is the diagram as it was
    handed over, ``simulated`` how models were set beside the recordings, with the start states found; ``provenance``
    is what all of it rests on, and ``no_consequence`` says why there is no ``consequence``.
    """

    diagram: str
    experiments: tuple[str, ...]
    seed: int
    verdict: str
    sentence: str
    effects: tuple[NamedEffect, ...]
    segments: tuple[Segment, ...]
    base: Diagram = attrs.field(repr=False)
    augmented: Diagram = attrs.field(repr=False)
    consequence: Consequence | None
    notes: tuple[str, ...]
    status: str
    windows: Mapping[str, tuple[float, float]] = attrs.field(factory=dict)
    given: Diagram | None = attrs.field(default=None, repr=False)
    simulated: Simulated | None = attrs.field(default=None, repr=False)
    provenance: Provenance | None = attrs.field(default=None, repr=False)
    no_consequence: str = ""

    @property
    def first(self) -> Diagram:
        """The diagram that was diagnosed, with its own numbers where they are known."""
        return self.base if self.given is None else self.given

    @property
    def start_states(self) -> dict[str, dict[str, float]]:
        """Start values of states that were found, by experiment: ``diagrams`` has them."""
        return {} if self.simulated is None else {k: dict(v) for k, v in self.simulated.start_states.items()}

    @property
    def diagrams(self) -> dict[str, Diagram]:
        """The augmented diagram of each experiment, with the start values of its own."""
        return {name: self.augmented.with_parameters(own) for name, own in self.start_states.items()}

    @property
    def worst(self) -> Segment:
        """The segment that the verdict is about: with effects named, else with the largest excess."""
        return max(self.segments, key=lambda s: (s.verdict == self.verdict, len(s.effects), s.excess))

    def to_dict(self) -> dict[str, Any]:
        """Return everything as plain values, as ``diagnosis.json`` holds it."""
        worst = self.worst
        return {
            "format": 1,
            "diagram": self.diagram,
            "experiments": list(self.experiments),
            "windows": _json_value({k: list(pair) for k, pair in self.windows.items()}),
            "seed": self.seed,
            "verdict": self.verdict,
            "sentence": self.sentence,
            "status": self.status,
            "effects": [_effect(e) for e in self.effects],
            "gap": _gap(worst.gaps[0]),
            "where": [_where(w) for w in worst.where],
            "ranking": [_ranked(r) for s in self.segments for r in s.ranking],
            "detection_limits": {m.name: _rounded(m.value) for s in reversed(self.segments) for m in s.limits},
            "segments": [_segment(s) for s in self.segments],
            "consequence": None if self.consequence is None else _json_value(attrs.asdict(self.consequence)),
            "no_consequence": self.no_consequence,
            "start_states": self.start_states,
            "simulated": None if self.simulated is None else self.simulated.to_dict(),
            "provenance": None if self.provenance is None else _json_value(attrs.asdict(self.provenance)),
            "notes": list(self.notes),
        }

    def to_pandas(self) -> Any:
        """A frame with a row per candidate of each round, as the ranking of ``diagnosis.json`` has it. Needs pandas."""
        rows = [_ranked(r) for s in self.segments for r in s.ranking]
        known = [k for k in (rows[0] if rows else {}) if k not in ("at_bound", "parameters")]
        return frame({k: [row[k] for row in rows] for k in known})

    def to_json(self) -> str:
        """Return ``diagnosis.json``: the same data and the same seed give the same bytes."""
        return json.dumps(self.to_dict(), indent=1, ensure_ascii=False, allow_nan=False) + "\n"

    def save(self, folder: str | Path) -> Path:
        """Write ``diagnosis.json``, ``augmented.toml`` and ``report.html`` into a folder."""
        return view("report", self, folder=Path(folder))

    def plot(self, ax: Any = None) -> Any:
        """A figure of how the gap shrank and where model and data disagree. Needs matplotlib."""
        return view("plot", self, ax=ax)

    def __repr__(self) -> str:
        found = [f"{e.name} on {e.wire.strip()}" for e in self.effects]
        return f"Diagnosis({self.diagram!r}, {self.verdict}{': ' if found else ''}{few(found)})"

    def _repr_html_(self) -> str:
        return view("html", self)

    def __str__(self) -> str:
        return view("text", self)


def _effect(e: NamedEffect) -> dict[str, Any]:
    return {
        "name": e.name,
        "family": e.family,
        "words": e.words,
        "segment": e.segment,
        "wire": e.wire,
        "block": e.block,
        "parameters": {k: _json_value(attrs.asdict(q)) for k, q in e.parameters.items()},
        "share_removed": _rounded(e.share_removed),
        "share_removed_across_experiments": _rounded(e.across),
        "also_possible": list(e.also_possible),
        "separating_experiment": e.separating_experiment,
        "code": e.code,
    }


def _gap(gap: Gap) -> dict[str, Any]:
    return {
        "output": gap.output,
        "unit": gap.unit,
        "noise_floor": _rounded(gap.noise_floor),
        "noise_floor_from": gap.method,
        "train": {"before": _rounded(gap.train[0]), "after": _rounded(gap.train[-1])},
        "held_out": {"before": _rounded(gap.held_out[0]), "after": _rounded(gap.held_out[-1])},
        "steps": {"train": _json_value(gap.train), "held_out": _json_value(gap.held_out)},
        "experiments": {k: _json_value(v) for k, v in gap.experiments.items()},
    }


def _where(w: ResidualCoordinate) -> dict[str, Any]:
    return {"coordinate": w.coordinate, "share": _rounded(w.share), "words": w.words}


def _ranked(r: RankedCandidate) -> dict[str, Any]:
    return {
        "round": r.round,
        "segment": r.segment,
        "name": r.name,
        "variant": r.variant,
        "family": r.family,
        "wire": r.wire,
        "held_out_gain": _rounded(r.gain),
        "share": _rounded(r.share),
        "across": _rounded(r.across),
        "share_across": _rounded(r.new),
        "statistic": _rounded(r.t),
        "line": _rounded(r.line),
        "in_set": r.in_set,
        "named": r.named,
        "fitted": r.fitted,
        "at_bound": list(r.at_bound),
        "parameters": _json_value(r.parameters),
    }


def _segment(s: Segment) -> dict[str, Any]:
    return {
        "name": s.name,
        "inputs": list(s.inputs),
        "outputs": list(s.outputs),
        "verdict": s.verdict,
        "excess": _rounded(s.excess),
        "sentence": s.sentence,
        "effects": [e.name for e in s.effects],
        "numbers": [] if s.fit is None else [_json_value(e.to_dict()) for e in s.fit],
        "cautions": list(s.cautions),
        "ceiling": _rounded(s.ceiling),
        "gaps": [_gap(g) for g in s.gaps],
        "where": [_where(w) for w in s.where],
        "detection_limits": {
            m.name: None if m.value is None else {"parameter": m.parameter, "value": _rounded(m.value), "unit": m.unit}
            for m in s.limits
        },
    }


def _json_value(value: Any) -> Any:
    if isinstance(value, Mapping):
        return {k: _json_value(v) for k, v in value.items()}
    if isinstance(value, (list, tuple)):
        return [_json_value(v) for v in value]
    return _rounded(float(value)) if isinstance(value, (float, np.floating)) else value


def _rounded(value: float | None) -> float | None:
    """Six digits, which more than covers what the data tell; None for what is no number."""
    if value is None or not np.isfinite(value):
        return None
    return float(f"{float(value):.6g}")
