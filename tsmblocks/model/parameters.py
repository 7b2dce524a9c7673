"""Parameters of a diagram by name: a dot reaches into diagrams, a bracket into lists."""

from __future__ import annotations

import functools
from collections.abc import Iterable, Iterator, Mapping
from typing import TYPE_CHECKING, Any

from tsmblocks.common.errors import DiagramError, ParameterError, in_words, near
from tsmblocks.common.kept import KeptFor
from tsmblocks.model.aliases import field_hint
from tsmblocks.model.block import Block
from tsmblocks.model.validation import value_faults
from tsmblocks.model.values import is_reference, leaves, map_leaves, plain

if TYPE_CHECKING:
    from tsmblocks.model.diagram import Diagram


@KeptFor
def _numbers_of(block: Block) -> dict[str, float]:
    """The numbers of a block's parameters by name, without references."""
    return {k: x for name, value in block.parameters.items() for k, x in leaves(value, name) if not is_reference(x)}


def numbers(diagram: Diagram) -> dict[str, float]:
    """See Diagram.parameters."""
    made = {k: x for name, value in diagram.values.items() for k, x in leaves(value, name) if not is_reference(x)}
    for name, block in diagram.blocks.items():  # this is asked for at every run with other numbers
        own = _numbers_of(block) if isinstance(block, Block) else block.parameters
        made |= {f"{name}.{key}": value for key, value in own.items()}
    return made


def _entries(diagram: Diagram, prefix: str = "") -> Iterator[tuple[Diagram, str, str, Any]]:
    """The diagram, full name, kind and value of each number in a table and each field of a block, at any depth."""
    for name, value in diagram.values.items():
        yield diagram, prefix + name, "value", value
    for name, block in diagram.blocks.items():
        if isinstance(block, Block):
            for key, field in block.fields().items():
                yield diagram, f"{prefix}{name}.{key}", field.kind, getattr(block, key)
        else:
            yield from _entries(block, f"{prefix}{name}.")


def names(diagram: Diagram) -> Iterator[str]:
    """See Diagram.parameter_names."""
    for _, name, _, value in _entries(diagram):
        yield name
        if isinstance(value, tuple):
            yield from (leaf for leaf, _ in leaves(value, name))


def referred(diagram: Diagram, wanted: Iterable[str]) -> dict[str, Any]:
    """Present values of those of the wanted parameters that refer to the ``values`` table, by full name."""
    wanted = set(wanted)
    return {
        leaf: owner.values[x[1:]]
        for owner, name, kind, value in _entries(diagram)
        if kind != "option"
        for leaf, x in leaves(value, name)
        if leaf in wanted and is_reference(x)
    }


def changed(diagram: Diagram, changes: Mapping[str, Any]) -> Diagram:
    """See Diagram.with_parameters."""
    if not isinstance(changes, Mapping) or not all(isinstance(name, str) for name in changes):
        raise ParameterError(f"parameters must map names to numbers, got {in_words(changes)}.")
    made = _changed(diagram, changes, diagram)
    return made.with_simulation(diagram.simulation.without(changes)) if diagram.simulation.start else made


def _changed(diagram: Diagram, changes: Mapping[str, Any], whole: Diagram, prefix: str = "") -> Diagram:
    """A diagram with other parameters; ``whole`` is the outermost diagram, ``prefix`` the path from it."""
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
            blocks[name] = _changed(block, part, whole, f"{prefix}{name}.")
            continue
        try:
            blocks[name] = _with_fields(block, part)
        except ParameterError as error:
            raise ParameterError(f"{prefix}{name}: {error}") from None
    if not all(_same_ports(diagram.blocks[name], blocks[name]) for name in grouped):
        return diagram._with(blocks=blocks, values=values)
    made = diagram._with_numbers(blocks, values)
    others = {name: block for name, block in blocks.items() if block is not diagram.blocks[name]}
    judged = blocks if made.values != diagram.values else others
    if faults := list(value_faults(judged, made.values, ())):
        raise DiagramError(diagram.title, faults, diagram.where)
    return made


def _same_ports(old: Any, new: Any) -> bool:
    """Whether a block with other values has the same ports, so that wires and units mean the same."""
    if not isinstance(old, Block):
        return old.interface is new.interface  # kept by ``_with_numbers``
    return bool(old.inports == new.inports and old.outports == new.outports)


def _with_fields(block: Block, part: Mapping[str, Any]) -> Block:
    """A block with fields, or single elements of them (``den[1]``), changed."""
    changes: dict[str, Any] = {}
    owner = type(block).__name__
    for key, value in part.items():
        name, bracket, _ = key.partition("[")
        if name not in block.fields():
            raise ParameterError(f"{owner} has no parameter '{key}'.{field_hint(key, block.fields())}")
        if not bracket:
            changes[name] = plain(value)
            continue
        whole = changes.get(name, getattr(block, name))
        known = dict(leaves(whole, name))
        if name in known:
            raise ParameterError(f"{owner}.{name} is one number, so there is no '{key}'.")
        if key not in known:
            raise ParameterError(f"{owner} has no element '{key}'.{near(key, known)}")
        changes[name] = map_leaves(functools.partial(_replaced, key, value), whole, name)
    return block.replace(**changes)


def _replaced(key: str, value: Any, leaf: str, old: Any) -> Any:
    return value if leaf == key else old


def near_path(name: str, known: Iterable[str]) -> str:
    """Near misses of a dotted name; for one without a dot, the names that end in it come first."""
    known = list(dict.fromkeys(known))
    hint = near(name, known)
    tail = [k for k in known if k.rpartition(".")[2] == name.rpartition(".")[2]]
    if tail and ("." not in name or not hint.startswith(" Did you mean")):
        return f" Did you mean {' or '.join(repr(k) for k in tail[:3])}?"
    return hint
