"""The result of tuning: the parameters, and the metrics in each case before and after."""

from __future__ import annotations

import textwrap
from collections.abc import Mapping, Sequence
from typing import Any

import attrs
import numpy as np

from tsmblocks.common import displayed_units
from tsmblocks.common.frames import frame, optional_library
from tsmblocks.common.tables import columns, few, line_width
from tsmblocks.common.views import view
from tsmblocks.data import heading
from tsmblocks.metrics.metrics import named
from tsmblocks.model.diagram import Diagram
from tsmblocks.tuning.constraints import LIMIT_TOLERANCE, Limit

BOUND_TOLERANCE = 1e-6
"""Distance from a bound, as a share of the range, that counts as at the bound. Chosen."""
MOST_CASES = 12
"""Cases in a printed table, at most: those where the objective is largest. Chosen."""


@attrs.frozen(eq=False)
class Oscillation:
    """A signal that oscillates far more than before, in the case where it does so most.

    Parameters
    ----------
    name, case, unit : str
        The signal, the case, and the unit of the signal.
    t, before, tuned : ndarray, shape (n,)
        Instants [s], and the signal with the diagrams' own parameters and with the tuned ones.
    frequency : float or None
        Frequency of its swings [Hz]; None for fewer than five.
    """

    name: str
    case: str
    unit: str
    t: np.ndarray = attrs.field(repr=False)
    before: np.ndarray = attrs.field(repr=False)
    tuned: np.ndarray = attrs.field(repr=False)
    frequency: float | None = None


