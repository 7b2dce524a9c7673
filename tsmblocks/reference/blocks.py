"""Pages of blocks, each written from the block itself: its declarations, its equations, its docstring, its example."""

from __future__ import annotations

import inspect
import math
from typing import Any

import numpy as np

import tsmblocks.blocks as public_blocks
from tsmblocks.common.headings import heading
from tsmblocks.common.tables import listed
from tsmblocks.compiler.dependencies import structure_of
from tsmblocks.files import dumps
from tsmblocks.html import block_facts
from tsmblocks.html.mathml import equation
from tsmblocks.model.block import REGISTRY, Block, Field, leaves
from tsmblocks.reference import examples, figures, rst, search_words, uses
from tsmblocks.reference.trace import LONGEST, Listing, listing, spaced

LETTERS = "A unit in italics, as *u*, is any unit, the same wherever the letter occurs."
ACROSS = (
    *("limits", "friction", "hysteresis", "control", "loops", "transmission", "changes", "delays"),
    *("arithmetic", "sensors"),
)
"""Families whose output is drawn over the input too, unless the input only jumps."""
LEVELS = 8
"""Distinct values up to which a signal is taken to jump between them."""
FAMILY_WORDS = {
    "sources": "Generated and recorded signals.",
    "arithmetic": "Operations on signals at one instant.",
    "linear": "Lags, integrators, delays and transfer functions in continuous time.",
    "limits": "Limits, dead zones, end stops, relays, rounding and tables.",
    "logic": "Comparisons, logic operations, modes, and diagrams that are switched on and off.",
    "friction": "Forces that resist a motion, as functions of its rate and its history.",
    "hysteresis": "Transmissions with memory: the paper's models, play, and similar ones.",
    "tendon": "Tendons in sheaths.",
    "control": "Controllers, and the paper's observer and compensator.",
    "motor": "Motors.",
    "discrete": "Blocks that act at multiples of a period and hold in between.",
    "sensors": "Errors of measurement: bias, quantisation, noise.",
    "delays": "Delays and lags that may be zero, for fits that estimate them.",
    "loops": "Hysteresis loops added to a signal; with their defaults they pass it on unchanged.",
    "transmission": "Deviations added to a signal; with their defaults they pass it on unchanged.",
    "changes": "Drifts, jumps and gains that change over time; with their defaults they pass the signal on.",
    "hydraulics": "Tanks.",
}


def families() -> dict[str, dict[str, type[Block]]]:
    """The blocks of the toolbox by family; those of users stay out."""
    own = {name: cls for name, cls in REGISTRY.items() if getattr(public_blocks, name, None) is cls}
    return block_facts.by_family(own)


def pages() -> dict[str, str]:
    """Every page by its path, the index among them."""
    found = families()
    made = {f"blocks/{name}": page(cls, list(some)) for some in found.values() for name, cls in some.items()}
    several = {f"families/{family}": _family(family, some) for family, some in found.items()}
    return {"blocks/index": _index(found), **several, **made}


def _index(found: dict[str, dict[str, type[Block]]]) -> str:
    parts = [
        rst.heading("Blocks"),
        f"{sum(map(len, found.values()))} blocks, by family. The page of a block is written from the block: its "
        "equations are those that are simulated, fitted, differentiated and exported. Under the name that another "
        "program gives it: :doc:`/howto/names`. How to write one of your own: :doc:`/tutorials/block`.",
    ]
    for family, some in found.items():
        parts += [f"{rst.link(f'/families/{family}', family.capitalize())}: {FAMILY_WORDS[family]}", _listed(some)]
    return rst.page(*parts, rst.contents(f"/families/{family}" for family in found))


def _family(family: str, some: dict[str, type[Block]]) -> str:
    """The page of a family: its blocks."""
    return rst.page(
        rst.heading(family.capitalize()),
        rst.indexed(search_words.FAMILIES.get(family, ())),
        FAMILY_WORDS[family],
        _listed(some),
        rst.contents(f"/blocks/{name}" for name in some),
    )


def _listed(some: dict[str, type[Block]]) -> str:
    rows = [
        (rst.link(f"/blocks/{name}", name), rst.plain(cls.symbol), rst.words(block_facts.words(cls)[0]))
        for name, cls in some.items()
    ]
    return rst.table(("Block", "Drawn as", "What it is"), rows, (25, 17, 58))


