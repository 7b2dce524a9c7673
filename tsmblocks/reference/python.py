"""Pages of the Python interface, by task, and of the commands. It is an extension of Sphinx."""

from __future__ import annotations

from collections.abc import Mapping
from importlib import import_module
from types import ModuleType
from typing import Any

import tsmblocks
from tsmblocks.reference import rst

GROUPS: dict[str, tuple[str, str, tuple[str, ...]]] = {
    "diagrams": ("Diagrams", "Assembled by script, read from files, drawn.", (
        "Diagram", "Inlet", "load", "loads", "save", "dumps", "to_svg", "to_png", "to_pdf", "to_mermaid")),
    "blocks": ("Blocks of your own", "The declarations of a block, and blocks made of functions.", (
        "Block", "block", "parameter", "option", "state", "Input", "Output", "State", "Tape", "Past", "Samples",
        "signals", "function_block", "from_control")),
    "running": ("Running", "One run, many side by side, or step by step.", (
        "simulate", "Run", "Stepper", "equations", "simulate_batch", "Batch", "sensitivities")),
    "measures": ("Measures", "Metrics of a run.", ("measure", "rms", "peak_to_peak", "tracking_error")),
    "data": ("Recordings", "Reading, repairs, and noise.", (
        "read", "from_pandas", "Record", "noise", "Noise", "cautions")),
    "fits": ("Fits", "Parameters estimated from recordings, and models compared.", (
        "fit", "Fit", "compare", "Comparison", "score", "Differences")),
    "diagnosis": ("Diagnosis", "Effects that a model lacks.", ("diagnose", "Diagnosis", "Effect")),
    "design": ("Studies and design", "Sweeps, tuning, and optimal control.", (
        "study", "read_study", "tune", "optimal_control", "OptimalControl", "receding_horizon", "RecedingHorizon")),
    "linear": ("Linear analysis", "Operating points and linear models.", ("trim", "linearize")),
    "errors": ("Errors", "Every error of the package derives from this one.", ("TsmError",)),
}  # fmt: skip
"""Page: its heading, its subject, the names of the package on it."""
MODULES = {
    "diagrams": ("export",),
    "blocks": ("testing",),
    "diagnosis": ("effects",),
    "design": ("studies", "tuning"),
    "linear": ("analysis",),
    "errors": ("errors",),
}
"""Modules of the package of which a page shows all public names."""


def pages() -> dict[str, str]:
    """Every page by its path, the index among them."""
    rows = [
        (rst.link(f"/python/{key}", title), words, ", ".join(f"``{n}``" for n in names))
        for key, (title, words, names) in GROUPS.items()
    ]
    index = rst.page(
        rst.heading("Python"),
        "``import tsmblocks as tsm`` gives every name on these pages. Angles are in radians inside; figures and tables "
        "show degrees where people think in degrees.",
        rst.table(("Page", "Task", "Names"), rows, (22, 34, 44)),
        rst.contents(GROUPS),
    )
    return {"python/index": index, **{f"python/{key}": _page(key) for key in GROUPS}}


def _page(key: str) -> str:
    title, about, names = GROUPS[key]
    parts = [rst.heading(title), about, *(_entry("tsmblocks", name, getattr(tsmblocks, name)) for name in names)]
    for module in MODULES.get(key, ()):
        made = import_module(f"tsmblocks.{module}")
        known = [n for n in getattr(made, "__all__", None) or _own(made) if n not in names]
        parts += [rst.heading(f"tsmblocks.{module}", 1), (made.__doc__ or "").strip().partition("\n\n")[0]]
        things = {name: getattr(made, name) for name in known}
        parts += [_entry(f"tsmblocks.{module}", name, thing) for name, thing in things.items() if callable(thing)]
    return rst.page(*parts)


def _own(package: ModuleType) -> list[str]:
    """Public classes and functions that a package has in its own modules, in the order of its imports."""
    inside = f"{package.__name__}."
    homes = {k: f"{getattr(v, '__module__', '')}." for k, v in vars(package).items() if not k.startswith("_")}
    return [k for k, home in homes.items() if home.startswith(inside)]


def _entry(module: str, name: str, thing: object) -> str:
    if isinstance(thing, type):
        return f".. autoclass:: {module}.{name}\n   :members:\n"
    return f".. autofunction:: {module}.{name}\n"


def _signature(*given: Any) -> tuple[str, str] | None:
    """A signature in which a default that is made for each value (as a new dict) is no name of attrs."""
    *_, text, returned = given
    return (text.replace("=NOTHING", "=…"), returned) if text else None


def setup(app: Any) -> dict[str, bool]:
    """Take part where signatures are written."""
    app.connect("autodoc-process-signature", _signature)
    return {"parallel_read_safe": True, "parallel_write_safe": True}


def commands(helps: Mapping[str, tuple[str, str]]) -> dict[str, str]:
    """Pages of the commands: name -> (what it does, what --help prints)."""
    rows = [(rst.link(f"/commands/{name}", f"tsmblocks {name}"), words) for name, (words, _) in helps.items()]
    index = rst.page(
        rst.heading("Commands"),
        "What ``tsmblocks --help`` and ``tsmblocks COMMAND --help`` print. Exit status: 0 done, 2 bad usage or input, "
        "130 stopped by Ctrl-C, 1 anything else.",
        rst.table(("Command", "What it does"), rows, (30, 70)),
        rst.contents(helps),
    )
    made = {"commands/index": index}
    for name, (_, text) in helps.items():
        made[f"commands/{name}"] = rst.page(rst.heading(f"tsmblocks {name}"), rst.block(text, "none"))
    return made
