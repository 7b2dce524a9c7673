"""What a greedy search named first is looked at once more: on tables that say what each set of effects leaves."""

from types import SimpleNamespace

import attrs
import numpy as np
import pytest

from tests.search_tables import Table, effect, names, search_of
from tsmblocks.diagnosis import exchange, forward_selection
from tsmblocks.diagnosis.decision import is_more_general
from tsmblocks.diagnosis.exchange import exchange_effects
from tsmblocks.diagnosis.forward_selection import forward_search
from tsmblocks.diagnosis.search_rounds import SearchContext


@attrs.frozen(eq=False)
class Score:
    """What a round predicted of a candidate."""

    gain: float
    noise_gains: np.ndarray
    candidate: SimpleNamespace


@pytest.fixture
def searching(monkeypatch):
    """The search on a table: its effects before and after they were looked at once more."""

    def search(left, contains=None, beyond=None):
        whole = search_of(Table(left, contains or {}, beyond or {}), monkeypatch)
        greedy = []
        forward_search(frozenset(), {}, whole, greedy)
        last = exchange_effects(greedy, whole)
        return names(greedy, whole), names(last, whole), last

    return search


def test_an_effect_that_stood_for_two_is_dropped(searching):
    before, after, rounds = searching({"": 20, "A": 6, "B": 9, "C": 11, "AB": 4, "AC": 4.5, "BC": 1.0})
    assert (before, after) == ("ABC", "BC")
    assert rounds[-1].verdict.named is None


def test_an_effect_that_imitated_another_beside_a_third_is_exchanged_in_its_place(searching):
    before, after, rounds = searching({"": 20, "A": 6, "B": 9, "C": 11, "AB": 1.04, "BC": 1.0})
    assert (before, after) == ("AB", "CB")
    assert rounds[0].most_complete.single_effect is False
    assert [one.candidate.effect.name for one in rounds[0].indistinguishable] == ["C"]


def test_what_is_named_again_beside_the_others_stays(searching):
    before, after, rounds = searching({"": 20, "A": 6, "B": 9, "AB": 1.0})
    assert (before, after) == ("AB", "AB")
    assert rounds[0].repeated is not None
    assert rounds[0].most_complete is rounds[0]


def test_a_more_general_form_of_what_was_named_takes_no_place(searching):
    table = {"": 20, "A": 6, "B": 9, "C": 7, "AB": 1.04, "BC": 1.0}
    assert searching(table)[1] == "CB"
    assert searching(table, {"C": ("A",)})[1] == "AB"


def test_a_general_form_that_explains_alone_what_two_do_is_named(searching):
    """A is a special case of C, and so simple that the search takes it first; B mends its form."""
    left = {"": 20, "A": 2, "B": 18, "C": 1.0, "AB": 1.0, "AC": 1.0}
    assert searching(left, {"C": ("A",)})[1] == "C"
    assert searching({**left, "C": 1.6, "AC": 1.6}, {"C": ("A",)})[1] == "AB"  # it does not reach what they do
    little = {"": 20, "A": 2, "B": 18, "C": 1.97, "AB": 1.97, "AC": 1.97}
    assert searching(little, {"C": ("A",)})[1] == "A"


@pytest.mark.parametrize(("beyond", "named"), [(4.0, ""), (1.5, "AB"), (0.9, "")])
def test_what_left_its_bounds_must_be_explained_by_all_together(searching, beyond, named):
    """An effect out of its bounds leaves less than any one in them: two that leave still less stand in its place."""
    left = {"": 20, "A": 6, "B": 9, "AB": 1.0} if named or beyond < 1 else {"": 20, "A": 6, "B": 9, "AB": 4.5}
    assert searching(left, beyond={"": beyond})[1] == named


def test_a_small_effect_of_time_is_no_error_of_form_of_one_of_the_motion(searching):
    """B and D remove as little beside A; an error of the form of A depends on the motion as A does."""
    assert searching({"": 20, "A": 1.9, "B": 18, "AB": 1.3})[0] == "A"
    assert searching({"": 20, "A": 1.9, "D": 18, "AD": 1.3})[0] == "AD"


def test_separate_sizes_are_more_general_than_one_for_all():
    shared, separate = effect("A"), effect("A")
    separate.local = ("size",)
    one, more = (SimpleNamespace(candidate=SimpleNamespace(effect=each)) for each in (shared, separate))
    assert is_more_general(more, one)
    assert not is_more_general(one, more)
    assert not is_more_general(one, one)


def test_one_effect_is_not_looked_at_again(searching):
    before, after, rounds = searching({"": 20, "A": 1.0})
    assert (before, after) == ("A", "A")
    assert rounds[0].repeated is None


def test_nothing_stays_nothing(searching):
    assert searching({"": 1.0})[:2] == ("", "")


def test_no_effect_is_exchanged_for_a_second_one_of_a_name(searching, monkeypatch):
    """B beside A is exchanged for C; where C has the name of A, as a second of a pair would, it is not."""
    table = {"": 20, "B": 6, "A": 9, "C": 11, "AB": 1.04, "AC": 1.0}
    assert searching(table)[1] == "CA"
    monkeypatch.setattr(exchange, "_has_name_of", lambda new, one: new.candidate.effect.name == "C")
    assert searching(table)[1] == "BA"


def test_what_has_a_low_screening_score_is_searched_for_again_only_where_nothing_else_is_found(monkeypatch):
    """A stood for B and C. In the round in which A was named, the score of B is less than a tenth of that of A."""
    table, seen = Table({"": 20, "A": 6, "B": 9, "C": 11, "AB": 4, "AC": 4.5, "BC": 1.0}, {}, {}), []
    whole = search_of(table, monkeypatch)

    def noted(model, known, search, found_in=None):
        seen.append("".join(one.name for one in search.effects))
        scores = [
            Score(gain, np.zeros(3), SimpleNamespace(effect=effect(name)))
            for name, gain in {"A": 10.0, "B": 0.5, "C": 2.0, "D": 0.1}.items()
        ]
        return attrs.evolve(table.search_round(model, known, search), screening_scores=tuple(scores))

    for module in (exchange, forward_selection):
        monkeypatch.setattr(module, "search_round", noted)
    monkeypatch.setattr(
        SearchContext, "tried_as", lambda self, one: next(e for e in whole.effects if e.name == one.effect.name)
    )
    greedy = []
    forward_search(frozenset(), {}, whole, greedy)
    seen.clear()
    last = exchange_effects(greedy, whole)
    assert "AC" in seen  # not B, whose score is less than a tenth of the best
    assert seen[seen.index("AC") + 1] == "ABCD"  # none was found among those
    assert names(last, whole) == "BC"
