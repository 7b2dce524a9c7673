"""Units of ports, and wires that join different ones. A port without a declared unit takes that of its wires.

The unit of a port is a known label, or a power of s times an unknown that some ports share. Blocks for any unit (a sum,
an integrator) pass units on, so a mismatch is found across them too.
"""

from __future__ import annotations

import re
from collections import defaultdict, deque
from collections.abc import Iterator, Mapping
from typing import Any

from tsmblocks.common import units
from tsmblocks.model.wires import End, Link, end_text, inlet_links, placed

Interface = dict[str, tuple[str, units.Unit]]
"""Port -> the group of ports that share its unknown unit ("" where it is known), and its unit or power in the group."""
SHARED_UNIT = re.compile(r"\?(\w+?)((?:[*/].*)?)")
"""A unit that ports of a block share: a letter, times a known unit."""
RATIO_OF_UNITS = re.compile(r"\?(\w+)/\?(\w+)")
"""The unit of a factor between two ports: the letter of one over that of another."""
READABLE_LABELS = (  # noqa: SIM905
    "1 rad deg rad/s deg/s rad/s^2 deg/s^2 rad*s deg*s mrad mrad/s rev rev/s V A N N*m m m/s m/s^2 m*s mm mm/s s 1/s "
    "1/s^2 ms V*s V/s mV mA K kg N/m N*s/m N*m/rad rad/V "
    "N kN N*m/A Pa kPa MPa bar in ft lbf psi m/V N/V N/rad"
).split()
"""Labels tried first for an inferred unit."""
DIMENSIONLESS = units.Unit(1.0, ())
OUTPUT_ADVICE = (
    "Correct the unit of the output or leave it out: recordings in other units are converted when they are read."
)
"""The remedy where the declared unit of an output made a wire join two units."""
SI: Any = "SI"
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
            return _equal(_times(fa, fb, -1), ratio)
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


def _equal(a: units.Unit, b: units.Unit) -> bool:
    """Whether two units are the same, up to rounding."""
    return a.dimension == b.dimension and abs(a.factor / b.factor - 1) < 1e-12


class _Survey:
    """The declared units of the ports of a diagram, and which ports share one."""

    def __init__(self) -> None:
        self.units = _Units()
        self.labels: dict[End, str] = {}  # declared
        self.shared: list[tuple[Any, Any]] = []  # ports and the unknowns of their block
        self.faults: list[str] = []
        self.outlets: dict[End, str] = {}  # ports whose unit is that of an output of the diagram -> the output

    def block(self, name: str, block: Any) -> None:
        """Add the ports of a block, or those of an inner diagram as they were inferred inside it."""
        if hasattr(block, "interface"):
            for port, (group, unit) in block.interface.items():
                node = (name, "?", group) if group else SI
                self.units.join((name, port), node, unit)
                if group:
                    self.shared.append(((name, port), node))
                else:
                    self.labels[name, port] = unit_label(unit)
            return
        for port, spec in (*block.inports.items(), *block.outports.items()):
            if spec.unit:
                self._port((name, port), spec.unit)

    def _port(self, end: End, unit: str) -> None:
        """Add a port with a declared unit."""
        name, node, known = end[0], SI, unit
        if match := SHARED_UNIT.fullmatch(unit):
            node, known = (name, "?", match[1]), "1" + match[2]
            self.shared.append((end, node))
        else:
            self.labels[end] = unit
        try:
            if not self.units.join(end, node, units.parse(known)):
                wrong = f"{'.'.join(end)} cannot have the unit '{unit}' beside the block's other ports."
                self.faults.append(placed(wrong, name))
        except units.UnitError as error:
            self.faults.append(placed(f"{'.'.join(end)}: {error}", name))

    def interface(self, ends: Mapping[str, End]) -> Interface:
        """Which inputs and outputs of the diagram share a unit, for the diagram around it."""
        groups: dict[Any, str] = {SI: ""}
        interface = {}
        for name, end in ends.items():
            root, ratio = self.units.find(end)
            interface[name] = (groups.setdefault(root, f"g{len(groups)}"), ratio)
        return interface

    def inlet(self, name: str, unit: str) -> None:
        """Add an input of the diagram."""
        try:
            self.units.join(("", name), SI, units.parse(unit))
            self.labels["", name] = unit
        except units.UnitError as error:
            self.faults.append(placed(f"input '{name}': {error}", name))

    def outlet(self, name: str, end: End, unit: str) -> None:
        """Add the declared unit of an output of the diagram, which shows the signal of a port."""
        try:
            if not self.units.join(end, SI, units.parse(unit)):
                other = f"output '{name}' is declared in {unit}, and its signal is in {self.label(end)}."
                self.faults.append(placed(other, name))
            if end not in self.labels:
                self.labels[end], self.outlets[end] = unit, name
        except units.UnitError as error:
            self.faults.append(placed(f"output '{name}': {error}", name))

    def label(self, end: End) -> str:
        """The label of a port whose unit is known."""
        return self.labels.get(end) or unit_label(self.units.known(end) or DIMENSIONLESS)


