"""Why candidates are not named: each reason by hand, and all of a diagnosis."""

from types import SimpleNamespace

import numpy as np
import pytest

import tsmblocks as tsm
from tsmblocks.blocks import Play
from tsmblocks.diagnosis import rejection
from tsmblocks.diagnosis.ranking import share_above_noise
from tsmblocks.diagnosis.rejection import why_named, why_not

BLOCKS = SimpleNamespace(sizes=np.ones(4))


def candidate(name="lag", loss=1.2, *, bounds=(), untenable="", contains=(), parameters=3):
    effect = SimpleNamespace(name=name, contains=frozenset(contains), family="delay", free=("size",), local=())
    return SimpleNamespace(
        candidate=SimpleNamespace(effect=effect),
        model=SimpleNamespace(r=np.full(4, loss)),
        disqualifying_bounds=bounds,
        tenable=not untenable,
        untenable=untenable,
        parameter_count=parameters,
        loss=loss,
    )


def searched(ranking, *, before=2.0, named=None, others=(), critical=2.0, out_of_bounds=np.inf):
    verdict = SimpleNamespace(
        ranking=tuple(ranking),
        critical_value=critical,
        named=named,
        indistinguishable=others,
        out_of_bounds_loss=out_of_bounds,
    )
    return SimpleNamespace(verdict=verdict, losses=np.full(4, before))


def diagnosed(count=0, noise=1.0):
    search = SimpleNamespace(noise=SimpleNamespace(low=min(noise, 1.0), least=lambda loss: min(noise, loss)))
    return SimpleNamespace(count=count, blocks=BLOCKS, noise_variance=noise, search=search)


def reason(one, *ranking, count=0, t=9.0, noise=1.0, **more):
    return why_not(diagnosed(count, noise), 1, searched([one, *ranking], **more), one, t)


def test_the_one_named_has_no_reason_and_its_equals_are_indistinguishable():
    named, same = candidate("gap"), candidate("loop")
    assert reason(named, same, count=1, named=named, others=(named, same)) == ""
    assert reason(same, named, count=1, named=named, others=(named, same)) == rejection.INDISTINGUISHABLE


def test_a_candidate_that_may_not_be_named_says_what_disqualifies_it():
    assert reason(candidate(bounds=("zeta", "omega"))) == "ends at a bound (zeta and omega)"
    assert reason(candidate(untenable="removes noise of the input only")) == "removes noise of the input only"


@pytest.mark.parametrize(
    ("loss", "t", "noise", "before", "expected"),
    [
        (2.1, 9.0, 1.0, 2.0, rejection.NO_BETTER),
        (1.2, 1.9, 1.0, 2.0, rejection.NOT_SIGNIFICANT),
        (1.0, 9.0, 1.0, 1.02, rejection.NO_EXCESS),
        (1.95, 9.0, 1.0, 2.0, rejection.TOO_LITTLE),
    ],
)
def test_held_out_data_that_do_not_support_a_candidate_are_the_reason(loss, t, noise, before, expected):
    assert reason(candidate(loss=loss), t=t, noise=noise, before=before) == expected


def test_beside_the_one_named_the_others_leave_more_or_are_more_general():
    named = candidate("gap", 1.0, parameters=3)
    assert reason(candidate("lag", 1.4), named, count=1, named=named) == rejection.LEAVES_MORE
    wider = candidate("loop", 1.0, contains=("gap",))
    assert reason(wider, named, count=1, named=named) == rejection.MORE_GENERAL
    assert reason(candidate("loop", 1.0, parameters=5), named, count=1, named=named) == rejection.MORE_GENERAL
    assert reason(candidate("loop", 1.005, parameters=3), named, count=1, named=named) == rejection.LEAVES_MORE


def test_a_round_without_an_effect_says_why_its_best_was_not_accepted():
    best = candidate("gap", 1.3)
    assert reason(best, named=best) == rejection.LEAVES_PREDICTED
    small = candidate("gap", 1.8)
    assert reason(small, named=small) == rejection.TOO_LITTLE
    assert reason(small, named=small, out_of_bounds=1.1) == "another that may not be named leaves less"
    assert reason(candidate("lag", 1.5), best, named=best) == rejection.LEAVES_MORE
    assert reason(best) == rejection.NOT_ACCEPTED
    later = why_not(diagnosed(1), 2, searched([best], named=best), best, 9.0)
    assert later == rejection.NOT_ACCEPTED


