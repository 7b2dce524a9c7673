"""The data options of the commands: what they hand to the reader, and the notes that come back."""

import numpy as np
import pytest

from tsmblocks.cli import common, recordings
from tsmblocks.common.errors import DataError


@pytest.fixture
def told(capsys):
    """Read with these options; the record and what was said about it."""

    def run(*words, only=("x",), path=None):
        parser = common.Parser(prog="tool")
        recordings.data_arguments(parser)
        record = recordings.read_record(parser.parse_args([str(word) for word in words]), only, path)
        return record, capsys.readouterr().err

    return run


def write(path, t, x, head="t,x\n"):
    path.write_text(head + "".join(f"{a:g},{b:g}\n" for a, b in zip(t, x, strict=True)))
    return path


T = np.arange(20.0)


def test_a_tail_and_a_gap(told, tmp_path):
    path = write(tmp_path / "a.csv", np.r_[T, T + 100, 0.0, 1.0], np.arange(42))
    record, said = told("--data", path, "--tail", "drop", "--gaps", "keep")
    assert len(record) == 40
    assert said.splitlines() == [
        f"note: {path}: Time jumps back at row 42, from 119 s to 0 s; everything from there on (2 rows, 5 %) was "
        "dropped, as requested.",
        f"note: {path}: Samples are missing in one place. It lasts 81.0 usual steps, before row 22 (from 19 s to "
        "100 s); signals are interpolated there. Long gaps were kept, as requested.",
    ]
    with pytest.raises(DataError, match="--tail drop"):
        told("--data", path)
    with pytest.raises(DataError, match="--gaps keep"):
        told("--data", path, "--tail", "drop")


def test_a_file_without_a_time_column(told, tmp_path):
    path = write(tmp_path / "a.csv", T, T, head="u,x\n")
    record, said = told("--data", path, "--sampling", "0.5")
    np.testing.assert_array_equal(record.t, T / 2)
    assert said == ""
    with pytest.raises(DataError, match=r"Or give the step of the rows in s \(step=…, or --sampling\)"):
        told("--data", path)


def test_a_group_of_a_file(told, tmp_path):
    from scipy.io import savemat

    savemat(tmp_path / "a.mat", {"a": {"t": T, "x": T}, "b": {"t": T, "x": 2 * T}})
    record, _ = told("--data", tmp_path / "a.mat", "--group", "b")
    np.testing.assert_array_equal(record["x"], 2 * T)


def test_one_of_several_files(told, tmp_path):
    other = write(tmp_path / "b.csv", T, -T)
    record, _ = told("--data", write(tmp_path / "a.csv", T, T), path=str(other))
    np.testing.assert_array_equal(record["x"], -T)


def test_options_that_are_no_choice(told):
    with pytest.raises(common.UsageError, match="argument --tail: invalid choice: 'cut'"):
        told("--tail", "cut")
