"""Edits of a diagram, and of its parameters: functions from a diagram to a new one, called by its methods."""

from __future__ import annotations

from collections.abc import Iterable, Mapping
from typing import TYPE_CHECKING, Any

import attrs

from tsmblocks.common.errors import DiagramError, ParameterError, near, several
from tsmblocks.model.block import Block, leaves, plain
from tsmblocks.model.validation import name_faults, wires_fault
from tsmblocks.model.wires import Fault, Link, class_name, fault_sentence, not_a_block, parse_chain, resolve

if TYPE_CHECKING:
    from tsmblocks.model.diagram import Diagram, Inlet


def _fail(diagram: Diagram, text: str) -> DiagramError:
    return DiagramError(diagram.title, [text], diagram.where)


def wires_in(diagram: Diagram, name: str, given: Any) -> tuple[str, ...]:
    """The chains in the argument ``name`` of an edit; raises DiagramError for anything but a list of them."""
    wrong = wires_fault(name, given)
    if wrong:
        raise _fail(diagram, wrong)
    return tuple(given)


def _default_port(diagram: Diagram, name: str, block: Any, side: str, wires: tuple[str, ...]) -> str:
    """The port of a block that is put on a wire: the only unused one, or the input named u."""
    ports = block.inports if side == "input" else block.outports
    taken = {end.strip() for wire in wires for stage in wire.split("->") for end in stage.split(",")}
    usual = [k for k, p in ports.items() if not getattr(p, "rate_of", "") and f"{name}.{k}" not in taken]
    if side == "input" and "u" in usual:
        return "u"
    if len(usual) != 1:
        raise _fail(
            diagram,
            f"insert '{name}': a block on a wire has one input and one output, and {class_name(block)} has "
            f"{several(usual, side)}. Use rewire, which takes blocks and wires.",
        )
    return usual[0]


def _need_block(diagram: Diagram, name: str, block: Any) -> None:
    if not isinstance(block, (Block, type(diagram))):
        raise _fail(diagram, not_a_block(name, block))


def inserted(
    diagram: Diagram, name: str, block: Block | Diagram, after: str, before: str, wires: tuple[str, ...]
) -> Diagram:
    """See Diagram.insert."""
    _need_block(diagram, name, block)
    wrong = [*name_faults({name: block}, "block")]
    if wrong:
        raise _fail(diagram, wrong[0])
    enter, leave = ((name, _default_port(diagram, name, block, side, wires)) for side in ("input", "output"))
    blocks = {**diagram.blocks, name: block}
    if after:
        links, inputs, outputs = _after(diagram, after, enter, leave)
    else:
        links, inputs, outputs = _before(diagram, before, enter, leave)
    more, inputs = _from_inputs(diagram, wires, inputs)
    return diagram._with(blocks=blocks, wires=[*links, *more], inputs=inputs, outputs=outputs)


def _from_inputs(
    diagram: Diagram, wires: tuple[str, ...], inputs: dict[str, Inlet]
) -> tuple[list[str], dict[str, Inlet]]:
    """Wires that begin at an input of the diagram become ports of that input; the others stay wires."""
    kept, made = list[str](), dict(inputs)
    for wire in wires:
        head, _, rest = (part.strip() for part in wire.partition("->"))
        if head in diagram.inputs and rest and "->" not in rest:
            more = [port.strip() for port in rest.split(",")]
            made[head] = attrs.evolve(made[head], ports=[*made[head].ports, *more])
        else:
            kept.append(wire)
    return kept, made


Edited = tuple[list[Link], "dict[str, Inlet]", dict[str, str]]


def _after(diagram: Diagram, signal: str, enter: tuple[str, str], leave: tuple[str, str]) -> Edited:
    out = ".".join(leave)
    if signal in diagram.inputs:
        moved = [Link(leave, end) for end in diagram.inlets[signal]]
        inlet = attrs.evolve(diagram.inputs[signal], ports=".".join(enter))
        outputs = {k: out if end == ("", signal) else diagram.outputs[k] for k, end in diagram.shown.items()}
        return [*diagram.links, *moved], {**diagram.inputs, signal: inlet}, outputs
    try:
        source = resolve(signal, diagram.blocks, "output")
    except Fault as fault:
        raise _fail(diagram, _instead(f"after='{signal}'", fault, signal, [*diagram.inputs, *diagram.blocks])) from None
    links = [attrs.evolve(link, source=leave) if link.source == source else link for link in diagram.links]
    outputs = {k: out if end == source else diagram.outputs[k] for k, end in diagram.shown.items()}
    return [*links, Link(source, enter)], dict(diagram.inputs), outputs