def test_why_an_effect_is_named_rather_than_its_equals():
    gap, lag, loop = candidate("gap", 1.0, parameters=3), candidate("lag", 1.1, parameters=4), candidate("loop", 0.99)
    assert why_named(gap, [gap]) == ""
    assert why_named(gap, [gap, lag]) == "gap is named because the model with it has the fewest parameters."
    assert why_named(loop, [gap, loop]) == "loop is named because it leaves the least error on held-out data."
    assert why_named(loop, [gap, loop, lag]) == why_named(loop, [gap, loop])
    assert why_named(loop, [gap, loop, candidate("wide", 0.98, parameters=9)]) == (
        "loop is named because of those with as few parameters it leaves the least error on held-out data."
    )
    assert why_named(lag, [gap, lag]) == ""


def test_a_share_is_at_most_one_and_has_no_value_where_it_has_no_meaning():
    assert share_above_noise(0.5, 2.0, diagnosed()) == 0.5
    assert share_above_noise(1.7, 2.0, diagnosed()) == 1.0
    assert share_above_noise(1.0, 5.0, diagnosed(noise=4.0)) == 0.25  # slow noise is above the floor
    assert share_above_noise(-0.5, 2.0, diagnosed()) == -0.5
    assert np.isnan(share_above_noise(0.7, 1.0, diagnosed()))
    assert np.isnan(share_above_noise(0.03, 1.04, diagnosed()))  # less above the noise than any effect removes
    assert share_above_noise(0.03, 1.1, diagnosed()) == pytest.approx(0.3)


def test_every_fitted_candidate_of_a_diagnosis_is_named_or_has_a_reason():
    t = np.arange(0.0, 10.0, 0.02)
    x = np.sin(1.3 * t) + 0.3 * np.sin(5.1 * t)
    model = tsm.load("tendon_sheath_linear")
    worn = model.insert("gap", Play(half_width=0.05), before="x_out")
    y = tsm.simulate(worn, inputs={"x_in": (t, x)}, stop=t[-1], step=0.02, check_step=False)["x_out"]
    y = y + np.random.default_rng(0).normal(0.0, 0.01, t.size)
    record = tsm.Record("run", t, {"x_in": x, "x_out": y}, {"x_in": "rad", "x_out": "rad"})
    effects = ["backlash", "hysteresis", "dead_time", "drift"]
    diagnosis = tsm.diagnose(model, record, noise_floor=0.01, effects=effects)
    found = diagnosis.to_dict()
    rows = [r for r in found["ranking"] if r["fitted"]]
    assert [r["name"] for r in rows if r["named"]] == ["backlash"]
    assert {r["why_not"] for r in rows if r["named"]} == {""}
    assert all(r["why_not"] and r["words"] for r in rows if not r["named"])
    assert max(r["share"] for r in rows if r["share"] is not None) <= 1
    marked = {r["name"] for r in rows if r["in_set"] and not r["named"]}
    assert marked - {"backlash"} == set(
        found["effects"][0]["also_possible"]
    )  # one list, in the sentence and in the table
    (segment,) = diagnosis.segments
    for name, quantity in segment.effects[0].parameters.items():  # one uncertainty, in the effect and in the fit
        own = segment.fit[f"{segment.effects[0].block}.{name}"]
        assert (own.value, own.low, own.high) == pytest.approx((quantity.value, quantity.low, quantity.high), rel=1e-9)
    first = {r["why_not"] for r in rows if r["round"] == 1 and not r["in_set"]}
    assert rejection.LEAVES_MORE in first
    last = {r["why_not"] for r in rows if r["round"] == 2}
    assert last & {
        rejection.NO_EXCESS,
        rejection.NOT_SIGNIFICANT,
        rejection.NO_BETTER,
        "random noise of its spectrum is reduced as much",
    }