def unit_faults(
    links: list[Link],
    declared: Mapping[str, str],
    blocks: Mapping[str, Any],
    shown: Mapping[str, End],
    output_units: Mapping[str, str],
) -> tuple[list[str], dict[End, units.Unit], Interface]:
    """Faults of links that join different units, the unit of every port that has one, and the interface.

    ``links`` include those from the inputs of the diagram, whose ``declared`` units are given by name, as are
    ``output_units``. A ring in which
    only unknown units disagree is accepted, since none of its units is declared.
    """
    survey = _Survey()
    for name, block in blocks.items():
        survey.block(name, block)
    for name, unit in declared.items():
        if unit:
            survey.inlet(name, unit)
    for name, unit in output_units.items():
        if name in shown:
            survey.outlet(name, shown[name], unit)
    contradicting = [x for x in links if not survey.units.join(x.source, x.target, DIMENSIONLESS)]
    wrong = [x for x in contradicting if survey.units.known(x.source) is not None]
    ends = [*survey.labels, *(end for end, _ in survey.shared), *(end for x in links for end in (x.source, x.target))]
    port_units = {end: known for end in ends if (known := survey.units.known(end)) is not None}
    interface = survey.interface({**{name: ("", name) for name in declared}, **shown})
    return [*survey.faults, *_link_faults(survey, links, wrong)], port_units, interface


def units_inside(blocks: Mapping[str, Any], known: Mapping[End, units.Unit]) -> dict[End, units.Unit]:
    """Units inside the diagrams among ``blocks`` that follow from the ``known`` units of their inputs and outputs.

    The port of an end of the result is ``inner.port``, seen from the diagram around it.
    """
    result = dict[End, units.Unit]()
    for name, inner in blocks.items():
        unknown = [port for port, (group, _) in getattr(inner, "interface", {}).items() if group]
        given = {port: unit_label(known[name, port]) for port in unknown if (name, port) in known}
        if given:
            declared = {port: given.get(port, inlet.unit) for port, inlet in inner.inputs.items()}
            shown = {**inner.output_units, **given}
            _, own, _ = unit_faults(
                [*inner.links, *inlet_links(inner.inlets)], declared, inner.blocks, inner.shown, shown
            )
            own |= units_inside(inner.blocks, own)
            result |= {(name, ".".join(end)): unit for end, unit in own.items() if end[0]}
    return result


def _link_faults(survey: _Survey, links: list[Link], wrong: list[Link]) -> Iterator[str]:
    """A sentence for each link that joins two units."""
    if not wrong:
        return
    bad = set(wrong)
    beside = defaultdict[Any, list[Any]](list)
    for a, b in (*((x.source, x.target) for x in links if x not in bad), *survey.shared):
        beside[a].append(b)
        beside[b].append(a)
    for link in wrong:
        source, target = survey.label(link.source), survey.label(link.target)
        origins = {end: _origin(survey, beside, end) for end in (link.source, link.target)}
        why = "".join(_reason(survey, end, origin) for end, origin in origins.items())
        by_output = any(origin in survey.outlets for origin in origins.values())
        advice = OUTPUT_ADVICE if by_output else _advice(source, target)
        yield placed(f"{link} joins {source} to {target}.{why} {advice}", link)


def _origin(survey: _Survey, beside: Mapping[Any, list[Any]], end: End) -> Any:
    """The nearest port with a declared unit, from which a port has its own; the port itself where none is known."""
    seen, queue = {end}, deque([end])
    while queue:
        node = queue.popleft()
        if node in survey.labels:
            return node
        more = [n for n in beside.get(node, ()) if n not in seen]
        seen.update(more)
        queue.extend(more)
    return end


def _reason(survey: _Survey, end: End, origin: Any) -> str:
    """A sentence on where a port has its unit from, unless that is its own declaration."""
    if origin in survey.outlets:
        output, unit = survey.outlets[origin], survey.labels[origin]
        return f" {end_text(end)} is in {survey.label(end)} because output '{output}' is declared in {unit}."
    if origin == end:
        return ""
    return f" {end_text(end)} is in {survey.label(end)} because {end_text(origin)} is in {survey.labels[origin]}."


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


THEN = ("", "/s", "/s^2", "*s", "/min", "/h", "*s/min", "*s/h", "/(min*s)", "/(h*s)")
"""What a readable label of an inferred unit may have behind a name: rates, and rates of flows."""


def unit_label(unit: units.Unit) -> str:
    """A readable label of an inferred unit."""
    for label in READABLE_LABELS:
        if _equal(units.parse(label), unit):
            return label
    for then in THEN:  # watts are not newton metres in a second
        for label in (f"{name}{then}" for name in units.NAMES):
            if _equal(units.parse(label), unit):
                return label
    power = "*".join(k if n == 1 else f"{k}^{n}" for k, n in unit.dimension) or "1"
    return power if abs(unit.factor - 1) < 1e-12 else f"{unit.factor:.15g}*{power}"
