"""What a block declares, as plain values: words, equation, source, ports, parameters."""

from __future__ import annotations

import inspect
import textwrap
from collections.abc import Mapping
from typing import Any

FAMILIES = {"lti": "linear", "tables": "limits", "switching": "logic"}
"""Module -> family of its blocks, where that is the name of another module."""
ORDER = ["sources", "arithmetic", "linear", "limits", "friction"]
ORDER += ["hysteresis", "control", "motor", "discrete", "sensors"]
"""Families that are listed first."""


def family(cls: type) -> str:
    """Return the family of a block: the module it stands in."""
    module = cls.__module__.rpartition(".")[2]
    return FAMILIES.get(module, module)


def by_family(registry: Mapping[str, type]) -> dict[str, dict[str, type]]:
    """Blocks by family and name."""
    families: dict[str, dict[str, type]] = {}
    for name, cls in sorted(registry.items()):
        families.setdefault(family(cls), {})[name] = cls
    return {k: families[k] for k in sorted(families, key=lambda f: (ORDER.index(f) if f in ORDER else len(ORDER), f))}


def words(cls: type) -> tuple[str, str, str]:
    """First sentence, equation and remarks of a block's docstring."""
    texts, equations, in_math = list[str](), list[str](), False
    for part in inspect.cleandoc(cls.__doc__ or "").split("\n\n"):
        begins = part.startswith(".. math::")
        in_math = begins or (in_math and part.startswith("    "))
        if begins:
            equations.append(part.removeprefix(".. math::").strip())
        elif in_math:
            equations.append(textwrap.dedent(part).strip())
        else:
            texts.append(" ".join(part.split()))
    return texts[0] if texts else "", " \\\\\n".join(filter(None, equations)), "\n".join(texts[1:])


def card(cls: Any) -> dict[str, Any]:
    """All that is declared of a block, as plain values."""
    block = cls()
    sentence, equation, remarks = words(cls)
    ports = block.inports.items()
    return {
        "name": cls.__name__,
        "family": family(cls),
        "words": sentence,
        "equation": equation,
        "remarks": remarks,
        "source": block.source,
        "symbol": block.symbol,
        "sampled": block.sampled,
        "inputs": [{"name": k, "unit": p.unit, "about": p.about, "rate_of": p.rate_of} for k, p in ports],
        "outputs": [{"name": k, "unit": p.unit, "about": p.about} for k, p in block.outports.items()],
        "parameters": [
            {"name": k, "kind": f.kind, "default": getattr(block, k), "unit": f.unit, "bounds": f.bounds()}
            | {"low": f.low, "high": f.high, "choices": list(f.choices), "about": f.about}
            for k, f in cls.fields().items()
        ],
    }
