"""Colours of charts and figures: one source, readable on their paper, apart for colour-blind readers."""

import itertools
import re

import numpy as np
import pytest

from tsmblocks.common.palette import DARK, EITHER, LIGHT, ROLES, SERIES, css_variables
from tsmblocks.html.pages import style

SEEN = {
    "usual": np.eye(3),
    "protanopia": [[0.152286, 1.052583, -0.204868], [0.114503, 0.786281, 0.099216], [-0.003882, -0.048116, 1.051998]],
    "deuteranopia": [[0.367322, 0.860646, -0.227968], [0.280085, 0.672501, 0.047413], [-0.011820, 0.042940, 0.968881]],
    "tritanopia": [[1.255528, -0.076749, -0.178779], [-0.078411, 0.930809, 0.147602], [0.004733, 0.691367, 0.303900]],
}
"""Linear sRGB as it looks to readers: Machado, Oliveira and Fernandes 2009, of full severity."""
XYZ = np.array(
    [[0.4124564, 0.3575761, 0.1804375], [0.2126729, 0.7151522, 0.0721750], [0.0193339, 0.1191920, 0.9503041]]
)
WHITE = np.array([0.95047, 1.0, 1.08883])
APART = 15.0
"""Least distance of two colours of a chart in CIELAB; 2.3 is a just noticeable difference."""


def linear(colour):
    parts = np.array([int(colour[k : k + 2], 16) for k in (1, 3, 5)]) / 255
    return np.where(parts <= 0.04045, parts / 12.92, ((parts + 0.055) / 1.055) ** 2.4)


def contrast(one, two):
    """Contrast of two colours by WCAG 2.2."""
    low, high = sorted(float(XYZ[1] @ linear(colour)) for colour in (one, two))
    return (high + 0.05) / (low + 0.05)


def lab(colour, reader):
    ratio = XYZ @ np.clip(np.array(SEEN[reader]) @ linear(colour), 0, 1) / WHITE
    f = np.where(ratio > (6 / 29) ** 3, np.cbrt(ratio), ratio / (3 * (6 / 29) ** 2) + 4 / 29)
    return np.array([116 * f[1] - 16, 500 * (f[0] - f[1]), 200 * (f[1] - f[2])])


def test_the_distance_is_that_of_the_textbook():
    assert lab("#ffffff", "usual") == pytest.approx([100, 0, 0], abs=0.02)
    assert lab("#ff0000", "usual") == pytest.approx([53.24, 80.09, 67.20], abs=0.02)
    confused = np.linalg.norm(lab("#b84a06", "deuteranopia") - lab("#5c7a00", "deuteranopia"))
    assert confused < APART < np.linalg.norm(lab("#b84a06", "usual") - lab("#5c7a00", "usual"))


LINES = ("measured", "before", "after", "between", "floor")
GREY = {"measured": "#808080"}
"""What half the ink of a page is, on either paper."""


@pytest.mark.parametrize("reader", SEEN)
@pytest.mark.parametrize("palette", [LIGHT, DARK, EITHER | GREY], ids=["light", "dark", "either"])
@pytest.mark.parametrize("names", [LINES[:3], LINES[1:4], ("measured", "before", "after", "floor"), SERIES], ids=str)
def test_colours_of_one_chart_are_apart_for_every_reader(reader, palette, names):
    colours = {name: palette[name] for name in names if name in palette}
    close = {
        (one, other): float(np.linalg.norm(lab(colours[one], reader) - lab(colours[other], reader)))
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

    assert set(ROLES) <= set(LIGHT)
    assert set(ROLES) <= set(DARK)
    assert (LIGHT["before"], LIGHT["after"], LIGHT["measured"]) == (figures.BEFORE, figures.MODEL, figures.MEASURED)
    assert figures.series() == [LIGHT[name] for name in SERIES]
    for sheet, palettes in (("page.css", (LIGHT, DARK)), ("card.css", (EITHER,))):
        assert "@light" not in style(sheet)
        for palette in palettes:
            assert css_variables(palette) in style(sheet)
        named = re.findall(r"--(\w+):(#\w{6})\b", style(sheet))
        assert {(name, colour) for name, colour in named if name in (*ROLES, *SERIES)} == {
            (k, v) for palette in palettes for k, v in palette.items() if v.startswith("#")
        }
