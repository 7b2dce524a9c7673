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
from tsmblocks.files.shipped import shipped_folder
from tsmblocks.model.block import Block
from tsmblocks.model.diagram import Diagram, Inlet

MAX_INLINE_EXPERIMENTS = 12
"""Experiments (or pieces) whose initial states are written out; more are read from diagnosis.json. Chosen: a page."""


def script_lines(diagnosis: Diagnosis) -> list[str]:
    """The lines that make the augmented diagram and score it; in a script they give the same values.

    They use ``recordings``, a mapping from experiments to records.
    """
    making = [*_loaded(diagnosis), *_parameters(diagnosis), *_inserted(diagnosis)]
    return [*_imports(diagnosis), "", *making, *_scored(diagnosis)]


# ---- the diagram ---------------------------------------------------------------------------------


def _imports(diagnosis: Diagnosis) -> Iterator[str]:
    many = diagnosis.simulated is not None and _too_many(diagnosis.simulated)
    yield from [] if not many else ["import json", "from pathlib import Path", ""]
    yield "import tsmblocks as tsm"
    used = [diagnosis.augmented.blocks[e.block] for e in diagnosis.effects]
    kinds = {kind for one in used for kind in _kinds(one)}
    kinds |= {Bias for e in diagnosis.effects if "Bias()" in e.code}
    own = sorted(k.__name__ for k in kinds if getattr(blocks, k.__name__, None) is k)
    if own:
        yield f"from tsmblocks.blocks import {', '.join(own)}"
    for kind in sorted(kinds, key=lambda k: k.__name__):
        if kind.__name__ not in own:
            yield f"from {kind.__module__} import {kind.__name__}"


def _kinds(block: Block | Diagram) -> Iterator[type]:
    if not isinstance(block, Diagram):
        yield type(block)
        return
    for inner in block.blocks.values():
        yield from _kinds(inner)


def diagram_source(diagram: Diagram) -> str:
    """The argument of ``tsm.load`` for this diagram; empty for one made in memory."""
    path = Path(diagram.where)
    if path.suffix != ".toml":
        return ""
    return path.stem if path.parent == shipped_folder() else diagram.where


def _loaded(diagnosis: Diagnosis) -> Iterator[str]:
    name = diagram_source(diagnosis.first)
    yield f"diagram = tsm.load({name!r})" if name else "# diagram: the one that was diagnosed"


def _parameters(diagnosis: Diagnosis) -> list[str]:
    """Parameters of the diagram that were refitted."""
    before, after = diagnosis.first.parameters, diagnosis.augmented.parameters
    changed = {name: after[name] for name, value in before.items() if after.get(name, value) != value}
    return [] if not changed else ["diagram = diagram.with_parameters({", *_items(changed), "})"]


def _items(given: Mapping[str, Any]) -> Iterator[str]:
    yield from (f"    {name!r}: {literal(value)}," for name, value in given.items())


def _inserted(diagnosis: Diagnosis) -> Iterator[str]:
    for effect in diagnosis.effects:
        block = literal(diagnosis.augmented.blocks[effect.block])
        yield f"diagram = {effect.code.replace('…', block, 1)}"
    if diagnosis.augmented.title != diagnosis.first.title:
        yield f"diagram = diagram.rewire(title={diagnosis.augmented.title!r})"


def literal(value: Any) -> str:
    """A value as Python code with all digits: numbers, texts, lists, blocks and diagrams of them."""
    if isinstance(value, Diagram):
        inside = ", ".join(f"{k!r}: {literal(b)}" for k, b in value.blocks.items())
        more = f", values={literal(dict(value.values))}" if value.values else ""
        more += f", source={value.source!r}" if value.source else ""
        return (
            f"tsm.Diagram(title={value.title!r}, blocks={{{inside}}}, wires={[str(x) for x in value.links]!r}, "
            f"inputs={literal(dict(value.inputs))}, outputs={literal(dict(value.outputs))}{more})"
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
    """The lines that reproduce the errors of each experiment, where the diagram was simulated as a whole."""
    how = diagnosis.simulated
    if how is None:
        return
    yield ""
    if len(diagnosis.segments) > 1:
        yield "# the errors reported are those of each part, simulated from the signals measured in front of it"
        yield from _initial_states(how)
        return
    yield "# recordings: the diagnosed records by experiment, as tsm.read returns them"
    yield from _initial_states(how)
    if how.pieces:
        yield from (
            ["pieces = saved['simulated']['pieces']"] if _too_many(how) else ["pieces = {", *_items(how.pieces), "}"]
        )
        yield "for name, (begin, first, end) in pieces.items():"
        ready, cut = "recordings[name.rpartition('#')[0]]", ".part(begin, end)"
    else:
        yield "for name, record in recordings.items():"
        ready, cut = "record", ""
    quiet = f".conditioned({list(how.conditioned)!r})" if how.conditioned else ""
    yield f"    made = {ready}{quiet}{cut}"
    yield f"    print(tsm.score(diagram, {{name: made}}, {', '.join(_arguments(diagnosis, how))}))"


def _initial_states(how: Simulated) -> Iterator[str]:
    if _too_many(how):
        yield "saved = json.loads(Path('diagnosis.json').read_text(encoding='utf-8'))"
        yield "start_states = saved['start_states']"
        return
    yield "start_states = {"
    yield from _items(how.start_states)
    yield "}"


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
    one = set(how.steps.values())
    yield f"step={one.pop()!r}" if len(one) == 1 else f"step={literal(dict(how.steps))}[name]"
    yield from [] if how.integrator == "rk4" else [f"integrator={how.integrator!r}"]
    yield f"hold={how.hold!r}"
