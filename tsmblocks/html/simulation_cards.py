"""Cards of runs: one run, and a batch of them."""

from __future__ import annotations

import functools

from tsmblocks.common.tables import few
from tsmblocks.common.views import no_view
from tsmblocks.html.card import MOST_ROWS, card, listed, over_time_and_ranges, rows, table_number
from tsmblocks.simulation.batch_result import Batch
from tsmblocks.simulation.run import Run

view = functools.singledispatch(no_view)


@view.register
def run_card(run: Run) -> str:
    """A run: its outputs over time, and their ranges."""
    names = list(run.aliases) or run.keys()[:MOST_ROWS]
    span = f"{run.t[0]:g} to {run.t[-1]:g} s" if len(run.t) else "no instant"
    about = f"{span} in steps of {run.step:g} s ({run.method}), {len(run.t)} instants"
    others = [name for name in run if name not in names]
    more = [f"Other signals: {few(others)}."] if others else []
    more += [] if run.complete else ["The run was stopped before its end."]
    more += [f"{len(run.events)} switching instants were located."] if run.events else []
    signals = {name: (run[name], run.unit(name)) for name in names}
    return card(run.title or "Run", about, *over_time_and_ranges(run.t, signals, "of the run over time"), listed(more))


@view.register
def batch_card(batch: Batch) -> str:
    """A batch: sets of parameters, and the results that are numbers."""
    count = len(next(iter(batch.parameters.values())))
    single = {k: v for k, v in batch.results.items() if v.ndim == 1}
    columns = {**batch.parameters, **single}
    cells = [[str(k), *(table_number(float(v[k])) for v in columns.values())] for k in range(min(count, MOST_ROWS))]
    signals = [f"{name} {v.shape}" for name, v in batch.results.items() if v.ndim > 1]
    failed = int(batch.failed.sum())
    notes = [f"Signals: {few(signals)}."] if signals else []
    notes += [f"{failed} sets have results that are not finite."] if failed else []
    return card(
        f"Batch of {count} runs",
        "",
        rows(["set", *columns], cells, "Sets of parameters and results", count=count),
        listed(notes),
    )