def _before(diagram: Diagram, receiver: str, enter: tuple[str, str], leave: tuple[str, str]) -> Edited:
    inputs, outputs = dict(diagram.inputs), dict(diagram.outputs)
    if receiver in diagram.outputs:
        head, port = diagram.shown[receiver]
        outputs[receiver] = ".".join(leave)
        if not head:
            raise _fail(diagram, f"before='{receiver}': that output shows an input; use after='{port}'.")
        return [*diagram.links, Link((head, port), enter)], inputs, outputs
    try:
        target = resolve(receiver, diagram.blocks, "input")
    except Fault as fault:
        known = [*diagram.outputs, *diagram.blocks]
        raise _fail(diagram, _instead(f"before='{receiver}'", fault, receiver, known)) from None
    links = [attrs.evolve(link, target=enter) if link.target == target else link for link in diagram.links]
    for key, ends in diagram.inlets.items():
        if target in ends:
            ports = tuple(".".join(enter if end == target else end) for end in ends)
            inputs[key] = attrs.evolve(diagram.inputs[key], ports=ports)
    return [*links, Link(leave, target)], inputs, outputs


def _instead(place: str, fault: Fault, name: str, known: list[str]) -> str:
    """The fault; for a name without a dot, with the near miss among inputs or outputs of the diagram too."""
    if "." in name or name in known or not str(fault).startswith("names block"):
        return fault_sentence(place, fault)
    return f"{place} names nothing in this diagram.{near(name, known)}"


def replaced(diagram: Diagram, name: str, block: Block | Diagram, ports: Mapping[str, str]) -> Diagram:
    """See Diagram.replace."""
    _need_block(diagram, name, block)
    old = diagram.blocks[name]
    for port in ports:
        known = {**old.inports, **old.outports}
        if port not in known:
            raise _fail(diagram, f"replace '{name}': {class_name(old)} has no port '{port}'.{near(port, known)}")
    faults: list[str] = []
    entering, leaving = block.inports, block.outports

    def moved(end: tuple[str, str], side: Mapping[str, Any], text: str) -> tuple[str, str]:
        if end[0] != name:
            return end
        what = "output" if side is leaving else "input"
        port = ports.get(end[1], end[1])
        if port not in side:
            wrong = f"{text}: the new {name} is a {class_name(block)}, which has no {what} '{port}'.{near(port, side)}"
            one = next(iter(side)) if len(side) == 1 else "…"
            map_it = f" Say ports={{'{end[1]}': '{one}'}}." if side and port == end[1] else ""
            faults.append(wrong + map_it)
        return name, port

    links = [Link(moved(x.source, leaving, str(x)), moved(x.target, entering, str(x)), x.place) for x in diagram.links]
    inputs = {
        k: attrs.evolve(
            v, ports=[".".join(moved(e, entering, f"input {k} -> {'.'.join(e)}")) for e in diagram.inlets[k]]
        )
        for k, v in diagram.inputs.items()
    }
    outputs = {
        k: ".".join(moved(end, leaving, f"output {k}")) if end[0] == name else diagram.outputs[k]
        for k, end in diagram.shown.items()
    }
    if faults:
        raise DiagramError(diagram.title, faults, diagram.where)
    return diagram._with(blocks={**diagram.blocks, name: block}, wires=links, inputs=inputs, outputs=outputs)


def removed(diagram: Diagram, name: str) -> Diagram:
    """See Diagram.remove."""
    into = [x for x in diagram.links if x.target[0] == name]
    outof = [x for x in diagram.links if x.source[0] == name]
    feeding = [(k, e) for k, ends in diagram.inlets.items() for e in ends if e[0] == name]
    shown = [k for k, end in diagram.shown.items() if end[0] == name]
    leaving = {x.source[1] for x in outof} | {diagram.shown[k][1] for k in shown}
    if leaving and (len(into) + len(feeding) != 1 or len(leaving) > 1):
        ins = [*(x.target[1] for x in into), *(e[1] for _, e in feeding)]
        raise _fail(
            diagram,
            f"remove '{name}': it has {several(ins, 'input')} and {several(sorted(leaving), 'output')} "
            "in use, so what should take its place is not known. Use rewire or replace.",
        )
    heads = {x.target[1] for x in into} | {e[1] for _, e in feeding}
    if leaving and heads == {"v"}:  # friction, an observer: the output is another quantity, whatever the units
        raise _fail(
            diagram,
            f"remove '{name}': its input v is a rate, which cannot take the place of what it gives. To do without it: "
            f"replace('{name}', Gain(gain=0.0), ports={{'v': 'u'}}), or rewire.",
        )
    links = [x for x in diagram.links if name not in (x.source[0], x.target[0])]
    inputs = {
        k: attrs.evolve(v, ports=[".".join(e) for e in diagram.inlets[k] if e[0] != name])
        for k, v in diagram.inputs.items()
    }
    outputs = dict(diagram.outputs)
    if leaving and into:
        links += [Link(into[0].source, x.target, x.place) for x in outof]
        outputs |= {k: ".".join(into[0].source) for k in shown}
    elif leaving:
        key = feeding[0][0]
        inputs[key] = attrs.evolve(inputs[key], ports=[*inputs[key].ports, *(".".join(x.target) for x in outof)])
        outputs |= dict.fromkeys(shown, key)
    blocks = {k: b for k, b in diagram.blocks.items() if k != name}
    return diagram._with(blocks=blocks, wires=links, inputs=inputs, outputs=outputs)


