"""The measured files as published: one call reads each, and its notes say exactly what was done."""

import numpy as np
import pytest

from tsmblocks.common.errors import DataError
from tsmblocks.data import cautions, noise, read

CALIB = "t, x_ref [deg], v_ref, x_out [deg], f1 [N], f2 [N], i1, i2"
TRACKING = "t, x_ref [deg], v_ref [deg/s],,, x_out [deg], f1, f2, f3, f4"
VERIFY = "t, x_ref [deg], v_ref [deg/s], vision [deg], vision_mean [deg], x_out [deg], u [deg]"
EVEN = "resampled() gives an even grid."
BETWEEN = "signals are interpolated there."
TENDON = {
    "calib/0.txt": (
        CALIB,
        510,
        [
            "1816 rows repeated the time of the row before (rows 3, 4, 5, 7, 8, …), their values up to 0.436 "
            "N apart (f2, "
            "row 48); each group was replaced by its mean, leaving 510 of 2326 samples."
        ],
    ),
    "calib/60.txt": (
        CALIB,
        516,
        [
            "1811 rows repeated the time of the row before (rows 2, 3, 5, 6, 7, …), their values up to 0.475 "
            "N apart (f2, "
            "row 43); each group was replaced by its mean, leaving 516 of 2327 samples."
        ],
    ),
    "calib/120.txt": (
        CALIB,
        513,
        [
            "1813 rows repeated the time of the row before (rows 2, 3, 5, 6, 7, …), their values up to 2.97 deg apart "
            "(x_out, row 688, 6 times the difference of neighbouring samples); each group was replaced by its "
            "mean, leaving "
            "513 of 2326 samples."
        ],
    ),
    "calib/180.txt": (
        CALIB,
        511,
        [
            "1814 rows repeated the time of the row before (rows 2, 3, 4, 6, 7, …), their values up to 2.03 deg apart "
            "(x_out, row 1297, 5 times the difference of neighbouring samples); each group was replaced by its "
            "mean, leaving "
            "511 of 2325 samples."
        ],
    ),
    "calib/240.txt": (
        CALIB,
        514,
        [
            "1821 rows repeated the time of the row before (rows 2, 3, 4, 6, 7, …), their values up to 2.21 deg apart "
            "(x_out, row 1871, 7 times the difference of neighbouring samples); each group was replaced by its "
            "mean, leaving "
            "514 of 2335 samples."
        ],
    ),
    "tracking/conf0_60.txt": (
        TRACKING,
        31214,
        [
            "7041 rows repeated the time of the row before (rows 2, 12, 23, 27, 35, …), their values up to "
            "0.0325 apart "
            "(f1, row 38207, 118 times the difference of neighbouring samples); each group was replaced by its "
            "mean, leaving "
            "31214 of 38255 samples.",
            "Samples are missing in 160 places. The longest lasts 3.0 usual steps, before row 29311 (from 16.3675 s to "
            f"16.3705 s); {BETWEEN}",
            f"The steps between samples are uneven: 0.0005 s to 0.0015 s around 0.0005 s (up to 200 % off). {EVEN}",
        ],
    ),
    "tracking/conf90_60.txt": (
        TRACKING,
        23268,
        [
            "Time jumps back at row 26329, from 14.9995 s to 0 s; everything from there on (1099 rows, 4 %) "
            "was dropped, "
            "as requested.",
            "3060 rows repeated the time of the row before (rows 3, 17, 23, 28, 39, …), their values up to "
            "2.08 deg apart "
            "(x_out, row 22963, 20 times the difference of neighbouring samples); each group was replaced by its "
            "mean, leaving"
            " 23268 of 26328 samples.",
            f"Samples are missing in 128 places. The longest lasts 3.0 usual steps, before row 15398 (from 8.833 s to "
            f"8.836 s); {BETWEEN}",
            f"The steps between samples are uneven: 0.0005 s to 0.0015 s around 0.0005 s (up to 200 % off). {EVEN}",
        ],
    ),
    "verify/ff.txt": (
        f"{VERIFY},,",
        4659,
        [
            f"Samples are missing in 374 places. The longest lasts 2.8 usual steps, before row 2259 (from 12.04 s to "
            f"12.057 s); {BETWEEN}",
            f"The steps between samples are uneven: 0.001 s to 0.009 s around 0.005 s (up to 80 % off). {EVEN}",
        ],
    ),
    "verify/output.txt": (
        VERIFY,
        4654,
        [
            "1 row repeated the time of the row before (row 1530), with the same values; each group was "
            "replaced by its "
            "mean, leaving 4654 of 4655 samples.",
            f"Samples are missing in 376 places. The longest lasts 2.8 usual steps, before row 4165 (from 22.307 s to "
            f"22.324 s); {BETWEEN}",
            f"The steps between samples are uneven: 0.002 s to 0.009 s around 0.005 s (up to 80 % off). {EVEN}",
        ],
    ),
    "verify/test0224.txt": (
        VERIFY,
        8074,
        [
            "11 rows repeated the time of the row before (rows 1111, 1298, 1441, 1468, 1634, …), with the "
            "same values; each"
            " group was replaced by its mean, leaving 8074 of 8085 samples.",
            f"Samples are missing in 195 places. The longest lasts 3.7 usual steps, before row 2184 (from 5.439 s to "
            f"5.45 s); {BETWEEN}",
            f"The steps between samples are uneven: 0.0005 s to 0.0045 s around 0.0025 s (up to 80 % off). {EVEN}",
            "vision never changes (it is 0 throughout).",
            "vision_mean never changes (it is 0 throughout).",
            "u never changes (it is 0 throughout).",
        ],
    ),
}


