"""Which parameters of a diagram a fit estimates, from which start and between which bounds."""

from __future__ import annotations

import math
from collections.abc import Collection, Iterable, Iterator, Mapping, Sequence
from fnmatch import fnmatchcase
from typing import Any

import attrs

from tsmblocks.common import arguments
from tsmblocks.common.errors import ParameterError, in_words
from tsmblocks.fitting.parameter_vector import Unknown
from tsmblocks.model.block import Field, is_reference, leaves
from tsmblocks.model.diagram import Diagram
from tsmblocks.model.parameter_units import unit_of
from tsmblocks.model.parameters import near_path

FAR = 1e100
"""A bound beyond this counts as none. Chosen."""
MARGIN = 1e-9
"""How far inside an excluded bound a fit stays, relative to the parameter. Chosen."""


def declarations(diagram: Diagram, prefix: str = "") -> Iterator[tuple[str, Field, str]]:
    """Every single number of a diagram: its full name, its declaration, and the shared number it refers to.

    What belongs to a term that is switched off, as the derivative filter of a PI controller, counts as known, and so
    does what is a definition: the gain of 1 from a speed to the position.
    """
    for name, block in diagram.blocks.items():
        if isinstance(block, Diagram):
            yield from declarations(block, f"{prefix}{name}.")
            continue
        fields, given = block.fields(), block.parameters
        for key, value in given.items():
            field = fields[key]
            off = bool(field.factor) and given[field.factor] == 0
            if off or (value == field.by_definition is not None and diagram.unit(f"{name}.u")):
                field = attrs.evolve(field, known=True)
            for leaf, number in leaves(value, f"{prefix}{name}.{key}"):
                yield leaf, field, prefix + number[1:] if is_reference(number) else ""


def numbers(diagram: Diagram) -> dict[str, list[Field]]:
    """Names that may be freed, each with the declarations that bind it (a shared number has several)."""
    found: dict[str, list[Field]] = {}
    for name, field, shared in declarations(diagram):
        found[name] = [field]
        if shared:
            found.setdefault(shared, []).append(field)
    for name in diagram.parameters:
        found.setdefault(name, [])
    return found


def chosen(diagram: Diagram, patterns: Iterable[str] | None, what: str = "free") -> list[str]:
    """Parameters named by patterns (``tsm.*``, ``offset.bias``), in the diagram's order.

    Without patterns: all but initial states, parameters that are ``known`` by declaration, those of terms that are
    switched off, and those that are what they are by definition. Raises ParameterError for a pattern that matches
    nothing.
    """
    known = numbers(diagram)
    endless = {name for name, value in diagram.parameters.items() if not math.isfinite(value)}  # limits that never act
    if patterns is None:
        return [name for name in diagram.parameters if name not in endless and not _is_set(known[name])]
    found: set[str] = set()
    for pattern in arguments.as_names(what, patterns, "tsm.*"):
        hits = named_by(pattern, known)
        if pattern in known and pattern in endless:
            raise ParameterError(
                f"{what} '{pattern}': it is infinite, so it cannot be estimated; set a finite value first."
            )
        if pattern not in known:
            hits = [k for k in hits if not _is_set(known[k]) and k not in endless]
        if not hits:
            hint = near_path(pattern, known)
            raise ParameterError(f"{what} '{pattern}' names no parameter of '{diagram.title}'.{hint}")
        found.update(hits)
    return [name for name in known if name in found]


def named_by(pattern: str, names: Collection[str]) -> list[str]:
    """The one of some names that a pattern is, as ``tsm.weights[1]``, or else those that it matches."""
    return [pattern] if pattern in names else [k for k in names if fnmatchcase(k, pattern)]


def is_start(fields: list[Field]) -> bool:
    """Whether a number is the initial value of a state: patterns leave those out, names do not."""
    return bool(fields) and all(f.kind == "state" or f.initial for f in fields)


def with_initial_values(diagram: Diagram) -> Diagram:
    """The diagram in which empty lists of initial values are zeros, so that each value can be named."""
    changed: dict[str, Any] = {}
    for name, block in diagram.blocks.items():
        if isinstance(block, Diagram):
            inner = with_initial_values(block)
            changed |= {} if inner is block else {name: inner}
            continue
        given = block.parameters
        empty = [k for k, f in block.fields().items() if f.initial and given.get(k) == ()]
        if empty and block.states:
            changed[name] = block.replace(**dict.fromkeys(empty, (0.0,) * len(block.states)))
    return diagram.rewire(blocks={**diagram.blocks, **changed}) if changed else diagram


def _is_set(fields: list[Field]) -> bool:
    """Whether a number is free only where it is named: an initial state, or one that is known."""
    return bool(fields) and all(f.kind == "state" or f.known or f.initial for f in fields)


def bounds_of(fields: list[Field], value: float) -> tuple[float, float]:
    """Bounds by declaration; an excluded bound is kept off by a margin, since steps may land on it."""
    size = MARGIN * max(abs(value), 1e-3)
    low = max((max(f.at_least, f.above + size) for f in fields), default=-math.inf)
    high = min((min(f.at_most, f.below - size) for f in fields), default=math.inf)
    return low, high


def given_bounds(
    given: Mapping[str, Any] | None, free: Sequence[str], known: Iterable[str]
) -> dict[str, tuple[float, float]]:
    """Bounds given by name or pattern. Raises ParameterError for invalid bounds, or a name that is not free."""
    made: dict[str, tuple[float, float]] = {}
    for pattern, pair in arguments.as_mapping("bounds", given, "'tsm.theta': (0.1, 50.0)").items():
        hits = named_by(pattern, free)
        if not hits:
            why = "is not free in this fit" if pattern in known else "names no parameter that is free"
            raise ParameterError(f"bounds: '{pattern}' {why}.{near_path(pattern, free)}")
        made.update(dict.fromkeys(hits, _pair(pattern, pair)))
    return made


def _pair(name: str, pair: Any) -> tuple[float, float]:
    try:
        ends = (math.copysign(math.inf, s) if v is None else float(v) for v, s in zip(pair, (-1, 1), strict=True))
        low, high = (math.copysign(math.inf, v) if abs(v) > FAR else v for v in ends)
    except (TypeError, ValueError, OverflowError):
        raise ParameterError(
            f"bounds of '{name}' must be a pair (low, high), None for no bound, got {in_words(pair)}."
        ) from None
    if not low < high:
        raise ParameterError(f"bounds of '{name}': the lower one must be below the upper one, got ({low:g}, {high:g}).")
    return low, high


def unknown(name: str, diagram: Diagram, fields: list[Field], own: tuple[float, float] | None) -> Unknown:
    """One parameter with its bounds. Raises ParameterError when it starts outside them."""
    value = diagram.parameters[name]
    low, high = bounds_of(fields, value)
    if own is not None:
        low, high = max(low, own[0]), min(high, own[1])
        if not low < high:
            raise ParameterError(
                f"bounds of '{name}': ({own[0]:g}, {own[1]:g}) do not overlap the bounds of its block, "
                f"{fields[0].bounds() if fields else 'any number'}."
            )
    if not low <= value <= high:
        raise ParameterError(
            f"'{name}' starts at {value:g}, outside its bounds of {low:g} to {high:g}. Start inside: "
            f"start={{'{name}': …}}, or other bounds."
        )
    unit = unit_of(name, diagram, fields)
    about = fields[0].about if fields else "shared number"
    return Unknown(name, value, low, high, unit, about)
