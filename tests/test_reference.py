"""The reference: every page is there, links lead somewhere, numbers are the blocks', and code shown was run."""

import contextlib
import io
import itertools
import math
import re
import sys
import textwrap
from functools import cache
from html.parser import HTMLParser
from pathlib import Path
from urllib.parse import unquote, urlsplit

import casadi as ca
import numpy as np
import pytest

import tsmblocks as tsm
from tsmblocks.blocks import DeadTime, Delay, Gain, LeadLag, Play, Resonance, Sine
from tsmblocks.cli import main
from tsmblocks.cli.entry import COMMANDS
from tsmblocks.compiler.compile import compile_diagram
from tsmblocks.files.shipped import shipped_names
from tsmblocks.html.block_facts import words
from tsmblocks.html.mathml import mathml
from tsmblocks.html.plain_formulas import LETTERS, plain
from tsmblocks.model.block import leaves
from tsmblocks.reference import blocks, examples, python, uses
from tsmblocks.reference import trace as tracing
from tsmblocks.reference.trace import ATOM, COMPARE, LOOSE, PLUS, POWER, TIMES, Notation, listing

CONCEPTS = Path(blocks.__file__).parent / "pages" / "concepts"
BLOCKS = {name: cls for family in blocks.families().values() for name, cls in family.items()}
LOADED = {("script", "src"), ("link", "href"), ("img", "src"), ("iframe", "src"), ("source", "src"), ("object", "data")}
"""Attributes whose addresses a browser fetches by itself."""


# ---- equations written out ---------------------------------------------------------------------------


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


# ---- examples ---------------------------------------------------------------------------------------


@pytest.mark.parametrize("name", BLOCKS)
def test_the_script_and_the_file_of_an_example_make_the_diagram_that_is_drawn(name):
    made = examples.example(BLOCKS[name])
    scope = {}
    assembling, _, running = examples.script(made).rpartition("run = ")
    exec(assembling, scope)
    assert scope["diagram"] == made
    assert running.startswith("tsm.simulate(diagram, stop=")
    assert tsm.loads(tsm.dumps(made)) == made


def test_examples_are_of_blocks_that_exist():
    assert {*examples.SET, *examples.DRIVE, *examples.STOPS} <= set(BLOCKS)
    assert set(blocks.FAMILY_WORDS) == set(blocks.families())


def shown_code(path):
    """Code of a page with what it says that is printed."""
    pattern = r"\.\. code-block:: python\n\n((?:   .*\n|\n)+)(?:\.\. code-block:: none\n\n((?:   .*\n|\n)+))?"
    return [
        (textwrap.dedent(code), textwrap.dedent(said or "").strip())
        for code, said in re.findall(pattern, path.read_text(encoding="utf-8"))
    ]


@pytest.mark.parametrize("path", [p for p in sorted(CONCEPTS.glob("*.rst")) if p.stem != "index"], ids=lambda p: p.stem)
def test_code_of_a_concept_prints_what_the_page_says(path):
    scope = {"__name__": "__main__"}
    assert shown_code(path)
    for code, said in shown_code(path):
        printed = io.StringIO()
        with contextlib.redirect_stdout(printed):
            exec(compile(code, "page.py", "exec"), scope)
        assert printed.getvalue().strip() == said


# ---- the pages --------------------------------------------------------------------------------------


class Html(HTMLParser):
    """Addresses in a page, its anchors, the cells of its tables, its words."""

    def __init__(self, text):
        super().__init__()
        self.links, self.loaded, self.anchors, self.rows, self.words = [], [], {""}, [], []
        self.feed(text)

    def handle_starttag(self, tag, attributes):
        for key, value in attributes:
            if (tag, key) in LOADED and ("rel", "search") not in attributes:
                self.loaded.append(value)
            if key == "href" and tag == "a":
                self.links.append(value)
            if key == "id":
                self.anchors.add(value)
        if tag == "tr":
            self.rows.append([])
        if tag in ("td", "th") and self.rows:
            self.rows[-1].append("")

    def handle_data(self, data):
        self.words.append(data)
        if self.rows and self.rows[-1]:
            self.rows[-1][-1] += data


@pytest.fixture(scope="module")
def site(tmp_path_factory):
    folder = tmp_path_factory.mktemp("reference")
    assert main(["reference", "--out", str(folder)]) == 0  # a warning of Sphinx would be an error
    return folder


@cache
def read(path):
    return Html(path.read_text(encoding="utf-8"))


