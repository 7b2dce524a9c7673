"""Reading measured data: every kind of file, every repair with its note, every refusal with its row."""

import pickle
import re
import sys

import numpy as np
import pytest
from hypothesis import example, given, settings
from hypothesis import strategies as st

import tsmblocks as tsm
from tsmblocks.blocks import Gain
from tsmblocks.common.errors import DataError, RunError
from tsmblocks.data import Record, from_pandas, read, split_heading
from tsmblocks.model.diagram import Diagram, Inlet
from tsmblocks.simulation.simulate import simulate

CALIB = ["t", "x_ref", "v_ref", "x_out", "tension1", "tension2", "current1", "current2"]


@pytest.fixture
def file(tmp_path):
    """Write text (or bytes) to a file and give its path."""

    def make(content, name="measured.csv"):
        path = tmp_path / name
        path.write_bytes(content if isinstance(content, bytes) else content.encode())
        return path

    return make


def refused(path, **options):
    with pytest.raises(DataError) as error:
        read(path, **options)
    text = str(error.value)
    assert str(path) in text
    return text


# ---- kinds of text files


SAME = {
    "comma": "t [s], x_in [deg]\n0, 1.5\n1, 2.5\n2, 3.5\n3, 4.5\n",
    "semicolon": "t [s];x_in [deg]\n0;1.5\n1;2.5\n2;3.5\n3;4.5\n",
    "decimal comma": "t [s];x_in [deg]\n0;1,5\n1;2,5\n2;3,5\n3;4,5\n",
    "tab": "t [s]\tx_in [deg]\n0\t1.5\n1\t2.5\n2\t3.5\n3\t4.5\n",
    "white space": "t [s]   x_in [deg]\n 0  1.5\n 1  2.5\n 2  3.5\n 3  4.5\n",
    "quotes": '"t [s]","x_in [deg]"\n"0","1.5"\n1,2.5\n2,3.5\n3,4.5\n',
    "round brackets": "t (s),x_in (deg)\n0,1.5\n1,2.5\n2,3.5\n3,4.5\n",
    "comments and blank lines": "# by hand\nt [s],x_in [deg]\n\n0,1.5\n# stuck\n1,2.5\n2,3.5\n3,4.5\n,\n\n",
    "header in a comment": "# t [s],x_in [deg]\n0,1.5\n1,2.5\n2,3.5\n3,4.5\n",
    "windows": "\ufefft [s],x_in [deg]\r\n0,1.5\r\n1,2.5\r\n2,3.5\r\n3,4.5\r\n",
    "commas at the end": "t [s],x_in [deg],\n0,1.5,\n1,2.5,\n2,3.5,\n3,4.5,\n",
    "milliseconds": "time [ms],x_in [deg]\n0,1.5\n1000,2.5\n2000,3.5\n3000,4.5\n",
}


@pytest.mark.parametrize("content", SAME.values(), ids=SAME.keys())
def test_the_same_table_however_it_is_written(file, content):
    record = read(file(content))
    assert record.names == ("x_in",)
    assert record.unit("x_in") == "deg"
    np.testing.assert_allclose(record.t, [0, 1, 2, 3], rtol=1e-15)
    np.testing.assert_array_equal(record["x_in"], [1.5, 2.5, 3.5, 4.5])


def test_decimal_commas_are_told(file):
    assert read(file(SAME["decimal comma"])).notes == ("Decimal commas were read as points.",)


def test_columns_name_a_file_without_a_header(file):
    path = file("0, 1, 7\n1, 2, 7\n2, 3, 8\n3, 4, 8\n")
    assert "the file has no header. Name its 3 columns in order" in refused(path)
    assert read(path, columns=["t", "x_in [deg]", ""]).names == ("x_in",)
    assert read(path, columns="t, x_in [deg], x_out").unit("x_in") == "deg"
    assert "the file has 3 columns, but 4 names were given (t, x, y, z)" in refused(path, columns=["t", "x", "y", "z"])
    assert read(path, columns=["t", "x"]).names == ("x",)


def test_columns_replace_a_header_and_say_so(file):
    record = read(file(SAME["comma"]), columns=["t", "angle"])
    assert record.names == ("angle",)
    assert record.notes == ("The header of the file was replaced by the columns given.",)


