"""Edits of the blocks and wires of a diagram: functions from a diagram to a new one, called by its methods.

They work on one list of links, which holds the inputs and outputs of the diagram too.
"""

from __future__ import annotations

import functools
from collections.abc import Callable, Iterable, Mapping
from typing import TYPE_CHECKING, Any

import attrs

from tsmblocks.common.errors import DiagramError, near, several
from tsmblocks.common.tables import listed
from tsmblocks.model.block import Block
from tsmblocks.model.validation import name_faults, wires_fault
from tsmblocks.model.wires import Fault, Link, end_text, fault_sentence, inlet_links, not_a_block, parse_chain, resolve

if TYPE_CHECKING:
    from tsmblocks.model.diagram import Diagram
    from tsmblocks.model.wires import End


def _fail(diagram: Diagram, *faults: str) -> DiagramError:
    return DiagramError(diagram.title, faults, diagram.where)


def _need(diagram: Diagram, name: str) -> Block | Diagram:
    """The block of this name. Raises DiagramError."""
    if name not in diagram.blocks:
        raise _fail(diagram, f"there is no block '{name}'.{near(name, diagram.blocks)}")
    return diagram.blocks[name]


def _check_block(diagram: Diagram, name: str, block: Any) -> None:
    if not isinstance(block, (Block, type(diagram))):
        raise _fail(diagram, not_a_block(name, block))


def _wires(diagram: Diagram, argument: str, given: Any) -> tuple[str, ...]:
    """The chains in an argument of an edit. Raises DiagramError for anything but a list of them."""
    wrong = wires_fault(argument, given)
    if wrong:
        raise _fail(diagram, wrong)
    return tuple(given)


def _links(diagram: Diagram) -> list[Link]:
    """The links of a diagram, and one for each port that an input drives and for each output."""
    outputs = [Link(end, ("", name)) for name, end in diagram.shown.items()]
    return [*diagram.links, *inlet_links(diagram.inlets), *outputs]


def _with_links(
    diagram: Diagram, links: Iterable[Link], blocks: Mapping[str, Any], wires: Iterable[str] = ()
) -> Diagram:
    """The diagram with these blocks and links, inputs and outputs included, and with further chains."""
    links, kept = list(links), list[Any]()
    ports = {k: [end_text(x.target) for x in links if x.source == ("", k) and x.target[0]] for k in diagram.inputs}
    shown = {x.target[1]: end_text(x.source) for x in links if not x.target[0]}
    for wire in wires:
        head, _, rest = (part.strip() for part in wire.partition("->"))
        if head in ports and rest and "->" not in rest:
            ports[head] += rest.split(",")
        else:
            kept.append(wire)
    return diagram._with(
        blocks=blocks,
        wires=[*(x for x in links if x.source[0] and x.target[0]), *kept],
        inputs={k: attrs.evolve(v, ports=ports[k]) for k, v in diagram.inputs.items()},
        outputs={k: shown[k] for k in diagram.outputs},
    )


def _nested(edit: Callable[..., Diagram]) -> Callable[..., Diagram]:
    """The edit of a block; one with a dotted name is an edit of the diagram inside."""

    @functools.wraps(edit)
    def edited(diagram: Diagram, name: str, *args: Any) -> Diagram:
        head, _, rest = name.partition(".")
        if not rest:
            return edit(diagram, name, *args)
        inner = _need(diagram, head)
        if isinstance(inner, Block):
            what = f"{edit.__name__} '{name}': {head} is a {type(inner).__name__}"
            raise _fail(diagram, f"{what}, not a diagram, so it contains no blocks.")
        try:
            changed = edited(inner, rest, *args)
        except DiagramError as error:
            raise _fail(diagram, *(f"{head}: {problem}" for problem in error.problems)) from None
        return diagram._with(blocks={**diagram.blocks, head: changed})

    return edited


@_nested
def insert(diagram: Diagram, name: str, block: Any, after: str, before: str, wires: Iterable[str]) -> Diagram:
    """See Diagram.insert."""
    if name in diagram.blocks:
        raise _fail(diagram, f"there is a block '{name}' already; choose another name.")
    if bool(after) == bool(before):
        got = "both" if after else "neither"
        raise _fail(diagram, f"insert '{name}' takes either after= or before=, got {got}.")
    wires = _wires(diagram, "wires", wires)
    _check_block(diagram, name, block)
    for wrong in name_faults({name: block}, "block"):
        raise _fail(diagram, wrong)
    enter, leave = ((name, _default_port(diagram, name, block, side, wires)) for side in ("input", "output"))
    links = _links(diagram)
    if after:
        source = _end(diagram, "after", after)
        links = [attrs.evolve(x, source=leave) if x.source == source else x for x in links]
        links.append(Link(source, enter))
    else:
        targets = [_end(diagram, "before", end.strip()) for end in before.split(",")]
        sources = {end_text(x.source) for x in links if x.target in targets}
        if len(sources) > 1:
            driving = listed(sorted(sources))
            raise _fail(diagram, f"before='{before}': these ports are on several wires, from {driving}.")
        cut = [x for x in links if x.target in targets]
        links = [attrs.evolve(x, target=enter) if x in cut[:1] else x for x in links if x not in cut[1:]]
        links += [Link(leave, target) for target in targets]
    return _with_links(diagram, links, {**diagram.blocks, name: block}, wires)


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
            f"insert '{name}': a block on a wire has one input and one output, and {type(block).__name__} has "
            f"{several(usual, side)}. Use rewire, which takes blocks and wires.",
        )
    return usual[0]


