"""The equations of blocks as the reference writes them: in LaTeX, as text, as MathML; held against the blocks."""

import re

import casadi as ca
import numpy as np
import pytest

from tsmblocks.html.block_facts import words
from tsmblocks.html.mathml import WIDEST, equation, mathml, printed_length
from tsmblocks.html.plain_formulas import LETTERS, plain
from tsmblocks.model.block import leaves
from tsmblocks.reference import blocks, examples
from tsmblocks.reference import trace as tracing
from tsmblocks.reference.trace import ATOM, COMPARE, LOOSE, PLUS, POWER, TIMES, Notation, listing

BLOCKS = {name: cls for family in blocks.families().values() for name, cls in family.items()}


def called(name):
    return (f"{name}(«0»)", ATOM, (LOOSE,))


PYTHON = Notation(
    {
        "ADD": ("«0» + «1»", PLUS, (PLUS, PLUS)),
        "SUB": ("«0» - «1»", PLUS, (PLUS, TIMES)),
        "NEG": ("-«0»", PLUS, (TIMES,)),
        "MUL": ("«0» * «1»", TIMES, (TIMES, TIMES)),
        "DIV": ("(«0») / («1»)", TIMES, (LOOSE, LOOSE)),
        "INV": ("1 / («0»)", TIMES, (LOOSE,)),
        "TWICE": ("2 * «0»", TIMES, (TIMES,)),
        "SQ": ("«0»**2", POWER, (ATOM,)),
        "EXP": called("exp"),
        "POW": ("«0»**(«1»)", POWER, (ATOM, LOOSE)),
        "CONSTPOW": ("«0»**(«1»)", POWER, (ATOM, LOOSE)),
        "SQRT": called("sqrt"),
        "FABS": called("abs"),
        "SIGN": called("sign"),
        "LOG": called("log"),
        "FLOOR": called("floor"),
        "LOG1P": called("log1p"),
        "EXPM1": called("expm1"),
        "FMIN": ("min(«0», «1»)", ATOM, (LOOSE, LOOSE)),
        "FMAX": ("max(«0», «1»)", ATOM, (LOOSE, LOOSE)),
        "LT": ("«0» < «1»", COMPARE, (PLUS, PLUS)),
        "LE": ("«0» <= «1»", COMPARE, (PLUS, PLUS)),
        "NOT": ("not «0»", LOOSE, (ATOM,)),
        "SIN": called("sin"),
        "COS": called("cos"),
        "TANH": called("tanh"),
    },
    brackets="(«0»)",
    shared="«0»«1»",
    constant=lambda value: (repr(value), ATOM if value >= 0 else PLUS),
    cases=lambda rows, rest: "(" + " ".join(f"{value} if {test} else" for test, value in rows) + f" {rest})",
    result=lambda kind, name: f"{kind}_{name}",
)
"""The same walk in a language that can be evaluated: what holds for its brackets holds for LaTeX's."""
MATHS = {k: getattr(np, k) for k in ("exp", "sqrt", "sign", "log", "floor", "log1p", "expm1", "sin", "cos", "tanh")}


@pytest.mark.parametrize("name", BLOCKS)
def test_equations_written_out_are_those_of_the_block(name):
    block = examples.example(BLOCKS[name]).blocks[examples.snake(name)]
    function, labels, results = tracing._function(block)
    plain = [f"v{k}" for k in range(len(labels))]
    sides = {k: k for _, k in results}
    made = listing(block, PYTHON, {**sides, **dict(zip(labels, plain, strict=True))})
    rng = np.random.default_rng(5)
    for scale in (0.3, 1.0, 2.0):
        numbers = rng.uniform(-1, 1, len(labels)) * scale
        fields = [
            leaf
            for key, value in block.parameters.items()
            if block.fields()[key].kind == "parameter"
            for leaf in leaves(value, key)
        ]
        numbers[len(labels) - len(fields) :] = [min(v, 1e3) for _, v in fields]
        scope = {**MATHS, "abs": abs, "min": min, "max": max, **dict(zip(plain, numbers, strict=True))}
        with np.errstate(all="ignore"):
            for shared, text in made.shared:
                scope[shared] = eval(text, scope)
            for side, text in made.equations:
                scope[side] = eval(text, scope)
            expected = np.array(function(ca.DM(numbers))).ravel()
        found = [float(scope[side]) for side, _ in made.equations]
        assert len(found) == len(results)
        assert found == pytest.approx(expected, rel=1e-12, abs=1e-12, nan_ok=True)


@pytest.mark.parametrize(
    ("name", "equations"),
    {
        "Saturation": {
            "y": r"\operatorname{min}\left(\operatorname{max}\left(u,\; \text{low}\right),\; "
            r"\text{high}\right)"
        },
        "HysteresisObserver": {
            "y": r"\zeta",
            r"\dot{\zeta}": r"A\,v - \theta\,\left|v\right|\,\zeta"
            r" + \delta\,\left|v\right|",
        },
        "Convert": {"y": r"\frac{180}{\pi}\,u"},
        "UnitDelay": {"y": r"\text{last}", r"\text{last}^{+}": "u"},
        "PID": {
            "y": r"\left(k_{p} + \frac{k_{d}}{\tau}\right)\,e + k_{i}\,\text{integral}"
            r" - \frac{k_{d}}{\tau}\,\text{smooth}",
            r"\dot{\text{integral}}": "e",
            r"\dot{\text{smooth}}": r"\frac{e - \text{smooth}}{\tau}",
        },
    }.items(),
)
def test_equations_in_latex(name, equations):
    assert dict(listing(BLOCKS[name]()).equations) == equations


