"""The result of a diagnosis, put together from its parts: diagrams, verdict, control consequence, provenance."""

from __future__ import annotations

import math
from collections.abc import Callable, Sequence

import attrs

from tsmblocks.common.interpolation import Hold
from tsmblocks.common.tables import listed
from tsmblocks.common.version import __version__
from tsmblocks.diagnosis.arguments import Request
from tsmblocks.diagnosis.consequence import consequence
from tsmblocks.diagnosis.diagnosed_part import DiagnosedPart
from tsmblocks.diagnosis.model import Model
from tsmblocks.diagnosis.partition import experiment_of, in_whole_diagram
from tsmblocks.diagnosis.presentation import in_display_units
from tsmblocks.diagnosis.quantities import recorded_units
from tsmblocks.diagnosis.result import Diagnosis
from tsmblocks.diagnosis.script import diagram_source
from tsmblocks.diagnosis.segment import Consequence, Segment
from tsmblocks.diagnosis.settings import Provenance, Simulated, recorded
from tsmblocks.diagnosis.summary import segment_summary
from tsmblocks.fitting.holds import common_holds, hold_text, in_one_word
from tsmblocks.fitting.parameters import with_initial_values
from tsmblocks.fitting.setup import one_where_equal
from tsmblocks.model.diagram import Diagram
from tsmblocks.model.simulation import Simulation

VERDICT_RANK = {"named": 2, "unknown": 1, "none": 0}
"""Verdicts by what they say: that of the whole diagram is the highest of its segments."""


def assembled(request: Request, parts: Sequence[DiagnosedPart], notes: Sequence[str], status: str) -> Diagnosis:
    """The diagnosis of the whole diagram from those of its parts; ``status`` is how the search ended."""
    diagram = with_initial_values(request.diagram) if request.settings.start_states else request.diagram
    segments = tuple(
        attrs.evolve(
            segment_summary(diagnosed, diagram),
            augmented=diagnosed.final.fitted_diagram,
            simulated=_simulated(request, [diagnosed]),
        )
        for diagnosed in parts
    )
    verdict = max((s.verdict for s in segments), key=lambda v: VERDICT_RANK[v])
    sentences = [s.sentence for s in segments if s.verdict == verdict]
    if status != "done":
        sentences.insert(0, "Provisional, since the search was stopped before its end:")
    control = _consequence(parts, segments)
    return Diagnosis(
        diagram.title,
        tuple(request.records),
        request.settings.seed,
        verdict,
        " ".join(sentences),
        tuple(e for s in segments for e in s.effects),
        segments,
        _whole_diagram(diagram, parts, with_effects=False),
        _whole_diagram(diagram, parts, with_effects=True),
        None if isinstance(control, str) else control,
        tuple(dict.fromkeys(notes)),
        status,
        request.spans,
        given=request.diagram,
        simulated=_simulated(request, parts),
        provenance=Provenance(
            __version__,
            diagram_source(request.diagram),
            recorded(request.records, [*diagram.inputs, *diagram.outputs]),
            _options(request, parts),
        ),
        no_consequence=control if isinstance(control, str) else "",
    )


def _whole_diagram(diagram: Diagram, parts: Sequence[DiagnosedPart], *, with_effects: bool) -> Diagram:
    """The whole diagram with the fitted parameters, and with the blocks of the named effects."""
    result = diagram
    for diagnosed in parts:
        last = diagnosed.models[-1 if with_effects else 0]
        for one in diagnosed.named if with_effects else ():
            c = one.candidate
            result = in_whole_diagram(c.point, diagnosed.part).put(result, c.block, last.fitted_diagram.blocks[c.block])
        own = last.parameters()
        result = result.untied(own).with_parameters(own)
    result = _with_simulation(result, parts, [one.models[-1 if with_effects else 0] for one in parts])
    named = [one.candidate.block for diagnosed in parts for one in diagnosed.named] if with_effects else []
    return result.rewire(title=f"{diagram.title}, with {listed(named, 3)}".lstrip(", ")) if named else result


