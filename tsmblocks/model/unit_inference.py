"""Units of ports, and wires that join different ones. A port without a declared unit takes that of its wires.

The unit of a port is a known label, or a power of s times an unknown that some ports share. Blocks for any unit (a sum,
an integrator) pass units on, so a mismatch is found across them too.
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
"""A unit that ports of a block share: a letter, times a known unit."""
READABLE_LABELS = (  # noqa: SIM905
    "1 rad deg rad/s deg/s rad/s^2 deg/s^2 rad*s deg*s mrad mrad/s rev rev/s V A N N*m m m/s m/s^2 m*s mm mm/s s 1/s "
    "1/s^2 ms V*s V/s mV mA K kg N/m N*s/m N*m/rad rad/V"
).split()
"""Labels tried first for an inferred unit."""
DIMENSIONLESS = units.Unit(1.0, ())
SI = "SI"
"""The node of pure numbers, which every known unit is related to."""


class _Units:
    """Union-find over ports whose edges carry a factor: ``unit(a) = ratio * unit(b)``.

    A node is a port, an unknown of a block, or ``SI``. The ratio is a (factor, dimension) pair, so that two paths to
    one node can be compared.
    """

    def __init__(self) -> None:
        self.parent: dict[Any, tuple[Any, units.Unit]] = {}

    def find(self, node: Any) -> tuple[Any, units.Unit]:
        """The root of a node and unit(node)/unit(root); the path is shortened for the next call."""
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
        """State unit(a) = ratio * unit(b); False when that contradicts earlier statements."""
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
    """The product of a unit and a power of another."""
    if b == DIMENSIONLESS:
        return a
    total = dict(a.dimension)
    for key, n in b.dimension:
        total[key] = total.get(key, 0) + power * n
    return units.Unit(a.factor * b.factor**power, tuple(sorted((k, n) for k, n in total.items() if n)))


class _Survey:
    """The declared units of the ports of a diagram, and which ports share one."""

    def __init__(self) -> None:
        self.units = _Units()
        self.labels: dict[End, str] = {}  # declared
        self.shared: list[tuple[Any, Any]] = []  # ports and the unknowns of their block
        self.faults: list[str] = []

    def block(self, name: str, block: Any) -> None:
        """Add the ports of a block, or those of an inner diagram as they were inferred inside it."""
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
        """Add one port; False when its unit contradicts the other ports of the block."""
        match = SHARED_UNIT.fullmatch(unit)
        if match is None:
            self.labels[end] = unit
            return self.units.join(end, SI, units.parse(unit))
        unknown = (end[0], "?", match[1])
        self.shared.append((end, unknown))
        return self.units.join(end, unknown, units.parse("1" + match[2]))

    def interface(self, ends: Mapping[str, End]) -> Interface:
        """Which inputs and outputs of the diagram share a unit, for the diagram around it."""
        groups: dict[Any, str] = {SI: ""}
        made = {}
        for name, end in ends.items():
            root, ratio = self.units.find(end)
            made[name] = (groups.setdefault(root, f"g{len(groups)}"), ratio)
        return made

    def inlet(self, name: str, unit: str) -> None:
        """Add an input of the diagram."""
        try:
            self.units.join(("", name), SI, units.parse(unit))
            self.labels["", name] = unit
        except units.UnitError as error:
            self.faults.append(placed(f"input '{name}': {error}", place_of(name)))

    def label(self, end: End) -> str:
        """The label of a port whose unit is known."""
        return self.labels.get(end) or unit_label(self.units.known(end) or DIMENSIONLESS)


def unit_faults(
    links: list[Link],
    inlets: Mapping[str, tuple[End, ...]],
    declared: Mapping[str, str],
    blocks: Mapping[str, Any],
    shown: Mapping[str, End],
) -> tuple[list[str], dict[End, units.Unit], Interface]:
    """Faults of wires that join different units, the unit of every port that has one, and the interface.

    A ring in which only unknown units disagree is accepted, since none of its units is declared.
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
    """The nearest port with a declared unit, from which a port without one has its unit, as a sentence."""
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
    """The remedy for a wire that joins two units."""
    try:
        units.factor(a, b)
    except units.UnitError:
        return (
            f"{a} and {b} measure different things: correct the wire or a unit, or put a block between them "
            f"that turns one into the other, such as Gain(unit='{b}')."
        )
    return f"Put Convert(source_unit='{a}', target_unit='{b}') between them, or correct the unit of one port."


def unit_label(unit: units.Unit) -> str:
    """A readable label of an inferred unit."""
    for label in READABLE_LABELS:
        u = units.parse(label)
        if u.dimension == unit.dimension and abs(u.factor / unit.factor - 1) < 1e-12:
            return label
    power = "*".join(k if n == 1 else f"{k}^{n}" for k, n in unit.dimension) or "1"
    return power if abs(unit.factor - 1) < 1e-12 else f"{unit.factor:g}*{power}"
