"""Whether wires join like units. A port without a declared unit takes that of what it is wired to.

Every port's unit is a known label, or a power of s times an unknown that some ports share. Blocks that
take anything (a sum, an integrator) pass units on, so a mismatch is found across them too.
"""

from __future__ import annotations

import re
from collections import deque
from collections.abc import Iterable, Iterator, Mapping
from typing import Any

from tsmblocks.common import units
from tsmblocks.model.wires import Link, place_of, placed

End = tuple[str, str]
Wire = tuple[End, End, str, str]
"""Source, target, text and place; an input of the diagram is the source ``("", name)``."""
Interface = dict[str, tuple[str, units.Unit]]
"""Port -> the group of ports that share its unknown unit ("" where it is known), and its unit or power in the group."""
SHARED_UNIT = re.compile(r"\?(\w+?)((?:[*/].*)?)")
"""A unit that a block's ports share: a letter, times a known unit."""
READABLE_LABELS = (  # noqa: SIM905
    "1 rad deg rad/s deg/s rad/s^2 deg/s^2 rad*s deg*s mrad mrad/s rev rev/s V A N N*m m m/s m/s^2 m*s mm mm/s s 1/s "
    "1/s^2 ms V*s V/s mV mA K kg N/m N*s/m N*m/rad rad/V"
).split()
"""Labels tried first for a unit that nobody named."""
DIMENSIONLESS = units.Unit(1.0, ())
SI = "SI"
"""The node of pure numbers, to which every known unit is tied."""


class _Units:
    """Union-find over ports whose edges carry a factor: ``unit(a) = ratio * unit(b)``.

    A node is a port, an unknown of a block, or ``SI``. The ratio is a (factor, dimension) pair, so
    that two routes to one node can be compared.
    """

    def __init__(self) -> None:
        self.parent: dict[Any, tuple[Any, units.Unit]] = {}

    def find(self, node: Any) -> tuple[Any, units.Unit]:
        """The root of a node and unit(node)/unit(root); the way there is shortened for the next call."""
        way = []
        while node in self.parent:
            way.append(node)
            node = self.parent[node][0]
        ratio = DIMENSIONLESS
        for passed in reversed(way):
            ratio = _times(self.parent[passed][1], ratio)
            self.parent[passed] = (node, ratio)
        return node, ratio

    def join(self, a: Any, b: Any, ratio: units.Unit) -> bool:
        """State unit(a) = ratio * unit(b); False when that contradicts what is known already."""
        (ra, fa), (rb, fb) = self.find(a), self.find(b)
        if ra == rb:
            known = _times(fa, fb, -1)
            return known.dimension == ratio.dimension and abs(known.factor / ratio.factor - 1) < 1e-12
        step = _times(_times(ratio, fb), fa, -1)
        if ra == SI:  # pure numbers stay a root, so that a unit is read off directly
            self.parent[rb] = (ra, _times(DIMENSIONLESS, step, -1))
        else:
            self.parent[ra] = (rb, step)
        return True

    def known(self, node: Any) -> units.Unit | None:
        """The unit of a node, if it follows from a declared one."""
        root, ratio = self.find(node)
        return ratio if root == SI else None


def _times(a: units.Unit, b: units.Unit, power: int = 1) -> units.Unit:
    if b == DIMENSIONLESS:
        return a
    total = dict(a.dimension)
    for key, n in b.dimension:
        total[key] = total.get(key, 0) + power * n
    return units.Unit(a.factor * b.factor**power, tuple(sorted((k, n) for k, n in total.items() if n)))


class _Survey:
    """What a diagram's ports declare of their units, and which of them share one."""

    def __init__(self) -> None:
        self.units = _Units()
        self.labels: dict[End, str] = {}  # declared
        self.shared: list[tuple[Any, Any]] = []  # ports and the unknowns of their block
        self.faults: list[str] = []

    def block(self, name: str, block: Any) -> None:
        """Take in the ports of a block, or those of a diagram as they were found inside it."""
        for port, (group, unit) in getattr(block, "interface", {}).items():
            node = (name, "?", group) if group else SI
            self.units.join((name, port), node, unit)
            if group:
                self.shared.append(((name, port), node))
            else:
                self.labels[name, port] = unit_label(unit)
        if hasattr(block, "interface"):
            return
        for side in (block.inports, block.outports):
            for port, spec in side.items():
                if not spec.unit:
                    continue
                end = (name, port)
                try:
                    sound = self._port(end, spec.unit)
                except units.UnitError as error:
                    self.faults.append(placed(f"{name}.{port}: {error}", place_of(name)))
                    continue
                if not sound:
                    self.faults.append(
                        placed(
                            f"{name}.{port} cannot have the unit '{spec.unit}' beside the block's other ports.",
                            place_of(name),
                        )
                    )

    def _port(self, end: End, unit: str) -> bool:
        match = SHARED_UNIT.fullmatch(unit)
        if match is None:
            self.labels[end] = unit
            return self.units.join(end, SI, units.parse(unit))
        unknown = (end[0], "?", match[1])
        self.shared.append((end, unknown))
        return self.units.join(end, unknown, units.parse("1" + match[2]))

    def interface(self, ends: Mapping[str, End]) -> Interface:
        """How a diagram's inputs and outputs hang together, for the diagram around it."""
        groups: dict[Any, str] = {SI: ""}
        made = {}
        for name, end in ends.items():
            root, ratio = self.units.find(end)
            made[name] = (groups.setdefault(root, f"g{len(groups)}"), ratio)
        return made

    def inlet(self, name: str, unit: str) -> None:
        """Take in an input of the diagram."""
        try:
            self.units.join(("", name), SI, units.parse(unit))
            self.labels["", name] = unit
        except units.UnitError as error:
            self.faults.append(placed(f"input '{name}': {error}", place_of(name)))

    def label(self, end: End) -> str:
        """How a message calls the unit of a port whose unit is known."""
        return self.labels.get(end) or unit_label(self.units.known(end) or DIMENSIONLESS)