def test_choices_within_choices_are_one_and_what_is_used_twice_has_a_letter():
    made = listing(BLOCKS["RateLimit"]())
    assert made.shared == (
        ("w_{1}", r"\text{last} + \text{rising}\,\left(t - \text{time}\right)"),
        ("w_{2}", r"\text{last} + \text{falling}\,\left(t - \text{time}\right)"),
    )
    assert made.equations[:2] == (
        (
            "y",
            r"\begin{cases} w_{1} & \text{if } w_{1} < u \\ w_{2} & \text{if } u < w_{2} \\ u & \text{otherwise} "
            r"\end{cases}",
        ),
        (r"\text{last}^{+}", "y"),
    )


FUNCTIONS = {"frac", "tfrac", "hat", "dot", "ddot", "max", "min", "tanh", "sin", "cos", "ln", "begin", "end"}


@pytest.mark.parametrize("name", BLOCKS)
def test_formulas_of_blocks_can_be_read_on_a_terminal(name):
    sentence, equation, remarks = words(BLOCKS[name])
    formulas = [equation, *re.findall(r":math:`(.+?)`", f"{sentence} {remarks}")]
    assert set(re.findall(r"\\([A-Za-z]+)", " ".join(formulas))) <= FUNCTIONS | set(LETTERS)
    for made in map(plain, formulas):
        assert not re.search(r"[\\&\0]", made)
        assert made.count("(") == made.count(")")


@pytest.mark.parametrize(
    ("latex", "text"),
    [
        (
            r"\dot\zeta &= A v - \vartheta |v| \zeta \\ y &= \alpha_x(v)\, x, \qquad v = \dot x_r",
            "ζ' = A v - ϑ |v| ζ\ny = α_x(v) x,   v = x_r'",
        ),
        (r"\alpha_1 e^{2v} + \frac{1 + s}{2} u_{k-1} - \tfrac12 \omega^2", "α₁ e^(2v) + (1 + s)/2 u_(k-1) - 1/2 ω²"),
        (r"\tanh\frac{t - t_0}{w} + \left[\frac{a}{g(v)}\right]^{n}", "tanh((t - t₀)/w) + [a/g(v)]^n"),
        (r"y = \begin{cases} a & u > 0 \\ 0 & \text{otherwise} \end{cases}", "y = {a if u > 0; 0 otherwise}"),
    ],
)
def test_formulas_as_text(latex, text):
    assert plain(latex) == text


def test_rows_and_columns_of_formulas_are_found_outside_of_environments_only():
    text = r"a &= \begin{cases} 1 & u \\ 2 & v \end{cases} \\ b &= \left[ \frac{c}{d} \right]"
    assert mathml(text).count("<mtr>") == 4  # two of the table, two of the cases
    assert mathml(r"a &= b \\ c &= d").count('<mtd class="right">') == 2
    assert "<mtable" not in mathml("y = k u")


def test_a_long_sum_goes_on_in_rows_and_brackets_stay_whole():
    term = r"\text{an even longer name} \cdot \left(b + c\right)"
    right = f"{term} + {term} - {term} + {term}"
    rows = equation("y", right).split("\\\\\n")
    assert len(rows) == 2
    assert all(row.count(term) == 2 and printed_length(row) <= WIDEST for row in rows)
    assert "".join(rows).replace(r"&\quad {}", "") == f"y &= {right}"
    assert equation("y", "-a + b") == "y &= -a + b"
    assert equation("y", rf"\left({right}\right)") == rf"y &= \left({right}\right)"  # a product of brackets has no sum


@pytest.mark.parametrize(
    ("latex", "parts"),
    [
        (r"a \cos n u", ['<mi>a</mi><mspace width="0.17em"/><mi>cos</mi><mo>&#x2061;</mo><mspace width="0.17em"/>']),
        (r"b \sin(n u)", ['<mspace width="0.17em"/><mi>sin</mi><mo>&#x2061;</mo><mo stretchy="false">&#x00028;</mo>']),
        (r"\tanh\left(\frac{v}{w}\right)", ["<mrow><mi>tanh</mi><mo>&#x2061;</mo><mrow><mo"]),
        (r"\sin^2 x", ["<msup><mi>sin</mi><mn>2</mn></msup>"]),
        (r"|v|", 2 * ['<mo stretchy="false" lspace="0" rspace="0">&#x0007C;</mo>']),
        (r"|v||w|", ['&#x0007C;</mo><mspace width="0.17em"/><mo stretchy="false" lspace="0" rspace="0">&#x0007C;']),
        (r"a \pm b", ["<mo>&#x000B1;</mo>"]),
    ],
)
def test_functions_bars_and_signs_have_the_spaces_of_print(latex, parts):
    made = mathml(latex)
    assert all(made.count(part) == parts.count(part) for part in parts), made
