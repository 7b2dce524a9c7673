"""The reference: every page is there, links lead somewhere, numbers are the blocks', and code shown was run."""

import contextlib
import html
import io
import itertools
import json
import math
import re
import sys
from functools import cache
from html.parser import HTMLParser
from pathlib import Path
from urllib.parse import unquote, urlsplit
from xml.etree import ElementTree

import numpy as np
import pytest
from PIL import Image

import tsmblocks as tsm
from tsmblocks.blocks import DeadTime, Delay, Gain, LeadLag, Play, Resonance, Sine, Sum
from tsmblocks.cli import main
from tsmblocks.cli.entry import COMMANDS
from tsmblocks.common import units
from tsmblocks.compiler.compile import compile_diagram
from tsmblocks.data.noise_floor import CONTENT
from tsmblocks.diagnosis.decision import MIN_VARIANCE_REDUCTION
from tsmblocks.diagnosis.variants import VARIANT_WORDS
from tsmblocks.files.shipped import shipped_names
from tsmblocks.fitting.identifiability import NO_INFLUENCE
from tsmblocks.fitting.summary import OPEN_VERDICT, UNCERTAIN_VERDICT
from tsmblocks.html.block_facts import words
from tsmblocks.html.mathml import mathml
from tsmblocks.model.block import Block
from tsmblocks.reference import blocks, effects, examples, gallery, hand_written, navigation, python, search_words, uses
from tsmblocks.reference.trace import listing
from tsmblocks.studies.files import KEYS as STUDY_KEYS
from tsmblocks.studies.files import PLANS as STUDY_PLANS

PAGES = {
    path.relative_to(hand_written.FOLDER).with_suffix("").as_posix(): path
    for path in sorted(hand_written.FOLDER.rglob("*.rst"))
}
"""Pages that are written by hand."""
WITHOUT_CODE = {"installation", "comparison", "glossary"}
BLOCKS = {name: cls for family in blocks.families().values() for name, cls in family.items()}
LOADED = {("script", "src"), ("link", "href"), ("img", "src"), ("iframe", "src"), ("source", "src"), ("object", "data")}
"""Attributes whose addresses a browser fetches by itself."""


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


README = Path(__file__).parents[1] / "README.md"  # whose commands have a test of their own


def text_of(page):
    return PAGES[page].read_text(encoding="utf-8")


NUMBER = re.compile(r"-?\d+(?:\.\d+)?(?:e[-+]?\d+)?")


def same_but_for_rounding(printed, said):
    """Whether two texts differ at most by one unit of the last digit of their numbers: processors round differently."""
    pairs = [*zip(NUMBER.findall(printed), NUMBER.findall(said), strict=False)]
    words = [" ".join(NUMBER.sub("0", text).split()) for text in (printed, said)]
    return words[0] == words[1] and all(
        abs(float(a) - float(b)) <= 1.001 * max(last_digit(a), last_digit(b)) for a, b in pairs
    )


def last_digit(number):
    """The value of one unit of a number's last digit; of a whole number, none: it is a count."""
    digits, _, power = number.partition("e")
    decimals = len(digits.partition(".")[2])
    return 10.0 ** (int(power or 0) - decimals) if decimals else 0.0


@pytest.mark.parametrize(
    ("printed", "said", "same"),
    [
        ("u  3.113  3.919\n", "u  3.113   3.92\n", True),
        ("u  3.113  3.918\n", "u  3.113   3.92\n", True),
        ("u  3.113  3.917\n", "u  3.113  3.919\n", False),
        ("u  3.113  3.91\n", "u  3.113  3.93\n", False),
        ("22 effects\n", "23 effects\n", False),
        ("1.25e-05 m\n", "1.26e-05 m\n", True),
        ("1.25e-05 m\n", "1.26e-05 mm\n", False),
    ],
)
def test_numbers_of_a_page_may_differ_in_their_last_digit_alone(printed, said, same):
    assert same_but_for_rounding(printed, said) is same


