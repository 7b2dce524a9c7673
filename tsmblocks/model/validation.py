"""Checks of a diagram: names, drivers, unconnected inputs, units.

Every fault is collected and reported once; a fault that only follows from another (a misspelt wire leaves a port
unconnected) is left out.
"""

from __future__ import annotations

import math
from collections.abc import Collection, Iterable, Iterator, Mapping
from typing import TYPE_CHECKING, Any

import attrs

from tsmblocks.common import units
from tsmblocks.common.errors import clip, in_words, near
from tsmblocks.model.unit_inference import Interface, unit_faults
from tsmblocks.model.wires import NAME, Fault, Link, class_name, fault_sentence, parse_chain, place_of, placed, resolve

if TYPE_CHECKING:
    from tsmblocks.model.diagram import Inlet

End = tuple[str, str]
MOST_FAULTS = 50
"""Faults of one kind after which the search for more ends: near misses take time. Chosen: more than a person reads."""


MAPPINGS = {
    "blocks": ("blocks", "'pid': PID()"),
    "inputs": ("the ports they drive", "'u': 'motor.u'"),
    "outputs": ("signals", "'x': 'motor.y'"),
    "values": ("numbers", "'theta': 5.0"),
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
    unsure: Collection[str] = (),
    silent: bool = False,
) -> Checked:
    """Check the parts of a diagram.

    ``unsure`` names blocks whose ports, and values whose number, are unknown because they are faulty; no fault is
    reported that could follow from these. ``silent`` leaves out unconnected inputs, for use when some wires could not
    be read.
    """
    faults = [
        *name_faults(blocks, "block"),
        *name_faults(inputs, "input"),
        *name_faults(outputs, "output"),
        *name_faults(values, "value"),
    ]
    unsure = {*unsure, *(k for k in blocks if not _is_name(k))}
    links, bad_wires = read_wires(wires, blocks, inputs, outputs)
    inlets, bad_inputs = resolve_inlets(inputs, blocks)
    shown, bad_outputs = resolve_outputs(outputs, blocks, inputs)
    echoes = silent or bool(
        bad_wires or bad_inputs
    )  # a misspelt wire leaves a port unconnected: only the spelling is reported
    known = {k: b for k, b in blocks.items() if k not in unsure}
    faults += [*bad_wires, *bad_inputs, *bad_outputs]
    faults += driver_faults(links, inlets, known, silent=echoes)
    faults += value_faults(known, values, unsure)
    declared = {k: v.unit for k, v in inputs.items()}
    bad_units, found, interface = unit_faults(links, inlets, declared, known, shown)
    return Checked(links, inlets, shown, found, interface, [*faults, *bad_units])


def kind_faults(parts: Mapping[str, Any]) -> Iterator[str]:
    """Parts of a diagram that are no text, or no mapping, where one is needed; they are not checked further."""
    for name, given in parts.items():
        what, example = MAPPINGS.get(name, ("", ""))
        if what and not isinstance(given, Mapping):
            yield f"{name} must map names to {what}, such as {{{example}}}, got {in_words(given)}."
        elif not what and name != "wires" and not isinstance(given, str):
            yield f"{name} must be text, got {in_words(given)}."


def read_wires(
    wires: Any, blocks: Mapping[str, Any], inputs: Collection[str] = (), outputs: Collection[str] = ()
) -> tuple[list[Link], list[str]]:
    """Links of chains (or links that were read before), and a sentence for each fault."""
    no_list = wires_fault("wires", wires)
    if no_list:
        return [], [no_list]
    links: list[Link] = []
    faults: list[str] = []
    for text in wires:
        if len(faults) >= MOST_FAULTS:
            break
        if isinstance(text, Link) and _still_valid(text, blocks):
            links.append(text)
            continue
        if not isinstance(text, (str, Link)):
            faults.append(f"a wire must be text such as 'error -> pid', got {in_words(text)}.")
            continue
        found, wrong = parse_chain(str(text) if isinstance(text, Link) else text, blocks)
        links += found
        faults += [placed(_instead(fault, inputs, outputs), place_of(text)) for fault in wrong]
    return links, faults


def wires_fault(name: str, given: Any) -> str:
    """What is wrong with ``given`` as a list of chains, ``""`` if nothing is; ``name`` is that of the argument."""
    if isinstance(given, Iterable) and not isinstance(given, str):
        return ""
    one = "one text, " if isinstance(given, str) else ""
    return f"{name} must be a list of chains such as ['error -> pid'], got {one}{in_words(given)}."


def _still_valid(link: Link, blocks: Mapping[str, Any]) -> bool:
    """Whether a link that was read before still joins two ports (its blocks may have changed)."""
    (source, out), (target, into) = link.source, link.target
    return source in blocks and target in blocks and out in blocks[source].outports and into in blocks[target].inports


def _instead(fault: str, inputs: Collection[str], outputs: Collection[str]) -> str:
    """The fault, or the correct form where an input or output of the diagram was taken for a block."""
    wire, names, rest = fault.partition(" names block '")
    name = rest.partition("'")[0]
    if names and name in inputs:
        return f"{wire} names '{name}', which is an input of the diagram: list the ports it drives under inputs."
    if names and name in outputs:
        return f"{wire} names '{name}', which is an output of the diagram: say under outputs what it shows."
    return fault