@settings(max_examples=25, deadline=None)
@given(st.lists(st.floats(allow_nan=False, allow_infinity=False, width=64), min_size=4, max_size=30))
@example([0.0, 0.0, 1.7976931348623155e308, -2.9937604643020797e292])  # whose difference is no number
def test_numbers_survive_a_file(tmp_path_factory, values):
    path = tmp_path_factory.mktemp("numbers") / "a.csv"
    path.write_text("t,x\n" + "".join(f"{k},{v!r}\n" for k, v in enumerate(values)))
    np.testing.assert_array_equal(read(path)["x"], values)


# ---- names and units


def test_map_and_units_say_what_the_file_does_not(file):
    path = file("time,motor angle,x_out\n0,10,1\n1,20,2\n2,30,3\n3,40,4\n")
    record = read(path, map={"x_in": "motor angle"}, units={"x_in": "deg"})
    assert record.names == ("x_in", "x_out")
    np.testing.assert_allclose(record.values("x_in", "rad"), np.radians([10, 20, 30, 40]), rtol=1e-15)
    np.testing.assert_array_equal(record.values("x_out", "rad"), [1, 2, 3, 4])  # no unit: taken as it is
    assert "column 'motor angel', which is not there. Did you mean 'motor angle'?" in refused(
        path, map={"x_in": "motor angel"}
    )
    assert "a unit is given for 'x_inn', which is not read." in refused(path, units={"x_inn": "deg"})


def test_a_missing_column_is_named_with_the_near_miss(file):
    path = file(SAME["comma"])
    text = refused(path, only=["x_on"])
    assert "there is no column 'x_on'. Did you mean 'x_in'? If it has another name there, map it" in text
    with pytest.raises(DataError, match=r"there is no signal 'x_inn'. Did you mean 'x_in'?"):
        read(path)["x_inn"]


def test_a_unit_that_does_not_convert_is_refused_when_it_is_asked_for(file):
    record = read(file(SAME["comma"]))
    with pytest.raises(DataError, match=r"signal 'x_in \[deg\]' is wanted in V"):
        record.samples("x_in", "V")


def test_two_columns_of_one_name_are_refused(file):
    assert "columns 2 and 3 are both named 'x'" in refused(file("t,x,x\n0,1,1\n1,2,2\n2,3,3\n3,4,4\n"))


def test_a_file_without_time_needs_a_step(file):
    path = file("u,y\n1,2\n2,3\n3,4\n4,5\n")
    assert "no column is named t or time. Map t to the column that holds the time (there are u, y)" in refused(path)
    np.testing.assert_allclose(read(path, step=0.25).t, [0, 0.25, 0.5, 0.75])
    assert "the step from row to row must be a positive number of seconds" in refused(path, step=-1.0)
    np.testing.assert_allclose(read(path, map={"t": "u"}).t, [1, 2, 3, 4])


@pytest.mark.parametrize(
    ("text", "parts"),
    [("x_in [deg]", ("x_in", "deg")), ("x_in", ("x_in", "")), (" x ( rad/s ) ", ("x", "rad/s")), ("", ("", ""))],
)
def test_headings_are_taken_apart(text, parts):
    assert split_heading(text) == parts


# ---- repairs


def test_repeated_times_are_merged_into_their_mean(file):
    rows = "0,1\n0.5,2\n0.5,4\n0.5,6\n1,7\n1.5,8\n1.5,9\n2,9\n"
    record = read(file("t,x\n" + rows))
    np.testing.assert_array_equal(record.t, [0, 0.5, 1, 1.5, 2])
    np.testing.assert_allclose(record["x"], [1, 4, 7, 8.5, 9])
    assert record.notes == (
        "3 rows repeated the time of the row before (rows 4, 5, 8), their values up to 4 apart (x, row 5); each group "
        "was replaced by its mean, leaving 5 of 8 samples.",
    )


