"""Of effects with the same outputs, the one is named beside which the model stays nearest to the diagram."""

from types import SimpleNamespace

import attrs
import numpy as np
import pytest

from tests.test_diagnosis_parts import stand_in
from tsmblocks.diagnosis.decision import Verdict
from tsmblocks.diagnosis.rejection import why_named
from tsmblocks.diagnosis.same_outputs import NEARER, SAME_SHARE, is_same_in_outputs, nearest_first

LOSSES = np.ones(20)
RESIDUAL = np.random.default_rng(3).normal(size=1000)


def candidate(name, gain, residual=RESIDUAL, count=2, loss=1.0):
    """A candidate beside which the one gain of the model is ``gain``."""
    one = stand_in(loss * LOSSES, count, name=name)
    values = {"plant.gain": gain, "b.p0": 9.0}
    model = SimpleNamespace(**{**vars(one.model), "r": residual, "parameters": lambda: values})
    return attrs.evolve(one, model=model)


def verdict_on(*candidates):
    return Verdict(candidates, (9.0,) * len(candidates), 2.0, candidates[0], candidates)


@pytest.mark.parametrize(("nearer", "name"), [(0.9, "creep"), (1.1, "lag")])
def test_the_effect_beside_which_the_parameters_stay_nearest_is_named(nearer, name):
    creep, lag = candidate("creep", 2.0 * np.exp(NEARER * nearer)), candidate("lag", 2.0)
    found = nearest_first(verdict_on(creep, lag), {"plant.gain": 2.0, "plant.bias": 5.0})
    assert found.named.candidate.effect.name == name
    assert set(found.indistinguishable) == {creep, lag}
    assert found.indistinguishable[0] is found.named
    assert nearest_first(found, {}) is found  # nothing is known of the parameters
    assert nearest_first(verdict_on(lag, creep), {"plant.gain": 2.0}).named is lag


@pytest.mark.parametrize(("difference", "same"), [(0.9, True), (1.1, False)])
def test_outputs_are_the_same_within_a_hundredth_of_the_residual(difference, same):
    other = RESIDUAL + difference * np.sqrt(SAME_SHARE * np.mean(RESIDUAL**2))
    creep, lag = candidate("creep", 3.0), candidate("lag", 2.0, other)
    assert is_same_in_outputs(lag, creep) is is_same_in_outputs(creep, lag) is same
    assert (nearest_first(verdict_on(creep, lag), {"plant.gain": 2.0}).named is lag) is same


def test_only_effects_of_as_many_parameters_that_may_be_named_are_compared():
    creep, more = candidate("creep", 3.0), candidate("more", 2.0, count=3)
    unfit = attrs.evolve(candidate("lag", 2.0), untenable="not this one")
    short = candidate("short", 2.0, RESIDUAL[:-1])
    assert nearest_first(verdict_on(creep, more, unfit, short), {"plant.gain": 2.0}).named is creep
    assert nearest_first(Verdict(), {"plant.gain": 2.0}).named is None
    elsewhere = candidate("creep", 2.0)  # the same effect at another place
    assert nearest_first(verdict_on(creep, elsewhere), {"plant.gain": 2.0}).named is creep


def test_the_reason_says_that_outputs_are_the_same():
    creep, lag = candidate("creep", 3.0, loss=0.999), candidate("lag", 2.0)
    assert why_named(lag, [lag, creep]) == (
        "lag is named because with it the parameters of the model are nearest to those of the diagram; the outputs are "
        "the same as with creep."
    )
    apart = candidate("creep", 3.0, 2 * RESIDUAL, loss=0.999)
    assert why_named(lag, [lag, apart]) == ""
