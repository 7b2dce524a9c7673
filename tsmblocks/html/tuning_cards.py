"""Cards of tuning results: the parameters, and each metric before and after."""

from __future__ import annotations

import functools

from tsmblocks.common import displayed_units
from tsmblocks.common.views import no_view
from tsmblocks.html.card import card, listed, rows, table_number
from tsmblocks.metrics.metrics import named
from tsmblocks.tuning.result import Tuned

view = functools.singledispatch(no_view)


@view.register
def tuned_card(tuned: Tuned) -> str:
    """The result of a tuning: the parameters, and each metric in each case before and after."""
    at, parameters = tuned.at_bounds, []
    for name, value in tuned.values.items():
        numbers = map(table_number, (tuned.own[name], value, *tuned.bounds[name]))
        parameters.append((name, *numbers, f"at its {at[name]} bound" if name in at else ""))
    display = {name: displayed_units.display_unit(unit) for name, unit in tuned.units.items()}
    cells = [
        (case, tuned.title(name), table_number(k * tuned.before[case][name]), table_number(k * after[name]))
        for case, after in tuned.after.items()
        for name, (k, _) in display.items()
    ]
    k, unit = display[tuned.objective]
    first, last = (table_number(k * v) for v in tuned.worst)
    return card(
        "Tuned",
        f"{named(tuned.objective)[0]} in the worst case: {first} before, {last} {unit} tuned",
        rows(["l:parameter", "before", "tuned", "from", "to", "l:remark"], parameters, "Parameters"),
        rows(["l:case", "l:metric", "before", "tuned"], cells, "Metrics in each case"),
        listed(tuned.remarks),
    )
