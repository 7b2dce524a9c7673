"""The step of the simulation in fits and diagnoses: told, or made finer, where intervals do not cover its error."""

import numpy as np
import pytest

import tsmblocks as tsm
from tsmblocks.blocks import Play
from tsmblocks.fitting.statistics import moved

T = np.arange(0.0, 12.0, 0.01)
X = 0.8 * np.sin(1.3 * T) + 0.3 * np.sin(3.1 * T)
SHEATH = tsm.load("tendon_sheath_asymmetric")
GAP = SHEATH.insert("gap", Play(half_width=np.deg2rad(1.5)), before="tsm.x")
"""A gap in front of a plant that answers to the rate of its input: the rate jumps within steps."""
NAMED = ("- x_in -> x_out: the parameters were refitted at a step of", "since they depended on the step of 0.01 s")


def recorded(noise, sizes=(1.0, 0.4)):
    """What a fine simulation gives, with noise [rad]."""
    made, draw = {}, np.random.default_rng(3)
    for name, size in zip("ab", sizes, strict=False):
        run = tsm.simulate(GAP, inputs={"x_in": (T, size * X)}, stop=T[-1], step=1e-4, hold="cubic")
        y = np.interp(T, run.t, run["x_out"]) + draw.normal(0.0, noise, T.size)
        made[name] = tsm.Record(name, T, {"x_in": size * X, "x_out": y}, {"x_in": "rad", "x_out": "rad"})
    return made


def step_notes(found):
    return [text for text in found.notes if "halving the step" in text]


@pytest.mark.parametrize("step", [None, 0.01])
def test_a_step_that_moves_the_numbers_beyond_their_intervals_is_told(step):
    fit = tsm.fit(GAP, recorded(1e-3, (1.0,)), hold="cubic", starts=1, step=step)
    assert fit.step == 0.01
    (said,) = step_notes(fit)
    assert said.startswith("halving the step of 0.01 s moves ")
    assert said.endswith("the intervals do not cover the error of the step; give a smaller step.")
    assert said in str(fit).replace("\n  ", " ")


def test_what_is_told_is_what_halving_the_step_does():
    records = recorded(1e-4, (1.0,))
    coarse, fine = (tsm.fit(GAP, records, free=["tsm.delta"], hold="cubic", starts=1, step=h) for h in (0.01, 0.005))
    e = coarse["tsm.delta"]
    size = abs(fine["tsm.delta"].value - e.value) / ((e.high - e.low) / 2)
    (said,) = step_notes(coarse)
    told = float(said.partition(" by ")[2].partition(" times")[0])
    assert told == pytest.approx(size, rel=0.1)


def test_noise_that_covers_the_error_of_the_step_is_no_reason_to_warn():
    assert step_notes(tsm.fit(GAP, recorded(0.05), hold="cubic", starts=1)) == []
    assert step_notes(tsm.fit(SHEATH, recorded(0.05), starts=1)) == []


def test_a_diagnosis_ends_with_a_step_that_its_intervals_cover():
    records = recorded(2e-3)
    found = tsm.diagnose(SHEATH, records, noise_floor=2e-3, effects=["backlash", "dead_time"])
    (effect,) = found.effects
    width = effect.parameters["half_width"]
    assert width.low < np.deg2rad(1.5) < width.high
    assert step_notes(found) == []
    assert all(words in str(found).replace("\n  ", " ") for words in NAMED)
    kept = tsm.diagnose(SHEATH, records, noise_floor=2e-3, effects=["backlash", "dead_time"], step=0.01)
    (said,) = step_notes(kept)
    assert said.startswith("x_in -> x_out: halving the step of 0.01 s moves ")
    assert found.worst.gaps[0].train[-1] < kept.worst.gaps[0].train[-1]


def test_how_far_an_estimate_moves():
    draw = np.random.default_rng(0)
    J, change = draw.normal(size=(50, 3)), draw.normal(size=50)
    assert moved(J, change) == pytest.approx(-np.linalg.lstsq(J, change, rcond=None)[0])
    held = moved(J, change, held=np.array([[1.0, 0.0, 0.0]]))
    assert held[0] == 0
    assert held[1:] == pytest.approx(-np.linalg.lstsq(J[:, 1:], change, rcond=None)[0])
    prior = np.diag([4.0, 0.0, 1.0])
    assert moved(J, change, prior=prior) == pytest.approx(-np.linalg.solve(J.T @ J + prior, J.T @ change))
