"""Another form of the effect that was named, where it explains it better at a finer step."""

from types import SimpleNamespace

import attrs
import numpy as np
import pytest

from tsmblocks.diagnosis import forms_at_finer_step
from tsmblocks.diagnosis.decision import Verdict
from tsmblocks.diagnosis.fitted_candidate import FittedCandidate
from tsmblocks.diagnosis.forms_at_finer_step import form_at_finer_step, with_form
from tsmblocks.diagnosis.search_rounds import SearchRound


def model(h, loss):
    times = SimpleNamespace(h=h)
    return SimpleNamespace(setup=SimpleNamespace(experiments=[SimpleNamespace(times=times)]), loss=loss)


def candidate(name, variant, loss, point="u -> y", untenable=""):
    effect = SimpleNamespace(name=name, variant=variant)
    made = SimpleNamespace(effect=effect, point=SimpleNamespace(signal=point))
    return FittedCandidate(made, model(0.01, loss), np.full(3, loss), np.full(3, loss), loss, untenable)


@pytest.fixture
def at(monkeypatch):
    """A round that named a soft form of an effect, and what each form leaves at a finer step."""

    def found(losses, h=0.001, others=()):
        soft, hard = candidate("limit", "soft", 2.0), candidate("limit", "", 3.0)
        every = (soft, hard, candidate("lag", "", 2.5), *others)
        refined = {id(one.model): model(h, losses.get(one.candidate.effect.variant, 9.0)) for one in every}
        monkeypatch.setattr(forms_at_finer_step, "at_optimum", lambda m, settings: refined[id(m)])
        monkeypatch.setattr(
            forms_at_finer_step,
            "fitted_candidate",
            lambda c, m, *rest: FittedCandidate(c, m, np.full(3, m.loss), np.full(3, m.loss), m.loss),
        )
        monkeypatch.setattr(forms_at_finer_step, "noise_beside", lambda *_: 1.0)
        monkeypatch.setattr(
            forms_at_finer_step, "decide", lambda base, some, *_: Verdict(named=min(some, key=lambda one: one.loss))
        )
        base = SimpleNamespace(mean_square=20.0)
        one = SearchRound(base, np.full(3, 20.0), np.full(3, 20.0), (), Verdict(ranking=every, named=soft))
        search = SimpleNamespace(settings=SimpleNamespace(seed=0), blocks=None, noise=None)
        return one, form_at_finer_step(one, refined[id(soft.model)], {}, search)

    return found


def test_the_hard_form_takes_the_place_of_a_soft_one_that_made_up_for_the_step(at):
    one, form = at({"soft": 2.5, "": 1.0})
    assert (form.candidate.effect.name, form.candidate.effect.variant, form.loss) == ("limit", "", 1.0)
    new = with_form(one, form).verdict
    assert new.named is form
    assert new.indistinguishable == (form,)
    assert [k.candidate.effect.name for k in new.ranking] == ["limit", "limit", "lag"]
    assert form in new.ranking


def test_the_form_that_was_named_stays_where_it_is_better(at):
    assert at({"soft": 0.9, "": 1.0})[1] is None


def test_at_the_same_step_nothing_is_tried(at):
    assert at({"soft": 2.5, "": 1.0}, h=0.01)[1] is None


def test_other_effects_other_wires_and_what_is_untenable_are_no_forms(at):
    elsewhere = candidate("limit", "elsewhere", 2.1, point="y -> z")
    noise = candidate("limit", "noise", 2.1, untenable="random noise")
    _, form = at({"soft": 2.5, "": 3.0, "elsewhere": 0.1, "noise": 0.1}, others=(elsewhere, noise))
    assert form is None


def test_a_round_without_a_name_has_no_other_form(at):
    one, _ = at({"soft": 2.5, "": 1.0})
    none = attrs.evolve(one, verdict=Verdict())
    assert form_at_finer_step(none, model(0.001, 1.0), {}, None) is None
