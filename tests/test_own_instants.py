"""Sudden changes at an instant of their own in each experiment, where experiments share no clock."""

import re

import numpy as np
import pytest

import tsmblocks as tsm
from tsmblocks.blocks import Bias, Gain
from tsmblocks.diagnosis.own_instants import Products, for_each, joined, moved, noise_gains
from tsmblocks.diagnosis.rejection import RECURRING
from tsmblocks.fitting.column_space import column_space
from tsmblocks.fitting.jacobian import Jacobian

BASE = tsm.Diagram(
    blocks={"gain": Gain(gain=0.9, unit="rad"), "offset": Bias()},
    wires=["gain -> offset"],
    inputs={"x_in": "gain.u"},
    outputs={"x_out": "offset.y"},
    title="bench",
)
LENGTHS = (8.0, 10.0, 12.0)
SIGMA = 0.004
OF_TIME = ("drift", "jump", "parameter_change", "creep", "periodic_disturbance")


def recordings(change, seed=3, steps=(0.02, 0.02, 0.02)):
    """Recordings of these lengths, each from 0 s: 0.9 x + 0.05, white noise, and what ``change(t, x, k)`` adds."""
    rng, made = np.random.default_rng(seed), {}
    for k, (length, step) in enumerate(zip(LENGTHS, steps, strict=True)):
        t = np.arange(0, length, step)
        x = np.sin(2.1 * t + k) + 0.5 * np.sin(5.3 * t + 2 * k)
        y = 0.9 * x + 0.05 + change(t, x, k) + SIGMA * rng.standard_normal(len(t))
        made[f"r{k + 1}"] = tsm.Record(f"r{k + 1}", t, {"x_in": x, "x_out": y}, {"x_in": "rad", "x_out": "rad"})
    return made


def test_a_jump_at_an_instant_of_its_own_in_each_recording_is_one_effect():
    """With one instant for all, a second effect was needed: a loop that changes."""
    sizes, instants = (0.01, 0.012, -0.009), (3.1, 6.37, 8.24)
    found = tsm.diagnose(BASE, recordings(lambda t, x, k: sizes[k] * (t > instants[k])), effects=OF_TIME)
    assert [one.name for one in found.effects] == ["jump"]
    values = found.effects[0].parameters
    for k, (size, instant) in enumerate(zip(sizes, instants, strict=True), start=1):
        assert values[f"time@r{k}"].value == pytest.approx(instant, abs=0.03)
        assert values[f"size@r{k}"].value == pytest.approx(size, abs=0.001)
    assert "in r2, where it is largest" in " ".join(str(found).split())


def test_changes_that_come_and_go_at_many_instants_are_not_named():
    """A drift was named instead."""

    def loosening(t, x, k):
        rng = np.random.default_rng(40 + k)
        instants, sizes = rng.uniform(1, 7, 3), rng.choice([-1, 1], 3) * rng.uniform(0.03, 0.06, 3)
        return sum(size * x * (t > instant) for size, instant in zip(sizes, instants, strict=True))

    found = tsm.diagnose(BASE, recordings(loosening), effects=OF_TIME)
    assert not found.effects
    assert any("comes and goes so often" in note for note in found.notes)
    rows = [row for segment in found.segments for row in segment.ranking if row.why_not == RECURRING]
    assert rows
    assert all(row.fitted and not row.named and not row.in_set for row in rows)
    assert RECURRING in " ".join(str(found).split())


def test_shapes_are_put_together_experiment_by_experiment():
    every = [for_each({"time": t, "distance": 0.2}, ["time"], ["a", "b"]) for t in (1.0, 2.0, 3.0)]
    assert every[1] == {"distance": 0.2, "time@a": 2.0, "time@b": 2.0}
    assert joined(every, [2, 0], ["a", "b"]) == {"distance": 0.2, "time@a": 3.0, "time@b": 1.0}
    assert moved(every[0], "time", 0.5) == {"distance": 0.2, "time@a": 1.5, "time@b": 1.5}