def unit_faults(
    links: list[Link],
    inlets: Mapping[str, tuple[End, ...]],
    declared: Mapping[str, str],
    blocks: Mapping[str, Any],
    shown: Mapping[str, End],
) -> tuple[list[str], dict[End, units.Unit], Interface]:
    """Wires that join different units, the unit of every port that has one, and how the outer ports hang together.

    A ring in which only unknown units disagree is let pass: nobody said what they are.
    """
    survey = _Survey()
    for name, block in blocks.items():
        survey.block(name, block)
    for name, unit in declared.items():
        if unit:
            survey.inlet(name, unit)
    wires: list[Wire] = [(link.source, link.target, str(link), link.place) for link in links]
    wires += [
        (("", n), end, f"input {n} -> {'.'.join(end)}", place_of(n)) for n, ends in inlets.items() for end in ends
    ]
    wrong = [wire for wire in wires if not survey.units.join(wire[0], wire[1], DIMENSIONLESS)]
    wrong = [wire for wire in wrong if survey.units.known(wire[0]) is not None]
    ends = [*survey.labels, *(end for end, _ in survey.shared), *(e for s, t, *_ in wires for e in (s, t))]
    found = {end: known for end in ends if (known := survey.units.known(end)) is not None}
    interface = survey.interface({**{name: ("", name) for name in inlets}, **shown})
    return [*survey.faults, *_wire_faults(survey, wires, wrong)], found, interface


def _wire_faults(survey: _Survey, wires: list[Wire], wrong: list[Wire]) -> Iterator[str]:
    """A sentence for each wire that joins two units."""
    if not wrong:
        return
    sound = [(s, t) for s, t, *_ in wires if (s, t) not in {w[:2] for w in wrong}]
    beside = _neighbours([*sound, *survey.shared])
    for source, target, text, place in wrong:
        a, b = survey.label(source), survey.label(target)
        why = "".join(_reason(survey, beside, end) for end in (source, target))
        yield placed(f"{text} joins {a} to {b}.{why} {_advice(a, b)}", place)


def _neighbours(pairs: Iterable[tuple[Any, Any]]) -> dict[Any, list[Any]]:
    beside: dict[Any, list[Any]] = {}
    for a, b in pairs:
        beside.setdefault(a, []).append(b)
        beside.setdefault(b, []).append(a)
    return beside


def _reason(survey: _Survey, beside: Mapping[Any, list[Any]], end: End) -> str:
    """Where a port that declares no unit of its own has it from: the nearest port that declares one."""
    if end in survey.labels:
        return ""
    seen, queue = {end}, deque([end])
    while queue:
        node = queue.popleft()
        if node in survey.labels:
            return (
                f" {'.'.join(filter(None, end))} is in {survey.label(end)} because "
                f"{'.'.join(filter(None, node))} is in {survey.labels[node]}."
            )
        more = [n for n in beside.get(node, ()) if n not in seen]
        seen.update(more)
        queue.extend(more)
    return ""


def _advice(a: str, b: str) -> str:
    try:
        units.factor(a, b)
    except units.UnitError:
        return (
            f"{a} and {b} measure different things: correct the wire or a unit, or put a block between them "
            f"that turns one into the other, such as Gain(unit='{b}')."
        )
    return f"Put Convert(source_unit='{a}', target_unit='{b}') between them, or correct the unit of one port."


def unit_label(unit: units.Unit) -> str:
    """A readable label of a unit found by inference."""
    for label in READABLE_LABELS:
        u = units.parse(label)
        if u.dimension == unit.dimension and abs(u.factor / unit.factor - 1) < 1e-12:
            return label
    power = "*".join(k if n == 1 else f"{k}^{n}" for k, n in unit.dimension) or "1"
    return power if abs(unit.factor - 1) < 1e-12 else f"{unit.factor:g}*{power}"