def test_a_headerless_file_with_repeated_times_reads_as_it_is_published(file):
    """The layout of the tendon-sheath calibration files: eight columns, each time four or five times."""
    t = np.repeat(np.arange(0, 3, 0.025), 5)
    table = np.column_stack([t, 60 * np.sin(t), 1500 * np.cos(t), *[np.cos(k + t) for k in range(5)]])
    text = "".join(", ".join(f"{v:.6f}" for v in row) + " \n" for row in table)
    record = read(file(text, "60.txt"), columns=CALIB)
    assert record.names == tuple(CALIB[1:])
    assert len(record) == 120
    np.testing.assert_allclose(record["x_ref"], 60 * np.sin(record.t), atol=1e-6)
    assert "480 rows repeated the time" in record.notes[0]


def test_a_time_that_jumps_back_is_refused_and_can_be_cut_off(file):
    lines = ["# logger 7", "t,x", *(f"{k / 10},{k}" for k in range(20)), "0,20", "0,20"]
    path = file("\n".join(lines))
    text = refused(path)
    assert "time jumps back at row 23, from 1.9 s to 0 s" in text
    assert "rows=(3, 22), or --rows 3:22" in text
    record = read(path, rows=(3, 22))
    assert (len(record), record.t[-1]) == (20, 1.9)
    assert len(read(path, rows=(None, 22))) == 20
    assert "must be two row numbers in order" in refused(path, rows=(5, 2))


def test_short_gaps_are_interpolated_in_time(file):
    record = read(file("t,x,y\n0,1,1\n1,,2\n3,4,\n4,NaN,\n5,n/a,5\n6,7,6\n"))
    np.testing.assert_allclose(record["x"], [1, 2, 4, 5, 6, 7])
    np.testing.assert_allclose(record["y"], [1, 2, 3 + 1 / 2, 4.25, 5, 6])
    assert record.notes == (
        "x: 3 missing numbers (rows 3, 5, 6) were interpolated.",
        "y: 2 missing numbers (rows 4, 5) were interpolated.",
        "Samples are missing in one place. It lasts 2.0 usual steps, before row 4 (from 1 s to 3 s); "
        "signals are interpolated there.",
    )


@pytest.mark.parametrize(
    ("cells", "words"),
    [
        ("1,,,,,6", "column 2 (x [deg]) has no number in rows 3 to 6. At most 3 samples are interpolated"),
        (",2,3,4,5,6", "column 2 (x [deg]) has no number in row 2. At the start there is nothing to interpolate from"),
        ("1,2,3,4,5,inf", "column 2 (x [deg]) has no number in row 7. At the end there is nothing"),
        (",,,,,", "column 2 (x [deg]) has no number in rows 2 to 7. It is empty throughout"),
        ("1,2,abc,4,5,6", "row 4, column 2 (x [deg]) holds 'abc', which is not a number."),
        ("1,2,abc,4,x5,6", "holds 'abc', which is not a number (and 1 more such cell)."),
        ("1,2,1_0,4,5,6", "row 4, column 2 (x [deg]) holds '1_0', which is not a number."),
    ],
)
def test_cells_that_hold_no_number(file, cells, words):
    path = file("t,x [deg],y\n" + "".join(f"{k},{cell},{k}\n" for k, cell in enumerate(cells.split(","))))
    assert words in refused(path)
    assert read(path, only=["y"]).names == ("y",)  # the fault is in a column that is not wanted


@pytest.mark.parametrize(
    ("content", "words"),
    [
        (b"", "the file is empty."),
        (b" \n\n", "the file is empty."),
        (b"# only a remark\n", "the file holds no numbers, only comments."),
        (b"t,x\n0,1\n1,2\n2,3\n", "only 3 samples found; 4 are the least."),
        (b"t,x\n", "only 0 samples found"),
        (b"t,x\n5,1\n5,2\n5,3\n5,4\n", "column 1 (t) is 5 s in all 4 rows, so it cannot be the time."),
        (b"t,x\n0,1\n,2\n2,3\n3,4\n4,5\n", "column 1 (t) has no number in row 3 (1 such row)."),
        (b"t,x\n0,1\n1,2\n2,3,4\n3,4\n4,5\n", "row 4 has 3 cells, but there are 2 columns. Every row needs the same"),
        (
            b"t,x\n0,1\n1,2\n2,3\n3,4\n4,5\n6\n",
            "row 7 has 1 cells, but there are 2 columns. The file seems to have been cut",
        ),
        (b"t,x\n0,1\n1,\x812\n2,3\n3,4\n", "row 3 is not UTF-8 text (byte 0x81). Save the file as UTF-8."),
        (b"t,x\n0,1\n1,\xff\x01\n2,3\n", "row 3 is not UTF-8 text (byte 0xff). Save the file as UTF-8."),
        (b"\xff\xfet\0,", "this begins as UTF-16 text and continues as none. Save it as UTF-8."),
        (b"t,x\n0,1\n\x00\x00", "this is not text (zero byte in row 3)."),
        (b"PK\x03\x04rest", "this is a spreadsheet or an archive. Export the sheet as CSV."),
        (b"t [furlong],x\n0,1\n1,2\n2,3\n3,4\n", "the time is in 'furlong'. 'furlong' is not a unit known here."),
    ],
)
def test_files_that_are_no_measurement(file, content, words):
    assert words in refused(file(content))


