"""Results of a study read again from the files that it wrote."""

from __future__ import annotations

from pathlib import Path

import numpy as np

from tsmblocks.common.errors import DataError
from tsmblocks.metrics.metrics import named
from tsmblocks.studies.plans import as_column
from tsmblocks.studies.results import Results, described_results
from tsmblocks.studies.store import facts_path, parsed_cell, read_table


def read_study(path: str | Path) -> Results:
    """Return results that ``study`` has written, complete or not.

    Parameters
    ----------
    path : str or Path
        The .csv file, beside its ``.study.json``.

    Returns
    -------
    Results
        The results, without diagram.

    Raises
    ------
    DataError
        For files that are not those of a study, with the line.

    Examples
    --------
    >>> from pathlib import Path
    >>> from tempfile import mkdtemp
    >>> import tsmblocks as tsm
    >>> path = Path(mkdtemp()) / "gains.csv"
    >>> _ = tsm.study(tsm.load("fig16_feedforward_feedback"), {"pid.kp": [1.0, 1.5]}, "rms(u)", stop=1.0, out=path)
    >>> tsm.read_study(path)
    Results('Feedforward plus PID feedback of the tip', 2 of 2 runs, metrics rms(u))
    """
    path = Path(path)
    table = read_table(path)
    facts, runs = table.facts, np.array(sorted(table.rows), dtype=int)
    try:
        count, wanted = int(facts["runs"]), {**dict.fromkeys(facts["parameters"], ""), **facts["units"]}
        _ = dict(facts["metrics"]), facts["title"], facts["kind"]
    except (KeyError, TypeError, ValueError):
        raise DataError(f"{facts_path(path)}: facts of the study are missing.") from None
    if [named(one) for one in table.heading[1:]] != list(wanted.items()):
        raise DataError(f"{path}:1: the heading does not have the parameters and metrics of {facts_path(path).name}.")
    if len(runs) and runs[-1] >= count:
        raise DataError(f"{path}: there are {count} runs, and a row of run {runs[-1]}.")
    columns = {name: as_column([parsed_cell(table.rows[run][k]) for run in runs]) for k, name in enumerate(wanted)}
    for name in facts["units"]:
        if columns[name].dtype.kind != "f":
            raise DataError(f"{path}: the column '{name}' has a value that is no number.")
    return described_results(facts, runs, columns, path)
