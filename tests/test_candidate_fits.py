"""Fits of candidates: a state too fast for the step where the motion is fast, and starts known from beside others."""

import sys
from pathlib import Path
from types import SimpleNamespace

import numpy as np
import pytest

import tsmblocks as tsm
from tsmblocks.blocks import FirstOrderLag
from tsmblocks.diagnosis import candidate_fits, screened_candidates
from tsmblocks.diagnosis.candidates import Candidate
from tsmblocks.diagnosis.model import ModelSettings, end_at, model_at, pose_model

sys.path.insert(0, str(Path(__file__).parent / "benchmarks"))
from independent_cases import build

LOST, FITS = 50.0, 1.1


@pytest.fixture(scope="module")
def found():
    """Stribeck friction behind a gap, whose loop reverses within a step of the fastest motion, with few candidates."""
    case = build("single", 4014)
    records = {k: tsm.Record(k, r["t"], r["signals"], r["units"]) for k, r in case.recordings.items()}
    return tsm.diagnose(tsm.loads(case.base), records, effects=["stribeck_friction", "rate_dependence"])


def test_a_loop_that_reverses_within_a_step_is_named_alone(found):
    """In truth a friction at rest over a distance of 0.02 rad, with a Stribeck velocity of 0.189 rad/s."""
    (effect,), (true,) = found.effects, build("single", 4014).truth["effects"]
    assert effect.name == "stribeck_friction"
    size = {name: one.value for name, one in effect.parameters.items()}
    assert size["half_width"] + size["breakaway"] == pytest.approx(true["size"], rel=0.03)
    assert size["speed"] == pytest.approx(0.189, abs=0.01)
    assert size["distance"] == pytest.approx(0.02, abs=0.002)


@pytest.fixture
def halving(monkeypatch):
    """The candidate that is kept where its loss is 50 at the first step, and these at a half and a quarter of it."""

    def kept(*finer, mean_square=1.0, loss=LOST):
        losses = iter(finer)

        def halved(problem, setup):
            return (problem, setup) if finer else None  # more steps than fit into memory

        monkeypatch.setattr(candidate_fits, "halved", halved)
        monkeypatch.setattr(candidate_fits, "optimized", lambda *_: first.model)
        monkeypatch.setattr(
            candidate_fits, "fitted_candidate", lambda c, model, *_: SimpleNamespace(loss=next(losses), model=model)
        )
        model = SimpleNamespace(problem=None, setup=None, theta=None, mean_square=mean_square)
        first = SimpleNamespace(loss=loss, model=model, candidate=None, untenable="")
        result = candidate_fits.at_sufficient_step(first, 2.0, 2.0, None, {})
        return "first" if result is first else result.loss

    return kept


def test_a_candidate_whose_loss_failed_is_fitted_at_a_finer_step(halving):
    assert halving(FITS) == FITS
    assert halving(LOST, FITS) == FITS


def test_a_candidate_stays_where_a_finer_step_mends_nothing(halving):
    assert halving(LOST, LOST, FITS) == "first"
    assert halving() == "first"


def test_a_candidate_that_has_not_failed_costs_no_fit(halving):
    assert halving(loss=3.9) == "first"
    assert halving(mean_square=2.1) == "first", "its fit is no better than the base"


def test_the_fit_of_a_known_effect_starts_at_its_parameters():
    def named(block, values):
        candidate = SimpleNamespace(effect=SimpleNamespace(name="backlash"), block=block)
        return SimpleNamespace(candidate=candidate, model=SimpleNamespace(values=values))

    items = [SimpleNamespace(name=name) for name in ("gain.gain", "gap.half_width", "gap.m@r1", "offset.bias")]
    score = SimpleNamespace(
        candidate=SimpleNamespace(effect=SimpleNamespace(name="backlash"), block="gap"),
        problem=SimpleNamespace(unknowns=SimpleNamespace(items=items)),
        starts=(np.array([1.0, 0.1, 0.0, 0.5]),),
    )
    beside = named("gap_2", {"gain.gain": 0.9, "gap_2.half_width": 0.3, "gap_2.m@r1": 0.2, "lag.time": 0.01})
    (start,) = candidate_fits.known_starts(score, beside)
    assert start.tolist() == [0.9, 0.3, 0.2, 0.5]
    assert candidate_fits.known_starts(score, None) == []
    beside.candidate.effect.name = "creep"
    assert candidate_fits.known_starts(score, beside) == []