@pytest.mark.parametrize("page", [page for page in PAGES if not page.endswith("index") and page not in WITHOUT_CODE])
def test_code_of_a_page_prints_what_the_page_says(page):
    code = hand_written.shown(text_of(page))
    assert code
    for printed, (_, said) in zip(hand_written.executed(text_of(page))[0], code, strict=True):
        assert printed == said or same_but_for_rounding(printed, said), f"{printed}\n---- the page says ----\n{said}"
    assert max(len(line) for piece, _ in code for line in piece.splitlines()) <= 100  # what a page shows


def test_the_page_on_studies_names_all_that_a_file_may_have():
    text = text_of("howto/study")
    for key in STUDY_KEYS:
        assert f"``{key}``" in text or f"``[{key}]``" in text
    for kind in STUDY_PLANS:
        assert f"``{kind}``" in text


COMMANDS_SHOWN = sorted(
    {line for page in PAGES for line in re.findall(r"^   (tsmblocks [^)\n]*)$", text_of(page), re.M)}
    - {*README.read_text("utf-8").splitlines()}
)


@pytest.mark.parametrize("line", COMMANDS_SHOWN)
def test_commands_on_the_pages_run(line, tmp_path, monkeypatch, capsys):
    monkeypatch.chdir(tmp_path)
    rows = [f"{k / 20},{50 * math.sin(k / 20):.3f},{40 * math.sin(k / 20 - 0.5):.3f}" for k in range(260)]
    (tmp_path / "sheath.csv").write_text("\n".join(["t [s], x_in [deg], x_out [deg]", *rows]))
    assert main(line.split()[1:]) == 0
    assert capsys.readouterr().out


def test_figures_of_the_comparison_are_measured():
    text = text_of("comparison")
    lines = (Path(__file__).parent / "benchmarks" / "README.md").read_text("utf-8").splitlines()
    printed = {
        cells[0]: set(cells) for line in lines if len(cells := [c.strip() for c in line.strip("|").split("|")]) == 10
    }
    rows = re.findall(r"   \* - (.+ \d+\.\d+\.\d+)\n     - .+\n     - (.+)\n     - (.+)\n     - (.+)\n", text)
    assert len(rows) == 8
    for tool, *figures in rows:
        assert set(figures) <= printed[tool]
    assert f"     - {len(BLOCKS)}\n" in text


# ---- the pages --------------------------------------------------------------------------------------


CODE = ("pre", "code", "style", "script")
"""Elements whose text is no prose."""


class Html(HTMLParser):
    """Addresses in a page, its anchors, the cells of its tables, its words."""

    def __init__(self, text):
        super().__init__()
        self.links, self.loaded, self.anchors, self.rows, self.words = [], [], {""}, [], []
        self.headings, self.pictures, self.prose, self.open_code = [], [], [], 0
        self.feed(text)

    def handle_starttag(self, tag, attributes):
        self.open_code += tag in CODE
        if re.fullmatch("h[1-6]", tag):
            self.headings.append(int(tag[1]))
        given = dict(attributes)
        if tag == "img":
            self.pictures.append(given.get("alt"))
        if tag == "svg" and given.get("class") in ("block-diagram", "chart"):
            self.pictures.append(given.get("aria-label"))
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

    def handle_endtag(self, tag):
        self.open_code -= tag in CODE

    def handle_data(self, data):
        self.words.append(data)
        if not self.open_code:
            self.prose.append(data)
        if self.rows and self.rows[-1]:
            self.rows[-1][-1] += data


DRAWN = "11_paper_feedback"
"""The example that is run for its page here; the others have tests of their own."""


