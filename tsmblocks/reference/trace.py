"""The equations of a block as they are computed: its expressions, written out in LaTeX or another notation.

They are the expressions that are simulated, fitted, differentiated and exported.
"""

from __future__ import annotations

import math
import re
from collections import Counter
from collections.abc import Callable, Mapping, Sequence

import attrs
import casadi as ca

from tsmblocks.compiler.dependencies import symbolic
from tsmblocks.engine.program import Program
from tsmblocks.model.block import Block

LONGEST = 150
"""Operations above which a block's equations are shown as a listing rather than a formula. Chosen."""
SHARED = 3
"""Operations from which a part that occurs twice gets a letter of its own. Chosen."""
ATOM, UNARY, POWER, TIMES, PLUS, COMPARE, LOOSE = range(7)
"""Precedence of a piece of text: the lower, the tighter it binds."""

Piece = tuple[str, int]


def filled(text: str, *parts: str) -> str:
    """A text with ``«0»``, ``«1»``, … replaced by the parts."""
    return re.sub("«([0-9])»", lambda found: parts[int(found[1])], text)


@attrs.frozen
class Notation:
    """A notation: for each operation its text with ``«0»``, ``«1»`` for the arguments, its precedence, and theirs.

    ``constant`` writes a number; ``cases`` a choice, from pairs of a condition and what holds then, and what holds
    otherwise; ``result`` the left side of an equation of a kind (``y``, ``dx``, ``next``).
    """

    operations: Mapping[str, tuple[str, int, tuple[int, ...]]]
    brackets: str
    shared: str
    constant: Callable[[float], Piece]
    cases: Callable[[Sequence[tuple[str, str]], str], str]
    result: Callable[[str, str], str]

    def bracketed(self, piece: Piece, most: int) -> str:
        """The text, in brackets where its precedence is looser than ``most``."""
        return piece[0] if piece[1] <= most else filled(self.brackets, piece[0])


PI_MULTIPLES = ((2, r"2 \pi"), (1, r"\pi"), (180 / math.pi**2, r"\frac{180}{\pi}"), (1 / 180, r"\frac{\pi}{180}"))
"""Multiples of pi, and how they are written (180 / pi**2 times pi is 180 / pi, from radians to degrees)."""


def _constant(value: float) -> Piece:
    """A number, as a multiple of pi where it is a simple one."""
    for times, text in PI_MULTIPLES:
        if math.isclose(value, times * math.pi, rel_tol=1e-14):
            return text, TIMES
    mantissa, e, power = f"{value:.12g}".partition("e")
    if e:
        tens = f"10^{{{int(power)}}}"
        return (tens, POWER) if mantissa == "1" else (rf"{mantissa} \cdot {tens}", TIMES if value > 0 else PLUS)
    return mantissa, ATOM if value >= 0 else PLUS


def _cases(choices: Sequence[tuple[str, str]], rest: str) -> str:
    rows = [*(rf"{value} & \text{{if }} {condition}" for condition, value in choices), rf"{rest} & \text{{otherwise}}"]
    return r"\begin{cases} " + r" \\ ".join(rows) + r" \end{cases}"


def _result(kind: str, name: str) -> str:
    return {"y": name, "dx": rf"\dot{{{name}}}", "next": f"{name}^{{+}}"}[kind]


def _call(name: str) -> tuple[str, int, tuple[int, ...]]:
    return (rf"\operatorname{{{name}}}\left(«0»\right)", ATOM, (LOOSE,))


