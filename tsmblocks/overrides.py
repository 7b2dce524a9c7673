"""How numbers of a diagram are changed by name: a dot reaches into diagrams, a bracket into lists."""

from __future__ import annotations

from collections.abc import Iterable, Mapping
from typing import Any

from tsmblocks.block import Block, leaves, plain
from tsmblocks.diagram import Diagram
from tsmblocks.errors import ParameterError, near


def overridden(diagram: Diagram, changes: Mapping[str, Any], whole: Diagram, prefix: str) -> Diagram:
    """See Diagram.with_parameters; ``whole`` is the diagram that was asked, ``prefix`` the way here."""
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
        if isinstance(block, Diagram):
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
    """Near misses of a dotted name; of one without a dot, those that end in it come first."""
    known = list(known)
    hint = near(name, known)
    tail = [k for k in known if k.rpartition(".")[2] == name.rpartition(".")[2]]
    if tail and ("." not in name or not hint.startswith(" Did you mean")):
        return f" Did you mean {' or '.join(repr(k) for k in tail[:3])}?"
    return hint
