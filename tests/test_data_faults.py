"""Every fault that measured data may have: what is repaired, with its note, and what is refused, with its row."""

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from tsmblocks.common.errors import DataError
from tsmblocks.data import read


def csv(t, *signals, head="t,x"):
    return head + "\n" + "".join(",".join(f"{v:.10g}" for v in row) + "\n" for row in zip(t, *signals, strict=True))


@pytest.fixture
def file(tmp_path):
    def make(text, name="a.csv"):
        path = tmp_path / name
        path.write_text(text)
        return path

    return make


def refusal(path, **options):
    with pytest.raises(DataError) as error:
        read(path, **options)
    return str(error.value)


STEPS = np.arange(40) / 10
CUT = np.r_[STEPS, 0.0, 0.1, 0.2]
HOLE = np.r_[STEPS, STEPS + 10]
FAULTS = {
    "time repeats throughout": (
        csv([5, 5, 5, 5], range(4)),
        "column 1 (t) is 5 s in all 4 rows, so it cannot be the time. Map t to the column that is.",
    ),
    "time is missing": ("t,x\n0,1\n,2\n2,3\n3,4\n4,5\n", "column 1 (t) has no number in row 3 (1 such row)."),
    "time jumps back": (
        csv(CUT, CUT),
        "time jumps back at row 42, from 3.9 s to 0 s. From there on (3 rows, 7 %) it is another recording or a tail. "
        "To keep the first part, read rows 2 to 41: rows=(2, 41), or --rows 2:41; or drop the rest: "
        'tail="drop", or --tail drop.',
    ),
    "one time is too large": (
        csv([0, 1, 2, 1e6, 4, 5, 6], range(7)),
        "the time in row 5 (1e+06 s) does not fit between those of the rows around it (2 s and 4 s). "
        "Correct that row, or delete it.",
    ),
    "one time is too small": (
        csv([*range(20, 40), 0, *range(41, 60)], range(40)),
        "the time in row 22 (0 s) does not fit between those of the rows around it (39 s and 41 s). "
        "Correct that row, or delete it.",
    ),
    "a long gap": (
        csv(HOLE, HOLE),
        "there are no samples between row 41 (3.9 s) and row 42 (10 s), 61 times the usual step. What happened in "
        "between is not known, so a run across it would be wrong. Read the rows before or after it: rows=(2, 41), or "
        '--rows 2:41; or keep it: gaps="keep", or --gaps keep.',
    ),
    "several long gaps": (
        csv(np.r_[HOLE, STEPS + 20], np.r_[HOLE, STEPS]),
        "there are no samples between row 41 (3.9 s) and row 42 (10 s), 61 times the usual step (the first of 2 such "
        "gaps). What happened in between is not known, so a run across it would be wrong. Read the rows before or "
        'after it: rows=(2, 41), or --rows 2:41; or keep it: gaps="keep", or --gaps keep.',
    ),
    "numbers missing for long": (
        "t,x\n0,1\n" + "".join(f"{k},\n" for k in range(1, 6)) + "6,1\n7,2\n",
        "column 2 (x) has no number in rows 3 to 7. At most 3 samples are interpolated: read the rows before or after, "
        "leave the column out, or correct the file.",
    ),
    "a column without numbers": (
        "t,x\n0,\n1,\n2,\n3,\n",
        "column 2 (x) has no number in rows 2 to 5. It is empty throughout: map another column, leave the column out, "
        "or correct the file.",
    ),
    "text": ("t,x\n0,1\n1,off\n2,1\n3,1\n", "row 3, column 2 (x) holds 'off', which is not a number."),
    "decimal commas between commas": (
        "t,x\n0,0,1,5\n0,1,2,5\n0,2,2,5\n0,3,1,5\n",
        "row 2 has 4 cells, but there are 2 columns (and 3 more such rows). Every row needs the same number of cells. "
        "If these are numbers with a decimal comma, save them with semicolons between the cells.",
    ),
    "no time": (
        csv(range(5), range(5), head="u,y"),
        "no column is named t or time. Map t to the column that holds the time (there are u, y): "
        "map={'t': 'COLUMN'}, or --map 't=COLUMN'. Or give the step of the rows in s (step=…, or --sampling).",
    ),
    "several wrong times": (
        csv([*range(29), 3.5, *range(29, 49), 12.5, *range(49, 59)], range(61)),
        "the time in row 31 (3.5 s) does not fit between those of the rows around it (28 s and 29 s). There are 2 such "
        "places: correct the file.",
    ),
    "too few rows": ("t,x\n0,1\n1,2\n", "only 2 samples found; 4 are the least."),
}


@pytest.mark.parametrize(("text", "message"), FAULTS.values(), ids=FAULTS.keys())
def test_what_is_refused(file, text, message):
    path = file(text)
    assert refusal(path) == f"{path}: {message}"


