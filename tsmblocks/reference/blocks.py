"""Pages of blocks, each written from the block itself: its declarations, its equations, its docstring, its example."""

from __future__ import annotations

import inspect
import math
from collections.abc import Iterable
from typing import Any

import numpy as np

from tsmblocks.common.units import heading
from tsmblocks.compiler.dependencies import Structure, structure_of
from tsmblocks.html.block_facts import by_family
from tsmblocks.model.block import Block, State, leaves
from tsmblocks.reference import examples, figures, rst, uses
from tsmblocks.reference.trace import LONGEST, Listing, listing, spaced

LETTERS = "A unit in italics, as *u*, is any unit, the same wherever the letter occurs."
ACROSS = ("limits", "friction", "hysteresis", "control", "loops", "transmission", "delays", "arithmetic", "sensors")
"""Families whose output is drawn over the input too, unless the input only jumps."""
LEVELS = 8
"""Distinct values up to which a signal is taken to jump between them."""
FAMILY_WORDS = {
    "sources": "Generated and recorded signals.",
    "arithmetic": "Operations on signals at one instant.",
    "linear": "Lags, integrators, delays and transfer functions in continuous time.",
    "limits": "Limits, dead zones, relays, rounding and tables.",
    "friction": "Forces that resist a motion, as functions of its rate and its history.",
    "hysteresis": "Transmissions with memory: the paper's models, play, and similar ones.",
    "control": "Controllers, and the paper's observer and compensator.",
    "motor": "Motors.",
    "discrete": "Blocks that act at multiples of a period and hold in between.",
    "sensors": "Errors of measurement: bias, quantisation, noise.",
    "delays": "Delays and lags that may be zero, for fits that estimate them.",
    "loops": "Hysteresis loops added to a signal; with their defaults they pass it on unchanged.",
    "transmission": "Deviations added to a signal; with their defaults they pass it on unchanged.",
    "hydraulics": "Vessels of liquids.",
}


def families() -> dict[str, dict[str, type[Block]]]:
    """The blocks of the toolbox by family; those of users stay out."""
    import tsmblocks.blocks as public_blocks
    from tsmblocks.model.block import REGISTRY

    return by_family({name: cls for name, cls in REGISTRY.items() if getattr(public_blocks, name, None) is cls})


def pages() -> dict[str, str]:
    """Every page by its path, the index among them."""
    found = families()
    made = {f"blocks/{name}": page(cls, list(some)) for some in found.values() for name, cls in some.items()}
    return {"blocks/index": _index(found), **made}


def _index(found: dict[str, dict[str, type[Block]]]) -> str:
    parts = [
        rst.heading("Blocks"),
        "Every block of the toolbox, by family. The page of a block is written from the "
        "block: its equations are those that are simulated, fitted, differentiated and exported. How to write "
        "one of your own: :doc:`/python/blocks`.",
    ]
    for family, some in found.items():
        rows = [
            (rst.link(f"/blocks/{name}", name), rst.plain(cls.symbol), rst.words(_sentence(cls)))
            for name, cls in some.items()
        ]
        parts += [
            rst.heading(family.capitalize(), 1),
            FAMILY_WORDS.get(family, ""),
            rst.table(("Block", "Drawn as", "What it is"), rows, (25, 17, 58)),
        ]
    return rst.page(*parts, rst.contents(sorted(name for some in found.values() for name in some)))


def _sentence(cls: type) -> str:
    return " ".join(inspect.cleandoc(cls.__doc__ or "").partition("\n\n")[0].split())


def page(cls: type[Block], family: list[str]) -> str:
    """The page of one block; ``family`` are the names of its kin."""
    block = cls()
    made = examples.example(cls)
    label = examples.snake(cls.__name__)
    shown = made.blocks[label]
    assert isinstance(shown, Block)
    return rst.page(
        rst.heading(cls.__name__),
        inspect.cleandoc(cls.__doc__ or ""),
        f":Source: {rst.plain(block.source)}\n:In Python: ``from tsmblocks.blocks import {cls.__name__}``\n"
        f':In a file: ``{{ type = "{cls.__name__}" }}``',
        rst.html(uses.linked_picture(made)),
        rst.html(_charts(cls)),
        _ports(block),
        _numbers(block, label),
        _states(shown),
        _behaviour(shown),
        _computed(shown, _validity(block, shown)),
        _shown(cls),
        _related(cls.__name__, family),
    )


# ---- tables ---------------------------------------------------------------------------------------


def unit(label: str) -> str:
    """A unit as a table shows it; a letter of the block's own in italics."""
    if label == "":
        return "any"
    return f"*{label.replace('?', '')}*" if "?" in label else rst.plain(label)


