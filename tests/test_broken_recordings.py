"""Recordings that are damaged, lie about their size or lead elsewhere: one message each, in time and within memory."""

import io
import json
import struct
import time
import zipfile
import zlib

import numpy as np
import pytest
from scipy.io import savemat

from tsmblocks.common import memory
from tsmblocks.common.errors import DataError
from tsmblocks.data import formats, read, text
from tsmblocks.data.record import Record
from tsmblocks.data.structures import MAX_NESTING

T = np.arange(20) / 10
QUICK = 5.0
"""Seconds. Each refusal is a matter of milliseconds; this only tells it from what hung for a minute."""


def refusal(path, **options):
    began = time.process_time()
    with pytest.raises(DataError) as caught:
        read(path, **options)
    assert time.process_time() - began < QUICK
    text = str(caught.value).replace(str(path), path.name)
    assert len(text) < 500
    return text


@pytest.fixture
def file(tmp_path):
    def make(name, content):
        path = tmp_path / name
        path.write_bytes(content if isinstance(content, bytes) else content.encode())
        return path

    return make


# ---- text


def test_a_cell_longer_than_the_reader_of_csv_takes(file):
    path = file("a.csv", 't,x\n0,1\n1,"' + "a" * 140_000 + '"\n2,3\n')
    assert refusal(path).startswith("a.csv: row 3, column 2 (x) holds '\"aaa")


def test_a_line_without_end_is_refused_at_once(file):
    path = file("a.csv", "t,x\n0,1\n1," + "1 " * 10_000_000 + "\n2,3\n")
    assert refusal(path) == "a.csv: row 3 has 20,000,001 characters; at most 1,000,000 are read."


def test_the_longest_line_that_is_read(file, monkeypatch):
    monkeypatch.setattr(text, "MAX_LINE", 9)
    assert read(file("a.csv", "t,x\n0,1\n1,2\n2,3\n3,4.56789\n")).names == ("x",)
    assert refusal(file("a.csv", "t,x\n0,1\n1,2\n2,3\n3,4.567890\n")) == (
        "a.csv: row 5 has 10 characters; at most 9 are read."
    )


def test_many_thousand_columns_are_refused(file):
    path = file("a.csv", "t" + ",x" * 200_000 + "\n" + "0" + ",1" * 200_000 + "\n")
    assert refusal(path) == "a.csv: row 1 has 200,001 cells; at most 10,000 columns are read."


def test_as_many_columns_as_are_read_take_seconds_at_most(file):
    names = ["t", *(f"x{k}" for k in range(9_999))]
    rows = [",".join([str(k), *["1"] * 9_999]) for k in range(4)]
    began = time.process_time()
    record = read(file("a.csv", "\n".join([",".join(names), *rows])), only=["x7"])
    assert list(record.names) == ["x7"]
    assert time.process_time() - began < QUICK


# ---- JSON

TWICE = "there are 2 columns named 'x'; give them different names."


@pytest.mark.parametrize(
    ("content", "text"),
    [
        ('{"columns": ["t", "x"], "data": [[0, 1], [1]]}', "a.json: row 2 of 'data' must list 2 values, not [1]."),
        ('{"columns": ["t", "x"], "data": [[0, 1], 3]}', "a.json: row 2 of 'data' must list 2 values, not 3."),
        ("[" * 900 + "]" * 900, "a.json: the JSON must hold lists of numbers by name, or rows as objects, not [[[["),
        ('{"a":' * 100_000, "a.json: this is not JSON that can be read"),
        ('{"t": [0, 1], "x": [0, 1], "x": [2, 3]}', f"a.json: {TWICE}"),
        ('{"t": 0, "x": 1}\n{"t": 1, "x": 2, "x": 3}', f"a.json: {TWICE}"),
        ('{"columns": ["t", "x", "x"], "data": [[0, 1, 2]]}', f"a.json: {TWICE}"),
        ('{"t": [0, 1], "units": {"x": 3}}', "a.json: the unit of 'x' must be text, not 3."),
        ('{"t": [0, 1], "units": {"x": ["rad"]}}', "a.json: the unit of 'x' must be text, not ['rad']."),
    ],
)
def test_json_that_is_no_recording(content, text, file):
    assert refusal(file("a.json", content)).startswith(text)


