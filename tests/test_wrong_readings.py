"""Single samples far off their neighbours are wrong readings of a sensor: they have no weight in a diagnosis."""

import attrs
import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st

import tsmblocks as tsm
from tests.test_diagnosis_pieces import MOTOR
from tests.test_diagnosis_pieces import recording as friction_recording
from tests.test_outliers import GAIN, records
from tsmblocks.diagnosis.wrong_readings import BESIDE, LOCAL_RATIO, off_neighbours

FEW = ["jump", "offset", "odd_nonlinearity"]


def spiked(record, at, size, name="x_out"):
    """A recording with some samples of a signal off by a size."""
    x = record[name].copy()
    x[at] += size
    return attrs.evolve(record, signals={**record.signals, name: x})


def note_of(found):
    """The note on wrong readings, which is one at most."""
    notes = [text for text in found.notes if "without weight" in text]
    assert len(notes) <= 1
    return notes[0] if notes else ""


# ---- how far samples are off


@given(st.floats(-1e3, 1e3), st.floats(-1e3, 1e3), st.floats(0.1, 1e3), st.integers(BESIDE, 29 - BESIDE))
def test_a_sample_is_off_by_its_distance_from_the_line_of_its_neighbours(start, slope, size, at):
    x = start + slope * np.arange(30.0)
    x[at] += size
    off, around = off_neighbours(x)
    rounding = 1e-12 * (abs(start) + 30 * abs(slope) + size)
    assert off[at] == pytest.approx(size, abs=rounding)
    assert around[at] <= rounding
    assert (np.delete(np.abs(off), at) <= LOCAL_RATIO * np.delete(around, at) + rounding).all()


@given(st.floats(-5.0, 5.0), st.floats(-5.0, 5.0), st.floats(-5.0, 5.0))
def test_a_kink_and_a_jump_are_no_single_samples(before, after, jump):
    k = np.arange(-15.0, 16.0)
    off, around = off_neighbours(np.where(k < 0, before * k, after * k + jump))
    assert (np.abs(off) <= 0.5 * LOCAL_RATIO * around + 1e-9).all()


def test_a_second_wrong_reading_beside_it_hides_none():
    x = np.random.default_rng(2).standard_normal(200)
    x[[100, 103]] += 30.0
    off, around = off_neighbours(x)
    assert np.flatnonzero(np.abs(off) > LOCAL_RATIO * around).tolist() == [100, 103]


def test_two_samples_beside_each_other_are_no_single_ones():
    x = np.random.default_rng(3).standard_normal(200)
    x[[100, 101, 150]] += 40.0
    off, around = off_neighbours(x)
    assert np.flatnonzero(np.abs(off) > LOCAL_RATIO * around).tolist() == [150]


@pytest.mark.parametrize("count", [0, 1, 2 * BESIDE])
def test_too_few_samples_have_no_neighbours(count):
    assert not off_neighbours(np.arange(float(count)) ** 2)[0].any()


# ---- in a diagnosis


def test_wrong_readings_change_neither_residual_nor_noise_floor():
    clean = records(4)
    found = [
        tsm.diagnose(GAIN, some, effects=FEW)
        for some in (clean, [spiked(one, [40, 200 + 10 * k], 0.4) for k, one in enumerate(clean)])
    ]
    (ours,), (theirs,) = ((one.segments[0].gaps) for one in found)
    assert ours.noise_floor == pytest.approx(theirs.noise_floor, rel=0.02)
    assert ours.held_out[-1] == pytest.approx(theirs.held_out[-1], rel=0.02)
    assert theirs.outliers == 0
    assert [one.verdict for one in found] == ["none", "none"]
    assert not note_of(found[0])
    assert note_of(found[1]).startswith("8 samples of x_out (")
    assert ": taken for wrong readings" in note_of(found[1])


def test_a_single_one_is_told_with_its_instant():
    first, *others = records(5)
    found = tsm.diagnose(GAIN, [spiked(first, 100, -0.4), *others], effects=FEW)
    assert note_of(found).startswith("1 sample of x_out (")
    assert f"is far off its neighbours, at t = {first.t[100]:g} s of run 0 (by 0.3" in note_of(found)


