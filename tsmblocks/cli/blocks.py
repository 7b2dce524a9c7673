"""List the blocks by family, or print the card of one: equation, source, ports, parameters.

The card of a block has its units and defaults.

  tsmblocks blocks
  tsmblocks blocks Play
  tsmblocks blocks AsymmetricBoucWen --json
"""

from __future__ import annotations

import argparse
import re
import textwrap
from typing import Any

from tsmblocks.cli import common, console
from tsmblocks.common.tables import columns
from tsmblocks.html.block_facts import by_family, card, words
from tsmblocks.html.plain_formulas import plain

HELP = "list the blocks, or show one block's card"


def arguments(parser: argparse.ArgumentParser) -> None:
    """Declare the options."""
    common.add(parser, "name", metavar="NAME", nargs="?", help="a block", suggests=common.BLOCKS)
    common.add(parser, "--json")


def execute(args: argparse.Namespace) -> int:
    """Run the command; the exit status."""
    import tsmblocks.blocks  # noqa: F401 - importing it registers every block
    from tsmblocks.model.aliases import block_hint
    from tsmblocks.model.block import REGISTRY

    if args.name:
        made = card(REGISTRY[common.known_name(args.name, REGISTRY, "block", block_hint)])
        common.print_result(args, made, card_text(made))
        return 0
    listed = {k: {name: words(cls)[0] for name, cls in some.items()} for k, some in by_family(REGISTRY).items()}
    common.print_result(args, listed, list_text(listed))
    return 0


def list_text(listed: dict[str, dict[str, str]]) -> str:
    """The list as text."""
    width = max(len(name) for blocks in listed.values() for name in blocks)
    lines: list[str] = []
    for name, blocks in listed.items():
        rows = [(k.ljust(width), text) for k, text in blocks.items()]
        lines += [name, columns(rows, "  ", _LEFT, console.width()), ""]
    return "\n".join([*lines, "'tsmblocks blocks NAME' shows one block's card."])


def card_text(made: dict[str, Any]) -> str:
    """The card as text."""
    wide = console.width()
    lines = [f"{made['name']} ({made['family']})", console.wrap(_unmarked(made["words"]), wide), ""]
    if made["equation"]:
        lines += [textwrap.indent(console.wrap(plain(made["equation"]), wide - 4, "  "), "    "), ""]
    if made["remarks"]:
        lines += [console.wrap(_unmarked(made["remarks"]), wide), ""]
    lines.append(console.wrap(f"Source: {made['source']}", wide, "  "))
    for title in ("inputs", "outputs"):
        rows = [(p["name"], f"[{p['unit'] or 'any'}]", p["about"] + _rate(p)) for p in made[title]]
        lines += ["", title, columns(rows, "  ", _LEFT, wide) if rows else "  none"]
    fields = [(p["name"], f"[{p['unit'] or '-'}]", _value(p["default"]), _about(p)) for p in made["parameters"]]
    lines += ["", "parameters", columns(fields, "  ", _LEFT - {2}, wide) if fields else "  none"]
    if any("?" in p["unit"] for kind in ("inputs", "outputs", "parameters") for p in made[kind]):
        any_unit = "A unit with a question mark, as [?u], is any unit, the same wherever the letter occurs."
        lines += ["", console.wrap(any_unit, wide)]
    return "\n".join(lines)


_LEFT = frozenset(range(4))


def _unmarked(text: str) -> str:
    """Text of a docstring without the marks around code, formulas as text."""
    text = re.sub(r":math:`(.+?)`", lambda match: plain(match[1]), text)
    return re.sub(r"(`+)(.+?)\1", r"\2", text)


def _rate(port: dict[str, Any]) -> str:
    return f" (formed from {port['rate_of']} when not connected)" if port.get("rate_of") else ""


def _value(value: Any) -> str:
    if isinstance(value, tuple):
        shown = ", ".join(_value(v) for v in value[:4])
        return f"[{shown}{', …' if len(value) > 4 else ''}]"
    return f"{value:g}" if isinstance(value, float) else f'"{value}"' if isinstance(value, str) else str(value).lower()


def _about(parameter: dict[str, Any]) -> str:
    text = {"state": "initial state: ", "option": "option: "}.get(parameter["kind"], "") + parameter["about"]
    limits = "" if parameter["bounds"] == "(-inf, inf)" else f"in {parameter['bounds']}"
    if parameter["choices"]:
        limits = f"one of {', '.join(map(str, parameter['choices']))}"
    return "; ".join(filter(None, [text, limits]))