@attrs.frozen(eq=False)
class Tuned:
    """Tuned parameters, and the metrics of each case before and after.

    Parameters
    ----------
    values : dict of str to float
        The parameters.
    diagrams : dict of str to Diagram
        The diagrams with these parameters, by case.
    objective : str
        Name of the metric that was minimised.
    units : dict of str to str
        Units of the metrics.
    before, after : dict of str to dict of str to float
        Metrics by case and name, with the diagrams' own parameters and with these.
    met : bool
        Whether all limits hold in all cases.
    status : {"complete", "interrupted"}
        How the searches ended.
    own : dict of str to float
        The diagrams' own parameters.
    bounds : dict of str to (float, float)
        Bounds of the parameters.
    limits : list of Limit
        The limits.
    starts, agreeing : int
        Number of searches, and of those that ended about as low as the best.
    idle, hunting : tuple of str, optional
        Parameters without effect, and texts on signals that oscillate far more than before.
    oscillation : Oscillation or None, default None
        The signal among them that grew most.
    """

    values: Mapping[str, float]
    diagrams: Mapping[str, Diagram] = attrs.field(repr=False)
    objective: str
    units: Mapping[str, str] = attrs.field(repr=False)
    before: Mapping[str, Mapping[str, float]] = attrs.field(repr=False)
    after: Mapping[str, Mapping[str, float]] = attrs.field(repr=False)
    met: bool
    status: str
    own: Mapping[str, float]
    bounds: Mapping[str, tuple[float, float]]
    limits: Sequence[Limit] = attrs.field(repr=False)
    starts: int
    agreeing: int
    idle: tuple[str, ...] = ()
    hunting: tuple[str, ...] = ()
    oscillation: Oscillation | None = attrs.field(repr=False, default=None)

    @property
    def diagram(self) -> Diagram:
        """The diagram, or the first of several."""
        return next(iter(self.diagrams.values()))

    @property
    def worst(self) -> tuple[float, float]:
        """The objective in the worst case, before and after."""
        before, after = (max(case[self.objective] for case in side.values()) for side in (self.before, self.after))
        return before, after

    @property
    def _change(self) -> str:
        """The objective in the worst case, before and after, as text."""
        k, unit = displayed_units.display_unit(self.units[self.objective])
        before, after = self.worst
        return f"{heading(named(self.objective)[0], unit)} {k * before:.4g} -> {k * after:.4g}"

    @property
    def improved(self) -> bool:
        """Whether the parameters differ from the diagrams' own."""
        return dict(self.values) != dict(self.own)

    @property
    def at_bounds(self) -> dict[str, str]:
        """Parameters at a bound, and at which side."""
        return {
            name: side
            for name, (low, high) in self.bounds.items()
            for bound, side in ((low, "lower"), (high, "upper"))
            if name not in self.idle and abs(self.values[name] - bound) <= BOUND_TOLERANCE * (high - low)
        }

    @property
    def remarks(self) -> tuple[str, ...]:
        """Warnings to read before the parameters are used."""
        texts = [self._violation(one) for one in self.limits]
        if self.status != "complete":
            texts.append("interrupted: these are the best parameters so far")
        if not self.improved:
            texts.append("no better parameters were found than the diagram's own")
        if self.starts > 1 and self.agreeing == 1:
            texts.append("no two starts ended here: more starts may find better parameters")
        held = [f"{name} is at its {side} bound ({self.values[name]:.4g})" for name, side in self.at_bounds.items()]
        if held and self.improved:
            texts.append(f"{', '.join(held)}: better parameters may lie beyond it")
        texts += [f"{name} has no effect on the objective and the limits" for name in self.idle]
        return tuple(text for text in (*texts, *self.hunting) if text)

    def _violation(self, one: Limit) -> str:
        """A text on a limit that is violated in the worst case, ``""`` where it holds."""
        case, value = max(((c, v[one.name]) for c, v in self.after.items()), key=lambda pair: one.excess(pair[1]))
        if not one.excess(value) > LIMIT_TOLERANCE:
            return ""
        where = f" in case '{case}'" if len(self.after) > 1 else ""
        texts = (*(f"{value:.{digits}g}" for digits in (4, 6, 9)), repr(value))
        shown = next(text for text in texts if one.excess(float(text)) > LIMIT_TOLERANCE)  # not rounded to the limit
        return f"{one.text} is not met: it is {shown} {one.unit}".rstrip() + where

    def title(self, name: str) -> str:
        """A metric as tables and plots show it: with its unit (degrees for angles) and its limits.

        Parameters
        ----------
        name : str
            The metric.

        Returns
        -------
        str
            The text.
        """
        k, unit = displayed_units.display_unit(self.units[name])
        limits = (one for one in self.limits if one.name == name)
        most = [f"{'at most' if one.sign > 0 else 'at least'} {k * one.most:.4g}" for one in limits]
        return ", ".join([heading(named(name)[0], unit), *most])

    def to_dict(self) -> dict[str, Any]:
        """The result as plain values.

        Returns
        -------
        dict
            Numbers, texts, lists and dicts, as JSON takes them.
        """
        return {
            "values": dict(self.values),
            "objective": self.objective,
            "worst": self.worst,
            "met": self.met,
            "status": self.status,
            "before": {k: dict(v) for k, v in self.before.items()},
            "after": {k: dict(v) for k, v in self.after.items()},
            "units": dict(self.units),
            "own": dict(self.own),
            "bounds": {k: list(v) for k, v in self.bounds.items()},
            "starts": {"tried": self.starts, "agreeing": self.agreeing},
            "remarks": list(self.remarks),
        }

    def to_pandas(self) -> Any:
        """A table of the metrics with a row for each case, before and tuned.

        Returns
        -------
        pandas.DataFrame
            The table; ``attrs["units"]`` has the units. Needs pandas.
        """
        pd = optional_library("pandas")
        sides = {"before": self.before, "tuned": self.after}
        rows = [(case, side) for case in self.after for side in sides]
        index = pd.MultiIndex.from_tuples(rows, names=["case", "numbers"])
        names = next(iter(self.after.values()))
        return frame(
            {name: [sides[side][case][name] for case, side in rows] for name in names}, index, units=self.units
        )

    def plot(self, *metrics: str, ax: Any = None, width: float | None = None) -> Any:
        """Plot metrics of each case, before and tuned, and a signal that oscillates far more than before.

        Parameters
        ----------
        *metrics : str
            The metrics; all unless given.
        ax : matplotlib.axes.Axes, optional
            Where to draw a single metric. By default in a new figure.
        width : float or None, default None
            Width of a new figure [in]; 7 by default, which is both columns of a paper. One column is 3.4.

        Returns
        -------
        matplotlib.figure.Figure
            The figure. Needs matplotlib.
        """
        return view("plot", self, metrics=metrics, ax=ax, width=width)

    def __repr__(self) -> str:
        values = few(f"{k} {v:.4g}" for k, v in self.values.items())
        ends = "" if self.met else ", not every limit is met"
        ends += ", it hunts" if self.hunting else ""
        return f"Tuned({values}; {self._change}{ends})"

    def _repr_html_(self) -> str:
        return view("html", self)

    def __str__(self) -> str:
        cases = f", the worst of {len(self.after)} cases" if len(self.after) > 1 else ""
        agree = f"; {self.agreeing} of {self.starts} starts ended there" if self.starts > 1 else ""
        head = textwrap.fill(f"{self._change}{cases}{agree}", line_width())
        numbers: list[Sequence[str]] = [("parameter", "before", "tuned", "from", "to", "")]
        at = self.at_bounds
        for name, value in self.values.items():
            shown = (f"{v:.4g}" for v in (self.own[name], value, *self.bounds[name]))
            numbers.append((name, *shown, f"at its {at[name]} bound" if name in at else ""))
        parts = [head, columns(numbers, left=(0, 5)), columns(self._measured())]
        if self.remarks:
            parts.append("\n".join(["beware:", *map(_bullet, self.remarks)]))
        return "\n\n".join(parts)

    def _shown(self, name: str, value: float) -> str:
        """A metric or margin in a table."""
        k, _ = displayed_units.display_unit(self.units[name])
        return "none" if any(one.name == name and one.is_none(value) for one in self.limits) else f"{k * value:.4g}"

    def _measured(self) -> list[tuple[str, ...]]:
        """Rows of all metrics, before and tuned, angles in degrees; an empty row between two metrics."""
        worst = sorted(self.after, key=lambda case: -self.after[case][self.objective])[:MOST_CASES]
        shown, rows = [case for case in self.after if case in worst], list[tuple[str, ...]]()
        more = [(f"… ({len(self.after)} in all, the worst shown)", "", "")] if len(self.after) > len(shown) else []
        for name in next(iter(self.after.values())):
            rows += [("", "", "")] if rows else []
            rows.append((self.title(name), "before", "tuned"))
            for case in shown:
                rows.append((case, *(self._shown(name, side[case][name]) for side in (self.before, self.after))))
            rows += more
        return rows


def _bullet(text: str) -> str:
    """A sentence in lines that fit a terminal, after a dash."""
    fold = textwrap.TextWrapper(line_width(), initial_indent="- ", subsequent_indent="  ", break_long_words=False)
    fold.break_on_hyphens = False
    return fold.fill(text)
