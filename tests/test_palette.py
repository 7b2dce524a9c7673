"""Colours of charts and figures: one source, readable on their paper, apart for colour-blind readers."""

import itertools
import re

import pytest

from tests.palette import VISION, contrast, distance, lab
from tsmblocks.common.palette import DARK, EITHER, LIGHT, ROLES, SERIES, TRACKING, css_variables
from tsmblocks.html.pages import style

APART = 15.0
"""Least distance of two colours of a chart in CIELAB; 2.3 is a just noticeable difference."""


def test_the_distance_is_that_of_the_textbook():
    assert lab("#ffffff") == pytest.approx([100, 0, 0], abs=0.02)
    assert lab("#ff0000") == pytest.approx([53.24, 80.09, 67.20], abs=0.03)
    confused = distance("#b84a06", "#5c7a00", "deuteranopia")
    assert confused < APART < distance("#b84a06", "#5c7a00")


LINES = ("measured", "before", "after", "between", "floor")
CHARTS = (
    LINES[:3],
    LINES[1:4],
    ("measured", "before", "after", "floor"),
    ("ink", "soft", "measured", "after", "floor"),
    SERIES,
)
"""Colours that stand beside each other; the residual of a fit has the colour of small print."""
GREY = {"measured": "#808080"}
"""What half the ink of a page is, on either paper."""


@pytest.mark.parametrize("reader", VISION)
@pytest.mark.parametrize("palette", [LIGHT, DARK, EITHER | GREY], ids=["light", "dark", "either"])
@pytest.mark.parametrize("names", CHARTS, ids=str)
def test_colours_of_one_chart_are_apart_for_every_reader(reader, palette, names):
    colours = {name: palette[name] for name in names if palette.get(name, "").startswith("#")}
    close = {
        (one, other): distance(colours[one], colours[other], reader)
        for one, other in itertools.combinations(colours, 2)
    }
    assert {pair: round(d, 1) for pair, d in close.items() if d < APART} == {}


@pytest.mark.parametrize(
    ("palette", "papers"), [(LIGHT, ["#ffffff"]), (DARK, ["#161718"]), (EITHER, ["#ffffff", "#111111"])]
)
def test_lines_stand_out_from_their_paper(palette, papers):
    """WCAG 2.2, 1.4.11: 3:1 for graphics; what is pale on purpose has a label."""
    for name in (*LINES, *SERIES):
        least = 2.5 if name == "between" else 2.95
        for paper in papers if palette.get(name, "").startswith("#") else []:
            assert contrast(palette[name], paper) >= least, name


def test_pages_cards_and_figures_have_the_same_colours():
    pytest.importorskip("matplotlib", reason="the extra [plots] brings it")
    from tsmblocks.plots import style as figures

    assert {*ROLES, *TRACKING} <= set(LIGHT)
    assert {*ROLES, *TRACKING} <= set(DARK)
    assert (LIGHT["before"], LIGHT["after"], LIGHT["measured"]) == (figures.BEFORE, figures.MODEL, figures.MEASURED)
    assert figures.series() == [LIGHT[name] for name in SERIES]
    for sheet, palettes in (("page.css", (LIGHT, DARK)), ("card.css", (EITHER,))):
        assert "@light" not in style(sheet)
        for palette in palettes:
            assert css_variables(palette) in style(sheet)
        named = re.findall(r"--(\w+):(#\w{6})\b", style(sheet))
        assert {(name, colour) for name, colour in named if name in (*ROLES, *TRACKING, *SERIES)} == {
            (k, v) for palette in palettes for k, v in palette.items() if v.startswith("#")
        }
