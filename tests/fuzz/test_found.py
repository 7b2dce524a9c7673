"""Inputs with which attacks found faults, each refused since."""

import json

import numpy as np
import pytest

import tsmblocks as tsm
from tsmblocks.common.errors import TsmError
from tsmblocks.studies.files import load_study


@pytest.mark.parametrize("number", ["1" * 50, "1" * 5000])
def test_a_run_whose_number_no_counter_holds(number, tmp_path):
    diagram = tsm.load("fig09b_feedforward")
    path = tmp_path / "results.csv"
    tsm.study(diagram, {"theta": [4.0]}, "rms(x_ref - x_out)", stop=0.1, step=0.005, out=path)
    path.write_text(path.read_text(encoding="utf-8").replace("\n0,", f"\n{number},"), encoding="utf-8")
    with pytest.raises(TsmError, match=r"results\.csv:2: 3 columns are expected, the first being the number of a run"):
        tsm.read_study(path)


def test_a_study_of_a_diagram_whose_name_no_file_can_have(tmp_path):
    path = tmp_path / "study.toml"
    path.write_text(f'format = 1\ndiagram = "{"x" * 300}"\n[vary]\na = [1]\n[metrics]\nm = "rms(x)"\n', "utf-8")
    with pytest.raises(TsmError, match="there is no file"):
        load_study(path)


@pytest.mark.parametrize(
    ("times", "text"),
    [
        ([], "resampling needs several samples, and there are 0"),
        ([0.0, np.inf, 1.0, 2.0], "the time of sample 1 is inf s, and resampling needs times that increase"),
        ([0.0, 1.0, 1.0, 2.0], "the time of sample 2 is 1 s, and resampling needs times that increase"),
        ([-1e308, 0.0, 1.0, 1e307], "a step of 0.1 s makes "),
    ],
)
def test_times_that_cannot_be_resampled(times, text):
    record = tsm.Record("r", times, {"x": np.zeros(len(times))}, {})
    with pytest.raises(TsmError) as caught:
        record.resampled(0.1)
    assert text in str(caught.value)


@pytest.mark.parametrize("content", [{"columns": ["t"], "data": [[]]}, {"columns": [], "data": [[1]]}])
def test_tables_of_json_whose_rows_have_another_length(content, tmp_path):
    path = tmp_path / "a.json"
    path.write_text(json.dumps(content), encoding="utf-8")
    with pytest.raises(TsmError, match="row 1 of 'data' must list"):
        tsm.read(path)


def test_a_date_beyond_the_last_column(tmp_path):
    path = tmp_path / "a.csv"
    rows = "".join(f"{k},{k * k}\n" for k in range(1, 10))
    path.write_text(f"t,x\n0,0,2026-11-22 14:03:01.5\n{rows}", encoding="utf-8")
    with pytest.raises(TsmError, match="row 2 has 3 cells, but there are 2 columns"):
        tsm.read(path)
