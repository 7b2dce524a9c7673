"""What all pages have in common: structure for every reader, legends, and colours that hold for every eye."""

import itertools
import re

import attrs
import pytest

from tests.diagnoses import NAMED, NONE, UNKNOWN, diagnosis
from tests.pages import Page, faults, unexplained
from tests.palette import VISION, contrast, distance, themes
from tests.views_everywhere import examples
from tsmblocks.common.version import __version__
from tsmblocks.html.pages import headings, part, sentence, style, width, with_ids
from tsmblocks.html.report import page

UNEXPLAINED = attrs.evolve(UNKNOWN, traces=tuple(attrs.evolve(one, after=one.before) for one in UNKNOWN.traces))
REPORTS = {"named": NAMED, "unknown": UNEXPLAINED, "none": attrs.evolve(NONE, traces=UNEXPLAINED.traces)}
THEMES = themes(style("page.css"))
TEXTS = {"ink": 7.0, "soft": 4.5, "link": 4.5, "floor": 4.5, "after": 4.5, "before": 4.5, "gone": 4.5}
"""Colours of texts, and the least contrast of each (WCAG 2.1, 1.4.6 and 1.4.3)."""
MEANINGS = ("measured", "input", "floor", "before", "between", "after", "open", "forward", "feedback", "gone")
"""Colours that mean something: what is measured, the motor, noise, models, compensators, lines taken out."""
TOGETHER = (
    ("measured", "before", "after"),
    ("before", "between", "after"),
    ("input", "measured"),
    ("open", "forward", "after"),
    ("open", "forward", "feedback"),
)
"""Colours of lines and bars that one chart shows; what else it shows is dashed and labelled."""


# ---- structure


@pytest.mark.parametrize("name", REPORTS)
def test_a_report_has_the_structure_that_readers_of_any_kind_need(name):
    text = page(diagnosis(REPORTS[name]), ("../index.html", "Demonstration"))
    assert faults(text) == []
    assert unexplained(text) == set()
    assert f"<footer>tsmblocks {__version__}; seed 3. Status: the search was completed.</footer>" in text
    shown = Page(text)
    assert shown.links[0] == "../index.html"
    assert [one for one in shown.links if one.startswith("#")] == [f"#{name}" for name, _ in headings(text_of(text))]


def text_of(page_text):
    """A page with its headings as they were written: without ids."""
    return re.sub(r"<h([23]) id=\"[^\"]*\">", r"<h\1>", page_text)


def test_a_report_that_belongs_to_no_page_has_no_way_back():
    assert 'class="back"' not in page(diagnosis(NAMED))


def test_every_card_has_captions_scopes_and_labels():
    cards = {name: made._repr_html_() for name, made in examples().items() if hasattr(made, "_repr_html_")}
    assert len(cards) > 10
    assert {name: found for name, card in cards.items() if (found := faults(card, whole=False))} == {}


def test_what_is_wrong_with_a_structure_is_found():
    assert faults("<main><h1>a</h1><h3>b</h3></main><footer></footer>") == ["h3 without id: {}", "h1 before h3"]
    assert faults("<table><tr><th>a</th></tr></table>", whole=False) == ["1 tables, 0 captions", "th without scope: {}"]
    assert faults('<p id="a"></p><p id="a"></p><a href="#b">b</a>', whole=False) == ["id a twice", "no place #b"]
    assert unexplained('<path class="line before"/><span style="--c:var(--after)">') == {"before"}


def test_headings_get_ids_and_those_of_the_same_words_get_numbers():
    written = "<h2>A &amp; b</h2><h3>Round <i>1</i></h3><h2>A b</h2><h2>…</h2>"
    assert headings(written) == [("a-b", "A &amp; b"), ("a-b-2", "A b"), ("part", "…")]
    assert with_ids(written) == (
        '<h2 id="a-b">A &amp; b</h2><h3 id="round-1">Round <i>1</i></h3><h2 id="a-b-2">A b</h2><h2 id="part">…</h2>'
    )


def test_a_drawing_says_how_wide_it_is_so_that_a_narrow_screen_can_hint_at_more():
    assert width('<svg class="a" width="812.5" height="3">') == "812.5"
    assert width("<svg>") == "0"
    made = part("picture", '<svg width="812.5"></svg>', "a loop")
    assert 'style="--w:812.5px"' in made
    assert 'role="group" aria-label="a loop"' in made


def test_arrows_and_signs_stay_with_what_they_belong_to():
    assert sentence("tsm.y -> x_out by 3 ± 1 %") == "tsm.y&nbsp;→&nbsp;x_out by 3&nbsp;±&nbsp;1&nbsp;%"


# ---- colours


@pytest.mark.parametrize("ground", ["paper", "panel"])
@pytest.mark.parametrize("theme", THEMES)
def test_texts_and_lines_stand_out_from_the_page(theme, ground):
    colours = THEMES[theme]
    least = {**dict.fromkeys(MEANINGS, 3.0), **TEXTS}  # 3: graphics, WCAG 2.1, 1.4.11
    low = {name: contrast(colours[name], colours[ground]) for name in least}
    assert {name: ratio for name, ratio in low.items() if ratio < least[name]} == {}


@pytest.mark.parametrize("theme", THEMES)
def test_no_colour_means_two_things(theme):
    used = [THEMES[theme][name] for name in MEANINGS]
    assert len(set(used)) == len(used)


@pytest.mark.parametrize("vision", VISION)
@pytest.mark.parametrize("theme", THEMES)
def test_colours_of_one_chart_are_apart_for_every_eye(theme, vision):
    colours = THEMES[theme]
    pairs = {pair for group in TOGETHER for pair in itertools.combinations(group, 2)}
    apart = {pair: distance(*(colours[name] for name in pair), vision) for pair in pairs}
    assert {pair: value for pair, value in apart.items() if value < 20} == {}


@pytest.mark.parametrize("theme", THEMES)
def test_the_motor_is_drawn_in_another_tone_than_the_tip_and_dashed(theme):
    assert contrast(THEMES[theme]["input"], THEMES[theme]["measured"]) > 2.5
    assert re.search(r"\.line\.input\{[^}]*stroke-dasharray", style("page.css"))


def test_contrast_and_distance_are_those_of_the_standards():
    assert contrast("#000", "#ffffff") == pytest.approx(21)
    assert contrast("#777777", "#fff") == pytest.approx(4.48, abs=0.01)
    assert distance("#000000", "#ffffff") == pytest.approx(100, abs=0.1)
    assert distance("#ff0000", "#00ff00") == pytest.approx(170.6, abs=0.2)
    assert distance("#ff0000", "#00ff00", "deuteranopia") < 40


# ---- sizes


def test_texts_of_charts_are_no_larger_than_the_text_around_them_and_legible_on_a_phone():
    from tsmblocks.html.charts import TEXT, WIDTH

    css = style("page.css")
    sizes = [TEXT, *map(float, re.findall(r"svg\.chart text(?:\.\w+)?\{font-size:([\d.]+)px", css))]
    widest = float(re.search(r"svg\.chart\{[^}]*max-width:(\d+)px", css)[1])
    body = float(re.search(r"font:(\d+)px", css)[1])
    assert max(sizes) * widest / WIDTH <= body
    assert min(sizes) * 350 / WIDTH > 10  # a phone of 375 pixels, less the margins
