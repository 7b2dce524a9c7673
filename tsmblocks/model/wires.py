"""The one notation of wires: ``"error -> pid -> drive.u, scope"``. It knows text, ports and names, no equations.

An arrow is the direction of the signal, a dot separates block and port, a comma separates receivers; a port is left out
where a block has only one. The same text is used in scripts, files, messages and names of logged signals.
"""

from __future__ import annotations

import itertools
import re
from collections.abc import Iterable, Mapping
from typing import Any, Protocol

import attrs

from tsmblocks.common.errors import clip, in_words, near

NAME = re.compile(r"[A-Za-z_][A-Za-z0-9_]*")
"""Allowed names of blocks, ports, inputs and outputs."""
NO_OTHERS: Mapping[str, str] = {}
"""No names but those of blocks."""


class Ported(Protocol):
    """Anything with ports: a block, or a diagram as a block."""

    @property
    def inports(self) -> Mapping[str, Any]: ...

    @property
    def outports(self) -> Mapping[str, Any]: ...


class PlacedText(str):
    """Text with the place where it was written (``"file:line"``)."""

    place: str = ""

    @classmethod
    def at(cls, text: str, place: str) -> PlacedText:
        """The text with its place."""
        placed_text = cls(text)
        placed_text.place = place
        return placed_text


End = tuple[str, str]
"""A block and one of its ports; ``("", name)`` is an input or output of the diagram itself."""


def end_text(end: End) -> str:
    """``block.port``, or the name of an input or output of the diagram."""
    return ".".join(filter(None, end))


@attrs.frozen
class Link:
    """A connection of two ends; ``place`` is where it was written."""

    source: End
    target: End
    place: str = attrs.field(default="", eq=False)

    def __str__(self) -> str:
        if not self.target[0]:
            return f"output {self.target[1]}"
        source = ".".join(filter(None, self.source)) if self.source[0] else f"input {self.source[1]}"
        return f"{source} -> {'.'.join(self.target)}"


def inlet_links(inlets: Mapping[str, Iterable[End]]) -> list[Link]:
    """A link from each input of a diagram to each port that it drives."""
    return [Link(("", name), end, place_of(name)) for name, ends in inlets.items() for end in ends]


def place_of(origin: Any) -> str:
    """``file:line`` of a name, text or link, ``""`` where it is not known."""
    return getattr(origin, "place", "")


def placed(text: str, origin: Any) -> str:
    """A sentence with the place of a name, text or link in front, where one is known."""
    place = place_of(origin)
    return f"{place}: {text}" if place else text


class Fault(Exception):
    """A fault of one piece of wire notation, as a sentence; collected by the caller."""


def not_a_block(name: str, given: object) -> str:
    """The message for something else given as a block."""
    hint = f" Write {given.__name__}()." if isinstance(given, type) else ""
    return f"{name} must be a block or a diagram, got {in_words(given)}.{hint}"


def _ports(block: Ported, side: str) -> Mapping[str, Any]:
    return block.inports if side == "input" else block.outports


def _choose(name: str, block: Ported, port: str, side: str) -> str:
    """The port that ``name`` or ``name.port`` refers to, on one side of a block; raises Fault."""
    ports, other = _ports(block, side), "output" if side == "input" else "input"
    owner = f"{name} ({type(block).__name__})"
    if port in ports:
        return port
    if port in _ports(block, other):
        raise Fault(
            f"{name}.{port} is an {other} of {owner}, and an {side} is needed here."
            f" Its {side}s: {', '.join(ports) or 'none'}."
        )
    if port:
        raise Fault(f"{owner} has no {side} '{clip(port)}'.{near(port, ports)}")
    usual = [k for k, p in ports.items() if not getattr(p, "rate_of", "")]
    if len(usual) == 1:
        return usual[0]
    if not usual:
        raise Fault(f"{owner} has no {side}.")
    raise Fault(f"{owner} has {len(usual)} {side}s; name one of them. Known here: {', '.join(usual)}.")