@pytest.fixture(scope="module")
def site(tmp_path_factory):
    folder = tmp_path_factory.mktemp("reference")
    said = io.StringIO()
    with pytest.MonkeyPatch.context() as there, contextlib.redirect_stderr(said):
        there.setattr(gallery.Example, "quick", property(lambda one: one.name == DRAWN))
        assert main(["reference", "--out", str(folder)]) == 0  # a warning of Sphinx would be an error
    assert "warning" not in said.getvalue()  # what is drawn is converged
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
    assert pages("families") == set(blocks.families())
    assert pages("gallery") == {one.name for one in gallery.listed()}
    assert all((site / f"{page}.html").is_file() for page in PAGES)
    said = {name for _, _, some in python.GROUPS.values() for name in some}
    modules = {name for some in python.MODULES.values() for name in some} | {"blocks"}
    assert said | (modules - {"effects", "testing"}) == set(tsm.__all__)
    anchors = {anchor for path in (site / "python").glob("*.html") for anchor in read(path).anchors}
    assert {f"tsmblocks.{name}" for name in said} <= anchors


def test_no_two_variants_on_the_page_of_an_effect_have_one_heading(site):
    for path in (site / "effects").glob("*.html"):
        headings = re.findall(r"<h2>(.*?)<a ", path.read_text(encoding="utf-8"))
        assert headings
        assert len(set(headings)) == len(headings), path.name


def test_every_unit_and_every_spelling_is_on_the_page_of_units(site):
    text = (site / "concepts" / "units.html").read_text(encoding="utf-8")
    known = {html.unescape(one) for one in re.findall(r'<span class="pre">([^<]*)</span>', text)}
    assert {*units.NAMES, *(other for some in units.spellings().values() for other in some)} <= known


def test_links_lead_somewhere_and_nothing_is_loaded_from_elsewhere(site):
    styles = [path.read_text(encoding="utf-8") for path in site.rglob("*.css")]
    assert not [one for text in styles for one in re.findall(r"@import[^;]*|url\(\s*[\"']?(?:https?:)?//[^)]*", text)]
    for path in site.rglob("*.html"):
        page = read(path)
        for address in page.loaded:
            assert not re.match(r"(?!data:)[a-z]+:|//", address), f"{path.name} loads {address}"
        for address in page.links:
            parts = urlsplit(address)
            if parts.scheme or parts.netloc:
                continue
            target = (path.parent / unquote(parts.path)).resolve() if parts.path else path
            assert target.is_file(), f"{path.name}: {address}"
            if target.suffix == ".html":
                assert unquote(parts.fragment) in read(target).anchors, f"{path.name}: {address}"


@pytest.mark.parametrize("page", ["index", "diagrams/tendon_sheath_play"])
def test_blocks_in_a_drawing_lead_to_their_pages(site, page):
    text = (site / f"{page}.html").read_text(encoding="utf-8")
    (drawn,) = re.findall(r'<div class="picture.*?</svg>', text, re.DOTALL)
    linked = re.findall(r'<a href="([^"]*blocks/\w+)\.html"><g class="\w+" data-block="', drawn)
    assert len(linked) == len(re.findall("data-block=", drawn)) > 0
    assert 'role="group"' in drawn  # an image has nothing inside that a key could reach


SHAPES = {"a", "circle", "clipPath", "defs", "ellipse", "g", "line", "path", "polygon", "polyline", "rect", "style"}
"""Elements of a drawing, beside its words. Within any other one, or one that does not end, nothing is shown."""


def test_a_drawing_is_made_of_shapes_and_a_page_has_one_icon(site):
    drawn = 0
    for path in site.rglob("*.html"):
        text = path.read_text(encoding="utf-8")
        head, _, body = text.partition("</head>")
        assert head.count('rel="icon"') == 1, path
        assert 'rel="icon"' not in body, path
        for one in re.findall(r'<svg [^>]*class="(?:block-diagram|chart)".*?</svg>', body, re.DOTALL):
            tags = {element.tag.rpartition("}")[2] for element in ElementTree.fromstring(one).iter()}
            assert tags <= {*SHAPES, "svg", "text", "tspan", "title", "desc", "use"}, path
            drawn += 1
    assert drawn > 400