LATEX = Notation(
    {
        "ADD": ("«0» + «1»", PLUS, (PLUS, PLUS)),
        "SUB": ("«0» - «1»", PLUS, (PLUS, TIMES)),
        "NEG": ("-«0»", PLUS, (TIMES,)),
        "MUL": (r"«0»\,«1»", TIMES, (TIMES, TIMES)),
        "DIV": (r"\frac{«0»}{«1»}", TIMES, (LOOSE, LOOSE)),
        "INV": (r"\frac{1}{«0»}", TIMES, (LOOSE,)),
        "TWICE": (r"2\,«0»", TIMES, (TIMES,)),
        "SQ": ("{«0»}^{2}", POWER, (ATOM,)),
        "POW": ("{«0»}^{«1»}", POWER, (ATOM, LOOSE)),
        "CONSTPOW": ("{«0»}^{«1»}", POWER, (ATOM, LOOSE)),
        "SQRT": (r"\sqrt{«0»}", ATOM, (LOOSE,)),
        "FABS": (r"\left|«0»\right|", ATOM, (LOOSE,)),
        "EXP": ("e^{«0»}", POWER, (LOOSE,)),
        "SIGN": _call("sgn"),
        "LOG": _call("ln"),
        "FLOOR": (r"\left\lfloor «0» \right\rfloor", ATOM, (LOOSE,)),
        "CEIL": (r"\left\lceil «0» \right\rceil", ATOM, (LOOSE,)),
        "LOG1P": (r"\operatorname{ln}\left(1 + «0»\right)", ATOM, (PLUS,)),
        "EXPM1": ("e^{«0»} - 1", PLUS, (LOOSE,)),
        "FMIN": (r"\operatorname{min}\left(«0»,\; «1»\right)", ATOM, (LOOSE, LOOSE)),
        "FMAX": (r"\operatorname{max}\left(«0»,\; «1»\right)", ATOM, (LOOSE, LOOSE)),
        "FMOD": (r"«0» \bmod «1»", TIMES, (ATOM, ATOM)),
        "LT": ("«0» < «1»", COMPARE, (PLUS, PLUS)),
        "LE": (r"«0» \le «1»", COMPARE, (PLUS, PLUS)),
        "EQ": ("«0» = «1»", COMPARE, (PLUS, PLUS)),
        "NE": (r"«0» \ne «1»", COMPARE, (PLUS, PLUS)),
        "AND": (r"«0» \text{ and } «1»", LOOSE, (COMPARE, COMPARE)),
        "OR": (r"«0» \text{ or } «1»", LOOSE, (COMPARE, COMPARE)),
        "NOT": (r"\text{not } «0»", LOOSE, (ATOM,)),
        **{k.upper(): _call(k) for k in ("sin", "cos", "tan", "sinh", "cosh", "tanh")},
        **{f"A{k.upper()}": _call(f"arc{k}") for k in ("sin", "cos", "tan")},
    },
    brackets=r"\left(«0»\right)",
    shared="«0»_{«1»}",
    constant=_constant,
    cases=_cases,
    result=_result,
)
LEAVES = ("CONST", "INPUT")
SWITCHES = {
    **dict.fromkeys(("FABS", "SIGN"), "«0» = 0"),
    **dict.fromkeys(("FMIN", "FMAX", "LT", "LE"), "«0» = «1»"),
    **dict.fromkeys(("FLOOR", "CEIL"), r"«0» \in \mathbb{Z}"),
}
"""Operations with a kink or a jump, and where it is."""
_LETTERS = """alpha beta gamma delta epsilon zeta eta theta iota kappa lambda mu nu xi pi rho sigma tau upsilon phi chi
psi omega"""
GREEK = frozenset(_LETTERS.split())


def symbol(name: str) -> str:
    """A name of a block as LaTeX: ``alpha1``, ``alpha_x``, ``half_width``, ``weights[0]``, ``kp``."""
    name, *places = re.split(r"[\[\]]+", name.rstrip("]"))
    head, _, tail = name.partition("_")
    numbered = re.fullmatch(r"([A-Za-z]+)(\d+)", head)
    if numbered and not tail:
        head, tail = numbered.groups()
    below = ",".join(filter(None, (_word(tail) if tail else "", *places)))
    if head[0] == "k" and len(head) in (2, 3) and not tail:
        head, below = "k", head[1:]
    elif not (head in GREEK or len(head) == 1 or numbered):
        head, below = "", ",".join(places)
    made = _word(head) if head else rf"\text{{{name.replace('_', ' ')}}}"
    return f"{made}_{{{below}}}" if below else made


def spaced(latex: str) -> str:
    """Products of words with a dot between them, so that two words are not read as one name."""
    return re.sub(r"(\\text\{[^{}]*\}(?:_\{[^{}]*\})?)\\,", r"\1 \\cdot ", latex).replace(r"\,\text{", r" \cdot \text{")


def _word(text: str) -> str:
    if text in GREEK:
        return f"\\{text}"
    return text if len(text) == 1 or text.isdigit() else rf"\text{{{text.replace('_', ' ')}}}"


@attrs.frozen(eq=False)
class Listing:
    """Equations as text: ``shared`` parts (name, text), then each equation (left side, text).

    ``switches`` are the places where an equation has a kink or a jump; ``size`` counts the operations.
    """

    shared: tuple[tuple[str, str], ...]
    equations: tuple[tuple[str, str], ...]
    switches: tuple[str, ...]
    size: int


def listing(block: Block, notation: Notation = LATEX, names: Mapping[str, str] | None = None) -> Listing:
    """A block's equations in a notation; ``names`` has the text of each port, state and parameter (LaTeX by default).

    Raises EquationError for equations that do not fit what the block declares.
    """
    function, labels, results = _function(block)
    written = [names[k] if names else symbol(k) for k in labels]
    labelled = [(kind, names[k] if names and k in names else symbol(k)) for kind, k in results]
    return _Walk(Program(function), written, notation).listing(labelled)


