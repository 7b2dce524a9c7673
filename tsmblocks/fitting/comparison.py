"""The result of ``compare``: models ranked from best to worst, in one file or over several."""

from __future__ import annotations

from collections.abc import Iterator, Mapping
from typing import Any

import attrs
import numpy as np

from tsmblocks.common import displayed_units
from tsmblocks.common.errors import RunError, near
from tsmblocks.common.frames import frame
from tsmblocks.common.tables import few
from tsmblocks.common.views import view
from tsmblocks.fitting.result import Fit
from tsmblocks.fitting.score import Differences


@attrs.frozen(eq=False)
class Row:
    """One model: its fit, and its residuals on training and held-out data.

    ``fault`` says why a model could not be fitted, and the rest is then empty; or, where there is a ``fit``, why it
    could not be validated.
    """

    name: str
    fit: Fit | None
    train: Differences | None
    held_out: Differences | None
    fault: str = ""

    @property
    def parameters(self) -> int:
        """Number of fitted parameters, initial states not counted."""
        return 0 if self.fit is None else sum(not e.is_start for e in self.fit.estimates)

    @property
    def interrupted(self) -> bool:
        """Whether Ctrl-C ended its fit."""
        return self.fit is not None and self.fit.status == "interrupted"

    @property
    def figure(self) -> float:
        """RMS by which models are ranked: on held-out data, or that of the fit without any; infinite on a fault."""
        best = self.held_out or self.train
        return np.inf if best is None or self.fault else best.rms

    def __repr__(self) -> str:
        if self.train is None:
            return f"Row({self.name!r}, {self.fault!r})"
        k, unit = displayed_units.display_unit(self.train.unit)
        return f"Row({self.name!r}, {self.parameters} parameters, rms {k * self.figure:.4g} {unit})"


@attrs.frozen(eq=False)
class Comparison:
    """Models ranked from best to worst, on held-out data where there are any; by name, ``comparison["play"]``.

    Parameters
    ----------
    rows : tuple of Row
        One per model.
    unit : str
        Unit of the errors.
    interrupted : bool, default False
        Whether Ctrl-C ended it.
    notes : tuple of str
        Units assumed for signals without one, and inputs too noisy to drive a model with memory.
    noise : float
        RMS of the noise of the output in ``unit``, from the recordings; NaN where several outputs are compared.
    noise_from : str
        How the noise was estimated.
    """

    rows: tuple[Row, ...]
    unit: str
    interrupted: bool = False
    notes: tuple[str, ...] = ()
    noise: float = float("nan")
    noise_from: str = ""

    @property
    def above_noise(self) -> float:
        """Error of the best model relative to the noise; NaN where that is not known."""
        return self.best.figure / self.noise if self.noise > 0 else float("nan")

    @property
    def best(self) -> Row:
        """The model of the least error."""
        return self.rows[0]

    def __iter__(self) -> Iterator[Row]:
        return iter(self.rows)

    def __len__(self) -> int:
        return len(self.rows)

    def __getitem__(self, name: str) -> Row:
        """Return a row by the model's name. Raises RunError with the near miss."""
        found = next((row for row in self.rows if row.name == name), None)
        if found is None:
            raise RunError(f"no model '{name}' was compared.{near(name, [r.name for r in self.rows])}")
        return found

    @property
    def is_share(self) -> bool:
        """Whether figures are shares of the spread of the outputs, which have no unit in common."""
        return any(row.train is not None and row.train.is_share for row in self)

    def to_dict(self) -> dict[str, Any]:
        """Return the ranking as plain values.

        Returns
        -------
        dict
            As ``tsmblocks compare --json`` prints it.
        """
        models = [
            {
                "name": row.name,
                "parameters": row.parameters,
                "fault": row.fault or None,
                "train": row.train and row.train.to_dict(),
                "held_out": row.held_out and row.held_out.to_dict(),
                "fit": row.fit and row.fit.to_dict(),
            }
            for row in self.rows
        ]
        return {
            "format": 1,
            "unit": self.unit,
            "interrupted": self.interrupted,
            "noise": self.noise if np.isfinite(self.noise) else None,
            "noise_from": self.noise_from,
            "notes": list(self.notes),
            "models": models,
        }

    def to_pandas(self) -> Any:
        """Return the ranking as a table.

        Returns
        -------
        pandas.DataFrame
            A row per model, best first: parameters, rms in-sample and held out, fault. Needs pandas.
        """
        columns = {
            "parameters": [r.parameters for r in self],
            "rms in-sample": [np.nan if r.train is None else r.train.rms for r in self],
            "rms held-out": [np.nan if r.held_out is None else r.held_out.rms for r in self],
            "fault": [r.fault for r in self],
        }
        return frame(columns, [r.name for r in self], "model", {k: self.unit for k in columns if k.startswith("rms")})

    def plot(self, ax: Any = None, *, width: float | None = None) -> Any:
        """Plot the error of every model and the loops of the best.

        Parameters
        ----------
        ax : matplotlib.axes.Axes, optional
            Axes to draw into; by default a new figure.
        width : float, optional
            Width of a new figure [in]; 7 by default, which is both columns of a paper. One column is 3.4.

        Returns
        -------
        matplotlib.figure.Figure
            The figure. Needs matplotlib.
        """
        return view("plot", self, ax=ax, width=width)

    def __repr__(self) -> str:
        return f"Comparison(best {self.best.name!r} of {len(self)}: {few(r.name for r in self)})"

    def _repr_html_(self) -> str:
        return view("html", self)

    def __str__(self) -> str:
        return view("text", self)


def overall(found: Mapping[str, Comparison]) -> list[tuple[str, float]]:
    """Models from best to worst over comparisons made file by file, with the root mean square of their figures.

    Models that are missing in a file, or could not be fitted there, come last; theirs is over the other files.
    """
    ranked = []
    for model in dict.fromkeys(row.name for one in found.values() for row in one):
        figures = [row.figure for one in found.values() for row in one if row.name == model]
        known = [value for value in figures if np.isfinite(value)]
        rms = float(np.sqrt(np.mean(np.square(known)))) if known else np.inf
        ranked.append((len(found) - len(known), rms, model))
    return [(model, rms) for _, rms, model in sorted(ranked)]
