"""Recordings in JSON, Excel, Parquet and MDF files, each the same as the CSV file of the same numbers."""

import datetime
import decimal
import json
import sys

import numpy as np
import pytest

import tsmblocks as tsm
from tsmblocks.common.errors import DataError

T = 0.01 * np.arange(300)
X = np.sin(3 * T)
Y = np.round(2 * X, 2)


def same(record, *, x_unit="deg", notes=0):
    """Whether a record has the numbers above."""
    np.testing.assert_allclose(record.t, T, atol=1e-12)
    np.testing.assert_allclose(record["x"], X, rtol=1e-12)
    np.testing.assert_allclose(record["y"], Y, rtol=1e-12)
    assert record.unit("x") == x_unit
    return len(record.notes) == notes


LISTS = {"t": T.tolist(), "x [deg]": X.tolist(), "y": Y.tolist()}
ROWS = [dict(zip(LISTS, row, strict=True)) for row in zip(*LISTS.values(), strict=True)]


@pytest.mark.parametrize(
    "content",
    [
        LISTS,
        ROWS,
        {"name": "bench", "rows": ROWS},
        {"columns": list(LISTS), "index": [], "data": [list(row.values()) for row in ROWS]},
        {"units": {"x": "deg"}, "t": LISTS["t"], "x": LISTS["x [deg]"], "y": LISTS["y"], "mode": ["a"] * 300},
    ],
    ids=["lists", "rows", "rows inside", "split", "units"],
)
def test_json(tmp_path, content):
    path = tmp_path / "run.json"
    path.write_text(json.dumps(content))
    assert same(tsm.read(path), notes=int("mode" in content))


def test_json_lines_groups_and_missing_numbers(tmp_path):
    path = tmp_path / "run.jsonl"
    path.write_text("\n".join(json.dumps(row) for row in ROWS))
    assert same(tsm.read(path))
    holes = [None if k == 7 else v for k, v in enumerate(LISTS["y"])]
    path = tmp_path / "run.json"
    path.write_text(json.dumps({"bench": {"t": LISTS["t"], "x": LISTS["x [deg]"], "y": holes}}))
    record = tsm.read(path, group="bench")
    assert np.flatnonzero(record.filled["y"]).tolist() == [7]
    assert tsm.read(path, only=["x"], map={"t": "bench/t", "x": "bench/x"}).names == ("x",)
    with pytest.raises(DataError, match=r"there is no group 'bensch'\. Did you mean 'bench'"):
        tsm.read(path, group="bensch")


@pytest.mark.parametrize("text", ["{", "3", '"x"', "[1, 2]", "{}", '{"t": "x"}', "[" * 100_000])
def test_json_that_holds_no_recording_is_refused(tmp_path, text):
    path = tmp_path / "run.json"
    path.write_text(text)
    with pytest.raises(DataError, match=r"run\.json"):
        tsm.read(path)


def test_excel(tmp_path):
    openpyxl = pytest.importorskip("openpyxl")
    book = openpyxl.Workbook()
    sheet = book.active
    sheet.title = "run 1"
    sheet.append(["t", "x", "y", "mode"])
    sheet.append(["s", "deg", None, None])
    for row in zip(*LISTS.values(), strict=True):
        sheet.append([*row, "idle"])
    dated = book.create_sheet("dated")
    dated.append(["when", "x [deg]", "y"])
    begin = datetime.datetime(2026, 11, 22, 14, 0)
    for t, *rest in zip(*LISTS.values(), strict=True):
        dated.append([begin + datetime.timedelta(seconds=100 * t), *rest])
    path = tmp_path / "run.xlsx"
    book.save(path)
    record = tsm.read(path)
    same(record)
    assert any("mode holds text and no number, and was left out." in note for note in record.notes)
    assert any("sheet 'run 1'; there are also dated" in note for note in record.notes)
    np.testing.assert_allclose(tsm.read(path, group="dated").t, 100 * T, atol=1e-6)
    with pytest.raises(DataError, match=r"there is no sheet 'datet'\. Did you mean 'dated'"):
        tsm.read(path, group="datet")
    (tmp_path / "bad.xlsx").write_bytes(b"PK\x03\x04 no")
    with pytest.raises(DataError, match="not an XLSX file"):
        tsm.read(tmp_path / "bad.xlsx")