@pytest.mark.parametrize(
    ("options", "message"),
    [
        (dict(tail="cut"), "tail must be 'refuse' or 'drop', got 'cut'."),
        (dict(gaps=True), "gaps must be 'refuse' or 'keep', got True."),
        (
            dict(only=["x_in"]),
            "there is no column 'x_in'. Known here: x. If it has another name there, map it: "
            "map={'x_in [deg]': 'COLUMN'}, or --map 'x_in [deg]=COLUMN'.",
        ),
        (dict(group="run"), "a group was given, but text files have none."),
    ],
)
def test_wishes_that_cannot_be_met(file, options, message):
    path = file(csv(STEPS, STEPS))
    assert refusal(path, **options) == f"{path}: {message}"


# ---- time repaired


def test_a_few_late_rows_are_sorted(file):
    order = [*range(10), 11, 10, *range(12, 20), 23, 20, 21, 22, *range(24, 40)]
    record = read(file(csv(STEPS[order], np.sin(STEPS[order]))))
    np.testing.assert_allclose(record.t, STEPS, atol=1e-9)
    np.testing.assert_allclose(record["x"], np.sin(STEPS), atol=1e-9)
    assert record.notes == () or record.notes == (
        "4 rows were out of order by up to 3 places, the first at row 13 (1 s after 1.1 s); the rows were sorted by "
        "time.",
    )


def test_rows_far_out_of_order_are_not_sorted(file):
    far = [*range(20), *range(30, 40), *range(20, 30)]
    assert "time jumps back at row 32" in refusal(file(csv(STEPS[far], STEPS)))


def test_two_recordings_that_overlap_are_not_merged_by_sorting(file):
    t = np.r_[0.0, 0.1, 0.2, STEPS]
    assert "time jumps back at row 5, from 0.2 s to 0 s" in refusal(file(csv(t, t)))


def test_a_tail_is_dropped_when_that_is_wanted(file):
    record = read(file(csv(CUT, np.arange(43.0))), tail="drop")
    np.testing.assert_allclose(record.t, STEPS)
    assert record.notes == (
        "Time jumps back at row 42, from 3.9 s to 0 s; everything from there on (3 rows, 7 %) was "
        "dropped, as requested.",
    )
    assert read(file(csv(STEPS, STEPS)), tail="drop").notes == ()


def test_one_wrong_time_is_no_tail_to_drop(file):
    assert "the time in row 5 (1e+06 s) does not fit" in refusal(file(FAULTS["one time is too large"][0]), tail="drop")


def test_missing_rows_are_told(file):
    kept = np.r_[0:10, 13:40]
    record = read(file(csv(STEPS[kept], STEPS[kept])))
    assert len(record) == 37
    assert record.notes == (
        "Samples are missing in one place. It lasts 4.0 usual steps, before row 12 (from 0.9 s to 1.3 s); signals are "
        "interpolated there.",
    )


def test_long_gaps_are_kept_when_that_is_wanted(file):
    assert read(file(csv(HOLE, HOLE)), gaps="keep").notes == (
        "Samples are missing in one place. It lasts 61.0 usual steps, before row 42 (from 3.9 s to 10 s); signals are "
        "interpolated there. Long gaps were kept, as requested.",
    )


def test_jitter_is_measured(file):
    t = STEPS + 0.01 * np.r_[0.0, np.tile([1.0, 0.0, -1.0], 13)]
    record = read(file(csv(t, t)))
    np.testing.assert_allclose(record.t, t, atol=1e-9)
    assert record.notes == (
        "The steps between samples are uneven: 0.09 s to 0.12 s around 0.09 s (up to 33 % off). resampled() gives an "
        "even grid.",
    )
    assert not record.uniform
    assert record.jitter == pytest.approx(1 / 3, rel=1e-6)


def repeated(file, x, y, rows=(11, 31)):
    """What is said of a file of 80 rows in which these two stand twice, with other values the second time."""
    t = np.arange(80) / 100
    lines = csv(t, x, y, head="t,x [deg],y").splitlines(keepends=True)
    for row in sorted(rows, reverse=True):
        a, b, c = lines[row - 1].split(",")
        lines.insert(row, f"{a},{float(b):g},{float(c) + row:g}\n")
    return read(file("".join(lines))).notes


def test_repeated_rows_are_named_and_how_far_they_are_apart(file):
    moving = np.cumsum(np.random.default_rng(1).normal(0, 20, 80))
    (note,) = repeated(file, np.arange(80.0), np.round(moving, 3))
    assert note == (
        "2 rows repeated the time of the row before (rows 12, 33), their values up to 31 apart (y, row 33); each group "
        "was replaced by its mean, leaving 80 of 82 samples."
    )


def test_repeated_rows_apart_where_nothing_moves_are_told(file):
    rows = [(0.0, 1.0), (1.0, 0.0), (1.0, 2.0), *((k, 1.0) for k in range(2, 40))]
    record = read(file("t,y\n" + "".join(f"{t},{y}\n" for t, y in rows)))
    apart = "their values up to 2 apart (y, row 4, while neighbouring samples do not differ)"
    assert apart in record.notes[0]
    assert set(record["y"]) == {1.0}