def _end(diagram: Diagram, argument: str, name: str) -> End:
    """The signal that ``after`` names, or the receiver that ``before`` names."""
    own: Mapping[str, Any] = diagram.inputs if argument == "after" else diagram.outputs
    place = f"{argument}='{name}'"
    if name in own:
        if argument == "before" and not diagram.shown[name][0]:
            raise _fail(diagram, f"{place}: that output shows an input; use after='{diagram.shown[name][1]}'.")
        return "", name
    try:
        return resolve(name, diagram.blocks, "output" if argument == "after" else "input")
    except Fault as fault:
        text = fault_sentence(place, fault)
        if str(fault).startswith("names block") and "." not in name:
            text = f"{place} names nothing in this diagram.{near(name, [*own, *diagram.blocks])}"
        raise _fail(diagram, text) from None


@_nested
def replace(diagram: Diagram, name: str, block: Any, ports: Mapping[str, str]) -> Diagram:
    """See Diagram.replace."""
    old = _need(diagram, name)
    _check_block(diagram, name, block)
    known = {**old.inports, **old.outports}
    for port in ports:
        if port not in known:
            raise _fail(diagram, f"replace '{name}': {type(old).__name__} has no port '{port}'.{near(port, known)}")
    faults: list[str] = []

    def moved(link: Link, side: str) -> End:
        """The end of a link at the new block, where it was at the old one."""
        end, there = (link.target, block.inports) if side == "input" else (link.source, block.outports)
        if end[0] != name:
            return end
        port = ports.get(end[1], end[1])
        if port not in there:
            one = next(iter(there)) if len(there) == 1 else "…"
            hint = f" Say ports={{'{end[1]}': '{one}'}}." if there and port == end[1] else ""
            what = f"{link}: the new {name} is a {type(block).__name__}, which has no {side} '{port}'."
            faults.append(f"{what}{near(port, there)}{hint}")
        return name, port

    links = [Link(moved(x, "output"), moved(x, "input"), x.place) for x in _links(diagram)]
    if faults:
        raise _fail(diagram, *faults)
    return _with_links(diagram, links, {**diagram.blocks, name: block})


@_nested
def remove(diagram: Diagram, name: str) -> Diagram:
    """See Diagram.remove."""
    _need(diagram, name)
    links = _links(diagram)
    into = [x for x in links if x.target[0] == name]
    leaving = sorted({x.source[1] for x in links if x.source[0] == name})
    if leaving and (len(into) != 1 or len(leaving) > 1):
        raise _fail(
            diagram,
            f"remove '{name}': it has {several([x.target[1] for x in into], 'input')} and "
            f"{several(leaving, 'output')} in use, so it is not known which signal should replace it. Use rewire or "
            "replace.",
        )
    if (
        leaving and into[0].target[1] == "v"
    ):  # friction, an observer: the output is another quantity, whatever the units
        raise _fail(
            diagram,
            f"remove '{name}': its input v is a rate, which cannot replace its output. To remove its effect: "
            f"replace('{name}', Gain(gain=0.0), ports={{'v': 'u'}}), or rewire.",
        )
    kept = [x for x in links if name not in (x.source[0], x.target[0])]
    joined = [attrs.evolve(x, source=into[0].source) for x in links if x.source[0] == name]
    return _with_links(diagram, [*kept, *joined], {k: b for k, b in diagram.blocks.items() if k != name})


def rewire(diagram: Diagram, cut: Iterable[str], add: Iterable[str], changes: Mapping[str, Any]) -> Diagram:
    """See Diagram.rewire."""
    gone: list[Link] = []
    cut, add = _wires(diagram, "cut", cut), _wires(diagram, "add", add)
    for text in cut:
        links, faults = parse_chain(text, diagram.blocks)
        faults += [
            f"cut '{link}': there is no such wire.{near(str(link), map(str, diagram.links))}"
            for link in links
            if link not in diagram.links
        ]
        if faults:
            raise _fail(diagram, *faults)
        gone += links
    kept = [link for link in diagram.links if link not in gone]
    return diagram._with(wires=[*kept, *add], **{k: v for k, v in changes.items() if v is not None})