def test_they_are_found_in_the_pieces_of_a_plant_that_integrates():
    runs = [spiked(friction_recording(seed, 0.3), [400, 771], 0.5, "x") for seed in (1, 2)]
    found = tsm.diagnose(MOTOR, runs, effects=["coulomb_friction"])
    assert any("restarts about every" in note for note in found.notes)
    assert [one.name for one in found.effects] == ["coulomb_friction"]
    assert found.worst.complete
    assert note_of(found).startswith("4 samples of x (")


def test_they_are_found_where_uneven_samples_are_interpolated_on_a_grid():
    """The grid has a part of each wrong reading on either side of it."""
    draw, runs = np.random.default_rng(11), []
    for k in range(2):
        t = 0.01 * (np.arange(2000) + draw.uniform(-0.15, 0.15, 2000))
        x = np.sin(1.1 * t + k) + 0.4 * np.sin(4.3 * t)
        y = 0.9 * x + 0.002 * draw.standard_normal(len(t))
        drive = x + 0.01 * draw.standard_normal(len(t))
        runs.append(spiked(tsm.Record(f"run {k}", t, {"x_in": drive, "x_out": y}, {}), [500, 777, 1400], 0.2))
    found = tsm.diagnose(GAIN, runs, effects=FEW)
    assert any("Resampled" in text for text in found.notes)
    assert note_of(found).startswith("6 samples of x_out (")
    (gap,) = found.segments[0].gaps
    assert gap.outliers == 0


def test_the_answer_to_jumps_of_an_input_is_no_wrong_reading():
    """A controller answers each step of its reference by one high sample; its model lacks that."""
    draw, t = np.random.default_rng(6), np.arange(0.0, 40.0, 0.02)
    reference = np.repeat(draw.normal(size=40), 50)
    kick = 0.5 * np.r_[0.0, np.diff(reference)]
    record = tsm.Record("loop", t, {"x_in": reference, "x_out": 0.9 * reference + kick}, {})
    noisy = attrs.evolve(record, signals={**record.signals, "x_out": record["x_out"] + 0.001 * draw.normal(size=2000)})
    assert not note_of(tsm.diagnose(GAIN, noisy, effects=FEW))
    assert "2 samples" in note_of(tsm.diagnose(GAIN, spiked(noisy, [525, 1431], 0.5), effects=FEW))


def test_the_last_digit_of_a_converter_that_flickers_is_no_wrong_reading():
    draw, t = np.random.default_rng(7), np.arange(0.0, 20.0, 0.01)
    x = np.clip(np.sin(0.9 * t), -0.6, 0.6)
    y = 0.05 * np.round((0.9 * x + 0.006 * draw.standard_normal(len(t))) / 0.05)
    assert not note_of(tsm.diagnose(GAIN, tsm.Record("run", t, {"x_in": x, "x_out": y}, {}), effects=FEW))


def test_a_single_sample_that_holds_little_keeps_its_weight():
    """It may be the only one of a fast motion."""
    first, *others = records(9)
    at, noise = 150, float(np.std(np.diff(first["x_out"] - 0.9 * first["x_in"]))) / np.sqrt(2)
    line = np.median([first["x_out"][[at - k, at + k]].mean() for k in (1, 2, 3)])
    spike = spiked(first, at, line + 11 * noise - first["x_out"][at])
    assert not note_of(tsm.diagnose(GAIN, [spike, *others], effects=FEW))
    assert note_of(tsm.diagnose(GAIN, [spiked(spike, at, 60 * noise), *others], effects=FEW))


def test_samples_that_were_missing_are_not_counted_again():
    first, *others = records(8)
    gone = np.zeros(len(first), dtype=bool)
    gone[[100, 300]] = True
    marked = attrs.evolve(spiked(first, [100, 300], 0.4), filled={"x_out": gone})
    assert not note_of(tsm.diagnose(GAIN, [marked, *others], effects=FEW))