def _is_name(name: Any) -> bool:
    return isinstance(name, str) and NAME.fullmatch(name) is not None


def name_faults(names: Mapping[str, Any], what: str) -> Iterator[str]:
    """Names that wire notation cannot hold."""
    for name in names:
        if not _is_name(name):
            yield placed(
                f"{what} name {clip(str(name))!r} must be letters, digits and underscores, not starting with a digit.",
                place_of(name),
            )


def resolve_inlets(
    inlets: Mapping[str, Inlet], blocks: Mapping[str, Any]
) -> tuple[dict[str, tuple[End, ...]], list[str]]:
    """The ports that each input of the diagram drives, and a sentence for each fault."""
    found: dict[str, tuple[End, ...]] = {}
    faults: list[str] = []
    for name, inlet in inlets.items():
        ends = []
        if name in blocks:
            faults.append(
                placed(
                    f"'{name}' is both an input of the diagram and a block; give one of them another name.",
                    place_of(name),
                )
            )
        for port in inlet.ports:
            if len(faults) >= MOST_FAULTS:
                break
            try:
                ends.append(resolve(port, blocks, "input"))
            except Fault as fault:
                faults.append(placed(fault_sentence(f"input '{name}'", fault), place_of(port)))
        found[name] = tuple(ends)
    return found, faults


def resolve_outputs(
    outputs: Mapping[str, str], blocks: Mapping[str, Any], inputs: Mapping[str, Any]
) -> tuple[dict[str, End], list[str]]:
    """The signal of each output, and a sentence for each fault; ``("", name)`` is an input passed through."""
    found: dict[str, End] = {}
    faults: list[str] = []
    for name, signal in outputs.items():
        if len(faults) >= MOST_FAULTS:
            break
        if name in inputs and name != signal:
            faults.append(
                placed(
                    f"'{name}' is both an input and an output of the diagram; give one of them another name.",
                    place_of(name),
                )
            )
        if signal in inputs:
            found[name] = ("", str(signal))
            continue
        try:
            found[name] = resolve(signal, blocks, "output")
        except Fault as fault:
            faults.append(placed(fault_sentence(f"output '{name}'", fault), place_of(signal)))
    return found, faults


def driver_faults(
    links: list[Link], inlets: Mapping[str, tuple[End, ...]], blocks: Mapping[str, Any], silent: bool
) -> Iterator[str]:
    """Inputs with several drivers, and (unless ``silent``) inputs with none."""
    driven: dict[End, list[tuple[str, str]]] = {}
    for link in links:
        driven.setdefault(link.target, []).append((str(link), link.place))
    for name, ends in inlets.items():
        for end in ends:
            driven.setdefault(end, []).append((f"input {name} -> {'.'.join(end)}", place_of(name)))
    for end, writers in driven.items():
        if len(writers) > 1:
            texts = "; ".join(text for text, _ in writers)
            same = len({text for text, _ in writers}) == 1
            advice = "Leave out all but one." if same else "Join them with a Sum block."
            yield placed(f"{'.'.join(end)} is driven {len(writers)} times: {texts}. {advice}", writers[-1][1])
    if silent:
        return
    for name, block in blocks.items():
        for port, spec in block.inports.items():
            if (name, port) not in driven and not getattr(spec, "rate_of", ""):
                unit = f" [{spec.unit}]" if spec.unit and "?" not in spec.unit else ""
                about = f" It is: {spec.about}{unit}." if spec.about else ""
                yield placed(
                    f"{name}.{port} ({class_name(block)}) is driven by nothing.{about} "
                    f"Wire it, list it under inputs, or drive it with a Constant.",
                    place_of(name),
                )


def value_faults(blocks: Mapping[str, Any], values: Mapping[str, float], unsure: Collection[str] = ()) -> Iterator[str]:
    """References to numbers that are not in the table, and referenced numbers that a block refuses.

    Numbers named in ``unsure`` exist, and are not judged.
    """
    from tsmblocks.common.errors import ParameterError
    from tsmblocks.model.block import Block, is_reference, leaves, map_leaves

    for key, value in values.items():
        if not _is_value(value):
            yield placed(f"value '{key}' must be a number, got {in_words(value)}.", place_of(key))
    for name, block in blocks.items():
        if not isinstance(block, Block):
            continue
        used = {k: v for k, v in block.parameters.items() if any(is_reference(x) for _, x in leaves(v))}
        wanted = {x[1:] for v in used.values() for _, x in leaves(v) if is_reference(x)}
        missing = wanted - set(values) - set(unsure)
        place = place_of(name)
        for key in sorted(missing)[:MOST_FAULTS]:
            yield placed(f"{name}: '${clip(key)}' refers to a number that is not in values.{near(key, values)}", place)
        if used and not wanted & set(unsure) and not missing and all(_is_value(values[k]) for k in wanted):
            try:
                block.replace(
                    **{k: map_leaves(lambda _, x: values[x[1:]] if is_reference(x) else x, v) for k, v in used.items()}
                )
            except ParameterError as error:
                said = ", ".join(f"{k} = {values[k]:g}" for k in sorted(wanted))
                yield placed(f"{name}: {error} From values: {said}.", place)


def _is_value(value: Any) -> bool:
    return isinstance(value, float) and not math.isnan(value)