def test_parquet(tmp_path):
    pyarrow = pytest.importorskip("pyarrow")
    from pyarrow import parquet

    fields = [pyarrow.field("t", "double"), pyarrow.field("x", "double", metadata={"unit": "deg"})]
    schema = pyarrow.schema([*fields, pyarrow.field("y", "double"), pyarrow.field("mode", "string")])
    columns = {"t": T, "x": X, "y": Y, "mode": ["idle"] * len(T)}
    parquet.write_table(pyarrow.table(columns, schema=schema), tmp_path / "run.parquet")
    assert same(tsm.read(tmp_path / "run.parquet"), notes=1)
    assert tsm.read(tmp_path / "run.parquet").notes == ("Left out, being no numbers: mode.",)
    (tmp_path / "bad.parquet").write_bytes(b"PAR1")
    with pytest.raises(DataError, match="not a Parquet file"):
        tsm.read(tmp_path / "bad.parquet")


def test_parquet_with_instants_durations_and_decimals(tmp_path):
    pyarrow = pytest.importorskip("pyarrow")
    from pyarrow import parquet

    path, count = tmp_path / "run.parquet", 12
    year = 365 * 86_400
    far = pyarrow.array([(1_000 * k - 1_970) * year for k in range(count)], pyarrow.timestamp("s"))  # 11,000 years
    lasting = pyarrow.array([datetime.timedelta(milliseconds=5 * k) for k in range(count)])
    exact = pyarrow.array([decimal.Decimal(k) / 8 for k in range(count)], pyarrow.decimal128(9, 3))
    never = pyarrow.array([None] * count, pyarrow.timestamp("ns"))
    columns = {"t": far, "d": lasting, "x": exact, "never": never}
    parquet.write_table(pyarrow.table(columns), path)
    record = tsm.read(path, only=["d", "x"])
    np.testing.assert_array_equal(record.t, 1_000.0 * year * np.arange(count))
    np.testing.assert_allclose(record["d"], 5e-3 * np.arange(count))
    np.testing.assert_array_equal(record["x"], np.arange(count) / 8)
    assert (record.unit("d"), record.unit("x")) == ("s", "")
    with pytest.raises(DataError, match=r"column 4 \(never \[s\]\) has no number in rows 1 to 12"):
        tsm.read(path)
    late = pyarrow.array([None, *range(count - 1)], pyarrow.timestamp("ms"))
    parquet.write_table(pyarrow.table({"t": pyarrow.array(range(count)), "late": late}), path)
    with pytest.raises(DataError, match=r"column 2 \(late \[s\]\) has no number in row 1\."):
        tsm.read(path)


def test_excel_with_durations_truth_values_and_a_chart(tmp_path):
    openpyxl = pytest.importorskip("openpyxl")
    book, path = openpyxl.Workbook(), tmp_path / "run.xlsx"
    book.active.append(["t", "on"])
    for k in range(30):
        book.active.append([datetime.timedelta(hours=23, seconds=k * 120.5), k % 2 == 0])
    book.save(path)
    record = tsm.read(path)
    np.testing.assert_allclose(record.t, 23 * 3600 + 120.5 * np.arange(30), atol=1e-3)
    np.testing.assert_array_equal(record["on"], 1.0 - np.arange(30) % 2)


def test_mdf_with_channels_of_two_rates(tmp_path):
    asammdf = pytest.importorskip("asammdf")
    file, slow = asammdf.MDF(version="4.10"), T[::5]
    signal = asammdf.Signal
    fast = [signal(X, T, name="x", unit="deg"), signal(Y, T, name="y")]
    file.append(fast, comment="fast")
    file.append([signal(np.cos(slow), slow, name="z"), signal(np.sign(slow - 1), slow, name="s")])
    file.save(tmp_path / "run.mf4")
    file.close()
    record = tsm.read(tmp_path / "run.mf4", only=["x", "y"])
    same(record)
    record = tsm.read(tmp_path / "run.mf4", rows=(1, 290))
    np.testing.assert_allclose(record["z"], np.cos(record.t), atol=1e-4)
    assert set(np.unique(record["s"])) <= {-1.0, 0.0, 1.0}
    assert any("Interpolated at the times of the group with most samples: z, s." in note for note in record.notes)
    assert len(tsm.read(tmp_path / "run.mf4", group="1")) == len(slow)
    (tmp_path / "bad.mf4").write_bytes(b"mdf     4.10")
    with pytest.raises(DataError, match="not an MDF file"):
        tsm.read(tmp_path / "bad.mf4")


