"""Reports of many candidates, and of very different errors."""

import itertools
import re

import attrs
import pytest

from tests.diagnoses import ranked
from tests.test_report import NAMED, diagnosis, trace
from tsmblocks.html import figures
from tsmblocks.html.pages import style
from tsmblocks.html.report import MAX_ROWS, page

CSS = style("page.css")
PRINT = CSS.partition("@media print")[2]


def with_candidates(fitted, screened):
    """A report on so many candidates beside the one named."""
    rows = [ranked("backlash", 0.98, named=True, in_set=True)]
    rows += [ranked(f"weak{k}", 0.5 - 0.01 * k, why_not="larger error than another") for k in range(fitted)]
    rows += [ranked(f"out{k}", 0.1, fitted=False) for k in range(screened)]
    return page(diagnosis(attrs.evolve(NAMED, ranking=tuple(rows))))


def test_the_first_candidates_are_shown_and_the_others_folded():
    shown, *folded = with_candidates(25, 120).split('<details class="rest">')
    assert len(folded) == 2
    first = [k for k in range(25) if f"weak{k}<" in shown]
    assert first == list(range(MAX_ROWS - 1))
    assert all(f"weak{k}<" in folded[0] for k in range(MAX_ROWS - 1, 25))
    assert "<summary>16 more were fitted and remove less</summary>" in folded[0]
    assert "<summary>120 more were screened out before they were fitted</summary>" in folded[1]


def test_one_sentence_stands_for_the_folded_candidates_in_print():
    text = with_candidates(25, 120)
    assert re.findall(r'<p class="printed">(.*?)</p>', text) == [
        "16 more were fitted and remove less: all of them are in diagnosis.json.",
        "120 more were screened out before they were fitted: all of them are in diagnosis.json.",
    ]
    assert "details.rest" in re.search(r"([^}]*)\{display:none\}", PRINT)[1]
    assert ".printed{display:block}" in PRINT
    assert ".printed{display:none}" in CSS.partition("@media print")[0]


def test_a_few_candidates_are_all_shown():
    assert '<details class="rest">' not in with_candidates(MAX_ROWS - 1, 0)


@pytest.mark.parametrize("small", [1e-3, 0.9])
def test_numbers_of_bars_of_very_different_sizes_stand_apart(small):
    rows = {"first": (1.0, small), "second": (small, 0.9 * small), "third": (small, small)}
    gap = attrs.evolve(NAMED.gaps[0], experiments=rows, held_out=(0.5, small), noise_floor=small / 2)
    traces = tuple(trace(name, 0.8, seed=k) for k, name in enumerate(rows))
    drawn = str(figures.gap_bars(attrs.evolve(NAMED, gaps=(gap,), traces=traces), gap))
    places = [float(y) for y in re.findall(r'<text class="small"[^>]* y="([^"]*)"', drawn)]
    height = float(re.search(r"text\.small\{font-size:([\d.]+)px", CSS)[1])
    assert len(places) == 8
    assert min(b - a for a, b in itertools.pairwise(places)) > height


def test_what_the_cells_mean_is_said_once():
    other = attrs.evolve(NAMED, name="r -> u")
    assert page(diagnosis(NAMED, other)).count("The cells above a residual") == 1