def test_pages_have_one_title_headings_in_order_and_words_for_pictures(site):
    drawn = 0
    for path in site.rglob("*.html"):
        page = read(path)
        assert page.headings.count(1) == 1, path
        text = path.read_text(encoding="utf-8")
        sections = [re.sub("<.*?>", "", words) for words in re.findall(r"<h2[^>]*>(.*?)</h2>", text, re.DOTALL)]
        assert len(set(sections)) == len(sections), path
        assert all(after <= before + 1 for before, after in itertools.pairwise(page.headings)), path
        assert all(words and words.strip() for words in page.pictures), path
        drawn += len(page.pictures)
    assert drawn > 400
    assert len(read(site / "gallery" / f"{DRAWN}.html").pictures) == 1


def test_boxes_that_scroll_are_reached_by_key_and_regions_and_columns_are_named(site):
    for path in site.rglob("*.html"):
        text = path.read_text(encoding="utf-8")
        boxes = re.findall(r'<(?:pre|div(?= [^>]*class="(?:table-wrapper|plot)\b))[^>]*>', text)
        assert all('tabindex="0"' in box for box in boxes), path
        assert all("aria-label=" in region for region in re.findall("<aside[^>]*>", text)), path
        assert not re.search(r"<th[^>]*>\s*(?:<p>\s*</p>\s*)?</th>", text), path


def test_signatures_show_no_internal_default_and_cards_show_small_pictures(site):
    for path in (site / "python").glob("*.html"):
        assert "NOTHING" not in path.read_text(encoding="utf-8"), path
    text = (site / "diagrams" / "index.html").read_text(encoding="utf-8")
    cards = dict(re.findall(r'<a class="card" href="(\w+)\.html">(.*?)</a>', text, re.DOTALL))
    across = {name for name, card in cards.items() if 'class="drawing across"' in card}
    assert set(cards) == set(shipped_names())
    assert {"fig16_feedforward_feedback"} <= across <= {k for k in cards if not k.startswith("tendon_sheath")}
    wide = [float(width) for width in re.findall(r'class="drawing" style="--w:([\d.]+)px"', text)]
    assert len(wide) == len(cards) - len(across)
    assert max(wide) <= max(uses.ROWS)
    gallery_index = (site / "gallery" / "index.html").read_text(encoding="utf-8")
    assert '<img src="../_images/' in gallery_index
    assert gallery_index.count('class="drawing') > 5


MISSPELT = {
    *(
        "accross",
        "agressive",
        "alot",
        "aproximate",
        "begining",
        "comparision",
        "compensater",
        "consistant",
        "controler",
    ),
    *(
        "dependant",
        "derivate",
        "diagramm",
        "existance",
        "explicitely",
        "frequence",
        "freqency",
        "histeresis",
        "hysterisis",
    ),
    *("independant", "lenght", "liniar", "occured", "occurence", "paramter", "paramater", "parametre"),
    *("perfomance", "presicion", "recieve", "refered", "seperate", "simulatation", "succesful", "tolerence", "wich"),
    *("behavior", "color", "center", "discretized", "normalized", "optimization's", "teh", "adress"),
}
"""Frequent slips, and American spellings where the package has British ones."""


def test_no_word_is_misspelt(site):
    for path in site.rglob("*.html"):
        words = set(re.findall(r"[a-z']+", " ".join(read(path).prose).lower()))
        assert not words & MISSPELT, f"{path.name}: {words & MISSPELT}"


def test_arguments_are_listed_with_type_and_meaning(site):
    words = " ".join(" ".join(read(site / "python" / "fits.html").words).split())
    assert re.search(r"starts *:? *int, default 4 *Number of starting points", words)
    assert re.search(r"window *:? *\(float, float\) or dict of str to these, optional", words)
    for page in (site / "python").glob("*.html"):
        assert not re.search(r"Parameters\s+-{4}|:param ", " ".join(read(page).words)), page


def test_pages_show_the_version_and_offer_to_copy_code(site):
    page = read(site / "getting_started.html")
    assert f"tsmblocks {tsm.__version__}" in " ".join(page.words)
    assert any("copybutton.js" in address for address in page.loaded)


