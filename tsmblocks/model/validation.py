"""Checks of a diagram: names, drivers, unconnected inputs, units.

Every fault is collected and reported once; a fault that only follows from another (a misspelt wire leaves a port
unconnected) is left out.
"""

from __future__ import annotations

import math
from collections.abc import Collection, Iterable, Iterator, Mapping
from contextlib import suppress
from typing import TYPE_CHECKING, Any

import attrs

from tsmblocks.common import units
from tsmblocks.common.errors import ParameterError, clip, in_words, near
from tsmblocks.model.block import Block
from tsmblocks.model.simulation import Simulation
from tsmblocks.model.unit_inference import Interface, unit_faults
from tsmblocks.model.values import is_reference, leaves, map_leaves
from tsmblocks.model.wires import NAME, End, Fault, Link, fault_sentence, inlet_links, parse_chain, placed, resolve

if TYPE_CHECKING:
    from tsmblocks.model.arguments import Inlet

MOST_FAULTS = 50
"""Faults of one kind after which the search for more ends: near misses take time. Chosen: more than a person reads."""

MAPPINGS = {
    "blocks": ("blocks", "'pid': PID()"),
    "inputs": ("the ports they drive", "'u': 'motor.u'"),
    "outputs": ("signals", "'x': 'motor.y'"),
    "values": ("numbers", "'theta': 5.0"),
    "output_units": ("units", "'x': 'rad'"),
}
"""Meaning of the entries of each mapping of a diagram, and an example."""


@attrs.frozen
class Checked:
    """The meaning of wires, inputs and outputs, and a sentence for each fault."""

    links: list[Link]
    inlets: dict[str, tuple[End, ...]]
    shown: dict[str, End]
    port_units: dict[End, units.Unit]
    interface: Interface
    faults: list[str]


def examine(
    blocks: Mapping[str, Any],
    wires: Any,
    inputs: Mapping[str, Inlet],
    outputs: Mapping[str, str],
    values: Mapping[str, float],
    *,
    output_units: Mapping[str, str] | None = None,
    unsure: Collection[str] = (),
    silent: bool = False,
) -> Checked:
    """Check the parts of a diagram.

    ``unsure`` names blocks whose ports, and values whose number, are unknown because they are faulty; no fault is
    reported that could follow from these. ``silent`` leaves out unconnected inputs, for use when some wires could not
    be read.
    """
    named = {"block": blocks, "input": inputs, "output": outputs, "value": values}
    faults = [fault for what, names in named.items() for fault in name_faults(names, what)]
    unsure = {*unsure, *(k for k in blocks if not _is_name(k))}
    others = dict.fromkeys(outputs, "an output of the diagram: give its signal under outputs.")
    others |= dict.fromkeys(inputs, "an input of the diagram: list the ports it drives under inputs.")
    links, bad_wires = _read_wires(wires, blocks, others)
    again = "give one of them another name."
    bad_inputs = [
        placed(f"'{k}' is both an input of the diagram and a block; {again}", k) for k in inputs if k in blocks
    ]
    inlets = {k: tuple(_ends(f"input '{k}'", v.ports, blocks, "input", bad_inputs)) for k, v in inputs.items()}
    clashing = (k for k, signal in outputs.items() if k in inputs and k != signal)
    bad_outputs = [placed(f"'{k}' is both an input and an output of the diagram; {again}", k) for k in clashing]
    shown: dict[str, End] = {}
    for name, signal in outputs.items():
        resolved = _ends(f"output '{name}'", [signal], blocks, "output", bad_outputs)
        shown.update((name, end) for end in ([("", str(signal))] if signal in inputs else resolved))
    known = {k: b for k, b in blocks.items() if k not in unsure}
    every = [*links, *inlet_links(inlets)]
    faults += [*bad_wires, *bad_inputs, *bad_outputs, *_driver_faults(every)]
    if not (silent or bad_wires or bad_inputs):  # a misspelt wire leaves a port unconnected: only that is reported
        faults += _unconnected_faults(known, {link.target for link in every})
    faults += value_faults(known, values, unsure)
    declared = {k: v.unit for k, v in inputs.items()}
    given = {k: unit for k, unit in (output_units or {}).items() if unit}
    faults += [f"output_units: there is no output '{k}'.{near(k, outputs)}" for k in given if k not in outputs]
    bad_units, port_units, interface = unit_faults(every, declared, known, shown, given)
    return Checked(links, inlets, shown, port_units, interface, [*faults, *bad_units])


def kind_faults(parts: Mapping[str, Any]) -> Iterator[str]:
    """Parts of a diagram that are no text, or no mapping, where one is needed; they are not checked further."""
    for name, given in parts.items():
        what, example = MAPPINGS.get(name, ("", ""))
        if what and not isinstance(given, Mapping):
            yield f"{name} must map names to {what}, such as {{{example}}}, got {in_words(given)}."
        elif name == "simulation":
            if not isinstance(given, Simulation):
                yield f"simulation must be a Simulation, got {in_words(given)}."
        elif not what and name != "wires" and not isinstance(given, str):
            yield f"{name} must be text, got {in_words(given)}."
        elif name == "outputs":
            yield from _signal_faults(given)


def _signal_faults(outputs: Mapping[str, Any]) -> Iterator[str]:
    """Outputs that are given as the inputs are: several in a list, or with a unit."""
    for name, signal in outputs.items():
        if isinstance(signal, (Mapping, list, set)):
            also = " Units of outputs are given by output_units." if isinstance(signal, Mapping) else ""
            yield f"output '{name}' must be a signal, such as 'plant.y', got {in_words(signal)}.{also}"


