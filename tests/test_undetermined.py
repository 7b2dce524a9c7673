"""Effects that are not determined beside the others, and effects behind parameters that make up for one another."""

from types import SimpleNamespace

import numpy as np
import pytest

import tsmblocks as tsm
from tests.search_tables import Table, names, search_of
from tsmblocks import blocks as b
from tsmblocks.diagnosis import determined, undetermined
from tsmblocks.diagnosis.forward_selection import forward_search
from tsmblocks.diagnosis.rejection import NO_SIZE, NOT_DETERMINED, TAKES_PLACE
from tsmblocks.effects import catalogue

T = np.arange(0.0, 12.0, 0.05)


@pytest.fixture
def left_out(monkeypatch):
    """What is named on a table in the end, where these effects are not determined in these models."""

    def search(left, open_in, lost_in=()):
        table = Table(left, {}, {})
        whole = search_of(table, monkeypatch)
        monkeypatch.setattr(undetermined, "held_out_losses", lambda model, *_: (np.array([table.loss(model)]),))

        def is_determined(one, model, base):
            return one.candidate.effect.name not in open_in.get("".join(sorted(model)), "")

        monkeypatch.setattr(undetermined, "_is_determined", is_determined)
        monkeypatch.setattr(
            undetermined, "lost_parameters", lambda model, _: ["k"] * ("".join(sorted(model)) in lost_in)
        )
        rounds = []
        forward_search(frozenset(), {}, whole, rounds)
        kept, omitted = undetermined.without_undetermined(rounds, whole)
        return names(kept, whole), [(one.index, one.effect.candidate.effect.name, one.reason) for one in omitted]

    return search


def test_the_next_best_candidate_takes_the_place_of_one_that_is_open(left_out):
    assert left_out({"": 20, "A": 1.0, "B": 1.2, "C": 9}, {"A": "A"}) == ("B", [(0, "A", NO_SIZE)])


def test_the_last_one_goes_where_it_made_a_better_one_open(left_out):
    """A explains nearly all; B beside it imitates it, so that the size of A is open, but alone leaves far more."""
    assert left_out({"": 20, "A": 3.0, "B": 15.0, "AB": 1.0}, {"AB": "A"}) == ("A", [(1, "B", NOT_DETERMINED)])


def test_an_effect_beside_which_the_model_is_lost_is_left_out(left_out):
    table = {"": 20, "A": 6.0, "B": 9.0, "AB": 1.0}
    assert left_out(table, {}, ["AB"]) == ("A", [(1, "B", TAKES_PLACE)])
    assert left_out(table, {}, ["A", "AB"]) == ("A", [(1, "B", TAKES_PLACE)])  # one may take the place of a part of it


@pytest.mark.parametrize(
    ("value", "spread", "lost"),
    [(3.0, 2.0, True), (3.0, 1.4, False), (0.0, 0.5, False), (0.0, 1.1, True), (3.0, np.inf, False)],
)
def test_a_parameter_is_lost_where_its_interval_is_much_wider_and_includes_zero(value, spread, lost, monkeypatch):
    """It was known to 0.1 without the effect. One that goes to zero and is known as well as before is not lost."""
    base, model = (
        SimpleNamespace(
            problem=SimpleNamespace(unknowns=SimpleNamespace(names=names)),
            is_local=np.zeros(len(names), dtype=bool),
            theta=np.array([value, 1.0][: len(names)]),
        )
        for names in (("lag.gain",), ("lag.gain", "friction.gain"))
    )
    known = {id(base): [0.1], id(model): [spread, 0.2]}
    monkeypatch.setattr(
        determined, "uncertainty_of_effects", lambda one, _: SimpleNamespace(errors=np.array(known[id(one)]))
    )
    assert determined.lost_parameters(model, base) == ["lag.gain"] * lost


def test_a_simpler_variant_of_an_effect_that_was_left_out_has_its_turn():
    wide, narrow, own, other = (
        SimpleNamespace(name="creep", free=free, local=local, variant=variant)
        for free, local, variant in (
            (("share", "time"), (), ""),
            (("share",), (), "broad"),
            (("share",), ("share",), "separate sizes"),
            (("share", "width"), (), "middle and ends"),
        )
    )
    assert undetermined._may_follow(narrow, wide)
    assert undetermined._may_follow(narrow, own)
    assert undetermined._may_follow(other, wide)
    assert not undetermined._may_follow(wide, wide)
    assert not undetermined._may_follow(wide, narrow)
    assert undetermined._may_follow(SimpleNamespace(name="lag", free=("time",), local=()), narrow)


