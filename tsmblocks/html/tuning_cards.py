"""Cards of tuning results: the parameters, and each metric before and after."""

from __future__ import annotations

import functools

from tsmblocks.common import units
from tsmblocks.common.views import no_view
from tsmblocks.html.card import card, listed, rows, table_number
from tsmblocks.metrics.metrics import named
from tsmblocks.tuning.result import Tuned

view = functools.singledispatch(no_view)


@view.register
def tuned_card(found: Tuned) -> str:
    """The result of a tuning: the parameters, and each metric in each case before and after."""
    at = found.at_bounds
    values = rows(
        ["l:parameter", "before", "tuned", "from", "to", "l:"],
        [
            (
                name,
                *map(table_number, (found.own[name], v, *found.bounds[name])),
                f"at its {at[name]} bound" if name in at else "",
            )
            for name, v in found.values.items()
        ],
    )
    people = {name: units.display_unit(unit) for name, unit in found.units.items()}
    cells = [
        (case, found.title(name), table_number(k * found.before[case][name]), table_number(k * after[name]))
        for case, after in found.after.items()
        for name, (k, _) in people.items()
    ]
    k, unit = people[found.objective]
    worst = f"{named(found.objective)[0]} in the worst case: {_ends([k * v for v in found.worst], unit)}"
    return card(
        "Tuned", worst, values, rows(["l:case", "l:metric", "before", "tuned"], cells), listed(list(found.remarks))
    )


def _ends(values: list[float], unit: str) -> str:
    before, after = values
    return f"{table_number(before)} before, {table_number(after)} {unit} tuned"
