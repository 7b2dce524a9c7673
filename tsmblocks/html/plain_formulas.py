"""Formulas as plain text for a terminal: LaTeX turned to letters, signs and brackets, one line for each equation."""

from __future__ import annotations

import re

LETTERS = {
    "alpha": "α", "beta": "β", "gamma": "γ", "delta": "δ", "zeta": "ζ", "vartheta": "ϑ", "theta": "θ", "mu": "μ",
    "pi": "π", "rho": "ρ", "sigma": "σ", "tau": "τ", "varphi": "φ", "omega": "ω", "Delta": "Δ", "Xi": "Ξ",
    "sum": "Σ", "prod": "Π", "int": "∫", "pm": "±", "ge": "≥", "le": "≤", "ne": "≠", "in": "∈", "to": "→",
    "uparrow": "↑", "downarrow": "↓", "sim": "~", "dots": "…", "cdots": "…", "lfloor": "⌊", "rfloor": "⌋",
    "cdot": "·", "infty": "∞",
    "quad": "\0", "qquad": "\0", ",": " ", ";": " ", "!": "", " ": " ", "{": "{", "}": "}",
    "left": "", "right": "", "bigl": "", "bigr": "", "text": "", "operatorname": "", "bmod": "mod",
}  # fmt: skip
"""Text of each command (``\\0`` marks the gap between equations); any other, such as ``max``, is its own name."""
RATES = {"dot": "'", "ddot": "''"}
"""Marks behind a letter and its index."""
HAT = "\N{COMBINING CIRCUMFLEX ACCENT}"
FRACTIONS = ("\\frac", "\\tfrac")
FUNCTIONS = ("tanh", "sin", "cos", "ln")
LOW, HIGH = str.maketrans("0123456789", "₀₁₂₃₄₅₆₇₈₉"), str.maketrans("0123456789", "⁰¹²³⁴⁵⁶⁷⁸⁹")
TOKEN = re.compile(r"\\[A-Za-z]+|\\.|[\s\S]")
CASES = re.compile(r"\\begin\{cases\}(.*?)\\end\{cases\}", re.DOTALL)
SINGLE = re.compile(rf"[\w.'{HAT}]*(?:\([^()]*\))?")
"""What needs no brackets around it in a fraction: a name, a number, a value of a function."""


def plain(latex: str) -> str:
    r"""A formula as text, such as ``ζ' = A v - ϑ |v| ζ``; a rate has a prime, ``\\`` ends a line."""
    lines = CASES.sub(_cases, latex).replace("&", "").split(r"\\")
    texts = (re.sub(r"\s+", " ", _read(TOKEN.findall(line))) for line in lines)
    return "\n".join(re.sub(r" *\0 *", "   ", text).strip() for text in texts)  # a gap is three blanks wide


def _cases(cases: re.Match[str]) -> str:
    """Cases on one line, each with its condition."""
    rows = (" if ".join(map(str.strip, row.split("&"))) for row in cases[1].strip().split(r"\\"))
    return r"\{" + "; ".join(rows).replace(r"if \text{otherwise}", "otherwise") + r"\}"


def _read(tokens: list[str]) -> str:
    """Text of all tokens; the list is empty afterwards."""
    text = ""
    while tokens:
        text += _next(tokens)
    return text


def _next(tokens: list[str]) -> str:
    """Text of the first item, whose tokens are removed: a letter, a group in braces, a command with its arguments."""
    token = tokens.pop(0)
    if token == "{":
        return _read(_group(tokens))
    if token in "_^" and tokens:
        return _shifted(token, _argument(tokens))
    name = token[1:] if len(token) > 1 else ""
    if not name:
        return token
    if token in FRACTIONS:
        over, under = _bracketed(_argument(tokens)), _bracketed(_argument(tokens))
        return f"{over}/{under}"
    if name == "hat":
        return _argument(tokens) + HAT
    if name in RATES:
        letter = _argument(tokens)
        return letter + (_next(tokens) if tokens[:1] == ["_"] else "") + RATES[name]
    if name in FUNCTIONS and tokens[:1] and tokens[0] in FRACTIONS:
        return f"{name}({_next(tokens)})"
    return LETTERS.get(name, name)


def _argument(tokens: list[str]) -> str:
    while tokens and tokens[0].isspace():
        tokens.pop(0)
    return _next(tokens).strip() if tokens else ""


def _group(tokens: list[str]) -> list[str]:
    """Tokens up to the brace that closes a group; they and the brace are removed from the list."""
    depth, group = 1, list[str]()
    while tokens:
        token = tokens.pop(0)
        depth += (token == "{") - (token == "}")
        if not depth:
            break
        group.append(token)
    return group


def _bracketed(text: str) -> str:
    return text if SINGLE.fullmatch(text) else f"({text})"


def _shifted(sign: str, text: str) -> str:
    """An index or a power: small digits, else behind its sign."""
    if text.isascii() and text.isdigit():
        return text.translate(LOW if sign == "_" else HIGH)
    alone = len(text) == 1 or (sign == "_" and text.isalpha())
    return sign + (text if alone else f"({text})")
