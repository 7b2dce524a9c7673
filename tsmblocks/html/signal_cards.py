"""Cards of signals over time: runs, recordings, responses, batches."""

from __future__ import annotations

from collections.abc import Mapping
from html import escape

import numpy as np

from tsmblocks.common import units
from tsmblocks.common.tables import few
from tsmblocks.data import Record, heading
from tsmblocks.html import charts
from tsmblocks.html.card import LEFT, MOST_ROWS, RIGHT, card, ends, listed, number, over_time, rows
from tsmblocks.html.charts import Frame
from tsmblocks.html.document import key
from tsmblocks.simulation.batch import Batch
from tsmblocks.simulation.run import Run
from tsmblocks.studies.responses import Responses

Signals = Mapping[str, tuple[np.ndarray, str]]
BANDS = ((0.05, 0.95), (0.25, 0.75))
"""Shares of the runs in the bands of an envelope."""
INSTANTS = 200
"""Instants at which an envelope is drawn."""


def run_card(run: Run) -> str:
    """A run: its outputs over time, and what they range over."""
    names = list(run.aliases) or run.keys()[:MOST_ROWS]
    span = f"{run.t[0]:g} to {run.t[-1]:g} s" if len(run.t) else "no instant"
    about = f"{span} in steps of {run.step:g} s ({run.method}), {len(run.t)} instants"
    others = [name for name in run if name not in names]
    more = [f"Other signals: {few(others)}."] if others else []
    more += [] if run.complete else ["The run was stopped before its end."]
    more += [f"{len(run.events)} switching instants were located."] if run.events else []
    signals = {name: (run[name], run.unit(name)) for name in names}
    return card(run.title or "Run", about, *_shown(run.t, signals, "of the run over time"), listed(more))


def record_card(record: Record) -> str:
    """A recording: its signals over time, what they range over, and what was repaired."""
    span = f"{record.t[0]:g} to {record.t[-1]:g} s" if len(record) else "no sample"
    even = f"every {record.step:.4g} s" if len(record) > 1 else ""
    uneven = f", uneven by {100 * record.jitter:.2g} %" if even and not record.uniform else ""
    about = ", ".join(filter(None, [f"{len(record)} samples", span, even + uneven, record.origin]))
    signals = {name: (record[name], record.unit(name)) for name in record.names}
    return card(
        record.name or "Record",
        about,
        *_shown(record.t, signals, "as recorded over time"),
        listed(record.notes, "repaired"),
    )


def responses_card(found: Responses) -> str:
    """Responses of many runs: where each signal lies."""
    count = len(next(iter(found.signals.values()), ()))
    drawn = [_envelope(found, name) for name in list(found.signals)[:MOST_ROWS]]
    bands = key([("--c0", "median"), ("--band", "5 to 95 %, and 25 to 75 %")])
    return card(
        f"{found.title}: responses of {count} runs",
        f"{len(found.t)} instants",
        f'<div class="charts">{"".join(drawn)}</div>',
        bands,
    )


def batch_card(batch: Batch) -> str:
    """A batch: sets of parameters, and what came out where it is a number."""
    count = len(next(iter(batch.parameters.values())))
    single = {k: v for k, v in batch.results.items() if v.ndim == 1}
    columns = {**batch.parameters, **single}
    cells = [[str(k), *(number(float(v[k])) for v in columns.values())] for k in range(min(count, MOST_ROWS + 1))]
    signals = [f"{name} {v.shape}" for name, v in batch.results.items() if v.ndim > 1]
    failed = int(batch.failed.sum())
    said = [f"Signals: {few(signals)}."] if signals else []
    said += [f"{failed} sets have results that are not finite."] if failed else []
    shown = rows(["set", *columns], cells[:MOST_ROWS])
    more = f'<p class="soft">… ({count} in all)</p>' if count > MOST_ROWS else ""
    return card(f"Batch of {count} runs", "", shown, more, listed(said))


def _shown(t: np.ndarray, signals: Signals, words: str) -> tuple[str, str]:
    """Charts, and a table of ranges; angles in degrees."""
    cells = []
    for name, (values, unit) in signals.items():
        k, shown = units.for_people(unit)
        y = np.asarray(values, dtype=float)[np.isfinite(values)]
        figures = (y.min(), y.max(), values[-1]) if len(y) else (np.nan,) * 3
        size = float(np.abs(k * y).max(initial=0.0))
        cells.append([name, *(number(k * float(v), size) for v in figures), shown])
    return over_time(t, signals, words), rows(["l:signal", "min", "max", "last", "l:unit"], cells)


def _envelope(found: Responses, name: str) -> str:
    """Bands and median of one signal over time."""
    k, unit = units.for_people(found.unit(name))
    t, *every = charts.sampled(INSTANTS, found.t, *(k * found[name]))
    y = np.array(every)
    y = y[np.isfinite(y).all(axis=1)]
    if not len(y):
        return f"<p>{escape(name)}: no run is finite all along.</p>"
    frame = Frame(LEFT, 22, RIGHT, 120, ends(t), charts.spread(y))
    parts = [charts.axes(frame, "t [s]", heading(name, unit))]
    for shares in BANDS:
        low, high = np.quantile(y, shares, axis=0)
        parts.append(charts.area(frame, t, low, high, "band"))
    parts.append(charts.line(frame, t, np.median(y, axis=0), "c0"))
    return f"<div>{charts.chart(parts, 152, f'{name} of {len(y)} runs over time')}</div>"