def test_folders_and_missing_files(tmp_path, file):
    assert "is a folder; give one file." in refused(tmp_path)
    file("x", "calib60.csv")
    assert "Did you mean 'calib60.csv'?" in refused(tmp_path / "calib6.csv")


def test_constant_signals_are_told(file):
    record = read(file("t,x,y\n0,5,1\n1,5,2\n2,5,3\n3,5,4\n"))
    assert record.notes == ("x never changes (it is 5 throughout).",)


# ---- arrays: NPZ, MAT, HDF5, pandas


def test_npz_as_a_run_saves_it(tmp_path):
    diagram = Diagram(
        blocks={"k": Gain(gain=2.0)}, inputs={"u": Inlet("k.u", unit="rad")}, outputs={"u": "u", "y": "k"}
    )
    run = simulate(diagram, stop=1.0, step=0.1, inputs={"u": np.linspace(0, 1, 11)})
    record = read(run.save(tmp_path / "run.npz"))
    np.testing.assert_array_equal(record["y"], run["y"])
    assert record.unit("u") == "rad"
    again = read(run.save(tmp_path / "run.csv"))
    np.testing.assert_array_equal(again["y"], run["y"])
    assert again.unit("u") == "rad"


def test_mat_of_version_5(tmp_path):
    from scipy.io import savemat

    t = np.arange(6) / 10
    path = tmp_path / "emps.mat"
    savemat(path, {"t": t[:, None], "qg": np.sin(t)[:, None], "kp": 160.18, "other": np.ones(9), "text": "hello"})
    record = read(path)
    assert record.names == ("qg",)
    np.testing.assert_array_equal(record["qg"], np.sin(t))
    assert record.notes == ("Left out, being of another length than t (6): other (9).",)


def test_a_matrix_needs_names(tmp_path):
    from scipy.io import savemat

    path = tmp_path / "matrix.mat"
    savemat(path, {"data": np.column_stack([np.arange(5.0), np.arange(5.0) ** 2])})
    assert "'data' has 2 columns, but they have no names." in refused(path)
    np.testing.assert_array_equal(read(path, columns=["t", "x"])["x"], np.arange(5.0) ** 2)
    savemat(path, {"kp": 2.0})
    assert "no arrays of one length were found" in refused(path)


def test_mat_of_version_7_3_and_hdf5(tmp_path):
    h5py = pytest.importorskip("h5py", reason="the extra [data] brings it")
    for name in ("new.mat", "groups.h5"):
        with h5py.File(tmp_path / name, "w", userblock_size=512 if name == "new.mat" else 0) as made:
            made["run/t"], made["run/x"] = np.arange(5.0)[None, :], np.arange(5.0)[None, :] ** 2
        record = read(tmp_path / name, map={"t": "run/t", "x": "run/x"})
        np.testing.assert_array_equal(record["x"], np.arange(5.0) ** 2)


def test_without_h5py_the_way_out_is_told(tmp_path, monkeypatch):
    monkeypatch.setitem(sys.modules, "h5py", None)
    path = tmp_path / "new.mat"
    path.write_bytes(b"MATLAB 7.3 MAT-file".ljust(512) + b"\x89HDF\r\n\x1a\n")
    assert 'need h5py: pip install "tsmblocks[data]"' in refused(path)


