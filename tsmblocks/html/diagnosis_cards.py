"""The card of a diagnosis: verdict, reported effects, and errors before and after; the report has the rest."""

from __future__ import annotations

import functools

from tsmblocks.common.tables import few
from tsmblocks.common.views import no_view
from tsmblocks.diagnosis.next_steps import next_steps
from tsmblocks.diagnosis.presentation import absence_text, size_rows, with_interval
from tsmblocks.diagnosis.result import Diagnosis
from tsmblocks.diagnosis.text import STATUS
from tsmblocks.diagnosis.verdict_text import alternatives, percent, segments_by_verdict, verdict_sentence, verdict_word
from tsmblocks.html.card import MOST_CHARTS, card, listed, table_of
from tsmblocks.html.figures import gap_bars
from tsmblocks.html.pages import part
from tsmblocks.html.report import model_colours

view = functools.singledispatch(no_view)


@view.register
def diagnosis_card(diagnosis: Diagnosis) -> str:
    """A diagnosis: verdict, effects with their parameters, errors before and after; ``save`` writes the report."""
    boxes = [
        part("verdict", s.verdict, verdict_word(s), verdict_sentence(s)) + part("bullets", next_steps(s), "Next:")
        for s in segments_by_verdict(diagnosis)
    ]
    table = [("effect", "insertion point", "size", "removes", "indistinguishable from")]
    for e in diagnosis.effects:
        texts = size_rows(e) or [(name, with_interval(q)) for name, q in e.parameters.items()]
        sizes = "; ".join([*(f"{name} {text}" for name, text in texts), *filter(None, [absence_text(e)])])
        table.append((e.name, e.wire.strip(), sizes, percent(e.share_removed), ", ".join(alternatives(e))))
    gaps = [gap_bars(s, g) for s in diagnosis.segments for g in s.gaps][:MOST_CHARTS]
    colours = [*model_colours(diagnosis.segments), ("ink", "on the data it was fitted to", "hollow")]
    stopped = "" if diagnosis.status == "done" else f"; {STATUS.get(diagnosis.status, diagnosis.status)}"
    count = len(diagnosis.experiments)
    about = f"{count} experiment{'s' if count > 1 else ''}: {few(diagnosis.experiments)}{stopped}"
    return card(
        f"Diagnosis: {diagnosis.diagram or 'diagram'}",
        about,
        *boxes,
        table_of(table, {0, 1, 2, 4}, "Effects that the model lacks") if diagnosis.effects else "",
        part("key", colours),
        part("charts", gaps),
        listed(["diagnosis.save(folder) writes the whole report."]),
    )
