"""Searches on tables that say what each set of effects leaves."""

from types import SimpleNamespace

import numpy as np

from tsmblocks.diagnosis import exchange, forward_selection, next_base
from tsmblocks.diagnosis.acceptance import accepted_count
from tsmblocks.diagnosis.cross_validation import TimeBlocks
from tsmblocks.diagnosis.decision import Verdict
from tsmblocks.diagnosis.noise_floor import NoiseLevel
from tsmblocks.diagnosis.search_rounds import SearchContext, SearchRound

ONE = TimeBlocks(np.zeros(1, int), np.zeros(1, int), np.zeros(1, int), np.ones(1))
WORTH = 0.05


def effect(name, contains=()):
    family = "time" if name == "D" else "map"
    return SimpleNamespace(name=name, family=family, contains=contains, free=("size",), local=(), variant="")


class Table:
    """Models are sets of names, and the table says what each leaves: of those not listed, that of their best part."""

    def __init__(self, left, contains, beyond):
        self.left = {frozenset(k): v for k, v in left.items()}
        self.out_of_bounds_loss = {frozenset(k): v for k, v in beyond.items()}
        self.effects = [effect(k, contains.get(k, ())) for k in "ABCD"]

    def loss(self, model):
        return min(v for k, v in self.left.items() if k <= model)

    def search_round(self, model, known, search, found_in=None):
        offered = [e for e in search.effects if e.name not in model]
        best = min(offered, key=lambda e: self.loss(model | {e.name}), default=None)
        passes = best is not None and self.loss(model) - self.loss(model | {best.name}) > WORTH
        ranking = [self.named(e, model | {e.name}) for e in offered]
        named = self.simplest(ranking, best.name, self.loss(model)) if passes else None
        verdict = Verdict(
            named=named,
            indistinguishable=(named,) if passes else (),
            ranking=tuple(ranking),
            t=tuple(self.loss(model) - one.loss for one in ranking),
            critical_value=0.0,
            out_of_bounds_loss=self.out_of_bounds_loss.get(model, float("inf")),
        )
        return SearchRound(model, np.array([self.loss(model)]), np.array([0.0]), (), verdict)

    @staticmethod
    def simplest(ranking, best, before):
        """The best, or a special case of it that removes nearly as much, as ``decide`` has it."""
        by_name = {one.candidate.effect.name: one for one in ranking}
        least = 0.95 * (before - by_name[best].loss)
        special = [by_name[k] for k in by_name[best].candidate.effect.contains if k in by_name]
        return next((one for one in special if before - one.loss >= least), by_name[best])

    def named(self, one, model):
        return SimpleNamespace(
            candidate=SimpleNamespace(effect=one, corners=()),
            model=model,
            loss=self.loss(model),
            tenable=True,
            disqualifying_bounds=(),
        )


def search_of(table, monkeypatch):
    """The context of a search on a table, in which models are sets of names."""
    for module in (exchange, forward_selection):
        monkeypatch.setattr(module, "search_round", table.search_round)
    monkeypatch.setattr(next_base, "at_optimum", lambda model, settings: model)
    monkeypatch.setattr(forward_selection, "form_at_finer_step", lambda *_: None)
    monkeypatch.setattr(forward_selection, "better_base", lambda *_: None)
    monkeypatch.setattr(exchange, "_with_all", lambda found, after: found)
    monkeypatch.setattr(next_base, "shrinkage_of", lambda candidate: {candidate.effect.name: (0.0, 1.0)})
    return SearchContext({}, None, table.effects, ONE, NoiseLevel(1.0, 1.0, 1.0), lambda *_: None)


def names(rounds, search):
    """The effects that were accepted, in one word."""
    return "".join(r.verdict.named.candidate.effect.name for r in rounds[: accepted_count(rounds, search)])
