"""The details of a diagnosis, as text: noise floors, candidates, parameters, detectable sizes, a script."""

from __future__ import annotations

import functools

from tsmblocks.common.tables import columns
from tsmblocks.common.views import no_view
from tsmblocks.data.noise_floor import CONTENT
from tsmblocks.diagnosis.candidate_tables import candidate_tables
from tsmblocks.diagnosis.detectable_sizes import limits_texts
from tsmblocks.diagnosis.lines import filled, of_segment
from tsmblocks.diagnosis.presentation import block_title, floor_methods, floor_rows, floor_sentence, with_interval
from tsmblocks.diagnosis.result import Diagnosis
from tsmblocks.diagnosis.script import script_lines
from tsmblocks.diagnosis.segment import Gap, NamedEffect, Segment
from tsmblocks.diagnosis.text import MAX_EXPERIMENTS, errors_table
from tsmblocks.fitting.text import estimate_rows


def details_text(diagnosis: Diagnosis) -> str:
    """What a summary leaves out."""
    several = len(diagnosis.segments) > 1
    parts = list[str]()
    for segment in diagnosis.segments:
        parts += [f"== {segment.name} =="] if several else []
        for gap in segment.gaps:
            parts += [errors_table(segment, gap)] if len(gap.experiments) > MAX_EXPERIMENTS else []
            parts += _floor(gap)
        parts += candidate_tables(segment)
    parts += [_block_parameters(effect) for effect in diagnosis.effects if effect.sizes]
    for segment in diagnosis.segments:
        parts += _parameters(segment, several)
        parts += limits_texts(segment, several) if segment.verdict != "none" else []
    parts += _script(diagnosis)
    if diagnosis.no_consequence:
        parts.append(filled(f"Consequence for control: {diagnosis.no_consequence}"))
    return "\n\n".join(parts)


def _floor(gap: Gap) -> list[str]:
    """Where a noise floor comes from, and what each recording alone shows."""
    if gap.given or gap.method not in CONTENT:
        return []
    rows, methods = floor_rows(gap), "; ".join(floor_methods(gap))
    table = [columns(rows, left=(0, 4))] if rows else []
    return ["\n".join([filled(floor_sentence(gap)), *table, *([filled(f"{methods}.")] if methods else [])])]


def _block_parameters(effect: NamedEffect) -> str:
    """The parameters of the block of an effect, from which its sizes follow."""
    rows = [[name, with_interval(q)] for name, q in effect.parameters.items()]
    return f"{block_title(effect)}, parameters of its block:\n{columns(rows, '  ', left=(0, 1))}"


def parameter_rows(segment: Segment) -> list[tuple[str, ...]]:
    """The diagram's own parameters in the last model, with intervals, the heading first; without initial states."""
    if segment.fit is None:
        return []
    added = tuple(f"{e.block}." for e in segment.effects)
    own = [e for e in segment.fit if not e.is_start and not e.name.startswith(added or "\0")]
    return estimate_rows(segment.fit, own) if own else []


def _parameters(segment: Segment, several: bool) -> list[str]:
    rows, title = parameter_rows(segment), f"fitted parameters of the diagram{of_segment(segment, several)}"
    return [f"{title}:\n{columns(rows, left=(0, 4, 6))}"] if rows else []


def initial_states_text(diagnosis: Diagnosis) -> str:
    """How the estimated initial states are used; empty where there are none."""
    if not any(diagnosis.start_states.values()):
        return ""
    return (
        "The errors reported are those of simulations from initial states estimated for each experiment: "
        "found.start_states, and start_states in diagnosis.json; found.diagrams has a diagram for each."
    )


def _script(diagnosis: Diagnosis) -> list[str]:
    if not diagnosis.effects:
        return []
    lines = ["in a script:", *(f"  {line}".rstrip() for line in script_lines(diagnosis))]
    return [*filter(None, [filled(initial_states_text(diagnosis))]), "\n".join(lines)]


view = functools.singledispatch(no_view)
view.register(Diagnosis, details_text)