def test_lists_nested_deeper_than_is_read_are_left_out(file):
    deep = '{"a": ' * (MAX_NESTING + 2) + "[1, 2, 3]" + "}" * (MAX_NESTING + 2)
    found = read(file("a.json", f'{{"t": {list(range(9))}, "x": {list(range(9))}, "more": {deep}}}'))
    assert found.names == ("x",)


def test_rows_that_each_have_another_name_cost_no_table_of_all_of_them(file, monkeypatch):
    rows = [{"t": k, f"x{k}": k} for k in range(9_999)]
    monkeypatch.setattr(memory, "SMALL", 0)
    monkeypatch.setattr(memory, "free_memory", lambda: 2e8)
    began = time.process_time()
    said = refusal(file("a.json", json.dumps(rows)))
    assert said == "a.json: reading it would take 2.4 GB of memory, and 200 MB are free."
    rows += [{"x": 0}, {"y": 0}]
    said = refusal(file("a.json", json.dumps(rows)))
    assert said == "a.json: the rows have 10,002 names; at most 10,000 columns are read."
    assert time.process_time() - began < QUICK


def test_rows_without_one_of_the_names_have_no_number_there(file):
    rows = [{"t": k, **({"x": k * k} if k != 7 else {}), "mode": "a"} for k in range(20)]
    record = read(file("a.json", json.dumps(rows)))
    assert np.flatnonzero(record.filled["x"]).tolist() == [7]
    assert record.names == ("x",)
    assert "Left out, being no numbers: mode." in record.notes


def test_rows_of_events_beside_signals_and_columns_of_no_numbers_are_left_out_and_named(file):
    content = {"t": [*range(9)], "x": [*range(9)], "events": [{"at": 3}], "y": [1, "a"] * 4, "units": {"x": None}}
    record = read(file("a.json", json.dumps(content)))
    assert (record.names, record.unit("x")) == (("x",), "")
    assert "Left out, being no numbers: events, y." in record.notes


def test_halves_of_characters_are_replaced(file):
    times = [*range(9)]
    record = read(file("a.json", f'{{"t": {times}, "\\ud800x": {times}, "units": {{"\\ud800x": "\\udfff"}}}}'))
    assert (record.names, record.unit("?x")) == (("?x",), "?")


def test_json_of_lines_of_which_one_is_cut_off(file):
    said = refusal(file("a.json", '{"t": 0, "x": 1}\n{"t": 1, "x"'))
    assert said == "a.json: this is not JSON that can be read (Extra data: line 2 column 1 (char 17))."


@pytest.mark.parametrize("number", ["9" * 5000, "1" + "0" * 400, "1e400", "-" + "9" * 5000])
def test_numbers_that_no_float_holds_are_missing_numbers(number, file):
    times, values = [*range(20)], [*range(20)]
    content = f'{{"t": {times}, "x": {values}}}'.replace("7, 8, 9", f"7, {number}, 9").replace(number, "8", 1)
    record = read(file("a.json", content))
    assert record.signals["x"][8] == 8.0  # interpolated
    assert "x" in record.notes[0]


# ---- what is no file


@pytest.mark.parametrize("given", [3, None, b"a.csv", [1, 2]])
def test_what_is_no_path_is_answered_with_what_takes_it(given):
    with pytest.raises(DataError) as caught:
        read(given)
    assert str(caught.value) == (
        f"read takes the path of a file, got {given!r}. tsm.from_pandas makes a recording from a frame, "
        "tsm.Record(name, t, signals, units) from arrays."
    )


