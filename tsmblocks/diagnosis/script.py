"""A diagnosis as lines of a script that make the augmented diagram and reproduce its errors."""

from __future__ import annotations

from collections.abc import Iterator, Mapping
from pathlib import Path
from typing import Any

import attrs

from tsmblocks import blocks
from tsmblocks.blocks import Bias
from tsmblocks.diagnosis.result import Diagnosis
from tsmblocks.diagnosis.settings import Simulated
from tsmblocks.effects.effect import parameters_of
from tsmblocks.files import load
from tsmblocks.files.shipped import shipped_folder
from tsmblocks.model.block import Block
from tsmblocks.model.diagram import Diagram, Inlet
from tsmblocks.model.wires import chains

MAX_INLINE_EXPERIMENTS = 12
"""Experiments (or pieces) whose initial states are written out; more are read from diagnosis.json. Chosen: a page."""
STEP_DIGITS = 10
"""Significant digits of a step. Chosen: a recording has fewer samples than that, so no instant moves by a sample."""


def script_lines(diagnosis: Diagnosis) -> list[str]:
    """The lines that make the augmented diagram and score it; in a script they give the same values.

    They use ``recordings``, a mapping from experiments to records.
    """
    return [*_imports(diagnosis), "", *_diagram(diagnosis), *_scored(diagnosis)]


# ---- the diagram ---------------------------------------------------------------------------------


def _imports(diagnosis: Diagnosis) -> Iterator[str]:
    if diagnosis.simulated is not None and _too_many(diagnosis.simulated):
        yield from ("import json", "from pathlib import Path", "")
    yield "import tsmblocks as tsm"
    kinds = {kind for e in diagnosis.effects for kind in _kinds(diagnosis.augmented.blocks[e.block])}
    kinds |= {kind for k in _with_initial_values(diagnosis) for kind in _kinds(diagnosis.base.blocks[k])}
    kinds |= {Bias for e in diagnosis.effects if "Bias()" in e.code}
    shipped = sorted(k.__name__ for k in kinds if getattr(blocks, k.__name__, None) is k)
    if shipped:
        yield f"from tsmblocks.blocks import {', '.join(shipped)}"
    for kind in sorted(kinds, key=lambda k: k.__name__):
        if kind.__name__ not in shipped:
            yield f"from {kind.__module__} import {kind.__name__}"


def _kinds(block: Block | Diagram) -> set[type]:
    if not isinstance(block, Diagram):
        return {type(block)}
    return {kind for inner in block.blocks.values() for kind in _kinds(inner)}


def diagram_source(diagram: Diagram) -> str:
    """The argument of ``tsm.load`` for this diagram; empty for one made in memory."""
    path = Path(diagram.where)
    if path.suffix != ".toml":
        return ""
    return path.stem if path.parent == shipped_folder() else diagram.where


def _diagram(diagnosis: Diagnosis) -> Iterator[str]:
    """The diagram, its refitted parameters, and the blocks added to it."""
    first, augmented = diagnosis.first, diagnosis.augmented
    name = diagram_source(first)
    yield f"diagram = tsm.load({name!r})" if name else "# diagram: the one that was diagnosed"
    for key in _with_initial_values(diagnosis):
        yield f"diagram = diagram.replace({key!r}, {literal(diagnosis.base.blocks[key])})"
    given, after = (load(name) if name else first).parameters, augmented.parameters
    before = {k: given.get(k, v) for k, v in diagnosis.base.parameters.items()}
    changed = {name: after[name] for name, value in before.items() if after.get(name, value) != value}
    if changed:
        yield from ("diagram = diagram.with_parameters({", *_items(changed), "})")
    for effect in diagnosis.effects:
        yield f"diagram = {effect.code.replace('…', literal(augmented.blocks[effect.block]), 1)}"
    if augmented.title != first.title:
        yield f"diagram = diagram.rewire(title={augmented.title!r})"


def _with_initial_values(diagnosis: Diagnosis) -> list[str]:
    """The blocks that hold lists of initial values, which were empty in the diagram that was diagnosed."""
    first, base = diagnosis.first, diagnosis.base
    had = set(first.parameters)
    return [k for k, block in base.blocks.items() if any(f"{k}.{p}" not in had for p in parameters_of(block))]


def _items(given: Mapping[str, Any]) -> Iterator[str]:
    yield from (f"    {name!r}: {literal(value)}," for name, value in given.items())