def _function(block: Block) -> tuple[ca.Function, list[str], list[tuple[str, str]]]:
    """All equations as a function of one column; the names of its elements, and of its results."""
    made = symbolic(block)
    starts = {k for k, f in block.fields().items() if f.kind == "state"}
    column = [made.t, *made.x, *made.u, *(p for p in made.p if p.name() not in starts)]
    function = ca.Function("equations", [ca.vertcat(*column)], [ca.vertcat(*made.results.values())])
    return function, [v.name() for v in column], list(made.results)


class _Walk:
    """Conversion of the nodes of a program to text, each once."""

    def __init__(self, program: Program, names: Sequence[str], notation: Notation) -> None:
        self.program, self.names, self.notation = program, names, notation
        self.letter = next(k for k in "wqgh" if not any(name.startswith(k) for name in names))
        self.uses = Counter(k for n in range(len(program.nodes)) for k in program.arguments(n))
        self.uses.update(program.outputs.values())
        self.sizes: list[int] = []
        for name, args in program.nodes:
            self.sizes.append(0 if name in LEAVES else 1 + sum(self.sizes[k] for k in args))
        self.pieces: dict[int, Piece] = {}
        self.shared: list[tuple[str, str]] = []

    def listing(self, results: Sequence[tuple[str, str]]) -> Listing:
        """Each result as an equation; what equals an earlier one is written as that."""
        made, goals = [], []
        for place, (kind, name) in enumerate(results):
            node, side = self.program.outputs.get((0, place)), self.notation.result(kind, name)
            if node is None:
                made.append((side, "0"))
                continue
            goals.append(node)
            known = node in self.pieces
            made.append((side, self.piece(node)[0] if known else self._written(node)[0]))
            if not known and self.sizes[node] >= SHARED:
                self.pieces[node] = (side, ATOM)
        used = self.program.needed(goals)
        switches = [self._switch(node) for node in sorted(used) if self.program.nodes[node][0] in SWITCHES]
        operations = sum(self.program.nodes[k][0] not in LEAVES for k in used)
        return Listing(tuple(self.shared), tuple(made), tuple(dict.fromkeys(switches)), operations)

    def piece(self, node: int) -> Piece:
        """A node as text; a large part that occurs twice becomes a name."""
        if node not in self.pieces:
            made = self._written(node)
            if self._is_shared(node):
                name = filled(self.notation.shared, self.letter, str(len(self.shared) + 1))
                self.shared.append((name, made[0]))
                made = (name, ATOM)
            self.pieces[node] = made
        return self.pieces[node]

    def _is_shared(self, node: int) -> bool:
        logical = self.program.nodes[node][0] in ("LT", "LE", "EQ", "NE", "AND", "OR", "NOT")
        return self.uses[node] > 1 and self.sizes[node] >= SHARED and not logical

    def _written(self, node: int) -> Piece:
        name, args = self.program.nodes[node]
        if name == "INPUT":
            return self.names[args[1]], ATOM
        if name == "CONST":
            return self.notation.constant(args[0])
        if self._choice(node):
            return self._cases(node), ATOM
        text, holds, wanted = self.notation.operations[name]
        parts = [self.notation.bracketed(self.piece(k), most) for k, most in zip(args, wanted, strict=True)]
        return filled(text, *parts), holds

    def _choice(self, node: int) -> tuple[int, int, int | None] | None:
        """Condition and the two branches (none: zero), where a node is a choice."""
        name, args = self.program.nodes[node]
        if name == "IF_ELSE_ZERO":
            return args[0], args[1], None
        if name != "ADD":
            return None
        (one, a), (two, b) = (self.program.nodes[k] for k in args)
        if one != "IF_ELSE_ZERO" or two != "IF_ELSE_ZERO":
            return None
        if self.program.nodes[b[0]] == ("NOT", (a[0],)):
            return a[0], a[1], b[1]
        return (b[0], b[1], a[1]) if self.program.nodes[a[0]] == ("NOT", (b[0],)) else None

    def _cases(self, node: int) -> str:
        """A choice, and the choices in its last branch, as one."""
        rows: list[tuple[str, str]] = []
        here: int | None = node
        while here is not None and (here == node or not (here in self.pieces or self._is_shared(here))):
            found = self._choice(here)
            if found is None:
                break
            rows.append((self.piece(found[0])[0], self.piece(found[1])[0]))
            here = found[2]
        return self.notation.cases(rows, "0" if here is None else self.piece(here)[0])

    def _switch(self, node: int) -> str:
        name, args = self.program.nodes[node]
        return filled(SWITCHES[name], *(self.piece(k)[0] for k in args))