@pytest.mark.parametrize(
    ("arguments", "said"),
    [
        ((["a", "b"], {}, {}), "a recording holds times and signals as numbers, got ['a', 'b']."),
        (([0, 1], {"x": [1, 10**400]}, {}), f"a recording holds times and signals as numbers, got [1, 1{'0' * 54}…."),
        (([0, 1], [1, 2], {}), "signals of a recording are a mapping by signal, got [1, 2]."),
        (([0, 1], {"x": [1, 2]}, "rad"), "units of a recording are a mapping by signal, got 'rad'."),
    ],
)
def test_what_is_no_recording(arguments, said):
    with pytest.raises(DataError) as caught:
        Record("a", *arguments)
    assert str(caught.value) == said


# ---- NumPy


def npz(arrays, edit=lambda b: b):
    buffer = io.BytesIO()
    np.savez_compressed(buffer, **arrays)
    return edit(buffer.getvalue())


def zeros_of(size):
    """The stream of an array of zeros, its header true."""
    header = io.BytesIO()
    np.lib.format.write_array_header_1_0(header, {"descr": "<f8", "fortran_order": False, "shape": (size // 8,)})
    return header.getvalue()


def test_every_cut_and_every_changed_byte_of_an_archive(file):
    whole = npz({"t": T, "x": np.sin(T)})
    for k in range(0, len(whole), 7):
        for content in (whole[:k], whole[:k] + bytes([whole[k] ^ 0xFF]) + whole[k + 1 :]):
            try:
                read(file("a.npz", content))
            except DataError:
                continue


@pytest.mark.parametrize(
    "header",
    [
        "{'descr': '<f8', 'fortran_order': False, 'shape': (",
        "{'descr': '<q9', 'fortran_order': False, 'shape': (3,), }",
        "{'descr': '<f8', 'fortran_order': False, 'shape': (99999999999999999999,), }",
        "{'descr': '<f8', 'fortran_order': False, 'shape': (1000000000000,), }",
        "{'descr': '|O', 'fortran_order': False, 'shape': (3,), }",
    ],
)
@pytest.mark.filterwarnings("ignore")
def test_a_broken_header_of_an_array(header, file):
    text = header.encode().ljust(117) + b"\n"
    content = b"\x93NUMPY\x01\x00" + struct.pack("<H", len(text)) + text + bytes(64)
    assert refusal(file("a.npy", content)).startswith("a.npy: this is not a NPY file of plain numbers")


def bomb(tmp_path, size=100_000_000):
    """An archive of 0.1 MB with an array of 100 MB."""
    path = tmp_path / "a.npz"
    with (
        zipfile.ZipFile(path, "w", zipfile.ZIP_DEFLATED) as archive,
        archive.open("t.npy", "w", force_zip64=True) as part,
    ):
        part.write(zeros_of(size))
        for _ in range(size // 4_000_000):
            part.write(bytes(4_000_000))
    return path


def test_an_archive_is_measured_before_it_is_unpacked(tmp_path, monkeypatch):
    path = bomb(tmp_path)
    assert path.stat().st_size < 1_000_000
    monkeypatch.setattr(memory, "free_memory", lambda: 2e8)
    assert refusal(path) == "a.npz: reading it would take 300 MB of memory, and 200 MB are free."


# ---- MAT 5


def mat5(variable, compressed=False):
    if compressed:
        body = zlib.compress(variable)
        variable = struct.pack("<II", 15, len(body)) + body
    return b"MATLAB 5.0 MAT-file".ljust(116) + bytes(8) + b"\x00\x01IM" + variable


def element(kind, body):
    return struct.pack("<II", kind, len(body)) + body + bytes(-len(body) % 8)


def matrix(of_class, *parts, size=(2, 1)):
    flags, shape = struct.pack("<II", of_class, 0), struct.pack(f"<{len(size)}i", *size)
    return element(14, element(6, flags) + element(5, shape) + element(1, b"x") + b"".join(parts))


def opaque(*parts):
    return element(14, element(6, struct.pack("<II", 17, 0)) + element(1, b"x") + b"".join(parts))


TWO = element(9, struct.pack("<2d", 1.0, 2.0))
LENGTH = struct.pack("<HHi", 5, 4, 8)
BROKEN = {
    "a type that there is not": (matrix(6, element(197, bytes(16))), "type 197"),
    "a short element of a type that there is not": (matrix(6, struct.pack("<HHI", 197, 1, 0)), "type 197"),
    "fewer numbers than announced": (matrix(6, TWO, size=(2, 3)), "an array of 6 numbers has 2"),
    "no class": (matrix(99, TWO), "there is no class 99 of arrays"),
    "a size below nought": (matrix(6, TWO, size=(2, -1)), "has the size (2, -1)"),
    "a billion cells": (matrix(1, size=(1 << 30, 1)), "1073741824 arrays are announced in"),
    "fields of no length": (
        matrix(2, struct.pack("<HHi", 5, 4, 0), element(1, b"a")),
        "the names of fields do not fit their length",
    ),
    "fields of half a length": (matrix(2, LENGTH, element(1, b"abc")), "the names of fields do not fit their length"),
    "numbers for an array": (matrix(1, TWO, TWO), "type 9 is found where an array is expected"),
    "an element beyond the end": (struct.pack("<II", 14, 1 << 30) + bytes(64), "is cut off"),
    "sparse places beyond the size": (
        matrix(5, element(5, struct.pack("<2i", 0, 1 << 30)), element(5, struct.pack("<2i", 0, 2)), TWO),
        "the places of a sparse array do not fit its size",
    ),
    "nested without end": (None, "too deep"),
    "no array": (element(9, bytes(16)), "a variable begins with an element of type 9"),
    "a short element of more than four bytes": (matrix(6, struct.pack("<HHI", 9, 8, 0)), "longer than four bytes"),
    "a cell that ends within an element": (matrix(1, bytes(4), size=(1, 1)), "ends within an element"),
    "flags of another size": (element(14, element(6, bytes(4))), "flags of an array have another size"),
    "a text longer than its size": (matrix(4, element(16, b"abc"), size=(1, 2)), "a text is longer than its size"),
    "an object of other names": (
        matrix(3, element(9, bytes(8))),
        "type 9 and 8 bytes is found where data are expected",
    ),
    "a class of its own with half its names": (
        opaque(element(1, b"MCOS"), TWO),
        "type 9 and 16 bytes is found where data",
    ),
}


@pytest.mark.parametrize("compressed", [False, True], ids=["plain", "compressed"])
@pytest.mark.parametrize("case", BROKEN)
def test_a_mat_file_that_scipy_would_follow_into_a_crash(case, compressed, file):
    """Several of these end the process in SciPy's reader, so what is seen here is a refusal before it."""
    variable, text = BROKEN[case]
    if variable is None:
        variable = matrix(6, TWO)
        for _ in range(100):
            variable = matrix(1, variable, size=(1, 1))
    said = refusal(file("a.mat", mat5(variable, compressed)))
    assert said.startswith("a.mat: this is not a MAT file that can be read (")
    assert text in said


def test_a_mat_file_without_its_byte_order(file):
    content = mat5(matrix(6, TWO)).replace(b"\x00\x01IM", b"\x00\x01IX")
    said = "a.mat: this is not a MAT file that can be read (its byte order is not given)."
    assert refusal(file("a.mat", content)) == said


NAMES = (b"a", b"b", b"c", b"t", b"y")


def test_objects_beside_signals_are_left_out_and_empty_cells_are_whole(file):
    objects = [
        opaque(element(1, b"MCOS"), element(1, b"timeseries"), matrix(6, TWO)),
        matrix(3, element(1, b"kind"), LENGTH, element(1, b"one".ljust(8, b"\0")), matrix(6, TWO), size=(1, 1)),
        matrix(1, element(14, b""), size=(1, 1)),
    ]
    signals = [matrix(6, element(9, np.arange(9.0).tobytes()), size=(9, 1))] * 2
    variables = [v.replace(element(1, b"x"), element(1, n), 1) for n, v in zip(NAMES, objects + signals, strict=True)]
    found = read(file("a.mat", mat5(b"".join(variables))))
    assert found.names == ("y",)
    assert found.values("y") == pytest.approx(np.arange(9.0))
    assert "it holds objects of MATLAB" in refusal(file("b.mat", mat5(objects[0])))


def test_mat_files_of_scipy_are_whole(tmp_path):
    from scipy.sparse import csc_matrix

    kinds = {
        "t": T, "x": np.sin(T), "z": T + 1j, "text": "words", "texts": np.array(["a", "bb"], dtype=object),
        "s": {"a": T, "b": {"c": "d"}}, "sparse": csc_matrix(np.eye(5)), "bits": T > 1, "small": np.int8([1, 2]),
        "none": np.empty((0, 0)),
    }  # fmt: skip
    for compressed in (False, True):
        savemat(tmp_path / "a.mat", kinds, do_compression=compressed)
        assert set(read(tmp_path / "a.mat").names) >= {"x"}


def test_a_mat_file_of_text_alone(tmp_path):
    savemat(tmp_path / "a.mat", {"note": "no signals"})
    assert refusal(tmp_path / "a.mat") == (
        "a.mat: no arrays of one length were found that could be signals. Numeric arrays: none."
    )


def test_a_mat_file_larger_than_the_memory(tmp_path, monkeypatch):
    savemat(tmp_path / "a.mat", {"t": T, "x": T}, do_compression=True)
    monkeypatch.setattr(memory, "SMALL", 0)
    monkeypatch.setattr(memory, "free_memory", lambda: 100.0)
    assert refusal(tmp_path / "a.mat").startswith("a.mat: a variable, unpacked, would take")


def test_fewer_names_than_a_matrix_has_columns_leave_the_others_out(tmp_path):
    np.save(tmp_path / "a.npy", np.column_stack([T, T**2, T**3]))
    assert read(tmp_path / "a.npy", columns="t, x [deg]").names == ("x",)


def test_a_variable_is_measured_while_it_is_unpacked(file, monkeypatch):
    monkeypatch.setattr(memory, "free_memory", lambda: 5e7)
    path = file("a.mat", mat5(element(14, bytes(60_000_000)), compressed=True))
    assert "a variable, unpacked, would take" in refusal(path)


# ---- Excel and Parquet


def test_a_cell_far_off_does_not_make_a_sheet_endless(tmp_path):
    openpyxl = pytest.importorskip("openpyxl")
    book, path = openpyxl.Workbook(), tmp_path / "a.xlsx"
    for row in [("t", "x"), *((k, k * k) for k in range(10))]:
        book.active.append(row)
    book.active.cell(1_048_576, 16_384).value = 3
    book.save(path)
    with pytest.raises(DataError, match="the sheet 'Sheet' covers more than 50,000,000 cells"):
        read(path)


def test_a_sheet_of_more_cells_than_are_read(tmp_path, monkeypatch):
    openpyxl = pytest.importorskip("openpyxl")
    book, path = openpyxl.Workbook(), tmp_path / "a.xlsx"
    for k in range(10):
        book.active.append((k, k * k))
    book.save(path)
    monkeypatch.setattr(formats, "MOST_CELLS", 19)
    assert refusal(path) == "a.xlsx: the sheet 'Sheet' covers more than 19 cells."


@pytest.mark.parametrize("part", ["xl/workbook.xml", "xl/worksheets/sheet1.xml"])
def test_a_spreadsheet_with_a_part_that_is_broken(part, tmp_path):
    openpyxl = pytest.importorskip("openpyxl")
    book, path = openpyxl.Workbook(), tmp_path / "a.xlsx"
    book.active.append(("t", "x"))
    book.save(tmp_path / "good.xlsx")
    with zipfile.ZipFile(tmp_path / "good.xlsx") as good, zipfile.ZipFile(path, "w") as broken:
        for name in good.namelist():
            broken.writestr(name, good.read(name).replace(b"<sheet", b"<she") if name == part else good.read(name))
    assert refusal(path)


def test_a_text_that_a_sheet_repeats_is_measured(tmp_path, monkeypatch):
    openpyxl = pytest.importorskip("openpyxl")
    book, path = openpyxl.Workbook(), tmp_path / "a.xlsx"
    for _ in range(100):
        book.active.append(["y" * 30_000] * 20)
    book.save(path)
    monkeypatch.setattr(memory, "free_memory", lambda: 2e8)
    monkeypatch.setattr(formats, "XML_BYTES", 0)  # as if it stood there once
    assert refusal(path) == "a.xlsx: reading it would take 160 MB of memory, and 200 MB are free."


def test_texts_of_a_table_are_not_read(tmp_path, monkeypatch):
    pyarrow = pytest.importorskip("pyarrow")
    from pyarrow import parquet

    columns = {"t": T, "x": T, "text": ["y" * 1_000_000] * len(T)}
    parquet.write_table(pyarrow.table(columns), tmp_path / "a.parquet")
    taken = []
    read_columns = parquet.ParquetFile.read
    monkeypatch.setattr(
        parquet.ParquetFile, "read", lambda self, names: taken.append(names) or read_columns(self, names)
    )
    record = read(tmp_path / "a.parquet")
    assert taken == [["t", "x"]]
    assert record.notes == ("Left out, being no numbers: text.",)


def test_a_table_with_a_name_twice(tmp_path):
    pyarrow = pytest.importorskip("pyarrow")
    from pyarrow import parquet

    parquet.write_table(pyarrow.Table.from_arrays([pyarrow.array(T)] * 3, ["t", "x", "x"]), tmp_path / "a.parquet")
    assert refusal(tmp_path / "a.parquet") == f"a.parquet: {TWICE}"


def test_a_table_is_measured_before_it_is_read(tmp_path, monkeypatch):
    pyarrow = pytest.importorskip("pyarrow")
    from pyarrow import parquet

    path = tmp_path / "a.parquet"
    parquet.write_table(pyarrow.table({"t": np.zeros(10**6)}), path)
    assert refusal(path, group="a") == "a.parquet: a group was given, but Parquet files have none."
    monkeypatch.setattr(memory, "SMALL", 0)
    monkeypatch.setattr(memory, "free_memory", lambda: 1e6)
    assert refusal(path).startswith("a.parquet: reading it would take")


def test_a_broken_mdf_file_and_a_group_that_there_is_not(tmp_path, file):
    asammdf = pytest.importorskip("asammdf")
    with asammdf.MDF(version="4.10") as made:
        made.append([asammdf.Signal(np.sin(T), T, name="x")])
        made.append([asammdf.Signal(np.full(20, np.nan), T / 2, name="lost")])
        made.save(tmp_path / "run.mf4")
    assert refusal(tmp_path / "run.mf4", group="7") == "run.mf4: there is no channel group '7'. Known here: 0, 1."
    with pytest.raises(DataError, match="lost"):
        read(tmp_path / "run.mf4", only=["lost"])
    said = refusal(file("a.mf4", (tmp_path / "run.mf4").read_bytes()[:300]))
    assert said.startswith("a.mf4: this is not an MDF file that can be read (")


@pytest.mark.parametrize("wrong", [0.4, 0.3, np.nan])
def test_a_slow_channel_of_an_mdf_file_whose_time_stands_or_falls(wrong, tmp_path):
    asammdf = pytest.importorskip("asammdf")
    slow = T[::2].copy()
    slow[3] = wrong  # after 0.4
    slow[2] = 0.4
    with asammdf.MDF(version="4.10") as made:
        made.append([asammdf.Signal(np.sin(T), T, name="x")])
        made.append([asammdf.Signal(T[::2] ** 2, slow, name="y")])
        made.save(tmp_path / "run.mf4")
    record = read(tmp_path / "run.mf4", rows=(1, 19))
    assert np.abs(record["y"] - T[:19] ** 2).max() < 0.03  # beside the gap too
    left = "" if np.isnan(wrong) else " (1 of its samples left out, as time does not increase)"
    assert f"Interpolated at the times of the group with most samples: y{left}." in record.notes


def test_nothing_is_printed_of_a_damaged_mdf_file(tmp_path, file, capfd):
    asammdf = pytest.importorskip("asammdf")
    with asammdf.MDF(version="4.10") as made:
        made.append([asammdf.Signal(np.sin(T), T, name="x")])
        made.save(tmp_path / "run.mf4")
    content = (tmp_path / "run.mf4").read_bytes()
    refused = 0
    for k in range(64, len(content), 97):
        path = file("a.mf4", content[:k] + b"\0" * 8 + content[k + 8 :])
        try:
            read(path)
        except DataError:
            refused += 1
    assert refused >= 3
    assert capfd.readouterr() == ("", "")


def test_columns_of_no_rows(tmp_path):
    pyarrow = pytest.importorskip("pyarrow")
    parquet = pytest.importorskip("pyarrow.parquet")
    empty = {"t": pyarrow.array([], pyarrow.timestamp("s")), "x": pyarrow.array([], pyarrow.float64())}
    parquet.write_table(pyarrow.table(empty), tmp_path / "a.parquet")
    assert refusal(tmp_path / "a.parquet").startswith("a.parquet: no arrays of one length were found")


# ---- HDF5 and MAT 7.3


@pytest.fixture
def hdf5(tmp_path):
    h5py = pytest.importorskip("h5py")

    def make(name, fill):
        path = tmp_path / name
        with h5py.File(path, "w", userblock_size=512 if name.endswith(".mat") else 0) as file:
            file["t"], file["x"] = T, np.sin(T)
            fill(h5py, file)
        return path

    return make


def test_links_that_lead_nowhere(hdf5):
    def fill(h5py, file):
        file["x_out"] = h5py.SoftLink("/lost")

    assert refusal(hdf5("a.mat", fill)) == "a.mat: 'x_out' is a link to an item that is not in the file."


@pytest.mark.parametrize("group", [False, True])
def test_links_into_other_files_are_refused(group, hdf5, tmp_path):
    hdf5("secret.h5", lambda h5py, file: None)

    def fill(h5py, file):
        place = file.create_group("s") if group else file
        place["x_out"] = h5py.ExternalLink(str(tmp_path / "secret.h5"), "/x")

    said = refusal(hdf5("a.mat", fill))
    assert said.startswith("a.mat: 'x_out' is a link into another file (")
    assert said.endswith("/secret.h5: /x), which is not read.")


@pytest.mark.parametrize("name", ["a.h5", "a.mat"])
def test_data_in_other_files_are_refused(name, hdf5, tmp_path):
    (tmp_path / "raw").write_bytes(np.sin(T).tobytes())

    def outside(h5py, file):
        file.create_dataset("x_out", T.shape, "f8", external=[(str(tmp_path / "raw"), 0, 160)])

    def virtual(h5py, file):
        layout = h5py.VirtualLayout(T.shape, "f8")
        layout[:] = h5py.VirtualSource(str(tmp_path / "secret.h5"), "x", T.shape)
        file.create_virtual_dataset("x_out", layout)

    for fill in (outside, virtual):
        assert refusal(hdf5(name, fill)) == f"{name}: the data of '/x_out' are in another file, which is not read."


@pytest.mark.parametrize("name", ["a.h5", "a.mat"])
def test_what_a_file_announces_is_measured_before_it_is_read(name, hdf5):
    def fill(h5py, file):
        file.create_dataset("x_out", (10**7, 10**7), "f8", chunks=(1000, 1000), fillvalue=1.0)

    said = refusal(hdf5(name, fill))
    assert said.startswith(f"{name}: its content up to '/x_out' (10000000, 10000000) would take 800,000 GB of memory")


def test_names_that_are_not_utf_8(hdf5):
    def fill(h5py, file):
        group = file.create_group("s")
        h5py.h5d.create(group.id, b"x\xb5m", h5py.h5t.NATIVE_DOUBLE, h5py.h5s.create_simple(T.shape))

    assert refusal(hdf5("a.mat", fill)) == "a.mat: the name 'x�m' in it is not UTF-8 text."
    assert "x" in read(hdf5("a.h5", fill)).names


def test_groups_that_hold_themselves(hdf5):
    def fill(h5py, file):
        group = file.create_group("s")
        for k in range(10):
            group[f"again{k}"] = group

    assert refusal(hdf5("a.mat", fill)) == "a.mat: it leads to more than 20,000 groups and data sets."


# ---- memory


def test_files_of_more_data_sets_than_are_read(hdf5, monkeypatch):
    from tsmblocks.data import hdf5 as reader

    monkeypatch.setattr(reader, "MOST_ITEMS", 1)
    assert refusal(hdf5("a.h5", lambda h5py, file: None)).startswith(
        "a.h5: it leads to more than 1 groups and data sets."
    )


def test_types_and_empty_structures_beside_signals(hdf5):
    def fill(h5py, file):
        file["kind"] = np.dtype("f8")
        file.create_group("empty").attrs["MATLAB_class"] = np.bytes_("struct")

    assert read(hdf5("a.mat", fill)).names == ("x",)


def test_data_in_other_files_whose_name_is_not_utf_8_are_refused(hdf5, tmp_path):
    def fill(h5py, file):
        plan = h5py.h5p.create(h5py.h5p.DATASET_CREATE)
        plan.set_external(bytes(tmp_path / "raw"), 0, 160)
        space = h5py.h5s.create_simple(T.shape)
        h5py.h5d.create(file.id, b"x\xb5m", h5py.h5t.NATIVE_DOUBLE, space, dcpl=plan)

    assert refusal(hdf5("a.h5", fill)) == "a.h5: the data of '/x�m' are in another file, which is not read."


def test_the_message_has_the_size_and_the_memory(monkeypatch):
    monkeypatch.setattr(memory, "free_memory", lambda: 2e9)
    memory.refuse_too_large(1.5e9, "this")
    with pytest.raises(DataError, match=r"this would take 7.5 GB of memory, and 2 GB are free. Take less."):
        memory.refuse_too_large(7.5e9, "this", "Take less.")


def test_the_memory_of_this_machine_is_known():
    assert 1e7 < memory.free_memory() < 1e16


def test_a_limit_of_the_process_counts():
    resource = pytest.importorskip("resource")
    before = resource.getrlimit(resource.RLIMIT_AS)
    try:
        resource.setrlimit(resource.RLIMIT_AS, (1 << 42, before[1]))
        assert memory.free_memory() < 1 << 42
    finally:
        resource.setrlimit(resource.RLIMIT_AS, before)


def test_recordings_of_ours_are_read_again(tmp_path):
    record = Record("ramp", T, {"x": np.sin(T)}, {"x": "rad"})
    for kind in ("csv", "npz", "mat"):
        record.save(tmp_path / f"a.{kind}")
        assert np.array_equal(read(tmp_path / f"a.{kind}").signals["x"], np.sin(T))
