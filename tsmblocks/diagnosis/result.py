"""The result of a diagnosis: verdict, effects named, segments, the diagrams before and after."""

from __future__ import annotations

import json
from collections.abc import Mapping
from pathlib import Path
from typing import Any

import attrs

from tsmblocks.common.frames import frame
from tsmblocks.common.tables import few
from tsmblocks.common.views import view
from tsmblocks.diagnosis.plain_values import diagnosis_values, ranking_values
from tsmblocks.diagnosis.segment import Consequence, NamedEffect, Segment
from tsmblocks.diagnosis.settings import Provenance, Simulated
from tsmblocks.model.diagram import Diagram


@attrs.frozen(eq=False)
class Diagnosis:
    """The result of ``tsm.diagnose``; ``print(diagnosis)`` shows a summary, ``print(diagnosis.details())`` the rest.

    Parameters
    ----------
    diagram : str
        Title of the diagram.
    experiments : tuple of str
        Names of the experiments.
    seed : int
        Seed of the random parts.
    verdict : {"named", "unknown", "none"}
        ``"named"`` where effects were named, ``"unknown"`` where the residual is above the noise floor and none of the
        effects tried explains it, ``"none"`` where no unmodelled effect is detectable.
    sentence : str
        The verdict in words.
    effects : tuple of NamedEffect
        The effects named, of all segments.
    segments : tuple of Segment
        The results by part of the diagram, between measured signals.
    base : Diagram
        The diagram with its parameters refitted.
    augmented : Diagram
        The diagram with the blocks of the effects inserted, and all parameters refitted.
    consequence : Consequence or None
        Tracking errors with compensators built on both; None where they could not be simulated.
    notes : tuple of str
        Notes on data and model.
    status : {"done", "interrupted", "limit"}
        The results until then: ``"interrupted"`` after Ctrl-C, ``"limit"`` at the time limit.
    windows : mapping of str to pair of float, default {}
        First and last instant compared [s] of each experiment of which a part was compared.
    given : Diagram, optional
        The diagram as it was passed to ``tsm.diagnose``.
    simulated : Simulated, optional
        How the last models were simulated, with the estimated initial states.
    provenance : Provenance, optional
        Version, source of the diagram, recordings and options.
    no_consequence : str, default ""
        Why there is no ``consequence``.
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
        """The diagram that was diagnosed, with its original parameters where they are known."""
        return self.base if self.given is None else self.given

    @property
    def start_states(self) -> dict[str, dict[str, float]]:
        """The estimated initial states by experiment; ``diagrams`` has them set."""
        return {} if self.simulated is None else {k: dict(v) for k, v in self.simulated.start_states.items()}

    @property
    def diagrams(self) -> dict[str, Diagram]:
        """The augmented diagram of each experiment, with its initial states."""
        return {name: self.augmented.with_parameters(own) for name, own in self.start_states.items()}

    @property
    def complete(self) -> bool:
        """Whether no segment's last model leaves more than noise."""
        return all(s.complete for s in self.segments)

    @property
    def worst(self) -> Segment:
        """The segment of the verdict: with effects named, else with the largest excess."""
        return max(self.segments, key=lambda s: (s.verdict == self.verdict, len(s.effects), s.excess))

    def details(self) -> str:
        """Return what the summary leaves out, as text.

        Returns
        -------
        str
            Noise floors, the candidates of each round with why they were not named, parameters with intervals,
            detection limits, and a script that makes the augmented diagram.
        """
        return view("details", self)

    def to_dict(self) -> dict[str, Any]:
        """Return everything as plain values, as in ``diagnosis.json``.

        Returns
        -------
        dict
            Numbers, texts, lists and mappings only; numbers with six digits.
        """
        return diagnosis_values(self)

    def to_pandas(self) -> Any:
        """Return a frame with a row for each candidate of each round. Needs pandas.

        Returns
        -------
        pandas.DataFrame
            Columns as in the ranking of ``diagnosis.json``.
        """
        rows = ranking_values(self)
        known = [k for k in (rows[0] if rows else {}) if k not in ("at_bound", "parameters")]
        return frame({k: [row[k] for row in rows] for k in known})

    def to_json(self) -> str:
        """Return the text of ``diagnosis.json``.

        Returns
        -------
        str
            JSON; the same data and the same seed give the same bytes.
        """
        return json.dumps(self.to_dict(), indent=1, ensure_ascii=False, allow_nan=False) + "\n"

    def save(self, folder: str | Path) -> Path:
        """Write ``diagnosis.json``, ``augmented.toml`` and ``report.html`` into a folder.

        Parameters
        ----------
        folder : str or Path
            The folder; made where it does not exist.

        Returns
        -------
        Path
            The folder.

        Raises
        ------
        TsmError
            Where the folder is a file, or has the name of one.
        """
        return view("report", self, folder=Path(folder))

    def plot(self, ax: Any = None, *, width: float | None = None) -> Any:
        """Plot the errors before and after, the signals, and the residual along its main coordinate. Needs matplotlib.

        Parameters
        ----------
        ax : matplotlib axes, optional
            Where to plot: four for each segment. Default: a new figure.
        width : float or None, default None
            Width of a new figure [in]; 7 by default, which is both columns of a paper. One column is 3.4.

        Returns
        -------
        matplotlib.figure.Figure
            The figure.
        """
        return view("plot", self, ax=ax, width=width)

    def __repr__(self) -> str:
        found = [f"{e.name} on {e.wire.strip()}" for e in self.effects]
        return f"Diagnosis({self.diagram!r}, {self.verdict}{': ' if found else ''}{few(found)})"

    def _repr_html_(self) -> str:
        return view("html", self)

    def __str__(self) -> str:
        return view("text", self)
