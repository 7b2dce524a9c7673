"""A diagram as Mermaid text, for pages that draw Mermaid themselves."""

from __future__ import annotations

import json

from tsmblocks.common.errors import TsmError, without_controls
from tsmblocks.draw.faces import symbol_of
from tsmblocks.draw.graph import PRODUCTS, SUMS
from tsmblocks.model.diagram import Diagram, required_diagram


def to_mermaid(diagram: Diagram) -> str:
    """Return a diagram as a Mermaid flow chart, with a line for each block, link, input and output.

    Parameters
    ----------
    diagram : Diagram
        What is drawn.

    Returns
    -------
    str
        Mermaid text, which ends with a newline.

    Raises
    ------
    TsmError
        ``diagram`` is not a diagram.

    See Also
    --------
    to_svg : The same diagram with a layout of its own.

    Examples
    --------
    >>> import tsmblocks as tsm
    >>> print(tsm.to_mermaid(tsm.load("motor_linear")))
    ---
    title: "Motor as a linear transfer function"
    ---
    flowchart LR
      in_u(["u"])
      b_motor["motor<br/>K/s(τs+1)"]
      out_x(["x"])
      in_u --> b_motor
      b_motor -->|"y"| out_x
    <BLANKLINE>
    """
    diagram = required_diagram(diagram, "drawn", TsmError)
    lines = ["---", f"title: {_title(diagram.title)}", "---"] if diagram.title else []
    lines.append("flowchart LR")
    lines += [f"  in_{name}([{_quoted(name)}])" for name in diagram.inputs]
    for name, block in diagram.blocks.items():
        if isinstance(block, Diagram):
            lines.append(f"  b_{name}[[{_quoted(name, block.title)}]]")
        elif symbol_of(block) in (*SUMS, *PRODUCTS):
            lines.append(f"  b_{name}(({_quoted(name, symbol_of(block))}))")
        else:
            lines.append(f"  b_{name}[{_quoted(name, symbol_of(block))}]")
    lines += [f"  out_{name}([{_quoted(name)}])" for name in diagram.outputs]
    for name, ends in diagram.inlets.items():
        lines += [f"  in_{name} -->{_ports(diagram, ('', ''), end)} b_{end[0]}" for end in ends]
    lines += [
        f"  b_{link.source[0]} -->{_ports(diagram, link.source, link.target)} b_{link.target[0]}"
        for link in diagram.links
    ]
    for name, (block_name, port) in diagram.shown.items():
        start = f"b_{block_name}" if block_name else f"in_{port}"
        lines.append(f"  {start} -->{_ports(diagram, (block_name, port), ('', ''))} out_{name}")
    return "\n".join(lines) + "\n"


def _ports(diagram: Diagram, source: tuple[str, str], target: tuple[str, str]) -> str:
    """The names of the ports, where a block has several on that side."""
    blocks = diagram.blocks
    out = source[1] if source[0] and len(blocks[source[0]].outports) > 1 else ""
    into = target[1] if target[0] and len(blocks[target[0]].inports) > 1 else ""
    text = " → ".join(filter(None, (out, into)))
    return f"|{_quoted(text)}|" if text else ""


def _title(text: str) -> str:
    """A title as YAML has it, in which no directive of Mermaid's (``%%{init…}%%``) begins."""
    return json.dumps(without_controls(text), ensure_ascii=False).replace("%%", "%\\u0025")


def _quoted(*lines: str) -> str:
    """Text in quotes, with what Mermaid would read as its own notation written as codes."""
    codes = {c: f"#{ord(c)};" for c in '"#<>&`|\\%'}
    plain = [" ".join(without_controls(line).split()) for line in lines if line]
    return '"' + "<br/>".join("".join(codes.get(c, c) for c in line) for line in plain) + '"'