@pytest.mark.parametrize("kind", ["npz", "npy"])
def test_a_damaged_file_of_numpy_is_refused_at_whatever_place_it_is_cut(tmp_path, kind):
    (np.savez_compressed if kind == "npz" else np.save)(tmp_path / f"a.{kind}", np.random.default_rng(0).normal(size=9))
    raw = (tmp_path / f"a.{kind}").read_bytes()
    for size in range(len(raw) - 1):
        (tmp_path / f"cut.{kind}").write_bytes(raw[:size])
        with pytest.raises(DataError, match=f"this is not a {kind.upper()} file of plain numbers"):
            read(tmp_path / f"cut.{kind}", columns="x", step=0.1)


@pytest.mark.parametrize("name", ["broken.npz", "broken.mat", "broken.h5"])
def test_damaged_binary_files(file, name):
    refused(file(b"\x01\x02\x03 this is nothing", name))


def test_pandas_frames():
    pd = pytest.importorskip("pandas", reason="the extra [data] brings it")
    frame = pd.DataFrame({"x_in [deg]": [1.0, 2.0, 3.0, 5.0]}, index=pd.Index([0, 1, 2, 3], name="t"))
    record = from_pandas(frame, name="bench")
    assert (record.name, record.unit("x_in")) == ("bench", "deg")
    np.testing.assert_array_equal(record.t, [0, 1, 2, 3])
    with pytest.raises(DataError, match="column 'who' holds"):
        from_pandas(frame.assign(who="me"))


# ---- the record


def test_a_record_is_a_value_that_drives_a_run(file):
    record = read(file(SAME["comma"]))
    assert isinstance(record, Record)
    with pytest.raises(ValueError, match="read-only"):
        record["x_in"][0] = 7.0
    diagram = Diagram(blocks={"k": Gain(gain=1.0)}, inputs={"u": Inlet("k.u", unit="rad")}, outputs={"y": "k"})
    run = simulate(diagram, step=0.5, inputs={"u": record.samples("x_in", "rad")})
    assert run.t[-1] == 3.0
    np.testing.assert_allclose(run["y"], np.radians(1.5 + run.t), rtol=1e-12)


def test_a_run_makes_a_recording():
    run = tsm.simulate(tsm.load("fig09b_feedforward"), stop=0.1)
    record = run.record("x_in", "x_out", name="bench")
    assert (record.name, record.names, record.unit("x_out")) == ("bench", ("x_in", "x_out"), "rad")
    np.testing.assert_array_equal(record["x_out"], run["x_out"])
    assert run.record().names == tuple(run.aliases)
    with pytest.raises(RunError, match=r"has no signal 'x_on'\. Did you mean 'x_in'"):
        run.record("x_on")


# ---- what spreadsheets and loggers write


def test_text_of_windows_is_read_with_a_note(file):
    rows = "".join(f"{k},{k},{k % 3}\n" for k in range(6))
    (note,) = read(file(("t [s],x [°],y [µm]\n" + rows).encode("utf-16"))).notes
    assert note == "Read as UTF-16 text."
    record = read(file(("t [s],x [°],y [µm]\n" + rows).encode("cp1252")))
    assert record.notes == ("Row 1 is not UTF-8 text: the file was read as Windows-1252, where byte 0xb0 is °.",)
    assert record.values("x", "rad")[2] == pytest.approx(np.radians(2.0))
    assert record.values("y", "m")[2] == pytest.approx(2e-6)


