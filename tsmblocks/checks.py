"""What must hold of a diagram before it means anything: names, drivers, open inputs, units.

Every fault is collected and said once; a fault that only follows from another (a misspelt wire
leaves a port open) is not said.
"""

from __future__ import annotations

import math
import re
from collections.abc import Collection, Iterator, Mapping
from typing import TYPE_CHECKING, Any

import attrs

from tsmblocks import units
from tsmblocks.errors import clip, in_words, near
from tsmblocks.wires import NAME, Fault, Link, Located, kind, parse, resolve

if TYPE_CHECKING:
    from tsmblocks.diagram import Inlet

End = tuple[str, str]
SHARED = re.compile(r"\?(\w+?)((?:[*/].*)?)")
"""A unit that a block's ports share: a letter, times a known unit."""
ONE = units.Unit(1.0, ())
ENOUGH = 50
"""Faults of one kind after which no more are looked for; looking for near misses takes time."""


@attrs.frozen
class Checked:
    """What wires, inputs and outputs were found to mean, and a sentence for each fault."""

    links: list[Link]
    inlets: dict[str, tuple[End, ...]]
    shown: dict[str, End]
    port_units: dict[End, units.Unit]
    faults: list[str]


def examine(
    blocks: Mapping[str, Any],
    wires: Any,
    inputs: Mapping[str, Inlet],
    outputs: Mapping[str, str],
    values: Mapping[str, float],
    *,
    unsure: Collection[str] = (),
    silent: bool = False,
) -> Checked:
    """Everything that must hold of a diagram's parts.

    ``unsure`` names blocks whose ports, and values whose number, are not known because they are
    faulty themselves; nothing is said that could follow from that. ``silent`` leaves out open
    inputs, for use when some wires could not be read.
    """
    faults = [*name_faults(blocks, "block"), *name_faults(inputs, "input"),
              *name_faults(outputs, "output"), *name_faults(values, "value")]  # fmt: skip
    links, bad_wires = read_wires(wires, blocks, inputs)
    inlets, bad_inputs = resolve_inlets(inputs, blocks)
    shown, bad_outputs = resolve_outputs(outputs, blocks, inputs)
    echoes = silent or bool(bad_wires or bad_inputs)  # a misspelt wire leaves a port open: say the spelling
    known = {k: b for k, b in blocks.items() if k not in unsure}
    faults += [*bad_wires, *bad_inputs, *bad_outputs]
    faults += driver_faults(links, inlets, known, silent=echoes)
    faults += value_faults(known, values, unsure)
    bad_units, found = unit_faults(links, inlets, {k: v.unit for k, v in inputs.items()}, known)
    return Checked(links, inlets, shown, found, [*faults, *bad_units])


def located(text: str, place: str) -> str:
    """The sentence with its ``file:line`` in front, where one is known."""
    return f"{place}: {text}" if place else text


def place_of(text: Any) -> str:
    """``file:line`` of a name or wire text, or ``""`` where it is not known."""
    return getattr(text, "place", "")


def read_wires(wires: Any, blocks: Mapping[str, Any], inputs: Mapping[str, Any]) -> tuple[list[Link], list[str]]:
    """Links from chains (or links already read), with the faults found."""
    links: list[Link] = []
    faults: list[str] = []
    for text in wires:
        if len(faults) >= ENOUGH:
            break
        if isinstance(text, Link):
            links.append(text)
            continue
        if not isinstance(text, str):
            faults.append(f"a wire must be text such as 'error -> pid', got {in_words(text)}.")
            continue
        found, wrong = parse(text, blocks)
        links += found
        for fault in wrong:
            hint = next((f" '{n}' is an input of the diagram: list its ports under inputs." for n in inputs
                         if f"names block '{n}'" in fault), "")  # fmt: skip
            faults.append(located(fault + hint, place_of(text)))
    return links, faults


def name_faults(names: Mapping[str, Any], what: str) -> Iterator[str]:
    """Names that cannot stand in wire notation."""
    for name in names:
        if not isinstance(name, str) or not NAME.fullmatch(name):
            yield located(
                f"{what} name {clip(str(name))!r} must be letters, digits and underscores, "
                "not starting with a digit.",
                place_of(name),
            )


def resolve_inlets(
    inlets: Mapping[str, Inlet], blocks: Mapping[str, Any]
) -> tuple[dict[str, tuple[End, ...]], list[str]]:
    """Ports that each input of the diagram drives."""
    found: dict[str, tuple[End, ...]] = {}
    faults: list[str] = []
    for name, inlet in inlets.items():
        ends = []
        if name in blocks:
            faults.append(located(
                f"'{name}' is both an input of the diagram and a block; give one of them another name.",
                place_of(name)))  # fmt: skip
        for port in inlet.ports:
            if len(faults) >= ENOUGH:
                break
            try:
                ends.append(resolve(port, blocks, "input"))
            except Fault as fault:
                faults.append(located(f"input '{name}': {fault}", place_of(port)))
        found[name] = tuple(ends)
    return found, faults


