"""Formulas in a page without scripts and without network: LaTeX converted to MathML, which browsers typeset.

It is an extension of Sphinx that offers the renderer ``mathml``.
"""

from __future__ import annotations

import re
from html import escape
from itertools import cycle
from typing import Any

ALIGNED = re.compile(r"\\begin\{(aligned|split|gathered)\}|\\end\{(aligned|split|gathered)\}")

SILENT = re.compile(r"\\(?:text|operatorname|left|right|frac|sqrt|dot)\b|\\[,;]|[{}_^&]")
"""Commands and brackets of a formula that print no character."""
WIDEST = 50
"""Characters in a row, above which a sum continues in the next. Chosen: as wide as a page."""
LONG = 30
"""Characters above which an inline formula is in a box that scrolls. Chosen: as wide as a phone."""
BRACE = re.compile(r'<mo[^>]*>(?:\{|&#x0007B;)</mo>\s*<mtable(?: class="[^"]*")?')
THIN = '<mspace width="0.17em"/>'
"""A thin space."""
BAR = re.compile(r'(<mo stretchy="false")(?=>&#x0007C;</mo>)>')
"""A bar of an absolute value, which browsers take for an operator between two terms."""
TWO_BARS = re.compile(r'(&#x0007C;</mo>)(?=<mo stretchy="false"[^>]*>&#x0007C;)')
"""The end of one absolute value before another."""
PLUS_MINUS = re.compile(r"<mi>&#x000B1;</mi>")
FUNCTION = re.compile(
    r"(</m(?:i|n|row|sub|sup|frac|subsup)>)?(?<!<msu[bp]>)(<mi>(?:a?cos|a?sin|a?tan|cosh|sinh|tanh|arctan|exp|log|ln|lg)</mi>)"
    r"(<mrow>\s*<mo[^>]*>&#x00028;|<mo[^>]*>&#x00028;)?"
)
"""A function, what ends before it, and the bracket behind it."""


def mathml(latex: str, *, block: bool = False) -> str:
    r"""A formula as a ``<math>`` element; rows end with ``\\`` and are aligned at ``&``."""
    rows = [_split(row.strip(), "&") for row in _split(ALIGNED.sub("", latex).strip(), r"\\")]
    if len(rows) == 1 and len(rows[0]) == 1:
        inner = _converted(rows[0][0])
    else:
        inner = f'<mtable class="aligned" displaystyle="true">{"".join(map(_row, rows))}</mtable>'
    shape = ' display="block"' if block else ""
    return (
        f'<math xmlns="http://www.w3.org/1998/Math/MathML"{shape}><semantics><mrow>{inner}</mrow>'
        f'<annotation encoding="application/x-tex">{escape(latex)}</annotation></semantics></math>'
    )


def printed_length(latex: str) -> int:
    """About how many characters a formula prints; of a fraction those above and below the line."""
    return len("".join(re.sub(r"\\[a-zA-Z]+", "x", SILENT.sub("", latex)).split()))


def equation(left: str, right: str) -> str:
    r"""An equation aligned at ``&``; a long sum continues in further rows, which end with ``\\``."""
    rows = [f"{left} &= "]
    for part in _split(right, " + "):
        for place, term in enumerate(_split(part, " - ")):
            sign = "-" if place else "" if rows[-1].endswith("&= ") else "+"
            if sign and printed_length(rows[-1]) + printed_length(term) > WIDEST:
                rows.append("&\\quad {}")
            rows[-1] += f" {sign} {term}" if sign else term
    return "\\\\\n".join(rows)


def _row(cells: list[str]) -> str:
    sides = cycle(("right", "left")) if len(cells) > 1 else ("left",)
    columns = (f'<mtd class="{side}">{_converted(cell)}</mtd>' for side, cell in zip(sides, cells, strict=False))
    return f"<mtr>{''.join(columns)}</mtr>"


def _split(latex: str, mark: str) -> list[str]:
    """Parts between marks that stand in no environment and in no braces."""
    parts, depth, k, begin = [], 0, 0, 0
    while k < len(latex):
        if latex.startswith((r"\begin{", r"\left"), k) or latex[k] == "{":
            depth += 1
        if latex.startswith((r"\end{", r"\right"), k) or latex[k] == "}":
            depth -= 1
        if depth == 0 and latex.startswith(mark, k):
            parts.append(latex[begin:k])
            k = begin = k + len(mark)
            continue
        k += 2 if latex[k] == "\\" and latex[k : k + 2] in (r"\\", r"\{", r"\}", r"\&") else 1
    return [*parts, latex[begin:]]


def _converted(latex: str) -> str:
    from latex2mathml.converter import convert

    made = re.sub(r"^<math[^>]*>|</math>$", "", convert(latex.strip() or "{}"))
    made = TWO_BARS.sub(rf"\1{THIN}", BAR.sub(r'\1 lspace="0" rspace="0">', made))
    made = FUNCTION.sub(_spaced, made)
    # A brace grows with its cases only where a font for mathematics is installed; a line does so everywhere.
    return BRACE.sub('<mtable class="cases"', PLUS_MINUS.sub("<mo>&#x000B1;</mo>", made))


def _spaced(found: re.Match[str]) -> str:
    """A function as browsers set no other name: with a thin space before it and, without brackets, behind it."""
    before, name, behind = found.groups(default="")
    first, last = THIN if before else "", "" if behind else THIN
    return f"{before}{first}{name}<mo>&#x2061;</mo>{last}{behind}"


def setup(app: Any) -> dict[str, bool]:
    """Offer the renderer to Sphinx."""
    app.add_html_math_renderer("mathml", (_inline, None), (_display, None))
    return {"parallel_read_safe": True, "parallel_write_safe": True}


def _inline(self: Any, node: Any) -> None:
    from docutils import nodes

    made = mathml(node.astext())
    self.body.append(f'<span class="math" tabindex="0">{made}</span>' if printed_length(node.astext()) > LONG else made)
    raise nodes.SkipNode


def _display(self: Any, node: Any) -> None:
    from docutils import nodes

    self.body.append(f'<div class="math" tabindex="0">{mathml(node.astext(), block=True)}</div>\n')
    raise nodes.SkipNode
