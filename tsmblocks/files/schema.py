"""The JSON schema of diagram files, made from the registered blocks, for editors that complete and check."""

from __future__ import annotations

import math
from typing import Any

from tsmblocks.common.interpolation import HOLD_WORDS
from tsmblocks.model.block import REGISTRY, Block, Field
from tsmblocks.model.simulation import METHODS

_NAME = "^[A-Za-z_][A-Za-z0-9_]*$"
_REFERENCE = {"type": "string", "pattern": "^\\$[A-Za-z_][A-Za-z0-9_]*$", "description": "a number of [values]"}
_TEXT = {"type": "string"}


def schema() -> dict[str, Any]:
    """The JSON schema (draft 2020-12) of a diagram file, with every registered block."""
    import tsmblocks.blocks  # noqa: F401 - imported for the blocks it registers

    kinds = {name: _kind(cls) for name, cls in sorted(REGISTRY.items())}
    inner = _diagram()
    whole = _diagram()
    first = {"format": {"const": 1, "description": "version of the file format"}}
    whole["properties"] = {**first, **whole["properties"], **_simulation()}
    return {
        "$schema": "https://json-schema.org/draft/2020-12/schema",
        "title": "tsmblocks diagram, format 1",
        **whole,
        "required": ["format", "blocks"],
        "$defs": {
            **kinds,
            "use": _use(),
            "diagram": inner,
            "block": {"anyOf": [{"$ref": f"#/$defs/{name}"} for name in (*kinds, "use", "diagram")]},
        },
    }


def _diagram() -> dict[str, Any]:
    ports = {"anyOf": [_TEXT, {"type": "array", "items": _TEXT}], "description": "the port or ports it drives"}
    inlet = _table({"ports": ports, "unit": _TEXT, "about": _TEXT}, ["ports"])
    outlet = _table({"signal": _TEXT, "unit": _TEXT}, ["signal"])
    wire = {"type": "string", "pattern": "->", "description": "a chain such as error -> pid -> drive"}
    return _table(
        {
            "title": _TEXT,
            "source": {**_TEXT, "description": "where the diagram is from: figure, equation, book"},
            "wires": {"type": "array", "items": wire},
            "blocks": _named({"$ref": "#/$defs/block"}, "blocks by name"),
            "inputs": _named({"anyOf": [*ports["anyOf"], inlet]}, "inputs by name: the port or ports they drive"),
            "outputs": _named({"anyOf": [_TEXT, outlet]}, "outputs by name: the signal they show"),
            "values": _named({"type": "number"}, 'numbers that several parameters refer to, as "$name"'),
        },
        [],
    )


def _simulation() -> dict[str, Any]:
    """Sections that say how a diagram was simulated on recordings."""
    seconds, hold = {"type": "number", "exclusiveMinimum": 0}, {"enum": list(HOLD_WORDS)}
    settings = {
        "step": {**_one_or_each(seconds), "description": "step in s, one for all or by recording"},
        "method": {"enum": list(METHODS)},
        "hold": {**_one_or_each(hold), "description": "interpolation between samples, for all inputs or by input"},
        "condition": {"type": "array", "items": _TEXT, "description": "inputs whose noise is filtered out"},
        "stop_when": {**_TEXT, "description": "comparison of signals at which a run ends"},
    }
    states = {"type": "object", "description": 'initial states such as "tsm.zeta" = 0.1'}
    about = "initial states by recording"
    return {
        "simulation": _table(settings, []),
        "start": {"type": "object", "additionalProperties": states, "description": about},
    }


def _one_or_each(value: dict[str, Any]) -> dict[str, Any]:
    """One value, or a table of such values."""
    return {"anyOf": [value, {"type": "object", "additionalProperties": value}]}


def _use() -> dict[str, Any]:
    numbers = {"type": "object", "description": 'numbers of that diagram to change, such as "drive.high" = 12.0'}
    name = {**_TEXT, "description": "a diagram file next to this one or below, or a ready-made diagram"}
    return _table({"use": name, "set": numbers}, ["use"])


def _kind(cls: type[Block]) -> dict[str, Any]:
    """The schema of one type of block."""
    about = (cls.__doc__ or "").strip().partition("\n")[0]
    fields = {
        key: {"description": _words(field), **_value(field, field.default)} for key, field in cls.fields().items()
    }
    return {"description": about, **_table({"type": {"const": cls.__name__}, **fields}, ["type"])}


def _words(field: Field) -> str:
    """The description of a field."""
    unit = f" [{field.unit}]" if field.unit and "?" not in field.unit else ""
    return f"{field.about}{unit}; default {field.default_in_files}"


def _value(field: Field, default: Any) -> dict[str, Any]:
    if field.choices:
        return {"enum": list(field.choices)}
    if isinstance(default, (bool, str)):
        return {"type": "boolean" if isinstance(default, bool) else "string"}
    if isinstance(default, tuple):
        items = [_value(field, v) for v in default[:1]] or [_value(field, 0.0), {"type": "array"}]
        return {"type": "array", "items": items[0] if len(items) == 1 else {"anyOf": items}}
    number = {"type": "integer" if type(default) is int else "number", **_bounds(field)}
    return number if field.kind == "option" else {"anyOf": [number, _REFERENCE]}


def _bounds(field: Field) -> dict[str, float]:
    bounds = {
        "exclusiveMinimum": field.above,
        "exclusiveMaximum": field.below,
        "minimum": field.at_least,
        "maximum": field.at_most,
    }
    return {key: bound for key, bound in bounds.items() if math.isfinite(bound)}


def _table(properties: dict[str, Any], required: list[str]) -> dict[str, Any]:
    return {"type": "object", "properties": properties, "required": required, "additionalProperties": False}


def _named(entry: dict[str, Any], about: str) -> dict[str, Any]:
    return {"type": "object", "propertyNames": {"pattern": _NAME}, "additionalProperties": entry, "description": about}