def resolve_outputs(
    outputs: Mapping[str, str], blocks: Mapping[str, Any], inputs: Mapping[str, Any]
) -> tuple[dict[str, End], list[str]]:
    """Signal that each output shows; ``("", name)`` stands for an input of the diagram passed through."""
    found: dict[str, End] = {}
    faults: list[str] = []
    for name, signal in outputs.items():
        if len(faults) >= ENOUGH:
            break
        if signal in inputs:
            found[name] = ("", str(signal))
            continue
        try:
            found[name] = resolve(signal, blocks, "output")
        except Fault as fault:
            faults.append(located(f"output '{name}': {fault}", place_of(signal)))
    return found, faults


def driver_faults(
    links: list[Link], inlets: Mapping[str, tuple[End, ...]], blocks: Mapping[str, Any], silent: bool
) -> Iterator[str]:
    """Inputs driven twice, and (unless ``silent``) inputs driven by nothing."""
    driven: dict[End, list[tuple[str, str]]] = {}
    for link in links:
        driven.setdefault(link.target, []).append((str(link), link.place))
    for name, ends in inlets.items():
        for end in ends:
            driven.setdefault(end, []).append((f"input {name} -> {'.'.join(end)}", place_of(name)))
    for end, writers in driven.items():
        if len(writers) > 1:
            texts = "; ".join(text for text, _ in writers)
            yield located(
                f"{'.'.join(end)} is driven {len(writers)} times: {texts}. Join them with a Sum block.",
                writers[-1][1],
            )
    if silent:
        return
    for name, block in blocks.items():
        for port, spec in block.inports.items():
            if (name, port) not in driven and not getattr(spec, "rate_of", ""):
                unit = f" [{spec.unit}]" if spec.unit and "?" not in spec.unit else ""
                about = f" It is: {spec.about}{unit}." if spec.about else ""
                yield located(f"{name}.{port} ({kind(block)}) is driven by nothing.{about} "
                              f"Wire it, list it under inputs, or drive it with a Constant.",
                              place_of(name))  # fmt: skip


# ---- units: every port's unit is a known label, or a power of s times an unknown shared by some ports


class _Units:
    """Union-find over ports whose edges carry a factor: ``unit(a) = ratio * unit(b)``.

    A node is a port or an unknown; ``"SI"`` is the node of pure numbers. The ratio is a
    (factor, dimension) pair, so that two routes to one node can be compared.
    """

    def __init__(self) -> None:
        self.parent: dict[Any, tuple[Any, units.Unit]] = {}
        self.label: dict[Any, tuple[str, str]] = {}  # root -> (unit label, the port it came from)

    def find(self, node: Any) -> tuple[Any, units.Unit]:
        """The root of a node and unit(node)/unit(root); the way there is shortened for the next call."""
        way = []
        while node in self.parent:
            way.append(node)
            node = self.parent[node][0]
        ratio = ONE
        for passed in reversed(way):
            ratio = _times(self.parent[passed][1], ratio)
            self.parent[passed] = (node, ratio)
        return node, ratio

    def join(self, a: Any, b: Any, ratio: units.Unit) -> units.Unit | None:
        """State unit(a) = ratio * unit(b). Returns what was known instead, if it disagrees."""
        (ra, fa), (rb, fb) = self.find(a), self.find(b)
        if ra == rb:
            known = _times(fa, fb, -1)
            agrees = known.dimension == ratio.dimension and abs(known.factor / ratio.factor - 1) < 1e-12
            return None if agrees else known
        step = _times(_times(ratio, fb), fa, -1)
        if ra == "SI":  # pure numbers stay a root, so that a unit is read off directly
            self.parent[rb] = (ra, _times(ONE, step, -1))
        else:
            self.parent[ra] = (rb, step)
        return None


def _times(a: units.Unit, b: units.Unit, power: int = 1) -> units.Unit:
    if b == ONE:
        return a
    total = dict(a.dimension)
    for key, n in b.dimension:
        total[key] = total.get(key, 0) + power * n
    return units.Unit(a.factor * b.factor**power, tuple(sorted((k, n) for k, n in total.items() if n)))


