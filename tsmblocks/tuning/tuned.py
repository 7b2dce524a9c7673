"""What tuning returns: the parameters found, and what they do in each case before and after."""

from __future__ import annotations

from collections.abc import Mapping
from typing import Any

import attrs

from tsmblocks.data import heading
from tsmblocks.diagram import Diagram
from tsmblocks.tables import few, in_parts


@attrs.frozen(eq=False)
class Tuned:
    """Parameters found. ``before`` and ``after`` map cases to metrics by name, with the diagrams' numbers and these.

    ``diagrams`` are the diagrams with the numbers, by case as they were given; ``met`` whether all limits hold
    everywhere, ``objective`` the metric that was to be small. ``remarks`` say which limits do not hold, and which
    numbers lie on a bound or change nothing.
    """

    values: Mapping[str, float]
    diagrams: Mapping[str, Diagram] = attrs.field(repr=False)
    objective: str
    units: Mapping[str, str] = attrs.field(repr=False)
    before: Mapping[str, Mapping[str, float]] = attrs.field(repr=False)
    after: Mapping[str, Mapping[str, float]] = attrs.field(repr=False)
    met: bool
    status: str = "complete"
    remarks: tuple[str, ...] = ()

    @property
    def diagram(self) -> Diagram:
        """The diagram, or the first of several."""
        return next(iter(self.diagrams.values()))

    @property
    def worst(self) -> tuple[float, float]:
        """The objective in the worst case, before and after."""
        before, after = (max(case[self.objective] for case in side.values()) for side in (self.before, self.after))
        return before, after

    def to_dict(self) -> dict[str, Any]:
        """The result as plain values."""
        return {"values": dict(self.values), "objective": self.objective, "worst": self.worst, "met": self.met,
                "status": self.status, "remarks": list(self.remarks),
                "before": {k: dict(v) for k, v in self.before.items()},
                "after": {k: dict(v) for k, v in self.after.items()}}  # fmt: skip

    def __repr__(self) -> str:
        found = few(f"{k} {v:.4g}" for k, v in self.values.items())
        before, after = self.worst
        ends = "" if self.met else ", not every limit is met"
        return f"Tuned({found}; {self.objective} {before:.4g} -> {after:.4g}{ends})"

    def _repr_html_(self) -> str:
        from tsmblocks.notebook import tuned_card

        return tuned_card(self)

    def __str__(self) -> str:
        names = list(next(iter(self.after.values())))
        rows = [("", *(x for name in names for x in (heading(name, self.units[name]), "tuned")))]
        shown = list(self.after)[:12]
        for case in shown:
            cells = [f"{side[case][name]:.4g}" for name in names for side in (self.before, self.after)]
            rows.append((case, *cells))
        more = f"\n… ({len(self.after)} in all)" if len(self.after) > len(shown) else ""
        found = ", ".join(f"{k} {v:.4g}" for k, v in self.values.items())
        ends = "".join(f"\n- {text}" for text in self.remarks)
        return f"{found}{ends}\n\n{in_parts(rows, together=2)}{more}"