def _with_simulation(diagram: Diagram, parts: Sequence[DiagnosedPart], models: Sequence[Model]) -> Diagram:
    """The diagram with the settings of its simulation, so that a run on the recordings reproduces their errors.

    Its own initial states are those of the first recording. A simulation that restarted within a recording is known by
    the states of the first piece. The step is the finest of its parts: at a coarser one, a part may diverge.
    """
    starts, steps = _starts_and_steps(models, experiment_of)
    first, hold = models[0].setup.experiments[0], _hold(parts)
    simulation = Simulation(
        step=one_where_equal(steps),
        method=first.rule.name,
        hold=hold if isinstance(hold, str) else {k: v for k, v in hold.items() if k in diagram.inputs},
        condition=tuple(k for k in diagram.inputs if any(k in one.filtered for one in parts)),
        start={name: own for name, own in starts.items() if own},
    )
    return diagram.with_parameters(next(iter(starts.values()), {})).with_simulation(simulation)


def _consequence(parts: Sequence[DiagnosedPart], segments: Sequence[Segment]) -> Consequence | str:
    """The consequence of the effects for control, for the last part with effects; a sentence if not simulated."""
    last = next((one for one, segment in zip(parts[::-1], segments[::-1], strict=True) if segment.effects), None)
    return "" if last is None else consequence(last.models[0], last.models[-1])


def _starts_and_steps(
    models: Sequence[Model], called: Callable[[str], str] = str
) -> tuple[dict[str, dict[str, float]], dict[str, float]]:
    """Parameters and initial states of the models by experiment, and its finest step [s], by what it is called.

    Of pieces that are called alike, those of the first one.
    """
    starts, steps = dict[str, dict[str, float]](), dict[str, float]()
    for model in models:
        for experiment in model.setup.experiments:
            name = called(experiment.name)
            starts[name] = {**model.parameters(experiment.name), **starts.get(name, {})}
            steps[name] = min(steps.get(name, math.inf), experiment.times.h)
    return starts, steps


def _simulated(request: Request, parts: Sequence[DiagnosedPart]) -> Simulated:
    """How the last models of parts were simulated: the finest steps, and the fitted initial states of all of them."""
    pieces = dict[str, tuple[float, float, float]]()
    for experiment in (one for diagnosed in parts for one in diagnosed.final.setup.experiments):
        if experiment_of(experiment.name) != experiment.name:
            t = experiment.record.t
            pieces[experiment.name] = (float(t[0]), float(experiment.t[0]), float(t[-1]))
    inputs = dict.fromkeys(k for diagnosed in parts for k in diagnosed.filtered)
    return Simulated(
        *_starts_and_steps([diagnosed.final for diagnosed in parts]),
        tuple(k for diagnosed in parts for k in diagnosed.part.outputs),
        tuple(inputs),
        request.settings.integrator,
        _hold(parts),
        pieces,
    )


def _hold(parts: Sequence[DiagnosedPart]) -> Hold:
    """Interpolation of inputs between samples, for all or by input."""
    experiments = [(one.record, one.hold) for diagnosed in parts for one in diagnosed.final.setup.experiments]
    return in_one_word(common_holds(experiments))


def _inputs_text(parts: Sequence[DiagnosedPart]) -> str:
    """How the noise of inputs was dealt with, in words."""
    exact = [k for one in parts for k in one.part.diagram.inputs if k not in one.filtered]
    if not any(one.filtered for one in parts):
        return "as recorded"
    return f"noise filtered out (zero phase){f', {listed(exact)} as recorded' if exact else ''}"


def _options(request: Request, parts: Sequence[DiagnosedPart]) -> dict[str, str]:
    """The options of the diagnosis, in words."""
    settings = request.settings
    steps = sorted({experiment.times.h for diagnosed in parts for experiment in diagnosed.final.setup.experiments})
    floors = [
        f"{k} {one.floors.given.get(k) or in_display_units(v, units[k])} ({one.floors.method[k]})"
        for one, units in ((one, recorded_units(one.final.setup)) for one in parts)
        for k, v in one.floors.sigma.items()
    ]
    return {
        "noise floor": ", ".join(floors),
        "effects": "all of the catalogue" if request.patterns is None else ", ".join(request.patterns),
        "free": "all but initial states" if settings.free is None else ", ".join(settings.free),
        **({"bounds": ", ".join(map(str, settings.bounds))} if settings.bounds else {}),
        **({"local": ", ".join(settings.local)} if settings.local else {}),
        "start states": "estimated for each experiment" if settings.start_states else "as in the diagram",
        "inputs": _inputs_text(parts),
        "step": f"{' to '.join(f'{h:.4g}' for h in (steps[:1] + steps[1:][-1:]))} s"
        f" ({'given' if settings.step is not None else 'chosen'})",
        "integrator": settings.integrator,
        "hold": hold_text(_hold(parts)),
        "seed": str(settings.seed),
    }