def test_dates_and_times_become_seconds(file):
    for begin, rows in (
        (
            "2026-03-01T10:00:59.9",
            ["2026-03-01T10:00:59.9", "2026-03-01T10:01:00", "2026-03-01T10:01:00.100", "2026-03-01T10:01:00.2"],
        ),
        (
            "2026-12-31 23:59:59.9+01:00",
            [
                "2026-12-31 23:59:59.9+01:00",
                '"2026-12-31T23:00:00Z"',
                "2027-01-01 00:00:00.1+01:00",
                "2026-12-31T23:00:00.2+00:00",
            ],
        ),
        ("10:00:59.9", ["10:00:59.9", "10:01:00.0", "10:01:00.1", "10:01:00.20"]),
    ):
        text = "".join(f"{clock},{k}\n" for k, clock in enumerate(rows))
        seconds = re.escape(begin.replace("T", " ").replace(".9", ".900000"))
        for head, how in (("Time [ms],x\n", {"map": {"t": "Time"}}), ("", {"columns": ["t", "x"]})):
            record = read(file(head + text), **how)
            assert record.t == pytest.approx([0.0, 0.1, 0.2, 0.3], abs=1e-9)
            assert re.search(rf"was read as seconds since {seconds}\.", record.notes[0])
    for row, said in (
        ("7,1", "row 4, column 1 (t [s]) holds '7', which is not a date and time as in the first row."),
        ("2026-03-01T10:00:01Z,1", "holds '2026-03-01T10:00:01Z', which is not a date and time as in the first row."),
        ("2026-03-01T10:00:75,1", "holds '2026-03-01T10:00:75', which is not a date and time as in the first row."),
    ):
        with pytest.raises(DataError, match=re.escape(said)):
            read(file(f"t,x\n2026-03-01T10:00:00,0\n2026-03-01T10:00:00.5,0\n{row}\n2026-03-01T10:00:09,0\n"))
    with pytest.raises(DataError, match="time jumps back at row 4"):  # no night is that short
        read(file("t,x\n20:59:58,0\n20:59:59,0\n00:00:00,0\n00:00:01,0\n"))


def test_times_of_day_go_on_over_midnight(file):
    rows = ["23:59:59,98", "23:59:59,99", "00:00:00,00", "", "00:00:00,02", "00:00:00,03"]
    record = read(file("t;x\n" + "".join(f"{clock};{k}\n" for k, clock in enumerate(rows) if clock)))
    assert record.t == pytest.approx([0.0, 0.01, 0.02, 0.04, 0.05], abs=1e-9)


def test_dates_with_points_and_a_column_of_any_name(file):
    rows = "".join(f"22.11.2026 14:03:0{k // 2},{5 * (k % 2)}00;{k},5;\n" for k in range(6))
    record = read(file("Zeit;Weg [mm];Bemerkung\n" + rows))
    assert record.t == pytest.approx([0.0, 0.5, 1.0, 1.5, 2.0, 2.5])
    assert (record.names, record["Weg"][-1]) == (("Weg",), 5.5)
    assert record.notes == (
        "Decimal commas were read as points.",
        "Zeit was read as seconds since 2026-11-22 14:03:00.",
        "Column 3 (Bemerkung) holds no number and was left out.",
    )


@pytest.mark.parametrize(
    ("cell", "said"),
    [
        (
            "11/22/2026 02:03:07",
            "holds '11/22/2026 02:03:07', which is not a number (and 4 more such cells). Dates and "
            "times are read as 2026-11-22 14:03:07.5, 22.11.2026 14:03:07.5 or 14:03:07.5.",
        ),
        (
            "noon",
            "holds 'noon', which is not a number (and 4 more such cells). To leave that column out, name the "
            "others: only=['t', 'x'].",
        ),
    ],
)
def test_text_in_a_column_is_told_with_what_would_be_read(file, cell, said):
    with pytest.raises(DataError, match=re.escape(said)):
        read(file("t,x,when\n" + "".join(f"{k},1,{cell}\n" for k in range(5))), only=["x", "when"])


def test_a_unit_that_is_not_the_files_is_taken_with_a_note(file):
    text = file("t,Weg [mm],Winkel [°]\n" + "".join(f"{k},{k},{k}\n" for k in range(5)))
    record = read(text, map={"x [cm]": "Weg", "phi [deg]": "Winkel"})
    assert (record.unit("x"), record.unit("phi")) == ("cm", "deg")
    assert record.notes == ("x was read in cm, as requested; the file gives mm.",)


def test_rows_that_are_not_there_are_told(file):
    path = file("t,x\n0,1\n1,2\n2,3\n3,4\n")
    for rows, said in (
        ((9, None), "from row 9 to the end"),
        ((None, 1), "from row 1 to 1"),
        ((7, 8), "from row 7 to 8"),
    ):
        with pytest.raises(DataError, match=re.escape(f"there are no samples {said}; they are in rows 2 to 5.")):
            read(path, rows=rows)