def test_the_glossary_has_the_words_and_limits_of_the_code(site):
    page = read(site / "glossary.html")
    said = " ".join(" ".join(page.words).split())
    for one in (*CONTENT.values(), *VARIANT_WORDS.values(), f"at least {100 * MIN_VARIANCE_REDUCTION:g} %"):
        assert one in said
    assert {
        f"term-{verdict.replace(' ', '-')}" for verdict in (NO_INFLUENCE, OPEN_VERDICT, UNCERTAIN_VERDICT)
    } <= page.anchors
    assert not re.search(r"@\w+@", said)


def test_figures_have_a_palette_which_keeps_pages_light(site):
    figures = list((site / "_images").glob("*.png"))
    assert len(figures) > 10
    for path in figures:
        with Image.open(path) as picture:
            assert picture.mode == "P", path.name


SEARCHES = {
    "howto/bode": (
        *("Bode", "Bode plot", "phase margin", "Nyquist"),
        *("linearize", "describing function", "pole placement"),
    ),
    "howto/names": ("coming from Simulink",),
    "howto/subsystem": ("Subsystem",),
    "howto/plot": ("scope", "plot", "to workspace"),
    "howto/tune": ("PID tuning", "tune"),
    "howto/study": ("Monte Carlo", "parameter sweep", "sweep parameters"),
    "howto/export_c": ("C code", "code generation"),
    "howto/guard": ("regression test", "pytest"),
    "howto/fit": ("parameter estimation", "least squares", "unit of an input"),
    "howto/diagnose": ("unmodelled dynamics", "root cause"),
    "howto/response": ("step response", "lsim", "impulse response"),
    "getting_started": ("connect", "interconnect", "DiagramBuilder"),
    "glossary": ("glossary", "fit %", "noise floor", "residual", "confidence interval", "hold-out", "no influence"),
    "howto/continue": ("initial conditions", "steady state", "trim"),
    "howto/step": ("solver", "step size", "ode4"),
    "howto/recordings": ("CSV", "import data", "semicolon", "decimal comma", "CSV Excel European"),
    "howto/metrics": ("overshoot", "settling time", "rise time", "tracking error", "ITAE", "ISE"),
    "installation": ("install", "pip"),
    "comparison": ("Simulink", "PathSim", "speed"),
    "families/hysteresis": ("hysteresis",),
    "families/friction": ("friction", "stick-slip", "stiction"),
    "blocks/FirstOrderLag": ("low-pass", "low pass filter", "lowpass", "PT1"),
    "blocks/DeadZone": ("deadband", "dead band", "dead zone", "dead-band"),
    "blocks/Play": ("backlash", "gear backlash"),
    "blocks/TransferFunction": ("Transfer Fcn", "transfer function"),
    "blocks/ZeroOrderHold": ("Zero-Order Hold", "ZOH"),
    "blocks/LookupTable": ("Lookup Table", "1-D Lookup Table"),
    "blocks/RateLimit": ("Rate Limiter", "slew rate"),
    "blocks/Delay": ("Transport Delay",),
    "blocks/Saturation": ("saturation",),
    "blocks/PIDController": ("PID Controller", "anti-windup"),
    "blocks/DiscreteIntegrator": ("Discrete-Time Integrator",),
    "blocks/StateSpace": ("State-Space",),
    "blocks/StribeckFriction": ("Stribeck",),
    "blocks/CoulombFriction": ("dry friction", "Coulomb friction"),
    "blocks/Random": ("white noise", "Band-Limited White Noise"),
    "blocks/UnitDelay": ("Unit Delay", "memory"),
    "tutorials/block": ("custom block", "MATLAB Function", "S-Function"),
    "tutorials/loop": ("python-control",),
}
"""Page -> what people type to find it."""


@pytest.fixture(scope="module")
def index(site):
    text = (site / "searchindex.js").read_text(encoding="utf-8")
    return json.loads(text.removeprefix("Search.setIndex(").removesuffix(")"))