def _read_wires(wires: Any, blocks: Mapping[str, Any], others: Mapping[str, str]) -> tuple[list[Link], list[str]]:
    """Links of chains (or links that were read before), and a sentence for each fault."""
    no_list = wires_fault("wires", wires)
    if no_list:
        return [], [no_list]
    links: list[Link] = []
    faults: list[str] = []
    for wire in wires:
        if len(faults) >= MOST_FAULTS:
            break
        if isinstance(wire, Link) and _still_valid(wire, blocks):
            links.append(wire)
        elif isinstance(wire, (str, Link)):
            read, wrong = parse_chain(str(wire) if isinstance(wire, Link) else wire, blocks, others)
            links += read
            faults += [placed(fault, wire) for fault in wrong]
        else:
            faults.append(f"a wire must be text such as 'error -> pid', got {in_words(wire)}.")
    return links, faults


def wires_fault(name: str, given: Any) -> str:
    """The fault of ``given`` as a list of chains, ``""`` if there is none; ``name`` is that of the argument."""
    if not isinstance(given, str):
        with suppress(TypeError):
            iter(given)
            return ""
    one = "one text, " if isinstance(given, str) else ""
    return f"{name} must be a list of chains such as ['error -> pid'], got {one}{in_words(given)}."


def _still_valid(link: Link, blocks: Mapping[str, Any]) -> bool:
    """Whether a link that was read before still joins two ports (its blocks may have changed)."""
    (source, out), (target, into) = link.source, link.target
    return source in blocks and target in blocks and out in blocks[source].outports and into in blocks[target].inports


def _is_name(name: Any) -> bool:
    return isinstance(name, str) and NAME.fullmatch(name) is not None


def name_faults(names: Mapping[str, Any], what: str) -> Iterator[str]:
    """Names that wire notation cannot hold."""
    for name in names:
        if not _is_name(name):
            wrong = (
                f"{what} name {clip(str(name))!r} must be letters, digits and underscores, not starting with a digit."
            )
            yield placed(wrong, name)


def _ends(place: str, texts: Iterable[str], blocks: Mapping[str, Any], side: str, faults: list[str]) -> Iterator[End]:
    """The ports that texts refer to, on one side of the blocks; faults are added to a list, ``MOST_FAULTS`` at most."""
    for text in texts:
        if len(faults) >= MOST_FAULTS:
            return
        try:
            yield resolve(text, blocks, side)
        except Fault as fault:
            faults.append(placed(fault_sentence(place, fault), text))


def _driver_faults(links: Iterable[Link]) -> Iterator[str]:
    """Ports with several drivers."""
    drivers: dict[End, list[Link]] = {}
    for link in links:
        drivers.setdefault(link.target, []).append(link)
    for end, writers in drivers.items():
        if len(writers) > 1:
            texts = [str(link) for link in writers]
            advice = "Leave out all but one." if len(set(texts)) == 1 else "Join them with a Sum block."
            wrong = f"{'.'.join(end)} is driven {len(writers)} times: {'; '.join(texts)}. {advice}"
            yield placed(wrong, writers[-1])


def _unconnected_faults(blocks: Mapping[str, Any], driven: Collection[End]) -> Iterator[str]:
    """Input ports without a driver."""
    for name, block in blocks.items():
        for port, spec in block.inports.items():
            if (name, port) not in driven and not getattr(spec, "rate_of", ""):
                unit = f" [{spec.unit}]" if spec.unit and "?" not in spec.unit else ""
                about = f" It is: {spec.about}{unit}." if spec.about else ""
                wrong = f"{name}.{port} ({type(block).__name__}) is driven by nothing.{about}"
                yield placed(f"{wrong} Wire it, list it under inputs, or drive it with a Constant.", name)


def value_faults(blocks: Mapping[str, Any], values: Mapping[str, float], unsure: Collection[str]) -> Iterator[str]:
    """References to numbers that are not in the table, and referenced numbers that a block refuses.

    Numbers named in ``unsure`` exist, and are not judged.
    """
    for key, value in values.items():
        if not _is_value(value):
            yield placed(f"value '{key}' must be a number, got {in_words(value)}.", key)
    for name, block in blocks.items():
        if not isinstance(block, Block):
            continue
        used = {k: v for k, v in block.parameters.items() if any(is_reference(x) for _, x in leaves(v))}
        wanted = {x[1:] for v in used.values() for _, x in leaves(v) if is_reference(x)}
        missing = wanted - set(values) - set(unsure)
        for key in sorted(missing)[:MOST_FAULTS]:
            yield placed(f"{name}: '${clip(key)}' refers to a number that is not in values.{near(key, values)}", name)
        if used and not wanted & set(unsure) and not missing and all(_is_value(values[k]) for k in wanted):
            try:
                block.replace(
                    **{k: map_leaves(lambda _, x: values[x[1:]] if is_reference(x) else x, v) for k, v in used.items()}
                )
            except ParameterError as error:
                numbers = ", ".join(f"{k} = {values[k]:g}" for k in sorted(wanted))
                yield placed(f"{name}: {error} From values: {numbers}.", name)


def _is_value(value: Any) -> bool:
    return isinstance(value, float) and not math.isnan(value)