def _port_faults(known: _Units, labels: dict[End, str], name: str, block: Any) -> Iterator[str]:
    for side in (block.inports, block.outports):
        for port, spec in side.items():
            end = (name, port)
            if not spec.unit:
                continue
            match = SHARED.fullmatch(spec.unit)
            try:
                factor = units.parse("1" + match[2] if match else spec.unit)
            except units.UnitError as error:
                yield located(f"{name}.{port}: {error}", place_of(name))
                continue
            if match is None:
                labels[end] = spec.unit
                known.join(end, "SI", factor)
            elif known.join(end, (name, "?", match[1]), factor) is not None:
                yield located(f"{name}.{port} cannot have the unit '{spec.unit}' beside the block's "
                              "other ports.", place_of(name))  # fmt: skip


def unit_faults(
    links: list[Link], inlets: Mapping[str, tuple[End, ...]], declared: Mapping[str, str], blocks: Mapping[str, Any]
) -> tuple[list[str], dict[End, units.Unit]]:
    """Wires that join different units, and the unit of every port that has one.

    Blocks that take anything (a sum, an integrator) pass units on, so a mismatch is found
    across them too.
    """
    known, labels = _Units(), dict[End, str]()
    faults: list[str] = []
    for name, block in blocks.items():
        faults += _port_faults(known, labels, name, block)
    for name, unit in declared.items():
        if unit:
            try:
                known.join(("", name), "SI", units.parse(unit))
                labels["", name] = unit
            except units.UnitError as error:
                faults.append(located(f"input '{name}': {error}", place_of(name)))
    wires = [(link.source, link.target, str(link), link.place) for link in links]
    wires += [(("", n), end, f"input {n} -> {'.'.join(end)}", place_of(n))
              for n, ends in inlets.items() for end in ends]  # fmt: skip
    for source, target, text, place in wires:
        if known.join(source, target, ONE) is not None:
            a, b = (_label(known, labels, end) for end in (source, target))
            faults.append(located(
                f"{text} joins {a} to {b}. Put a Convert block between them, or correct the unit of one port.",
                place))  # fmt: skip
    found = {}
    for end in [*labels, *(e for s, t, *_ in wires for e in (s, t))]:
        root, ratio = known.find(end)
        if root == "SI":
            found[end] = ratio
    return faults, found


def _label(known: _Units, labels: Mapping[End, str], end: End) -> str:
    if end in labels:
        return labels[end]
    root, ratio = known.find(end)
    if root == "SI":
        return name_of(ratio)
    return "another unit"


def name_of(unit: units.Unit) -> str:
    """A readable label of a unit found by inference."""
    for label in ("1", "rad", "deg", "rad/s", "deg/s", "rad/s^2", "rad*s", "V", "A", "N", "N*m", "m", "m/s", "m*s",
                  "mm", "s", "1/s", "V*s", "V/s"):  # fmt: skip
        u = units.parse(label)
        if u.dimension == unit.dimension and abs(u.factor / unit.factor - 1) < 1e-12:
            return label
    power = "*".join(k if n == 1 else f"{k}^{n}" for k, n in unit.dimension) or "1"
    return power if abs(unit.factor - 1) < 1e-12 else f"{unit.factor:g}*{power}"


def value_faults(
    blocks: Mapping[str, Any], values: Mapping[str, float], unsure: Collection[str] = ()
) -> Iterator[str]:
    """References to numbers that are not in the table, and referenced numbers a block refuses.

    Numbers named in ``unsure`` exist, and are not to be judged by.
    """
    from tsmblocks.block import Block, is_reference, leaves, map_leaves
    from tsmblocks.errors import ParameterError

    for key, value in values.items():
        if not _is_number(value):
            yield located(f"value '{key}' must be a number, got {in_words(value)}.", place_of(key))
    for name, block in blocks.items():
        if not isinstance(block, Block):
            continue
        used = {k: v for k, v in block.parameters.items() if any(is_reference(x) for _, x in leaves(v))}
        wanted = {x[1:] for v in used.values() for _, x in leaves(v) if is_reference(x)}
        missing = wanted - set(values) - set(unsure)
        place = place_of(name)
        for key in sorted(missing)[:ENOUGH]:
            yield located(f"{name}: '${clip(key)}' stands for a number that is not in values."
                          f"{near(key, values)}", place)  # fmt: skip
        if used and not wanted & set(unsure) and not missing and all(_is_number(values[k]) for k in wanted):
            try:
                block.replace(**{
                    k: map_leaves(lambda _, x: values[x[1:]] if is_reference(x) else x, v) for k, v in used.items()
                })  # fmt: skip
            except ParameterError as error:
                yield located(f"{name}: {error}", place)


def _is_number(value: Any) -> bool:
    return isinstance(value, float) and not math.isnan(value)


__all__ = ["Checked", "Located", "driver_faults", "examine", "name_faults", "read_wires", "resolve_inlets",
           "resolve_outputs", "unit_faults", "value_faults"]  # fmt: skip