def best(index, query):
    """Pages with the highest score, as Sphinx's search computes it from titles, index entries and names of objects."""
    typed, scores = query.lower().strip(), {}
    for title, places in index["alltitles"].items():
        if typed in title.lower() and len(typed) >= len(title) / 2:
            for page, _ in places:
                scores.setdefault(round(15 * len(typed) / len(title)) + (index["titles"][page] == title), set()).add(
                    page
                )
    for entry, places in index["indexentries"].items():
        if typed in entry and len(typed) >= len(entry) / 2:
            for page, _, main_entry in places:
                assert main_entry, entry  # the others come after all results
                scores.setdefault(round(100 * len(typed) / len(entry)), set()).add(page)
    return {index["docnames"][page] for page in scores[max(scores)]} if scores and max(scores) > 26 else set()


@pytest.mark.parametrize("page", SEARCHES)
def test_the_words_that_people_use_lead_to_the_page(page, index):
    assert {query: best(index, query) for query in SEARCHES[page]} == {query: {page} for query in SEARCHES[page]}


def test_words_of_the_search_are_of_families_and_blocks_that_exist():
    assert set(search_words.FAMILIES) <= set(blocks.families())
    assert set(search_words.BLOCKS) <= set(BLOCKS)


def test_the_sidebar_lists_two_levels_and_the_way_to_the_open_page():
    children = {"index": ["a", "b"], "a": ["a1", "a2"], "a1": ["deep"], "b": []}
    names = ["a", "b", "a1", "a2", "deep"]
    parents = {child: name for name, some in children.items() for child in some}
    assert navigation.way(parents, "deep") == ["index", "a", "a1", "deep"]
    titles = {name: f"<{name}>" for name in names}

    def listed(path):
        made = navigation.tree(children, titles, {name: f"{name}.html" for name in names}, path)
        return re.findall(r'href="(\w+)\.html">&lt;', made), re.findall(r'current" href="(\w+)\.html', made)

    assert listed(["index", "b"]) == (["a", "a1", "a2", "b"], ["b"])
    assert listed(["index", "a", "a1"]) == (["a", "a1", "deep", "a2", "b"], ["a", "a1"])


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


def test_ports_that_depend_on_options_have_an_example():
    redefined = {
        name
        for name, cls in BLOCKS.items()
        if any(k in vars(base) for base in cls.mro()[: cls.mro().index(Block)] for k in ("inports", "outports"))
    }
    assert redefined == set(examples.OTHER_PORTS)
    said = blocks._other_ports(Sum)
    assert said.endswith('``Sum(signs="++-")`` has the inputs ``plus1``, ``plus2`` and ``minus`` and the output ``y``.')
    assert blocks._other_ports(Gain) == ""


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


# ---- pages of effects ---------------------------------------------------------------------------------


def test_values_on_the_page_of_an_effect_have_their_units():
    page = effects.page("backlash", uses.effects()["backlash"])
    assert re.search(r"``half_width`` = [\d.]+ deg[,:]", page)
    assert "from 0.942 rad/s to 900 rad/s" in effects.page("resonance", uses.effects()["resonance"])
    assert page.count(blocks.LETTERS) == 1
    assert blocks.LETTERS not in effects.page("resonance", uses.effects()["resonance"])


def test_the_headings_of_an_effect_begin_with_the_place():
    page = effects.page("position_ripple", uses.effects()["position_ripple"])
    assert "\nOutput: a ripple over the position (eccentricity)\n" in page
    assert "\nLoad: a ripple of the force over the position (cogging)\n" in page


def test_an_effect_in_front_of_the_model_is_not_described_twice():
    opening = effects.page("backlash", uses.effects()["backlash"]).split("\n:Family")[0]
    places = "inside the control loop", "inside the transmission", "in the elastic transmission"
    kinds = "; ".join(["A backlash gap", *(f"a backlash gap {place}" for place in places)]) + "."
    assert opening.rstrip().endswith(f"\n\n{kinds}")


def test_a_ripple_is_drawn_with_few_periods():
    for effect in uses.effects()["position_ripple"]:
        made = effects.placed(effect)
        (cycles,) = (value for name, value in made.sizes.items() if name.endswith("cycles"))
        moved = np.ptp(effects.traces(made).signals[next(iter(made.diagram.outputs))])
        assert 2 < np.radians(moved) * cycles / (2 * np.pi) < 8