def test_what_is_determined_stays(left_out):
    assert left_out({"": 20, "A": 6, "B": 9, "AB": 1.0}, {}) == ("AB", [])


def balanced(tipping=0.0, damping=0.0):
    """A drive, a speed and a position, each with a gain; with a force that tips it over beyond the rest at -0.3."""
    plain = tsm.Diagram(
        title="a body that is pushed",
        blocks={"drive": b.Gain(gain=2.0), "speed": b.Integrator(), "position": b.Integrator()},
        wires=["drive -> speed -> position"],
        inputs={"u": "drive.u"},
        outputs={"x": "position"},
    )
    (stiffness,) = (one for one in catalogue() if one.name == "stiffness")
    (friction, _) = (one for one in catalogue() if one.name == "viscous_friction")
    true = plain
    if tipping:
        true = true.insert("hidden", stiffness.block, before="speed.u", wires=["position -> hidden.x"])
        true = true.with_parameters({"hidden.force.gain": -tipping, "hidden.away.bias": 0.3})
    if damping:
        true = true.insert("hidden", friction.block, before="speed.u", wires=["position -> hidden.x"])
        true = true.with_parameters({"hidden.friction.gain": damping})
    records, rng = [], np.random.default_rng(3)
    for k, sign in enumerate((1.0, -1.0, 0.6)):
        u = sign * (0.3 * np.sin(1.1 * T) + 0.2 * np.sin(2.7 * T + k)) - 0.15 * tipping
        run = tsm.simulate(true, inputs={"u": (T, u)}, stop=T[-1], step=0.01, hold="cubic")
        x = np.interp(T, run.t, run["x"]) + rng.normal(0.0, 0.01, T.size)
        records.append(tsm.Record(f"run{k}", T, {"u": u, "x": x}, {}))
    return plain, records


FEW = ["stiffness", "viscous_friction", "load_offset", "coulomb_friction", "drift"]


def test_a_force_that_tips_over_is_named_behind_gains_that_make_up_for_one_another():
    """Only the product of the three gains shows; with two of them held, the force has a size and an interval."""
    plain, records = balanced(tipping=0.2)
    found = tsm.diagnose(plain, records, noise_floor=0.01, effects=FEW)
    (effect,) = found.effects
    assert effect.name == "stiffness"
    gain, away = effect.parameters["force.gain"], effect.parameters["away.bias"]
    gains = found.augmented.parameters
    through = gains["speed.gain"] * gains["position.gain"]
    assert gain.low * through < -0.2 < gain.high * through
    assert gain.high < 0
    assert away.low < 0.3 < away.high


def test_viscous_friction_is_named():
    plain, records = balanced(damping=0.15)
    found = tsm.diagnose(plain, records, noise_floor=0.01, effects=FEW)
    (effect,) = found.effects
    assert effect.name == "viscous_friction"
    gains = found.augmented.parameters
    assert effect.parameters["friction.gain"].value * gains["speed.gain"] == pytest.approx(0.15, rel=0.1)


@pytest.mark.parametrize(
    ("open_beside", "count"), [({}, 3), ({3: "C"}, 2), ({3: "A"}, 2), ({3: "C", 2: "A", 1: "A"}, 0)]
)
def test_a_search_that_was_stopped_keeps_effects_that_are_determined(open_beside, count, monkeypatch):
    """Round k has the model with k effects; ``open_beside`` says which one is not determined in it."""
    verdicts = [SimpleNamespace(named=name) for name in "ABC"] + [SimpleNamespace(named=None)]
    rounds = [SimpleNamespace(base=k, verdict=verdict) for k, verdict in enumerate(verdicts)]
    monkeypatch.setattr(undetermined, "_is_determined", lambda one, model, base: open_beside.get(model) != one)
    monkeypatch.setattr(undetermined, "lost_parameters", lambda model, _: [])
    assert undetermined.determined_count(rounds, 3) == count
