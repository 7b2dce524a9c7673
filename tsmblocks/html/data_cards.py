"""Cards of recordings."""

from __future__ import annotations

import functools

from tsmblocks.common.rounding import to_digits
from tsmblocks.common.views import no_view
from tsmblocks.data.record import Record
from tsmblocks.html.card import card, listed, over_time_and_ranges

view = functools.singledispatch(no_view)


@view.register
def record_card(record: Record) -> str:
    """A recording: its signals over time, their ranges, and the repairs."""
    span = f"{record.t[0]:g} to {record.t[-1]:g} s" if len(record) else "no sample"
    even = f"every {record.step:.4g} s" if len(record) > 1 else ""
    uneven = f", uneven by {to_digits(100 * record.jitter)} %" if even and not record.uniform else ""
    about = ", ".join(filter(None, [f"{len(record)} samples", span, even + uneven, record.origin]))
    signals = {name: (record[name], record.unit(name)) for name in record.names}
    return card(
        record.name or "Record",
        about,
        *over_time_and_ranges(record.t, signals, "as recorded over time"),
        listed(record.notes, "repaired"),
    )