def rewired(diagram: Diagram, cut: tuple[str, ...], add: tuple[str, ...], changes: dict[str, Any]) -> Diagram:
    """See Diagram.rewire."""
    gone: list[Link] = []
    for text in cut:
        links, faults = parse_chain(text, diagram.blocks)
        faults += [
            f"cut '{link}': there is no such wire.{near(str(link), map(str, diagram.links))}"
            for link in links
            if link not in diagram.links
        ]
        if faults:
            raise DiagramError(diagram.title, faults, diagram.where)
        gone += links
    kept = [link for link in diagram.links if link not in gone]
    return diagram._with(wires=[*kept, *add], **changes)


# ---- parameters by name: a dot reaches into diagrams, a bracket into lists


def overridden(diagram: Diagram, changes: Mapping[str, Any], whole: Diagram, prefix: str) -> Diagram:
    """See Diagram.with_parameters; ``whole`` is the outermost diagram, ``prefix`` the path from it."""
    grouped: dict[str, dict[str, Any]] = {}
    values = dict(diagram.values)
    for name, value in changes.items():
        head, _, rest = name.partition(".")
        if head in values and not rest:
            values[head] = value
        elif head in diagram.blocks and rest:
            grouped.setdefault(head, {})[rest] = value
        else:
            hint = near_path(prefix + name, whole.parameter_names())
            raise ParameterError(f"diagram '{whole.title}' has no parameter '{prefix}{name}'.{hint}")
    blocks = dict(diagram.blocks)
    for name, part in grouped.items():
        block = blocks[name]
        if not isinstance(block, Block):
            blocks[name] = overridden(block, part, whole, f"{prefix}{name}.")
            continue
        try:
            blocks[name] = _with_fields(block, part)
        except ParameterError as error:
            raise ParameterError(f"{prefix}{name}: {error}") from None
    return diagram._with(blocks=blocks, values=values)


def _with_fields(block: Block, part: Mapping[str, Any]) -> Block:
    """A block with fields, or single elements of them (``den[1]``), changed."""
    changes: dict[str, Any] = {}
    for key, value in part.items():
        name, bracket, _ = key.partition("[")
        if name not in block.fields():
            raise ParameterError(f"{type(block).__name__} has no parameter '{key}'.{near(key, block.fields())}")
        if not bracket:
            changes[name] = plain(value)
            continue
        whole = changes.get(name, getattr(block, name))
        if key not in {leaf for leaf, _ in leaves(whole, name)}:
            known = [leaf for leaf, _ in leaves(whole, name)]
            if known == [name]:
                raise ParameterError(f"{type(block).__name__}.{name} is one number, so there is no '{key}'.")
            raise ParameterError(f"{type(block).__name__} has no element '{key}'.{near(key, known)}")
        changes[name] = _set_leaf(whole, name, key, value)
    return block.replace(**changes)


def _set_leaf(whole: Any, name: str, key: str, value: Any) -> Any:
    if not isinstance(whole, tuple):
        return value if name == key else whole
    return tuple(_set_leaf(v, f"{name}[{k}]", key, value) for k, v in enumerate(whole))


def near_path(name: str, known: Iterable[str]) -> str:
    """Near misses of a dotted name; for one without a dot, the names that end in it come first."""
    known = list(known)
    hint = near(name, known)
    tail = [k for k in known if k.rpartition(".")[2] == name.rpartition(".")[2]]
    if tail and ("." not in name or not hint.startswith(" Did you mean")):
        return f" Did you mean {' or '.join(repr(k) for k in tail[:3])}?"
    return hint