def literal(value: Any) -> str:
    """A value as Python code with all digits: numbers, texts, lists, blocks and diagrams of them."""
    if isinstance(value, Diagram):
        more = f", values={literal(value.values)}" if value.values else ""
        more += f", output_units={literal(dict(value.output_units))}" if value.output_units else ""
        more += f", source={value.source!r}" if value.source else ""
        return (
            f"tsm.Diagram(title={value.title!r}, blocks={literal(value.blocks)}, "
            f"wires={[str(x) for x in value.links]!r}, inputs={literal(value.inputs)}, "
            f"outputs={literal(value.outputs)}{more})"
        )
    if isinstance(value, Inlet):
        return f"tsm.Inlet({', '.join(literal(getattr(value, a.name)) for a in attrs.fields(Inlet))})"
    if isinstance(value, Block):
        defaults = {f.name: f.default for f in attrs.fields(type(value))}  # type: ignore[arg-type]
        own = {k: getattr(value, k) for k in value.fields()}
        shown = [f"{k}={literal(v)}" for k, v in own.items() if k not in defaults or defaults[k] != v]
        return f"{type(value).__name__}({', '.join(shown)})"
    if isinstance(value, Mapping):
        return f"{{{', '.join(f'{k!r}: {literal(v)}' for k, v in value.items())}}}"
    if isinstance(value, (tuple, list)):
        return f"({', '.join(map(literal, value))}{',' if len(value) == 1 else ''})"
    if isinstance(value, float) and value - value != 0:
        return f"float('{value}')"
    return repr(value)


# ---- its errors ----------------------------------------------------------------------------------


def _scored(diagnosis: Diagnosis) -> Iterator[str]:
    """The lines that reproduce the errors of each experiment; of several parts, part by part."""
    how = diagnosis.simulated
    if how is None:
        return
    yield from ("", "# recordings: the diagnosed records by experiment, as tsm.read returns them")
    if _too_many(how):
        yield "saved = json.loads(Path('diagnosis.json').read_text(encoding='utf-8'))"
    if len(diagnosis.segments) == 1:
        yield from _scores(diagnosis, how, "diagram", "saved")
        return
    yield "# each part is simulated from the signals measured in front of it"
    for k, segment in enumerate(diagnosis.segments):
        if segment.augmented is not None and segment.simulated is not None:
            yield from ("", f"# {segment.name}", *_part(segment.augmented))
            yield from _scores(diagnosis, segment.simulated, "part", f"saved['segments'][{k}]")


def _part(diagram: Diagram) -> Iterator[str]:
    """The lines that cut a part of the augmented diagram out of it."""
    yield "part = tsm.Diagram("
    yield f"    blocks={{name: diagram.blocks[name] for name in {literal(list(diagram.blocks))}}},"
    yield f"    wires={chains(diagram.links, diagram.blocks)!r},"
    yield f"    inputs={literal(diagram.inputs)},"
    yield f"    outputs={literal(diagram.outputs)},"
    yield from ["    values=diagram.values,"] if diagram.values else []
    yield from [f"    output_units={literal(diagram.output_units)},"] if diagram.output_units else []
    yield ")"


def _scores(diagnosis: Diagnosis, how: Simulated, model: str, saved: str) -> Iterator[str]:
    """The lines that score a diagram, the variable ``model``; ``saved`` is where the file has what is too long."""
    if _too_many(how):
        yield f"start_states = {saved}['start_states']"
    else:
        yield from ("start_states = {", *_items(how.start_states), "}")
    quiet = f".conditioned({list(how.conditioned)!r})" if how.conditioned else ""
    if how.pieces and _too_many(how):
        yield f"pieces = {saved}['simulated']['pieces']"
    elif how.pieces:
        yield from ("pieces = {", *_items(how.pieces), "}")
    if how.pieces:
        yield "for name, (begin, first, end) in pieces.items():"
        yield f"    made = recordings[name.rpartition('#')[0]]{quiet}.part(begin, end)"
    else:
        yield "for name, record in recordings.items():"
        yield f"    made = record{quiet}"
    yield f"    print(tsm.score({model}, {{name: made}}, {', '.join(_arguments(diagnosis, how))}))"


def _short(step: float) -> float:
    """A step [s] without the rounding of the time stamps it was found from: 0.008 for 0.00799999999999912."""
    return float(f"{step:.{STEP_DIGITS}g}")


def _too_many(how: Simulated) -> bool:
    """Whether there are too many initial states and pieces to write out."""
    return len(how.start_states) > MAX_INLINE_EXPERIMENTS


def _arguments(diagnosis: Diagnosis, how: Simulated) -> Iterator[str]:
    yield "parameters=start_states[name]"
    yield f"outputs={list(how.outputs)!r}"
    if how.pieces:
        yield "window=(first, None)"
    elif diagnosis.windows:
        yield f"window={literal(dict(diagnosis.windows))}.get(name)"
    steps = {name: _short(step) for name, step in how.steps.items()}
    one = set(steps.values())
    yield f"step={one.pop()!r}" if len(one) == 1 else f"step={literal(steps)}[name]"
    yield from [] if how.integrator == "rk4" else [f"integrator={how.integrator!r}"]
    yield f"hold={how.hold!r}"