@pytest.mark.parametrize(("name", "columns", "samples", "notes"), [(k, *v) for k, v in TENDON.items()], ids=TENDON)
def test_tendon_sheath_files(measured, name, columns, samples, notes):
    record = read(measured / "tendon_sheath" / name, columns=columns, tail="drop")
    assert len(record) == samples
    assert np.all(np.diff(record.t) > 0)
    assert list(record.notes) == notes


def test_the_tail_that_resets_is_refused_unless_it_is_to_be_dropped(measured):
    path = measured / "tendon_sheath/tracking/conf90_60.txt"
    with pytest.raises(DataError) as error:
        read(path, columns=TRACKING)
    assert str(error.value) == (
        f"{path}: time jumps back at row 26329, from 14.9995 s to 0 s. From there on (1099 rows, 4 %) it is another "
        "recording or a tail. To keep the first part, read rows 1 to 26328: rows=(1, 26328), or --rows 1:26328; or "
        'drop the rest: tail="drop", or --tail drop.'
    )
    assert read(path, columns=TRACKING, rows=(1, 26328)).t[-1] == 14.9995


def test_the_calibration_repeats_twice(measured):
    record = read(measured / "tendon_sheath/calib/60.txt", columns=CALIB)
    assert record.period("x_ref") == pytest.approx(2 * np.pi, rel=1e-6)
    first, second = record.periods("x_ref")
    assert abs(len(first) - len(second)) <= 1
    got = noise(record, "x_out", inputs="x_ref")
    assert got.method == "repeated periods"
    assert 0.05 < got.floor < 0.3  # deg; the transient of the first period reaches 16 deg
    assert cautions(record, "x_ref") == ()


def test_tracking_on_an_even_grid(measured):
    record = read(measured / "tendon_sheath/tracking/conf0_60.txt", columns=TRACKING, only=["x_ref", "x_out"])
    even = record.resampled()
    assert even.uniform
    assert len(even) == 40001
    at = np.searchsorted(even.t, record.t - 1e-6)
    assert np.abs(even["x_out"][at] - record["x_out"]).max() < 1e-3
    smooth = even.filtered(cutoff=20.0).differentiated("x_ref", cutoff=20.0)
    assert smooth.unit("x_ref_dot") == "deg/s"


def test_emps(measured):
    for name, signals in (("DATA_EMPS", ("qg", "qm", "vir")), ("DATA_EMPS_PULSES", ("pulses_N", "qg", "qm", "vir"))):
        record = read(measured / f"emps/{name}.mat", units={"qg": "m", "qm": "m", "vir": "V"})
        assert (record.names, len(record), record.notes) == (signals, 24841, ())
        assert record.uniform
    assert noise(record, "qm").method == "high frequencies"  # the pulses do not repeat as the reference does


def test_the_velocity_of_emps_follows_its_position(measured):
    record = read(measured / "emps/DATA_EMPS.mat", units={"qm": "m"}).differentiated("qm")
    assert record.unit("qm_dot") == "m/s"
    back = np.cumsum(record["qm_dot"]) * record.step
    off = back - (record["qm"] - record["qm"][0])
    assert np.abs(off - off.mean()).max() < 2e-4  # of a stroke of 0.24 m
    assert np.ptp(record["qm"]) > 0.2


def test_cascaded_tanks(measured):
    path = measured / "cascaded_tanks/dataBenchmark.csv"
    record = read(path, step=4.0, only=["uEst", "yEst", "uVal", "yVal"])
    assert (len(record), record.notes) == (1024, ())
    with pytest.raises(DataError) as error:
        read(path, step=4.0)
    assert str(error.value) == (
        f"{path}: column 5 (Ts) has no number in rows 3 to 1025. At the end there is nothing to interpolate from: read "
        "fewer rows, leave the column out, or correct the file."
    )


def test_silverbox(measured):
    record = read(measured / "silverbox/SNLS80mV.csv", step=1 / 610.35, units={"V1": "V", "V2": "V"})
    assert (record.names, len(record), record.notes) == (("V1", "V2"), 131072, ())
    arrow = read(measured / "silverbox/SNLS80mV.csv", step=1 / 610.35, rows=(101, 40576))
    np.testing.assert_array_equal(arrow["V2"], record["V2"][99:40575])


@pytest.mark.parametrize(
    ("name", "group", "samples", "period"),
    [("test", "multisine", 8192, None), ("test", "sinesweep", 153000, None), ("train", "multisine", 40960, 8192 / 750)],
)
def test_bouc_wen(measured, name, group, samples, period):
    record = read(measured / f"bouc_wen/{name}.h5", group=group, step=1 / 750, units={"u": "N", "y": "m"})
    assert (record.names, len(record), record.notes) == (("u", "y"), samples, ())
    assert record.period("u") == (None if period is None else pytest.approx(period, rel=1e-9))


def test_the_noise_of_the_bouc_wen_training_data(measured):
    """Its five periods differ by the noise alone that was added; the test data hold none."""
    record = read(measured / "bouc_wen/train.h5", group="multisine", step=1 / 750)
    got = noise(record, "y", inputs="u")
    assert got.method == "repeated periods"
    steady = np.concatenate([p["y"] for p in record.periods("u")[2:]]).reshape(3, -1)
    assert got.floor == pytest.approx(float(np.sqrt(np.mean(np.var(steady, axis=0, ddof=1)))), rel=0.05)