def test_the_newest_row_may_come_first(file):
    record = read(file("t,x\n4,1\n3,2\n3,4\n2,5\n1,6\n0,7\n"))
    assert record.t.tolist() == [0, 1, 2, 3, 4]
    assert record["x"].tolist() == [7, 6, 5, 3, 1]
    assert record.notes[0] == "The time falls from row to row, the newest row coming first; the rows were reversed."


def test_seconds_that_may_be_milliseconds_are_doubted(file):
    rows = "".join(f"{2 * k},{k}\n" for k in range(60))
    (note,) = read(file("t,x\n" + rows)).notes
    assert note == (
        "t has no unit and was taken to be in s, which makes 2 s from row to row. If it is in ms, give the unit: "
        "map={'t [ms]': 't'}, or --map 't [ms]=t'."
    )
    for head, named in (("Time,x\n", None), ("clock,x\n", {"t": "clock"})):
        column = head.partition(",")[0]
        (note,) = read(file(head + rows), map=named).notes
        assert note.startswith(f"{column} has no unit ")
        assert note.endswith(f"map={{'t [ms]': '{column}'}}, or --map 't [ms]={column}'.")
        followed = read(file(head + rows), map={"t [ms]": column})
        assert (followed.notes, followed.t[1]) == ((), 2e-3)
    for record in (read(file("t [ms],x\n" + rows)), read(file("t,x\n" + rows), units={"t": "ms"})):
        assert record.notes == ()
        assert record.t[1] == 2e-3
    assert read(file("t [s],x\n" + rows)).notes == ()


def test_a_time_that_is_not_read_is_told(file):
    record = read(file("t [s],x\n0,1\n1,2\n2,3\n3,4\n"), step=0.5, only="x")
    assert record.t.tolist() == [0, 0.5, 1.0, 1.5]
    assert record.notes == ("The column t [s] was not read: the rows follow each other at 0.5 s, as requested.",)


def test_a_signal_of_another_length_is_named(tmp_path):
    np.savez(tmp_path / "a.npz", t=np.arange(6.0), x=np.arange(5.0), y=np.arange(6.0))
    with pytest.raises(DataError) as found:
        read(tmp_path / "a.npz", only="x")
    assert str(found.value).endswith(
        "there is no column 'x'. Known here: y. If it has another name there, map it: map={'x [deg]': 'COLUMN'}, or "
        "--map 'x [deg]=COLUMN'. Left out, being of another length than t (6): x (5)."
    )


def test_the_matrix_of_an_npy_file(tmp_path):
    values = np.column_stack([np.arange(6.0), np.arange(6.0) ** 2])
    np.save(tmp_path / "a.npy", values)
    np.save(tmp_path / "b.npy", np.array([{}, {}]))
    record = read(tmp_path / "a.npy", columns="t, x [deg]")
    assert (record["x"].tolist(), record.unit("x")) == (values[:, 1].tolist(), "deg")
    with pytest.raises(DataError, match="'a' has 2 columns, but they have no names"):
        read(tmp_path / "a.npy")
    with pytest.raises(DataError, match="this is not a NPY file of plain numbers"):
        read(tmp_path / "b.npy", columns="t, x")


@pytest.mark.parametrize(
    ("name", "hint"),
    [
        ("noise_floor", " The noise of a signal is tsm.noise(record, 'NAME').floor."),
        ("fitt", " A diagram is fitted by tsm.fit(diagram, record)."),
        ("x", " A signal is found by its name: record['x']."),
        ("plott", " Did you mean 'plot'?"),
    ],
)
def test_what_is_no_attribute_of_a_record_is_found_elsewhere(name, hint):
    record = tsm.Record("run", [0.0, 0.1, 0.2], {"x": [1.0, 2.0, 3.0]}, {})
    with pytest.raises(AttributeError) as caught:
        getattr(record, name)
    assert str(caught.value) == f"a record has no '{name}'.{hint}"
    assert not hasattr(record, "__array__")
    assert pickle.loads(pickle.dumps(record)).names == ("x",)
