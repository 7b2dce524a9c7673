"""How many named effects are accepted, by what each leaves and whether it is one that was named before."""

from types import SimpleNamespace

import numpy as np
import pytest

from tsmblocks.diagnosis.acceptance import accepted_count
from tsmblocks.diagnosis.noise_floor import NoiseLevel
from tsmblocks.effects import catalogue

SEARCH = SimpleNamespace(
    blocks=SimpleNamespace(sizes=np.ones(1), experiment=np.zeros(1, int)), noise=NoiseLevel(1.0, 1.0, 1.0)
)
EFFECTS = {(one.name, one.variant): one for one in catalogue()}


def rounds(losses, effects, significance=3.0, outputs=None):
    """Rounds that begin with these losses and name these effects; ``outputs`` are the losses of each output."""
    made = []
    for loss, one, each in zip(losses, [*effects, None], outputs or [[k] for k in losses], strict=True):
        named = None if one is None else SimpleNamespace(candidate=SimpleNamespace(effect=EFFECTS[one]))
        verdict = SimpleNamespace(named=named, significance=significance, out_of_bounds_loss=np.inf)
        base = SimpleNamespace(residual_rms={f"y{k}": one**0.5 for k, one in enumerate(each)})
        made.append(SimpleNamespace(losses=np.array([loss]), verdict=verdict, base=base))
    return made


DRIFT, HUM, FRICTION = ("parameter_change", "drift"), ("periodic_disturbance", "output"), ("coulomb_friction", "")


@pytest.mark.parametrize(
    ("second", "count"),
    [
        pytest.param(DRIFT, 1, id="the same again is an error of its form"),
        pytest.param(("drift", ""), 2, id="another effect of time"),
        pytest.param(FRICTION, 2, id="an effect of the motion"),
    ],
)
def test_a_small_second_effect_that_leaves_noise_only(second, count):
    assert accepted_count(rounds([2.13, 1.09, 1.0], [DRIFT, second]), SEARCH) == count


def test_a_second_oscillation_has_another_period():
    assert accepted_count(rounds([2.13, 1.09, 1.0], [HUM, HUM]), SEARCH) == 2


def test_the_same_again_is_accepted_where_it_is_large():
    assert accepted_count(rounds([9.0, 3.0, 1.0], [DRIFT, DRIFT]), SEARCH) == 2


@pytest.mark.parametrize(
    ("outputs", "count"),
    [
        pytest.param([[1e7, 1e4], [2.0, 60.0], [2.0, 1.5]], 2, id="an output is left with a fraction of its error"),
        pytest.param([[1e7, 1e7], [60.0, 60.0], [1.5, 1.5]], 1, id="next to nothing of either"),
    ],
)
def test_an_effect_is_no_error_of_form_that_is_material_in_one_output(outputs, count):
    losses = [sum(each) / 2 for each in outputs]
    assert accepted_count(rounds(losses, [FRICTION, ("dead_time", "")], 1.9, outputs), SEARCH) == count


def test_a_small_second_effect_has_to_be_clearly_significant():
    assert accepted_count(rounds([2.13, 1.09, 1.0], [DRIFT, ("drift", "")], significance=1.5), SEARCH) == 1


@pytest.mark.parametrize(
    ("before", "significance", "count"),
    [
        pytest.param(80.0, 1.5, 1, id="tiny beside the first and not clear"),
        pytest.param(80.0, 2.5, 2, id="tiny beside the first, but clear"),
        pytest.param(8.0, 1.5, 2, id="not so small beside the first"),
    ],
)
def test_a_tiny_second_effect_of_another_kind_has_to_be_clearly_significant(before, significance, count):
    """A stop that is met a few times, of another form than the block, leaves events that a change of time explains."""
    assert accepted_count(rounds([before, 1.15, 1.0], [FRICTION, DRIFT], significance=significance), SEARCH) == count


@pytest.mark.parametrize(
    ("losses", "count"),
    [
        pytest.param([3.1, 2.0, 1.85, 1.1], 3, id="together they remove nearly all of the rest"),
        pytest.param([3.1, 2.0, 1.85, 1.4], 1, id="too much is left"),
        pytest.param([9.0, 1.95, 1.85, 1.1], 1, id="together they remove as little as an error of form"),
    ],
)
def test_a_large_effect_behind_a_small_one_is_accepted_with_it(losses, count):
    assert accepted_count(rounds(losses, [DRIFT, FRICTION, ("backlash", "")]), SEARCH) == count


@pytest.mark.parametrize(
    ("across", "count"),
    [
        pytest.param([9.0, 4.0, 3.0], 2, id="smaller there as well"),
        pytest.param([9.0, 4.0, 4.5], 2, id="a little larger there"),
        pytest.param([9.0, 4.0, 6.0], 1, id="larger there by more than it takes off elsewhere"),
    ],
)
def test_a_second_effect_carries_over_to_experiments_that_are_held_out(across, count):
    several = SimpleNamespace(**{**vars(SEARCH), "blocks": SimpleNamespace(sizes=np.ones(1), experiment=np.arange(2))})
    made = rounds([9.0, 3.0, 1.0], [DRIFT, FRICTION])
    for one, loss in zip(made, across, strict=True):
        one.experiment_losses = np.array([loss])
    assert accepted_count(made, several) == count
    assert accepted_count(made, SEARCH) == 2  # a single experiment
    own = rounds([9.0, 3.0, 1.0], [FRICTION, ("parameter_change", "drift, separate sizes")])
    for one, loss in zip(own, across, strict=True):
        one.experiment_losses = np.array([loss])
    assert accepted_count(own, several) == 2  # a size in each experiment cannot carry over


@pytest.mark.parametrize("effects", [[HUM], [HUM, HUM], [HUM, ("drift", "")]])
@pytest.mark.parametrize(("left", "accepted"), [(100.0, False), (20.0, True)])
def test_effects_of_time_are_larger_than_the_slow_noise_that_they_leave(effects, left, accepted):
    """What remains may all be slow noise, a hundred times the noise floor: beside it alone they would remove all."""
    slow = SimpleNamespace(blocks=SEARCH.blocks, noise=NoiseLevel(1.0, 1.0, 1000.0))
    losses = [128.0, *np.linspace(128.0, left, len(effects) + 1)[1:]]
    assert (accepted_count(rounds(losses, effects), slow) == len(effects)) is accepted