def test_every_block_diagram_effect_command_and_public_name_has_its_place(site):
    def pages(kind):
        return {path.stem for path in (site / kind).glob("*.html")} - {"index"}

    assert pages("blocks") == set(BLOCKS) == set(tsm.blocks.__all__) - {"from_control", "function_block"}
    assert pages("diagrams") == set(shipped_names())
    assert pages("effects") == set(uses.effects())
    assert pages("commands") == set(COMMANDS)
    assert pages("concepts") == {path.stem for path in CONCEPTS.glob("*.rst")} - {"index"}
    said = {name for _, _, some in python.GROUPS.values() for name in some}
    modules = {name for some in python.MODULES.values() for name in some} | {"blocks"}
    assert said | (modules - {"effects", "testing"}) == set(tsm.__all__)
    anchors = {anchor for path in (site / "python").glob("*.html") for anchor in read(path).anchors}
    assert {f"tsmblocks.{name}" for name in said} <= anchors


def test_links_lead_somewhere_and_nothing_is_loaded_from_elsewhere(site):
    styles = [path.read_text(encoding="utf-8") for path in site.rglob("*.css")]
    assert not [one for text in styles for one in re.findall(r"@import[^;]*|url\(\s*[\"']?(?:https?:)?//[^)]*", text)]
    for path in site.rglob("*.html"):
        page = read(path)
        for address in page.loaded:
            assert not re.match(r"[a-z]+:|//", address), f"{path.name} loads {address}"
        for address in page.links:
            parts = urlsplit(address)
            if parts.scheme or parts.netloc:
                continue
            target = (path.parent / unquote(parts.path)).resolve() if parts.path else path
            assert target.is_file(), f"{path.name}: {address}"
            if target.suffix == ".html":
                assert unquote(parts.fragment) in read(target).anchors, f"{path.name}: {address}"


def test_numbers_on_the_pages_of_blocks_are_their_own(site):
    for name, cls in BLOCKS.items():
        block, page = cls(), read(site / "blocks" / f"{name}.html")
        rows = {row[0].strip(): [cell.strip() for cell in row] for row in page.rows if len(row) == 5}
        for key, field in block.fields().items():
            if field.kind != "state":
                compare(f"{name}.{key}", field, getattr(block, key), *rows[key][1:4])
        assert block.source.split(",")[0].split(";")[0] in " ".join(page.words), name


def compare(owner, field, value, default, unit, bounds):
    """A row of a table beside what the block declares."""
    if isinstance(value, float):
        assert float(default.replace("∞", "inf").replace("−", "-")) == pytest.approx(value, rel=1e-5), owner
    if field.unit and "?" not in field.unit:
        assert unit == field.unit, owner
    if math.isfinite(field.low) and math.isfinite(field.high):
        assert re.findall(r"[-\d.e]+", bounds) == [f"{field.low:g}", f"{field.high:g}"], owner


def test_what_pages_say_of_feedthrough_is_what_closes_an_algebraic_loop():
    tried = 0
    for name, cls in BLOCKS.items():
        block, text = cls(), blocks._feedthrough(cls())
        rates = {port.rate_of for port in block.inports.values()} - {""}  # a loop may go by the rate alone
        inputs = [k for k, port in block.inports.items() if not port.rate_of]
        for inlet, outlet in itertools.product([k for k in inputs if k not in rates], block.outports):
            others = {k: f"b.{k}" for k in inputs if k != inlet}
            closed = tsm.Diagram(
                blocks=dict(b=block, g=Gain(gain=0.5)),
                wires=[f"b.{outlet} -> g", f"g -> b.{inlet}"],
                inputs=others,
                outputs={"y": f"b.{outlet}"},
            )
            said = re.search(rf"``{outlet}`` depends on ([^,.]*)", text)
            there = said is not None and f"``{inlet}``" in said[1]
            with pytest.raises(tsm.errors.AlgebraicLoop) if there else contextlib.nullcontext():
                compile_diagram(closed, refuse_loops=True)
            assert there or outlet in text or "breaks algebraic loops" in text, name
            tried += 1
    assert tried > 80


@pytest.mark.parametrize(("cls", "charts"), [(Play, 2), (LeadLag, 1), (Resonance, 1), (Sine, 1)])
def test_what_answers_a_step_is_not_drawn_over_the_step(cls, charts):
    assert blocks._charts(cls).count("<svg") == charts


def test_blocks_that_read_the_past_are_not_said_to_be_of_one_instant():
    assert "earlier instants" in blocks._time(Delay())
    assert "earlier instants" in blocks._time(DeadTime())
    assert "same instant" in blocks._time(Gain())


def test_every_formula_becomes_mathml():
    for cls in BLOCKS.values():
        for text in (words(cls)[1], *(right for _, right in listing(cls()).equations)):
            assert "\\" not in re.sub(r"<annotation.*?</annotation>", "", mathml(text), flags=re.DOTALL), cls


def test_what_is_missing_is_named(monkeypatch, tmp_path, capsys):
    monkeypatch.setitem(sys.modules, "furo", None)
    assert main(["reference", "--out", str(tmp_path / "none")]) == 2
    said = 'The reference needs furo, which is not installed: pip install "tsmblocks[reference]"'
    assert capsys.readouterr().err.strip() == f"tsmblocks: {said}"
    assert not (tmp_path / "none").exists()