def page(cls: type[Block], family: list[str]) -> str:
    """The page of one block; ``family`` are the names of the blocks of its family."""
    block, made, name = cls(), examples.example(cls), cls.__name__
    shown = made.blocks[examples.snake(name)]
    assert isinstance(shown, Block)
    return rst.page(
        rst.heading(name),
        rst.indexed(search_words.of_block(name)),
        inspect.cleandoc(cls.__doc__ or ""),
        f":Source: {rst.plain(block.source)}\n:In Python: ``from tsmblocks.blocks import {name}``\n"
        f':In a file: ``{{ type = "{name}" }}``',
        rst.html(uses.linked_picture(made)),
        _ports(block),
        _numbers(block, shown, examples.snake(name)),
        _states(shown),
        rst.heading("Signals of the example", 1),
        rst.html(_charts(cls)),
        _behaviour(shown),
        _computed(block, shown),
        rst.heading("Example", 1),
        "The diagram at the top of this page, as a script and as a file.",
        rst.block(examples.script(made, examples.stop_of(cls)), "python"),
        rst.block(dumps(made), "toml"),
        _related(name, family),
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
    labels = [p.unit for p in block.inports.values()] + [p.unit for p in block.outports.values()]
    letters = LETTERS if any("?" in label for label in labels) else ""
    table = rst.section("Ports", ("Port", "Kind", "Unit", "Meaning"), rows, (16, 14, 14, 56))
    return rst.page(table, letters, _other_ports(type(block)))


def _other_ports(cls: type[Block]) -> str:
    """The ports of a block whose ports depend on its options, for other ones than in the table; else nothing."""
    given = examples.OTHER_PORTS.get(cls.__name__)
    if given is None:
        return ""
    block = cls(**given)
    said = [
        f"the {kind}{'s' if len(ports) > 1 else ''} {listed([rst.code(k) for k in ports], len(ports))}"
        for kind, ports in (("input", block.inports), ("output", block.outports))
    ]
    return f"The table holds for the defaults; {rst.code(examples.made(block))} has {' and '.join(said)}."


def _numbers(block: Block, shown: Block, label: str) -> str:
    """The fields of a block; ``shown`` is the one of the example, with values in each list."""
    parts = []
    for kind in ("parameter", "option"):
        rows = [
            (rst.code(k), default_text(getattr(block, k)), own_unit(f.unit), bounds(f), rst.words(_about(f)))
            for k, f in block.fields().items()
            if f.kind == kind
        ]
        if not rows:
            continue
        words = "They shape the equations, and cannot be fitted."
        if kind == "parameter":
            named = [leaf for key, value in shown.parameters.items() for leaf, _ in leaves(value, key)]
            where = f", as ``{label}.{named[0]}`` in the example below" if named else ""
            words = (
                "They stay symbols until the run: they can be set, swept, fitted and "
                f"differentiated, each by its name{where}."
            )
        table = rst.table(("Name", "Default", "Unit", "Bounds", "Meaning"), rows, (16, 14, 10, 18, 42))
        parts += [rst.heading(f"{kind.capitalize()}s", 1), words, table]
    return rst.page(*parts)


def _about(field: Field) -> str:
    """The meaning of a field, and what is meant where it is not given, unless that is the default."""
    if field.opposite:
        return f"{field.about}; in Python the opposite of {field.opposite}, where that alone is given"
    return field.about if field.omitted is None else f"{field.about}; {field.omitted:g} in a file that does not give it"


def own_unit(label: str) -> str:
    """The unit of a number; nothing for one without."""
    return unit(label) if label else ""


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
    shape, rows = structure_of(block), []
    for k, state in block.states.items():
        if k in shape.continuous:
            kind = "continuous, with resets" if k in shape.resets else "continuous"
        else:
            kind = f"memory, set at each {'sample' if block.sampled else 'step'}"
        long_before = isinstance(state.start, float) and state.start < -1e8
        start = "before the run" if long_before else default_text(state.start)
        rows.append((rst.code(k), kind, start, own_unit(state.unit), rst.words(state.about)))
    return rst.section("States", ("State", "Kind", "Initial value", "Unit", "Meaning"), rows, (16, 20, 12, 10, 42))


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
        return "**Export to C**: not possible, since its signal is computed for a whole run in advance."
    return "**Export to C**: possible (``tsmblocks export``)."


def _computed(block: Block, shown: Block) -> str:
    """The equations of the block of the example, and for which options and lengths of lists they hold."""
    made = listing(shown)
    if made.size > LONGEST:
        return ""
    lists = any(isinstance(v, tuple) for v in block.parameters.values())
    why = " and ".join(filter(None, ("options" if block.options else "", "lengths of lists" if lists else "")))
    other = [k for k in block.options if getattr(block, k) != getattr(shown, k)]
    which = f" ({', '.join(f'``{k}`` = {default_text(getattr(shown, k))}' for k in other)})" if other else ""
    apart = f" They are those of the block of the example{which}; other {why} give others." if why else ""
    words = (
        "The equations that are simulated, fitted, differentiated and exported, written from the expressions. Names "
        "in upright letters are those of the tables above; a dot is a rate, a plus the value after the next "
        f"{'sample' if block.sampled else 'step'}.{apart}"
    )
    text = "\\\\\n".join(equation(left, spaced(right)) for left, right in (*made.shared, *made.equations))
    return rst.page(rst.heading("As it is computed", 1), words, rst.formula(text))


# ---- the example ----------------------------------------------------------------------------------


def _charts(cls: type[Block]) -> str:
    run, made = examples.run(cls), examples.example(cls)
    names = list(made.outputs)
    labels = {k: heading(k, made.unit(k)) for k in names}
    signals = {k: run[k] for k in names}
    drawn = [figures.over_time(run.t, signals, labels)]
    driven = [k for k in cls().inports if k in names]
    outputs = list(cls().outports)
    moves = len(driven) == 1 and len(np.unique(run[driven[0]])) > LEVELS
    if moves and outputs and block_facts.family(cls) in ACROSS:
        x, y = driven[0], outputs[0]
        drawn.append(figures.over_another(run[x], run[y], (labels[x], labels[y])))
    return figures.side_by_side(drawn, names)


def _related(name: str, family: list[str]) -> str:
    found = {
        "In the diagrams": ("diagrams", uses.diagrams_with(name)),
        "In the effects": ("effects", uses.effects_with(name)),
        "Of the same family:": ("blocks", [k for k in family if k != name]),
    }
    items = [
        f"{words} {', '.join(rst.link(f'/{folder}/{k}', k) for k in names)}."
        for words, (folder, names) in found.items()
        if names
    ]
    return rst.page(rst.heading("Where it is used", 1), rst.listed(items))