def score(name, gain, noise, *, local=(), variant="", place="output"):
    effect = SimpleNamespace(name=name, variant=variant, place=place, local=local)
    candidate = SimpleNamespace(effect=effect)
    return SimpleNamespace(candidate=candidate, gain=gain, noise_gains=np.array([noise, noise]))


def fitted_names(scores):
    """The candidates of these that a round fits, with a problem of a thousand samples."""
    model = SimpleNamespace(problem=SimpleNamespace(samples=1000))
    search = SimpleNamespace(noise_variance=1.0)
    ordered = sorted(scores, key=lambda one: -one.gain)
    chosen = screened_candidates.worth_fitting(ordered, model, search)
    return [f"{one.candidate.effect.name}{one.candidate.effect.variant}" for one in chosen]


def test_what_reaches_much_in_noise_leaves_room_for_other_effects():
    flood = [score("change", 1000.0 + k, 600.0, local=("size",), variant=str(k)) for k in range(20)]
    others = [score(name, 300.0, 20.0) for name in ("backlash", "creep", "dead_zone")]
    names = fitted_names([*flood, *others])
    assert names[:3] == ["change19", "change18", "change17"]
    assert {"backlash", "creep", "dead_zone"} < set(names)
    assert len(names) == screened_candidates.MAX_FITTED_CANDIDATES


def test_what_predicts_next_to_nothing_is_not_fitted_but_for_the_first_few():
    names = fitted_names([score("a", 900.0, 1.0), *(score(n, 5.0, 1.0) for n in "bcde")])
    assert len(names) == screened_candidates.MIN_FITTED_CANDIDATES
    assert names[0] == "a"


def test_replacements_are_fitted_beside_the_others():
    many = [score(f"effect{k}", 500.0, 1.0) for k in range(30)]
    assert "relative" in fitted_names([*many, score("relative", 400.0, 1.0, place=screened_candidates.REPLACED)])


def key(name, variant="", before="lag.u"):
    effect, point = SimpleNamespace(name=name, variant=variant), SimpleNamespace(after="", before=before)
    return Candidate(effect, point, name, None, None).key


def test_a_candidate_is_known_by_its_effect_variant_and_place():
    known = key("dead_zone", "drive", "valve.u")
    assert known == key("dead_zone", "drive", "valve.u")
    assert known != key("dead_zone", "drive")
    assert known != key("dead_zone", before="valve.u")


@pytest.mark.parametrize(
    ("change", "of_base", "step", "depends"),
    [
        (3.2, 0.0, 0.5, True),
        (np.inf, 0.0, 0.5, True),
        (0.9, 0.0, 0.5, False),  # less than the noise
        (3.2, 2.0, 0.5, False),  # the step does not suit the base either
        (3.2, 0.0, None, False),  # the step follows the effect
    ],
)
def test_what_changes_with_a_given_step_is_no_effect(monkeypatch, change, of_base, step, depends):
    fitted, base = (SimpleNamespace(mean_square=size, change=by) for size, by in ((50.0, change), (110.0, of_base)))
    monkeypatch.setattr(candidate_fits, "_change_by_halving", lambda model: model.change)
    assert candidate_fits.depends_on_given_step(fitted, base, SimpleNamespace(step=step)) is depends


def test_half_the_step_shows_a_lag_that_is_too_fast_for_it():
    """Of rk4 at a step of 0.5 s: 0.2 s is close to where it is unstable, 5 s is followed to rounding."""
    t = np.arange(0.0, 40.0, 0.5)
    u = np.where(t % 10 < 5, 1.0, -1.0)
    record = tsm.Record("r", t, {"u": u, "y": np.zeros(t.size)}, {"u": "V", "y": "V"})
    settings = ModelSettings(None, {"y": 0.01}, ("y",), step=0.5, hold="zero")

    def model(time_constant):
        lag = tsm.Diagram(
            blocks={"lag": FirstOrderLag(time_constant=time_constant)}, inputs={"u": "lag"}, outputs={"y": "lag"}
        )
        problem, setup = pose_model(lag, {"r": record}, settings, None)
        return model_at(problem, setup, end_at(problem, problem.unknowns.start))

    slow, fast = model(5.0), model(0.2)
    assert candidate_fits.depends_on_given_step(fast, slow, settings)
    assert not candidate_fits.depends_on_given_step(slow, slow, settings)
    assert not candidate_fits.depends_on_given_step(fast, fast, settings)