def _ports(block: Block) -> str:
    rows = []
    for name, port in block.inports.items():
        more = f"; formed exactly from ``{port.rate_of}`` where it is not connected" if port.rate_of else ""
        rows.append((rst.code(name), "input", unit(port.unit), rst.words(port.about) + more))
    for name, outlet in block.outports.items():
        rows.append((rst.code(name), "output", unit(outlet.unit), rst.words(outlet.about)))
    for name, tape in block.tape_ports.items():
        rows.append((rst.code(name), "made for a run", "", rst.words(tape.about)))
    for name, past in block.past_ports.items():
        rows.append((rst.code(name), "past", "", f"{rst.words(past.about)}: ``{past.of}``, ``{past.by}`` ago"))
    letters = LETTERS if any("?" in text for text in _units(block)) else ""
    return rst.page(
        rst.heading("Ports", 1), rst.table(("Port", "", "Unit", "Meaning"), rows, (16, 14, 14, 56)), letters
    )


def _units(block: Block) -> list[str]:
    return [p.unit for p in block.inports.values()] + [p.unit for p in block.outports.values()]


def _numbers(block: Block, label: str) -> str:
    fields = block.fields().items()
    rows = [
        (rst.code(k), default_text(getattr(block, k)), unit(f.unit) if f.unit else "", bounds(f), rst.words(f.about))
        for k, f in fields
        if f.kind == "parameter"
    ]
    options = [
        (rst.code(k), default_text(getattr(block, k)), unit(f.unit) if f.unit else "", bounds(f), rst.words(f.about))
        for k, f in fields
        if f.kind == "option"
    ]
    parts = []
    head = ("Name", "Default", "Unit", "Bounds", "Meaning")
    if rows:
        named = next(leaf for key, value in block.parameters.items() for leaf, _ in leaves(value, key))
        parts += [
            rst.heading("Parameters", 1),
            "They stay symbols until the run: they can be set, swept, fitted and "
            f"differentiated, each by its name, as ``{label}.{named}`` in the example below.",
            rst.table(head, rows, (16, 14, 10, 18, 42)),
        ]
    if options:
        parts += [
            rst.heading("Options", 1),
            "They shape the equations, and cannot be fitted.",
            rst.table(head, options, (16, 14, 10, 18, 42)),
        ]
    return rst.page(*parts)


def default_text(value: Any) -> str:
    """A default as a table shows it: six digits, the name ``""`` of an empty text."""
    if isinstance(value, tuple):
        return "[" + ", ".join(default_text(v) for v in value) + "]"
    if isinstance(value, float):
        return f"{value:.6g}" if math.isfinite(value) else ("∞" if value > 0 else "−∞")
    return f'``"{value}"``' if isinstance(value, str) else str(value).lower()


def bounds(field: Any) -> str:
    """The admissible values of a field."""
    if field.choices:
        return "one of " + ", ".join(f"``{c}``" for c in field.choices)
    made = field.bounds()
    return "" if made == "(-inf, inf)" else made.replace("-inf", "−∞").replace("inf", "∞")


def _states(block: Block) -> str:
    shape, states = structure_of(block), block.states
    if not states:
        return ""
    rows = [
        (rst.code(k), _kind(block, shape, k), _start(s), unit(s.unit) if s.unit else "", rst.words(s.about))
        for k, s in states.items()
    ]
    return rst.page(
        rst.heading("States", 1),
        rst.table(("State", "Kind", "Initial value", "Unit", "Meaning"), rows, (16, 20, 12, 10, 42)),
    )


def _start(state: State) -> str:
    """The initial value of a state, in words where it is a time long before all runs."""
    return "before the run" if isinstance(state.start, float) and state.start < -1e8 else default_text(state.start)


def _kind(block: Block, shape: Structure, name: str) -> str:
    if name in shape.resets:
        return "continuous, with resets"
    if name in shape.continuous:
        return "continuous"
    return "memory, set at each sample" if block.sampled else "memory, set at each step"


# ---- behaviour -----------------------------------------------------------------------------------


def _behaviour(block: Block) -> str:
    items = [_time(block), _feedthrough(block), _switches(listing(block)), _in_c(block)]
    return rst.page(rst.heading("Behaviour", 1), rst.listed(items))


def _time(block: Block) -> str:
    shape = structure_of(block)
    if block.sampled:
        return (
            "**Sampled**: it acts at multiples of its ``period`` and holds its outputs in between; see "
            ":doc:`/concepts/fixed_step`."
        )
    if shape.memory:
        return "**Time**: continuous, with memory that is set once at the start of each step."
    if shape.continuous:
        return "**Time**: continuous; its states are integrated by the method of the run."
    if block.past_ports:
        return "**Time**: continuous; it has no state, and reads its input at earlier instants of the run."
    return "**Time**: none; it has no state, and its output is a function of the same instant."