@pytest.mark.parametrize(
    ("name", "package", "extra"),
    [("run.xlsx", "openpyxl", "excel"), ("run.parquet", "pyarrow", "parquet"), ("run.mf4", "asammdf", "mdf")],
)
def test_a_missing_package_is_named_with_its_extra(tmp_path, monkeypatch, name, package, extra):
    monkeypatch.setitem(sys.modules, package, None)
    (tmp_path / name).write_bytes(b"")
    with pytest.raises(DataError, match=rf'need {package}: pip install "tsmblocks\[{extra}\]"'):
        tsm.read(tmp_path / name)


@pytest.mark.parametrize("ending", ["xls", "ods", "tdms", "pkl"])
def test_formats_that_are_not_read_are_refused_by_name(tmp_path, ending):
    (tmp_path / f"run.{ending}").write_bytes(b"\0")
    with pytest.raises(DataError, match=r"which is not read\. Save it as CSV"):
        tsm.read(tmp_path / f"run.{ending}")


# ---- columns that nobody asked for, and fewer samples


def test_fewer_names_leave_the_other_columns_out(tmp_path):
    path = tmp_path / "run.csv"
    path.write_text("\n".join(f"{t},{x},{x},7" for t, x in zip(T, X, strict=True)))
    assert tsm.read(path, columns="t, x [deg]").names == ("x",)
    with pytest.raises(DataError, match="the file has 4 columns, but 5 names were given"):
        tsm.read(path, columns="t,a,b,c,d")


def test_columns_that_nobody_asked_for_are_no_fault(tmp_path):
    path = tmp_path / "run.csv"
    head = "t [s],x (cmd),x (meas),state,y [in],state,w [furlong]\n"
    path.write_text(head + "\n".join(f"{t},{x},{x},on,{x},off,{x}" for t, x in zip(T, X, strict=True)))
    record = tsm.read(path, only=["x (cmd)", "y"])
    assert record.names == ("x (cmd)", "y")
    np.testing.assert_allclose(record.values("y", "mm"), 25.4 * X)
    with pytest.raises(DataError, match="columns 4 and 6 are both named 'state'"):
        tsm.read(path, only=["state"])
    path.write_text(head.replace("state", "a", 1) + "\n".join(f"{t},1,2,on,3,off,4" for t in T))
    record = tsm.read(path)
    assert record.names == ("x (cmd)", "x (meas)", "y", "w")
    assert record.notes[-1] == "state holds text and no number, and was left out."
    with pytest.raises(DataError, match="which is not a number"):
        tsm.read(path, only=["state"])


def test_fewer_samples_without_what_would_come_back_slow(tmp_path, capsys):
    from tsmblocks.cli import main

    hum = 0.3 * np.sin(2 * np.pi * 48 * T)
    record = tsm.Record("run", T, {"x_in": X, "x_out": X + hum}, {"x_in": "rad", "x_out": "rad"})
    thin = record.decimated(5)
    np.testing.assert_allclose(thin.t, T[::5])
    np.testing.assert_allclose(thin["x_out"][4:-4], X[::5][4:-4], atol=0.02)
    assert record.decimated(1) is record
    for wrong in (0, 1.5, True, -3):
        with pytest.raises(DataError, match="decimated takes a whole number of at least 1"):
            record.decimated(wrong)
    path = record.save(tmp_path / "run.csv")
    for option in (["--decimate", "5"], ["--resample", "0.05"]):
        assert main(["fit", "tendon_sheath_linear", "--data", str(path), *option, "--starts", "1", "--json"]) == 0
        said = json.loads(capsys.readouterr().out)
        assert said["data"][0]["samples"] == 60
    assert main(["fit", "tendon_sheath_linear", "--data", str(path), "--decimate", "0"]) == 2