def resolve(text: str, blocks: Mapping[str, Ported], side: str, others: Mapping[str, str] = NO_OTHERS) -> End:
    """``"tsm"`` or ``"tsm.y"`` as (block, port), the port being an ``input`` or ``output``; raises Fault.

    ``others`` maps names that are no blocks to what they are, as the end of a sentence.
    """
    if not isinstance(text, str):
        raise Fault(f"a port must be text such as 'motor.y', got {in_words(text)}.")
    name, _, port = text.strip().partition(".")
    name, port = name.strip(), port.strip()
    numbered = re.fullmatch(r"(\w+)\[\d+\]", name) or (port.isdigit() and re.fullmatch(r"(\w+)", name))
    if numbered and numbered[1] in blocks:
        block = blocks[numbered[1]]
        raise Fault(
            f"the ports of {numbered[1]} ({type(block).__name__}) are named, not numbered."
            f" Its {side}s: {', '.join(_ports(block, side)) or 'none'}."
        )
    if not NAME.fullmatch(name) or (port and not NAME.fullmatch(port)):
        raise Fault(f"'{clip(text.strip())}' is not a name. Write block or block.port.")
    if name not in blocks and name in others:
        raise Fault(f"names '{name}', which is {others[name]}")
    if name not in blocks:
        raise Fault(f"names block '{clip(name)}', which is not in blocks.{near(name, blocks)}")
    return name, _choose(name, blocks[name], port, side)


def parse_chain(
    text: str, blocks: Mapping[str, Ported], others: Mapping[str, str] = NO_OTHERS
) -> tuple[list[Link], list[str]]:
    """The links of one chain, and a sentence for each fault in it; ``others`` as for ``resolve``."""
    place = place_of(text)
    stages = [[part.strip() for part in stage.split(",")] for stage in text.split("->")]
    links: list[Link] = []
    faults: list[str] = []
    text = clip(text)
    if len(stages) < 2 or any(not part for stage in stages for part in stage):
        return [], [f"wire '{text}' is not a chain. Write source -> target, for example error -> pid.e."]
    if any(len(stage) > 1 for stage in stages[:-1]):
        return [], [f"wire '{text}' has a comma before its last arrow; only the last place may list several."]
    for (source,), targets in itertools.pairwise(stages):
        try:
            # In the middle of a chain a port names where the wire enters; the block must have one output.
            first = source is stages[0][0]
            start = resolve(source if first else source.partition(".")[0], blocks, "output", others)
        except Fault as fault:
            faults.append(str(fault))
            start = None
        for target in targets:
            try:
                end = resolve(target, blocks, "input", others)
                if start is not None:
                    links.append(Link(start, end, place))
            except Fault as fault:
                faults.append(str(fault))
    return links, [fault_sentence(f"wire '{text}'", fault) for fault in dict.fromkeys(faults)]


def fault_sentence(place: str, fault: object) -> str:
    """A fault after the text that it is a fault of: ``wire 'a -> b' names block 'a', …``."""
    return f"{place} {fault}" if str(fault).startswith("names ") else f"{place}: {fault}"


def short_name(end: End, blocks: Mapping[str, Ported], side: str) -> str:
    """``block`` where the port is its only one, else ``block.port``."""
    name, port = end
    try:
        plain = _choose(name, blocks[name], "", side)
    except Fault:
        return f"{name}.{port}"
    return name if plain == port else f"{name}.{port}"


def chains(links: Iterable[Link], blocks: Mapping[str, Ported]) -> list[str]:
    """The links as few readable chains, in the order of the links.

    A chain continues through a block when it leaves by the only output and that signal has not been written yet;
    several receivers of one signal share a line.
    """
    targets: dict[End, list[End]] = {}
    for link in links:
        targets.setdefault(link.source, []).append(link.target)
    fed = {end[0] for ends in targets.values() for end in ends}
    heads = sorted(targets, key=lambda source: source[0] in fed)  # stable: sources without inputs come first
    lines: list[str] = []
    for head in heads:
        if head not in targets:
            continue
        line, here = short_name(head, blocks, "output"), head
        while True:
            ends = targets.pop(here)
            line += " -> " + ", ".join(short_name(end, blocks, "input") for end in ends)
            outs = list(blocks[ends[0][0]].outports) if len(ends) == 1 else []
            here = (ends[0][0], outs[0]) if len(outs) == 1 else here
            if here not in targets:
                break
        lines.append(line)
    return lines