def _feedthrough(block: Block) -> str:
    passed = {key: past.of for key, past in block.past_ports.items() if past.now}  # a delay that may be none
    found = {
        name: [f"``{k}``" for k in block.inports if k in wanted | {passed.get(key, key) for key in wanted}]
        for name, wanted in structure_of(block).outputs.items()
    }
    if not block.inports:
        return "**Direct feedthrough**: none; it has no input."
    if not any(found.values()):
        return (
            "**Direct feedthrough** (read from the equations): none; no output depends on an input at the same "
            "instant, so it breaks algebraic loops."
        )
    parts = [f"``{name}`` depends on {' and '.join(inputs) or 'no input'}" for name, inputs in found.items()]
    return f"**Direct feedthrough** (read from the equations): at the same instant {', '.join(parts)}."


def _switches(made: Listing) -> str:
    if not made.switches:
        return "**Kinks and jumps**: none; its equations are smooth."
    if made.size > LONGEST or sum(map(len, made.switches)) > 700:
        return f"**Kinks and jumps**: {len(made.switches)} (see :doc:`/concepts/fixed_step`)."
    places = ", ".join(f":math:`{spaced(place)}`" for place in made.switches)
    letters = " (letters as in the equations below)" if made.shared else ""
    return f"**Kinks and jumps** (see :doc:`/concepts/fixed_step`) where {places}{letters}."


def _in_c(block: Block) -> str:
    if block.tape_ports:
        return "**Export to C**: not possible, since its signal is made for a whole run at once."
    return "**Export to C**: possible (``tsmblocks export``)."


def _validity(block: Block, shown: Block) -> str:
    """The options and lengths of lists for which the equations shown hold."""
    other = [k for k in block.options if getattr(block, k) != getattr(shown, k)]
    lists = [k for k, v in block.parameters.items() if isinstance(v, tuple)]
    if not block.options and not lists:
        return ""
    which = f" ({', '.join(f'``{k}`` = {default_text(getattr(shown, k))}' for k in other)})" if other else ""
    why = " and ".join(filter(None, ("options" if block.options else "", "lengths of lists" if lists else "")))
    return f" They are those of the block of the example{which}; other {why} give others."


def _computed(block: Block, apart: str) -> str:
    made = listing(block)
    if made.size > LONGEST:
        return ""
    lines = [*made.shared, *made.equations]
    text = "\\\\\n".join(f"{left} &= {spaced(right)}" for left, right in lines)
    rows = [
        "The equations that are simulated, fitted, differentiated and exported, written from the expressions. Names "
        "in upright letters are those of the tables above; a dot is a rate, a plus the value after the next "
        f"{'sample' if block.sampled else 'step'}.{apart}"
    ]
    return rst.page(rst.heading("As it is computed", 1), *rows, rst.formula(text))


# ---- the example ----------------------------------------------------------------------------------


def _charts(cls: type[Block]) -> str:
    run, made = examples.run(cls), examples.example(cls)
    names = list(made.outputs)
    labels = {k: heading(k, made.unit(k)) for k in names}
    signals = {k: run[k] for k in names}
    drawn = [figures.over_time(run.t, signals, labels)]
    driven = [k for k in cls().inports if k in names]
    first = next(iter(cls().outports), "")
    moves = len(driven) == 1 and len(np.unique(run[driven[0]])) > LEVELS
    if moves and first and _family(cls) in ACROSS:
        drawn.append(figures.over_another(run[driven[0]], run[first], (labels[driven[0]], labels[first])))
    return figures.side_by_side(drawn, names)


def _family(cls: type[Block]) -> str:
    from tsmblocks.html.block_facts import family

    return family(cls)


def _shown(cls: type[Block]) -> str:
    from tsmblocks.files import dumps

    made = examples.example(cls)
    return rst.page(
        rst.heading("Example", 1),
        "The diagram at the top of this page, as a script and as a file.",
        rst.block(examples.script(made, examples.stop_of(cls)), "python"),
        rst.block(dumps(made), "toml"),
    )


def _related(name: str, family: Iterable[str]) -> str:
    kin = ", ".join(rst.link(f"/blocks/{k}", k) for k in family if k != name)
    diagrams = ", ".join(rst.link(f"/diagrams/{k}", k) for k in uses.diagrams_with(name))
    effects = ", ".join(rst.link(f"/effects/{k}", k) for k in uses.effects_with(name))
    items = [
        f"In the diagrams {diagrams}." if diagrams else "",
        f"In the effects {effects}." if effects else "",
        f"Of the same family: {kin}." if kin else "",
    ]
    return rst.page(rst.heading("Where it is used", 1), rst.listed(filter(None, items)))