def test_gains_in_surrogates_are_those_of_least_squares():
    """Against least squares with every pair of shapes written out; the best one of each experiment is taken."""
    rng, n, shapes, k, draws = np.random.default_rng(0), 60, 4, 2, 5
    base, r, noise = rng.standard_normal((2 * n, 3)), rng.standard_normal(2 * n), rng.standard_normal((2 * n, draws))
    space = column_space(Jacobian.of(base), 1e-12)
    noise = space.project_out(noise)
    apart = [
        np.where((np.arange(2 * n) // n == e)[:, None], rng.standard_normal((2 * n, shapes * k)), 0) for e in (0, 1)
    ]
    products = [Products.of(one, k, space, r, noise) for one in apart]

    def fall(y, columns):
        both = np.hstack([base, columns])
        without = y - base @ np.linalg.lstsq(base, y, rcond=None)[0]
        return without @ without - np.sum((y - both @ np.linalg.lstsq(both, y, rcond=None)[0]) ** 2)

    def part(e, s):
        return apart[e][:, s * k : (s + 1) * k]

    gains = noise_gains(products)
    for d in range(draws):
        best = [int(np.argmax([fall(noise[:, d], part(e, s)) for s in range(shapes)])) for e in (0, 1)]
        expected = fall(noise[:, d], np.hstack([part(e, s) for e, s in enumerate(best)]))
        assert gains[d] == pytest.approx(expected, rel=1e-4)
    assert products[0].best == np.argmax([fall(r, part(0, s)) for s in range(shapes)])


def test_a_hum_at_half_of_the_sampling_rate_is_named():
    """At its bound it was no name; here 25.01 Hz at 50 samples in a second, and at 100."""
    phase = (0.4, 1.7, 2.9)
    hum = recordings(lambda t, x, k: 2 * SIGMA * np.sin(2 * np.pi * 25.01 * t + phase[k]), steps=(0.01, 0.01, 0.02))
    found = tsm.diagnose(BASE, hum, effects=OF_TIME)
    assert [one.name for one in found.effects] == ["periodic_disturbance"]


def test_the_recordings_in_which_nothing_changes_are_named_and_not_listed():
    """Their sizes and instants are those of noise: five lines of cautions were on them."""
    found = tsm.diagnose(BASE, recordings(lambda t, x, k: 0.012 * (t > 6.37) * (k == 1)), effects=OF_TIME)
    assert [one.name for one in found.effects] == ["jump"]
    (jump,) = found.effects
    assert jump.absent_in == ("r1", "r3")
    told = " ".join(str(found).split())
    assert "s, in r2 only)" in told
    assert "not detectable in r1 and r3" in told
    assert not any("@r1" in text or "@r3" in text for text in found.segments[0].cautions)
    assert "size@r1" in found.details()
    assert found.to_dict()["effects"][0]["absent_in"] == ["r1", "r3"]


def test_a_gain_that_differs_is_relative_to_a_recording_where_the_diagram_has_a_gain():
    """One recording had 1 % more, and two others were said to have 0.8 % less each."""
    found = tsm.diagnose(BASE, recordings(lambda t, x, k: 0.045 * x * (k == 2)), effects=["gain_error", "offset"])
    (effect,) = found.effects
    assert effect.name == "gain_error"
    assert effect.relative_to in ("r1", "r2")
    size = effect.sizes["error of the gain@r3"]
    assert size.low < 5.0 < size.high
    assert size.high - size.low < 1.0
    assert set(effect.absent_in) == {"r1", "r2"}
    told = " ".join(str(found).split())
    assert f"% in r3 relative to {effect.relative_to})" in told
    assert f"relative to {effect.relative_to}; not detectable in" in told
    assert "gain_error.error: a separate value in each experiment, here that of r1" in told


def test_the_report_lists_each_parameter_once_where_the_effect_is_present(tmp_path):
    """What is fitted for each recording was listed again as not fitted."""
    found = tsm.diagnose(BASE, recordings(lambda t, x, k: 0.012 * (t > 6.37) * (k == 1)), effects=["jump"])
    found.save(tmp_path)
    page = (tmp_path / "report.html").read_text(encoding="utf-8")
    row = re.search(r"Blocks that were added.*?</table>", page.partition("<caption")[2], re.DOTALL).group()
    assert "size@r2" in row
    assert "@r1" not in row
    assert re.findall(r"(\w+) [-0-9.]+ \w+ \(not fitted\)", row) == ["width"]