def test_repeated_rows_far_apart_beside_their_neighbours_are_told(file):
    slow = np.sin(np.arange(80) / 10)
    usual = np.sqrt(
        np.mean(np.diff(slow + np.isin(np.arange(80), [9, 29]) * np.where(np.arange(80) < 20, 5.5, 15.5)) ** 2)
    )
    note = repeated(file, np.arange(80.0), slow)[0]
    assert 31 / usual > 5
    assert (
        f"their values up to 31 apart (y, row 33, {31 / usual:.0f} times the difference of neighbouring samples)"
        in note
    )


def test_repeats_jitter_and_a_tail_together(file):
    t = np.r_[np.repeat(STEPS, 2), 0.0, 0.0]
    record = read(file(csv(t, np.r_[np.repeat(STEPS, 2), 7.0, 7.0])), tail="drop")
    np.testing.assert_allclose(record["x"], STEPS)
    assert record.notes == (
        "Time jumps back at row 82, from 3.9 s to 0 s; everything from there on (2 rows, 2 %) was "
        "dropped, as requested.",
        "40 rows repeated the time of the row before (rows 3, 5, 7, 9, 11, …), with the same values; each group was "
        "replaced by its mean, leaving 40 of 80 samples.",
    )


@settings(max_examples=60, deadline=None)
@given(st.permutations(range(9)), st.integers(0, 200))
def test_sorting_gives_what_was_written_or_refuses(tmp_path_factory, shuffle, place):
    """Whatever nine neighbouring rows do, no row is ever read under another's time."""
    t = np.arange(240) / 8
    order = np.arange(240)
    order[place : place + 9] = place + np.array(shuffle)
    path = tmp_path_factory.mktemp("order") / "a.csv"
    path.write_text(csv(t[order], t[order] ** 2))
    record = read(path)
    np.testing.assert_allclose(record.t, t)
    np.testing.assert_allclose(record["x"], t**2)


# ---- signals


def test_angles_that_wrap_are_told(file):
    t = np.arange(100) / 10
    angle = np.mod(100 * t, 360)
    record = read(file(csv(t, angle, head="t,x [deg]")))
    assert record.notes == (
        "x jumps by about a turn (360 deg) at row 38 and in 1 more place. If it is an encoder that wraps, "
        "unwrapped('x') joins the parts.",
    )
    joined = record.unwrapped("x")
    np.testing.assert_allclose(joined["x"], 100 * t, atol=1e-6)
    assert joined.notes[-1] == "x: 2 jumps of a turn were joined (a turn is 360 deg)."
    assert "jumps by about a turn (6.28319) at row" in read(file(csv(t, np.radians(angle)))).notes[0]


@pytest.mark.parametrize("x", [180 * np.sign(np.sin(STEPS)), 500 * np.sin(STEPS), 170 * np.sin(STEPS)])
def test_what_only_looks_like_a_turn_is_not_told(file, x):
    assert read(file(csv(STEPS, x, head="t,x [deg]"))).notes == ()


def test_constant_signals_are_told(file):
    record = read(file(csv(STEPS, STEPS, 0 * STEPS, head="t,x,y")))
    assert record.notes == ("y never changes (it is 0 throughout).",)


# ---- a row of units under the header

UNITS = {
    "plain": "t,x_in,x_out,n\ns,deg,mm,\n",
    "brackets": "t,x_in,x_out,n\n[s],[deg],(mm),[-]\n",
    "header wins": "t,x_in [deg],x_out,n\ns,rad,mm,-\n",
    "one not known": "t,x_in,x_out,n\ns,deg,mm,counts\n",
}


@pytest.mark.parametrize("head", UNITS.values(), ids=UNITS.keys())
def test_a_row_of_units(file, head):
    record = read(file(head + "".join(f"{k},{k},{k},{k}\n" for k in range(5))))
    assert (record.unit("x_in"), record.unit("x_out"), len(record)) == ("deg", "mm", 5)
    assert record.unit("n") == ("counts" if "counts" in head else "")
    assert record.notes[0].startswith("Row 2 was read as the units of the columns (")


def test_a_row_of_units_scales_the_time(file):
    record = read(file("time,x\nms,V\n0,1\n1,2\n2,3\n3,4\n"))
    np.testing.assert_allclose(record.t, [0, 0.001, 0.002, 0.003])
    assert record.notes == ("Row 2 was read as the units of the columns (ms, V).",)


def test_a_second_row_of_words_is_no_row_of_units(file):
    path = file("t,x\nlogger,seven\n0,1\n1,2\n2,3\n3,4\n")
    assert refusal(path) == (
        f"{path}: row 2, column 1 (t) holds 'logger', which is not a number (and 1 more such cell)."
    )
