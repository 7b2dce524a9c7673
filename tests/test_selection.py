"""Where the effects found leave an error, the search begins again with other first effects."""

import pytest

from tests.search_tables import Table, names, search_of
from tsmblocks.diagnosis import selection
from tsmblocks.diagnosis.forward_selection import forward_search

TWO = {"": 20, "A": 8, "B": 11, "C": 12, "D": 18, "AB": 6, "AC": 6, "AD": 5}
"""A explains a part of what B and C do together; beside A, D removes more than either of them."""


@pytest.fixture
def selected(monkeypatch):
    """The effects of the whole selection on a table, and the first effects with which it began again."""

    def select(table):
        search = search_of(Table(table, {}, {}), monkeypatch)
        monkeypatch.setattr(selection, "without_undetermined", lambda rounds, _: (rounds, []))
        monkeypatch.setattr(selection, "without_recurring_events", lambda rounds, _: (rounds, [], []))
        monkeypatch.setattr(type(search.noise), "largest", lambda self, _: 1.0)
        starts = []

        def counted(model, shrinkage, search, rounds):
            starts.append(names(rounds, search) or rounds[0].verdict.named.candidate.effect.name)
            forward_search(model, shrinkage, search, rounds)

        monkeypatch.setattr(selection, "forward_search", counted)
        rounds = []
        forward_search(frozenset(), {}, search, rounds)
        return names(selection.selected(rounds, search).rounds, search), "".join(starts)

    return select


def test_another_first_effect_leads_to_the_two_that_act(selected):
    assert selected({**TWO, "BC": 1.0}) == ("BC", "B")


def test_the_search_does_not_begin_again_where_noise_is_left(selected):
    assert selected({"": 20, "A": 1.0, "B": 11, "C": 12}) == ("A", "")


def test_the_search_does_not_begin_again_where_little_is_left(selected):
    """Of an error of 19, what is left is 2: an error of the form of A, as it may be."""
    table = {"": 20, "A": 3.0, "B": 11, "C": 12, "AB": 3.0, "AC": 3.0, "BC": 1.0}
    assert selected(table) == ("A", "")
    assert selected({**table, "A": 6.0, "AB": 6.0, "AC": 6.0})[0] == "BC"


def test_the_first_effect_stays_where_no_other_leads_further(selected):
    effects, starts = selected(TWO)
    assert effects.startswith("A")
    assert set(starts) == set("BC")


def test_nothing_named_is_not_searched_again(selected):
    assert selected({"": 20}) == ("", "")
